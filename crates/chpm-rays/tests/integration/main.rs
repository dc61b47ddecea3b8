//! Rays beside brute force, at vertices and edges, within memory, and what is proven.

mod brute;
mod leaks;
mod proofs;
mod same;
mod scene;
