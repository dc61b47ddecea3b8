"""What an open file tells, and what becomes of files that are missing, damaged or changed."""

from __future__ import annotations

import errno
import gc
import json
import os
import pathlib
import subprocess
import sys
import textwrap

import chpm
import numpy as np
import pytest
from conftest import run


def test_facts_are_those_of_info(models):
    for name, path in models.items():
        told = json.loads(run("info", path, "--json"))
        with chpm.open(path) as file:
            assert (file.triangle_count, file.vertex_count) == (told["triangles"], told["vertices"]), name
            counts = {"clusters": file.cluster_count, "groups": file.group_count, "roots": file.root_count}
            assert counts.items() <= told["counts"].items()
            assert len(file) == file.cluster_count
            for level, theirs in zip(file.levels, told["levels"], strict=True):
                assert level.level == theirs["level"] and level.cluster_count == theirs["clusters"]
                assert (level.triangle_count, level.vertex_count) == (theirs["triangles"], theirs["vertices"])
                assert level.base_triangle_count == theirs["base_triangles"]
                assert (level.min_error, level.max_error) == (theirs["min_error"], theirs["max_error"])
            assert file.metadata["source"]["name"] == told["source"]["name"]
            assert file.metadata["generator"] == told["generator"]
            assert set(file.metadata) == {"generator", "source", "settings", "repairs", "warnings"}
            settings = {name.replace("-", "_"): value for name, value in file.metadata["settings"].items()}
            assert settings == told["settings"] and settings["cluster_triangles"] == "512"
            whole = file.select(level=0)
            points = whole.absolute()
            assert file.bounds.shape == (2, 3) and file.bounds.dtype == np.float64
            if name not in ("trimmed", "roots"):
                assert (file.bounds == [points.min(0), points.max(0)]).all(), name
            assert file.diagonal == pytest.approx(np.linalg.norm(file.bounds[1] - file.bounds[0]), rel=1e-6)
            assert file.is_certified and file.version[0] == 1
            assert file.max_error == max(level.max_error for level in file.levels)
            assert file.path == path and "chpm.File" in repr(file)


def test_files_are_closed_and_say_so(models):
    path = models["plain"]
    with chpm.open(str(path)) as file:
        assert not file.closed
        page = file.page(0)
        vertices = page.vertices
        kept = vertices.copy()
    assert file.closed and "closed" in repr(file)
    file.close()
    for use in [lambda: file.select(level=0), lambda: file.levels, lambda: file.page(0), lambda: file.pages(), file.check]:
        with pytest.raises(chpm.ClosedError, match=f"'{path}' is closed; open it again"):
            use()
    # What looks into the file keeps it.
    del file, page
    gc.collect()
    assert (vertices == kept).all()
    with pytest.raises(ZeroDivisionError), chpm.open(path) as file:
        1 / 0
    assert file.closed


def test_what_is_no_file_is_an_os_error(tmp_path):
    missing = tmp_path / "missing.chpm"
    with pytest.raises(chpm.MissingFileError) as raised:
        chpm.open(missing)
    error = raised.value
    assert isinstance(error, FileNotFoundError) and isinstance(error, chpm.FileError) and isinstance(error, chpm.Error)
    assert (error.errno, error.filename) == (errno.ENOENT, str(missing)) or error.filename == missing
    assert str(error).startswith(f"cannot open '{missing}': No such file or directory")
    with pytest.raises(chpm.FileError, match="does not name a file; give the path of a file"):
        chpm.open(tmp_path)
    with pytest.raises(chpm.FileError):
        chpm.open(missing / "below")
    for odd in [5, None, b"\xff".hex]:
        with pytest.raises(TypeError):
            chpm.open(odd)
    if os.geteuid() != 0:
        closed = tmp_path / "closed.chpm"
        closed.write_bytes(b"")
        closed.chmod(0)
        with pytest.raises(chpm.FileError) as raised:
            chpm.open(closed)
        assert raised.value.errno == errno.EACCES


def test_names_that_are_no_text_are_opened(models, tmp_path):
    odd = os.fsencode(tmp_path) + b"/\xff\n.chpm"
    try:
        os.link(models["one"], odd)
    except OSError:
        pytest.skip("no such names here")
    with chpm.open(pathlib.Path(os.fsdecode(odd))) as file:
        assert file.triangle_count == 1
    os.remove(odd)


