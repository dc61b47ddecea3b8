#!/usr/bin/env bash
# Tilesets of three models, and of one of them with boxes of its own, in a browser: tiles that are drawn, cracks, and every GLB by gltf-validator.
# Archives (.3tz): archive/run.sh. bash tests/tiles/run.sh [MODEL.ply ...]: of these instead of generated ones. CHPM names another command.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
chpm=${CHPM:-$here/../../target/release/chpm}
[ -d "$here/node_modules" ] || (cd "$here" && npm ci --no-audit --no-fund --legacy-peer-deps)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if [ $# -eq 0 ]; then
    "$chpm" synth isosurface --triangles 60000 -q -o "$work/closed.ply"
    "$chpm" synth terrain --triangles 40000 -q -o "$work/open.ply"
    "$chpm" synth torus --triangles 40000 -q -o "$work/torus.ply"
    set -- "$work/closed.ply" "$work/open.ply" "$work/torus.ply"
fi
sets=()
for model in "$@"; do
    name=$(basename "${model%.*}")
    "$chpm" build "$model" -q --cluster-triangles 512 -o "$work/$name.chpm" > "$work/log"
    "$chpm" export "$work/$name.chpm" -q --3dtiles "$work/$name"
    "$chpm" export "$work/$name.chpm" -q --3dtiles "$work/$name-packed" --meshopt --up y --span 3
    sets+=("$name=$work/$name" "$name-packed=$work/$name-packed")
done
# A check that finds nothing in what is wrong is none.
name=$(basename "${1%.*}")
sets+=("false=$work/$name:false")
node "$here/check.mjs" "${sets[@]}"
