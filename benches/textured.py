#!/usr/bin/env python3
"""Builders of levels of detail with textures, in turn: seconds, processor seconds, memory, bytes and nearness of pictures.

textured.py CHPM PICTURES WORK MODEL... prints CSV. PICTURES is `cargo build --release -p chpm-build --example textured_pictures`, WORK a folder for what is made.
`nxsbuild` (nexus; MODEL as OBJ or PLY) and `Obj2Tiles` (OBJ) take part where the path has them: their command lines are from their documentation, and were not tried here.
Bytes of one that writes a folder are all in it. psnr_1, psnr_4 and psnr_16 are of meshes of all, a quarter and a sixteenth of the triangles with one image of 4096 texels
a side, as `chpm extract` writes them: the least of six sides, 1024 pixels each, decibels, beside the source; of the other two no mesh of so many triangles is taken.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time

PARTS = (1, 4, 16)


def size(path):
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def measured(command):
    """Wall and processor seconds, and most MiB that were resident."""
    begun = time.perf_counter()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode != 0:
        raise RuntimeError(f"{command[0]} ended with {child.returncode}")
    return time.perf_counter() - begun, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def psnr(pictures, work, source, mesh):
    out = subprocess.run([pictures, "1024", work / "pictures", source, mesh], capture_output=True, text=True, check=True)
    return min(float(found) for found in re.findall(r"PSNR ([\d.]+)", out.stdout))


def triangles(chpm, file):
    out = subprocess.run([chpm, "stats", file, "--json"], capture_output=True, text=True, check=True).stdout
    return int(float(re.search(r'"triangles": ([\d.]+)', out).group(1)))


def main():
    chpm, pictures, work, *models = sys.argv[1:]
    work = pathlib.Path(work)
    work.mkdir(parents=True, exist_ok=True)
    print("model,builder,seconds,processor_seconds,mib,bytes," + ",".join(f"psnr_{part}" for part in PARTS), flush=True)
    for model in models:
        name = pathlib.Path(model).stem
        builders = {"chpm": ([chpm, "build", model, "-o", work / f"{name}.chpm", "-fq"], work / f"{name}.chpm")}
        if shutil.which("nxsbuild"):
            builders["nxsbuild"] = (["nxsbuild", model, "-o", work / f"{name}.nxs"], work / f"{name}.nxs")
        if shutil.which("Obj2Tiles") and model.endswith(".obj"):
            builders["Obj2Tiles"] = (["Obj2Tiles", "--lods", "4", model, work / f"{name}.tiles"], work / f"{name}.tiles")
        for builder, (command, made) in builders.items():
            seconds, processor, memory = measured(command)
            row = [name, builder, f"{seconds:.2f}", f"{processor:.2f}", f"{memory:.0f}", size(made)]
            for part in PARTS if builder == "chpm" else ():
                mesh = work / f"{name}-{part}.glb"
                count = triangles(chpm, made) // part
                words = [chpm, "extract", made, "--triangles", str(count), "--texture-size", "4096", "-o", mesh, "-fq"]
                subprocess.run(words, check=True)
                row.append(f"{psnr(pictures, work, model, mesh):.1f}")
            print(*row, sep=",", flush=True)


main()
