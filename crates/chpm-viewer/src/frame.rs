//! One model, drawn frame by frame: the loop of Quick-VDR 5.4.
//!
//! A frame that flows refines, draws what was visible before, has the boxes of the rest tested against that depth and what they
//! show drawn, all in one submission: nothing is read back before a later frame. A frame that waits repeats refining and testing, in
//! depth alone and with the answers at once, until nothing changes any more, and then draws what is visible.

mod flow;
mod paint;
mod rate;
mod samples;
mod smooth;

use crate::error::ViewerError;
use crate::gpu::buffers::{Canvas, Sampled};
use crate::gpu::studio::Studio;
use crate::gpu::{
    Answers, Arena, DrawBuffers, DrawList, Drawn, Gpu, Kind, Lens, Occlusion, Pipelines, Probe, Questions,
    TestBox, passes,
};
use crate::request::{Accuracy, Budgets, FrameRequest, Target};
use crate::scene::visibility::{Sight, Subject};
use crate::scene::{Culling, News, Scene, gpu_bytes};
use crate::stats::Stats;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::Aabb;
use chpm_refine::{Camera, Changes, Outline, RefineError, Stance, View, Window};
use flow::Picture;
pub(crate) use paint::heat;
use paint::{Colors, Plan};
use rate::Rate;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A model and all that drawing it needs.
#[derive(Debug)]
pub struct Viewer {
    gpu: Arc<Gpu>,
    scene: Scene,
    pipelines: Pipelines,
    arena: Arena,
    occlusion: Occlusion,
    probe: Probe,
    /// Made when it is first used.
    studio: Option<Studio>,
    buffers: DrawBuffers,
    list: DrawList,
    depth: Option<Canvas>,
    /// For pictures of several samples.
    sampled: Option<Sampled>,
    canvas: Option<Canvas>,
    /// Of the last frame, for picking.
    lens: Option<Lens>,
    /// Number of the round.
    now: u64,
    /// Tests whose answers have not been taken in, and what they are about.
    asked: VecDeque<(Vec<Subject>, Answers)>,
    /// Of the last frame that flowed.
    before: Option<Camera>,
    /// What the last frame that flowed drew.
    drawn: Option<Picture>,
    rate: Rate,
    /// Pixels of error that a number of triangles has led to.
    found: f64,
    /// By cluster: number of its first triangle; empty until ids are asked for.
    keys: Vec<u32>,
}

/// A camera as a frame has it, in file coordinates.
struct Eye {
    view: View,
    lens: Lens,
    culling: Culling,
}

/// How far a refinement goes: how long it waits for pages, and how many bytes it brings for the GPU; none for all.
#[derive(Clone, Copy, Debug)]
struct Haste {
    wait: Option<Duration>,
    most: Option<u64>,
}

impl Haste {
    const NONE: Haste = Haste { wait: None, most: None };

    fn of(most: u64) -> Self {
        Haste { wait: Some(Duration::ZERO), most: Some(most) }
    }
}

/// Frames from one test of what is visible to the next.
const ASK_EVERY: u64 = 4;
/// The same where nothing is hidden.
const ASK_CALMLY: u64 = 16;
/// Rounds after which a frame that waits is done in any case; one for each level, and for what comes into sight, is usual.
const ROUNDS: u64 = 200;

