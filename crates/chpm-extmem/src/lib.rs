//! External memory: a budget that is asked before memory is taken, a work directory that cleans up after itself or keeps what
//! another run can go on with, arrays, sequences, blobs and sorts that live in memory when the budget grants it and on disk when
//! it does not, files that appear complete or not at all, the request to stop and
//! the report of progress that all long work knows, fail points (planned errors), the project's only memory map, METIS
//! made safe for threads (a feature), and all that differs between operating systems.
//!
//! The crate knows bytes and plain records, not meshes. Whether an array was granted memory never shows in its
//! content, so a result does not depend on the budget.
#![deny(unsafe_code)]

mod alive;
mod archive;
mod buckets;
mod budget;
mod buffer;
mod cached;
mod cancel;
mod column;
mod error;
mod fail_point;
mod file;
mod lock;
mod manifest;
#[allow(unsafe_code)]
mod map;
#[cfg(feature = "metis")]
#[allow(unsafe_code)]
pub mod metis;
mod paged;
mod part;
mod part_reader;
mod pipe;
#[allow(unsafe_code)]
pub mod platform;
pub mod process;
mod progress;
mod publish;
mod saved;
mod segments;
#[cfg(feature = "metis")]
mod sequence;
mod sorter;
mod spool;
mod store;
mod target;
mod text;
mod workdir;

pub use archive::{archived, archived_among};
pub use buckets::{BucketMut, Buckets, Drain};
pub use budget::{MemoryBudget, Reservation, TaskReservation};
pub use buffer::{Buffer, BufferWriter};
pub use cached::Cached;
pub use cancel::{Cancel, Cancelled};
pub use column::{Column, Part};
pub use error::ExtmemError;
pub use fail_point::FailPoints;
pub use lock::Lock;
pub use map::{Access, MappedBuffer, MappedFile};
pub use paged::Paged;
pub use part::{PartFile, PartFolder, PartWriter};
pub use part_reader::PartReader;
pub use pipe::receive;
pub use progress::{Progress, Silent};
pub use publish::AtomicFile;
pub use saved::SavedFile;
pub use sorter::{Sorted, Sorter};
pub use spool::{Extent, Spool};
pub use store::Store;
pub use target::{hidden_name, same_file, target};
pub use text::{read_limited, read_text};
pub use workdir::WorkDir;
