#!/usr/bin/env bash
# Peak resident memory and speed of builds of growing models at one budget, in order and shuffled.
# Usage: benches/memory.sh MEMORY MILLIONS... > FILE.csv, as in benches/memory.sh 256M 1 10 30
# Needs about 80 bytes of disk for each triangle of the largest model. Shuffles models up to 30 million triangles only.
set -euo pipefail
export LC_ALL=C

memory=${1:?usage: benches/memory.sh MEMORY MILLIONS...}
shift
cd "$(dirname "$0")/.."

cargo build --release --quiet
cargo build --release --quiet -p chpm-import --example shuffle
target=$(cargo metadata --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
chpm=$target/release/chpm
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

field() { sed -n "s/^  \"$1\": \([0-9.]*\),\{0,1\}$/\1/p" "$work/report.json"; }

# Builds a model and prints its row.
row() {
    local name=$1 source=$2 TIMEFORMAT='%R %U %S'
    { time "$chpm" build --quiet --json --force --memory "$memory" -o "$work/out.chpm" "$source" \
        >"$work/report.json"; } 2>"$work/time"
    awk -v name="$name" -v memory="$memory" -v n="$(field triangles)" -v rss="$(field peak_resident_bytes)" \
        -v bytes="$(wc -c <"$work/out.chpm")" \
        '{ printf "%s,%d,%s,%.1f,%.2f,%.2f,%d,%.2f\n", name, n, memory, rss / 1048576, $1, $2 + $3, n / $1, bytes / n }' \
        "$work/time"
}

echo "model,triangles,memory,peak_rss_mib,wall_s,cpu_s,tri_per_s,bytes_per_tri"
for millions in "$@"; do
    for shape in terrain isosurface; do
        "$chpm" synth "$shape" --triangles "${millions}000000" -o "$work/model.ply" --quiet --force >/dev/null
        row "$shape" "$work/model.ply"
        if ((millions <= 30)); then
            "$target/release/examples/shuffle" "$work/model.ply" "$work/shuffled.ply"
            rm "$work/model.ply"
            row "$shape shuffled" "$work/shuffled.ply"
            rm "$work/shuffled.ply"
        fi
    done
done