impl Viewer {
    /// Opens a file; reads its tables and no page.
    ///
    /// # Errors
    /// [`ViewerError::Extmem`], [`ViewerError::File`], [`ViewerError::Budget`], [`ViewerError::Device`].
    pub fn open(gpu: Arc<Gpu>, path: &Path, budgets: Budgets) -> Result<Viewer, ViewerError> {
        let file = Chpm::open(MappedFile::open(path)?)
            .map_err(|source| ViewerError::File { path: path.to_path_buf(), source })?;
        let file = Arc::new(file);

        // What the GPU can count on decides what the scene may ask for.
        let colors = file.header().attributes().colors;
        let largest = file.clusters().iter().map(|cluster| gpu_bytes(cluster, colors)).max().unwrap_or(0);
        let (pipelines, occlusion, probe) = gpu.attempt("preparing shaders", || {
            (Pipelines::new(&gpu, colors), Occlusion::new(&gpu), Probe::new(&gpu))
        })?;
        let clusters = file.clusters().len();
        let arena = Arena::new(&gpu, &pipelines, clusters, budgets.gpu_memory, largest);
        let scene = Scene::new(file, budgets, arena.capacity(largest))?;

        Ok(Viewer {
            scene,
            arena,
            occlusion,
            probe,
            studio: None,
            buffers: DrawBuffers::new(&gpu, &pipelines),
            pipelines,
            list: DrawList::new(Kind::Depth),
            depth: None,
            sampled: None,
            canvas: None,
            lens: None,
            now: 0,
            asked: VecDeque::new(),
            before: None,
            drawn: None,
            rate: Rate::default(),
            found: 1.0,
            keys: Vec::new(),
            gpu,
        })
    }

    /// The device that it draws with.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// The file.
    pub fn file(&self) -> &Arc<Chpm<MappedFile>> {
        self.scene.file()
    }

    /// Why some of the model stays coarser than frames that do not wait want it: the first of its pages that could not be read.
    pub fn damage(&self) -> Option<&ViewerError> {
        self.scene.damage()
    }

    /// The box around the model, relative to [`Viewer::origin`].
    pub fn bounds(&self) -> Aabb {
        self.file().header().aabb()
    }

    /// What the file's coordinates are relative to, in the model's.
    pub fn origin(&self) -> [f64; 3] {
        self.file().header().origin
    }

    /// The camera that looks at the box around the model along the z axis, in the model's coordinates.
    pub fn framing(&self) -> Camera {
        Camera::framing(&self.bounds()).relative_to(self.origin().map(|x| -x))
    }

    /// A coarse mesh of the model. Reads the pages of a level.
    ///
    /// # Errors
    /// [`ViewerError::Page`] for a file that is damaged.
    pub fn outline(&self) -> Result<Outline, ViewerError> {
        let path = || self.file().get_ref().path().to_path_buf();
        Outline::of_file(self.file()).map_err(|error| match error {
            RefineError::Format(source) => ViewerError::Page { path: path(), source },
            error => error.into(),
        })
    }

    /// The camera that sees all of a model from as near as it can, in the model's coordinates.
    pub fn fit(&self, outline: &Outline, stance: &Stance, viewport: [u32; 2]) -> Camera {
        let aspect = f64::from(viewport[0]) / f64::from(viewport[1].max(1));
        let window = Window::of_image(aspect, Camera::DEFAULT_FOV);
        let (sight, up) = (stance.sight(), stance.up().vector());
        let camera = outline.fit(&self.bounds(), sight, up, Camera::DEFAULT_FOV, window);
        camera.relative_to(self.origin().map(|x| -x))
    }

    /// So many cameras around a model, from the side that the stance shows on, each further to the right; in the model's coordinates.
    pub fn turn(&self, outline: &Outline, stance: &Stance, viewport: [u32; 2], count: u32) -> Vec<Camera> {
        let aspect = f64::from(viewport[0]) / f64::from(viewport[1].max(1));
        let window = Window::of_image(aspect, Camera::DEFAULT_FOV);
        let (sight, up) = (stance.sight(), stance.up().vector());
        let cameras = outline.turn(&self.bounds(), sight, up, Camera::DEFAULT_FOV, window, count);
        cameras.iter().map(|camera| camera.relative_to(self.origin().map(|x| -x))).collect()
    }

