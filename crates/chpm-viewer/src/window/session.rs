//! One open model: the viewer, the camera, and what is recorded, replayed or frozen.

use crate::error::ViewerError;
use crate::frame::{Spot, Viewer};
use crate::gpu::Gpu;
use crate::headless::{self, Image, TriangleId};
use crate::request::{Accuracy, Budgets, FrameRequest, Target};
use crate::stats::Stats;
use crate::transform::Transform;
use crate::window::detail::{Detail, Took};
use crate::window::figures::Figures;
use crate::window::frustum;
use crate::window::gesture::Motion;
use crate::window::navigate::{Navigator, Pivot};
use crate::window::record::{Pace, Recorder, Replay};
use crate::window::relation::Second;
use crate::window::rulers::Mark;
use crate::window::section::Cutting;
use crate::window::settings::Settings;
use chpm_refine::{Camera, CameraPath, Member, Side, Stance, Up};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Seconds for which an answer to "what is below the pointer" serves the same pixel, and between two measures of how far flight can see.
const RECENT: f64 = 0.25;
/// Frames without any change after which the picture is taken for final.
const QUIET: u32 = 3;
/// The same while pages are missing: afterwards somebody looks now and then.
const MISSING: u32 = 30;

/// Of a screenshot.
const SAMPLES: u32 = 8;

/// Next step of the event loop, as far as the picture goes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Next {
    /// The next frame will be another one.
    Frame,
    /// The picture may change when pages come that have not come for a while.
    Look,
    /// Nothing.
    Rest,
}

/// Target of a pan.
#[derive(Clone, Copy, Debug)]
enum Held {
    /// Surface at this pixel when the drag began.
    Pixel([f64; 2]),
    /// Something at this depth; nothing known.
    Depth(Option<f64>),
}

/// How a model is looked at first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Whole {
    pub(super) up: Option<Up>,
    pub(super) side: Option<Side>,
    /// Width by height of the part of the image that it may take.
    pub(super) aspect: f64,
}

/// An open model.
pub(super) struct Session {
    pub(super) path: PathBuf,
    pub(super) viewer: Viewer,
    pub(super) navigator: Navigator,
    pub(super) figures: Figures,
    /// The camera that the selection is held for, and the shape of its image.
    pub(super) frozen: Option<(Camera, f64)>,
    pub(super) recorder: Option<Recorder>,
    pub(super) replay: Option<Replay>,
    /// Path of a replay.
    pub(super) recorded: Option<CameraPath>,
    camera: Camera,
    held: Held,
    /// When and where was looked for what is below the pointer, and what was there.
    picked: Option<(f64, [f64; 2], Option<[f64; 3]>)>,
    /// Seconds of motion, and when flight was last measured.
    time: f64,
    measured: f64,
    moving: bool,
    /// The last frame was as the one before it.
    calm: bool,
    /// Frames since something changed.
    quiet: u32,
    detail: Detail,
    /// Points that are measured, two at most.
    pub(super) marks: Vec<Mark>,
    /// A cluster, as lines of text.
    pub(super) inspected: Vec<String>,
    /// The frame that was drawn last, if nobody has taken notice of what it took.
    took: Option<Took>,
    /// The last frame drew nothing new.
    idle: bool,
    /// Request of the last frame.
    asked: Option<FrameRequest>,
    /// Its picture was drawn over since.
    drawn_over: bool,
}

impl Session {
    /// Opens a file.
    pub(super) fn open(
        gpu: &Arc<Gpu>,
        path: &Path,
        second: Option<&Second>,
        budgets: Budgets,
        color_by: Option<&str>,
        whole: &Whole,
    ) -> Result<Self, ViewerError> {
        let mut paths = vec![(path, second.map_or(Transform::STILL, |second| second.first))];
        paths.extend(second.and_then(|second| Some((second.model.as_path(), *second.steps.first()?))));
        let viewer = Viewer::open_colored(Arc::clone(gpu), &paths, budgets, color_by)?;
        let mut navigator = Navigator::new(&viewer.bounds(), viewer.origin());
        // What is damaged is told when it is drawn.
        let outline = viewer.outline().unwrap_or_default();
        let stance = Stance::of(&outline, whole.up, whole.side);
        navigator.stand(outline, &stance, whole.aspect);
        let camera = navigator.camera();
        Ok(Session {
            path: path.to_owned(),
            viewer,
            navigator,
            figures: Figures::default(),
            frozen: None,
            recorder: None,
            replay: None,
            recorded: None,
            camera,
            held: Held::Depth(None),
            picked: None,
            time: 0.0,
            measured: f64::NEG_INFINITY,
            moving: false,
            calm: false,
            quiet: 0,
            detail: Detail::default(),
            marks: Vec::new(),
            inspected: Vec::new(),
            took: None,
            idle: false,
            asked: None,
            drawn_over: false,
        })
    }

