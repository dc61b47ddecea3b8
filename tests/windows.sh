#!/usr/bin/env bash
# Makes chpm.exe, without the window, and tries it in Wine: the same bytes as here, verbs, refusals, a kill. Takes the two targets' cold builds.
#
# Needs: rustup target add x86_64-pc-windows-gnu; Debian's mingw-w64 and wine64. Usage: bash tests/windows.sh [FOLDER FOR RESULTS]
set -euo pipefail
cd "$(dirname "$0")/.."
target=x86_64-pc-windows-gnu
folder=$(realpath -m "${1:-target/windows}")
built=${CARGO_TARGET_DIR:-target}
list=$PWD/tests/integration/bytes.txt
rm -rf "$folder" && mkdir -p "$folder/here"

cargo build --quiet --profile quick --no-default-features
# C++ and C libraries of the compiler go into the program, so that it is one file: in a folder of its own the static one is found first.
mkdir "$folder/library"
cp "$(x86_64-w64-mingw32-g++ -print-file-name=libstdc++.a)" "$folder/library"
CARGO_TARGET_X86_64_PC_WINDOWS_GNU_RUSTFLAGS="-C link-arg=-static -L native=$folder/library" \
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

failed=0 number=0
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

while IFS=';' read -r _ source settings; do
    number=$((number + 1))
    "$here" synth $source -o "$number.ply" -q > /dev/null
    expect "synth $source" windows synth $source -o same.ply -qf
    expect "the same source" cmp "$number.ply" same.ply
    "$here" build "$number.ply" -o "here/$number.chpm" -q $settings > /dev/null
    expect "build $settings" windows build "$number.ply" -q $settings
    expect "the same bytes" cmp "here/$number.chpm" "$number.chpm"
    rm -f "$number.ply" same.ply "$number.chpm"
done < <(grep -v '^#' "$list")
for shape in "torus --triangles 60k" "surface --triangles 100k" "plates --triangles 60k"; do
    set -- $shape
    "$here" synth "${1/surface/isosurface}" "$2" "$3" -o "$1.ply" -q > /dev/null
    expect "build $shape" windows build "$1.ply" -q
done
expect "verify" windows verify surface.chpm --against surface.ply --cuts 20
expect "verify --errors" windows verify torus.chpm --against torus.ply --errors
expect "info" windows info surface.chpm
expect "stats" windows stats torus.chpm
expect "measure" windows measure torus.chpm --against torus.ply
expect "extract" windows extract surface.chpm --triangles 5000 -o small.glb
expect "extract to standard output" bash -c "wine ./chpm.exe extract surface.chpm --triangles 5000 -o - > small.ply 2> /dev/null && [ -s small.ply ]"
expect "build what was extracted" windows build small.glb -q
expect "simplify" windows simplify surface.ply --within 1% -o within.stl -q
expect "relayout" windows relayout torus.chpm -o again.chpm --order levels
expect "export" windows export surface.chpm --3dtiles tiles -q
expect "nothing but tiles" bash -c '[ "$(ls tiles | LC_ALL=C sort | tr "\n" " ")" = "tiles tileset.json " ]'
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
