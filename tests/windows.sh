#!/usr/bin/env bash
# Makes chpm.exe, without the window, and tries it in Wine: the same bytes as here, verbs, refusals, a kill. Takes the two targets' cold builds.
#
# Needs: rustup target add x86_64-pc-windows-gnu; Debian's mingw-w64 and wine64. Usage: bash tests/windows.sh [FOLDER FOR RESULTS]
set -euo pipefail
cd "$(dirname "$0")/.."
target=x86_64-pc-windows-gnu
folder=$(realpath -m "${1:-target/windows}")
built=${CARGO_TARGET_DIR:-target}
rm -rf "$folder" && mkdir -p "$folder/here"

cargo build --quiet --profile quick --no-default-features
# C++ and C libraries of the compiler go into the program, so that it is one file.
CARGO_TARGET_X86_64_PC_WINDOWS_GNU_RUSTFLAGS="-C link-arg=-static" \
    cargo build --quiet --profile quick --no-default-features --target $target
here=$(realpath "$built/quick/chpm")
cp "$built/$target/quick/chpm.exe" "$folder"
cd "$folder"

export WINEPREFIX=$folder/wine WINEDEBUG=-all
# Wine before 9 lacks the one function of this library that Rust's hash maps ask for.
cat > random.c <<'C'
#include <windows.h>
BOOLEAN NTAPI SystemFunction036(PVOID, ULONG);
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE bytes, SIZE_T len) { return SystemFunction036(bytes, (ULONG)len); }
C
x86_64-w64-mingw32-gcc -shared -o bcryptprimitives.dll random.c -ladvapi32
windows() { wine ./chpm.exe "$@" 2> >(grep -v wine32 >&2); }

failed=0
expect() { # NAME COMMAND.. : the command succeeds
    if "${@:2}" > out.txt 2>&1; then echo "ok      $1"; else
        echo "FAILED  $1"
        cat out.txt
        failed=1
    fi
}
refuse() { # NAME CODE WORDS COMMAND.. : the command ends with the code and says the words
    local code=0
    "${@:4}" > out.txt 2>&1 || code=$?
    if [ $code = "$2" ] && grep -q "$3" out.txt; then echo "ok      $1"; else
        echo "FAILED  $1: code $code"
        cat out.txt
        failed=1
    fi
}

while IFS=';' read -r name source settings; do
    "$here" synth $source -o "$name.ply" -q > /dev/null
    "$here" build "$name.ply" -o "here/$name.chpm" -q $settings > /dev/null
    windows build "$name.ply" -q $settings > /dev/null
    expect "bytes of $name ($source; $settings)" cmp "here/$name.chpm" "$name.chpm"
done <<'END'
torus;torus --triangles 60k;
soup;odd:random --triangles 20k;
surface;isosurface --triangles 100k;--threads 2 --memory 128M
plates;plates --triangles 60k;--pages packed
terrain;terrain --triangles 60k;--normals computed
locked;sphere --triangles 30k;--boundary lock
oblivious;torus --triangles 30k;--order cache-oblivious
lattice;sphere --triangles 30k;--positions lattice:16
cut;torus --triangles 30k;--finest-error 0.01
large;isosurface --triangles 600k;--memory 128M
END
expect "verify" windows verify surface.chpm --against surface.ply --cuts 20
expect "verify --errors" windows verify torus.chpm --against torus.ply --errors
expect "info" windows info surface.chpm
expect "stats" windows stats torus.chpm
expect "measure" windows measure torus.chpm --against torus.ply
expect "extract" windows extract surface.chpm --triangles 5000 -o small.glb
expect "extract to standard output" bash -c "wine ./chpm.exe extract surface.chpm --triangles 5000 -o - > small.ply 2> /dev/null && [ -s small.ply ]"
expect "build what was extracted" windows build small.glb -q
expect "simplify" windows simplify surface.ply --within 1% -o within.stl -q
expect "relayout" windows relayout torus.chpm -o again.chpm --order cache-oblivious
expect "export" windows export surface.chpm --3dtiles tiles -q
expect "nothing but tiles" bash -c '[ "$(ls tiles | sort | tr "\n" " ")" = "tileset.json tiles " ]'
expect "export in place of another" windows export torus.chpm --3dtiles tiles -q --force
expect "batch" windows batch torus.ply plates.ply -o many -q
expect "report" windows report torus.chpm -o torus.html -q
expect "compare" windows compare surface.ply within.stl -q
refuse "what is there is not replaced" 2 "exists already" windows build torus.ply -q
refuse "no such file" 2 "cannot" windows build none.ply -q
refuse "damage" 1 "I10" bash -c "head -c 200000 torus.chpm > damaged.chpm; wine ./chpm.exe verify damaged.chpm 2> /dev/null"

# A build that is killed leaves no file of the name, and the next one goes on or begins anew, with the same bytes.
"$here" synth isosurface --triangles 3M -o killed.ply -q > /dev/null
"$here" build killed.ply -o here/killed.chpm -q > /dev/null
windows build killed.ply -q > /dev/null & sleep 4
wineserver -k || pkill -f chpm.exe || true
wait || true
expect "no half of a file" bash -c "[ ! -e killed.chpm ]"
windows build killed.ply -q > /dev/null
expect "the same bytes after a kill" cmp here/killed.chpm killed.chpm
expect "nothing is left" bash -c '! ls -A | grep -E "\.(work|partial|lock)$"'
exit $failed
