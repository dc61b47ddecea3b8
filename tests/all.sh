#!/usr/bin/env bash
# Everything that has to pass: format, lints, documentation, tests. Installs what is missing, where it may, and lists at the end what was skipped
# and how long each part took, by the clock and of all processors together. With CI=true nothing may be skipped.
set -euo pipefail
cd "$(dirname "$0")/.."

mkdir -p target
# What is compiled once needs no notes for the next time, and lines of backtraces cost the compiler time.
[ "${CI:-}" != true ] || export CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=none
CHPM_SKIPPED=$(mktemp "$PWD/target/skipped.XXXXXX")
export CHPM_SKIPPED
work=$(mktemp -d)
trap 'rm -rf "$CHPM_SKIPPED" "$work"' EXIT
# Processor seconds of all that has ended, as `times` has them: of this shell, then of its children.
spent() { awk '{ for (i = 1; i <= 2; i++) { split($i, t, /[ms]/); sum += 60 * t[1] + t[2] } } END { printf "%d", sum }' "$work/times"; }
took=()
part() {
    local name="$1" start=$SECONDS before
    shift
    echo "== $name" >&2
    times >"$work/times" && before=$(spent)
    "$@"
    times >"$work/times" && took+=("$((SECONDS - start)) s, processors $(($(spent) - before)) s: $name")
}

part "tools" bash tests/tools.sh
[ ! -f "${CARGO_HOME:-$HOME/.cargo}/env" ] || . "${CARGO_HOME:-$HOME/.cargo}/env"
export PATH="$PATH:$PWD/target/tools/bin"
# Some tests wait for a browser, a server or a signal: with half as many more at once, no processor does.
export RUST_TEST_THREADS="${RUST_TEST_THREADS:-$((($(getconf _NPROCESSORS_ONLN) * 3 + 1) / 2))}"
# Mesa looks for a folder of the session; any will do.
export XDG_RUNTIME_DIR="${XDG_RUNTIME_DIR:-/tmp}"

has_macos() { command -v cargo-zigbuild >/dev/null && rustup target list --installed 2>/dev/null | grep '^aarch64-apple-darwin$' >/dev/null; }

# What draws; left out where there is no driver for it.
draws=(integration::render:: integration::window:: integration::couple:: integration::shadows:: sheets_are_drawn a_picture_says_what_it_lacks every_key_is_documented_and_appears
    every_example_of_the_help_runs every_command_of_the_pages_runs)
without=()
packages=(--workspace)
if grep -q '^pictures by Vulkan' "$CHPM_SKIPPED"; then
    packages+=(--exclude chpm-viewer)
    for name in "${draws[@]}"; do without+=(--skip "$name"); done
fi

part "format" cargo fmt --all --check
part "lints" cargo clippy --workspace --all-targets --locked -- -D warnings
part "lints without the viewer" cargo clippy -p chpm --no-default-features --all-targets --locked -- -D warnings
part "documentation" env RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked
# As far as a compiler goes without Apple's libraries.
if has_macos; then part "macOS" bash tests/targets.sh aarch64-apple-darwin; fi
# Of the examples those that tests run; the lints have looked at all.
examples=(--example simplify_patch --example build_and_select --example smallest_file --example draw_a_view)
compile() { cargo test "${packages[@]}" --tests --locked --no-run && cargo build "${packages[@]}" "${examples[@]}" --locked; }
part "compile" compile

part "tests" cargo test "${packages[@]}" --lib --bins --tests --locked --no-fail-fast -- ${without[@]+"${without[@]}"}
part "tests in the documentation" cargo test "${packages[@]}" --doc --locked
# The Python package, where there is Python; a workspace of its own.
part "Python" bash python/test.sh
# The same pictures where there is nothing but OpenGL.
grep -q '^pictures by' "$CHPM_SKIPPED" ||
    part "pictures by OpenGL" env WGPU_BACKEND=gl cargo test --workspace --locked --test pictures

printf '%s\n' "${took[@]}" >&2
if [ -s "$CHPM_SKIPPED" ]; then
    echo "Skipped:" >&2
    sort -u "$CHPM_SKIPPED" | sed 's/^/  /' >&2
    [ "${CI:-}" != true ] || { echo "in CI nothing may be skipped" >&2; exit 1; }
fi