    /// Draws one frame.
    ///
    /// # Errors
    /// [`ViewerError::View`] for a camera that none can be, [`ViewerError::Size`], [`ViewerError::Page`] and [`ViewerError::Read`] for a
    /// file that is damaged, [`ViewerError::Device`].
    pub fn frame(&mut self, request: &FrameRequest, target: &Target<'_>) -> Result<Stats, ViewerError> {
        let start = Instant::now();
        self.check_size(request.viewport)?;
        (self.pipelines.one_sided, self.pipelines.clipped) = (request.look.one_sided, request.clip.is_some());
        let mut stats = if request.wait || request.select_from.is_some() {
            self.drawn = None;
            let mut stats = self.settle(request)?;
            let colors = self.colors(request, target);
            let samples = if request.wait { request.samples.max(1) } else { 1 };
            let first = samples::shifts(samples).next().unwrap_or_default();
            self.paint(request, Some(target.color), colors, first, &mut stats)?;
            stats
        } else {
            self.flow(request, target)?
        };
        self.gpu.check("drawing")?;
        stats.times.total = start.elapsed();
        Ok(stats)
    }

    fn colors(&self, request: &FrameRequest, target: &Target<'_>) -> Colors {
        Colors::new(&request.look, self.file().header().attributes().colors, target.format)
    }

    fn check_size(&self, got: [u32; 2]) -> Result<(), ViewerError> {
        let limit = self.gpu.device.limits().max_texture_dimension_2d;
        let ok = got.iter().all(|side| (1..=limit).contains(side));
        if ok { Ok(()) } else { Err(ViewerError::Size { limit, got }) }
    }

    /// What a frame sees with this camera.
    fn eye(&self, camera: &Camera, request: &FrameRequest, poe: f64) -> Result<Eye, ViewerError> {
        let (camera, viewport) = (camera.relative_to(self.origin()), request.viewport);
        let view = View::new(&camera, viewport, poe)?;
        Ok(Eye {
            view: match request.clip {
                Some(clip) => view.clipped(clip.normal(), clip.offset_from(self.origin())),
                None => view,
            },
            lens: Lens::new(&camera, viewport, &self.bounds()).of_request(request, self.origin()),
            culling: Culling { frustum: request.frustum_culling, occlusion: request.occlusion_culling },
        })
    }

    fn pixels_of_error(&self, accuracy: Accuracy) -> f64 {
        match accuracy {
            Accuracy::PoE(pixels) => pixels,
            Accuracy::Triangles(_) => self.found,
        }
    }

    /// Selects for an eye, up to the cut.
    fn refine(&mut self, eye: &Eye, haste: Haste, stats: &mut Stats) -> Result<Changes, ViewerError> {
        if !self.scene.has_roots() {
            // The one thing that a frame cannot do without.
            self.scene.read_roots()?;
        }

        // What has come makes room for what is asked for.
        self.scene.receive(Some(Duration::ZERO))?;
        stats.requested_bytes += self.scene.want(&eye.view, eye.culling);
        if haste.wait != Some(Duration::ZERO) {
            let start = Instant::now();
            let came = self.scene.receive(haste.wait)?;
            if came > 0 {
                stats.stalls += 1;
                stats.times.stall += start.elapsed();
            }
        }

        let sent = |cluster| self.arena.get(cluster).is_some();
        let changes = self.scene.refine(&eye.view, haste.most, sent)?;
        stats.splits += changes.splits;
        stats.collapses += changes.collapses;
        stats.pm_steps += changes.pm_steps;
        Ok(changes)
    }

