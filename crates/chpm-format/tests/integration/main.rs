//! Files from one end to the other: written, read, verified, damaged.

/// Hostile bytes: every flip, every cut, every lie with right checksums.
mod chained;
mod hostile;
/// Random damage under right checksums never panics.
mod mutate;
/// Every bit of a page comes back from its packed form, and damage is refused.
mod packed;
/// Remnants of components that vanish.
mod remnants;
/// Ranges of a file say what the whole of it says, and what they say is not believed.
mod remote;
/// Round trips.
mod round_trip;
/// Small files to test with.
mod sample;
/// Sheets: images of clusters, and where triangles are in them.
mod sheets;
/// The text of a file, and the specimen of FORMAT.md.
mod text;
/// Every invariant that `verify` knows is missed when it is broken.
mod verify;
/// Pages in files of their own: nothing changes, and what is not theirs is refused by name.
mod volumes;
