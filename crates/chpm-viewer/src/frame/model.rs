//! One model of a picture: what of it is selected, in memory and on the GPU, and what is known to be hidden.

use super::Deadline;
use super::paint::Item;
use super::shade::Caster;
use super::share::Need;
use crate::error::ViewerError;
use crate::fetch::held_bytes;
use crate::gpu::arena::Resident;
use crate::gpu::buffers::Canvas;
use crate::gpu::camera_uniform::FrameUniform;
use crate::gpu::{
    Answers, Arena, CameraUniform, Casters, DrawBuffers, DrawList, Drawn, Gpu, Kind, Occlusion, Pipelines,
    Questions, Sheets, TestBox, sheets,
};
use crate::request::{Budgets, FrameRequest};
use crate::scene::visibility::{Sight, Subject};
use crate::scene::{Culling, News, Reach, Scene, gpu_bytes};
use crate::stats::Stats;
use crate::tint::Tint;
use crate::transform::Transform;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, Bytes, ClusterId};
use chpm_refine::{Camera, Changes, Member, Outline, RefineError, View};
use std::collections::VecDeque;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A model and all that drawing it needs.
#[derive(Debug)]
pub(super) struct Model {
    pub(super) scene: Scene,
    pub(super) place: Transform,
    pub(super) pipelines: Pipelines,
    pub(super) arena: Arena,
    /// Where sheets are drawn.
    pub(super) sheets: Option<Sheets>,
    /// How many draws of the list lack their sheet.
    pub(super) unpainted: u64,
    occlusion: Occlusion,
    buffers: DrawBuffers,
    pub(super) list: DrawList,
    /// How many draws of the list are shown in any case: they come first.
    pub(super) shown: usize,
    /// On their way into the list.
    pub(super) items: Vec<Item>,
    /// Clusters that throw shadows, in lists, and those of them that the GPU has.
    pub(super) casters: Option<Casters>,
    pub(super) thrown: Vec<Caster>,
    /// Those that are not in the list of draws.
    pub(super) unlisted: Vec<Member>,
    /// From where shadows fall on what was seen in the last round.
    pub(super) reach: Option<Reach>,
    /// Tests whose answers have not been taken in, and what they are about.
    pub(super) asked: VecDeque<(Vec<Subject>, Answers)>,
    /// By cluster: number of its first triangle; empty until ids are asked for.
    pub(super) keys: Vec<u32>,
}

/// A camera as a frame has it, in the coordinates of a model's file.
pub(super) struct Eye {
    pub(super) view: View,
    pub(super) camera_uniform: CameraUniform,
    pub(super) culling: Culling,
}

/// Frames from one test of what is visible to the next.
const ASK_EVERY: u64 = 4;
/// The same where nothing is hidden.
const ASK_CALMLY: u64 = 16;

impl Model {
    /// The file of one, whose tables are read.
    pub(super) fn file_of(path: &Path) -> Result<Arc<Chpm<MappedFile>>, ViewerError> {
        let map = MappedFile::open(path)?;
        let real = map.real_path();
        let file = Chpm::open_at(map, &real, MappedFile::open)
            .map_err(|source| ViewerError::File { path: path.to_path_buf(), source })?;
        Ok(Arc::new(file))
    }

    /// Main memory and GPU memory that a file needs for its roots, and that it could use.
    pub(super) fn needs(file: &Chpm<MappedFile>, tint: &Tint) -> (Need, Need) {
        let (held, on_gpu) = (held_bytes(file, tint), gpu_bytes(file, tint));
        let (pages, blocks) = (held.iter().sum::<u64>(), on_gpu.iter().sum::<u64>());
        let largest = on_gpu.iter().max().copied().unwrap_or(0);
        let (mut root_pages, mut root_blocks) = (0, 0);
        for root in file.roots() {
            root_pages += held[root.index()];
            root_blocks += on_gpu[root.index()];
        }

        // An eighth is for blocks that wait, and what is left at the ends of slabs is lost.
        let lost = (blocks / Bytes::mib(32).0 + 2) * largest;
        let in_memory = Need { least: root_pages, most: pages / 7 * 8 + 8 };
        let sheets = tint.longest_sheet().and_then(|longest| sheets::extent(file, Bytes(u64::MAX), longest));
        let textures = sheets.map_or(0, |(side, count)| count * sheets::bytes_of(side));
        (in_memory, Need { least: root_blocks + 2 * largest, most: blocks + lost + textures })
    }

