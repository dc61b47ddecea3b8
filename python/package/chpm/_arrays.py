"""Meshes that are in memory, as a build reads them."""

from __future__ import annotations

import os
import tempfile
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

ROWS = 1 << 16
"""Vertices or faces that are looked at and written at once."""

MOST = 2**32 - 1
"""Vertices that a mesh may have."""


class Mesh:
    """Arrays of a mesh that has been looked at. ``drop_invalid`` leaves numbers that are none to the build, which drops them."""

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        normals: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        *,
        drop_invalid: bool = False,
    ) -> None:
        self.drops = drop_invalid
        self.vertices = _rows("vertices", vertices, (3,), "f", "float32 or float64")
        if self.vertices.dtype.itemsize not in (4, 8):
            raise ValueError(f"vertices: float32 or float64 expected, got {self.vertices.dtype}")
        count = len(self.vertices)
        if count > MOST:
            raise ValueError(f"vertices: at most {MOST} can be numbered, got {count}")
        # An empty list has no type of its own.
        self.faces = _rows("faces", faces if np.size(faces) else np.empty((0, 3), "u4"), (3,), "iu", "integers")
        self.normals = None if normals is None else _rows("normals", normals, (3,), "f", "float32 or float64")
        self.colors = None if colors is None else _rows("colors", colors, (3, 4), "u", "uint8")
        for name, array in (("normals", self.normals), ("colors", self.colors)):
            if array is not None and len(array) != count:
                raise ValueError(f"{name}: one for each of {count} vertices expected, got {len(array)}")
        if self.colors is not None and self.colors.dtype != np.uint8:
            raise ValueError(f"colors: uint8 expected, got {self.colors.dtype}")

    def write(self, file: IO[bytes]) -> None:
        """Writes the mesh as a PLY, some rows at a time."""
        real = "double" if self.vertices.dtype.itemsize == 8 else "float"
        columns = [(name, real, self.vertices[:, axis]) for axis, name in enumerate("xyz")]
        if self.normals is not None:
            columns += [("n" + name, "float", self.normals[:, axis]) for axis, name in enumerate("xyz")]
        if self.colors is not None:
            names = ["red", "green", "blue", "alpha"][: self.colors.shape[1]]
            columns += [(name, "uchar", self.colors[:, axis]) for axis, name in enumerate(names)]
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(self.vertices)}"]
        head += [f"property {kind} {name}" for name, kind, _ in columns]
        head += [f"element face {len(self.faces)}", "property list uchar uint vertex_indices", "end_header", ""]
        file.write("\n".join(head).encode())
        self._write_vertices(file, columns)
        self._write_faces(file)
        file.flush()

    def _write_vertices(self, file: IO[bytes], columns: list[tuple[str, str, NDArray[Any]]]) -> None:
        types = {"float": "<f4", "double": "<f8", "uchar": "u1"}
        table = np.empty(ROWS, [(name, types[kind]) for name, kind, _ in columns])
        for first in range(0, len(self.vertices), ROWS):
            if not self.drops:
                _finite(self.vertices[first : first + ROWS], first)
            count = min(ROWS, len(self.vertices) - first)
            for name, _, column in columns:
                table[name][:count] = column[first : first + count]
            file.write(table[:count].tobytes())

    def _write_faces(self, file: IO[bytes]) -> None:
        table = np.empty(ROWS, [("n", "u1"), ("corners", "<u4", 3)])
        table["n"] = 3
        for first in range(0, len(self.faces), ROWS):
            rows = self.faces[first : first + ROWS]
            corners = self._corners(rows, first)
            table["corners"][: len(rows)] = corners
            file.write(table[: len(rows)].tobytes())

    def _corners(self, rows: NDArray[Any], first: int) -> NDArray[Any]:
        count = len(self.vertices)
        wrong = (rows < 0) | (rows >= count)
        if not wrong.any():
            return rows
        if self.drops:
            # No vertex has this number: there are fewer.
            return np.where(wrong, MOST, rows)
        face = int(np.flatnonzero(wrong.any(axis=1))[0])
        vertex = int(rows[face][wrong[face]][0])
        told = "is negative" if vertex < 0 else f"is out of range: there are {count} vertices"
        raise ValueError(f"faces[{first + face}]: index {vertex} {told}")


def _rows(name: str, given: ArrayLike, widths: tuple[int, ...], kinds: str, expected: str) -> NDArray[Any]:
    if np.ma.is_masked(given):
        raise ValueError(f"{name}: an array without masked values expected; leave their rows out")
    array = np.asarray(given)
    if array.ndim != 2 or array.shape[1] not in widths:
        shape = " or ".join(f"(n, {width})" for width in widths)
        raise ValueError(f"{name}: an array of the shape {shape} expected, got {array.shape}")
    if array.dtype.kind not in kinds:
        raise ValueError(f"{name}: {expected} expected, got {array.dtype}")
    return array


def _finite(rows: NDArray[Any], first: int) -> None:
    good = np.isfinite(rows).all(axis=1)
    if not good.all():
        at = int(np.flatnonzero(~good)[0])
        raise ValueError(f"vertices[{first + at}] is not finite: {rows[at].tolist()}; drop_invalid=True leaves it out")


def spooled(mesh: Mesh, folder: str | os.PathLike[str] | None) -> IO[bytes]:
    """The mesh in a file without a name, which is gone when it is closed."""
    file = tempfile.TemporaryFile(dir=folder)
    try:
        mesh.write(file)
    except BaseException:
        file.close()
        raise
    return file
