#!/usr/bin/env bash
# What finds more the longer it goes on, and is short in tests/all.sh: more random cuts, larger models, SECONDS_EACH (600) of odd sources and files and
# of damaged images, each with SEED (2).
set -euo pipefail
cd "$(dirname "$0")/.."
each="${SECONDS_EACH:-600}" seed="${SEED:-2}"
CHPM_SOAK=1 cargo test --release --locked --test integration -- cuts:: formats::
cargo test --release --locked --test fuzz -- --seconds "$each" --seed "$seed" --cuts 5 --keep target/found
cargo test --release --locked -p chpm-image --test fuzz -- --seconds "$each" --seed "$seed"
