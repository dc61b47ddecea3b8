#!/usr/bin/env bash
# Kills builds of a mesh at N random moments (kill -9), runs each again and compares the bytes with those of a build that was left alone.
# Usage: benches/kill.sh MODEL N [CHECKPOINT_SECONDS [SEED]] > FILE.csv, as in benches/kill.sh model.ply 50 0.2
# CHPM names the command to use, MEMORY its budget. Ends with an error if a result differs.
set -euo pipefail
export LC_ALL=C

model=${1:?usage: benches/kill.sh MODEL N [CHECKPOINT_SECONDS [SEED]]}
count=${2:?usage: benches/kill.sh MODEL N [CHECKPOINT_SECONDS [SEED]]}
checkpoint=${3:-0.2}
seed=${4:-1}
memory=${MEMORY:-128M}
model=$(realpath "$model")
if [[ -z ${CHPM:-} ]]; then
    cd "$(dirname "$0")/.."
    cargo build --release --quiet
    CHPM=$(cargo metadata --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')/release/chpm
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

now() { date +%s.%N; }
since() { awk -v a="$1" -v b="$(now)" 'BEGIN { printf "%.2f", b - a }'; }
build() { "$CHPM" build "$model" -o "$work/out.chpm" --force --json --memory "$memory" "$@"; }

build --quiet --no-resume >/dev/null
mv "$work/out.chpm" "$work/whole.chpm"
start=$(now)
build --quiet --checkpoint "$checkpoint" >/dev/null
seconds=$(since "$start")
cmp "$work/out.chpm" "$work/whole.chpm"

echo "seed,kill,after_s,in_stage,resumed_after,resumed_s,same_bytes"
failed=0
mapfile -t moments < <(awk -v n=$((8 * count)) -v seed="$seed" -v s="$seconds" \
    'BEGIN { srand(seed); for (i = 0; i < n; i++) printf "%.3f\n", 1.1 * rand() * s }')
kills=0
for moment in "${moments[@]}"; do
    ((kills < count)) || break
    rm -f "$work/out.chpm"
    # Not through the function, whose process would be another one.
    "$CHPM" build "$model" -o "$work/out.chpm" --force --memory "$memory" --checkpoint "$checkpoint" \
        >/dev/null 2>"$work/log" &
    process=$!
    sleep "$moment"
    kill -9 "$process" 2>/dev/null || true
    # Faster than the kill: another moment.
    if wait "$process" 2>/dev/null; then continue; fi
    kills=$((kills + 1))
    stage=$(sed -n 's/^\([a-z]*\) \.\.\.$/\1/p' "$work/log" | tail -n 1)
    start=$(now)
    build --quiet --checkpoint "$checkpoint" >"$work/report.json"
    taken=$(since "$start")
    after=$(sed -n 's/^  "resumed_after": "\(.*\)",$/\1/p' "$work/report.json")
    same=yes
    if ! cmp -s "$work/out.chpm" "$work/whole.chpm"; then
        same=no
        failed=$((failed + 1))
    fi
    echo "$seed,$kills,$moment,${stage:-start},${after:-nothing},$taken,$same"
done
echo "$((kills - failed)) of $kills killed builds went on to the same bytes; alone it takes $seconds s" >&2
((failed == 0 && kills == count))
