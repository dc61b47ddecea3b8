//! A picture, drawn frame by frame: the loop of Quick-VDR 5.4.
//!
//! An interactive frame refines, draws what was visible before, has the boxes of the rest tested against that depth and what they
//! show drawn, all in one submission: nothing is read back before a later frame. A frame that waits repeats refining and testing, in
//! depth alone and with the answers at once, until nothing changes any more, and then draws what is visible. Of several models, each
//! has the camera in the coordinates of its own file, and all are drawn into one depth before anything is tested against it.

mod converge;
mod exact;
mod interactive;
mod model;
mod paint;
mod rate;
mod samples;
mod shade;
mod share;
mod smooth;

use crate::error::ViewerError;
use crate::gpu::buffers::{Canvas, Sampled};
use crate::gpu::lighting::Lighting;
use crate::gpu::{CameraUniform, Gpu, Probe, passes};
use crate::request::{Accuracy, Budgets, FrameRequest, Look, Target};
use crate::scene::Culling;
use crate::stats::Stats;
use crate::tint::Tint;
use crate::transform::Transform;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, Scalar};
use chpm_refine::{Camera, Changes, Outline, Portrait, Side, Up, told_by};
use converge::next_poe;
pub use exact::Spot;
use interactive::CacheKey;
use model::{Eye, Model};
use paint::Colors;
use rate::Rate;
use shade::Shade;
use share::{Need, budget_shares};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Models, and all that a picture of them needs.
#[derive(Debug)]
pub struct Viewer {
    gpu: Arc<Gpu>,
    /// One at least.
    models: Vec<Model>,
    /// Origin of the picture's coordinates where they are rounded.
    origin: [f64; 3],
    /// The box around all models, relative to that.
    bounds: Aabb,
    probe: Probe,
    /// Made when it is first used.
    lighting: Option<Lighting>,
    /// Shadows; nothing until they are first wanted.
    shade: Shade,
    depth: Option<Canvas>,
    /// Whether clusters that throw shadows were missing in the last frame.
    shadows_withheld: bool,
    /// For pictures of several samples.
    sampled: Option<Sampled>,
    canvas: Option<Canvas>,
    /// Of the last frame, for picking.
    camera_uniform: Option<CameraUniform>,
    /// Number of the round.
    now: u64,
    /// Of the last interactive frame.
    before: Option<Camera>,
    /// Picture of the last frame that was rendered until it converged.
    drawn: Option<CacheKey>,
    rate: Rate,
    /// Pixels of error that a number of triangles has led to.
    found: f64,
}

/// How far a refinement goes: how long it waits for pages, and how many bytes it brings for the GPU; none for all.
#[derive(Clone, Copy, Debug)]
struct Deadline {
    wait: Option<Duration>,
    most: Option<u64>,
}

impl Deadline {
    const NONE: Deadline = Deadline { wait: None, most: None };

    fn of(most: u64) -> Self {
        Deadline { wait: Some(Duration::ZERO), most: Some(most) }
    }

    /// For one of so many models.
    fn share(self, models: usize) -> Self {
        let models = models.max(1) as u32;
        Deadline {
            wait: self.wait.map(|wait| wait / models),
            most: self.most.map(|most| most / u64::from(models)),
        }
    }
}

impl Viewer {
    /// Opens a file; reads its tables and no page.
    ///
    /// # Errors
    /// [`ViewerError::Extmem`], [`ViewerError::File`], [`ViewerError::Budget`], [`ViewerError::Device`].
    pub fn open(gpu: Arc<Gpu>, path: &Path, budgets: Budgets) -> Result<Viewer, ViewerError> {
        Viewer::open_all(gpu, &[(path, Transform::STILL)], budgets)
    }

    /// Opens files for one picture, each put somewhere. They share the budgets: as much for each, but what one cannot use is left to the
    /// others.
    ///
    /// # Errors
    /// As [`Viewer::open`]; [`ViewerError::NoModel`].
    pub fn open_all(
        gpu: Arc<Gpu>,
        paths: &[(&Path, Transform)],
        budgets: Budgets,
    ) -> Result<Viewer, ViewerError> {
        Viewer::open_colored(gpu, paths, budgets, None)
    }

