//! Context of every stage: storage, threads, progress and the request to stop.

use crate::clock::Clock;
use crate::error::BuildError;
use crate::ids::Ids;
use crate::memo::Memo;
use crate::progress::{BuildProgress, Stage};
use crate::report::StageReport;
use crate::trace::Trace;
use chpm_extmem::{Cancel, Store, process};
use std::sync::Mutex;
use std::time::Instant;

/// The surroundings of one build.
pub struct Context<'a> {
    /// Memory budget and work directory.
    pub store: Store,
    /// The build's own threads.
    pub pool: rayon::ThreadPool,
    /// Where progress goes.
    pub progress: &'a dyn BuildProgress,
    /// The request to stop.
    pub cancel: Cancel,
    /// When the work is to be saved.
    pub(crate) clock: Clock,
    /// The least kind of ids for a source's vertices.
    pub(crate) ids: Ids,
    /// Where stages and tasks are recorded.
    pub(crate) trace: Trace,
    /// Results for later builds.
    pub(crate) memo: Option<Memo>,
    stages: Mutex<Vec<StageReport>>,
}

impl<'a> Context<'a> {
    /// Surroundings with `pool`'s threads, and without checkpoints.
    pub fn new(
        store: Store,
        pool: rayon::ThreadPool,
        progress: &'a dyn BuildProgress,
        cancel: Cancel,
    ) -> Self {
        Self::with_clock(store, pool, progress, cancel, Clock::new(None))
    }

    pub(crate) fn with_clock(
        store: Store,
        pool: rayon::ThreadPool,
        progress: &'a dyn BuildProgress,
        cancel: Cancel,
        clock: Clock,
    ) -> Self {
        Context {
            store,
            pool,
            progress,
            cancel,
            clock,
            ids: Ids::default(),
            trace: Trace::default(),
            memo: None,
            stages: Mutex::new(Vec::new()),
        }
    }

    /// Runs one stage: progress around it, a row of the stage table after it.
    pub fn stage<T: Send>(
        &self,
        stage: Stage,
        total: u64,
        run: impl FnOnce() -> Result<T, BuildError> + Send,
    ) -> Result<T, BuildError> {
        self.check()?;
        self.progress.begin_stage(stage, total);
        let (start, used) = (Instant::now(), process::process_time());
        let result = self.pool.install(|| {
            let _traced = self.trace.stage(stage.name());
            run()
        });
        // What threads freed that ended with the stage would be kept for others like them.
        process::return_free_pages();
        self.progress.end_stage(stage);
        let row = StageReport {
            stage,
            seconds: start.elapsed().as_secs_f64(),
            processor_seconds: process::process_time()
                .zip(used)
                .map(|(now, before)| now.saturating_sub(before).as_secs_f64()),
            peak_resident: process::peak_resident(),
            budget_used: self.store.budget.used(),
        };
        self.stages.lock().unwrap_or_else(|e| e.into_inner()).push(row);
        result
    }

    /// The rows of the stages that have run.
    pub fn stage_reports(&self) -> Vec<StageReport> {
        self.stages.lock().unwrap_or_else(|e| e.into_inner()).clone()
    }

    /// Ends the build if it was asked to stop.
    pub fn check(&self) -> Result<(), BuildError> {
        Ok(self.cancel.check()?)
    }
}
