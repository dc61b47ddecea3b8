//! A frame that waits: refined and tested until nothing changes, with the answers at once.

use super::model::{Eye, Model};
use super::paint::{Colors, Plan};
use super::{Deadline, Viewer, Watch};
use crate::error::ViewerError;
use crate::gpu::buffers::Canvas;
use crate::gpu::{Kind, passes};
use crate::request::{Accuracy, FrameRequest};
use crate::scene::News;
use crate::stats::Stats;

/// Rounds after which a frame that waits is done in any case; one for each level, and for what comes into sight, is usual.
const ROUNDS: u64 = 200;

impl Viewer {
    /// Refines and tests for the camera that selects, until nothing changes if the frame waits; draws nothing but depth.
    pub(super) fn converge(&mut self, request: &FrameRequest) -> Result<Stats, ViewerError> {
        let Accuracy::Triangles(limit) = request.accuracy else {
            return self.converge_at(request, self.pixels_of_error(request.accuracy));
        };
        // A frozen selection goes on from frame to frame.
        if !request.wait {
            let stats = self.converge_at(request, self.found)?;
            self.found = next_poe(self.found, stats.triangles, limit);
            return Ok(stats);
        }

        // Between one that is too fine and one that is too coarse; from one pixel on, so that the answer does not depend on frames before.
        let (mut poe, mut fine, mut coarse) = (1.0, None, None);
        let mut stats = Stats::default();
        for _ in 0..SEARCH {
            let step = self.converge_at(request, poe)?;
            stats.add_work(&step);
            if step.triangles > limit {
                fine = Some(poe);
            } else {
                coarse = Some(poe);
                if step.triangles as f64 >= 0.97 * limit as f64 || poe <= LEAST_POE {
                    break;
                }
            }
            poe = match (fine, coarse) {
                (Some(fine), Some(coarse)) => f64::sqrt(fine * coarse),
                (Some(fine), None) => 4.0 * fine,
                (None, Some(coarse)) => coarse / 4.0,
                (None, None) => poe,
            };
        }

        // The last one may have had too many.
        if let Some(coarse) = coarse.filter(|coarse| *coarse != stats.poe) {
            let step = self.converge_at(request, coarse)?;
            stats.add_work(&step);
        }
        Ok(stats)
    }

    fn converge_at(&mut self, request: &FrameRequest, poe: f64) -> Result<Stats, ViewerError> {
        let eyes = self.eyes(&request.select_from.unwrap_or(request.camera), request, poe)?;
        let culling = self.culling(request);
        let colors = vec![Colors::depth(); self.models.len()];
        for model in &mut self.models {
            // Answers to questions of frames before would come in between.
            model.asked.clear();
            // Nor does it depend on what threw shadows then.
            model.reach = None;
            model.pipelines.prepare(&self.gpu, Kind::Depth, 1)?;
        }
        let mut stats = Stats { poe, ..Stats::default() };

        // What comes into sight is refined, and what is refined may hide less.
        loop {
            stats.rounds += 1;
            let mut watch = Watch::start();
            let stalled = stats.times.stall;
            let deadline =
                if request.wait { Deadline::NONE } else { Deadline::of(self.rate.bytes(request.patience)) };
            let changes = self.refine(&eyes, deadline, &mut stats)?;
            for (model, eye) in self.models.iter_mut().zip(&eyes) {
                model.scene.look(&eye.view, culling);
            }
            stats.times.refine += watch.lap().saturating_sub(stats.times.stall - stalled);
            let mut changed = changes.splits + changes.collapses > 0;
            if culling.occlusion {
                let news = self.test(&eyes, &colors, &mut stats)?;
                stats.newly_visible += news.clusters;
                changed |= news != News::default();
            }
            // What throws shadows on what is seen is as fine as the camera wants it there.
            let is_shaded = request.look.shadows && request.select_from.is_none();
            let seen: Vec<_> = eyes.iter().map(|eye| &eye.camera_uniform).collect();
            let fit = if is_shaded { self.fit(&seen, Plan::Visible) } else { None };
            let is_wider = self.reach(&seen, fit.as_ref());
            let goes_on = changed && culling.occlusion || is_wider && is_shaded;
            if !request.wait || !goes_on || stats.rounds >= ROUNDS {
                break;
            }
        }
        stats.triangles = self.models.iter_mut().map(Model::triangles).sum();
        Ok(stats)
    }

    /// Draws the depth of what is visible of all models and asks the boxes; answers what came into sight.
    fn test(&mut self, eyes: &[Eye], colors: &[Colors], stats: &mut Stats) -> Result<News, ViewerError> {
        self.gather(colors, Plan::Visible, (None, None), stats)?;

        // Depth alone, waited for: its time is not that of the tests.
        let mut watch = Watch::start();
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let size = eyes.first().map_or([1; 2], |eye| eye.camera_uniform.viewport());
        let depth = Canvas::fit(&mut self.depth, &self.gpu, size);
        for (model, eye) in self.models.iter_mut().zip(eyes) {
            model.write(&self.gpu, &eye.camera_uniform.uniform([0; 4]));
        }
        let mut pass = passes::begin(&mut encoder, None, depth.view(), Some(wgpu::Color::BLACK));
        for model in &self.models {
            model.draw(&self.gpu, &mut pass, (Kind::Depth, 1), 0..model.shown);
        }
        drop(pass);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait()?;
        stats.times.draw += watch.lap();

        let mut all = News::default();
        for (model, eye) in self.models.iter_mut().zip(eyes) {
            let (subjects, boxes) = model.questions(eye, false, self.now);
            stats.tested += boxes.len() as u64;
            if boxes.is_empty() {
                continue;
            }
            let mut encoder =
                self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let answers = model.test(&self.gpu, &mut encoder, depth, &boxes);
            self.gpu.queue.submit([encoder.finish()]);
            let news = model.wait(&self.gpu, subjects, answers)?;
            (all.clusters, all.groups) = (all.clusters + news.clusters, all.groups + news.groups);
            stats.times.occlusion += watch.lap();
        }
        Ok(all)
    }
}

/// Steps towards a number of triangles.
const SEARCH: usize = 16;
/// Pixels of error below which nobody sees a difference, and no search goes.
const LEAST_POE: f64 = 1.0 / 64.0;

/// Pixels of error for the next frame, after one that drew so many triangles.
pub(super) fn next_poe(poe: f64, triangles: u64, limit: u64) -> f64 {
    let share = triangles as f64 / limit.max(1) as f64;
    // Within these nothing moves.
    if (0.9..=1.0).contains(&share) {
        return poe;
    }
    // Triangles fall with about the square of the error; half of the way at most.
    let step = (share / 0.95).powf(0.4).clamp(0.7, 1.5);
    (poe * step).clamp(LEAST_POE, 1e4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_of_triangles_is_approached_and_then_kept() {
        // A model whose triangles fall with the square of the error, down to ten.
        let triangles = |poe: f64| (1e6 / (poe * poe)) as u64 + 10;
        let mut poe = 1.0;
        for _ in 0..60 {
            poe = next_poe(poe, triangles(poe), 20_000);
        }
        assert!((18_000..=20_000).contains(&triangles(poe)), "{}", triangles(poe));
        assert_eq!(next_poe(poe, triangles(poe), 20_000), poe);
        // Fewer than there are at any error.
        for _ in 0..60 {
            poe = next_poe(poe, triangles(poe), 1);
        }
        assert!(poe.is_finite());
    }
}