    /// What is to be tested: the clusters of the draw list, in its order; those that are hidden, unless they are in the list; and the groups
    /// of which nothing is seen.
    fn questions(&mut self, eye: &Eye, listed: bool) -> (Vec<Subject>, Vec<TestBox>) {
        let clusters = self.scene.file().clusters();
        let mut subjects = Vec::with_capacity(self.list.count());
        let mut boxes = Vec::with_capacity(self.list.count());

        // Where nothing is hidden, most frames need not ask at all.
        let calm = self.list.clusters().all(|(_, shown)| shown);
        let every = if calm { ASK_CALMLY } else { ASK_EVERY };
        for (draw, (cluster, shown)) in self.list.clusters().enumerate() {
            // In a frame that flows, what is visible is asked about now and then: it costs no more than what it draws in vain.
            let turn = if calm { self.now } else { self.now + u64::from(cluster.0) };
            if listed && shown && !turn.is_multiple_of(every) {
                continue;
            }
            let record = &clusters[cluster.index()];
            subjects.push(Subject::Cluster(cluster));
            // What is drawn in any case is not to be switched off.
            let draw = (!shown).then_some(draw);
            boxes.push(TestBox::new(record.aabb_min, record.aabb_max, draw));
        }

        let hidden = self.scene.members().filter(|(_, sight)| *sight == Sight::Hidden && !listed);
        for (member, _) in hidden {
            let record = &clusters[member.cluster.index()];
            subjects.push(Subject::Cluster(member.cluster));
            boxes.push(TestBox::new(record.aabb_min, record.aabb_max, None));
        }
        for (subject, bounds) in self.scene.doubtful(&eye.view, eye.culling) {
            subjects.push(subject);
            boxes.push(bounds);
        }
        (subjects, boxes)
    }

    /// Refines and tests for the camera that selects, until nothing changes if the frame waits; draws nothing but depth.
    fn settle(&mut self, request: &FrameRequest) -> Result<Stats, ViewerError> {
        let Accuracy::Triangles(limit) = request.accuracy else {
            return self.settle_at(request, self.pixels_of_error(request.accuracy));
        };
        // A frozen selection goes on from frame to frame.
        if !request.wait {
            let stats = self.settle_at(request, self.found)?;
            self.found = next_poe(self.found, stats.triangles, limit);
            return Ok(stats);
        }

        // Between one that is too fine and one that is too coarse; from one pixel on, so that the answer does not depend on frames before.
        let (mut poe, mut fine, mut coarse) = (1.0, None, None);
        let mut stats = Stats::default();
        for _ in 0..SEARCH {
            let step = self.settle_at(request, poe)?;
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
            let step = self.settle_at(request, coarse)?;
            stats.add_work(&step);
        }
        Ok(stats)
    }

    fn settle_at(&mut self, request: &FrameRequest, poe: f64) -> Result<Stats, ViewerError> {
        // Answers to questions of frames before would come in between.
        self.asked.clear();
        let eye = self.eye(&request.select_from.unwrap_or(request.camera), request, poe)?;
        let colors = Colors::depth();
        self.pipelines.prepare(&self.gpu, colors.kind(), 1)?;
        let mut stats = Stats { poe, ..Stats::default() };

        // What comes into sight is refined, and what is refined may hide less.
        loop {
            stats.rounds += 1;
            let mut watch = Watch::start();
            let stalled = stats.times.stall;
            let haste = if request.wait { Haste::NONE } else { Haste::of(self.rate.bytes(request.patience)) };
            let changes = self.refine(&eye, haste, &mut stats)?;
            self.scene.look(&eye.view, eye.culling);
            stats.times.refine += watch.lap().saturating_sub(stats.times.stall - stalled);
            let mut changed = changes.splits + changes.collapses > 0;
            if eye.culling.occlusion {
                let news = self.test(&eye, &colors, &mut stats)?;
                stats.newly_visible += news.clusters;
                changed |= news != News::default();
            }
            if !request.wait || !changed || !eye.culling.occlusion || stats.rounds >= ROUNDS {
                break;
            }
        }

        let seen = self.scene.members().filter(|(_, sight)| *sight == Sight::Visible);
        let seen: Vec<_> = seen.map(|(member, _)| member).collect();
        stats.triangles = seen.into_iter().map(|member| self.triangles_of(member)).sum();
        Ok(stats)
    }

