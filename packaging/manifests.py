"""Fills the manifests of package managers with a release: its version, its address, and the checksums of its archives.

Usage: python3 packaging/manifests.py FOLDER-OF-ARCHIVES ADDRESS OUTPUT

ADDRESS is where the archives of the release can be fetched, without the last slash. Templates are the files in homebrew, winget and
conda beside this one: @VERSION@, @ADDRESS@ and @SHA256 ARCHIVE@ stand for what is filled in.
"""

import hashlib
import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
MANAGERS = ["homebrew", "winget", "conda"]


def version() -> str:
    found = re.search(r'^version = "(.*)"', (HERE.parent / "Cargo.toml").read_text(), re.MULTILINE)
    return found[1]


def filled(template: str, archives: Path, address: str) -> str:
    text = template.replace("@VERSION@", version()).replace("@ADDRESS@", address)

    def checksum(found: re.Match) -> str:
        return hashlib.sha256((archives / found[1]).read_bytes()).hexdigest()

    return re.sub(r"@SHA256 (\S+)@", checksum, text)


def main() -> None:
    archives, address, output = sys.argv[1:]
    for manager in MANAGERS:
        for template in sorted((HERE / manager).iterdir()):
            target = Path(output) / manager / template.name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(filled(template.read_text(), Path(archives), address))
            print(target)


if __name__ == "__main__":
    main()
