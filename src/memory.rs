//! The memory of a verb that reads a `.chpm`.

use crate::args::MemorySize;
use crate::threads::{ThreadArgs, Workers};
use anyhow::Result;
use chpm_build::Cancel;
use chpm_extmem::{MappedFile, process};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
pub(crate) use chpm_verify::memory::{divide, divide_among};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

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

/// The threads of a verb that reads `file`, and what [`divide`] leaves it: as many as are asked for, or as many as there is memory for, where each takes
/// `each` bytes beside the verb's `own`.
///
/// # Errors
/// Those of [`divide`], for one thread.
pub(crate) fn workers(
    threads: &ThreadArgs,
    file: &Chpm<MappedFile>,
    memory: Bytes,
    own: u64,
    each: u64,
) -> Result<(Workers, u64)> {
    let count = threads.wanted().min(chpm_verify::memory::threads(file, memory, own, each));
    let free = divide(file, memory, own + count as u64 * each)?;
    Ok((Workers::start(count)?, free))
}

/// The same for a verb that reads two files, with the verb's own bytes beside each of them; its threads work on the second, and there is always room for one.
///
/// # Errors
/// Those of [`divide_among`], for one thread.
pub(crate) fn workers_among(
    threads: &ThreadArgs,
    [(first, own), (second, beside)]: [(&Chpm<MappedFile>, u64); 2],
    memory: Bytes,
    each: u64,
) -> Result<(Workers, [u64; 2])> {
    let count = chpm_verify::memory::threads(second, Bytes(memory.0 / 2), beside, each).min(threads.wanted());
    let free = divide_among([(first, own), (second, beside + (count as u64 - 1) * each)], memory)?;
    Ok((Workers::start(count)?, free))
}

/// Pages after which what they left goes back to the system.
const PAGES: u64 = 256;

/// Asked before each page of many that come and go: whether to go on. What one thread frees another cannot use, so now and then the system gets it
/// back.
pub(crate) fn go_on(cancel: &Cancel) -> impl Fn() -> bool + Sync {
    let pages = AtomicU64::new(1);
    move || {
        if pages.fetch_add(1, Relaxed).is_multiple_of(PAGES) {
            process::return_free_pages();
        }
        !cancel.is_cancelled()
    }
}
