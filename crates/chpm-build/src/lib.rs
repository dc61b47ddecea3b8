//! The out-of-core pipeline: ingest, decompose, hierarchy, simplify, layout, emit.
//!
//! [`build`] is the whole of it on one page; each stage is a module of the same name. Big arrays live in
//! `chpm_extmem` columns, buckets and spools, which go to the work directory when the memory budget refuses them, and every
//! stage gives the same answer for any number of threads and any budget.
#![forbid(unsafe_code)]

mod allowance;
mod chain;
mod checkpoint;
mod clock;
pub mod config;
pub mod context;
mod decompose;
mod emit;
mod error;
mod fingerprint;
mod hierarchy;
mod ids;
mod in_order;
mod ingest;
mod join;
mod layout;
mod memo;
mod output;
mod pairs;
mod per_thread;
mod pipeline;
pub mod progress;
mod range;
pub mod report;
mod sheets;
mod simplify;
pub mod stage;
mod trace;
mod triangle_order;
mod trim;
mod vertex_columns;

pub use allowance::MIN_MEMORY;
pub use chain::{chain, close_up};
pub use chpm_extmem::{Cancel, FailPoints, Progress, Silent};
pub use config::{BuildConfig, Division, Keep, Resources, Settings};
pub use error::BuildError;
pub use ids::Ids;
pub use layout::{MOST_ORDERED, ORDER_BYTES, order_mesh, page_order};
pub use memo::beside as memo_beside;
pub use output::{Append, OutputFiles};
pub use pipeline::{build, build_open};
pub use progress::{BuildProgress, Stage};
pub use report::{BuildReport, Reached, TakenOver};
pub use trace::Trace;