    /// Names of the models' files.
    pub(super) fn name(&self) -> String {
        fn name(path: &Path) -> Option<String> {
            path.file_name().map(|name| name.to_string_lossy().into_owned())
        }
        let names: Vec<_> = self.viewer.files().filter_map(|file| name(file.get_ref().path())).collect();
        names.join(", ")
    }

    /// The camera of the last frame.
    pub(super) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// So many seconds go by: where the camera is now.
    pub(super) fn step(&mut self, seconds: f64, size: [u32; 2]) {
        self.time += seconds.max(0.0);
        self.moving = match &mut self.replay {
            Some(replay) => match replay.next(seconds) {
                Some(camera) => {
                    self.camera = camera;
                    true
                }
                None => {
                    self.stop_replay();
                    false
                }
            },
            None => {
                self.measure_flight(size);
                let moves = self.navigator.step(seconds);
                self.camera = self.navigator.camera();
                moves
            }
        };

        if let Some(recorder) = &mut self.recorder {
            recorder.go(&self.camera, seconds);
        }
    }

    /// Request for the next frame; `since` is the time of the last one, if this one follows it at once.
    pub(super) fn request(
        &mut self,
        settings: &Settings,
        size: [u32; 2],
        since: Option<f64>,
    ) -> FrameRequest {
        let wish = settings.wish(size);
        let ms = since.map(|seconds| 1e3 * seconds);
        if let (true, Some(ms)) = (self.idle, ms) {
            self.detail.take_empty(ms);
        }
        let took = self.took.take().map(|took| Took { ms, ..took });
        let poe = self.detail.next(&wish, took.as_ref(), self.moving);
        // At rest, a picture that takes long is worth waiting for what belongs into it.
        let patience =
            if self.moving { wish.ms.min(100.0) / 4.0 } else { self.figures.total().clamp(30.0, 250.0) };
        // A picture that still changes is soon another one.
        let rests = !self.moving && self.calm;
        FrameRequest {
            accuracy: Accuracy::PoE(poe),
            samples: settings.smooths(self.viewer.gpu()).samples(rests),
            clip: settings.plane(&self.viewer.bounds(), self.viewer.origin()),
            patience: Duration::from_secs_f64(1e-3 * patience),
            ..settings.request_on(self.viewer.gpu(), self.camera, size, self.frozen.map(|(camera, _)| camera))
        }
    }

    /// Draws a frame, unless the picture that there is is final, and what was asked for.
    pub(super) fn draw(
        &mut self,
        request: &FrameRequest,
        target: &Target<'_>,
        kept: bool,
    ) -> Result<Option<Stats>, ViewerError> {
        let request = FrameRequest { kept, ..*request };
        let before =
            self.asked.replace(request).map(|before| FrameRequest { patience: request.patience, ..before });
        let drawn_over = std::mem::take(&mut self.drawn_over);
        if kept && !drawn_over && before == Some(request) && self.next() == Next::Rest {
            return Ok(None);
        }
        self.viewer.frame(&request, target).map(Some)
    }

    /// A frame is shown: it took so long, and came so many seconds after the last one.
    pub(super) fn shown(&mut self, stats: &Stats, whole: Duration, seconds: f64) {
        let changes = self.moving || changed(&self.figures.last, stats);
        self.calm = !changes;
        // Nothing is final before all answers are there.
        self.quiet = if changes { 0 } else { self.quiet + u32::from(stats.unanswered == 0) };
        self.idle = stats.kept;
        if stats.kept {
            self.figures.keep(stats);
        } else {
            self.took = Some(Took { poe: stats.poe, triangles: stats.triangles, ms: None });
            self.figures.take(stats, whole, seconds, changes);
        }
        // What was below the pointer is somewhere else now.
        if self.moving {
            self.picked = None;
        }
    }

    /// The picture, complete and without a panel.
    pub(super) fn image(&mut self, settings: &Settings, size: [u32; 2]) -> Result<Image, ViewerError> {
        let frozen = self.frozen.map(|(camera, _)| camera);
        let clip = settings.plane(&self.viewer.bounds(), self.viewer.origin());
        let request = FrameRequest {
            wait: true,
            samples: SAMPLES,
            clip,
            ..settings.request_on(self.viewer.gpu(), self.camera, size, frozen)
        };
        Ok(headless::image(&mut self.viewer, &request)?.0)
    }

