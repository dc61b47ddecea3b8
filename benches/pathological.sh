#!/usr/bin/env bash
# Builds every odd shape (`chpm synth --list`) with little memory, checks and measures what comes out, and writes a record: what has more
# memory than it was given, or takes more than five times as long as the plain grid of as many triangles, is said at the end.
# Usage: benches/pathological.sh [TRIANGLES [NAME...]]; with names, the record is printed only. MEMORY and LIMIT (seconds for a step) may be set.
set -euo pipefail
export LC_ALL=C

triangles=${1:-1000000}
shift || true
memory=${MEMORY:-128M}
limit=${LIMIT:-600}
cd "$(dirname "$0")/.."

if [[ -z ${CHPM:-} ]]; then
    cargo build --release --quiet --no-default-features
    CHPM=$(cargo metadata --no-deps --format-version 1 | jq -r .target_directory)/release/chpm
fi
chpm=$(realpath "$CHPM")
names=("$@")
[[ ${#names[@]} -gt 0 ]] || mapfile -t names < <("$chpm" synth --list | sed -n 's/^odd:\([a-z]*\).*/\1/p')

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Runs a step, and leaves in $result its exit code, and if that is not 0 why: "slow" beyond the limit; in $cpu its seconds of all
# processors, in $rss the most resident memory in MiB.
step() {
    local code=0
    /usr/bin/time -f '%U %S %M' -o "$work/time" nice timeout "$limit" "$chpm" "$@" >"$work/out" 2>"$work/errors" || code=$?
    read -r cpu rss < <(tail -n 1 "$work/time" | awk '{ printf "%.2f %.1f\n", $1 + $2, $3 / 1024 }')
    case $code in
        0) result=ok ;;
        124) result=slow ;;
        *) result="exit $code" ;;
    esac
    [[ $code == 0 || $code == 124 ]] || tail -n 1 "$work/errors" "$work/out" | cut -c 1-200 >&2
}

commit=$(git rev-parse --short HEAD)$(git diff --quiet HEAD || echo +)
record=$work/record.csv
echo "date,commit,shape,triangles,memory,build,build_cpu_s,build_ratio,build_rss_mib,copies,bytes_per_tri,clusters,roots,root_triangles,verify,verify_cpu_s,verify_rss_mib,cuts,cuts_cpu_s,cuts_ratio,cuts_rss_mib,measure,measure_cpu_s,measure_ratio,measure_rss_mib" >"$record"
plain=()
ratio() { awk -v a="$1" -v b="${2:-0}" 'BEGIN { if (b > 0) printf "%.2f", a / b }'; }

# One line of the record.
row() {
    local name=$1 line built='{}'
    "$chpm" synth "odd:$name" --triangles "$triangles" --quiet --force -o "$work/shape.ply" >/dev/null
    rm -f "$work/shape.chpm"
    step build --quiet --json --force --no-resume --memory "$memory" -o "$work/shape.chpm" "$work/shape.ply"
    local times=("$cpu")
    line="$result,$cpu,$(ratio "$cpu" "${plain[0]:-}"),$rss"
    if [[ $result == ok ]]; then
        cp "$work/out" "$work/built.json"
        built=$(cat "$work/built.json")
        line+=,$(jq -r '[.repairs.merged_copies, (.bytes_per_triangle * 10 | round / 10), .clusters, .roots,
            .levels[-1].base_triangles] | map(tostring) | join(",")' <<<"$built")
        step verify --quiet --memory "$memory" "$work/shape.chpm"
        line+=",$result,$cpu,$rss"
        step verify --quiet --memory "$memory" --cuts 100 "$work/shape.chpm"
        times+=("$cpu")
        line+=",$result,$cpu,$(ratio "$cpu" "${plain[1]:-}"),$rss"
        step measure --quiet --json --memory "$memory" --positions 1 --samples 1 "$work/shape.chpm" --against "$work/shape.ply"
        times+=("$cpu")
        line+=",$result,$cpu,$(ratio "$cpu" "${plain[2]:-}"),$rss"
    else
        line+=,,,,,,,,,,,,,,,,
    fi
    echo "$(date +%F),$commit,$name,$triangles,$memory,$line" >>"$record"
    [[ ${#plain[@]} -gt 0 ]] || plain=("${times[@]}")
    tail -n 1 "$record"
}

# The plain grid comes first, since the others are measured by it.
row grid
for name in "${names[@]}"; do
    [[ $name == grid ]] || row "$name"
done

# What is beyond the goals.
awk -F, -v limit="$(numfmt --from=iec "$memory")" 'NR > 1 {
    if ($6 != "ok") print $3 ": build " $6
    if ($9 * 1048576 > limit) print $3 ": " $9 " MiB"
    if ($8 > 5) print $3 ": build takes " $8 " times as long as the grid"
    if ($18 != "ok" && $6 == "ok") print $3 ": verify --cuts " $18
    if ($20 > 5) print $3 ": verify --cuts takes " $20 " times as long"
    if ($22 != "ok" && $6 == "ok") print $3 ": measure " $22
    if ($24 > 5) print $3 ": measure takes " $24 " times as long"
}' "$record"

if [[ $# -eq 0 ]]; then
    cp "$record" "benches/records/$(date +%F)-pathological.csv"
    echo "written: benches/records/$(date +%F)-pathological.csv"
fi
