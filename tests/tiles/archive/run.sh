#!/usr/bin/env bash
# Archives of tilesets, taken apart by 3d-tiles-tools, which finds files by the index: the same bytes as of the folder. By hand, since it takes 224 MB of packages.
# bash tests/tiles/archive/run.sh [MODEL.ply ...]: of these instead of generated ones. CHPM names another command.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
chpm=${CHPM:-$here/../../../target/release/chpm}
[ -d "$here/node_modules/3d-tiles-tools" ] ||
    npm install --prefix "$here" --no-save --no-audit --no-fund --ignore-scripts 3d-tiles-tools@0.5.4
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if [ $# -eq 0 ]; then
    "$chpm" synth isosurface --triangles 60000 -q -o "$work/closed.ply"
    "$chpm" synth terrain --triangles 40000 -q -o "$work/open.ply"
    set -- "$work/closed.ply" "$work/open.ply"
fi
for model in "$@"; do
    name=$(basename "${model%.*}")
    "$chpm" build "$model" -q --cluster-triangles 512 -o "$work/$name.chpm" >"$work/log"
    for more in "" "--meshopt --up y --span 3"; do
        rm -rf "${work:?}/made" "$work/taken"
        # Options are words.
        # shellcheck disable=SC2086
        "$chpm" export "$work/$name.chpm" -qf --3dtiles "$work/made" $more >"$work/log"
        # shellcheck disable=SC2086
        "$chpm" export "$work/$name.chpm" -qf --3dtiles "$work/made.3tz" $more >"$work/log"
        (cd "$here" && npx 3d-tiles-tools convert -i "$work/made.3tz" -o "$work/taken" -f) >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
        diff -r "$work/made" "$work/taken"
        echo "$name $more: $(find "$work/taken" -type f | wc -l) files, the same bytes"
    done
done
