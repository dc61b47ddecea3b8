#!/usr/bin/env python3
"""Holds `chpm distance` against python-fcl and coal: proximity.py CHPM A.ply B.ply POSES
(pip install numpy trimesh python-fcl coal). For each pose of B, a line X Y Z QX QY QZ QW: the interval, the distance of each library,
whether it is inside up to their own tolerance, and their milliseconds once their boxes are made. Touching is told as 0 or less by both."""
import json
import subprocess
import sys
import time

import coal
import fcl
import numpy as np
import trimesh

chpm, a, b, poses = sys.argv[1:5]
error = sys.argv[5] if len(sys.argv) > 5 else "0"
answers = json.loads(subprocess.check_output([chpm, "distance", a, b, "--path", poses, "--error", error, "--json", "-q"]))
meshes = [trimesh.load(path, process=False) for path in (a, b)]


def of_fcl(mesh):
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return model


def of_coal(mesh):
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    for face in np.asarray(mesh.vertices)[np.asarray(mesh.faces)]:
        model.addTriangle(*face)
    model.endModel()
    return model


def timed(work):
    start = time.process_time()
    return work(), time.process_time() - start


fcls, fcl_made = timed(lambda: [of_fcl(mesh) for mesh in meshes])
coals, coal_made = timed(lambda: [of_coal(mesh) for mesh in meshes])
print(f"# boxes made in {fcl_made:.2f} s (fcl) and {coal_made:.2f} s (coal)")
print("least,most,fcl,coal,fcl_ms,coal_ms,inside")
missed = 0
size = float(max(np.linalg.norm(mesh.extents) for mesh in meshes))
lines = [line.replace(",", " ").split() for line in open(poses) if line.strip() and not line.startswith("#")]
for words, answer in zip(lines, answers["answers"]):
    x, y, z, i, j, k, w = map(float, words)

    def ask_fcl():
        still, moved = fcl.CollisionObject(fcls[0]), fcl.CollisionObject(fcls[1], fcl.Transform([w, i, j, k], [x, y, z]))
        if fcl.collide(still, moved):
            return 0.0
        return fcl.distance(still, moved, fcl.DistanceRequest(), fcl.DistanceResult())

    def ask_coal():
        place = coal.Transform3s(coal.Quaternion(w, i, j, k).matrix(), np.array([x, y, z]))
        result = coal.DistanceResult()
        return coal.distance(coals[0], coal.Transform3s.Identity(), coals[1], place, coal.DistanceRequest(), result)

    (p, p_time), (q, q_time) = timed(ask_fcl), timed(ask_coal)
    slack = 1e-6 * size
    inside = all(answer["least"] - slack <= max(d, 0.0) <= answer["most"] + slack for d in (p, q))
    missed += not inside
    print(f"{answer['least']},{answer['most']},{p},{q},{1000 * p_time:.2f},{1000 * q_time:.2f},{inside}")
print(f"# {len(lines)} poses, {missed} outside")
sys.exit(missed > 0)
