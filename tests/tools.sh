#!/usr/bin/env bash
# Installs what the tests need and this machine lacks, where it may: on Debian and Ubuntu, as root or by sudo. What cannot be installed is named
# with the line that installs it. `bash tests/all.sh` begins with this; alone it only prepares.
# In $CHPM_SKIPPED, a file, it notes what will be skipped for want of a tool.
set -euo pipefail
cd "$(dirname "$0")/.."
list="${CHPM_SKIPPED:-/dev/null}"

lacks() {
    echo "missing: $1; install it by: $2" >&2
    echo "$3: no $1 ($2)" >>"$list"
}

# What a tool is looked for by, its package in Debian, and what is skipped without it.
has_compilers() { command -v cc >/dev/null && command -v c++ >/dev/null; }
# Not `grep -q`, which ends at the first match: now and then that ended `ldconfig` by a signal, and what was there was missing.
has_library() { ldconfig -p | grep -F "$1" >/dev/null; }
has_vulkan() { has_library libvulkan.so.1; }
has_vulkan_driver() { compgen -G '/usr/share/vulkan/icd.d/lvp_icd*.json' >/dev/null; }
has_egl() { has_library libEGL.so.1; }
has_gl_driver() { compgen -G '/usr/lib/*/dri/swrast_dri.so' >/dev/null; }
has_node() { command -v node >/dev/null && node -e 'process.exit(parseInt(process.versions.node) < 20 ? 1 : 0)'; }
has_venv() { python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; }
has() { command -v "$1" >/dev/null; }

wanted=(
    "has_compilers|build-essential|everything"
    "has_vulkan|libvulkan1|pictures by Vulkan"
    "has_vulkan_driver|mesa-vulkan-drivers|pictures by Vulkan"
    "has_egl|libegl1|pictures by OpenGL"
    "has_gl_driver|libgl1-mesa-dri|pictures by OpenGL"
    "has Xvfb|xvfb|windows"
    "has xdotool|xdotool|windows"
    "has chromium|chromium|pages in a browser"
    "has_node|nodejs|the reader in JavaScript and pages in a browser"
    "has npm|npm|pages in a browser"
    "has_venv|python3-venv|the Python package and the workflow"
)

missing=()
for row in "${wanted[@]}"; do
    IFS='|' read -r check package _ <<<"$row"
    $check || missing+=("$package")
done
if [ ${#missing[@]} -gt 0 ] && has apt-get; then
    root=()
    [ "$(id -u)" -eq 0 ] || root=(sudo -n)
    if [ "$(id -u)" -eq 0 ] || sudo -n true 2>/dev/null; then
        echo "installing ${missing[*]}" >&2
        "${root[@]}" apt-get update --quiet --quiet || true
        # One by one: a package that a system does not have keeps no other one away.
        for package in "${missing[@]}"; do
            "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install --quiet --quiet --yes --no-install-recommends "$package" >&2 || true
        done
    fi
fi
for row in "${wanted[@]}"; do
    IFS='|' read -r check package skips <<<"$row"
    $check || lacks "$package" "sudo apt-get install $package" "$skips"
done
has_compilers || exit 1

# Rust comes from rustup: what distributions have is older.
[ -f "${CARGO_HOME:-$HOME/.cargo}/env" ] && . "${CARGO_HOME:-$HOME/.cargo}/env"
if ! has cargo; then
    lacks "Rust 1.95 or newer" "curl --proto '=https' -sSf https://sh.rustup.rs | sh -s -- -y" "everything"
    exit 1
fi
for component in rustfmt clippy; do
    cargo "${component/rustfmt/fmt}" --version >/dev/null 2>&1 || rustup component add "$component" ||
        { lacks "$component" "rustup component add $component" "everything"; exit 1; }
done

# What drives the browser, and the renderer of 3D Tiles. What is there and current is not asked for again.
node_packages() {
    local folder="$1" kept="$1/node_modules/.package-lock.json"
    shift
    [ -e "$kept" ] && [ ! "$folder/package-lock.json" -nt "$kept" ] && return
    npm ci --prefix "$folder" --no-audit --no-fund --fetch-retries 1 --silent "$@" >&2
}
if has_node && has npm; then
    node_packages web/test || lacks "driver for the browser" "npm ci --prefix web/test" "pages in a browser"
    node_packages tests/tiles --legacy-peer-deps ||
        lacks "renderer of 3D Tiles" "npm ci --prefix tests/tiles --legacy-peer-deps" "tilesets in a browser"
fi

# The engine that the workflow of data/workflow is written for.
runs_workflows() { PATH="$PATH:target/tools/bin" snakemake --version >/dev/null 2>&1; }
if has_venv && ! runs_workflows; then
    # Anew: what is there may be of a checkout that lay elsewhere.
    { python3 -m venv --clear target/tools && target/tools/bin/pip install --quiet --disable-pip-version-check --requirement tests/snakemake.txt; } ||
        lacks "snakemake" "python3 -m venv target/tools && target/tools/bin/pip install snakemake" "the workflow"
fi

# The compiler of C for macOS, and Rust's library for it. Without them the workspace is not compiled for macOS, which no test needs.
if has_venv && has rustup && [ ! -x target/tools/bin/cargo-zigbuild ]; then
    { [ -x target/tools/bin/pip ] || python3 -m venv target/tools; } &&
        target/tools/bin/pip install --quiet --disable-pip-version-check --requirement tests/zig.txt &&
        rustup target add aarch64-apple-darwin ||
        echo "macOS is not compiled for: no zig, or no library of Rust for it" >&2
fi
