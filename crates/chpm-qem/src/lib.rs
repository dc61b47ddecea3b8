//! Quadric half-edge-collapse simplification of one cluster, in core.