    /// As [`Viewer::open_all`], with vertices in the colours of a named scalar, in the range that each file tells of it; a file without it keeps
    /// its own colours.
    ///
    /// # Errors
    /// As [`Viewer::open_all`].
    pub fn open_colored(
        gpu: Arc<Gpu>,
        paths: &[(&Path, Transform)],
        budgets: Budgets,
        color_by: Option<&str>,
    ) -> Result<Viewer, ViewerError> {
        let files = paths.iter().map(|(path, _)| Model::file_of(path)).collect::<Result<Vec<_>, _>>()?;
        let tints: Vec<Tint> = files.iter().map(|file| Tint::of(file, color_by)).collect();
        let (in_memory, on_gpu): (Vec<Need>, Vec<Need>) =
            files.iter().zip(&tints).map(|(file, tint)| Model::needs(file, tint)).unzip();
        let memory = budget_shares("memory", budgets.memory, &in_memory)?;
        let gpu_memory = budget_shares("GPU memory", budgets.gpu_memory, &on_gpu)?;

        let mut models = Vec::with_capacity(files.len());
        for (place, (file, tint)) in files.into_iter().zip(tints).enumerate() {
            let budgets = Budgets { memory: memory[place], gpu_memory: gpu_memory[place] };
            models.push(Model::new(&gpu, file, tint, paths[place].1, budgets)?);
        }

        let probe = gpu.attempt("preparing shaders", || Probe::new(&gpu))?;
        let mut viewer = Viewer {
            origin: models.first().ok_or(ViewerError::NoModel)?.zero(),
            models,
            bounds: Aabb::of_points([]),
            probe,
            lighting: None,
            shade: Shade::default(),
            depth: None,
            shadows_withheld: false,
            sampled: None,
            canvas: None,
            camera_uniform: None,
            now: 0,
            before: None,
            drawn: None,
            rate: Rate::default(),
            found: 1.0,
            gpu,
        };
        viewer.bound();
        Ok(viewer)
    }

    fn bound(&mut self) {
        let mut all = Aabb::of_points([]);
        self.models.iter().for_each(|model| all.merge(&model.bounds_from(self.origin)));
        self.bounds = all;
    }

    /// Puts a model, from 0, somewhere: the next frame shows it there. Answers whether it was somewhere else.
    pub fn put(&mut self, model: usize, place: Transform) -> bool {
        let Some(model) = self.models.get_mut(model).filter(|model| model.place != place) else {
            return false;
        };
        model.place = place;
        self.drawn = None;
        self.bound();
        true
    }

    /// The scalar that colours show, of the first model that has it.
    pub fn scalar(&self) -> Option<&Scalar> {
        self.models.iter().find_map(|model| model.scene.tint().scalar())
    }

    /// The device that it draws with.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// The file of the first model.
    pub fn file(&self) -> &Arc<Chpm<MappedFile>> {
        self.models[0].scene.file()
    }

    /// The files of all models.
    pub fn files(&self) -> impl Iterator<Item = &Arc<Chpm<MappedFile>>> {
        self.models.iter().map(|model| model.scene.file())
    }

    /// Where each of them is.
    pub fn places(&self) -> impl Iterator<Item = Transform> {
        self.models.iter().map(|model| model.place)
    }

    /// Why some of a model stays coarser than frames that do not wait want it: the first of its pages that could not be read.
    pub fn damage(&self) -> Option<&ViewerError> {
        self.models.iter().find_map(|model| model.scene.damage())
    }

    /// The box around the models, relative to [`Viewer::origin`].
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Origin of the coordinates of boxes and outlines, in the picture's: that of the first file.
    pub fn origin(&self) -> [f64; 3] {
        self.origin
    }

    /// The camera that looks at the box around the model along the z axis, in the picture's coordinates.
    pub fn framing(&self) -> Camera {
        Camera::framing(&self.bounds()).relative_to(self.origin().map(|x| -x))
    }

    /// A coarse mesh of the models. Reads the pages of a level of each.
    ///
    /// # Errors
    /// [`ViewerError::Page`] for a file that is damaged.
    pub fn outline(&self) -> Result<Outline, ViewerError> {
        let mut all = self.models[0].outline(self.origin)?;
        for model in &self.models[1..] {
            all = all.joined(&model.outline(self.origin)?);
        }
        Ok(all)
    }

    /// How all of the models is looked at; what is told is not chosen. Relative to [`Viewer::origin`]. Where a terrain's
    /// heights are in another unit than its places, it is shown lower from now on, as [`Portrait::note`] says.
    ///
    /// # Errors
    /// [`ViewerError::Page`] for a file that is damaged.
    pub fn portrait(&mut self, up: Option<Up>, side: Option<Side>) -> Result<Portrait, ViewerError> {
        // One alone may say itself how it stands.
        let own = self.files().next().and_then(|file| file.metadata().ok());
        let own = own.filter(|_| self.models.len() == 1).map(|own| told_by(&own)).unwrap_or_default();
        let (up, side) = (up.or(own.0), side.or(own.1));
        let portrait = Portrait::new(self.outline()?, self.bounds(), up, side);
        let is_alone = self.models.len() == 1 && self.models[0].place.is_still();
        if !is_alone {
            return Ok(portrait);
        }
        let portrait = portrait.with_heights(self.origin(), up, side);
        if self.put(0, Transform::stretched(portrait.stretch())) {
            self.origin = self.models[0].zero();
            self.bound();
        }
        Ok(portrait)
    }

