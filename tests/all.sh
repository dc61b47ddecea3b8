#!/usr/bin/env bash
# Everything that has to pass: format, lints, documentation, tests.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo fmt --all --check
cargo clippy --workspace --all-targets --locked -- -D warnings
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked
cargo test --workspace --locked --no-fail-fast
# The Python package, where there is Python; a workspace of its own.
bash python/test.sh
# The same pictures where there is nothing but OpenGL.
WGPU_BACKEND=gl cargo test --workspace --locked --test pictures