    pub(super) fn new(
        gpu: &Gpu,
        file: Arc<Chpm<MappedFile>>,
        tint: Tint,
        place: Transform,
        budgets: Budgets,
    ) -> Result<Self, ViewerError> {
        // Sheets have half of the GPU's memory at most, and what the coarsest mesh leaves.
        let (_, least) = Self::needs(&file, &tint);
        let half = Bytes((budgets.gpu_memory.0 / 2).min(budgets.gpu_memory.0.saturating_sub(least.least)));
        let limit = gpu.device.limits().max_texture_dimension_2d;
        let extent = tint.longest_sheet().and_then(|_| sheets::extent(&file, half, limit));
        let tint = tint.with_sheets_to(extent.map(|(side, _)| side));
        let textures = extent.map_or(0, |(side, count)| count * sheets::bytes_of(side));

        // What the GPU can count on decides what the scene may ask for.
        let colors = tint.is_there();
        let largest = gpu_bytes(&file, &tint).into_iter().max().unwrap_or(0);
        let (pipelines, occlusion) = gpu.attempt("preparing shaders", || {
            (Pipelines::new(gpu, colors, extent.is_some()), Occlusion::new(gpu))
        })?;
        let clusters = file.clusters().len();
        let sheets = extent.map(|extent| Sheets::new(gpu, &pipelines.sheets, clusters, extent));
        let arena = Arena::new(gpu, &pipelines, clusters, Bytes(budgets.gpu_memory.0 - textures), largest);
        let scene = Scene::new(file, tint, budgets, arena.capacity(largest))?;
        Ok(Model {
            scene,
            place,
            arena,
            sheets,
            unpainted: 0,
            occlusion,
            buffers: DrawBuffers::new(gpu, &pipelines),
            pipelines,
            list: DrawList::new(Kind::Depth),
            shown: 0,
            items: Vec::new(),
            casters: None,
            thrown: Vec::new(),
            unlisted: Vec::new(),
            reach: None,
            asked: VecDeque::new(),
            keys: Vec::new(),
        })
    }

    pub(super) fn has_colors(&self) -> bool {
        self.scene.tint().is_there()
    }

    pub(super) fn has_sheets(&self) -> bool {
        self.sheets.is_some()
    }

    fn bounds(&self) -> Aabb {
        self.scene.file().header().aabb()
    }

    fn origin(&self) -> [f64; 3] {
        self.scene.file().header().origin
    }

    /// Origin of the file's positions, in the picture.
    pub(super) fn zero(&self) -> [f64; 3] {
        self.place.apply(self.origin())
    }

    /// A position of the file in the picture, relative to an origin there.
    fn shown_at(&self, position: [f64; 3], origin: [f64; 3]) -> [f64; 3] {
        let (way, zero) = (self.place.way(position.into()), self.zero());
        std::array::from_fn(|axis| way[axis] + (zero[axis] - origin[axis]))
    }

    /// The box around it in the picture, relative to an origin there.
    pub(super) fn bounds_from(&self, origin: [f64; 3]) -> Aabb {
        let bounds = self.bounds();
        if self.place.is_still() && self.origin() == origin || bounds.is_empty() {
            return bounds;
        }
        let mut around = Aabb::of_points([]);
        for corner in bounds.corners() {
            let at = self.shown_at(corner.into(), origin);
            around.add(at.map(below));
            around.add(at.map(|x| -below(-x)));
        }
        around
    }

