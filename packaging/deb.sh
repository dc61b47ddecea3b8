#!/usr/bin/env bash
# Makes a Debian package: the command, its manual pages, and completions for bash, zsh and fish, and the terms of what others wrote of it.
# It needs `cargo install cargo-deb` and python3.
# --no-build takes the program that is there; what else is given goes to cargo deb.
set -euo pipefail
cd "$(dirname "$0")/.."

build=yes
more=()
for word in "$@"; do
    if [ "$word" = --no-build ]; then build=no; else more+=("$word"); fi
done
[ $build = no ] || cargo build --release --locked
program="${CARGO_TARGET_DIR:-target}/release/chpm"
# What is packed is where Cargo.toml says, whatever the target folder.
made=target/package
rm -rf "$made"
mkdir -p "$made/man1"
"$program" man --force "$made/man1" >/dev/null
"$program" completions bash >"$made/chpm.bash"
"$program" completions zsh >"$made/_chpm"
"$program" completions fish >"$made/chpm.fish"
# What others ask to be told of what is linked in: METIS, zstd, meshoptimizer, fonts, crates.
python3 packaging/notices.py Cargo.toml | gzip --best --no-name >"$made/THIRD-PARTY-NOTICES.gz"
# Debian asks for a history of the package itself, too.
gzip --best --no-name <CHANGELOG.md >"$made/changelog.gz"
version=$(cargo metadata --locked --no-deps --format-version 1 | grep -o '"name":"chpm","version":"[^"]*"' | cut -d'"' -f8)
date=$(date --utc --rfc-email --date="@$(git log -1 --format=%ct)")
printf 'chpm (%s-1) unstable; urgency=medium\n\n  * See changelog.gz.\n\n -- The authors of chpm <>  %s\n' "$version" "$date" >"$made/changelog"
cargo deb --locked --no-build "${more[@]}"
