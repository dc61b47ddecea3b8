#!/usr/bin/env bash
# Packs the program that was built for a target, with its manual pages, completions and the terms of what others wrote of it, into
# chpm-VERSION-TARGET.tar.xz (.zip for Windows) and its SHA-256 beside it. Needs python3, and a program that runs here.
#
# Usage: bash packaging/archive.sh TARGET [FOLDER FOR THE ARCHIVE]
set -euo pipefail
cd "$(dirname "$0")/.."
target=$1
mkdir -p "${2:-target/dist}"
folder=$(cd "${2:-target/dist}" && pwd)

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
name=chpm-$version-$target
program=${CARGO_TARGET_DIR:-target}/$target/release/chpm
case $target in *windows*) program+=.exe ;; esac
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
packed=$work/$name

mkdir -p "$packed/man" "$packed/completions"
cp "$program" README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$packed"
"$program" man --force "$packed/man" > /dev/null
for shell in bash zsh fish powershell; do "$program" completions $shell > "$packed/completions/chpm.$shell"; done
python3 packaging/notices.py Cargo.toml "$target" > "$packed/THIRD-PARTY-NOTICES"

cd "$work"
case $target in
*windows*)
    archive=$name.zip
    python3 -m zipfile --create "$folder/$archive" "$name"
    ;;
*)
    archive=$name.tar.xz
    tar --create --xz --file "$folder/$archive" "$name"
    ;;
esac
cd "$folder"
python3 - "$archive" > "$archive.sha256" <<'P'
import hashlib, sys
print(hashlib.sha256(open(sys.argv[1], "rb").read()).hexdigest(), "", sys.argv[1])
P
echo "$folder/$archive"
