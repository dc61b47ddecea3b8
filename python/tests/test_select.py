"""A selection has what ``chpm extract`` writes, for every way to select."""

from __future__ import annotations

import struct
import warnings
import zlib

import chpm
import meshes
import numpy as np
import pytest
from conftest import MODELS, tell

CAMERA = (2.5, 1.0, 3.0, 0.1, 0.0, -0.2)

# What is selected, and the same for the command.
WAYS = {
    "source": (dict(level=0), "--level 0"),
    "level": (dict(level=1), "--level 1"),
    "error": (dict(error=0.02), "--error 0.02"),
    "exact": (dict(error=0), "--error 0"),
    "loose": (dict(error=1e9), "--error 1e9"),
    "share": (dict(error="2%"), "--error 2%"),
    "triangles": (dict(triangles=3000), "--triangles 3000"),
    "triangles_text": (dict(triangles="2.5k"), "--triangles 2.5k"),
    "triangles_share": (dict(triangles="40%"), "--triangles 40%"),
    "pixels": (dict(pixels=2), "--poe 2"),
    "camera": (dict(camera=CAMERA), "--poe 1 --camera {camera}"),
    "wide": (dict(camera=(*CAMERA, 80.0), pixels=3.5), "--poe 3.5 --camera {camera},80"),
    "picture": (dict(camera=CAMERA, viewport=(1280, 720), pixels=0.5), "--poe 0.5 --camera {camera} --viewport 1280x720"),
    "culled": (dict(camera=CAMERA, cull=True), "--poe 1 --camera {camera} --cull"),
    "seen": (dict(camera=CAMERA, triangles=2500), "--triangles 2500 --camera {camera}"),
    "seen_culled": (dict(camera=CAMERA, triangles=2500, cull=True), "--triangles 2500 --camera {camera} --cull"),
}


def same(mine, theirs) -> None:
    assert (mine is None) == (theirs is None)
    if mine is not None:
        assert mine.dtype == theirs.dtype and mine.shape == theirs.shape
        assert mine.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", MODELS)
def test_a_selection_is_what_the_command_extracts(models, tmp_path, name, way):
    keywords, words = WAYS[way]
    with chpm.open(models[name]) as file:
        origin = file.origin
        camera = [*(np.array(CAMERA[:3]) + origin), *(np.array(CAMERA[3:]) + origin)]
        if "camera" in keywords:
            keywords = {**keywords, "camera": [*camera, *keywords["camera"][6:]]}
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                mesh, refused = file.select(**keywords), None
            except chpm.SelectionError as error:
                mesh, refused = None, error
    out = tmp_path / "out.ply"
    words = words.format(camera=",".join(repr(float(x)) for x in camera)).split()
    done = tell("extract", models[name], *words, "-o", out, "-q")
    lines = done.stderr.splitlines()
    if refused:
        # The same words, a cause a line.
        assert done.returncode == 2 and name in ("one", "roots"), lines
        assert [line.removeprefix("error: ").removeprefix("  because: ") for line in lines] == str(refused).split(": ", 1)
        return
    assert done.returncode == 0, lines
    assert [f"warning: {warning.message}" for warning in warned] == lines
    ply = meshes.read(out)
    same(mesh.faces, ply.faces)
    same(mesh.absolute() if origin.any() else mesh.vertices, ply.points)
    same(mesh.normals, ply.normals)
    same(mesh.colors, ply.colors)
    assert (np.float32(mesh.error), np.float32(mesh.distance)) == (np.float32(ply.error), np.float32(ply.distance))
    assert (mesh.vertex_count, mesh.triangle_count) == (len(ply.points), len(ply.faces))
    assert mesh.vertices.dtype == np.float32 and mesh.absolute().dtype == np.float64
    same(mesh.absolute(), mesh.vertices.astype("f8") + mesh.origin)


def test_the_models_are_as_different_as_they_should_be(models):
    opened = {name: chpm.open(path) for name, path in models.items()}
    assert [name for name, file in opened.items() if file.root_count > 1] == ["roots"]
    assert [name for name, file in opened.items() if file.origin.any()] == ["far", "far_packed"]
    assert [name for name, file in opened.items() if file.has_colors] == ["looks", "packed"]
    packed = ["packed", "octahedral_packed", "far_packed", "lattice"]
    assert [name for name, file in opened.items() if file.is_packed] == packed
    normals = ["looks", "packed", "octahedral", "octahedral_packed"]
    assert [name for name, file in opened.items() if file.has_normals] == normals
    dust = opened["dust"].select(level=len(opened["dust"].levels) - 1)
    assert dust.distance > dust.error > 0


