#!/usr/bin/env bash
# Makes a record: builds MODEL with chpm and with the peer in turn, as whole processes, and writes the medians.
# Usage: benches/record.sh MODEL.ply [RUNS]
set -euo pipefail
export LC_ALL=C

model=$(realpath "${1:?usage: benches/record.sh MODEL.ply [RUNS]}")
runs=${2:-5}
cd "$(dirname "$0")/.."

cargo build --release --quiet
peers=$(cargo bench --no-run --bench peers 2>&1 | sed -n 's/.*Executable.*(\(.*\)).*/\1/p')
target=$(cargo metadata --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
chpm=$target/release/chpm
[[ -x $chpm && -x $peers ]] || { echo "record.sh: nothing to run at '$chpm' or '$peers'" >&2; exit 1; }

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat "$model" >"$work/warm" && rm "$work/warm" # into the page cache

# Runs a command, its output to a file; prints seconds.
seconds() {
    local out=$1 start=$EPOCHREALTIME
    shift
    "$@" >"$out"
    awk -v a="$start" -v b="$EPOCHREALTIME" 'BEGIN { printf "%.4f\n", b - a }'
}

median() { sort -g | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'; }

field() { sed -n "s/^  \"$1\": \([0-9.]*\),\{0,1\}$/\1/p" "$2"; }

for ((run = 0; run < runs; run++)); do
    seconds "$work/chpm.json" "$chpm" build --quiet --json --force -o "$work/out.chpm" "$model" >>"$work/chpm.s"
    field peak_resident_bytes "$work/chpm.json" >>"$work/chpm.rss"
    seconds "$work/clod.txt" "$peers" clod "$model" "$work/out.clod" >>"$work/clod.s"
    awk '{ print $2 }' "$work/clod.txt" >>"$work/clod.rss"
done

name=$(basename "$model" .ply)
triangles=$(field triangles "$work/chpm.json")
commit=$(git rev-parse --short HEAD)$(git diff --quiet HEAD || echo +)
meshopt=$(sed -n '/^name = "meshopt"$/{n;s/version = "\(.*\)"/\1/p}' Cargo.lock)
record=benches/records/$(date +%F)-$name.csv
mkdir -p benches/records
echo "date,commit,model,triangles,tool,wall_s,tri_per_s,peak_rss_mb,output_bytes,bytes_per_tri" >"$record"
row() {
    local tool=$1 files=$2 out=$3
    awk -v tool="$tool" -v date="$(date +%F)" -v commit="$commit" -v model="$name" -v n="$triangles" \
        -v s="$(median <"$work/$files.s")" -v rss="$(median <"$work/$files.rss")" -v bytes="$(wc -c <"$out")" \
        'BEGIN { printf "%s,%s,%s,%d,%s,%.3f,%.0f,%.1f,%d,%.2f\n",
                 date, commit, model, n, tool, s, n / s, rss / 1048576, bytes, bytes / n }' >>"$record"
}
row chpm chpm "$work/out.chpm"
row "meshopt-clod-$meshopt" clod "$work/out.clod"

column -s, -t "$record" 2>/dev/null || cat "$record"
echo "median of the ratios: $(paste "$work/clod.s" "$work/chpm.s" | awk '{ print $1 / $2 }' | median)"
echo "written: $record"
