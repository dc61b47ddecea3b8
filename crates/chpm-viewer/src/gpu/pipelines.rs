//! Shaders, what they are bound to, and the pipelines made of them.

use super::block::words_of_unit;
use super::camera_uniform;
use super::context::Gpu;
use crate::error::ViewerError;
use wgpu::{BindingType, BufferBindingType, CompareFunction, ShaderStages, TextureFormat, VertexFormat};

/// Format of all depth.
pub const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// Format of ids.
pub const IDS: TextureFormat = TextureFormat::R32Uint;

/// Output of a draw.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    /// Depth alone.
    Depth,
    /// One colour for each draw, by the planes of triangles.
    Bare(TextureFormat),
    /// Colours, or normals, of vertices.
    Colored(TextureFormat),
    /// Colours of sheets; of vertices where a cluster has no sheet.
    Painted(TextureFormat),
    /// Colours of triangles, or with their edges.
    Wired(TextureFormat),
    /// Ids.
    Identified,
}

impl Kind {
    /// Whether triangles are drawn by their indices; otherwise the shader fetches them.
    pub fn is_indexed(self) -> bool {
        matches!(self, Kind::Depth | Kind::Bare(_) | Kind::Colored(_))
    }

    /// Words of the arguments of one draw.
    pub fn stride(self) -> usize {
        if self.is_indexed() { 5 } else { 4 }
    }

    /// Whether what is drawn into converts from linear colours.
    pub fn is_linear(self) -> bool {
        self.format().is_some_and(|format| format.is_srgb())
    }

    /// Texture format of the output; none for depth alone.
    pub fn format(self) -> Option<TextureFormat> {
        match self {
            Kind::Depth => None,
            Kind::Bare(format) | Kind::Colored(format) | Kind::Painted(format) | Kind::Wired(format) => {
                Some(format)
            }
            Kind::Identified => Some(IDS),
        }
    }
}

/// Key of a pipeline: output, one-sided or not, clipped or not, samples a pixel.
type Way = (Kind, bool, bool, u32);

/// The pipelines that draw clusters; made when they are first used.
#[derive(Debug)]
pub struct Pipelines {
    shader: wgpu::ShaderModule,
    /// The same for several samples a pixel, where that makes a difference.
    sampled: Option<wgpu::ShaderModule>,
    layout: wgpu::PipelineLayout,
    /// Frame and draws.
    pub frame: wgpu::BindGroupLayout,
    /// A slab.
    pub slab: wgpu::BindGroupLayout,
    /// A texture of sheets; nothing else binds it.
    pub sheets: wgpu::BindGroupLayout,
    painted: wgpu::PipelineLayout,
    /// Whether what is drawn next shows its front sides only.
    pub one_sided: bool,
    /// Whether what is drawn next is clipped.
    pub clipped: bool,
    /// Whether vertices have colours.
    colors: bool,
    made: Vec<(Way, wgpu::RenderPipeline)>,
}

