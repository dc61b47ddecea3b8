"""Lets meshio read ``.chpm`` files.

>>> import meshio, chpm.meshio                     # doctest: +SKIP
>>> mesh = meshio.read("scan.chpm")
"""

from __future__ import annotations

import os
from typing import Any

try:
    import meshio
except ImportError as missing:
    raise ImportError("chpm.meshio needs meshio: pip install meshio") from missing

from ._read import facts
from ._read import read as _read

__all__ = ["read"]


def read(path: str | os.PathLike[str], **selection: Any) -> meshio.Mesh:
    """One mesh of a file. ``meshio.read`` takes no selection; this does.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    **selection
        What :meth:`chpm.File.select` takes. If nothing is asked for, the finest mesh of at most ``chpm.DEFAULT_TRIANGLES``.

    Returns
    -------
    meshio.Mesh
        Points in float32, or in float64 where the file has an origin, which is added; one block of triangles. ``point_data`` has
        "normals" (float32, (n, 3)) and "rgba" (uint8, (n, 4)) where vertices have them, ``info`` "error" and "distance", in the
        model's units.
    """
    mesh = _read(path, **selection)
    points = mesh.absolute() if mesh.origin.any() else mesh.vertices
    carried = {"normals": mesh.normals, "rgba": mesh.colors}
    return meshio.Mesh(
        points,
        [("triangle", mesh.faces)],
        point_data={name: array for name, array in carried.items() if array is not None},
        info=facts(mesh),
    )


meshio.register_format("chpm", [".chpm"], read, {})
