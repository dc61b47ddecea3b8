#!/usr/bin/env python3
"""Triangles of the coarsest mesh within a share of the diagonal: by what is stored, by proof (`--tight`), and by measured distances.

tight.py CHPM FOLDER SOURCE... builds each source in FOLDER and writes CSV. `needed` is the coarsest mesh at an error of the file whose distance, sampled at SAMPLES points
a triangle, is within the share; it is found by bisection, and is not proven. Seconds are processor time of `extract`.
"""
import json
import math
import os
import resource
import subprocess
import sys

SHARES = (0.01, 0.003, 0.001)
SAMPLES = "10"
STEPS = 7
# How much farther than what is measured stored distances may be.
LOOSE = 8


def told(words):
    return json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


def spent():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class Meshes:
    """The meshes of a file beside its source."""

    def __init__(self, chpm, file, source):
        self.chpm, self.file, self.source, self.mesh = chpm, file, source, f"{file}.ply"
        box = told([chpm, "info", file, "--json"])["box"]
        self.diagonal = math.dist(box["min"], box["max"])

    def within(self, error, *options):
        """Triangles of the coarsest mesh within an error."""
        words = [self.chpm, "extract", self.file, "--error", repr(error), *options, "-o", self.mesh, "-f", "--json", "-q"]
        return told(words)["triangles"]

    def measured(self):
        """How far the mesh that was taken last is from the source."""
        return told([self.chpm, "measure", self.mesh, self.source, "--samples", SAMPLES, "--json", "-q"])["max"]

    def needed(self, error):
        """Triangles of the coarsest mesh whose measured distance is within an error."""
        near, far, triangles = error, LOOSE * error, self.within(error)
        for _ in range(STEPS):
            middle = math.sqrt(near * far)
            count = self.within(middle)
            if count == triangles or self.measured() <= error:
                near, triangles = middle, count
            else:
                far = middle
        return triangles


def main():
    chpm, folder, sources = sys.argv[1], sys.argv[2], sys.argv[3:]
    print("model,share,stored,tight,needed,stored_s,tight_s", flush=True)
    for source in sources:
        name = os.path.splitext(os.path.basename(source))[0]
        file = os.path.join(folder, f"{name}.chpm")
        subprocess.run([chpm, "build", source, "-o", file, "-q", "-f"], check=True, capture_output=True)
        meshes = Meshes(chpm, file, source)
        for share in SHARES:
            error = share * meshes.diagonal
            begun = spent()
            stored = meshes.within(error)
            between = spent()
            tight = meshes.within(error, "--tight")
            seconds = f"{between - begun:.2f},{spent() - between:.2f}"
            print(f"{name},{100 * share:g}%,{stored},{tight},{meshes.needed(error)},{seconds}", flush=True)


main()
