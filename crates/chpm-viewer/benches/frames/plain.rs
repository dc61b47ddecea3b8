//! Vertices and indices drawn as plainly as can be: what the viewer's way is measured against.

use crate::film::FORMAT;
use chpm_viewer::Gpu;
use chpm_viewer::internals::buffers::buffer;
use chpm_viewer::internals::camera_uniform::{FrameUniform, WGSL};
use wgpu::BufferUsages;

const SHADER: &str = "
struct Seen { @builtin(position) position: vec4<f32>, @location(0) at: vec3<f32> }
@vertex fn vertex(@location(0) position: vec3<f32>) -> Seen {
    let at = relative(position);
    return Seen(project(at), at);
}
@fragment fn fragment(seen: Seen) -> @location(0) vec4<f32> {
    let normal = normalize(cross(dpdx(seen.at), dpdy(seen.at)));
    return vec4(vec3(0.78, 0.76, 0.72) * light(normal, seen.at), 1.0);
}";

/// A pipeline that draws flat triangles of positions, 12 bytes each.
pub(crate) struct Plain {
    pipeline: wgpu::RenderPipeline,
    uniform: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl Plain {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let device = &gpu.device;
        let shader = gpu.shader(&[WGSL, SHADER]);
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("vertex"),
                compilation_options: Default::default(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: 12,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x3],
                })],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: wgpu::TextureFormat::Depth32Float,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader,
                entry_point: Some("fragment"),
                compilation_options: Default::default(),
                targets: &[Some(FORMAT.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let size = size_of::<FrameUniform>() as u64;
        let uniform = buffer(gpu, "frame", size, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() }],
        });
        Plain { pipeline, uniform, group }
    }

    pub(crate) fn look_through(&self, gpu: &Gpu, uniform: &FrameUniform) {
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(uniform));
    }

    /// Makes a pass draw from these buffers.
    pub(crate) fn set(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        vertices: &wgpu::Buffer,
        (indices, format): (&wgpu::Buffer, wgpu::IndexFormat),
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.set_index_buffer(indices.slice(..), format);
    }
}