impl Pipelines {
    /// None yet, for files with or without colours, and with or without sheets.
    pub fn new(gpu: &Gpu, colors: bool, has_sheets: bool) -> Self {
        let device = &gpu.device;
        let shown = include_str!("../shaders/depth_shown.wgsl");
        let kept = match gpu.writes_depth() {
            true => [include_str!("../shaders/depth_written.wgsl"), shown],
            false => [include_str!("../shaders/depth_kept.wgsl"), ""],
        };
        let sheets = if has_sheets { include_str!("../shaders/sheets.wgsl") } else { "" };
        let clusters = &[include_str!("../shaders/clusters.wgsl"), sheets].concat();
        let shader = gpu.shader(&[camera_uniform::WGSL, kept[0], kept[1], clusters]);
        // A depth that is written is that of all samples of a pixel, unless each is looked at on its own.
        let sampled = (gpu.writes_depth() && gpu.multisamples()).then(|| {
            let apart = "@location(0) @interpolate(perspective, sample) at:";
            let kept = include_str!("../shaders/depth_sampled.wgsl");
            gpu.shader(&[camera_uniform::WGSL, kept, shown, &clusters.replace("@location(0) at:", apart)])
        });
        let both = ShaderStages::VERTEX_FRAGMENT;
        let frame = layout(gpu, "frame", &[(both, UNIFORM), (ShaderStages::VERTEX, READ)]);
        let slab = layout(gpu, "clusters", &[(ShaderStages::VERTEX, READ)]);
        let pixels = ShaderStages::FRAGMENT;
        let sheets = layout(gpu, "sheets", &[(pixels, TEXTURE), (pixels, SAMPLER)]);
        let of = |bind_group_layouts: &[Option<&wgpu::BindGroupLayout>]| {
            let label = Some("clusters");
            let descriptor = wgpu::PipelineLayoutDescriptor { label, bind_group_layouts, immediate_size: 0 };
            device.create_pipeline_layout(&descriptor)
        };
        let painted = of(&[Some(&frame), Some(&slab), Some(&sheets)]);
        let layout = of(&[Some(&frame), Some(&slab)]);
        Pipelines {
            shader,
            sampled,
            layout,
            frame,
            slab,
            sheets,
            painted,
            one_sided: false,
            clipped: false,
            colors,
            made: Vec::new(),
        }
    }

    /// Bytes of a vertex.
    pub fn unit(&self) -> u64 {
        4 * u64::from(words_of_unit(self.colors))
    }

    /// Makes a pipeline for targets of so many samples a pixel, if there is none yet.
    ///
    /// # Errors
    /// [`ViewerError::Device`] where the driver refuses it.
    pub fn prepare(&mut self, gpu: &Gpu, kind: Kind, samples: u32) -> Result<(), ViewerError> {
        if self.get(kind, samples).is_none() {
            let pipeline = gpu.attempt("making a pipeline that draws", || self.make(gpu, kind, samples))?;
            self.made.push((self.way(kind, samples), pipeline));
        }
        Ok(())
    }

    fn make(&self, gpu: &Gpu, kind: Kind, samples: u32) -> wgpu::RenderPipeline {
        let shader = self.sampled.as_ref().filter(|_| samples > 1).unwrap_or(&self.shader);
        let (vertex, fragment) = match kind {
            Kind::Depth if self.clipped => ("bare", Some("deep_cut")),
            Kind::Depth => ("depth_only", gpu.writes_depth().then_some("deep")),
            Kind::Bare(_) => ("bare", Some("bared")),
            Kind::Colored(_) => ("indexed", Some("colored")),
            Kind::Painted(_) => ("pulled_painted", Some("painted")),
            Kind::Wired(_) => ("pulled", Some("wired")),
            Kind::Identified => ("pulled", Some("identified")),
        };

        let target = [kind.format().map(wgpu::ColorTargetState::from)];
        let targets = if kind == Kind::Depth { &[][..] } else { &target };
        // Decided here, since a processor that draws would decide for each pixel, and do both.
        let constants = [
            ("unit", f64::from(words_of_unit(self.colors))),
            ("to_linear", f64::from(u8::from(kind.is_linear()))),
            ("clipped", f64::from(u8::from(self.clipped))),
        ];
        let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };

