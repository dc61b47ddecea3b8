//! The memory of a verb that reads a `.chpm`.

use crate::args::MemorySize;
use chpm_mesh::Bytes;
pub(crate) use chpm_verify::memory::{divide, divide_among};

/// The memory of a verb that only reads.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct MemoryArgs {
    /// Memory that the whole process stays below, as in 64M; refused if the file's tables alone take more
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    memory: MemorySize,
}

impl MemoryArgs {
    /// Budget.
    pub(crate) fn memory(&self) -> Bytes {
        self.memory.0
    }
}
