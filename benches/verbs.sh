#!/usr/bin/env bash
# Peak resident memory and processor time of the verbs that read a .chpm, at given budgets.
# Usage: benches/verbs.sh MODEL.chpm SOURCE MEMORY... > FILE.csv, as in benches/verbs.sh iso.chpm iso.ply 128M 256M
# CHPM names the program, which is built if it does not. Needs GNU time, and disk for the mesh of level 0.
set -euo pipefail
export LC_ALL=C

usage="usage: benches/verbs.sh MODEL.chpm SOURCE MEMORY..."
model=$(realpath "${1:?$usage}") source=$(realpath "${2:?$usage}")
shift 2
cd "$(dirname "$0")/.."
if [ -z "${CHPM:-}" ]; then
    cargo build --release --quiet
    CHPM=$(cargo metadata --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')/release/chpm
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

triangles=$("$CHPM" info --json "$model" | sed -n 's/^  "triangles": \([0-9]*\),$/\1/p')

# Runs a verb and prints its row.
row() {
    local memory=$1
    shift
    /usr/bin/time -q -o "$work/time" -f '%M %U %S' "$CHPM" "$@" --memory "$memory" >/dev/null 2>"$work/error" ||
        echo "failed: $* --memory $memory: $(tail -n 1 "$work/error")" >&2
    local words="$*"
    words=${words//"$model"/MODEL} words=${words//"$source"/SOURCE} words=${words//"$work/"/}
    awk -v words="$words" -v memory="$memory" -v n="$triangles" \
        '{ printf "%s,%d,%s,%.1f,%.1f\n", words, n, memory, $1 / 1024, $2 + $3 }' "$work/time"
}

"$CHPM" path orbit "$model" --frames 20 -o "$work/orbit.path" >/dev/null
echo "verb,triangles,memory,peak_rss_mib,cpu_s"
for memory in "$@"; do
    row "$memory" verify "$model" -q
    row "$memory" verify "$model" --against "$source" -q
    row "$memory" measure "$model" --against "$source" --samples 1 --cuts 1 -q
    row "$memory" dump "$model"
    row "$memory" dump "$model" --pages
    row "$memory" info "$model"
    row "$memory" path dive "$model" -o "$work/dive.path" -f
    row "$memory" extract "$model" --level 0 -o "$work/out.ply" -qf
    row "$memory" extract "$model" --triangles $((triangles / 2)) -o "$work/out.ply" -qf
    row "$memory" extract "$model" --error 0 -o "$work/out.ply" -qf
    row "$memory" extract "$model" --poe 1 -o "$work/out.ply" -qf
    row "$memory" walk "$model" "$work/orbit.path" -q
    rm -f "$work/out.ply"
done
