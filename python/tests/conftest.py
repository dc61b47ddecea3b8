"""Models that the tests share, built by the command."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import meshes
import pytest

ROOT = Path(__file__).resolve().parents[2]


def pytest_report_header() -> str:
    return f"command: {command()}"


def command() -> str:
    """The command to compare with: CHPM, the one that tests of the command use, or the installed one."""
    built = ROOT / "target/debug/chpm"
    found = os.environ.get("CHPM") or (str(built) if built.exists() else shutil.which("chpm"))
    if found is None:
        raise pytest.UsageError("no command to compare with: cargo build, or set CHPM")
    return found


def tell(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([command(), *map(str, words)], capture_output=True, text=True)


def run(*words: object) -> str:
    """What the command says."""
    done = tell(*words)
    assert done.returncode == 0, f"{words}: {done.stderr}"
    return done.stdout


@pytest.fixture(scope="session")
def chpm_command() -> str:
    return command()


# By name: the source, and how it is built.
MODELS = {
    "plain": ("sphere", []),
    "looks": ("looks", []),
    "packed": ("looks", ["--pages", "packed"]),
    "octahedral": ("sphere", ["--normals", "computed"]),
    "octahedral_packed": ("sphere", ["--normals", "computed", "--pages", "packed"]),
    "far": ("far", []),
    "far_packed": ("far", ["--pages", "packed"]),
    "lattice": ("sphere", ["--positions", "lattice:12", "--pages", "packed"]),
    "roots": ("sphere", ["--target-error", "0.5%"]),
    "trimmed": ("sphere", ["--finest-error", "1%"]),
    "dust": ("dust", []),
    "one": ("one", []),
}


@pytest.fixture(scope="session")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("models")
    built = {}
    for name, (source, options) in MODELS.items():
        ply = folder / f"{source}.ply"
        if not ply.exists():
            meshes.write(ply, *meshes.SOURCES[source]())
        built[name] = folder / f"{name}.chpm"
        run("build", ply, "-o", built[name], "-q", "--cluster-triangles", 512, *options)
    return built
