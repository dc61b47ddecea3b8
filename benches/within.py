#!/usr/bin/env python3
"""Triangles of `chpm simplify --within` beside the fewest that other simplifiers need to come as near.

within.py CHPM FOLDER SHARE[,SHARE..] EFFORT[,EFFORT..] SOURCE... writes CSV. Distances are sampled in both directions at SAMPLES points a triangle of either mesh, whoever made it,
and a peer has an oracle that none of its users has: its count of triangles is bisected until its mesh is as near to the source as ours of the last effort.
Seconds are processor time of one call. Needs fast-simplification, meshoptimizer and pymeshlab of PyPI.
"""
import json
import math
import os
import resource
import subprocess
import sys

import fast_simplification
import meshoptimizer
import numpy
import pymeshlab

SAMPLES = "4"
# A count is looked for to within this share of it, beginning at ours and going by this factor.
FINE = 1.02
FACTOR = 2


def meshopt(options):
    def simplify(points, faces, count):
        kept = numpy.zeros(faces.size, dtype=numpy.uint32)
        indices = numpy.ascontiguousarray(faces.ravel(), dtype=numpy.uint32)
        told = meshoptimizer.simplify(
            kept, indices, points, target_index_count=3 * count, target_error=1e9, options=options
        )
        return points, kept[:told].reshape(-1, 3)

    return simplify


def fast(points, faces, count):
    return fast_simplification.simplify(points, faces.astype(numpy.int32), target_count=count)


def meshlab(boundary):
    def simplify(points, faces, count):
        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.add_mesh(pymeshlab.Mesh(points.astype(numpy.float64), faces.astype(numpy.int32)))
        meshes.meshing_decimation_quadric_edge_collapse(
            targetfacenum=count, planarquadric=True, preserveboundary=boundary
        )
        mesh = meshes.current_mesh()
        return mesh.vertex_matrix(), mesh.face_matrix()

    return simplify


PEERS = {
    "meshopt": meshopt(0),
    "meshopt_prune": meshopt(meshoptimizer.SIMPLIFY_PRUNE),
    "fast": fast,
    "meshlab": meshlab(False),
    "meshlab_boundary": meshlab(True),
}


def told(words):
    return json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


def spent():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def read(path):
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.load_new_mesh(path)
    mesh = meshes.current_mesh()
    # Rows one after the other, as meshoptimizer takes them.
    points = numpy.ascontiguousarray(mesh.vertex_matrix(), dtype=numpy.float32)
    return points, numpy.ascontiguousarray(mesh.face_matrix(), dtype=numpy.uint32)


def write(path, points, faces):
    """A binary PLY, of the vertices that faces use."""
    used, faces = numpy.unique(faces, return_inverse=True)
    points, faces = points[used].astype("<f4"), faces.reshape(-1, 3)
    rows = numpy.empty(len(faces), dtype=[("n", "u1"), ("corners", "<i4", 3)])
    rows["n"], rows["corners"] = 3, faces
    names = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{names}"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    with open(path, "wb") as file:
        file.write(head.encode() + points.tobytes() + rows.tobytes())


class Model:
    """A source, and what is as near to it."""

    def __init__(self, chpm, folder, source):
        self.chpm = chpm
        file, self.whole, self.mesh = (os.path.join(folder, name) for name in ("m.chpm", "whole.ply", "mesh.ply"))
        subprocess.run([chpm, "build", source, "-o", file, "-q", "-f"], check=True, capture_output=True)
        subprocess.run([chpm, "extract", file, "--level", "0", "-o", self.whole, "-f", "-q"], check=True, capture_output=True)
        self.points, self.faces = read(self.whole)
        self.diagonal = math.dist(self.points.min(axis=0).tolist(), self.points.max(axis=0).tolist())

    def distance(self):
        """How far the mesh that was written last is from the source."""
        return told([self.chpm, "measure", self.mesh, self.whole, "--samples", SAMPLES, "--json", "-q"])["max"]

    def ours(self, share, effort):
        words = [self.chpm, "simplify", self.whole, "--within", f"{100 * share}%", "--effort", effort, "--threads", "1"]
        begun = spent()
        triangles = told([*words, "-o", self.mesh, "-f", "--json", "-q"])["triangles"]
        return triangles, spent() - begun, self.distance()

    def near(self, peer, count, distance):
        """Triangles of a peer's mesh, if that is within a distance."""
        points, faces = peer(self.points, self.faces, count)
        if not len(faces):
            return None
        write(self.mesh, points, faces)
        return len(faces) if self.distance() <= distance else None

    def fewest(self, peer, distance, begin):
        """The fewest triangles of a peer that are within a distance; none if it does not come so near."""
        low, high = 0, begin
        while not (fewest := self.near(peer, high, distance)):
            if high >= len(self.faces):
                return None
            low, high = high, min(FACTOR * high, len(self.faces))
        while True:
            count = round(math.sqrt(low * high) if low else high / FACTOR)
            if count < 4 or high <= FINE * count:
                return fewest
            if found := self.near(peer, count, distance):
                high, fewest = count, min(fewest, found)
            else:
                low = count


def main():
    chpm, folder, shares, efforts, sources = *sys.argv[1:3], sys.argv[3].split(","), sys.argv[4].split(","), sys.argv[5:]
    columns = ",".join(f"effort_{effort},effort_{effort}_s" for effort in efforts)
    print(f"model,of,share,{columns},distance_of_share," + ",".join(PEERS) + ",ours_by_best", flush=True)
    for source in sources:
        name = os.path.splitext(os.path.basename(source))[0]
        model = Model(chpm, folder, source)
        for share in map(float, shares):
            ours = [model.ours(share, effort) for effort in efforts]
            count, _, distance = ours[-1]
            found = [model.fewest(peer, distance, count) for peer in PEERS.values()]
            cells = [name, len(model.faces), f"{100 * share:g}%"]
            cells += [cell for count, seconds, _ in ours for cell in (count, f"{seconds:.2f}")]
            cells += [f"{distance / (share * model.diagonal):.4f}", *(count or "" for count in found)]
            best = min((count for count in found if count), default=None)
            cells.append(f"{count / best:.3f}" if best else "")
            print(*cells, sep=",", flush=True)


if __name__ == "__main__":
    main()
