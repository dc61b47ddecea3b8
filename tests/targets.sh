#!/usr/bin/env bash
# The command, without the window, made for other systems and tried here: every test of the command, with their program in place of this
# system's. The bytes of 40 builds are among them (tests/integration/bytes.txt). Ends with a table. Each target is a cold build, and emulation is slow.
#
# Usage: [ONLY=TEST] bash tests/targets.sh [TARGET..]; all three when none is named, all tests without ONLY (`ONLY=integration::bytes` is the bytes of 40 builds).
# Needs `rustup target add TARGET`, and
#   x86_64-unknown-linux-musl     pip install cargo-zigbuild
#   aarch64-unknown-linux-gnu     Debian's g++-aarch64-linux-gnu, qemu-user
#   x86_64-pc-windows-gnu         Debian's mingw-w64, wine64
#   aarch64-apple-darwin, x86_64-apple-darwin: only when named, the first by tests/all.sh; all of the workspace is compiled, viewer included; with LINK=1 the command
#                                 without its window is linked, too.
#                                 pip install cargo-zigbuild
set -euo pipefail
cd "$(dirname "$0")/.."
folder=$(realpath -m "${CARGO_TARGET_DIR:-target}")
[ $# -gt 0 ] || set -- x86_64-unknown-linux-musl aarch64-unknown-linux-gnu x86_64-pc-windows-gnu
features=(--profile quick --no-default-features --features web)
table=()
# zig of the tests' own Python, if it is there: another Python may come first.
[ ! -x target/tools/bin/python-zig ] || export CARGO_ZIGBUILD_PYTHON_PATH="$PWD/target/tools/bin/python3"

# The program for a target in a folder of its own, under the name `chpm`, however it has to be started.
program() { # TARGET FOLDER
    local built="$folder/$1/quick"
    case $1 in
    *-musl)
        cargo zigbuild --quiet "${features[@]}" --target "$1"
        cp "$built/chpm" "$2/chpm"
        ;;
    aarch64-*)
        CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc cargo build --quiet "${features[@]}" --target "$1"
        printf '#!/bin/sh\nexec qemu-aarch64 -L /usr/aarch64-linux-gnu %s "$@"\n' "$built/chpm" > "$2/chpm"
        ;;
    *-windows-gnu)
        # C++ and C libraries of the compiler go into the program, so that it is one file: in a folder of its own the static one is found first.
        mkdir -p "$2/library"
        cp "$(x86_64-w64-mingw32-g++ -print-file-name=libstdc++.a)" "$2/library"
        CARGO_TARGET_X86_64_PC_WINDOWS_GNU_RUSTFLAGS="-C link-arg=-static -L native=$2/library" \
            cargo build --quiet "${features[@]}" --target "$1"
        cp "$built/chpm.exe" "$2"
        # Wine before 9 lacks the one function of this library that Rust's hash maps ask for.
        cat > "$2/random.c" <<'C'
#include <windows.h>
BOOLEAN NTAPI SystemFunction036(PVOID, ULONG);
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE bytes, SIZE_T len) { return SystemFunction036(bytes, (ULONG)len); }
C
        x86_64-w64-mingw32-gcc -shared -o "$2/bcryptprimitives.dll" "$2/random.c" -ladvapi32
        local wine=/usr/lib/wine/wine64
        [ -x $wine ] || wine=wine
        printf '#!/bin/sh\nexport WINEPREFIX=%s WINEDEBUG=-all\nexec %s %s "$@"\n' "$2/wine" $wine "$2/chpm.exe" > "$2/chpm"
        ;;
    esac
    chmod +x "$2/chpm"
}

failed=0
for target in "$@"; do
    if [[ $target == *-apple-darwin ]]; then
        if cargo-zigbuild check --quiet --workspace --locked --target "$target"; then
            line="$target: compiles"
            if [ "${LINK:-}" = 1 ]; then
                cargo-zigbuild build --quiet "${features[@]}" --locked --target "$target"
                line+="; the command without its window links"
            fi
            table+=("$line")
        else
            table+=("$target: does not compile")
            failed=1
        fi
        continue
    fi
    place=$folder/targets/$target
    rm -rf "$place" && mkdir -p "$place"
    program "$target" "$place"
    "$place/chpm" --version

    # Tests that cannot say anything there: a name and the reason on each line.
    without=()
    list=tests/targets/$target.txt
    while IFS=';' read -r name _; do without+=(--skip "$name"); done < <(grep -v '^#' "$list" || true)
    run() { CHPM_PROGRAM="$place/chpm" cargo test "${features[@]}" --test integration --no-fail-fast -- "$@" | tee "$place/log"; }
    passed() { sed -n 's/^test result.* \([0-9]*\) passed.*/\1/p' "$place/log"; }
    again=0
    run ${ONLY:-} "${without[@]}" || again=1
    line="$target: $(passed) passed"
    mapfile -t names < <(sed -n 's/^test \(.*\) \.\.\. FAILED$/\1/p' "$place/log")
    # Wine now and then kills a process whose threads are about to end.
    case $target in
    *windows*)
        if [ ${#names[@]} -gt 0 ]; then
            again=0
            run --exact "${names[@]}" || again=1
            line+=", and $(passed) of ${#names[@]} others the second time"
        fi
        ;;
    esac
    [ $again = 0 ] || failed=1
    table+=("$line; left out: $(grep -vc '^#' "$list" || true), in $list")
done
printf '%s\n' "${table[@]}"
exit $failed
