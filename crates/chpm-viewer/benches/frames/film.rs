//! A viewer and what it draws into, frame by frame, each waited for and timed.

use chpm_mesh::Bytes;
use chpm_viewer::internals::buffers::Canvas;
use chpm_viewer::{Budgets, FrameRequest, Gpu, Stats, Target, Viewer, ViewerError};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

pub(crate) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// More than any model here needs.
const PLENTY: Budgets = Budgets { memory: Bytes::mib(4096), gpu_memory: Bytes::mib(2048) };

pub(crate) struct Film {
    pub(crate) viewer: Viewer,
    canvas: Option<Canvas>,
}

/// One frame: what the viewer says, and milliseconds until the device was done, by the clock and of all processors together.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shot {
    pub(crate) stats: Stats,
    pub(crate) ms: f64,
    pub(crate) processor_ms: f64,
}

impl Film {
    pub(crate) fn open(gpu: &Arc<Gpu>, path: &Path) -> Result<Self, ViewerError> {
        Ok(Film { viewer: Viewer::open(Arc::clone(gpu), path, PLENTY)?, canvas: None })
    }

    /// A point of the model.
    pub(crate) fn point(&self) -> Result<[f64; 3], Box<dyn Error>> {
        let file = self.viewer.file();
        let root = file.roots().next().ok_or("no root")?;
        Ok(file.page(root)?.view().positions[0].map(f64::from))
    }

    pub(crate) fn shoot(&mut self, request: &FrameRequest) -> Result<Shot, ViewerError> {
        let fits = |canvas: &Canvas| canvas.size() == request.viewport;
        let canvas = match self.canvas.take().filter(fits) {
            Some(canvas) => canvas,
            None => Canvas::new(self.viewer.gpu(), "bench", request.viewport, FORMAT),
        };
        let (start, busy) = (Instant::now(), processor_ms());
        let stats = self.viewer.frame(request, &Target { color: canvas.view(), format: FORMAT })?;
        self.viewer.gpu().wait()?;
        let shot = Shot { stats, ms: ms(start.elapsed()), processor_ms: processor_ms() - busy };
        self.canvas = Some(canvas);
        Ok(shot)
    }

    /// The same again and again.
    pub(crate) fn repeat(&mut self, request: &FrameRequest, times: usize) -> Result<Vec<Shot>, ViewerError> {
        (0..times).map(|_| self.shoot(request)).collect()
    }

    /// Levels come one by one, and answers a frame later: until nothing changes any more.
    pub(crate) fn converge(&mut self, request: &FrameRequest) -> Result<(), ViewerError> {
        let mut calm = 0;
        while calm < 3 {
            let stats = self.shoot(request)?.stats;
            let moves = stats.splits + stats.collapses + stats.newly_visible + stats.withheld;
            calm = if moves == 0 { calm + 1 } else { 0 };
        }
        Ok(())
    }
}

/// Of this process until now, in and outside the kernel.
pub(crate) fn processor_ms() -> f64 {
    let usage = getrusage(UsageWho::RUSAGE_SELF).expect("every process has one");
    1e-3 * (usage.user_time() + usage.system_time()).num_microseconds() as f64
}

pub(crate) fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

pub(crate) fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}
