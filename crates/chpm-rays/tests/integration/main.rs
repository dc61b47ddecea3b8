//! Rays beside brute force, at vertices and edges, within memory, what is proven, and what is turned inside out.

mod brute;
mod leaks;
mod proofs;
mod same;
mod scene;
mod sides;
