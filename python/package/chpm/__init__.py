"""Reads ``.chpm`` files: triangle meshes of any size at every level of detail, with proven errors.

>>> import chpm
>>> with chpm.open("scan.chpm") as scan:           # doctest: +SKIP
...     mesh = scan.select(triangles=20_000)
...     print(mesh.vertices.shape, mesh.faces.shape, mesh.error)

The package reads; :func:`build` calls the installed command. ``import chpm.pyvista`` and ``import chpm.meshio`` teach those two to read
``.chpm`` files; :func:`read_trimesh` gives a mesh of trimesh.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError as _NotInstalled
from importlib.metadata import version as _version

from ._build import build
from ._chpm import Camera, File, Level, Page, Selection
from ._errors import (
    ClosedError,
    CommandError,
    DamagedError,
    Error,
    FileError,
    MissingFileError,
    SelectionError,
    ShortfallWarning,
)
from ._read import DEFAULT_TRIANGLES, open, read, read_trimesh

__all__ = [
    "DEFAULT_TRIANGLES",
    "Camera",
    "ClosedError",
    "CommandError",
    "DamagedError",
    "Error",
    "File",
    "FileError",
    "Level",
    "MissingFileError",
    "Page",
    "Selection",
    "SelectionError",
    "ShortfallWarning",
    "build",
    "open",
    "read",
    "read_trimesh",
]

try:
    __version__ = _version("chpm")
except _NotInstalled:  # Used from its folder.
    __version__ = "unknown"
