#!/usr/bin/env bash
# Terrains in UTM coordinates, exported with --crs and shown by CesiumJS: how far they are from where PROJ has their vertices. bash tests/tiles/cesium/place.sh;
# CHPM names another command, PYTHON one that has pyproj and numpy.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
chpm=${CHPM:-$here/../../../target/release/chpm}
[ -d "$here/node_modules" ] || (cd "$here" && npm ci --no-audit --no-fund)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"${PYTHON:-python3}" "$here/place.py" "$work"
names=()
for list in "$work"/*.json; do
    name=$(basename "$list" .json)
    code=$(sed 's/.*"code": \([0-9]*\).*/\1/' "$list")
    "$chpm" build "$work/$name.ply" -q -o "$work/$name.chpm" > "$work/log"
    "$chpm" export "$work/$name.chpm" -q --crs "EPSG:$code" --3dtiles "$work/$name" > "$work/log"
    names+=("$name")
done
node "$here/place.mjs" "$work" "${names[@]}"
