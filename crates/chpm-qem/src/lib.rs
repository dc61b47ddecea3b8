//! Quadric half-edge-collapse simplification of one cluster, in core (Quick-VDR 4.3; Garland and Heckbert 1997).
//!
//! One cluster fits the cache, so the kernel is single-threaded, pure and allocation-free once its scratch has grown:
//! slices in, a collapse order out. Threads belong to the caller, one [`Decimator`] each.
#![forbid(unsafe_code)]

mod adjacency;
mod bound;
mod decimate;
mod displacement;
mod fan;
mod forced;
mod kd_tree;
mod kept;
mod legality;
mod look;
mod nearest;
mod overlay;
mod patch;
mod price;
mod quadric;
mod queue;
mod record;
mod refusal;
mod remnant;
mod ring;
mod state;

pub use decimate::Decimator;
pub use displacement::Displacement;
pub use look::{Deviation, FaceLook, Looks};
pub use patch::{Collapse, Outcome, Patch, Topology};
pub use quadric::Quadric;
pub use record::Record;
pub use refusal::{Refusal, Refusals};
pub use remnant::{Remnant, gap, thin_out};
