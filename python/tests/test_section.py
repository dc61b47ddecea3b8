"""A section is what ``chpm section`` writes, whatever the file is."""

from __future__ import annotations

import json

import chpm
import numpy as np
import pytest
from conftest import MODELS, tell


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("error", [None, "2%"])
def test_a_section_is_what_the_command_writes(models, tmp_path, name, error):
    with chpm.open(models[name]) as scan:
        normal = np.array([0.2, -0.3, 1.0])
        middle = scan.bounds.mean(axis=0)
        offset = float(middle @ normal / np.linalg.norm(normal))
        section = scan.section((*normal, offset), error=error)
    out = tmp_path / "out.csv"
    words = ["--plane", f"0.2,-0.3,1:{offset!r}", *(["--preview", error] if error else [])]
    told = json.loads(tell("section", models[name], *words, "-o", out, "-q", "--json").stdout)["sections"][0]
    assert told["lines"] == len(section.lines) > 0
    assert told["closed"] == sum(section.closed)
    assert told["open_ends"] == section.open_ends
    assert (told["area"], told["length"]) == (section.area, section.length)
    theirs = np.loadtxt(out, delimiter=",", skiprows=1, ndmin=2)
    mine = np.concatenate(
        [np.concatenate([line, line[:1]]) if closed else line for line, closed in zip(section.lines, section.closed)]
    )
    scale = np.abs(mine).max()
    assert theirs.shape[0] == mine.shape[0] and np.abs(theirs[:, 4:] - mine).max() <= 1e-8 * scale
    assert all(line.dtype == np.float64 and line.shape[1] == 3 for line in section.lines)


def test_what_is_no_plane_is_refused(models):
    with chpm.open(next(iter(models.values()))) as scan:
        with pytest.raises(chpm.SelectionError, match="normal with a direction"):
            scan.section((0, 0, 0, 1))
        far = scan.section((0, 0, 1, 1e9))
        assert far.lines == [] and far.area == 0 and "0 lines" in repr(far)
