//! A frame that waits for nothing: what is there is drawn, in one submission, and nothing is read back before a later frame.

use super::paint::Plan;
use super::{Eye, Haste, Viewer, Watch, next_poe, smooth};
use crate::error::ViewerError;
use crate::gpu::buffers::Canvas;
use crate::gpu::{Drawn, Kind, Questions, passes};
use crate::request::{Accuracy, Clip, FrameRequest, Look, Target};
use crate::scene::Culling;
use crate::stats::Stats;
use chpm_refine::{Camera, Changes};
use std::time::Duration;

/// Frames that are read ahead.
const LOOK_AHEAD: f64 = 8.0;
/// Frames from one look ahead to the next; a page takes longer than that anyway.
const AHEAD_EVERY: u64 = 4;

/// What decides about a picture beside the cut, and what was in it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Picture {
    camera: Camera,
    viewport: [u32; 2],
    look: Look,
    samples: u32,
    clip: Option<Clip>,
    culling: Culling,
    triangles: u64,
    clusters: u64,
    scale: Option<[f32; 2]>,
}

impl Picture {
    fn is_of(&self, request: &FrameRequest, culling: Culling) -> bool {
        let Picture { camera, viewport, look, samples, clip, .. } = *self;
        (camera, viewport, look) == (request.camera, request.viewport, request.look)
            && (samples, clip, self.culling) == (request.samples, request.clip, culling)
    }
}

impl Viewer {
    /// One frame that waits for nothing.
    pub(super) fn flow(&mut self, request: &FrameRequest, target: &Target<'_>) -> Result<Stats, ViewerError> {
        let poe = self.pixels_of_error(request.accuracy);
        let eye = self.eye(&request.camera, request, poe)?;
        let mut stats = Stats { poe, rounds: 1, ..Stats::default() };
        let mut watch = Watch::start();

        // What frames before have asked, and the cut that follows from it.
        self.take_answers(&mut stats);
        stats.times.occlusion += watch.lap();
        let before = self.before.replace(request.camera);
        let rests = before == Some(request.camera);
        let haste = Haste {
            wait: Some(if rests { request.patience } else { Duration::ZERO }),
            most: Some(self.rate.bytes(request.patience)),
        };
        let changes = self.refine(&eye, haste, &mut stats)?;

        // Where the camera is going, pages are read before they are wanted.
        if let Some(before) = before
            && !rests
            && self.now.is_multiple_of(AHEAD_EVERY)
        {
            let ahead = request.camera.onward(&before, LOOK_AHEAD);
            if let Ok(ahead) = self.eye(&ahead, request, poe) {
                stats.requested_bytes += self.scene.foresee(&ahead.view, ahead.culling);
            }
        }
        self.scene.look(&eye.view, eye.culling);
        stats.times.refine += watch.lap().saturating_sub(stats.times.stall);

        // What is in the target may be what is asked for.
        let moved = changes != Changes::default() || stats.newly_visible > 0;
        let last = self.drawn.filter(|last| request.kept && !moved && last.is_of(request, eye.culling));
        if let Some(last) = last {
            self.keep(&eye, last, &mut stats);
            return Ok(stats);
        }

        // The draw list: what is visible comes first, then what a test may show.
        let colors = self.colors(request, target);
        let sampled = self.is_sampled(request, colors.kind());
        let first = self.prepare(colors.kind(), sampled)?;
        // Without numbered draws, what comes into sight is drawn once the answer is there.
        let at_once = self.gpu.features.contains(wgpu::Features::INDIRECT_FIRST_INSTANCE);
        let plan = if eye.culling.occlusion && at_once { Plan::HiddenToo } else { Plan::Visible };
        let shown = self.gather(&colors, plan, &mut stats)?;
        let brought = watch.lap();
        let uniform = eye.lens.uniform(colors.uniform());
        self.buffers.write(&self.gpu, &self.pipelines, &self.list, &uniform);
        stats.times.draw += watch.lap();
        let (subjects, boxes) = match eye.culling.occlusion {
            true => self.questions(&eye, at_once),
            false => Default::default(),
        };
        stats.tested += boxes.len() as u64;
        stats.times.occlusion += watch.lap();

        // One submission: what is visible, the tests against its depth, what they show.
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let depth = Canvas::fit(&mut self.depth, &self.gpu, request.viewport);
        let color = Some(target.color).filter(|_| first != Kind::Depth);
        let mut pass = passes::begin(&mut encoder, color, depth.view(), Some(colors.background()));
        let drawn = Drawn { pipeline: self.pipelines.get(first, 1), arena: &self.arena, list: &self.list };
        self.buffers.draw(&self.gpu, &mut pass, &drawn, 0..shown);
        drop(pass);
        stats.times.draw += watch.lap();
        let questions = Questions { depth, boxes: &boxes, draws: &self.buffers, kind: self.list.kind() };
        let answers = (!boxes.is_empty()).then(|| self.occlusion.record(&self.gpu, &mut encoder, &questions));
        stats.times.occlusion += watch.lap();
        if shown < self.list.count() {
            let mut pass = passes::begin(&mut encoder, color, depth.view(), None);
            self.buffers.draw(&self.gpu, &mut pass, &drawn, shown..self.list.count());
        }
        if sampled {
            // All of it: what the tests show is switched on by now.
            let (view, background) = (target.color, colors.background());
            let picture = smooth::Picture { view, size: request.viewport, background };
            self.smooth(&mut encoder, picture, 0..self.list.count())?;
        }
        self.gpu.queue.submit([encoder.finish()]);

        // The answers are taken in by a frame to come.
        if let Some(answers) = answers {
            answers.send();
            self.asked.push_back((subjects, answers));
        }
        stats.times.draw += watch.lap();

        stats.triangles = self.list.triangles();
        stats.clusters_drawn = shown as u64 + stats.newly_visible;
        self.count(&mut stats);
        self.rate.take(stats.uploaded_bytes, brought);
        if let Accuracy::Triangles(limit) = request.accuracy {
            self.found = next_poe(self.found, stats.triangles, limit);
        }
        self.lens = Some(eye.lens);
        self.drawn = Some(Picture {
            camera: request.camera,
            viewport: request.viewport,
            look: request.look,
            samples: request.samples,
            clip: request.clip,
            culling: eye.culling,
            triangles: stats.triangles,
            clusters: stats.clusters_drawn,
            scale: stats.scale,
        });
        Ok(stats)
    }

