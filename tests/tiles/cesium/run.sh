#!/usr/bin/env bash
# Tilesets of three models on the earth and elsewhere, shown by CesiumJS: tiles that are drawn, cracks, and what the console says; and what its options
# that load fewer tiles do. bash tests/tiles/cesium/run.sh; CHPM names another command. The package is 100 MB.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
chpm=${CHPM:-$here/../../../target/release/chpm}
[ -d "$here/node_modules" ] || (cd "$here" && npm ci --no-audit --no-fund)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

place=(--origin 13.4,52.5,34)
turned=(--transform 0,1,0,0,-1,0,0,0,0,0,1,0,4000000,-2000000,3000000,1)
sets=()
for kind in isosurface terrain torus; do
    "$chpm" synth "$kind" --triangles 30000 -q -o "$work/$kind.ply"
    "$chpm" build "$work/$kind.ply" -q --cluster-triangles 512 -o "$work/$kind.chpm" > "$work/log"
    "$chpm" export "$work/$kind.chpm" -q "${place[@]}" --3dtiles "$work/$kind-earth" > "$work/log"
    sets+=("$kind-earth=$work/$kind-earth=$work/$kind-earth")
done
plain="$work/isosurface-earth"
"$chpm" export "$work/isosurface.chpm" -q "${turned[@]}" --3dtiles "$work/turned" > "$work/log"
"$chpm" export "$work/isosurface.chpm" -q "${place[@]}" --3dtiles "$work/packed" --meshopt --up y --span 3 > "$work/log"
sets+=("turned=$work/turned=$plain" "packed=$work/packed=$plain")
# As it is by itself, and with the option that lets coarse and fine tiles lie side by side.
sets+=("by-itself=$plain=$plain={}" "skipping=$plain=$plain={\"skipLevelOfDetail\":true}")
node "$here/check.mjs" "${sets[@]}"