        // Vertices as blocks have them, where triangles have indices.
        fn attribute(shader_location: u32, format: VertexFormat, offset: u64) -> wgpu::VertexAttribute {
            wgpu::VertexAttribute { format, offset, shader_location }
        }
        // Where there are no colours, nothing looks at them.
        let attributes = [
            attribute(0, VertexFormat::Float32x3, 0),
            attribute(1, VertexFormat::Uint32, 12),
            attribute(2, VertexFormat::Unorm8x4, if self.colors { 16 } else { 12 }),
        ];
        let vertices = [Some(wgpu::VertexBufferLayout {
            array_stride: self.unit(),
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &attributes,
        })];

        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("clusters"),
            layout: Some(if matches!(kind, Kind::Painted(_)) { &self.painted } else { &self.layout }),
            vertex: wgpu::VertexState {
                module: shader,
                entry_point: Some(vertex),
                compilation_options: options.clone(),
                buffers: if kind.is_indexed() { &vertices } else { &[] },
            },
            primitive: wgpu::PrimitiveState {
                cull_mode: self.one_sided.then_some(wgpu::Face::Back),
                ..wgpu::PrimitiveState::default()
            },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(CompareFunction::Greater),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
            fragment: fragment.map(|entry_point| wgpu::FragmentState {
                module: shader,
                entry_point: Some(entry_point),
                compilation_options: options,
                targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }

    fn way(&self, kind: Kind, samples: u32) -> Way {
        (kind, self.one_sided, self.clipped, samples)
    }

    /// A pipeline that was prepared.
    pub fn get(&self, kind: Kind, samples: u32) -> Option<&wgpu::RenderPipeline> {
        let wanted = self.way(kind, samples);
        self.made.iter().find(|(made, _)| *made == wanted).map(|(_, pipeline)| pipeline)
    }
}

/// A uniform.
pub const UNIFORM: BindingType =
    BindingType::Buffer { ty: BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size: None };
/// Storage that is read.
pub const READ: BindingType = BindingType::Buffer {
    ty: BufferBindingType::Storage { read_only: true },
    has_dynamic_offset: false,
    min_binding_size: None,
};
/// Storage that is written.
pub const WRITE: BindingType = BindingType::Buffer {
    ty: BufferBindingType::Storage { read_only: false },
    has_dynamic_offset: false,
    min_binding_size: None,
};
/// Depth that is read.
pub const DEPTH_TEXTURE: BindingType = BindingType::Texture {
    // What a depth texture may be bound as, and what every interface can read texel by texel.
    sample_type: wgpu::TextureSampleType::Float { filterable: false },
    view_dimension: wgpu::TextureViewDimension::D2,
    multisampled: false,
};

/// Colours that are read between their texels.
pub const TEXTURE: BindingType = BindingType::Texture {
    sample_type: wgpu::TextureSampleType::Float { filterable: true },
    view_dimension: wgpu::TextureViewDimension::D2,
    multisampled: false,
};
/// How they are.
pub const SAMPLER: BindingType = BindingType::Sampler(wgpu::SamplerBindingType::Filtering);

/// A pipeline that computes; `entry` names the function and the pipeline.
pub fn compute(
    gpu: &Gpu,
    groups: &[&wgpu::BindGroupLayout],
    shader: &wgpu::ShaderModule,
    entry: &str,
) -> wgpu::ComputePipeline {
    let groups: Vec<_> = groups.iter().map(|group| Some(*group)).collect();
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(entry),
        bind_group_layouts: &groups,
        immediate_size: 0,
    });
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&layout),
        module: shader,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

/// A layout of bindings 0, 1, 2 and so on.
pub fn layout(gpu: &Gpu, label: &str, bindings: &[(ShaderStages, BindingType)]) -> wgpu::BindGroupLayout {
    fn entry((binding, (visibility, ty)): (u32, &(ShaderStages, BindingType))) -> wgpu::BindGroupLayoutEntry {
        wgpu::BindGroupLayoutEntry { binding, visibility: *visibility, ty: *ty, count: None }
    }
    let entries: Vec<_> = (0..).zip(bindings).map(entry).collect();
    gpu.device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

/// A group of bindings 0, 1, 2 and so on.
pub fn group<'a>(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    bindings: &[wgpu::BindingResource<'a>],
) -> wgpu::BindGroup {
    let entries = (0..)
        .zip(bindings)
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() });
    let entries: Vec<_> = entries.collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}
