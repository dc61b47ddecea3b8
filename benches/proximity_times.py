"""Times `chpm distance` at random poses, a process for each: proximity_times.py CHPM FILE.chpm COUNT [ERROR] [POSES]

The second model is FILE again, turned at random, its middle up to 0.7 of the diagonal away along each axis. A line for each pose, and percentiles: processor
time of the whole process (user and system), bytes that were read as a share of both files. With POSES, the poses are written there, for `peer` and `--path`.
"""

import json
import math
import random
import resource
import subprocess
import sys


def pose(rng, middle, diagonal):
    """A turn about the middle and a way: X Y Z QX QY QZ QW."""
    q = [rng.gauss(0, 1) for _ in range(4)]
    length = math.sqrt(sum(x * x for x in q))
    x, y, z, w = (v / length for v in q)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    turned = [sum(r * c for r, c in zip(row, middle)) for row in rows]
    way = [c - t + 0.7 * diagonal * (2 * rng.random() - 1) for c, t in zip(middle, turned)]
    return [f"{v:.9g}" for v in way + [x, y, z, w]]


def asked(chpm, file, words):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    out = subprocess.run([chpm, "distance", file, file, "--json", "-q", *words], capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return json.loads(out.stdout), 1000 * cpu


def middle_of(chpm, file):
    """The middle and the diagonal of the file's box, in the source's coordinates."""
    origin = low = high = None
    for line in subprocess.run([chpm, "dump", file], capture_output=True, text=True, check=True).stdout.splitlines():
        if line.startswith("origin "):
            parts = line.replace("[", "]").split("]")
            origin, low, high = ([float(x) for x in parts[i].split(",")] for i in (1, 3, 5))
            break
    middle = [o + (a + b) / 2 for o, a, b in zip(origin, low, high)]
    return middle, math.dist(low, high)


def main():
    chpm, file, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
    error = sys.argv[4] if len(sys.argv) > 4 else "0.1%"
    middle, diagonal = middle_of(chpm, file)
    rng = random.Random(9)
    poses = [pose(rng, middle, diagonal) for _ in range(count)]
    if len(sys.argv) > 5:
        with open(sys.argv[5], "w") as out:
            out.writelines(" ".join(p) + "\n" for p in poses)
    times, shares = [], []
    print("pose,least,most,ended,pages,percent_of_bytes,cpu_ms")
    for at, words in enumerate(poses):
        value, cpu = asked(chpm, file, [f"--pose={','.join(words)}", "--error", error])
        answer = value["answers"][0]
        share = 100 * sum(answer["page_bytes"]) / (value["first"]["bytes"] + value["second"]["bytes"])
        times.append(cpu)
        shares.append(share)
        print(f"{at},{answer['least']},{answer['most']},{answer['ended']},{sum(answer['pages'])},{share:.3f},{cpu:.1f}")
    for name, values in (("cpu_ms", times), ("percent_of_bytes", shares)):
        values.sort()
        at = lambda p: values[min(len(values) - 1, int(p * len(values)))]
        print(f"# {name}: median {at(0.5):.3f}, 90th percentile {at(0.9):.3f}, largest {at(1):.3f}")


if __name__ == "__main__":
    main()
