#!/usr/bin/env bash
# Makes the command, without the window, for another kind of Linux, and compares what it writes with what is written here: every build
# of tests/integration/bytes.txt, byte for byte; then verbs. Takes two cold builds for each target, and minutes of emulation.
#
# Usage: bash tests/targets.sh [aarch64-unknown-linux-gnu] [x86_64-unknown-linux-musl]
# Needs: rustup target add TARGET; for aarch64 Debian's g++-aarch64-linux-gnu and qemu-user, for musl: pip install cargo-zigbuild.
set -euo pipefail
cd "$(dirname "$0")/.."
built=${CARGO_TARGET_DIR:-target}
list=$PWD/tests/integration/bytes.txt
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc

cargo build --quiet --profile quick --no-default-features
here=$(realpath "$built/quick/chpm")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failed=0

check() { # NAME COMMAND.. : the command succeeds
    if "${@:2}" > "$work/said" 2>&1; then ok=$((ok + 1)); else
        echo "FAILED  $target: $1"
        cat "$work/said"
        failed=1
    fi
}

for target in "${@:-aarch64-unknown-linux-gnu}"; do
    case $target in
    aarch64-*)
        cargo build --quiet --profile quick --no-default-features --target "$target"
        there=(qemu-aarch64 -L /usr/aarch64-linux-gnu)
        ;;
    *)
        cargo zigbuild --quiet --profile quick --no-default-features --target "$target"
        there=()
        ;;
    esac
    there+=("$(realpath "$built/$target/quick/chpm")")
    file -b "${there[-1]}" | cut -d, -f1-4
    ok=0

    while IFS=';' read -r _ source settings; do
        rm -f "$work"/*.ply "$work"/*.chpm
        # shellcheck disable=SC2086
        {
            "$here" synth $source -o "$work/in.ply" -q > /dev/null
            check "synth $source" "${there[@]}" synth $source -o "$work/same.ply" -q
            check "source $source" cmp "$work/in.ply" "$work/same.ply"
            "$here" build "$work/in.ply" -o "$work/here.chpm" -q $settings > /dev/null
            check "build $source $settings" "${there[@]}" build "$work/in.ply" -o "$work/there.chpm" -q $settings
            check "bytes of $source;$settings" cmp "$work/here.chpm" "$work/there.chpm"
        }
    done < <(grep -v '^#' "$list")
    check "verify" "${there[@]}" verify "$work/there.chpm" --against "$work/in.ply" --cuts 5
    check "info" "${there[@]}" info "$work/there.chpm"
    check "extract" "${there[@]}" extract "$work/there.chpm" --triangles 2000 -o "$work/small.glb"
    check "build what was extracted" "${there[@]}" build "$work/small.glb" -q
    echo "$target: $ok of $((4 * $(grep -vc '^#' "$list") + 4))"
done
exit $failed
