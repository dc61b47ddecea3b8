"""Meshes to build of, and PLY as the command writes it: binary, little endian, triangles alone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np


def bumpy(rings: int = 60, sides: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """A sphere with bumps, closed but for its poles."""
    v, u = np.meshgrid(np.linspace(0.05, np.pi - 0.05, rings), np.arange(sides) * 2 * np.pi / sides, indexing="ij")
    r = 1 + 0.08 * np.sin(7 * u) * np.sin(9 * v) + 0.01 * np.sin(40 * u + 30 * v)
    points = np.stack([r * np.sin(v) * np.cos(u), r * np.cos(v), r * np.sin(v) * np.sin(u)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = i * sides + j, i * sides + (j + 1) % sides
    c, d = a + sides, b + sides
    faces = np.concatenate([np.stack([a, b, d], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return points, faces


def sphere():
    points, faces = bumpy()
    return points.astype("f4"), faces, None, None


def looks():
    """With normals and colours."""
    points, faces = bumpy()
    normals = (points / np.linalg.norm(points, axis=1, keepdims=True)).astype("f4")
    colors = np.concatenate([(127.5 + 127.5 * normals).astype("u1"), np.full((len(points), 1), 200, "u1")], 1)
    return points.astype("f4"), faces, normals, colors


def far():
    """Where single precision would not do."""
    points, faces = bumpy()
    return points + [500_000.125, -4_000_000.5, 1234.0625], faces, None, None


def dust():
    """Specks about a sphere, which vanish early."""
    points, faces = bumpy(30, 60)
    rng = np.random.default_rng(1)
    at = rng.normal(size=(200, 3))
    at *= 1.5 / np.linalg.norm(at, axis=1, keepdims=True)
    specks = at[:, None] + 0.002 * rng.normal(size=(200, 3, 3))
    more = len(points) + np.arange(600).reshape(-1, 3)
    return np.concatenate([points, specks.reshape(-1, 3)]).astype("f4"), np.concatenate([faces, more]), None, None


def one():
    """A single triangle."""
    return np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "f4"), np.array([[0, 1, 2]]), None, None


SOURCES = {"sphere": sphere, "looks": looks, "far": far, "dust": dust, "one": one}

TYPES = {"f4": "float", "f8": "double", "u1": "uchar"}


def write(path: Path, points, faces, normals, colors, scalars=None) -> None:
    columns = [(name, points[:, axis]) for axis, name in enumerate("xyz")]
    if normals is not None:
        columns += [("n" + name, normals[:, axis]) for axis, name in enumerate("xyz")]
    if colors is not None:
        columns += [(name, colors[:, axis]) for axis, name in enumerate(["red", "green", "blue", "alpha"])]
    columns += list((scalars or {}).items())
    vertices = np.empty(len(points), [(name, column.dtype.str) for name, column in columns])
    for name, column in columns:
        vertices[name] = column
    corners = np.empty(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    corners["n"], corners["v"] = 3, faces
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    head += [f"property {TYPES[column.dtype.str[1:]]} {name}" for name, column in columns]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    path.write_bytes("\n".join(head).encode() + b"\n" + vertices.tobytes() + corners.tobytes())


class Ply(NamedTuple):
    points: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None
    colors: np.ndarray | None
    error: float
    distance: float | None


NUMBERS = {"float": "<f4", "double": "<f8", "uchar": "u1", "uint8": "u1", "float32": "<f4", "float64": "<f8"}


def read(path: Path) -> Ply:
    """What ``chpm extract`` has written; everything in it is looked at."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + 11
    head = data[:end].decode()
    assert "format binary_little_endian 1.0" in head
    vertices, faces = (int(re.search(rf"element {name} (\d+)", head)[1]) for name in ("vertex", "face"))
    fields = [(name, NUMBERS[kind]) for kind, name in re.findall(r"property (?!list)(\S+) (\S+)", head)]
    table = np.frombuffer(data, fields, vertices, end)
    kind, index = re.search(r"property list (\S+) (\S+) ", head).groups()
    assert kind in ("uchar", "uint8") and index in ("int", "uint", "int32", "uint32"), head
    corners = np.frombuffer(data, [("n", "u1"), ("v", "<u4", 3)], faces, end + table.nbytes)
    assert (corners["n"] == 3).all() and len(data) == end + table.nbytes + corners.nbytes

    def columns(*names):
        return np.stack([table[name] for name in names], -1) if names[0] in table.dtype.names else None

    told = dict(re.findall(r"(error|distance) (\S+?)[,\n]", head))
    return Ply(
        columns("x", "y", "z"),
        corners["v"],
        columns("nx", "ny", "nz"),
        columns("red", "green", "blue", "alpha"),
        float(told["error"]),
        float(told["distance"]) if "distance" in told else None,
    )
