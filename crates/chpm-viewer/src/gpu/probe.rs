//! The depth at one pixel: what is below the pointer.

use super::buffers::{Canvas, buffer, read};
use super::context::Gpu;
use super::pipelines::{DEPTH_TEXTURE, UNIFORM, WRITE, compute, group, layout};
use crate::error::ViewerError;
use wgpu::{BufferUsages, ShaderStages};

/// Reads single pixels of depth, which not every interface copies to a buffer.
#[derive(Debug)]
pub struct Probe {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    pixel: wgpu::Buffer,
    found: wgpu::Buffer,
    staging: wgpu::Buffer,
}

/// Bytes of a depth.
const DEPTH: u64 = 4;

impl Probe {
    /// For a device.
    pub fn new(gpu: &Gpu) -> Self {
        let shader = gpu.shader(&[include_str!("../shaders/probe.wgsl")]);
        let bindings = [UNIFORM, DEPTH_TEXTURE, WRITE].map(|binding| (ShaderStages::COMPUTE, binding));
        let layout = layout(gpu, "probe", &bindings);
        Probe {
            pipeline: compute(gpu, &[&layout], &shader, "look"),
            layout,
            pixel: buffer(gpu, "pixel", 16, BufferUsages::UNIFORM | BufferUsages::COPY_DST),
            found: buffer(gpu, "found", DEPTH, BufferUsages::STORAGE | BufferUsages::COPY_SRC),
            staging: buffer(gpu, "found", DEPTH, BufferUsages::COPY_DST | BufferUsages::MAP_READ),
        }
    }

    /// The depth at a pixel of an image.
    ///
    /// # Errors
    /// [`ViewerError::Device`].
    pub fn depth(&self, gpu: &Gpu, depth: &Canvas, [x, y]: [u32; 2]) -> Result<f32, ViewerError> {
        gpu.queue.write_buffer(&self.pixel, 0, bytemuck::bytes_of(&[x, y, 0, 0]));
        let bindings = [
            self.pixel.as_entire_binding(),
            wgpu::BindingResource::TextureView(depth.view()),
            self.found.as_entire_binding(),
        ];
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group(gpu, &self.layout, &bindings), &[]);
        pass.dispatch_workgroups(1, 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&self.found, 0, &self.staging, 0, DEPTH);
        gpu.queue.submit([encoder.finish()]);
        let bytes = read(gpu, &self.staging, DEPTH)?;
        Ok(bytemuck::pod_read_unaligned(&bytes))
    }
}