def test_damaged_files_say_where(models, tmp_path):
    whole = models["looks"].read_bytes()
    path = tmp_path / "bad.chpm"
    for bytes, told in [
        (b"", f"cannot open '{path}': header: 256 bytes expected, 0 present"),
        (b"ply\n" + whole[4:], f"cannot open '{path}': not a CHPM file"),
        (whole[:200], "header: 256 bytes expected, 200 present"),
        (whole[:-4096], "the file is cut short or was never finished"),
        (whole[:100] + b"\x55" + whole[101:], "header: checksum"),
    ]:
        path.write_bytes(bytes)
        with pytest.raises(chpm.DamagedError) as raised:
            chpm.open(path)
        assert told in str(raised.value) and isinstance(raised.value, ValueError)
    # A page: the file opens, and whatever needs the page says which.
    torn = bytearray(whole)
    torn[-5000:] = b"\xff" * 5000
    path.write_bytes(torn)
    with chpm.open(path) as file:
        with pytest.raises(chpm.DamagedError, match=f"cannot read '{path}': page of cluster {len(file) - 1}: checksum"):
            file.page(-1)
        with pytest.raises(chpm.DamagedError, match=f"cannot read '{path}': page of cluster"):
            file.select(level=0)
        assert file.select(triangles=500).triangle_count <= 500


def test_every_damaged_byte_is_an_exception_or_nothing(models, tmp_path):
    whole = models["packed"].read_bytes()
    path = tmp_path / "bad.chpm"
    rng = np.random.default_rng(7)
    refused = 0
    for at in rng.integers(0, len(whole), 300):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ (1 << rng.integers(8))]) + whole[at + 1 :])
        try:
            with chpm.open(path) as file:
                file.metadata
                file.select(error=0)
                for page in file.pages():
                    page.vertices.sum(), page.errors.sum(), page.faces.max()
        except chpm.DamagedError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 250


# In a process of its own, so that what must not happen, its end, shows.
CHANGED = """
    import chpm, os, sys
    file = chpm.open("model.chpm")
    page = file.page(-1)
    before, vertices = page.vertices.copy(), page.vertices
    pages = file.pages()
    os.{how}
    try:
        print("read:", file.select(level=0).triangle_count)
    except chpm.FileError as error:
        print("refused:", error)
    for use in [lambda: file.page(-1), lambda: next(pages), file.check, lambda: page.faces]:
        try:
            use()
            print("used")
        except chpm.FileError as error:
            print("refused:", error)
    print("seen:", float(abs(vertices).sum()) if {look} else 0)
"""


def changed(tmp_path, model, how: str, look: bool = True) -> list[str]:
    (tmp_path / "model.chpm").write_bytes(model.read_bytes())
    script = textwrap.dedent(CHANGED).replace("{how}", how).replace("{look}", str(look))
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_a_file_that_is_cut_short_is_an_exception(models, tmp_path):
    told = changed(tmp_path, models["plain"], 'truncate("model.chpm", 5000)')
    assert told[0].startswith("refused: 'model.chpm' was cut short"), told
    assert all(line.startswith("refused: 'model.chpm' was") for line in told[:5]), told
    assert told[-1] == "seen: 0.0", "what is no longer there is zeros"


def test_a_file_that_is_removed_is_read_on(models, tmp_path):
    told = changed(tmp_path, models["plain"], 'remove("model.chpm")')
    assert told[0].startswith("read:") and told[1:5] == ["used"] * 4, told
    assert float(told[-1].split()[1]) > 0


def test_a_file_that_is_written_to_is_an_exception(models, tmp_path):
    told = changed(tmp_path, models["plain"], 'utime("model.chpm", (1, 1))')
    assert all("'model.chpm' was changed" in line for line in told[:4]), told


def test_faults_of_others_are_told_as_before(models, tmp_path):
    """The handler that guards the maps leaves other faults to the one that was there."""
    script = """
        import faulthandler, mmap, os, sys
        faulthandler.enable()
        import chpm
        chpm.open(sys.argv[1])
        with open("other", "wb") as out:
            out.write(bytes(100_000))
        file = open("other", "r+b")
        view = mmap.mmap(file.fileno(), 0)
        file.truncate(0)
        view[50_000]
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script), models["one"]], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode < 0 and "Bus error" in done.stderr, (done.returncode, done.stderr)
