#!/usr/bin/env python3
"""Schedules the recorded steps of a build on other numbers of workers: how long each phase takes, and how much of the workers it uses.

Usage: benches/schedule.py RECORD.csv [WORKERS...]

RECORD is what `benches/stage.py measure` prints. Each worker is a machine that does one step at a time; a step begins when the parts that it reads are there
and a worker is free, the longest first. Times are processor seconds, as on one thread of an idle machine. Reading from a shared file system and starting
processes are not modelled. With `--finer F` each part is divided into F, at an equal share of its time: what more parts would do, as a guess.
"""

import csv
import heapq
import re
import sys

WORKERS = [16, 64, 1024]


def needs(name, names):
    """The files that a step reads."""
    of = lambda *starts: [other for other in names if other.startswith(starts)]
    level = re.match(r"(?:group|simplify)-([0-9]+)", name)
    if name.startswith("scatter"):
        return of("plan")
    if name.startswith("borders"):
        return of("scatter")
    if name.startswith("regions"):
        return of("borders")
    if name.startswith("hierarchy"):
        return of("regions")
    if name.startswith("group"):
        return of("hierarchy") if level[1] == "0" else of(f"simplify-{int(level[1]) - 1}-")
    if name.startswith("simplify"):
        return of(f"group-{level[1]}.")
    if name.startswith("top"):
        return of("simplify-") or of("hierarchy")
    if name.startswith("layout"):
        return of("top")
    if name.startswith("emit"):
        return of("layout")
    return of("emit") if not name.startswith("plan") else []


def schedule(times, workers):
    """When each step begins and ends."""
    waits = {name: set(needs(name, times)) for name in times}
    ready, running, free, now, spans = [], [], workers, 0.0, {}
    for name, wait in waits.items():
        if not wait:
            heapq.heappush(ready, (-times[name], name))
    while ready or running:
        while ready and free:
            cost, name = heapq.heappop(ready)
            spans[name] = (now, now - cost)
            heapq.heappush(running, (now - cost, name))
            free -= 1
        now, ended = heapq.heappop(running)
        free += 1
        for name, wait in waits.items():
            if ended in wait:
                wait.remove(ended)
                if not wait and name not in spans:
                    heapq.heappush(ready, (-times[name], name))
    return spans


def phase(name):
    return re.match(r"[a-z]+(?:-[0-9]+(?=-[0-9]+-|\.))?", name)[0] if not name.startswith(("scatter", "regions", "emit")) else name.split("-")[0]


def main():
    words = sys.argv[1:]
    finer = int(words.pop(words.index("--finer") + 1)) if "--finer" in words else 1
    words = [word for word in words if word != "--finer"]
    with open(words[0]) as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    times = {}
    for row in rows:
        pieces = finer if "-of-" in row["file"] else 1
        for piece in range(pieces):
            name = row["file"] if pieces == 1 else row["file"].replace("-of-", f"-{piece}-of-")
            times[name] = float(row["processor_seconds"]) / pieces
    total = sum(times.values())
    print("workers,phase,steps,processor_seconds,seconds,efficiency")
    for workers in [int(word) for word in words[1:]] or WORKERS:
        spans = schedule(times, workers)
        phases = {}
        for name in times:
            phases.setdefault(phase(name), []).append(name)
        for kind, names in phases.items():
            busy = sum(times[name] for name in names)
            took = max(spans[name][1] for name in names) - min(spans[name][0] for name in names)
            print(f"{workers},{kind},{len(names)},{busy:.2f},{took:.2f},{busy / (took * workers) if took else 1:.3f}")
        end = max(end for _, end in spans.values())
        print(f"{workers},all,{len(times)},{total:.2f},{end:.2f},{total / (end * workers):.3f}")


if __name__ == "__main__":
    main()
