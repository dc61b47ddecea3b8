//! Lighting of a picture that is drawn: corners and the ground below the model are darker.

use super::buffers::{Canvas, buffer};
use super::camera_uniform::{self, FrameUniform};
use super::context::Gpu;
use super::pipelines::{DEPTH_TEXTURE, UNIFORM, group, layout};
use wgpu::{BlendComponent, BlendFactor, BlendOperation, BufferUsages, ShaderStages, TextureFormat};

/// A pass over a picture and its depth.
#[derive(Debug)]
pub struct Lighting {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
    format: TextureFormat,
    uniform: wgpu::Buffer,
}

impl Lighting {
    /// For pictures of a format.
    pub fn new(gpu: &Gpu, format: TextureFormat) -> Self {
        let shader = gpu.shader(&[camera_uniform::WGSL, include_str!("../shaders/lighting.wgsl")]);
        let layout =
            layout(gpu, "lighting", &[UNIFORM, DEPTH_TEXTURE].map(|it| (ShaderStages::FRAGMENT, it)));
        let whole = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("lighting"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        // What is there, times what the pass finds.
        let times = BlendComponent {
            src_factor: BlendFactor::Zero,
            dst_factor: BlendFactor::Src,
            operation: BlendOperation::Add,
        };
        let target = wgpu::ColorTargetState {
            format,
            blend: Some(wgpu::BlendState { color: times, alpha: times }),
            write_mask: wgpu::ColorWrites::ALL,
        };
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("lighting"),
            layout: Some(&whole),
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("everywhere"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader,
                entry_point: Some("contact"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(target)],
            }),
            multiview_mask: None,
            cache: None,
        });
        let size = size_of::<FrameUniform>() as u64;
        let uniform = buffer(gpu, "lighting", size, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        Lighting { layout, pipeline, format, uniform }
    }

    /// The format of the pictures.
    pub fn format(&self) -> TextureFormat {
        self.format
    }

    /// Records the pass; what it is seen through takes effect with the submission.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        color: &wgpu::TextureView,
        depth: &Canvas,
        uniform: &FrameUniform,
    ) {
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(uniform));
        let bound = group(
            gpu,
            &self.layout,
            &[self.uniform.as_entire_binding(), wgpu::BindingResource::TextureView(depth.view())],
        );
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("lighting"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bound, &[]);
        pass.draw(0..3, 0..1);
    }
}
