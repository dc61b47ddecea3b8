"""The example of the project's README runs."""

from __future__ import annotations

from pathlib import Path

import meshes
import pytest
from conftest import ROOT, command

README = ROOT / "README.md"


@pytest.mark.skipif(not README.exists(), reason="the project is not here")
def test_the_example_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    _, rest = README.read_text().split("```python\n", 1)
    code, _ = rest.split("```", 1)
    meshes.write(tmp_path / "scan.ply", *meshes.SOURCES["sphere"]())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(Path(command()).parent), prepend=":")

    exec(compile(code, str(README), "exec"), {})

    assert (tmp_path / "scan.chpm").exists()
    vertices, faces, *_ = capsys.readouterr().out.split(") ")
    assert "3" in vertices and "3" in faces
