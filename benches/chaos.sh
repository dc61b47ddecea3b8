#!/usr/bin/env bash
# What happens to files on a bad day: killed writers, full disks, flipped bits, files that vanish or are replaced while they are read, and a
# crowd of connections. After each attack: no panic, an exit code that was promised, nothing half-written, nothing lost.
# Usage: benches/chaos.sh [ROUNDS [SEED]] > benches/records/DATE-chaos.txt
# CHPM names the command; if not given, a release build. Traffic stays on 127.0.0.1 and is bounded. Ends with an error if an attack succeeded.
set -uo pipefail
export LC_ALL=C

rounds=${1:-10}
seed=${2:-1}
if [[ -z ${CHPM:-} ]]; then
    cd "$(dirname "$0")/.." || exit 2
    cargo build --release --quiet || exit 2
    CHPM=$(cargo metadata --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')/release/chpm
fi
CHPM=$(realpath "$CHPM")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 2
RANDOM=$seed
bad=0
declare -A tried failed

# attack KIND CASE: counts a case; what follows it may call `broken`.
attack() {
    kind=$1 case="$2"
    tried[$kind]=$((${tried[$kind]:-0} + 1))
}
broken() {
    bad=$((bad + 1))
    failed[$kind]=$((${failed[$kind]:-0} + 1))
    echo "BROKEN $kind, $case: $1"
    sed 's/^/    /' log 2>/dev/null | head -5
}
# A process that panicked, was killed by a signal of its own, or left with a code that nobody promised.
judge() {
    local code=$1
    shift
    grep -q "panicked at" log && broken "panic"
    case " $* " in *" $code "*) ;; *) broken "exit code $code, not one of: $*" ;; esac
}
random() { echo $(((RANDOM << 15 | RANDOM) % $1)); }

"$CHPM" synth isosurface --triangles 60000 -q -o scan.ply >/dev/null || exit 2
"$CHPM" synth terrain --triangles 20000 -q -o other.ply >/dev/null || exit 2
"$CHPM" build scan.ply -q -o raw.chpm --pages raw --cluster-triangles 1024 >/dev/null || exit 2
"$CHPM" build scan.ply -q -o packed.chpm --pages packed --cluster-triangles 1024 >/dev/null || exit 2
"$CHPM" build other.ply -q -o other.chpm >/dev/null || exit 2
echo "# $("$CHPM" --version), seed $seed, $rounds rounds"

# Verbs that write: arguments, output, and where the output goes by itself.
writers=(
    "build scan.ply -q -o out|out"
    "build scan.ply -q --no-resume -o out|out"
    "relayout raw.chpm -q --pages packed -o out.chpm|out.chpm"
    "simplify scan.ply -q --triangles 5000 -o out.ply|out.ply"
    "extract packed.chpm -q --level 0 -o out.ply|out.ply"
    "extract raw.chpm -q --level 0 -o out.glb|out.glb"
    "export raw.chpm -q --3dtiles out|out"
    "share raw.chpm -q -o out|out"
    "report raw.chpm -q -o out.html|out.html"
    "compare raw.chpm other.chpm -q -o out.ply|out.ply"
)
# Verbs that read one file.
readers=(
    "info F" "info F --cache" "dump F" "stats F" "verify F -q" "extract F -q --level 0 -o out.ply" "extract F -q --error 1% -o out.stl"
    "relayout F -q --pages packed -o out.chpm" "export F -q --3dtiles out" "share F -q -o out" "report F -q -o out.html" "measure F --against scan.ply -q --samples 1 --positions 1"
    "distance F other.chpm" "clearance F other.chpm --above 1e-3" "contacts F other.chpm" "compare F other.chpm -q -o out.ply"
    "render F -q -o out.png --viewport 64x64"
)
clean() { rm -rf out out.* log; }
# A digest of all that a verb wrote.
digest() { find . -mindepth 1 \( -path './out' -o -path './out.*' -o -path './out/*' \) -type f | sort | xargs -r -d '\n' cat | md5sum; }
# Anything beside what was there, hidden or not.
leftovers() {
    find . -mindepth 1 -maxdepth 1 ! -name scan.ply ! -name other.ply ! -name '*.chpm' ! -name log | sort | tr '\n' ' '
}

# 1. kill -9 at random moments; then the same command must give what an undisturbed one gives, and leave nothing beside it.
declare -A expected
for writer in "${writers[@]}"; do
    IFS='|' read -r words output <<<"$writer"
    clean
    attack kill "undisturbed: $words"
    # shellcheck disable=SC2086
    "$CHPM" $words >log 2>&1
    judge $? 0
    expected[$words]=$(digest)
done
for round in $(seq "$rounds"); do
    for writer in "${writers[@]}"; do
        IFS='|' read -r words output <<<"$writer"
        clean
        attack kill "round $round: $words"
        # shellcheck disable=SC2086
        "$CHPM" $words >log 2>&1 &
        process=$!
        sleep "0.$(printf %03d "$(random 400)")"
        kill -9 $process 2>/dev/null
        wait $process 2>/dev/null
        # shellcheck disable=SC2086
        "$CHPM" $words --force >log 2>&1 || "$CHPM" $words >log 2>&1
        judge $? 0
        left=$(find . -mindepth 1 -maxdepth 1 ! -name scan.ply ! -name other.ply ! -name raw.chpm ! -name packed.chpm ! -name other.chpm \
            ! -name log ! -name "$output" | tr '\n' ' ')
        [ -z "$left" ] || broken "left behind: $left"
        [ "$(digest)" = "${expected[$words]}" ] || broken "other bytes than undisturbed"
        find "$output" -name '.*' -mindepth 1 2>/dev/null | grep -q . && broken "hidden files in $output"
        rm -rf "$output"
    done
