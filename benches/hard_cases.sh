#!/usr/bin/env bash
# Builds every hard mesh at full size, and in turn with each a terrain of as many triangles, as whole processes; writes a record.
# Usage: benches/hard_cases.sh [RUNS [NAME...]]; with names, the record is printed only.
set -euo pipefail
export LC_ALL=C

runs=${1:-3}
shift || true
cd "$(dirname "$0")/.."

if [[ -z ${CHPM:-} ]]; then
    cargo build --release --quiet
    CHPM=$(cargo metadata --no-deps --format-version 1 | jq -r .target_directory)/release/chpm
fi
chpm=$(realpath "$CHPM")
names=("$@")
[[ ${#names[@]} -gt 0 ]] || mapfile -t names < <("$chpm" synth --list | sed -n 's/^hard:\([a-z-]*\).*/\1/p')

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

median() { sort -g | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'; }

# Builds MODEL, and appends seconds to MODEL.s: of the clock, and of all processors; the report is in MODEL.json.
build() {
    local TIMEFORMAT='%R %U %S'
    { time "$chpm" build --quiet --json --force -o "$work/out.chpm" "$work/$1.ply" >"$work/$1.json" 2>"$work/errors"; } 2>"$work/time" ||
        { cat "$work/errors" >&2; return 1; }
    awk '{ printf "%.3f %.3f\n", $1, $2 + $3 }' "$work/time" >>"$work/$1.s"
}

# Medians of both.
seconds() { echo "$(cut -d' ' -f1 "$work/$1.s" | median),$(cut -d' ' -f2 "$work/$1.s" | median)"; }

commit=$(git rev-parse --short HEAD)$(git diff --quiet HEAD || echo +)
record=$work/record.csv
echo "date,commit,case,triangles,wall_s,cpu_s,wall_ratio,cpu_ratio,peak_rss_mb,bytes_per_tri,stalled,forced,top_triangles" >"$record"
for name in "${names[@]}"; do
    rm -f "$work"/*.s
    "$chpm" synth "hard:$name" --quiet --force -o "$work/case.ply" >"$work/said"
    triangles=$(sed 's/.*: \([0-9,]*\) triangles.*/\1/; s/,//g' "$work/said")
    "$chpm" synth terrain --triangles "$triangles" --quiet --force -o "$work/terrain.ply" >"$work/said"
    for ((run = 0; run < runs; run++)); do
        build case
        build terrain
    done
    times=$(seconds case),$(seconds terrain)
    jq -r --arg head "$(date +%F),$commit,$name" --arg times "$times" '
        def digits(n): . * n | round / n;
        ($times | split(",") | map(tonumber)) as [$wall, $cpu, $terrain_wall, $terrain_cpu]
        | [$head, .triangles, $wall, $cpu, ($wall / $terrain_wall | digits(100)), ($cpu / $terrain_cpu | digits(100)),
           (.peak_resident_bytes / 1048576 | digits(10)), (.bytes_per_triangle | digits(10)),
           ([.levels[].stalled_clusters] | add), ([.levels[].forced_collapses] | add), .levels[-1].base_triangles]
        | map(tostring) | join(",")' "$work/case.json" >>"$record"
    tail -n 1 "$record"
done

if [[ $# -eq 0 ]]; then
    cp "$record" "benches/records/$(date +%F)-hard-cases.csv"
    echo "written: benches/records/$(date +%F)-hard-cases.csv"
fi
