//! Errors between a file and a picture.

use chpm_extmem::ExtmemError;
use chpm_format::FormatError;
use chpm_mesh::{Bytes, ClusterId};
use chpm_refine::RefineError;
use std::io;
use std::path::PathBuf;

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewerError {
    /// The file cannot be mapped.
    #[error(transparent)]
    Extmem(#[from] ExtmemError),
    /// The file is no CHPM, or its tables are damaged.
    #[error("'{}': {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: FormatError,
    },
    /// A file cannot be opened.
    #[error("cannot open '{}': {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// The system refuses a thread.
    #[error("cannot start a thread: {0}; end other programs, or raise the limit of processes")]
    Thread(#[source] io::Error),
    /// A page cannot be read.
    #[error(
        "{cluster} of '{}': {len} bytes at {offset} cannot be read: {source}; if the file was cut short or replaced, copy or build it again and open it anew",
        path.display()
    )]
    Read {
        /// Whose page.
        cluster: ClusterId,
        /// The file.
        path: PathBuf,
        /// Where the page starts, bytes.
        offset: u64,
        /// Its length, bytes.
        len: u32,
        /// Cause.
        source: io::Error,
    },
    /// A page is damaged.
    #[error("'{}': {source}", path.display())]
    Page {
        /// The file.
        path: PathBuf,
        /// The cluster and what is wrong with its page.
        source: FormatError,
    },
    /// No camera, or no image, that anything could be seen with.
    #[error(transparent)]
    View(#[from] RefineError),
    /// There is no adapter to draw with.
    #[error(
        "graphics: no adapter found ({wanted} wanted): {reason}; install a driver, or a software adapter such as mesa-vulkan-drivers; WGPU_BACKEND=vulkan or gl asks for one interface"
    )]
    NoAdapter {
        /// Adapter that was looked for.
        wanted: String,
        /// Reason, in the system's words.
        reason: String,
    },
    /// The adapter cannot do what every picture needs.
    #[error(
        "graphics: {adapter} lacks {what}; choose another adapter, or another interface with WGPU_BACKEND=vulkan or gl"
    )]
    Unable {
        /// The adapter.
        adapter: String,
        /// Feature that it lacks.
        what: String,
    },
    /// The device was lost or refused something.
    #[error(
        "graphics: {adapter}: {what}: {reason}; try again, another adapter, another interface with WGPU_BACKEND=vulkan or gl, or a newer driver"
    )]
    Device {
        /// The adapter.
        adapter: String,
        /// During what.
        what: &'static str,
        /// Message of the driver.
        reason: String,
    },
    /// Not even the coarsest mesh fits.
    #[error("{what}: at least {needed} needed for the coarsest mesh, {got} allowed; allow more")]
    Budget {
        /// Which budget.
        what: &'static str,
        /// The least that serves.
        needed: Bytes,
        /// Allowed bytes.
        got: Bytes,
    },
    /// A picture of nothing.
    #[error("a picture of one model at least expected, got none")]
    NoModel,
    /// The image is larger than the adapter can draw.
    #[error("image: sides of 1 to {limit} pixels expected, got {}x{}", got[0], got[1])]
    Size {
        /// Longest side.
        limit: u32,
        /// Requested size.
        got: [u32; 2],
    },
    /// There are more triangles than 32-bit ids tell apart.
    #[error("ids: fewer than 2^32 triangles of all clusters together expected, got {got}")]
    TooManyIds {
        /// Triangles of all clusters.
        got: u64,
    },
    /// The model could not be made.
    #[error("{0}")]
    Model(String),
    /// The window system refused something.
    #[error("window: {0}")]
    Window(String),
}