def test_other_ways_to_say_it_are_the_same(models):
    with chpm.open(models["plain"]) as file:
        camera = chpm.Camera(CAMERA[:3], CAMERA[3:], fov=60)
        pairs = [
            (dict(camera=camera), dict(camera=np.array([*CAMERA, 60]))),
            (dict(camera=file.camera(), pixels=2), dict(pixels=2)),
            (dict(triangles=np.int64(3000)), dict(triangles=3e3)),
            (dict(error=np.float32(0.5)), dict(error="0.5")),
        ]
        for one, other in pairs:
            same(file.select(**one).faces, file.select(**other).faces)
        upright = chpm.Camera([0, 0, 5], [0, 0, 0], up=[0, 1, 0], fov=20, near=0.5)
        assert (upright.position, upright.target, upright.up) == ((0, 0, 5), (0, 0, 0), (0, 1, 0))
        assert (upright.fov, upright.near) == (20, 0.5)
        assert repr(upright) == "chpm.Camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), fov=20.0, near=0.5)"


def test_arrays_are_the_callers(models):
    with chpm.open(models["looks"]) as file:
        mesh = file.select(triangles=2000)
        again = file.select(triangles=2000)
    assert mesh.vertices is mesh.vertices
    mesh.vertices[:] += 1
    assert not np.shares_memory(mesh.vertices, again.vertices)
    assert (mesh.vertices != again.vertices).any()
    assert "Selection" in repr(mesh) and str(mesh.triangle_count) in repr(mesh)


def test_what_cannot_be_selected_is_told(models):
    with chpm.open(models["plain"]) as file:
        name = str(models["plain"])
        for keywords, told in [
            ({}, "nothing is asked for"),
            (dict(error=1, triangles=5), "error and triangles cannot both be given"),
            (dict(level=0, pixels=1), "level and pixels cannot both be given"),
            (dict(level=0, camera=CAMERA), "level is the same from everywhere"),
            (dict(error=1, camera=CAMERA), "error is the same from everywhere"),
            (dict(error=1, cull=True), "viewport and cull are of a picture"),
            (dict(triangles=5000, viewport=(10, 10)), "viewport and cull are of a picture"),
            (dict(level=99), f"'{name}' does not have that: no level 99: the highest is"),
            (dict(triangles=1), f"'{name}' does not have that: the coarsest mesh has"),
            (dict(triangles=0), "at least 1"),
            (dict(triangles=-5), "at least 1"),
            (dict(triangles=1.5), "whole number"),
            (dict(triangles=float("nan")), "whole number"),
            (dict(triangles="many"), "not a whole number"),
            (dict(triangles="200%"), "no share"),
            (dict(level=-1), "numbered from 0"),
            (dict(error=-1), "at least 0"),
            (dict(error=float("nan")), "at least 0"),
            (dict(error="1 mm"), "no length"),
            (dict(pixels=-1), "pixels of error"),
            (dict(pixels=float("inf")), "pixels of error"),
            (dict(camera=[1, 2, 3]), "6 or 7 numbers"),
            (dict(camera=[0] * 6), "a target away from the position"),
            (dict(camera=[float("nan")] * 6), "finite numbers"),
            (dict(camera=[*CAMERA, 180]), "field of view"),
            (dict(camera=CAMERA, viewport=(0, 5)), "viewport"),
        ]:
            with pytest.raises(chpm.SelectionError) as raised:
                file.select(**keywords)
            assert told in str(raised.value), keywords
            assert isinstance(raised.value, ValueError) and isinstance(raised.value, chpm.Error)
        for keywords in [dict(error=[]), dict(triangles=None, level="x"), dict(camera="here"), dict(sort=1)]:
            with pytest.raises(TypeError):
                file.select(**keywords)


def test_less_than_was_asked_for_is_a_warning_or_an_error(models):
    with chpm.open(models["trimmed"]) as file:
        with pytest.warns(chpm.ShortfallWarning, match="the finest mesh of .* has an error of") as caught:
            mesh = file.select(error=1e-6)
        assert mesh.shortfall == str(caught[0].message) and mesh.triangle_count > 0
        assert caught[0].filename == __file__
        with pytest.raises(chpm.SelectionError, match="the finest mesh of"):
            file.select(error=1e-6, strict=True)
        with pytest.warns(chpm.ShortfallWarning, match="fewer than 1,000,000"):
            file.select(triangles=1_000_000)
        with pytest.warns(chpm.ShortfallWarning, match="is in the image"):
            file.select(camera=[0, 0, 10, 0, 0, 20], cull=True)
        assert file.select(triangles="100%", strict=True).shortfall is None


