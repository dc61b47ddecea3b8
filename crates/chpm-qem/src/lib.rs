//! Quadric half-edge-collapse simplification of one cluster, in core (Quick-VDR 4.3; Garland and Heckbert 1997).
//!
//! One cluster fits the cache, so the kernel is single-threaded, pure and allocation-free once its scratch has grown:
//! slices in, a collapse order out. Threads belong to the caller, one [`Decimator`] each.
#![forbid(unsafe_code)]

mod adjacency;
mod decimate;
mod fan;
mod forced;
mod legality;
mod quadric;
mod record;
mod refusal;

pub use decimate::{Collapse, Decimator, Outcome, Patch, Topology};
pub use quadric::Quadric;
pub use record::Record;
pub use refusal::{Refusal, Refusals};
