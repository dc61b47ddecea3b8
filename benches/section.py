#!/usr/bin/env python3
"""Processor time of one section beside trimesh's, in turns: `benches/section.py CHPM MODEL.chpm MODEL.ply OFFSET...` for level planes.

The command's whole process counts, its start and the opening of the file with it; trimesh has the mesh in memory, and nothing of reading it counts.
"""

import json
import resource
import statistics
import subprocess
import sys
import time

import numpy as np
import trimesh

chpm, model, source, *offsets = sys.argv[1:]
mesh = trimesh.load(source, process=False)
print("offset,chpm_ms,trimesh_ms,trimesh_segments_ms,ratio,chpm_length,trimesh_length,chpm_area,trimesh_area")
for offset in offsets:
    ours, theirs, bare = [], [], []
    for _ in range(15):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        words = [chpm, "section", model, "--plane", f"0,0,1:{offset}", "--json", "-q"]
        told = json.loads(subprocess.run(words, capture_output=True, check=True).stdout)["sections"][0]
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        ours.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        plane = dict(plane_normal=[0, 0, 1], plane_origin=[0, 0, float(offset)])
        start = time.process_time()
        path = mesh.section(**plane)
        theirs.append(time.process_time() - start)
        start = time.process_time()
        lines = trimesh.intersections.mesh_plane(mesh, **plane)
        bare.append(time.process_time() - start)
    a, b, c = (1e3 * statistics.median(times) for times in (ours, theirs, bare))
    length = np.linalg.norm(lines[:, 0] - lines[:, 1], axis=1).sum()
    area = path.to_2D()[0].area
    print(f"{offset},{a:.2f},{b:.1f},{c:.1f},{b / a:.1f},{told['length']},{length},{told['area']},{area}")
