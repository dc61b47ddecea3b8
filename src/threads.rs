//! How many threads a verb works with.

use crate::number;
use anyhow::{Context, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::ops::Deref;
use std::thread::{Builder, JoinHandle, available_parallelism};

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

    /// How many, counted.
    pub(crate) fn wanted(&self) -> usize {
        let each = || available_parallelism().map_or(1, usize::from);
        self.threads.map_or_else(each, |threads| threads as usize)
    }

    /// The threads, to be given work with `install`.
    pub(crate) fn pool(&self) -> Result<Workers> {
        Workers::start(self.count())
    }
}

/// Worker threads, all of which have ended when this is dropped: a process that ends together with its threads is killed in Wine now and then.
#[derive(Debug)]
pub(crate) struct Workers {
    pool: Option<ThreadPool>,
    threads: Vec<JoinHandle<()>>,
}

impl Workers {
    /// So many of them; for zero one per processor.
    pub(crate) fn start(count: usize) -> Result<Self> {
        let mut threads = Vec::new();
        let pool = ThreadPoolBuilder::new().num_threads(count).spawn_handler(|worker| {
            threads.push(Builder::new().spawn(|| worker.run())?);
            Ok(())
        });
        let pool = pool.build().context("cannot start the worker threads")?;
        Ok(Workers { pool: Some(pool), threads })
    }
}

impl Deref for Workers {
    type Target = ThreadPool;

    fn deref(&self) -> &ThreadPool {
        self.pool.as_ref().expect("there until it is dropped")
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        drop(self.pool.take());
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
