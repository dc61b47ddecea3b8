"""What dust costs whoever asks for a distance: triangles of `extract --error D` by two programs, with and without dust.

    python3 benches/specks.py BEFORE AFTER WORK MODEL... > benches/records/DATE-specks.csv

BEFORE and AFTER are two programs, WORK is a folder for what they make. A MODEL is a mesh, or one of `chpm synth` and its triangles, as in hard:components/400000.
`clean` is AFTER's file of the model without components smaller than 2 %.
"""

import json
import pathlib
import subprocess
import sys

SHARES = ["0.25%", "0.5%", "1%", "2%", "4%"]


def run(program, *arguments):
    done = subprocess.run([program, *arguments], capture_output=True, text=True)
    return done.stdout if done.returncode == 0 else None


def triangles(program, file, share, work):
    out = run(program, "extract", file, "--error", share, "-o", work / "out.ply", "-fq", "--json")
    return json.loads(out) if out else {"triangles": "", "distance": ""}


def main():
    before, after, work, *models = sys.argv[1:]
    work = pathlib.Path(work)
    print("model,share,before,after,clean,distance_after,remnants_of_file,bytes_before,bytes_after")
    for model in models:
        name, path = pathlib.Path(model).stem, model
        if not pathlib.Path(model).exists():
            kind, _, count = model.partition("/")
            name, path = model, work / "model.ply"
            run(after, "synth", kind, *(["--triangles", count] if count else []), "-o", path, "-fq")
        files = {}
        for key, program, *more in [("before", before), ("after", after), ("clean", after, "--min-component", "2%")]:
            files[key] = work / f"{key}.chpm"
            run(program, "build", path, "-o", files[key], "-fq", *more)
        remnants = json.loads(run(after, "info", files["after"], "--json")).get("remnants", "")
        sizes = [files[key].stat().st_size for key in ("before", "after")]
        for share in SHARES:
            of = {key: triangles(before if key == "before" else after, file, share, work) for key, file in files.items()}
            row = [of[key]["triangles"] for key in files] + [of["after"]["distance"], remnants, *sizes]
            print(name.replace(",", ""), share, *row, sep=",", flush=True)


main()
