"""Files held against their sources, and meshes against meshes."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from . import _chpm

Progress = Callable[[str, int, int], Any]


@dataclass(frozen=True)
class Verification:
    """What a verification found; true where the file is sound. Dictionaries have the keys of ``chpm verify --json``."""

    fault_count: int
    """All faults, also those that are only counted."""
    faults: list[str]
    """Faults in words."""
    clusters: int | None
    """Clusters whose pages can be read; None if the file does not even open."""
    triangles: int | None
    """Triangles of these."""
    trimmed: bool
    """Whether detail of the source was left out on purpose, so that the leaves are not it."""
    against: dict[str, Any] | None
    """The leaves beside the source, where one was given."""
    errors: dict[str, Any] | None
    """Proofs of the stored errors and distances, where they were asked for."""
    cuts: dict[str, Any] | None
    """Random cuts, where they were asked for."""

    @property
    def sound(self) -> bool:
        """Whether there is no fault: bool."""
        return self.fault_count == 0

    def __bool__(self) -> bool:
        return self.sound


@dataclass(frozen=True)
class Measurement:
    """What was measured of a file's levels and cuts. Dictionaries have the keys of ``chpm measure --json``."""

    diagonal: float
    """Of the model's box, in its units."""
    slack: float
    """Distances up to this count as none."""
    levels: list[dict[str, Any]]
    """Levels, from the finest on."""
    cuts: list[dict[str, Any]]
    """Random cuts."""
    violations: int
    """Samples that are farther away than the file states."""


@dataclass(frozen=True)
class Deviation:
    """How far two meshes are from each other, by samples. Lengths are in their units."""

    max: float
    """The larger of both ways."""
    mean: float
    """The larger of both ways."""
    rms: float
    """The root mean square, the larger of both ways."""
    at: tuple[float, float, float] | None
    """Where the maximum is."""
    diagonal: float
    """Of the box around both."""
    forward: dict[str, Any]
    """From the first to the second: ``max``, ``at``, ``mean``, ``rms``, ``samples``."""
    backward: dict[str, Any]
    """From the second to the first."""


def verify(
    path: str | os.PathLike[str],
    *,
    against: str | os.PathLike[str] | None = None,
    same_as: str | os.PathLike[str] | None = None,
    cuts: int | None = None,
    seed: int = 0,
    errors: bool = False,
    level: int | Sequence[int] = (),
    positions: int = 1,
    effort: int = 256,
    memory: str | int = "1G",
    threads: int | None = None,
    work_dir: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> Verification:
    """Verifies every byte and invariant of a file, as ``chpm verify`` does.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    against : str or os.PathLike, optional
        The mesh that it was built from, whose triangles must be those of the leaves.
    same_as : str or os.PathLike, optional
        Another ``.chpm`` file that must hold the same.
    cuts, seed : int, optional
        Random cuts to look for cracks in, and the seed of the first.
    errors : bool
        Prove that stored errors and distances hold; needs ``against``.
    level : int or sequence of int
        Of the levels only these.
    positions, effort : int
        Positions of each level, and pieces that a triangle may be cut into, for ``errors``.
    memory, threads, work_dir, progress
        As :func:`build` has them.

    Returns
    -------
    Verification
        What was found: ``if chpm.verify("scan.chpm"): ...``.

    Raises
    ------
    BuildError
        If what is asked for makes no sense, or the source cannot be read; a ValueError, too.
    FileError, MissingFileError
        If a file cannot be opened.
    """
    if errors and against is None:
        raise ValueError("errors: against is needed, which the errors are held against")
    asked = {
        "against": against,
        "same_as": same_as,
        "errors": errors,
        "levels": [level] if isinstance(level, int) else list(level),
        "positions": _count("positions", positions, 1000),
        "effort": _count("effort", effort, 1_000_000),
        "cuts": None if cuts is None else _count("cuts", cuts, 2**32 - 1),
        "seed": seed,
    }
    return Verification(**_chpm.verify(path, asked, _means(memory, threads, work_dir), progress))


def measure(
    first: str | os.PathLike[str],
    second: str | os.PathLike[str] | None = None,
    *,
    against: str | os.PathLike[str] | None = None,
    levels: bool | None = None,
    positions: int = 2,
    cuts: int = 0,
    seed: int = 0,
    samples: int = 10,
    memory: str | int = "1G",
    threads: int | None = None,
    work_dir: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> Deviation | Measurement:
    """Measures how far two meshes are from each other, or with ``against`` the levels and cuts of a file from its source.

    Parameters
    ----------
    first : str or os.PathLike
        A mesh; with ``against`` a ``.chpm`` file.
    second : str or os.PathLike
        The mesh to measure it against, and that against it.
    against : str or os.PathLike
        The mesh that the file was built from.
    levels : bool, optional
        Measure all levels; if not given, where no cuts are asked for.
    positions, cuts, seed : int
        Positions of each level; random cuts, and the seed of the first.
    samples : int
        Samples on each triangle of the finer mesh at least.
    memory, threads, work_dir, progress
        As :func:`build` has them.

    Returns
    -------
    Deviation
        Of two meshes.
    Measurement
        Of a file.

    Raises
    ------
    BuildError
        If the leaves are not the source's triangles, or a mesh cannot be read; a ValueError, too.
    FileError, MissingFileError
        If a file cannot be opened.
    """
    if (second is None) == (against is None):
        raise ValueError("one of second and against is needed")
    samples = _count("samples", samples, 1_000_000)
    means = _means(memory, threads, work_dir)
    if second is not None:
        return Deviation(**_chpm.measure_meshes(first, second, samples, means, progress))
    wanted = {
        "levels": cuts == 0 if levels is None else levels,
        "positions": _count("positions", positions, 1000),
        "cuts": cuts,
        "seed": seed,
        "samples": samples,
    }
    return Measurement(**_chpm.measure_file(first, against, wanted, means, progress))


def _means(memory: str | int, threads: int | None, work_dir: str | os.PathLike[str] | None) -> dict[str, Any]:
    return {"memory": memory, "threads": threads, "work_dir": work_dir}


def _count(name: str, count: int, most: int) -> int:
    if not 1 <= count <= most:
        raise ValueError(f"{name}: 1 to {most} expected, got {count}")
    return count
