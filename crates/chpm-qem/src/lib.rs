//! Quadric half-edge-collapse simplification of one cluster, in core (Quick-VDR 4.3; Garland and Heckbert 1997), with a proven bound.
//!
//! One cluster fits the cache, so the kernel is single-threaded, pure and allocation-free once its scratch has grown:
//! slices in, a collapse order out. Threads belong to the caller, one [`Decimator`] each.
//!
//! A [`Patch`] goes in: positions, triangles, which vertices must stay, and how far each triangle already is from the source
//! ([`Displacement`]). An [`Outcome`] comes out: every [`Collapse`] in order, each with the error of the mesh that it leaves. Played backward they are a
//! progressive mesh; a [`Record`] numbers its vertices so that every position of it is a prefix.
//!
//! # How a collapse is chosen
//!
//! 1. *Price.* Each half edge costs what the quadrics of its two ends say at the vertex that stays, which is one of the source's: no vertex moves.
//! 2. *Legality.* The cheapest is looked at first. It must keep the link condition, turn no face over, and leave locked vertices where they are; what
//!    is refused is counted by its reason ([`Refusals`]) and comes back when its neighbourhood has changed.
//! 3. *Bound.* What the faces about it would then be away from the source is bounded. If that is far above the price, the collapse is requeued at its bound.
//! 4. *Carried out.* Faces, displacements and prices about the vertex are brought up to date; the error of the mesh is the largest bound so far.
//! 5. *Forced.* Where nothing legal is left and [`Topology::Change`] allows it, small components vanish and handles close, at a price by their size.
//!
//! # Why the error is a bound
//!
//! 1. Every face has a box of displacements: each of its points is a source point moved by a vector of that box, and every source point of its part is on it.
//! 2. A collapse maps the old one-ring onto the new one, piecewise linear and onto (an overlay of the two). A linear piece moves no point farther than its corners.
//! 3. So the boxes of the new faces hold the old ones' boxes, widened by what the overlay's corners move. All is rounded outward.
//! 4. By induction from the source, the farthest corner of any box bounds the distance from mesh to source and back.
//! 5. What vanishes with its component goes on with the nearest face that stays, at the price of the way; what lies apart stays behind as a
//!    [`DroppedComponent`], which the *distance* of a mesh has in it and the error of pictures does not.
//!
//! The steps, with the function that takes each, are in `PROOF.md` beside this crate; an oracle in exact arithmetic tests step 3.
#![forbid(unsafe_code)]

mod adjacency;
mod attribute_error;
mod bound;
mod cover;
mod decimate;
mod displacement;
mod dropped;
mod forced;
mod kd_tree;
mod kept;
mod legality;
mod nearest;
mod one_ring;
mod overlay;
mod patch;
mod price;
mod quadric;
mod queue;
mod record;
mod refusal;
mod ring;
mod vertex_flags;

pub use attribute_error::{AttributeErrors, Deviation, FaceAttributeError};
pub use cover::{Course, Limits, Reference, tightened};
pub use decimate::{BorderGoal, Decimator};
pub use displacement::Displacement;
pub use dropped::{DroppedComponent, LastFace, gap, thin_out};
pub use patch::{Collapse, Outcome, Patch, Topology};
pub use quadric::Quadric;
pub use record::Record;
pub use refusal::{Refusal, Refusals};
