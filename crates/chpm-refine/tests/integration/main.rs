//! Cuts, extraction and cursors over small files with known answers.

/// A cursor is always where playing from scratch is.
mod cursor;
/// The uniform rules against naive oracles; what is no cut is refused.
mod cuts;
/// Extracted meshes: exactly the cut's triangles, welded, without cracks.
mod extraction;
/// Files made by hand: a bumpy grid in strips.
mod strips;
