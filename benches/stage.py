#!/usr/bin/env python3
"""One model in steps: what they take beside one process, and what is lost of them.

Usage: benches/stage.py measure CHPM SOURCE FOLDER [--parts N] [--levels K] [--memory SIZE] [--by work|snakemake] [SETTINGS...]
       benches/stage.py faults CHPM SOURCE FOLDER [--parts N] [--levels K] [--turns N] [--seed N] [SETTINGS...]

`measure` builds SOURCE in one process and in steps, compares the files, and prints a line of CSV for each step: its file, bytes, seconds,
processor seconds, peak memory. `faults` makes all parts, then turn by turn deletes, cuts or changes a part or kills a step at random, and has
`chpm work` put it right: the bytes of the parts and of the model must be those of before, and only what was lost, or what comes behind it, may be made again.
"""

import argparse
import hashlib
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import time

import schedule

LINE = re.compile(r"^(.*): ([0-9.,]+) (B|KiB|MiB|GiB) in ([0-9.]+) s(?:, ([0-9.]+) s of processors)?(?:, ([0-9.]+) (B|KiB|MiB|GiB) of memory)?$")
UNITS = {"B": 1, "KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}


def run(*words, **options):
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, **options)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}: {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def used():
    """Processor seconds of all processes that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def digest(path):
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def rows(text):
    """File, bytes, seconds, processor seconds and memory of each step that told of itself."""
    for line in text.splitlines():
        found = LINE.match(line)
        if found:
            name, size, unit, seconds, busy, memory, memory_unit = found.groups()
            size = float(size.replace(",", "")) * UNITS[unit]
            yield os.path.basename(name), size, float(seconds), float(busy or 0), float(memory or 0) * UNITS[memory_unit or "B"]


def plan(args):
    return run(args.chpm, "stage", "plan", args.source, "-o", args.stages, "--parts", args.parts, "--levels", args.levels,
               "--memory", args.memory, "--threads", args.threads, "-q", *args.settings)


def measure(args):
    one, before, begun = os.path.join(args.folder, "one.chpm"), used(), time.time()
    run(args.chpm, "build", args.source, "-o", one, "-f", "-q", "--no-resume", "--memory", args.memory, "--threads", args.threads, *args.settings)
    of_one, wall = used() - before, time.time() - begun
    shutil.rmtree(args.stages, ignore_errors=True)
    before, begun = used(), time.time()
    if args.by == "snakemake":
        text = run(args.chpm, "stage", "workflow", args.source, "-o", args.model, "--parts", args.parts, "--levels", args.levels,
                   "--memory", args.memory, "--threads", args.threads, "--", *args.settings)
        snakefile = os.path.join(args.folder, "Snakefile")
        with open(snakefile, "w") as file:
            file.write(text)
        told = run("snakemake", "--cores", 2, "-s", snakefile, "-d", args.folder, "--config", f"chpm={args.chpm}")
    else:
        told = plan(args) + run(args.chpm, "work", args.stages, "-o", args.model, "-f", "-q", "--memory", args.memory, "--threads", args.threads)
    of_steps, steps_wall = used() - before, time.time() - begun
    same = digest(one) == digest(args.model)
    table = list(rows(told))
    busy, largest = sum(row[3] for row in table), max(row[4] for row in table)
    disk = sum(entry.stat().st_size for entry in os.scandir(args.stages))
    print(f"# {args.source}: {args.parts} parts, {args.levels} levels in parts, --memory {args.memory}, --threads {args.threads}, by {args.by}; bytes are {'the same' if same else 'DIFFERENT'}")
    print(f"# one process: {of_one:.1f} s of processors, {wall:.0f} s; steps: {busy:.1f} s of processors in {len(table)} commands, {of_steps:.1f} s with the engine, {steps_wall:.0f} s")
    print(f"# processor time of steps beside one process: {busy / of_one:.2f}, with the engine {of_steps / of_one:.2f}; most memory {largest / (1 << 20):.0f} MiB; parts take {disk / (1 << 20):.0f} MiB of disk")
    print("file,bytes,seconds,processor_seconds,peak_memory")
    for name, size, seconds, busy, memory in table:
        print(f"{name},{size:.0f},{seconds:.2f},{busy:.2f},{memory:.0f}")
    return 0 if same else 1


def parts(folder):
    names = sorted(name for name in os.listdir(folder) if name.endswith(".part"))
    return {name: (digest(os.path.join(folder, name)), os.stat(os.path.join(folder, name)).st_mtime_ns) for name in names}


def behind(name, names):
    """The parts that are made of one, or of what is."""
    found = {name}
    while more := {other for other in names if other not in found and found & set(schedule.needs(other, names))}:
        found |= more
    return found


def fault(args, chance, names):
    """Does something to a part; answers its name and what was done."""
    name = chance.choice(names)
    path = os.path.join(args.stages, name)
    what = chance.choice(["deleted", "changed", "cut", "killed"])
    if what == "deleted":
        os.remove(path)
    elif what == "cut":
        os.truncate(path, chance.randrange(os.path.getsize(path)))
    elif what == "changed":
        with open(path, "r+b") as file:
            place = chance.randrange(os.path.getsize(path))
            file.seek(place)
            byte = file.read(1)[0]
            file.seek(place)
            file.write(bytes([byte ^ 1 << chance.randrange(8)]))
    else:
        # A worker that makes it is killed on its way, at some access to a file.
        os.remove(path)
        subprocess.run([args.chpm, "work", args.stages, "-o", args.model, "-f", "-q", "--threads", "2", "--kill-at", str(chance.randrange(60))],
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return name, what


def faults(args):
    chance = random.Random(args.seed)
    shutil.rmtree(args.stages, ignore_errors=True)
    one = os.path.join(args.folder, "one.chpm")
    run(args.chpm, "build", args.source, "-o", one, "-f", "-q", *args.settings)
    plan(args)
    work = [args.chpm, "work", args.stages, "-o", args.model, "-f", "-q", "--threads"]
    run(*work, 2)
    whole, first = digest(one), parts(args.stages)
    print("turn,part,fault,made_again,bytes")
    failed = digest(args.model) != whole
    for turn in range(args.turns):
        before = parts(args.stages)
        name, what = fault(args, chance, [name for name in first if name != "plan.part"])
        # What was changed inside a part shows where somebody reads it, or when all is looked at.
        if what == "changed":
            os.remove(args.model)
            run(args.chpm, "stage", "check", args.stages, "--remove")
        run(*work, 1 + turn % 3)
        after = parts(args.stages)
        again = [other for other in after if after[other][1] != before[other][1]]
        same = digest(args.model) == whole and {n: d for n, (d, _) in after.items()} == {n: d for n, (d, _) in first.items()}
        only = set(again) <= behind(name, list(first)) | {"finish.part"}
        failed |= not (same and only)
        print(f"{turn},{name},{what},{' '.join(again)},{'same' if same else 'DIFFERENT'}{'' if only else ' TOO MANY'}", flush=True)
    return int(failed)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["measure", "faults"])
    for name in ["chpm", "source", "folder"]:
        parser.add_argument(name, type=os.path.abspath)
    parser.add_argument("--parts", default=4, type=int)
    parser.add_argument("--levels", default=3, type=int)
    parser.add_argument("--memory", default="512M")
    parser.add_argument("--threads", default=2, type=int)
    parser.add_argument("--by", choices=["work", "snakemake"], default="work")
    parser.add_argument("--turns", default=40, type=int)
    parser.add_argument("--seed", default=1, type=int)
    args, args.settings = parser.parse_known_args()
    os.makedirs(args.folder, exist_ok=True)
    args.stages, args.model = (os.path.join(args.folder, name) for name in ["model.stages", "model.chpm"])
    sys.exit({"measure": measure, "faults": faults}[args.what](args))


main()
