"""Times of the Python package: opening a file and selecting 100,000 triangles of it, page cache warm and cold.

usage: python benches/python_speed.py FILE.chpm
"""

from __future__ import annotations

import os
import statistics
import sys
import time

import chpm


def once(path: str, **selection) -> tuple[float, float, chpm.Selection]:
    wall, cpu = time.perf_counter(), time.process_time()
    with chpm.open(path) as file:
        mesh = file.select(**selection)
    return time.perf_counter() - wall, time.process_time() - cpu, mesh


def main(path: str) -> None:
    with chpm.open(path) as file:
        camera = file.camera()
        print(f"{path}: {file.triangle_count:,} triangles, packed pages: {file.is_packed}")
    once(path, triangles=100_000)
    print("selection, median wall s, longest wall s, median processor s, triangles")
    for name, selection in {
        "triangles=100_000": {"triangles": 100_000},
        "triangles=100_000, camera": {"triangles": 100_000, "camera": camera},
        "error='1%'": {"error": "1%"},
    }.items():
        runs = [once(path, **selection) for _ in range(7)]
        wall, cpu = [run[0] for run in runs], [run[1] for run in runs]
        count = runs[0][2].triangle_count
        print(f"{name}, {statistics.median(wall):.3f}, {max(wall):.3f}, {statistics.median(cpu):.3f}, {count:,}")
    with open(path, "rb") as file:
        os.fsync(file)
        cold = []
        for _ in range(5):
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
            cold.append(once(path, triangles=100_000)[0])
    print("triangles=100_000, page cache dropped:", ", ".join(f"{wall:.3f}" for wall in cold))
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main(sys.argv[1])
