#!/usr/bin/env bash
# Builds the wheel, installs it beside trimesh, PyVista and meshio, and runs its tests, which compare it with the command (CHPM; the dev build if
# not given). Where something for that is missing, it says so and skips.
set -euo pipefail
cd "$(dirname "$0")"
python="${PYTHON:-python3}"

skip() {
    echo "the Python package is not tested: $1" >&2
    echo "the Python package: $1" >>"${CHPM_SKIPPED:-/dev/null}"
    exit 0
}

command -v "$python" >/dev/null || skip "there is no $python"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' || skip "$("$python" --version) is older than 3.10"
"$python" -m venv target/venv || skip "it needs the modules venv and pip (Debian: python3-venv)"
# What is installed already is not asked for again.
target/venv/bin/python -m pip install --quiet --requirement tests/requirements.txt || skip "PyPI does not answer"

# The command's own: what is there is not compiled again.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$(cd .. && pwd)/target}"
export CHPM="${CHPM:-$CARGO_TARGET_DIR/debug/chpm}"
[ -x "$CHPM" ] || cargo build --manifest-path ../Cargo.toml --locked

cargo fmt --check
cargo clippy --locked -- -D warnings
# The wheel tells what of others is in it; so does this file, until a crate changes.
"$python" ../packaging/notices.py Cargo.toml | cmp - THIRD-PARTY-NOTICES ||
    { echo "python/THIRD-PARTY-NOTICES is old: packaging/notices.py python/Cargo.toml >python/THIRD-PARTY-NOTICES" >&2; exit 1; }
rm -rf target/wheels
target/venv/bin/maturin build --profile dev --locked --interpreter "$python" --out target/wheels
# Names that METIS is to find here are no business of other libraries.
if nm -D "$CARGO_TARGET_DIR"/debug/lib_chpm.so | grep ' gk_' >/dev/null; then echo "the wheel exports METIS's names" >&2; exit 1; fi
"$python" -m zipfile --list target/wheels/*.whl | grep THIRD-PARTY-NOTICES >/dev/null
target/venv/bin/python -m pip install --quiet --no-deps --force-reinstall target/wheels/*.whl
target/venv/bin/python -m pytest --quiet -rs | tee target/pytest.log
sed -n "s/^SKIPPED/the Python package:/p" target/pytest.log >>"${CHPM_SKIPPED:-/dev/null}"
