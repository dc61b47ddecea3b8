"""Lets PyVista read ``.chpm`` files.

>>> import pyvista, chpm.pyvista                   # doctest: +SKIP
>>> mesh = pyvista.read("scan.chpm", triangles=100_000)
"""

from __future__ import annotations

import os
from typing import Any

try:
    import pyvista
except ImportError as missing:
    raise ImportError("chpm.pyvista needs pyvista: pip install 'pyvista>=0.48'") from missing

from ._read import facts
from ._read import read as _read

__all__ = ["read"]


def read(path: str | os.PathLike[str], **selection: Any) -> pyvista.PolyData:
    """One mesh of a file, as ``pyvista.read`` gives it with the same arguments.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    **selection
        What :meth:`chpm.File.select` takes. If nothing is asked for, the finest mesh of at most ``chpm.DEFAULT_TRIANGLES``.

    Returns
    -------
    pyvista.PolyData
        Points in float32, or in float64 where the file has an origin, which is added. ``point_data`` has "Normals" (float32, (n, 3))
        and "RGBA" (uint8, (n, 4)) where vertices have them; with ``texture_size``, places in the images are its texture coordinates. ``field_data`` "error" and "distance", in the model's units.
    """
    mesh = _read(path, **selection)
    points = mesh.absolute() if mesh.origin.any() else mesh.vertices
    data = pyvista.PolyData.from_regular_faces(points, mesh.faces)
    if mesh.normals is not None:
        data.point_data["Normals"] = mesh.normals
        data.point_data.active_normals_name = "Normals"
    if mesh.colors is not None:
        data.point_data["RGBA"] = mesh.colors
    if mesh.uv is not None:
        data.active_texture_coordinates = mesh.uv
    for name, value in facts(mesh).items():
        data.field_data[name] = [value]
    return data


try:
    # Where the entry point of the package came first, it is the same function.
    pyvista.register_reader(".chpm", read, override=True)
except AttributeError as old:
    raise ImportError(f"chpm.pyvista needs pyvista 0.48 or newer, and this is {pyvista.__version__}: pip install -U pyvista") from old