    /// A coarse mesh of it in the picture, relative to an origin there.
    pub(super) fn outline(&self, origin: [f64; 3]) -> Result<Outline, ViewerError> {
        let file = self.scene.file();
        fn path(file: &Arc<Chpm<MappedFile>>) -> std::path::PathBuf {
            file.get_ref().path().to_path_buf()
        }
        let outline = Outline::of_file(file).map_err(|error| match error {
            RefineError::Format(source) => ViewerError::Page { path: path(file), source },
            error => error.into(),
        })?;
        let stays = self.place.is_still() && self.origin() == origin;
        Ok(if stays { outline } else { outline.moved(|point| self.shown_at(point, origin)) })
    }

    /// View of it by a camera of the picture.
    pub(super) fn eye(
        &self,
        camera: &Camera,
        camera_uniform: &CameraUniform,
        request: &FrameRequest,
        poe: f64,
    ) -> Result<Eye, ViewerError> {
        let camera = self.place.camera(camera, self.origin());
        let view = View::new(&camera, request.viewport, poe)?;
        let view = match request.clip.map(|clip| self.place.clip(&clip, self.origin())) {
            Some((normal, offset)) => view.clipped(normal, offset),
            None => view,
        };
        Ok(Eye {
            view: view.stretched(self.place.stretch().into()),
            camera_uniform: camera_uniform.within(&self.place, &camera),
            culling: Culling { frustum: request.frustum_culling, occlusion: request.occlusion_culling },
        })
    }

    /// Takes in what has come, and asks for what a view wants.
    pub(super) fn want(&mut self, eye: &Eye, stats: &mut Stats) -> Result<(), ViewerError> {
        if !self.scene.has_roots() {
            // The one thing that a frame cannot do without.
            self.scene.read_roots()?;
        }

        // What has come makes room for what is asked for.
        self.scene.receive(Some(Duration::ZERO))?;
        stats.requested_bytes += self.scene.want(&eye.view, eye.culling, self.reach.as_ref());
        Ok(())
    }

    /// Selects for an eye, up to the cut.
    pub(super) fn refine(
        &mut self,
        eye: &Eye,
        deadline: Deadline,
        stats: &mut Stats,
    ) -> Result<Changes, ViewerError> {
        if deadline.wait != Some(Duration::ZERO) {
            let start = Instant::now();
            let came = self.scene.receive(deadline.wait)?;
            if came > 0 {
                stats.stalls += 1;
                stats.times.stall += start.elapsed();
            }
        }

        let changes =
            self.scene.refine(&eye.view, deadline.most, |cluster| self.arena.get(cluster).is_some())?;
        stats.splits += changes.splits;
        stats.collapses += changes.collapses;
        stats.pm_steps += changes.pm_steps;
        Ok(changes)
    }