    /// The clipping plane whose outline is wanted.
    pub(super) fn cutting(&self, settings: &Settings) -> Option<Cutting> {
        let clip = settings.plane(&self.viewer.bounds(), self.viewer.origin());
        let mut places = [Transform::STILL; 2];
        places.iter_mut().zip(self.viewer.places()).for_each(|(to, place)| *to = place);
        clip.filter(|_| settings.outline).map(|clip| Cutting { clip, places })
    }

    /// Whether the camera moves.
    pub(super) fn is_moving(&self) -> bool {
        self.moving
    }

    /// Whether there is more to draw.
    pub(super) fn next(&self) -> Next {
        let missing = self.figures.last.withheld > 0;
        let patience = if missing { MISSING } else { QUIET };
        match self.quiet < patience || self.navigator.is_moving() || self.replay.is_some() {
            true => Next::Frame,
            false if missing => Next::Look,
            false => Next::Rest,
        }
    }

    /// The second model is somewhere else.
    pub(super) fn put(&mut self, place: Transform) {
        if self.viewer.put(1, place) {
            (self.picked, self.quiet) = (None, 0);
        }
    }

    /// Something else is asked for from now on.
    pub(super) fn wake(&mut self) {
        self.quiet = 0;
    }

    /// Moves the camera; it goes where it is told to even while a replay runs, which then ends.
    pub(super) fn go(&mut self, motion: Motion, size: [u32; 2]) {
        let height = f64::from(size[1]);
        match motion {
            Motion::Grab(at) => self.held = Held::Pixel(at),
            // That is no matter of the camera.
            Motion::Light(_) => {}
            Motion::Turn(drag) => self.lead().turn(drag, height),
            Motion::Pan(drag) => {
                self.stop_replay();
                let depth = self.held_depth(size);
                self.navigator.pan(drag, height, depth);
            }
            Motion::Dolly { factor, at } => {
                self.stop_replay();
                let point = self.pick(at, size);
                self.navigator.dolly(factor, point);
            }
            Motion::Focus(at) => {
                self.stop_replay();
                if let Some(point) = self.pick(at, size) {
                    self.navigator.focus_on(point);
                }
            }
        }
    }

    /// The camera in the user's hand: a replay ends where it is.
    pub(super) fn lead(&mut self) -> &mut Navigator {
        self.stop_replay();
        &mut self.navigator
    }

    /// Ends a replay; the camera stays where it came to.
    pub(super) fn stop_replay(&mut self) {
        let Some(replay) = self.replay.take() else { return };
        match replay.upward() {
            Some(_) => self.navigator.jump(&self.camera),
            None => self.navigator.resume(&self.camera),
        };
    }

    /// Goes along a path.
    pub(super) fn follow(&mut self, path: &CameraPath, pace: Pace) {
        self.replay = Replay::new(path.clone(), pace);
        self.wake();
    }

    /// Holds the selection for this camera, or lets it go.
    pub(super) fn freeze(&mut self, size: [u32; 2]) {
        let aspect = f64::from(size[0]) / f64::from(size[1].max(1));
        self.frozen = if self.frozen.is_some() { None } else { Some((self.camera, aspect)) };
        self.wake();
    }

    /// The borders of what the frozen camera sees.
    pub(super) fn frozen_lines(&self, size: [u32; 2]) -> Vec<frustum::Line> {
        self.frozen
            .map(|(camera, aspect)| frustum::lines(&camera, aspect, &self.camera, size))
            .unwrap_or_default()
    }

    fn held_depth(&mut self, size: [u32; 2]) -> Option<f64> {
        if let Held::Pixel(at) = self.held {
            let depth = self.pick(at, size).map(|point| frustum::depth(&self.camera, point));
            self.held = Held::Depth(depth.filter(|depth| *depth > 0.0));
        }
        match self.held {
            Held::Depth(depth) => depth,
            Held::Pixel(_) => None,
        }
    }

    /// The point of the model at a pixel of the last frame. A picture that cannot be asked shows nothing.
    fn pick(&mut self, at: [f64; 2], size: [u32; 2]) -> Option<[f64; 3]> {
        if let Some((time, there, point)) = self.picked
            && self.time - time < RECENT
            && there == at
        {
            return point;
        }
        let inside = (0..2).all(|axis| at[axis] >= 0.0 && at[axis] < f64::from(size[axis]));
        if !inside || self.figures.frames() == 0 {
            return None;
        }
        let point = self.viewer.pick(at.map(|x| x as u32)).ok().flatten();
        self.picked = Some((self.time, at, point));
        point
    }

