//! A frame that waits for nothing: what is there is drawn, in one submission, and nothing is read back before a later frame.

use super::model::Eye;
use super::paint::Plan;
use super::{Deadline, Viewer, Watch, next_poe, smooth};
use crate::error::ViewerError;
use crate::gpu::buffers::Canvas;
use crate::gpu::{Kind, passes};
use crate::request::{Accuracy, Clip, FrameRequest, Look, Target};
use crate::scene::Culling;
use crate::stats::Stats;
use chpm_refine::{Camera, Changes};
use std::time::Duration;

/// Frames that are read ahead.
const LOOK_AHEAD: f64 = 8.0;
/// Frames from one look ahead to the next; a page takes longer than that anyway.
const AHEAD_EVERY: u64 = 4;

/// Cache key of a picture beside its cut, and its members.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct CacheKey {
    camera: Camera,
    viewport: [u32; 2],
    look: Look,
    samples: u32,
    clip: Option<Clip>,
    culling: Culling,
    triangles: u64,
    clusters: u64,
    /// Clusters and triangles that throw shadows.
    shadows: [u64; 2],
    scale: Option<[f32; 2]>,
}

impl CacheKey {
    fn matches(&self, request: &FrameRequest, culling: Culling) -> bool {
        let CacheKey { camera, viewport, look, samples, clip, .. } = *self;
        (camera, viewport, look) == (request.camera, request.viewport, request.look)
            && (samples, clip, self.culling) == (request.samples, request.clip, culling)
    }
}

