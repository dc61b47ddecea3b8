//! Which boxes may be seen, asked of the depth that was drawn so far.
//!
//! A pyramid of farthest depths is made of the depth buffer; a box is hidden if its nearest corner is farther than the farthest depth in all
//! of the few texels, of the level of its size, that its image covers. It is visible where the near plane cuts it. All answers err to
//! the side of "visible", and a box inside another one is never visible where that one is not.

use super::buffers::{Canvas, Growing, buffer, read};
use super::camera_uniform;
use super::context::Gpu;
use super::passes::DrawBuffers;
use super::pipelines::{DEPTH_TEXTURE, Kind, READ, UNIFORM, WRITE, compute, group, layout};
use crate::error::ViewerError;
use bytemuck::{Pod, Zeroable};
use chpm_refine::Region;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use wgpu::{BufferUsages, ShaderStages};

/// A box to test; see `occlusion.wgsl`.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct TestBox {
    low: [f32; 3],
    draw: u32,
    high: [f32; 3],
    unused: u32,
}

impl TestBox {
    /// By how much a box is widened on every side, relative to the sum of its sides.
    const WIDER: f32 = 1e-3;
    /// The same relative to its coordinates: twice the rounding of one.
    const ROUNDING: f32 = f32::EPSILON;
    const NONE: u32 = u32::MAX;

    /// A box in file coordinates, a little widened; if it is visible, the draw is shown.
    pub fn new(low: [f32; 3], high: [f32; 3], draw: Option<usize>) -> Self {
        let margin = Self::WIDER * (0..3).map(|axis| high[axis] - low[axis]).sum::<f32>();
        TestBox {
            low: low.map(|x| x - (margin + Self::ROUNDING * x.abs())),
            draw: draw.map_or(Self::NONE, |draw| draw as u32),
            high: high.map(|x| x + (margin + Self::ROUNDING * x.abs())),
            unused: 0,
        }
    }

    /// The box of a region.
    pub fn of_region(region: &Region) -> Self {
        // From file coordinates, which are f32.
        TestBox::new(region.low.map(|x| x as f32), region.high.map(|x| x as f32), None)
    }
}

/// Levels that the shader has room for: images of up to 2^15 pixels a side.
const LEVELS: usize = 16;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Params {
    boxes: u32,
    stride: u32,
    levels: u32,
    unused: u32,
    level: [[u32; 4]; LEVELS],
}

impl Params {
    /// For an image of this size, and the texels of its pyramid.
    fn new([mut width, mut height]: [u32; 2], boxes: usize, kind: Kind) -> (Self, u32) {
        let (boxes, stride) = (boxes as u32, kind.stride() as u32);
        let mut params = Params { boxes, stride, levels: 1, unused: 0, level: [[0; 4]; LEVELS] };
        params.level[0] = [width, height, 0, 0];
        let mut texels = 0;
        while (width > 1 || height > 1) && (params.levels as usize) < LEVELS {
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
            params.level[params.levels as usize] = [width, height, texels, 0];
            params.levels += 1;
            texels += width * height;
        }
        (params, texels)
    }
}

/// The test, and the pyramid for images of one size.
#[derive(Debug)]
pub struct Occlusion {
    layout: wgpu::BindGroupLayout,
    reduce: wgpu::ComputePipeline,
    test: wgpu::ComputePipeline,
    /// By level, from 1: which one it is.
    steps: Vec<wgpu::BindGroup>,
    params: wgpu::Buffer,
    boxes: Growing,
    flags: Growing,
    pyramid: Growing,
    /// Buffers for answers, that are not on their way.
    idle: Vec<wgpu::Buffer>,
}

/// Boxes to test.
#[derive(Clone, Copy, Debug)]
pub struct Questions<'a> {
    /// Depths that were drawn so far.
    pub depth: &'a Canvas,
    /// Boxes that may be hidden behind them.
    pub boxes: &'a [TestBox],
    /// The camera, and the draws that boxes show.
    pub draws: &'a DrawBuffers,
    /// Output of these draws.
    pub kind: Kind,
}

/// Answers that are on their way.
#[derive(Debug)]
pub struct Answers {
    staging: wgpu::Buffer,
    count: usize,
    /// That they are there, and whether mapping failed.
    there: Arc<AtomicBool>,
    failed: Arc<AtomicBool>,
}

impl Occlusion {
    /// For a device.
    pub fn new(gpu: &Gpu) -> Self {
        let shader = gpu.shader(&[camera_uniform::WGSL, include_str!("../shaders/occlusion.wgsl")]);

        let bindings = [UNIFORM, UNIFORM, DEPTH_TEXTURE, WRITE, READ, WRITE, WRITE];
        let main = layout(gpu, "occlusion", &bindings.map(|binding| (ShaderStages::COMPUTE, binding)));
        let step = layout(gpu, "level", &[(ShaderStages::COMPUTE, UNIFORM)]);
        let pipeline = |entry| compute(gpu, &[&main, &step], &shader, entry);

        let steps = (0..LEVELS as u32).map(|level| {
            let uniform = buffer(gpu, "level", 16, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
            gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&[level, 0, 0, 0]));
            group(gpu, &step, &[uniform.as_entire_binding()])
        });

