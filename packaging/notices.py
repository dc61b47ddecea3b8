#!/usr/bin/env python3
"""Prints what a program of Rust owes to others: every crate that is linked into it, what it may be used under, and the texts that come with it and with
the libraries of C that it carries. It asks `cargo metadata`; crates have to be there, as after a build.

    packaging/notices.py Cargo.toml [TARGET] > THIRD-PARTY-NOTICES

Systems link crates of their own: those of TARGET are named, of Linux where none is given.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

LINUX = "x86_64-unknown-linux-gnu"
# Names of files that hold terms, wherever they are in a crate: next to the code, in a library that it carries, beside fonts.
TERMS = re.compile(r"(un)?licen[sc]e|copying|copyright|notice|[ou]fl\b|(hack-regular|egui-icons)\.txt", re.IGNORECASE)
NOT_TERMS = {".rs", ".py", ".c", ".h", ".hpp", ".toml", ".html", ".sh", ".yml"}
# Terms at the end of a header, where a library of C comes without a file of them.
IN_SOURCE = {"meshopt": ["vendor/src/meshoptimizer.h"]}


def linked(manifest, target=LINUX):
    """The crates of others that end up in the program."""
    words = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", target]
    data = json.loads(subprocess.check_output(words + ["--manifest-path", manifest]))
    packages = {package["id"]: package for package in data["packages"]}
    nodes = {node["id"]: node for node in data["resolve"]["nodes"]}
    waiting, seen = [data["resolve"]["root"]], set()
    while waiting:
        node = waiting.pop()
        if node in seen:
            continue
        seen.add(node)
        # What only tests or builds a crate is not in the program.
        waiting += [dep["pkg"] for dep in nodes[node]["deps"] if any(kind["kind"] is None for kind in dep["dep_kinds"])]
    others = (packages[node] for node in seen if packages[node]["source"])
    return sorted(others, key=lambda package: (package["name"], package["version"]))


def comment_at_end(path):
    """The last comment of a source file that speaks of a copyright."""
    comments = re.findall(r"/\*\*?(.*?)\*/", path.read_text(encoding="utf-8", errors="replace"), re.DOTALL)
    last = [comment for comment in comments if "Copyright" in comment][-1]
    return "\n".join(line.strip().removeprefix("*").strip() for line in last.strip().splitlines())


def terms(package):
    """The texts that come with a crate, by where they are in it."""
    folder = Path(package["manifest_path"]).parent
    found = {}
    for path in sorted(folder.rglob("*")):
        inside = path.relative_to(folder)
        if path.is_file() and TERMS.match(path.name) or "license" in path.name.lower() and path.suffix == ".txt":
            if path.suffix.lower() not in NOT_TERMS and not {"tests", "target"} & set(inside.parts):
                found[str(inside)] = path.read_text(encoding="utf-8", errors="replace")
    for name in IN_SOURCE.get(package["name"], []):
        found[name] = comment_at_end(folder / name)
    return found


def main():
    # Windows writes in an encoding that lacks some of the names.
    sys.stdout.reconfigure(encoding="utf-8")
    texts, rows = {}, []
    for package in linked(*sys.argv[1:]):
        named = f"{package['name']} {package['version']}"
        found = terms(package)
        authors = ", ".join(re.sub(r"\s*<.*?>", "", author) for author in package["authors"])
        by = "" if found or not authors else f"; by {authors}"
        rows.append(f"{named}: {package['license'] or 'see its text below'}{by}")
        for inside, text in found.items():
            text = "\n".join(line.rstrip() for line in text.strip("\n").splitlines())
            # One text, however its lines are broken.
            texts.setdefault(" ".join(text.split()), (text, []))[1].append(f"{named}, {inside}")
    print("This program contains work of others. Crates of Rust, and the terms that they may be used under:\n")
    print("\n".join(rows))
    for text, users in texts.values():
        print("\n" + "-" * 100)
        print("\n".join(users))
        print("-" * 100 + "\n")
        print(text)


main()