def test_a_bound_is_never_rounded_up(models):
    with chpm.open(models["plain"]) as file:
        least = file.select(level=0).distance
        coarser = file.select(error=8 * least + 1e-3 * np.linalg.norm(np.subtract(*file.bounds)))
        # The nearest single is what the coarser mesh has, and more than what is asked for.
        asked = float(coarser.distance) * (1 - 2**-27)
        assert np.float32(asked) == np.float32(coarser.distance) and asked < coarser.distance
        assert file.select(error=asked).distance <= asked


def png(pixels: np.ndarray) -> bytes:
    """An RGB image of 8 bits."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def test_textures_come_with_places_and_images(tmp_path):
    # Left half of the square dark, right half light.
    side = 24
    u, v = np.meshgrid(np.linspace(0, 1, side + 1), np.linspace(0, 1, side + 1))
    points = np.stack([u, v, 0.1 * np.sin(5 * u) * np.cos(4 * v)], -1).reshape(-1, 3)
    pixels = np.zeros((256, 256, 3), "u1")
    pixels[:, 128:] = 240
    (tmp_path / "half.png").write_bytes(png(pixels))
    (tmp_path / "half.mtl").write_text("newmtl half\nmap_Kd half.png\n")
    with open(tmp_path / "half.obj", "w") as text:
        text.write("mtllib half.mtl\nusemtl half\n")
        text.writelines(f"v {x} {y} {z}\nvt {x} {y}\n" for x, y, z in points)
        for row in range(side):
            for column in range(side):
                a = row * (side + 1) + column + 1
                b = a + side + 1
                text.write(f"f {a}/{a} {a + 1}/{a + 1} {b + 1}/{b + 1} {b}/{b}\n")
    with chpm.build(tmp_path / "half.obj", tmp_path / "half.chpm", texture="sheets", cluster_triangles=256) as file:
        plain = file.select(level=0)
        assert plain.uv is None and plain.images == [] and plain.face_images is None
        mesh = file.select(level=0, texture_size=512)
        few = file.select(triangles=300, texture_size=512)
        for size in (255, 16385):
            with pytest.raises(chpm.SelectionError, match="texture_size: 256 to 16384 expected"):
                file.select(level=0, texture_size=size)
    assert mesh.triangle_count == plain.triangle_count == 2 * side * side
    assert 2 < few.triangle_count <= 300 and len(few.uv) == few.vertex_count
    assert mesh.uv.shape == (mesh.vertex_count, 2) and mesh.uv.dtype == np.float32
    assert mesh.uv.min() >= 0 and mesh.uv.max() <= 1
    assert mesh.colors is None and mesh.face_images.max() + 1 == len(mesh.images) >= 1
    assert all(image[:2] == b"\xff\xd8" for image in mesh.images)
    # Written as an OBJ and read back, each vertex has the colour of its half.
    for number, image in enumerate(mesh.images):
        (tmp_path / f"{number}.jpg").write_bytes(image)
    with open(tmp_path / "back.obj", "w") as text:
        text.write("mtllib back.mtl\n")
        text.writelines(f"v {x} {y} {z}\n" for x, y, z in mesh.absolute())
        text.writelines(f"vt {u} {v}\n" for u, v in mesh.uv)
        for (a, b, c), number in zip(mesh.faces + 1, mesh.face_images):
            text.write(f"usemtl m{number}\nf {a}/{a} {b}/{b} {c}/{c}\n")
    (tmp_path / "back.mtl").write_text("".join(f"newmtl m{n}\nmap_Kd {n}.jpg\n" for n in range(len(mesh.images))))
    with chpm.build(tmp_path / "back.obj", tmp_path / "back.chpm", texture="vertices") as file:
        back = file.select(level=0)
        with pytest.raises(chpm.SelectionError, match="no sheets"):
            file.select(level=0, texture_size=512)
    x, red = back.absolute()[:, 0], back.colors[:, 0]
    # The image repeats, so that each border shows a little of the other.
    dark, light = red[(x > 0.05) & (x < 0.45)], red[(x > 0.55) & (x < 0.95)]
    assert len(dark) > 100 and len(light) > 100
    assert (dark < 60).all() and (light > 180).all()
