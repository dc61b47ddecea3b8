"""What is built, simplified, verified and measured in this process is what the command makes of the same."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import textwrap
import threading
import time
import zlib
from concurrent.futures import ThreadPoolExecutor

import chpm
import conftest
import meshes
import numpy as np
import pytest

SETTINGS = [
    {},
    {"pages": "packed", "normals": "computed", "seed": 3},
    {"positions": "lattice:12", "colors": False, "cluster_triangles": 256},
    {"boundary": "lock", "topology": "keep", "partitioner": "greedy", "order": "cache-oblivious"},
    {"finest_error": "0.1%", "target_error": 0.05, "normals": "none"},
]


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "looks.ply"
    meshes.write(path, *meshes.looks())
    return path


def words(settings):
    for name, value in settings.items():
        yield "--no-colors" if name == "colors" else f"--{name.replace('_', '-')}={value}"


def test_pages_go_to_volumes_and_are_read_from_them(source, tmp_path):
    settings = {"volume_size": "200K", "cluster_triangles": 256}
    conftest.run("build", source, "-o", tmp_path / "command.chpm", "-q", *words(settings))
    with chpm.build(source, tmp_path / "own.chpm", **settings) as file, chpm.build(source, tmp_path / "one.chpm", cluster_triangles=256) as one:
        volumes = sorted(tmp_path.glob("own.*.pages"))
        assert len(volumes) > 1
        for own in [tmp_path / "own.chpm", *volumes]:
            assert own.read_bytes() == own.with_name(own.name.replace("own", "command")).read_bytes()
        mesh, expected = file.select(level=0), one.select(level=0)
        assert np.array_equal(mesh.vertices, expected.vertices) and np.array_equal(mesh.faces, expected.faces)
        file.check()
        os.utime(volumes[-1], (0, 0))
        with pytest.raises(chpm.FileError, match=r"pages' was changed"):
            file.check()
    volumes[0].unlink()
    with pytest.raises(chpm.DamagedError, match=r"own\.0001\.pages' is not there"):
        chpm.open(tmp_path / "own.chpm")
    with pytest.raises(ValueError, match="volume_size: 'huge' is no size"):
        chpm.build(source, tmp_path / "bad.chpm", volume_size="huge")


def test_a_source_that_changes_is_built_anew_where_it_has_changed(tmp_path):
    source, settings = tmp_path / "torus.ply", {"cluster_triangles": 64}
    conftest.run("synth", "torus", "--triangles", "20000", "-o", source, "-q")
    chpm.build(source, tmp_path / "old.chpm", updatable=True, **settings).close()
    with chpm.open(tmp_path / "old.chpm") as file:
        mesh = file.select(level=0)
    vertices = mesh.vertices.copy()
    vertices[5] += 1e-3
    chpm.build(vertices, mesh.faces, tmp_path / "nothing.chpm", updatable=True, **settings).close()
    chpm.build(vertices, mesh.faces, tmp_path / "new.chpm", update=tmp_path / "old.chpm", **settings).close()
    for name in ["{}.chpm", "{}.chpm.memo"]:
        assert (tmp_path / name.format("new")).read_bytes() == (tmp_path / name.format("nothing")).read_bytes()
    with pytest.raises(chpm.BuildError, match=r"plain\.chpm\.memo"):
        chpm.build(source, tmp_path / "plain.chpm", **settings).close()
        chpm.build(source, tmp_path / "other.chpm", update=tmp_path / "plain.chpm", **settings)
    with pytest.raises(ValueError, match="updatable: such a build is not gone on with"):
        chpm.build(source, tmp_path / "x.chpm", updatable=True, resume=True)


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda settings: "-".join(settings) or "none")
def test_a_file_is_built_to_the_bytes_of_the_command(source, tmp_path, settings):
    conftest.run("build", source, "-o", tmp_path / "command.chpm", "-q", *words(settings))
    expected = (tmp_path / "command.chpm").read_bytes()
    for name, means in [("one", {"threads": 1, "memory": "128M"}), ("all", {})]:
        out = tmp_path / f"{name}.chpm"
        with chpm.build(source, out, **settings, **means) as file:
            assert not file.closed and file.path == out
        assert out.read_bytes() == expected


def png(color):
    """An image of one pixel."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0)
    pixels = zlib.compress(b"\0" + bytes(color))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def test_images_become_colours(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
    (tmp_path / "a.png").write_bytes(png((10, 200, 30)))
    obj = tmp_path / "a.obj"
    obj.write_text("mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    for texture, expected in [(None, [10, 200, 30, 255]), ("vertices", [10, 200, 30, 255]), ("sheets", [10, 200, 30, 255]), ("none", None)]:
        with chpm.build(obj, tmp_path / "a.chpm", force=True, texture=texture) as file:
            colors = file.select(level=0).colors
            assert (colors is None) if expected is None else (colors == expected).all()

    (tmp_path / "a.png").unlink()
    with pytest.raises(chpm.BuildError, match="a.png"):
        chpm.build(obj, tmp_path / "b.chpm", missing_images="refuse")
    with pytest.raises(ValueError, match="texture: one of 'none', 'vertices', 'sheets' expected"):
        chpm.build(obj, tmp_path / "b.chpm", texture="images")


@pytest.mark.parametrize("pages", ["raw", "packed", "chained"])
def test_scalars_that_are_kept_are_arrays(tmp_path, pages):
    points, faces, _, _ = meshes.sphere()
    rng = np.random.default_rng(5)
    scalars = {"quality": rng.random(len(points), "f4"), "time": rng.random(len(points))}
    path = tmp_path / "scan.ply"
    meshes.write(path, points, faces, None, None, scalars)
    of = {tuple(point): tuple(row) for point, *row in zip(points.tolist(), *(a.tolist() for a in scalars.values()))}

    with chpm.build(path, keep="quality", force=True, pages=pages) as file:
        assert list(file.scalars) == ["quality"]
    with chpm.build(path, keep=["time", "quality"], force=True, pages=pages) as file:
        assert list(file.scalars) == ["time", "quality"]
        told = file.scalars["time"]
        assert (told["type"], told["count"]) == ("float64", len(points))
        assert (told["low"], told["high"]) == (scalars["time"].min(), scalars["time"].max())
        parts = [file.select(triangles=1000), file.select(level=0), next(iter(file.pages()))]
        for part in parts:
            got = part.scalars
            assert (got["quality"].dtype, got["time"].dtype) == (np.float32, np.float64)
            for point, quality, time_ in zip(part.vertices.tolist(), got["quality"].tolist(), got["time"].tolist()):
                assert of[tuple(point)] == (quality, time_)
    with pytest.raises(ValueError, match="height"):
        chpm.build(path, keep="height", force=True)
    with pytest.raises(ValueError, match="keep"):
        chpm.build(path, keep=3, force=True)


def test_arrays_are_built_as_a_file_of_them_is(tmp_path):
    points, faces, normals, colors = meshes.looks()
    whole = points, faces, normals, colors
    for name, (points, faces, normals, colors) in {"looks": whole, "far": meshes.far(), "one": meshes.one()}.items():
        path = tmp_path / f"{name}.ply"
        meshes.write(path, points, faces, normals, colors)
        path.write_bytes(path.read_bytes().replace(b"list uchar int", b"list uchar uint", 1))
        conftest.run("build", path, "-q", "--cluster-triangles", 512)
        more = {key: value for key, value in {"normals": normals, "colors": colors}.items() if value is not None}
        out = tmp_path / "arrays.chpm"
        with chpm.build(points, faces, out, name=path.name, force=True, cluster_triangles=512, **more) as file:
            assert file.metadata["source"]["name"] == path.name
        assert out.read_bytes() == path.with_suffix(".chpm").read_bytes(), name


def test_arrays_may_be_of_any_width_and_order(tmp_path):
    points, faces, *_ = meshes.sphere()
    chpm.build(points, faces, tmp_path / "plain.chpm").close()
    expected = (tmp_path / "plain.chpm").read_bytes()
    strided = np.zeros((len(points), 6), "f4")
    strided[:, ::2] = points
    variants = [
        (strided[:, ::2], faces.astype("i2")),
        (np.asfortranarray(points), faces.astype("u8")[::-1][::-1]),
        (points.astype(">f4"), np.asfortranarray(faces.astype(">i4"))),
        (points.tolist(), faces.tolist()),
    ]
    for at, (vertices, corners) in enumerate(variants[:3]):
        out = tmp_path / f"{at}.chpm"
        chpm.build(vertices, corners, out).close()
        assert out.read_bytes() == expected, at
    # Lists of floats are doubles, which these are not more than singles of.
    with chpm.build(*variants[3], tmp_path / "lists.chpm") as file:
        assert file.triangle_count == len(faces)
    assert not [name for name in os.listdir(tmp_path) if not name.endswith(".chpm")]


POINTS = np.eye(3)
FACES = np.array([[0, 1, 2]])
NOT_FINITE = np.array([[0, 0, 0], [1, np.nan, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("points", "faces", "settings", "told"),
    [
        (POINTS[:, :2], FACES, {}, r"vertices: an array of the shape \(n, 3\) expected, got \(3, 2\)"),
        (POINTS.ravel(), FACES, {}, r"vertices: .*got \(9,\)"),
        (POINTS.astype(int), FACES, {}, "vertices: float32 or float64 expected, got int64"),
        (POINTS.astype("f2"), FACES, {}, "vertices: float32 or float64 expected, got float16"),
        (np.ma.masked_equal(POINTS, 1), FACES, {}, "vertices: an array without masked values expected"),
        (POINTS, np.ma.masked_equal(FACES, 2), {}, "faces: an array without masked values expected"),
        (NOT_FINITE, FACES, {}, r"vertices\[1\] is not finite: .*drop_invalid"),
        (POINTS, FACES.astype(float), {}, "faces: integers expected, got float64"),
        (POINTS, FACES[:, :2], {}, r"faces: an array of the shape \(n, 3\) expected, got \(1, 2\)"),
        (POINTS, [[0, 1, 2], [0, 1, -1]], {}, r"faces\[1\]: index -1 is negative"),
        (POINTS, [[0, 1, 3]], {}, r"faces\[0\]: index 3 is out of range: there are 3 vertices"),
        (POINTS, [[0, 1, 1]], {}, "arrays.*its one face is no triangle"),
        (POINTS, [], {}, "arrays.*no faces"),
        (POINTS, FACES, {"colors": POINTS.astype("f4")}, "colors: uint8 expected, got float32"),
        (POINTS, FACES, {"normals": POINTS[:2]}, "normals: one for each of 3 vertices expected, got 2"),
        (POINTS, FACES, {"memory": "1M"}, "memory: 1M is less than a build can stay below"),
        (POINTS, FACES, {"memory": "much"}, "memory: "),
        (POINTS, FACES, {"pages": "tight"}, "pages: one of 'raw', 'packed', 'chained' expected, got 'tight'"),
        (POINTS, FACES, {"positions": "lattice:99"}, "positions: .*lattice:BITS"),
        (POINTS, FACES, {"threads": 0}, "threads: 1 to 1024 expected, got 0"),
        (POINTS, FACES, {"seed": "x"}, "seed: not understood: 'x'"),
        (POINTS, FACES, {"no_such_thing": 1}, "no_such_thing: there is no such setting"),
    ],
)
def test_what_makes_no_sense_is_named(tmp_path, points, faces, settings, told):
    with pytest.raises(ValueError, match=f"(?s){told}"):
        chpm.build(points, faces, tmp_path / "out.chpm", **settings)
    assert os.listdir(tmp_path) == []


def test_invalid_rows_are_dropped_where_that_is_wanted(tmp_path):
    points = np.concatenate([POINTS, [[np.inf, 0, 0]]])
    faces = [[0, 1, 2], [1, 2, 3], [0, 1, -1], [2, 1, 9]]
    with chpm.build(points, faces, tmp_path / "out.chpm", drop_invalid=True) as file:
        assert file.triangle_count == 1
        assert file.metadata["repairs"]["dropped-faces"] == 3


def test_files_that_are_there_or_are_not_are_told(source, tmp_path):
    out = tmp_path / "out.chpm"
    chpm.build(source, out).close()
    with pytest.raises(chpm.FileError, match="exists already; force=True"):
        chpm.build(source, out)
    chpm.build(source, out, force=True).close()
    chpm.build(source).close()
    assert source.with_suffix(".chpm").read_bytes() == out.read_bytes()
    with pytest.raises(chpm.MissingFileError, match="missing.ply"):
        chpm.build(tmp_path / "missing.ply", tmp_path / "new.chpm")
    with pytest.raises(chpm.BuildError, match="is the source itself"):
        chpm.build(source, source, force=True)
    (tmp_path / "bad.ply").write_bytes(source.read_bytes()[:-5])
    with pytest.raises(chpm.BuildError, match="bad.ply"):
        chpm.build(tmp_path / "bad.ply")
    with pytest.raises(TypeError, match="vertices, faces and an output"):
        chpm.build(POINTS, FACES)


def test_progress_is_told_in_the_thread_that_builds(tmp_path):
    points, faces = meshes.bumpy(200, 400)
    told = []
    here = threading.get_ident()
    with chpm.build(points, faces, tmp_path / "out.chpm", progress=lambda *state: told.append((threading.get_ident(), *state))):
        pass
    assert told and all(thread == here and 0 <= done <= total for thread, _, done, total in told)
    assert {stage for _, stage, *_ in told} <= {"ingest", "decompose", "hierarchy", "simplify", "layout", "emit"}


def test_an_error_of_progress_ends_the_build_and_leaves_nothing(tmp_path):
    points, faces = meshes.bumpy(200, 400)

    def stop(stage, done, total):
        raise KeyError(stage)

    with pytest.raises(KeyError):
        chpm.build(points, faces, tmp_path / "out.chpm", progress=stop)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 7), (signal.SIGTERM, -signal.SIGTERM)])
def test_a_signal_leaves_nothing_behind(tmp_path, sent, code):
    # What a shell starts in the background ignores SIGINT, and so do its children.
    script = """
        import signal, sys, meshes, chpm
        signal.signal(signal.SIGINT, signal.default_int_handler)
        points, faces = meshes.bumpy(900, 1800)
        try:
            chpm.build(points, faces, sys.argv[1], progress=lambda *state: print(*state, flush=True))
        except KeyboardInterrupt:
            sys.exit(7)
    """
    words = [sys.executable, "-c", textwrap.dedent(script), str(tmp_path / "out.chpm")]
    # A thread of another library would take SIGTERM.
    environment = {**os.environ, "PYTHONPATH": os.path.dirname(__file__), "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment) as running:
        assert any("decompose" in line for line in running.stdout)
        running.send_signal(sent)
        running.stdout.read()
    assert running.returncode == code
    assert os.listdir(tmp_path) == []


def test_builds_go_side_by_side(tmp_path):
    points, faces = meshes.bumpy(150, 300)
    alone = tmp_path / "alone.chpm"
    chpm.build(points, faces, alone).close()
    with ThreadPoolExecutor(3) as pool:
        outs = [tmp_path / f"{at}.chpm" for at in range(3)]
        for file in pool.map(lambda out: chpm.build(points, faces, out, threads=2, memory="256M"), outs):
            file.close()
    assert all(out.read_bytes() == alone.read_bytes() for out in outs)


def test_python_goes_on_while_something_is_built(tmp_path):
    points, faces = meshes.bumpy(200, 400)
    seen = []
    done = threading.Event()

    def build():
        chpm.build(points, faces, tmp_path / "out.chpm").close()
        done.set()

    thread = threading.Thread(target=build)
    thread.start()
    while not done.is_set():
        seen.append(time.monotonic())
        time.sleep(1e-3)
    thread.join()
    assert len(seen) > 10


def test_a_simplified_mesh_is_what_the_command_writes(source, tmp_path):
    points, faces, normals, colors = meshes.looks()
    sizes = []
    for asked, words in [
        ({"triangles": 900}, ["--triangles", "900"]),
        *(({"within": "1%", "effort": n}, ["--within", "1%", "--effort", str(n)]) for n in range(4)),
        ({"within": "1%"}, ["--within", "1%"]),
    ]:
        conftest.run("simplify", source, *words, "-o", tmp_path / "small.ply", "-q", "--force")
        expected = meshes.read(tmp_path / "small.ply")
        for mesh in [
            chpm.simplify(source, **asked),
            chpm.simplify(points, faces, normals=normals, colors=colors, **asked),
        ]:
            assert mesh.triangle_count == len(expected.faces) and mesh.vertex_count == len(expected.points)
            assert sorted(mesh.vertices.tolist()) == sorted(expected.points.tolist())
            assert np.isclose(mesh.distance, expected.distance, rtol=1e-3)
        sizes.append(mesh.triangle_count)
    # By proof there are fewer, vertex by vertex fewer still; nothing given is 2.
    assert sizes[1] > sizes[2] > sizes[3] >= sizes[4] and sizes[5] == sizes[3]
    with pytest.raises(chpm.SelectionError, match="0 to 3"):
        chpm.simplify(source, within="1%", effort=4)
    with pytest.raises(chpm.SelectionError, match="give within"):
        chpm.simplify(source, triangles=900, effort=1)
    for wrong in [dict(), dict(within=1, triangles=3)]:
        with pytest.raises(chpm.SelectionError, match="within or triangles"):
            chpm.simplify(source, **wrong)
    with pytest.raises(TypeError, match="without faces"):
        chpm.simplify(points, triangles=3)


def test_a_simplified_mesh_is_within_or_there_is_none(tmp_path):
    dust = tmp_path / "dust.ply"
    conftest.run("synth", "odd:tetrahedra", "--triangles", 3000, "-o", dust, "-q")
    diagonal = np.linalg.norm(np.ptp(chpm.simplify(dust, triangles=3000).vertices, axis=0))
    for effort in [0, 1]:
        mesh = chpm.simplify(dust, within="0.1%", effort=effort)
        assert mesh.distance <= 1e-3 * diagonal and 0 < mesh.triangle_count <= 3000
    # What is missing is told by the name that was given.
    told = chpm.simplify(dust, triangles=10**6).shortfall
    assert str(dust) in told and "model.chpm" not in told


def test_a_verification_is_that_of_the_command(source, tmp_path):
    out = tmp_path / "out.chpm"
    chpm.build(source, out, cluster_triangles=512).close()
    found = chpm.verify(out, against=source, cuts=4, errors=True, same_as=out, threads=2)
    told = json.loads(conftest.run("verify", out, "--against", source, "--cuts", 4, "--errors", "--json", "-q"))
    assert found and found.sound and told["sound"]
    for name in ["fault_count", "faults", "clusters", "triangles", "trimmed", "against", "cuts"]:
        assert getattr(found, name) == told[name], name
    for ours, theirs in zip(found.errors["levels"], told["errors"]["levels"]):
        assert ours["level"] == theirs["level"] and ours["of_mesh"]["most"] == theirs["of_mesh"]["most"]

    other = tmp_path / "other.ply"
    points, faces, *_ = meshes.looks()
    meshes.write(other, points, faces[1:], None, None)
    found = chpm.verify(out, against=other)
    assert not found and found.fault_count == 1 and "is not in the source" in found.faults[0]
    damaged = tmp_path / "damaged.chpm"
    damaged.write_bytes(out.read_bytes()[:1000])
    found = chpm.verify(damaged)
    assert not found.sound and found.clusters is None
    with pytest.raises(chpm.MissingFileError):
        chpm.verify(tmp_path / "missing.chpm")
    with pytest.raises(ValueError, match="against is needed"):
        chpm.verify(out, errors=True)
    with pytest.raises(chpm.BuildError, match="has no level 99"):
        chpm.verify(out, against=source, errors=True, level=99)


def test_a_measurement_is_that_of_the_command(source, tmp_path):
    out, small = tmp_path / "out.chpm", tmp_path / "small.ply"
    chpm.build(source, out, cluster_triangles=512).close()
    found = chpm.measure(out, against=source, positions=1)
    told = json.loads(conftest.run("measure", out, "--against", source, "--positions", 1, "--json", "-q"))
    assert found.violations == told["violations"] == 0 and found.cuts == []
    assert [level["max"] for level in found.levels] == [level["max"] for level in told["levels"]]
    assert found.levels[0]["of_mesh"] == told["levels"][0]["of_mesh"]

    conftest.run("extract", out, "--triangles", 900, "-o", small, "-q")
    between = chpm.measure(source, small)
    told = json.loads(conftest.run("measure", source, small, "--json", "-q"))
    for name in ["max", "mean", "rms", "at", "diagonal", "forward", "backward"]:
        ours = getattr(between, name)
        assert (list(ours) if isinstance(ours, tuple) else ours) == told[name], name
    with pytest.raises(ValueError, match="one of second and against"):
        chpm.measure(out)
    with pytest.raises(chpm.BuildError, match="are not the triangles of"):
        chpm.measure(out, against=small)
