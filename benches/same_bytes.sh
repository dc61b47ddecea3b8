#!/usr/bin/env bash
# Compares two programs: do they write the same bytes? For a change that is to alter none. Prints what differs, and exits with 1 if anything does.
# Usage: benches/same_bytes.sh BEFORE AFTER [--all]
# Sources are every shape of `chpm synth` at TRIANGLES (3000) triangles, meshes with normals, colours and doubles, and the files of the
# folder that CHPM_DATA names, or ../shared/data beside the repository: those below 400 kB, all of them with --all. Each is built with several
# settings; .chpm, report, info, extracted meshes, exit codes and messages must agree. So must --help of every verb, and how wrong calls end.
set -euo pipefail
export LC_ALL=C

usage="usage: benches/same_bytes.sh BEFORE AFTER [--all]"
before=$(realpath "${1:?$usage}") after=$(realpath "${2:?$usage}")
largest=$([[ ${3:-} == --all ]] && echo 1T || echo 400K)
triangles=${TRIANGLES:-3000}
cd "$(dirname "$0")/.."
data=${CHPM_DATA:-../shared/data}
data=$(realpath "$data" 2>/dev/null || true)

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work"/{in,before,after,program/{before,after}}
# Both have the same name, which messages and help repeat.
cp "$before" "$work/program/before/chpm"
cp "$after" "$work/program/after/chpm"
different=0 compared=0

# Runs the program of $side in its folder; what it says and how it ends go to NAME.said. Times and memory are left out of JSON.
call() {
    local name=$1 code=0
    shift
    "$work/program/$side/chpm" "$@" >"$name.out" 2>"$name.errors" </dev/null || code=$?
    jq '(.. | objects) |= with_entries(if .key | test("seconds|resident|budget") then .value = null else . end)' \
        "$name.out" >"$name.json" 2>/dev/null || mv "$name.out" "$name.json"
    { echo "exit $code"; cat "$name.json" "$name.errors"; } >"$name.said"
    rm -f "$name.out" "$name.json" "$name.errors"
}

# Says in what the folders of both differ, and empties them.
compare() {
    local found
    compared=$((compared + $(find "$work/before" -type f | wc -l)))
    if ! found=$(diff -rq "$work/before" "$work/after"); then
        different=1
        sed "s|$work/||g; s|^|$1: |" <<<"$found"
    fi
    rm -rf "$work"/{before,after}
    mkdir "$work"/{before,after}
}

# Both programs, each in its folder, do what comes next.
both() {
    for side in before after; do
        (cd "$work/$side" && "$@")
    done
}

# Regions are of 64 leaves: small leaves make many regions and levels of a small mesh.
settings=(
    "--threads 2"
    "--threads 1 --memory 16K --any-memory --no-resume --order cache-oblivious --boundary lock"
    "--threads 2 --memory 1M --any-memory --cluster-triangles 32 --partitioner greedy --drop-invalid"
    "--threads 2 --cluster-triangles 256 --topology keep --order simplification --min-component 1% --finest-error 0.01% --no-normals"
    "--threads 2 --cluster-triangles 16 --normals computed --pages packed"
)

build() {
    local number=0
    for options in "${settings[@]}"; do
        number=$((number + 1))
        # shellcheck disable=SC2086
        call "build$number" build "$1" -o "$number.chpm" --json -q $options
        [[ -e $number.chpm ]] || continue
        call "info$number" info "$number.chpm" --json --cache
        call "near$number" extract "$number.chpm" --error 0.1% -o "near$number.ply" -q
        call "level$number" extract "$number.chpm" --level 1 -o "level$number.ply" --ascii -q
    done
}

generate() {
    call synth synth "$1" --triangles "$triangles" -o mesh.ply -q
}

# An ASCII PLY of positions becomes one with normals, colours, and doubles if $1 says so, of each vertex's number.
dress() {
    awk -v type="$1" '
        /^element vertex/ { vertices = $3 }
        /^property float z/ { print "property " type " z"; for (i = 1; i <= 3; i++) print "property float n" substr("xyz", i, 1)
            print "property uchar red"; print "property uchar green"; print "property uchar blue"; next }
        /^property float/ { sub("float", type) }
        body && seen++ < vertices { $0 = sprintf("%.9f %s %s %f %f %f %d %d %d", $1 + (type == "double" ? 1e6 : 0), $2, $3,
            cos(seen), sin(seen), seen % 7, seen % 256, seen / 16 % 256, seen / 256 % 256) }
        /^end_header/ { body = 1 }
        { print }'
}

side=before
shapes=(terrain isosurface sphere torus plates)
mapfile -t listed < <("$work/program/before/chpm" synth --list | cut -d ' ' -f 1)
for name in "${shapes[@]}" "${listed[@]}"; do
    both generate "$name"
    [[ ! -e $work/before/mesh.ply ]] || cp "$work/before/mesh.ply" "$work/in/${name/:/-}.ply"
    compare "synth $name"
done
for name in terrain isosurface; do
    "$work/program/before/chpm" synth "$name" --triangles "$triangles" --ascii -o "$work/plain.ply" -qf >/dev/null
    for type in float double; do
        dress "$type" <"$work/plain.ply" >"$work/in/$name-dressed-$type.ply"
    done
done
gzip -k "$work/in/terrain-dressed-float.ply"
head -c 50000 "$work/in/terrain.ply" >"$work/in/cut-short.ply"

while IFS= read -r source; do
    both build "$source"
    compare "$source"
done < <(cd "$work/in" && find "$work/in" "${data:-$work/in}" -type f -size "-$(numfmt --from=iec "$largest")c" \
    -regex '.*\.\(ply\|stl\|obj\|conf\)\(\.gz\|\.zst\)?' | sort -u)

helped() {
    local verb
    call help --help
    for verb in $("$work/program/before/chpm" --help | sed -n 's/^  \([a-z]\{3,\}\) .*/\1/p'); do
        call "help-$verb" "$verb" --help
        call "brief-$verb" "$verb" -h
    done
}

wrong() {
    local mesh=$work/in/terrain.ply
    call none
    call unknown frobnicate
    call missing build missing.ply
    call no-setting build "$mesh" --order upward
    call little build "$mesh" -o little.chpm --memory 1M
    call good build "$mesh" -o good.chpm --json -q
    call twice build "$mesh" -o good.chpm -q
    call nowhere build "$mesh" -o none/good.chpm
    call folder build .
    call not-one info "$mesh"
    call goal extract good.chpm -o goal.ply
    call level extract good.chpm --level 99 -o level.ply
    call strict extract good.chpm --triangles 1 --strict -o strict.ply
    head -c 5000 good.chpm >short.chpm
    call short info short.chpm
    { head -c 9000 good.chpm; printf wrong; tail -c +9006 good.chpm; } >damaged.chpm
    call damaged verify damaged.chpm
    call verified verify good.chpm -q --cuts 10
    call dumped dump good.chpm --pages
}

both helped
compare help
both wrong
compare "wrong calls"
echo "$compared files compared"
exit "$different"