    /// Draws the depth of what is visible and asks the boxes; answers what came into sight.
    fn test(&mut self, eye: &Eye, colors: &Colors, stats: &mut Stats) -> Result<News, ViewerError> {
        let shown = self.gather(colors, Plan::Visible, stats)?;

        // Depth alone, waited for: its time is not that of the tests.
        let mut watch = Watch::start();
        self.buffers.write(&self.gpu, &self.pipelines, &self.list, &eye.lens.uniform([0; 4]));
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let depth = Canvas::fit(&mut self.depth, &self.gpu, eye.lens.viewport());
        let mut pass = passes::begin(&mut encoder, None, depth.view(), Some(wgpu::Color::BLACK));
        let pipeline = self.pipelines.get(colors.kind(), 1);
        let drawn = Drawn { pipeline, arena: &self.arena, list: &self.list };
        self.buffers.draw(&self.gpu, &mut pass, &drawn, 0..shown);
        drop(pass);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait()?;
        stats.times.draw += watch.lap();

        let (subjects, boxes) = self.questions(eye, false);
        stats.tested += boxes.len() as u64;
        if boxes.is_empty() {
            return Ok(News::default());
        }
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let depth = Canvas::fit(&mut self.depth, &self.gpu, eye.lens.viewport());
        let questions = Questions { depth, boxes: &boxes, draws: &self.buffers, kind: self.list.kind() };
        let answers = self.occlusion.record(&self.gpu, &mut encoder, &questions);
        self.gpu.queue.submit([encoder.finish()]);
        let visible = self.occlusion.wait(&self.gpu, answers)?;
        let news = self.scene.answer(subjects.into_iter().zip(visible));
        stats.times.occlusion += watch.lap();
        Ok(news)
    }

    /// What the cut and the memory look like after a frame.
    fn count(&mut self, stats: &mut Stats) {
        stats.clusters_active = self.scene.len() as u64;
        for (_, sight) in self.scene.members() {
            stats.frustum_culled += u64::from(sight == Sight::Outside);
            stats.occluded += u64::from(sight == Sight::Hidden);
        }
        stats.withheld = self.scene.withheld();
        stats.resident_bytes = self.scene.resident().0;
        stats.gpu_bytes = self.arena.used().0;
        stats.uploaded_bytes += self.arena.take_uploaded();
    }

    /// The point of the model that was seen at a pixel (column and row from the top) of the last frame, in the model's coordinates;
    /// `None` for the background and outside the image.
    ///
    /// # Errors
    /// [`ViewerError::Device`].
    pub fn pick(&self, pixel: [u32; 2]) -> Result<Option<[f64; 3]>, ViewerError> {
        let (Some(lens), Some(depth)) = (&self.lens, &self.depth) else { return Ok(None) };
        let [width, height] = depth.size();
        if pixel[0] >= width || pixel[1] >= height {
            return Ok(None);
        }
        let depth = self.probe.depth(&self.gpu, depth, pixel)?;
        let origin = self.origin();
        let absolute = |point: [f64; 3]| std::array::from_fn(|axis| point[axis] + origin[axis]);
        Ok(lens.point(pixel, depth).map(absolute))
    }
}

/// Steps towards a number of triangles.
const SEARCH: usize = 16;
/// Pixels of error below which nobody sees a difference, and no search goes.
const LEAST_POE: f64 = 1.0 / 64.0;

/// Pixels of error for the next frame, after one that drew so many triangles.
fn next_poe(poe: f64, triangles: u64, limit: u64) -> f64 {
    let share = triangles as f64 / limit.max(1) as f64;
    // Within these nothing moves.
    if (0.9..=1.0).contains(&share) {
        return poe;
    }
    // Triangles fall with about the square of the error; half of the way at most.
    let step = (share / 0.95).powf(0.4).clamp(0.7, 1.5);
    (poe * step).clamp(LEAST_POE, 1e4)
}

/// Times between laps.
struct Watch(Instant);

impl Watch {
    fn start() -> Self {
        Watch(Instant::now())
    }

    fn lap(&mut self) -> Duration {
        let now = Instant::now();
        now.duration_since(std::mem::replace(&mut self.0, now))
    }
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
