"""Rays in memory beside embreex, one thread each, by processor time, in turn.

Usage: python benches/rays.py SPEED MESH.ply FILE.chpm [RUNS], with numpy, trimesh and embreex; SPEED is
target/release/examples/speed (cargo build --release -p chpm-rays --example speed). Prints CSV.
"""

import subprocess
import sys
import tempfile
import time

import numpy as np
import trimesh
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

speed, mesh_path, file_path = sys.argv[1:4]
runs = int(sys.argv[4]) if len(sys.argv) > 4 else 3
mesh = trimesh.load(mesh_path, process=False)
low, high = mesh.bounds
middle, size = (low + high) / 2, np.linalg.norm(high - low)
chance = np.random.default_rng(1)

# A camera, row by row; and rays between random points of the box.
eye = middle + size * np.array([0.6, -0.9, 0.5])
way = (middle - eye) / np.linalg.norm(middle - eye)
right = np.cross(way, [0, 0, 1])
right /= np.linalg.norm(right)
up = np.cross(right, way)
x, y = np.meshgrid(np.linspace(-0.4, 0.4, 700), np.linspace(-0.4, 0.4, 700))
camera = way + x.reshape(-1, 1) * right + y.reshape(-1, 1) * up
a, b = (low + chance.random((300_000, 3)) * (high - low) for _ in range(2))
kinds = {"camera": (np.broadcast_to(eye, camera.shape), camera), "random": (a, b - a)}

scene = rtcore_scene.EmbreeScene()
TriangleMesh(scene, mesh.triangles.astype(np.float32))
print("rays,count,run,chpm hits,embreex hits,chpm rays/s,embreex rays/s,ratio")
for name, (origins, directions) in kinds.items():
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    with tempfile.NamedTemporaryFile() as rays:
        rays.write(np.hstack([origins, directions]).astype("<f8").tobytes())
        rays.flush()
        o, d = origins.astype(np.float32), directions.astype(np.float32)
        scene.run(o[:100], d[:100])
        for run in range(runs):
            out = subprocess.run([speed, file_path, rays.name], check=True, capture_output=True, text=True).stdout
            _, count, hits, _, seconds = next(line for line in out.splitlines() if line.startswith("nearest")).split(",")
            begun = time.process_time()
            found = scene.run(o, d)
            theirs = time.process_time() - begun
            mine = int(count) / float(seconds)
            peer = len(o) / theirs
            print(f"{name},{count},{run},{hits},{(found >= 0).sum()},{mine:.0f},{peer:.0f},{mine / peer:.3f}", flush=True)