    /// Boxes to be tested: the clusters of the draw list, in its order; those that are hidden, unless they are in the list; and the groups
    /// of which nothing is seen.
    pub(super) fn questions(&mut self, eye: &Eye, listed: bool, now: u64) -> (Vec<Subject>, Vec<TestBox>) {
        let clusters = self.scene.file().clusters();
        let mut subjects = Vec::with_capacity(self.list.count());
        let mut boxes = Vec::with_capacity(self.list.count());

        // Where nothing is hidden, most frames need not ask at all.
        let calm = self.list.clusters().all(|(_, shown)| shown);
        let every = if calm { ASK_CALMLY } else { ASK_EVERY };
        for (draw, (cluster, shown)) in self.list.clusters().enumerate() {
            // In an interactive frame, what is visible is asked about now and then: it costs no more than what it draws in vain.
            let turn = if calm { now } else { now + u64::from(cluster.0) };
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

    /// Records tests of boxes against what was drawn so far, of all models.
    pub(super) fn test(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        depth: &Canvas,
        boxes: &[TestBox],
    ) -> Answers {
        let questions = Questions { depth, boxes, draws: &self.buffers, kind: self.list.kind() };
        self.occlusion.record(gpu, encoder, &questions)
    }

    /// Waits for the answers of tests that were submitted, and takes them in.
    pub(super) fn wait(
        &mut self,
        gpu: &Gpu,
        subjects: Vec<Subject>,
        answers: Answers,
    ) -> Result<News, ViewerError> {
        let visible = self.occlusion.wait(gpu, answers)?;
        Ok(self.scene.answer(subjects.into_iter().zip(visible)))
    }

    /// Takes in the answers that have come.
    pub(super) fn take_answers(&mut self, stats: &mut Stats) {
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
        stats.unanswered += self.asked.len() as u64;
    }

    /// Has the answers of tests sent that were submitted; a frame to come takes them in.
    pub(super) fn send(&mut self, subjects: Vec<Subject>, answers: Answers) {
        answers.send();
        self.asked.push_back((subjects, answers));
    }

    /// Sends the list and what it is seen through; takes effect with the next submission.
    pub(super) fn write(&mut self, gpu: &Gpu, uniform: &FrameUniform) {
        self.buffers.write(gpu, &self.pipelines, &self.list, uniform);
    }

    /// Draws a part of the list that was sent, with a pipeline that was prepared.
    pub(super) fn draw(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        (kind, samples): (Kind, u32),
        part: Range<usize>,
    ) {
        let pipeline = self.pipelines.get(kind, samples);
        let shadows = self.casters.as_ref().filter(|_| kind.is_lit() && self.pipelines.shaded);
        let drawn = Drawn {
            pipeline,
            arena: &self.arena,
            list: &self.list,
            sheets: self.sheets.as_ref(),
            shadows: shadows.map(Casters::group),
        };
        self.buffers.draw(gpu, pass, &drawn, part);
    }

    /// Triangles of what is visible of the cut.
    pub(super) fn triangles(&mut self) -> u64 {
        let Model { scene, arena, .. } = self;
        let seen = scene.members().filter(|(_, sight)| *sight == Sight::Visible);
        seen.map(|(member, _)| triangles_of(member, scene, arena)).sum()
    }

    /// Adds counts of the cut and of the memory after a frame.
    pub(super) fn count(&mut self, stats: &mut Stats) {
        stats.clusters_active += self.scene.len() as u64;
        for (_, sight) in self.scene.members() {
            stats.frustum_culled += u64::from(sight == Sight::Outside);
            stats.occluded += u64::from(sight == Sight::Hidden);
        }
        stats.withheld += self.scene.withheld();
        stats.resident_bytes += self.scene.resident().0;
        stats.gpu_bytes += self.arena.used().0;
        stats.uploaded_bytes += self.arena.take_uploaded();
        stats.unpainted += self.unpainted;
        if let Some(sheets) = &mut self.sheets {
            stats.gpu_bytes += sheets.used().0;
            stats.uploaded_bytes += sheets.take_uploaded();
        }
    }

    /// The places in the page of the triangles that were drawn of a cluster.
    pub(super) fn places(&self, cluster: ClusterId) -> Vec<u32> {
        let (Some(page), Some(resident)) = (self.scene.page(cluster), self.arena.get(cluster)) else {
            return Vec::new();
        };
        let (mesh, n) = (page.page().progressive_mesh(), resident.position().vertices as usize);
        (0..)
            .zip(mesh.triangles)
            .filter(|(_, corners)| mesh.birth(**corners) <= n)
            .map(|(place, _)| place)
            .collect()
    }
}

/// The greatest single that is not above.
fn below(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

/// Triangles of a cluster that is drawn, or would be.
fn triangles_of(member: Member, scene: &Scene, arena: &mut Arena) -> u64 {
    let Member { cluster, vertices } = member;
    let drawn = arena.get(cluster).map(Resident::position);
    match (drawn.filter(|drawn| drawn.vertices == vertices), scene.page(cluster)) {
        (Some(drawn), _) => u64::from(drawn.triangles),
        (None, Some(page)) => arena.triangles_of(&page.page().progressive_mesh(), vertices),
        (None, None) => 0,
    }
}
