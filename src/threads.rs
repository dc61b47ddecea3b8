//! How many threads a verb works with.

use crate::number;
use anyhow::{Context, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Threads of a verb whose result does not depend on their number.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct ThreadArgs {
    /// Worker threads; one per processor if not given
    #[arg(long, value_name = "N", value_parser = number::count(1_u32..=1024))]
    threads: Option<u32>,
}

impl ThreadArgs {
    /// The threads, to be given work with `install`.
    pub(crate) fn pool(&self) -> Result<ThreadPool> {
        ThreadPoolBuilder::new()
            .num_threads(self.threads.unwrap_or(0) as usize)
            .build()
            .context("cannot start the worker threads")
    }
}
