//! Cuts, extraction and cursors over small files with known answers.

/// The best mesh within so many triangles: all of them used up, without cracks, at no larger error than one everywhere.
mod budget;
/// A cursor is always where playing from scratch is.
mod cursor;
/// The uniform rules against naive oracles; what is no cut is refused.
mod cuts;
/// Extracted meshes: exactly the cut's triangles, welded, without cracks.
mod extraction;
/// A reader written from FORMAT.md alone selects the same.
mod foreign;
/// The incremental selection against the stateless one, along random paths.
mod front;
/// Camera paths as text, and made.
mod path;
/// A split changes no triangle at the moment it happens.
mod pops;
/// Components that have vanished, drawn by what is left of them.
mod remnants;
/// Pages that come late, in any order, or not at all.
mod residency;
/// The stateless selection: the rule, legal for any camera, without cracks.
mod select;
/// Files made by hand: a bumpy grid in strips.
mod strips;
/// Bounds and culling are conservative and nest.
mod view;
