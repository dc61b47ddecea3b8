"""From a mesh to a file, or to a smaller mesh, in this process."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Union, overload

from numpy.typing import ArrayLike

from . import _chpm
from ._arrays import Mesh, spooled
from ._chpm import File, Selection
from ._errors import SelectionError

PathLike = Union[str, "os.PathLike[str]"]
Progress = Callable[[str, int, int], Any]
Source = Union[str, "os.PathLike[str]", tuple[int, str]]


@overload
def build(
    source: PathLike, output: PathLike | None = None, /, *, progress: Progress | None = None, **settings: Any
) -> File: ...
@overload
def build(
    vertices: ArrayLike,
    faces: ArrayLike,
    output: PathLike,
    /,
    *,
    name: str = "arrays",
    progress: Progress | None = None,
    **settings: Any,
) -> File: ...
def build(*source: Any, name: str = "arrays", progress: Progress | None = None, **settings: Any) -> File:
    """Builds a ``.chpm`` file of a mesh, in this process: ``build("scan.ply", "scan.chpm")`` or ``build(vertices, faces, "scan.chpm")``.

    The bytes are those that ``chpm build`` writes for the same source and settings, whatever the threads and the memory.

    Parameters
    ----------
    source : str or os.PathLike
        A mesh in a file, of any format that the command reads. Or two arrays: vertices, float32 or float64 of the shape (n, 3), and faces,
        integers of the shape (m, 3).
    output : str or os.PathLike
        The file to make; of a file the name with ``.chpm`` if not given. It is complete or not there.
    name : str
        What the file says that arrays come from.
    progress : callable, optional
        Called with the name of a stage, what is done of it, and its total, now and then, in the thread that builds.
    normals : str or array
        ``"source"``, ``"computed"`` or ``"none"``; with arrays also normals of the vertices, float of the shape (n, 3).
    colors : bool or array
        False leaves colours out; with arrays also colours of the vertices, uint8 of the shape (n, 3) or (n, 4).
    **settings
        By the names that options of ``chpm build`` have, ``_`` for ``-``: ``cluster_triangles``, ``partitioner``, ``boundary``, ``topology``,
        ``finest_error``, ``target_error``, ``min_component``, ``seed``, ``texture``, ``missing_images``, ``keep`` (a name, or several), ``drop_invalid``, ``bounds``, ``order``, ``pages``,
        ``volume_size``, ``positions``; ``memory`` (as in ``"4G"``), ``threads``, ``work_dir``; ``force=True`` replaces the output. ``resume=True`` keeps what is done every ``checkpoint`` seconds,
        so that a build that was ended goes on there; without it an interrupt leaves nothing behind. ``updatable=True`` keeps what becomes of each part in a file beside the
        output, and ``update="old.chpm"`` takes over from there what has not changed; the bytes are those of ``updatable=True``.

    Returns
    -------
    File
        The file, open.

    Raises
    ------
    ValueError
        If arrays or settings make no sense: the message names which, and where.
    BuildError
        If the mesh cannot be built; a ValueError, too.
    FileError, MissingFileError
        If a file cannot be read or written, or is there already.
    MemoryError
        If ``memory`` is too little.
    """
    if len(source) == 3:
        vertices, faces, output = source
        folder = settings.get("work_dir") or Path(output).parent
    elif len(source) in (1, 2) and isinstance(source[0], (str, os.PathLike)):
        vertices, faces, folder = source[0], None, None
        output = source[1] if len(source) == 2 else None
        if output is None:
            output = Path(source[0]).with_suffix(".chpm")
    else:
        raise TypeError("a source and an output expected, or vertices, faces and an output")
    with _opened(vertices, faces, settings, folder, name) as opened:
        return _chpm.build(opened, os.fspath(output), settings, progress)


@overload
def simplify(
    source: PathLike,
    /,
    *,
    within: float | str | None = None,
    triangles: float | str | None = None,
    effort: int | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Selection: ...
@overload
def simplify(
    vertices: ArrayLike,
    faces: ArrayLike,
    /,
    *,
    within: float | str | None = None,
    triangles: float | str | None = None,
    effort: int | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Selection: ...
def simplify(
    *source: Any,
    within: float | str | None = None,
    triangles: float | str | None = None,
    effort: int | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Selection:
    """A smaller mesh that is proven to be near a given one: ``simplify("scan.ply", within="0.1%")`` or ``simplify(vertices, faces, triangles="20k")``.

    Parameters
    ----------
    source : str or os.PathLike
        A mesh in a file, or two arrays, as :func:`build` takes them.
    within : float or str
        The coarsest mesh that is nowhere farther from the source, nor the source from it: in the model's units or, as in ``"0.1%"``, of the
        diagonal of its box.
    triangles : int or str
        The finest mesh of at most so many triangles, as in ``20000`` or ``"20k"``, or of a share of the source's, as in ``"1%"``.
    effort : int, optional
        How long to look for a coarser mesh that is proven to be within ``within``, as the command's ``--effort``: 0, by the distances that were stored, at once; 1, also by proof: half of the
        triangles may be left, ten seconds for a million of the source, about; 2, vertex by vertex from there on: a quarter may be left, a minute more at most, about; 3, as 2 without end, and five
        times as many places are tried for each vertex. If not given, 2, and 0 of more than 4 million triangles. Where ``memory`` is too little for 2 or 3, it is 1, and ``shortfall`` says so.
    progress : callable, optional
        As :func:`build` has it.
    **settings
        As :func:`build` has them. The work is done in a folder of ``work_dir``, or of the temporary folder, that is removed.

    Returns
    -------
    Selection
        The mesh, as arrays, with its bounds.

    Raises
    ------
    SelectionError
        If not exactly one of ``within`` and ``triangles`` is given, or nothing is so near; a ValueError, too.
    ValueError, BuildError, FileError, MissingFileError, MemoryError
        As :func:`build`.
    """
    if len(source) not in (1, 2):
        raise TypeError("a source expected, or vertices and faces")
    faces = source[1] if len(source) == 2 else None
    if faces is None and not isinstance(source[0], (str, os.PathLike)):
        raise TypeError("vertices without faces: give both")
    if (within is None) == (triangles is None):
        raise SelectionError("within or triangles expected, and not both: each says by itself how small")
    with _opened(source[0], faces, settings, settings.get("work_dir"), "arrays") as opened:
        return _chpm.simplify(opened, within, triangles, effort, settings, progress)


@contextlib.contextmanager
def _opened(
    source: Any, faces: Any, settings: dict[str, Any], folder: PathLike | None, name: str
) -> Iterator[Source]:
    """What the build is handed. Arrays that are among the settings are taken out of these."""
    if faces is None:
        yield os.fspath(source)
        return
    normals, colors = (_array(settings, which) for which in ("normals", "colors"))
    mesh = Mesh(source, faces, normals, colors, drop_invalid=bool(settings.get("drop_invalid")))
    with spooled(mesh, folder) as file:
        yield file.fileno(), name


def _array(settings: dict[str, Any], name: str) -> Any:
    given = settings.get(name)
    if given is None or isinstance(given, (str, bool)):
        return None
    return settings.pop(name)