done
clean

# 2. A disk that is full, by a limit on the length of files and by /dev/full.
for words_output in "${writers[@]}"; do
    IFS='|' read -r words output <<<"$words_output"
    for blocks in 0 8 64 200; do
        clean
        attack "full disk" "$blocks KiB: $words"
        # shellcheck disable=SC2086
        (ulimit -f "$blocks"; "$CHPM" $words) >log 2>&1
        code=$?
        judge $code 0 2 
        [ $code -eq 0 ] || [ ! -e "$output" ] || broken "$output is there"
        left=$(leftovers)
        [ $code -eq 0 ] || case "$left" in *[!.\ ]*) [ -z "$(find . -maxdepth 1 -name "$output*" ! -name log)" ] || broken "left: $left" ;; esac
    done
done
for words in "info raw.chpm" "dump raw.chpm" "stats raw.chpm" "extract raw.chpm -q --level 0 -o -" "--help" "man"; do
    attack "full disk" "stdout: $words"
    # shellcheck disable=SC2086
    "$CHPM" $words >/dev/full 2>log
    judge $? 2
done
clean

# 3. A flipped bit anywhere in a file: every verb refuses it, or, where it was in padding, gives what the whole file gives.
bytes() { stat -c %s "$1"; }
for name in raw packed; do
    for reader in "${readers[@]}"; do
        clean
        words=${reader//F/$name.chpm}
        # shellcheck disable=SC2086
        "$CHPM" $words >said 2>log
        whole=$? said=$(cat said; digest)
        attack "flipped bit" "whole file: $words"
        judge $whole 0 1
        for round in $(seq "$rounds"); do
            rm -rf out out.*
            cp $name.chpm bad.chpm
            at=$(random "$(bytes bad.chpm)") bit=$(random 8)
            old=$(od -An -tu1 -j "$at" -N 1 bad.chpm)
            printf "$(printf '\\%03o' $((old ^ (1 << bit))))" | dd of=bad.chpm bs=1 seek="$at" conv=notrunc status=none
            words=${reader//F/bad.chpm}
            attack "flipped bit" "byte $at bit $bit of $name: $words"
            # shellcheck disable=SC2086
            "$CHPM" $words >said 2>log
            code=$?
            judge $code "$whole" 1 2
            if [ $code -eq 2 ]; then
                grep -q "bad.chpm" log || broken "the error does not name the file"
                [ -z "$(find . -maxdepth 1 -name 'out*')" ] || broken "an output is there"
            elif [ $code -eq "$whole" ]; then
                # Only the file's name and its own numbers may differ; what was written must not.
                case $reader in
                *-o*) [ "$(digest)" = "${said##*$'\n'}" ] || case $reader in report*|share*|relayout*) ;; *) broken "used without a word" ;; esac ;;
                esac
            fi
        done
    done
done
rm -f said bad.chpm
clean

# 4. Files that are cut, vanish or are replaced while they are read.
for round in $(seq "$rounds"); do
    for reader in "${readers[@]}"; do
        for how in cut vanish replace; do
            clean
            cp raw.chpm moving.chpm
            words=${reader//F/moving.chpm}
            attack "$how while reading" "round $round: $words"
            # shellcheck disable=SC2086
            "$CHPM" $words >said 2>log &
            process=$!
            sleep "0.0$(printf %02d "$(random 60)")"
            case $how in
            cut) truncate -s "$(random 1000000)" moving.chpm ;;
            vanish) rm moving.chpm ;;
            replace) cp other.chpm next && mv next moving.chpm ;;
            esac
            wait $process
            judge $? 0 1 2
            rm -f moving.chpm next said
        done
    done
done
clean

# 5. Two hundred connections to a server that may open 64 descriptors; then it answers as before.
attack connections "200 with 64 descriptors"
(ulimit -n 64; exec "$CHPM" serve raw.chpm --port 0) >served 2>log &
server=$!
for _ in $(seq 100); do grep -q '^http' served 2>/dev/null && break; sleep 0.1; done
url=$(head -1 served)
port=$(sed 's|http://127.0.0.1:\([0-9]*\)/.*|\1|' <<<"$url")
python3 - "$port" <<'P' || broken "the server does not answer after the crowd"
import socket, sys, time, urllib.request
port = int(sys.argv[1])
crowd = []
for n in range(200):
    try:
        s = socket.create_connection(("127.0.0.1", port), timeout=2)
        if n % 3 == 0: s.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n")  # a head that never ends
        if n % 3 == 1: s.sendall(b"GET /raw.chpm HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % port)  # an answer that nobody reads
        crowd.append(s)
    except OSError:
        pass
for s in crowd: s.close()
last = None
for _ in range(50):
    try:
        got = urllib.request.urlopen("http://127.0.0.1:%d/raw.chpm" % port, timeout=5).read(4)
        sys.exit(0 if got == b"CHPM" or len(got) == 4 else 1)
    except OSError as error:
        last = error
        time.sleep(0.2)
sys.exit(str(last))
P
kill -0 $server 2>/dev/null || broken "the server died"
kill -INT $server 2>/dev/null
wait $server 2>/dev/null
grep -q "panicked at" log && broken "panic"

echo "attack,cases,broken"
for kind in "${!tried[@]}"; do echo "$kind,${tried[$kind]},${failed[$kind]:-0}"; done | sort
((bad == 0))
