"""From a file to one mesh."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from ._chpm import File, Selection

if TYPE_CHECKING:
    import trimesh

DEFAULT_TRIANGLES = 1_000_000
"""Triangles that a reader takes at most where it is not told what to select: a file may have more than fit into memory."""


def open(path: str | os.PathLike[str]) -> File:
    """Opens a ``.chpm`` file.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    File
        It reads the tables and no geometry. To be used in a ``with`` statement, or closed by the garbage collector.

    Raises
    ------
    MissingFileError, FileError
        If it cannot be opened; an OSError, too.
    DamagedError
        If it is no ``.chpm`` file, or a damaged one; a ValueError, too.
    """
    return File(path)


def read(path: str | os.PathLike[str], **selection: Any) -> Selection:
    """Opens a file, takes one mesh out of it, and closes it.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    **selection
        What :meth:`File.select` takes. If nothing is asked for, the finest mesh of at most :data:`DEFAULT_TRIANGLES`.

    Returns
    -------
    Selection
        The mesh, as arrays.
    """
    with File(path) as file:
        chosen = {"error", "triangles", "level", "pixels", "camera"}
        if all(selection.get(name) is None for name in chosen):
            selection["triangles"] = max(1, min(DEFAULT_TRIANGLES, file.triangle_count))
        return file.select(**selection)


def facts(mesh: Selection) -> dict[str, float]:
    """What a mesh of another package should know of where it comes from."""
    told = {"error": mesh.error}
    if mesh.distance is not None:
        told["distance"] = mesh.distance
    return told


def read_trimesh(path: str | os.PathLike[str], **selection: Any) -> trimesh.Trimesh:
    """One mesh of a file, as a mesh of trimesh.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    **selection
        What :meth:`File.select` takes. If nothing is asked for, the finest mesh of at most :data:`DEFAULT_TRIANGLES`.

    Returns
    -------
    trimesh.Trimesh
        Vertices in float64, with the origin added, in the order of the selection: nothing is merged or dropped. ``metadata`` has
        "error" and "distance", in the model's units.
    """
    try:
        import trimesh
    except ImportError as missing:
        raise ImportError("chpm.read_trimesh needs trimesh: pip install trimesh") from missing
    mesh = read(path, **selection)
    return trimesh.Trimesh(
        vertices=mesh.absolute(),
        faces=mesh.faces,
        vertex_normals=mesh.normals,
        vertex_colors=mesh.colors,
        process=False,
        metadata={"file_path": os.fspath(path), **facts(mesh)},
    )
