"""Builds and reads ``.chpm`` files: triangle meshes of any size at every level of detail, with proven errors.

>>> import chpm
>>> with chpm.build("scan.ply", "scan.chpm") as scan:   # doctest: +SKIP
...     mesh = scan.select(triangles=20_000)
...     print(mesh.vertices.shape, mesh.faces.shape, mesh.error)

:func:`build` and :func:`simplify` take files and NumPy arrays; :func:`verify` and :func:`measure` judge what was built. ``import chpm.pyvista`` and ``import chpm.meshio`` teach those two to read
``.chpm`` files; :func:`read_trimesh` gives a mesh of trimesh.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError as _NotInstalled
from importlib.metadata import version as _version

from ._build import build, simplify
from ._chpm import Camera, File, Hits, Level, Page, Section, Selection
from ._errors import (
    BuildError,
    ClosedError,
    DamagedError,
    Error,
    FileError,
    MissingFileError,
    SelectionError,
    ShortfallWarning,
)
from ._judge import Deviation, Measurement, Verification, measure, verify
from ._read import DEFAULT_TRIANGLES, open, read, read_trimesh

__all__ = [
    "DEFAULT_TRIANGLES",
    "BuildError",
    "Camera",
    "ClosedError",
    "DamagedError",
    "Deviation",
    "Error",
    "File",
    "FileError",
    "Hits",
    "Level",
    "Measurement",
    "MissingFileError",
    "Page",
    "Section",
    "Selection",
    "SelectionError",
    "ShortfallWarning",
    "Verification",
    "build",
    "measure",
    "open",
    "read",
    "read_trimesh",
    "simplify",
    "verify",
]

try:
    __version__ = _version("chpm")
except _NotInstalled:  # Used from its folder.
    __version__ = "unknown"
