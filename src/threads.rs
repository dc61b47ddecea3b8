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
    /// How many; zero is the libraries' word for one per processor.
    pub(crate) fn count(&self) -> usize {
        self.threads.unwrap_or(0) as usize
    }

    /// The threads, to be given work with `install`.
    pub(crate) fn pool(&self) -> Result<ThreadPool> {
        ThreadPoolBuilder::new().num_threads(self.count()).build().context("cannot start the worker threads")
    }
}
