#!/usr/bin/env python3
"""Replays the trace of a build for other numbers of workers, and prints the speed-up.

Usage: chpm build SOURCE --threads 1 --trace TRACE.json; benches/replay.py TRACE.json

The trace is to be of one thread, whose tasks nobody disturbed. Stages come one after another, and in a stage its phases (a level
of simplify is one); the tasks of a phase are given, in their order, to whichever worker is free first. What is in no task is
serial. Memory bandwidth is not modelled, and a task that uses several threads counts as one.
"""

import heapq
import json
import sys
from collections import defaultdict

WORKERS = [2, 4, 8, 16, 64]


def makespan(tasks, workers):
    """When the last of the tasks ends."""
    free = [0.0] * workers
    for length in tasks:
        heapq.heappush(free, heapq.heappop(free) + length)
    return max(free)


def stages(events):
    """Name, serial time and the phases' tasks of each stage, in seconds."""
    tasks = sorted((e for e in events if e["cat"] == "task"), key=lambda e: e["ts"])
    for stage in sorted((e for e in events if e["cat"] == "stage"), key=lambda e: e["ts"]):
        phases = defaultdict(list)
        for task in tasks:
            if stage["ts"] <= task["ts"] < stage["ts"] + stage["dur"]:
                phases[task["args"]["phase"]].append(task["dur"] / 1e6)
        serial = stage["dur"] / 1e6 - sum(map(sum, phases.values()))
        yield stage["name"], max(serial, 0.0), list(phases.values())


def row(name, serial, times):
    ratios = "".join(f"{times[0] / max(time, 1e-12):8.2f}" for time in times[1:])
    print(f"{name:12}{serial:10.3f}{ratios}")


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        events = json.load(file)
    if len({e["tid"] for e in events if e["cat"] == "task"}) > 1:
        sys.exit("the trace is of several threads; record it with --threads 1")
    print(f"{'stage':12}{'serial s':>10}" + "".join(f"{count:8}" for count in WORKERS))
    total, waiting = [0.0] * (1 + len(WORKERS)), 0.0
    for name, serial, phases in stages(events):
        times = [serial + sum(makespan(p, count) for p in phases) for count in [1, *WORKERS]]
        row(name, serial, times)
        total = [sum(pair) for pair in zip(total, times)]
        waiting += serial
    row("all", waiting, total)


main()