    /// So many cameras around it, each further to the right; in the picture's coordinates.
    pub fn turn(&self, portrait: &Portrait, viewport: [u32; 2], count: u32) -> Vec<Camera> {
        let cameras = portrait.turn(aspect(viewport), count);
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
        self.set_ways(&request.look, request.clip.is_some());
        let mut stats = if request.wait || request.select_from.is_some() {
            self.drawn = None;
            let mut stats = self.converge(request)?;
            let colors = self.colors(request, target);
            let samples = if request.wait { request.samples.max(1) } else { 1 };
            let first = samples::shifts(samples).next().unwrap_or_default();
            self.paint(request, Some(target.color), &colors, first, &mut stats)?;
            stats
        } else {
            self.interactive_frame(request, target)?
        };
        self.gpu.check("drawing")?;
        stats.times.total = start.elapsed();
        Ok(stats)
    }

    /// How the next draws are made.
    fn set_ways(&mut self, look: &Look, clipped: bool) {
        for Model { pipelines, .. } in &mut self.models {
            (pipelines.one_sided, pipelines.clipped) = (look.one_sided, clipped);
            pipelines.shaded = look.shadows;
        }
    }

    /// How each model looks.
    fn colors(&self, request: &FrameRequest, target: &Target<'_>) -> Vec<Colors> {
        self.models
            .iter()
            .enumerate()
            .map(|(place, model)| {
                let has = (model.has_colors(), model.has_sheets());
                Colors::new(&request.look, has, target.format).of_other(place > 0)
            })
            .collect()
    }

    fn check_size(&self, got: [u32; 2]) -> Result<(), ViewerError> {
        let limit = self.gpu.device.limits().max_texture_dimension_2d;
        let ok = got.iter().all(|side| (1..=limit).contains(side));
        if ok { Ok(()) } else { Err(ViewerError::Size { limit, got }) }
    }

    /// Camera uniform of a picture with this camera.
    fn camera_uniform(&self, camera: &Camera, request: &FrameRequest) -> CameraUniform {
        let (camera, bounds) = (camera.relative_to(self.origin), self.bounds);
        let camera_uniform =
            CameraUniform::new(&camera, request.viewport, &bounds).of_request(request, self.origin);
        // The smallest of the models may be looked at from as near as it can alone.
        let nears = self.models.iter().map(|model| {
            CameraUniform::new(&camera, request.viewport, &model.scene.file().header().aabb()).near()
        });
        camera_uniform.with_near(nears.reduce(f64::min).unwrap_or(camera_uniform.near()))
    }

    /// Eye of each model with this camera.
    fn eyes(&self, camera: &Camera, request: &FrameRequest, poe: f64) -> Result<Vec<Eye>, ViewerError> {
        let camera_uniform = self.camera_uniform(camera, request);
        self.models.iter().map(|model| model.eye(camera, &camera_uniform, request, poe)).collect()
    }

    fn culling(&self, request: &FrameRequest) -> Culling {
        Culling { frustum: request.frustum_culling, occlusion: request.occlusion_culling }
    }

    fn pixels_of_error(&self, accuracy: Accuracy) -> f64 {
        match accuracy {
            Accuracy::PoE(pixels) => pixels,
            Accuracy::Triangles(_) => self.found,
        }
    }

    /// Selects for each model, up to the cut.
    fn refine(
        &mut self,
        eyes: &[Eye],
        deadline: Deadline,
        stats: &mut Stats,
    ) -> Result<Changes, ViewerError> {
        // What all want is asked for before anything is waited for.
        for (model, eye) in self.models.iter_mut().zip(eyes) {
            model.want(eye, stats)?;
        }
        let deadline = deadline.share(self.models.len());
        let mut all = Changes::default();
        for (model, eye) in self.models.iter_mut().zip(eyes) {
            let changes = model.refine(eye, deadline, stats)?;
            all.splits += changes.splits;
            all.collapses += changes.collapses;
            all.pm_steps += changes.pm_steps;
        }
        Ok(all)
    }

    fn count(&mut self, stats: &mut Stats) {
        self.models.iter_mut().for_each(|model| model.count(stats));
    }

    /// The point of a model that was seen at a pixel (column and row from the top) of the last frame, in the picture's coordinates;
    /// `None` for the background and outside the image.
    ///
    /// # Errors
    /// [`ViewerError::Device`].
    pub fn pick(&self, pixel: [u32; 2]) -> Result<Option<[f64; 3]>, ViewerError> {
        let (Some(camera_uniform), Some(depth)) = (&self.camera_uniform, &self.depth) else {
            return Ok(None);
        };
        let [width, height] = depth.size();
        if pixel[0] >= width || pixel[1] >= height {
            return Ok(None);
        }
        let depth = self.probe.depth(&self.gpu, depth, pixel)?;
        Ok(camera_uniform
            .point(pixel, depth)
            .map(|point| std::array::from_fn(|axis| point[axis] + self.origin[axis])))
    }
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

fn aspect(viewport: [u32; 2]) -> f64 {
    f64::from(viewport[0]) / f64::from(viewport[1].max(1))
}