impl Viewer {
    /// One frame that waits for nothing.
    pub(super) fn interactive_frame(
        &mut self,
        request: &FrameRequest,
        target: &Target<'_>,
    ) -> Result<Stats, ViewerError> {
        let poe = self.pixels_of_error(request.accuracy);
        let eyes = self.eyes(&request.camera, request, poe)?;
        let culling = self.culling(request);
        let mut stats = Stats { poe, rounds: 1, ..Stats::default() };
        let mut watch = Watch::start();

        // What frames before have asked, and the cut that follows from it.
        self.gpu.poll(wgpu::PollType::Poll);
        self.models.iter_mut().for_each(|model| model.take_answers(&mut stats));
        stats.times.occlusion += watch.lap();
        let before = self.before.replace(request.camera);
        let rests = before == Some(request.camera);
        let deadline = Deadline {
            wait: Some(if rests { request.patience } else { Duration::ZERO }),
            most: Some(self.rate.bytes(request.patience)),
        };
        let changes = self.refine(&eyes, deadline, &mut stats)?;

        // Where the camera is going, pages are read before they are wanted.
        if let Some(before) = before
            && !rests
            && self.now.is_multiple_of(AHEAD_EVERY)
        {
            let ahead = request.camera.onward(&before, LOOK_AHEAD);
            if let Ok(ahead) = self.eyes(&ahead, request, poe) {
                for (model, ahead) in self.models.iter_mut().zip(&ahead) {
                    stats.requested_bytes += model.scene.foresee(&ahead.view, ahead.culling);
                }
            }
        }
        for (model, eye) in self.models.iter_mut().zip(&eyes) {
            model.scene.look(&eye.view, culling);
        }
        stats.times.refine += watch.lap().saturating_sub(stats.times.stall);

        // What is in the target may be what is asked for.
        let moved = changes != Changes::default() || stats.newly_visible > 0 || self.shadows_withheld;
        let last = self.drawn.filter(|last| request.kept && !moved && last.matches(request, culling));
        if let Some(last) = last {
            self.keep(&eyes, last, &mut stats);
            return Ok(stats);
        }

        // The draw lists: what is visible comes first, then what a test may show.
        let colors = self.colors(request, target);
        let look = colors[0];
        let sampled = self.is_sampled(request, look.kind());
        let first = self.prepare(&colors, sampled)?;
        // Without numbered draws, what comes into sight is drawn once the answer is there.
        let at_once = self.gpu.features.contains(wgpu::Features::INDIRECT_FIRST_INSTANCE);
        let plan = if culling.occlusion && at_once { Plan::HiddenToo } else { Plan::Visible };
        let seen: Vec<_> = eyes.iter().map(|eye| &eye.camera_uniform).collect();
        let fit = if look.has_shadows() { self.fit(&seen, Plan::Visible) } else { None };
        self.reach(&seen, fit.as_ref());
        self.gather(&colors, plan, (fit.as_ref(), deadline.most), &mut stats)?;
        self.shadows_withheld = stats.shadows_withheld;
        let brought = watch.lap();
        for ((model, eye), colors) in self.models.iter_mut().zip(&eyes).zip(&colors) {
            model.write(&self.gpu, &eye.camera_uniform.uniform(colors.uniform()));
        }
        stats.times.draw += watch.lap();
        let mut asked = Vec::with_capacity(self.models.len());
        for (model, eye) in self.models.iter_mut().zip(&eyes) {
            let questions = match culling.occlusion {
                true => model.questions(eye, at_once, self.now),
                false => Default::default(),
            };
            stats.tested += questions.1.len() as u64;
            asked.push(questions);
        }
        stats.times.occlusion += watch.lap();

        // One submission: what is visible of all models, the tests against its depth, what they show.
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        if look.has_shadows() {
            self.shade(&mut encoder, &seen, fit.as_ref(), &mut stats)?;
        }
        let depth = Canvas::fit(&mut self.depth, &self.gpu, request.viewport);
        let color = Some(target.color).filter(|_| first[0] != Kind::Depth);
        let mut pass = passes::begin(&mut encoder, color, depth.view(), Some(look.background()));
        for (model, first) in self.models.iter().zip(&first) {
            model.draw(&self.gpu, &mut pass, (*first, 1), 0..model.shown);
        }
        drop(pass);
        stats.times.draw += watch.lap();
        let mut answers = Vec::with_capacity(self.models.len());
        for (model, (_, boxes)) in self.models.iter_mut().zip(&asked) {
            answers.push((!boxes.is_empty()).then(|| model.test(&self.gpu, &mut encoder, depth, boxes)));
        }
        stats.times.occlusion += watch.lap();
        if self.models.iter().any(|model| model.shown < model.list.count()) {
            let mut pass = passes::begin(&mut encoder, color, depth.view(), None);
            for (model, first) in self.models.iter().zip(&first) {
                model.draw(&self.gpu, &mut pass, (*first, 1), model.shown..model.list.count());
            }
        }
        if sampled {
            // All of it: what the tests show is switched on by now.
            let (view, background) = (target.color, look.background());
            let picture = smooth::Picture { view, size: request.viewport, background };
            self.smooth(&mut encoder, picture, |model| model.list.count())?;
        }
        if let Some(color) = color.or(sampled.then_some(target.color)) {
            self.darken(&mut encoder, color, &look, &self.camera_uniform(&request.camera, request))?;
        }
        self.gpu.queue.submit([encoder.finish()]);

        // The answers are taken in by a frame to come.
        for ((model, (subjects, _)), answers) in self.models.iter_mut().zip(asked).zip(answers) {
            if let Some(answers) = answers {
                model.send(subjects, answers);
            }
        }
        stats.times.draw += watch.lap();

        stats.triangles = self.models.iter().map(|model| model.list.triangles()).sum();
        let shown = self.models.iter().map(|model| model.shown as u64).sum::<u64>();
        stats.clusters_drawn = shown + stats.newly_visible;
        self.count(&mut stats);
        self.rate.take(stats.uploaded_bytes, brought);
        if let Accuracy::Triangles(limit) = request.accuracy {
            self.found = next_poe(self.found, stats.triangles, limit);
        }
        self.camera_uniform = Some(self.camera_uniform(&request.camera, request));
        self.drawn = Some(CacheKey {
            camera: request.camera,
            viewport: request.viewport,
            look: request.look,
            samples: request.samples,
            clip: request.clip,
            culling,
            triangles: stats.triangles,
            clusters: stats.clusters_drawn,
            shadows: [stats.shadow_casters, stats.shadow_triangles],
            scale: stats.scale,
        });
        Ok(stats)
    }

    /// The picture of before stays; only what is hidden in it and wanted is asked about.
    fn keep(&mut self, eyes: &[Eye], last: CacheKey, stats: &mut Stats) {
        let mut watch = Watch::start();
        self.now += 1;

        if let Some(depth) = &self.depth {
            for (model, eye) in self.models.iter_mut().zip(eyes) {
                if !eye.culling.occlusion || !model.asked.is_empty() {
                    continue;
                }

                let doubtful = model.scene.doubtful(&eye.view, eye.culling);
                if doubtful.is_empty() {
                    continue;
                }
                let (subjects, boxes): (Vec<_>, Vec<_>) = doubtful.into_iter().unzip();
                stats.tested += boxes.len() as u64;
                let mut encoder =
                    self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                let answers = model.test(&self.gpu, &mut encoder, depth, &boxes);
                self.gpu.queue.submit([encoder.finish()]);
                model.send(subjects, answers);
            }
        }

        (stats.triangles, stats.clusters_drawn, stats.kept) = (last.triangles, last.clusters, true);
        (stats.scale, [stats.shadow_casters, stats.shadow_triangles]) = (last.scale, last.shadows);
        self.count(stats);
        stats.times.occlusion += watch.lap();
    }
}
