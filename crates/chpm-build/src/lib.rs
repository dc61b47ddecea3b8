//! The out-of-core pipeline: ingest, decompose, hierarchy, simplify, layout, emit.