    /// The picture of before stays; only what is hidden in it and wanted is asked about.
    fn keep(&mut self, eye: &Eye, last: Picture, stats: &mut Stats) {
        let mut watch = Watch::start();
        self.now += 1;
        let doubtful = match (eye.culling.occlusion && self.asked.is_empty(), &self.depth) {
            (true, Some(_)) => self.scene.doubtful(&eye.view, eye.culling),
            _ => Vec::new(),
        };
        if let (Some(depth), false) = (&self.depth, doubtful.is_empty()) {
            let (subjects, boxes): (Vec<_>, Vec<_>) = doubtful.into_iter().unzip();
            stats.tested += boxes.len() as u64;
            let mut encoder =
                self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let questions = Questions { depth, boxes: &boxes, draws: &self.buffers, kind: self.list.kind() };
            let answers = self.occlusion.record(&self.gpu, &mut encoder, &questions);
            self.gpu.queue.submit([encoder.finish()]);
            answers.send();
            self.asked.push_back((subjects, answers));
        }
        (stats.triangles, stats.clusters_drawn, stats.kept) = (last.triangles, last.clusters, true);
        stats.scale = last.scale;
        self.count(stats);
        stats.times.occlusion += watch.lap();
    }

    /// Takes in the answers that have come.
    fn take_answers(&mut self, stats: &mut Stats) {
        self.gpu.poll(wgpu::PollType::Poll);
        while let Some((subjects, answers)) = self.asked.pop_front() {
            match self.occlusion.try_take(answers) {
                Ok(visible) => {
                    stats.newly_visible += self.scene.answer(subjects.into_iter().zip(visible)).clusters;
                }
                Err(answers) => {
                    self.asked.push_front((subjects, answers));
                    break;
                }
            }
        }
        stats.unanswered = self.asked.len() as u64;
    }
}
