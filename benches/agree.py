"""Compares `chpm measure` with two other programs' distances on the same pairs of meshes; CSV on stdout.

Usage: agree.py CHPM SOURCE.ply LOD.ply [SOURCE.ply LOD.ply ...]; needs pymeshlab, trimesh, scipy and rtree from PyPI.

MeshLab's filter samples vertices, edges and faces of one mesh and looks the nearest point of the other one up; `trimesh` does the
latter exactly for points that are given, here the vertices of one mesh and the middles of its triangles. Neither takes the samples that
`chpm` takes, so maxima and means agree as far as dense samples do.
"""

import json
import subprocess
import sys

import numpy
import pymeshlab
import trimesh


def meshlab(source, target, samples):
    def filtered(**on):
        meshes = pymeshlab.MeshSet()
        for path in (source, target):
            meshes.load_new_mesh(path)
            # Vertices that no face uses are no part of the surface.
            meshes.meshing_remove_unreferenced_vertices()
        return meshes.get_hausdorff_distance(
            sampledmesh=0, targetmesh=1, samplenum=samples, maxdist=pymeshlab.PercentageValue(100), **on
        )

    everything = filtered(samplevert=True, sampleedge=True, sampleface=True)
    # By area, as ours: vertices and edges count for the maximum only.
    faces = filtered(samplevert=False, sampleedge=False, sampleface=True)
    return everything["max"], faces["mean"], faces["RMS"]


def points(source, target):
    a, b = (trimesh.load(path, process=False) for path in (source, target))
    used = a.vertices[numpy.unique(a.faces)]
    samples = numpy.concatenate([used, a.triangles_center])
    return max(
        trimesh.proximity.closest_point(b, samples[start : start + 4096])[1].max()
        for start in range(0, len(samples), 4096)
    )


def main():
    chpm, paths = sys.argv[1], sys.argv[2:]
    print("source,lod,direction,chpm_max,chpm_mean,chpm_rms,chpm_samples,", end="")
    print("meshlab_max,meshlab_mean,meshlab_rms,trimesh_points_max")
    for source, lod in zip(paths[::2], paths[1::2]):
        command = [chpm, "measure", source, lod, "--json", "--quiet"]
        ours = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        for name, pair in (("forward", (source, lod)), ("backward", (lod, source))):
            side = ours[name]
            theirs = meshlab(*pair, side["samples"])
            row = [path.rsplit("/", 1)[-1] for path in (source, lod)] + [name]
            numbers = [side["max"], side["mean"], side["rms"]]
            row += [f"{x:.6e}" for x in numbers] + [str(side["samples"])]
            row += [f"{x:.6e}" for x in (*theirs, points(*pair))]
            print(",".join(row), flush=True)


main()
