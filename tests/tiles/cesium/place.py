#!/usr/bin/env python3
"""A terrain in UTM coordinates, and where on the earth some of its vertices are by PROJ: place.py FOLDER. Needs pyproj and numpy."""

import json
import sys
from pathlib import Path

import numpy
import pyproj

SIDE, STEP = 200, 2.0
# A zone of the north, one of the south, and one whose metres are not quite metres: at the edge of its zone.
SITES = {"munich": (32632, 691000, 5335000, 520.0), "cape": (32734, 261000, 6243000, 40.0), "edge": (25833, 779000, 5820000, 12.0)}

folder = Path(sys.argv[1])
for name, (code, east, north, height) in SITES.items():
    j, i = numpy.meshgrid(numpy.arange(SIDE), numpy.arange(SIDE))
    # As steep as 2 in 1: what is aside shows as a height.
    hills = 20 * numpy.sin(i * STEP / 10) * numpy.cos(j * STEP / 12.5) + 8 * numpy.sin(j * STEP / 7)
    points = numpy.stack([east + i * STEP, north + j * STEP, height + hills], axis=-1).reshape(-1, 3)
    first = (i[:-1, :-1] * SIDE + j[:-1, :-1]).ravel()
    corners = [[first, first + SIDE, first + SIDE + 1], [first, first + SIDE + 1, first + 1]]
    triangles = numpy.concatenate([numpy.stack(c, axis=-1) for c in corners]).astype("<i4")
    with open(folder / f"{name}.ply", "wb") as ply:
        header = f"element vertex {len(points)}\nproperty double x\nproperty double y\nproperty double z\nelement face {len(triangles)}\n"
        ply.write(f"ply\nformat binary_little_endian 1.0\n{header}property list uchar int vertex_indices\nend_header\n".encode())
        ply.write(points.astype("<f8").tobytes())
        rows = numpy.zeros(len(triangles), dtype=[("n", "u1"), ("corners", "<i4", 3)])
        rows["n"], rows["corners"] = 3, triangles
        ply.write(rows.tobytes())
    inner = [a * SIDE + b for a in range(7, SIDE - 7, 23) for b in range(5, SIDE - 5, 31)]
    # Of the ellipsoid of WGS 84, as the heights of the source are taken to be.
    to_earth = pyproj.Transformer.from_crs(code, 4326, always_xy=True)
    asked = [[*to_earth.transform(x, y), z] for x, y, z in points[inner].tolist()]
    (folder / f"{name}.json").write_text(json.dumps({"code": code, "points": asked}))