    /// The point of the next mark, or the end of measuring. A mark is on the source's own triangles where they are within reach, however
    /// coarse the picture is.
    pub(super) fn measure(&mut self, at: [f64; 2], size: [u32; 2]) -> Result<(), ViewerError> {
        let inside = (0..2).all(|axis| at[axis] >= 0.0 && at[axis] < f64::from(size[axis]));
        let request = self.asked.filter(|_| inside && self.marks.len() < 2);
        let spot = match request {
            Some(request) => {
                let request = FrameRequest { viewport: size, ..request };
                self.viewer.exact(&request, at.map(|x| x as u32))?
            }
            None => None,
        };
        // The depth that picking looks at is that of one pixel now: whoever picks before the next frame finds nothing there.
        (self.drawn_over, self.quiet, self.picked) = (true, 0, None);
        match spot {
            Some(Spot { point, error }) => self.marks.push(Mark { point, error }),
            None => self.marks.clear(),
        }
        Ok(())
    }

    /// Tells of the cluster at a pixel.
    pub(super) fn inspect(&mut self, at: [f64; 2], size: [u32; 2]) -> Result<(), ViewerError> {
        self.inspected.clear();
        let Some((seen, member, error)) = self.cluster_at(at, size)? else { return Ok(()) };
        let Some(file) = self.viewer.files().nth(seen.model as usize) else { return Ok(()) };
        let record = &file.clusters()[member.cluster.index()];

        let group = if record.is_root() {
            "a root".to_owned()
        } else {
            format!("below group {}", record.parent_group)
        };
        let of = if self.viewer.files().nth(1).is_some() {
            format!(", of model {}", seen.model + 1)
        } else {
            String::new()
        };

        self.inspected = vec![
            format!("{} of level {}, in group {}, {group}{of}", member.cluster, record.level, record.group),
            format!("drawn with {} of {} vertices", member.vertices, record.vertex_count),
            format!("triangles {} to {}", record.base_triangle_count, record.triangle_count),
            format!("error as drawn {error:.4e} units"),
            format!("page {} at {}", chpm_mesh::Bytes(u64::from(record.page_len)), record.page_offset),
        ];
        Ok(())
    }

    /// Cluster at a pixel, its position, and its error.
    fn cluster_at(
        &mut self,
        at: [f64; 2],
        size: [u32; 2],
    ) -> Result<Option<(TriangleId, Member, f32)>, ViewerError> {
        let inside = (0..2).all(|axis| at[axis] >= 0.0 && at[axis] < f64::from(size[axis]));
        let Some(request) = self.asked.filter(|_| inside) else { return Ok(None) };
        let (ids, _) =
            self.viewer.ids(&FrameRequest { viewport: size, wait: false, kept: false, ..request })?;
        // The picture was drawn over, in the depth that picking looks at; another point may be wanted before the next frame.
        (self.drawn_over, self.quiet) = (true, 0);
        let [x, y] = at.map(|x| x as usize);
        let seen = ids.pixels[y * size[0] as usize + x];
        Ok(seen.and_then(|seen| {
            let (member, error) = self.viewer.drawn(seen.model as usize, seen.cluster)?;
            Some((seen, member, error))
        }))
    }

    /// Flight is as fast as what is ahead is far away.
    fn measure_flight(&mut self, size: [u32; 2]) {
        let flies = self.navigator.pivot() == Pivot::Eye && self.navigator.is_flying();
        if flies && self.time - self.measured > RECENT {
            self.measured = self.time;
            if let Some(point) = self.pick(size.map(|x| 0.5 * f64::from(x)), size) {
                self.navigator.set_distance(frustum::depth(&self.camera, point));
            }
        }
    }
}

/// Whether a frame differs from the one before it, or is going to from the next.
fn changed(before: &Stats, now: &Stats) -> bool {
    let work = [now.splits, now.collapses, now.pm_steps, now.newly_visible, now.uploaded_bytes];
    let poe = (before.poe - now.poe).abs() > 1e-3 * now.poe;
    fn shown(s: &Stats) -> (u64, u64, u64, u64) {
        (s.triangles, s.clusters_drawn, s.resident_bytes, s.withheld)
    }
    poe || shown(before) != shown(now) || work.iter().any(|count| *count > 0) || now.requested_bytes > 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_final_when_nothing_changes() {
        let calm = Stats { triangles: 5, poe: 1.0, ..Stats::default() };
        assert!(!changed(&calm, &calm));
        for stats in [
            Stats { splits: 1, ..calm },
            Stats { collapses: 1, ..calm },
            Stats { pm_steps: 1, ..calm },
            Stats { newly_visible: 1, ..calm },
            Stats { uploaded_bytes: 1, ..calm },
            Stats { requested_bytes: 1, ..calm },
            Stats { triangles: 6, ..calm },
            Stats { resident_bytes: 6, ..calm },
            Stats { poe: 1.5, ..calm },
        ] {
            assert!(changed(&calm, &stats), "{stats:?}");
        }
    }
}
