//! Graph partitioning: METIS behind a lock, and a pure-Rust partitioner as oracle and fallback.