        let size = size_of::<Params>() as u64;
        Occlusion {
            steps: steps.collect(),
            reduce: pipeline("reduce"),
            test: pipeline("test"),
            layout: main,
            params: buffer(gpu, "occlusion", size, BufferUsages::UNIFORM | BufferUsages::COPY_DST),
            boxes: Growing::new(gpu, "boxes", BufferUsages::STORAGE),
            flags: Growing::new(gpu, "flags", BufferUsages::STORAGE | BufferUsages::COPY_SRC),
            pyramid: Growing::new(gpu, "pyramid", BufferUsages::STORAGE),
            idle: Vec::new(),
        }
    }

    /// Records tests: what boxes show is switched on in the arguments of its draw, and the answers are on their way once the encoder was
    /// submitted and [`Answers::send`] called.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        questions: &Questions<'_>,
    ) -> Answers {
        let Questions { depth, boxes, draws, kind } = *questions;
        let (params, texels) = Params::new(depth.size(), boxes.len(), kind);

        // What the tests read and write, with room for it.
        let bytes = 4 * boxes.len() as u64;
        gpu.queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&params));
        self.boxes.write(gpu, bytemuck::cast_slice(boxes));
        self.flags.reserve(gpu, bytes);
        self.pyramid.reserve(gpu, 4 * u64::from(texels));
        let bound = group(
            gpu,
            &self.layout,
            &[
                draws.uniform().as_entire_binding(),
                self.params.as_entire_binding(),
                wgpu::BindingResource::TextureView(depth.view()),
                self.pyramid.get().as_entire_binding(),
                self.boxes.get().as_entire_binding(),
                self.flags.get().as_entire_binding(),
                draws.arguments().as_entire_binding(),
            ],
        );

        // The pyramid, level by level, and then all boxes at once.
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, &bound, &[]);
        pass.set_pipeline(&self.reduce);
        for level in 1..params.levels as usize {
            let [width, height, ..] = params.level[level];
            pass.set_bind_group(1, &self.steps[level], &[]);
            pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        }
        pass.set_bind_group(1, &self.steps[0], &[]);
        pass.set_pipeline(&self.test);
        pass.dispatch_workgroups(params.boxes.div_ceil(64), 1, 1);
        drop(pass);

        // A buffer for the answers that no other answers are on their way in.
        let place = self.idle.iter().position(|idle| idle.size() >= bytes);
        let staging = place.map(|place| self.idle.swap_remove(place)).unwrap_or_else(|| {
            let size = bytes.max(256).next_power_of_two();
            buffer(gpu, "answers", size, BufferUsages::COPY_DST | BufferUsages::MAP_READ)
        });
        encoder.copy_buffer_to_buffer(self.flags.get(), 0, &staging, 0, bytes);
        fn flag() -> Arc<AtomicBool> {
            Arc::new(AtomicBool::new(false))
        }
        Answers { staging, count: boxes.len(), there: flag(), failed: flag() }
    }

    /// The answers if they are there: by box, whether it may be seen. Gives them back if not.
    pub fn try_take(&mut self, answers: Answers) -> Result<Vec<bool>, Answers> {
        if !answers.there.load(Ordering::Acquire) {
            return Err(answers);
        }
        if answers.failed.load(Ordering::Acquire) {
            // A lost device says so elsewhere; until then everything is visible.
            return Ok(vec![true; answers.count]);
        }
        let bytes = 4 * answers.count as u64;
        let flags = match answers.staging.slice(..bytes).get_mapped_range() {
            Ok(view) => bytemuck::cast_slice::<u8, u32>(&view).iter().map(|flag| *flag != 0).collect(),
            Err(_) => vec![true; answers.count],
        };
        answers.staging.unmap();
        self.idle.push(answers.staging);
        Ok(flags)
    }

    /// Waits for the answers, which [`Answers::send`] was not called for.
    ///
    /// # Errors
    /// [`ViewerError::Device`].
    pub fn wait(&mut self, gpu: &Gpu, answers: Answers) -> Result<Vec<bool>, ViewerError> {
        let bytes = read(gpu, &answers.staging, 4 * answers.count as u64)?;
        self.idle.push(answers.staging);
        Ok(bytemuck::cast_slice::<u8, u32>(&bytes).iter().map(|flag| *flag != 0).collect())
    }
}

impl Answers {
    /// Has them sent, after the tests were submitted. They come with some later poll of the device.
    pub fn send(&self) {
        let (there, failed) = (Arc::clone(&self.there), Arc::clone(&self.failed));
        self.staging.slice(..4 * self.count as u64).map_async(wgpu::MapMode::Read, move |result| {
            failed.store(result.is_err(), Ordering::Release);
            there.store(true, Ordering::Release);
        });
    }
}
