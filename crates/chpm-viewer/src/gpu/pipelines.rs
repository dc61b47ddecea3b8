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
    /// Depth in the map of shadows, as the light has it.
    Cast,
}

impl Kind {
    /// Whether triangles are drawn by their indices; otherwise the shader fetches them.
    pub fn is_indexed(self) -> bool {
        matches!(self, Kind::Depth | Kind::Cast | Kind::Bare(_) | Kind::Colored(_))
    }

    /// Words of the arguments of one draw.
    pub fn stride(self) -> usize {
        if self.is_indexed() { 5 } else { 4 }
    }

    /// Whether what is drawn into converts from linear colours.
    pub fn is_linear(self) -> bool {
        self.format().is_some_and(|format| format.is_srgb())
    }

    /// Whether light falls on it.
    pub fn is_lit(self) -> bool {
        !matches!(self, Kind::Depth | Kind::Cast | Kind::Identified)
    }

    /// Texture format of the output; none for depth alone.
    pub fn format(self) -> Option<TextureFormat> {
        match self {
            Kind::Depth | Kind::Cast => None,
            Kind::Bare(format) | Kind::Colored(format) | Kind::Painted(format) | Kind::Wired(format) => {
                Some(format)
            }
            Kind::Identified => Some(IDS),
        }
    }
}

/// Key of a pipeline: output, one-sided or not, clipped or not, with shadows or not, samples a pixel.
type Way = (Kind, bool, bool, bool, u32);

/// Changes of the shaders that draw clusters where shadows fall: of a smooth surface, how far a point is below the one that its normals stand for
/// takes one vector more from vertices to pixels.
const SHADED: [(&str, &str); 5] = [
    ("across: vec3<f32>,", "across: vec3<f32>,\n    @location(7) anchor: vec3<f32>,"),
    ("seen.across, seen.color", "seen.across, seen.anchor, seen.color"),
    (
        "    seen.color = PLAIN;",
        "    seen.anchor = bent(seen.at, seen.straight, seen.across);\n    seen.color = PLAIN;",
    ),
    ("light(facing_plane(seen.at), seen.at)", "shaded(facing_plane(seen.at), seen.at)"),
    (
        "light(smoothed(seen.at, seen.straight, seen.across), seen.at)",
        "shaded_smoothly(seen.at, seen.straight, seen.across, seen.anchor)",
    ),
];

/// The pipelines that draw clusters; made when they are first used.
#[derive(Debug)]
pub struct Pipelines {
    shader: wgpu::ShaderModule,
    /// The same for several samples a pixel, where that makes a difference.
    sampled: Option<wgpu::ShaderModule>,
    /// The same two with shadows; made when they are first used.
    shadowed: [Option<wgpu::ShaderModule>; 2],
    has_sheets: bool,
    layout: wgpu::PipelineLayout,
    /// Frame and draws.
    pub frame: wgpu::BindGroupLayout,
    /// A slab.
    pub slab: wgpu::BindGroupLayout,
    /// A texture of sheets; nothing else binds it.
    pub sheets: wgpu::BindGroupLayout,
    painted: wgpu::PipelineLayout,
    /// The map of shadows, and how it is looked up.
    pub shadows: wgpu::BindGroupLayout,
    /// The same two layouts with it.
    with_shadows: [wgpu::PipelineLayout; 2],
    /// Whether what is drawn next shows its front sides only.
    pub one_sided: bool,
    /// Whether what is drawn next is clipped.
    pub clipped: bool,
    /// Whether shadows fall on what is drawn next.
    pub shaded: bool,
    /// Whether vertices have colours.
    colors: bool,
    made: Vec<(Way, wgpu::RenderPipeline)>,
}

impl Pipelines {
    /// None yet, for files with or without colours, and with or without sheets.
    pub fn new(gpu: &Gpu, colors: bool, has_sheets: bool) -> Self {
        let device = &gpu.device;
        let shader = module(gpu, has_sheets, false, false);
        // A depth that is written is that of all samples of a pixel, unless each is looked at on its own.
        let sampled =
            (gpu.writes_depth() && gpu.multisamples()).then(|| module(gpu, has_sheets, true, false));
        let both = ShaderStages::VERTEX_FRAGMENT;
        let frame = layout(gpu, "frame", &[(both, UNIFORM), (ShaderStages::VERTEX, READ)]);
        let slab = layout(gpu, "clusters", &[(ShaderStages::VERTEX, READ)]);
        let pixels = ShaderStages::FRAGMENT;
        let sheets = layout(gpu, "sheets", &[(pixels, TEXTURE), (pixels, SAMPLER)]);
        let shadows = layout(gpu, "shadows", &[UNIFORM, DEPTH_MAP, COMPARES].map(|it| (pixels, it)));
        let of = |bind_group_layouts: &[Option<&wgpu::BindGroupLayout>]| {
            let label = Some("clusters");
            let descriptor = wgpu::PipelineLayoutDescriptor { label, bind_group_layouts, immediate_size: 0 };
            device.create_pipeline_layout(&descriptor)
        };
        let painted = of(&[Some(&frame), Some(&slab), Some(&sheets)]);
        let layout = of(&[Some(&frame), Some(&slab)]);
        let with_shadows =
            [None, Some(&sheets)].map(|it| of(&[Some(&frame), Some(&slab), it, Some(&shadows)]));
        Pipelines {
            shader,
            sampled,
            shadowed: [None, None],
            has_sheets,
            layout,
            frame,
            slab,
            sheets,
            painted,
            shadows,
            with_shadows,
            one_sided: false,
            clipped: false,
            shaded: false,
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

    fn make(&mut self, gpu: &Gpu, kind: Kind, samples: u32) -> wgpu::RenderPipeline {
        let apart = self.sampled.is_some() && samples > 1;
        let is_shaded = self.shaded && kind.is_lit();
        if is_shaded || kind == Kind::Cast {
            self.shadowed[usize::from(apart)]
                .get_or_insert_with(|| module(gpu, self.has_sheets, apart, true));
        }
        let shaded = self.shadowed[usize::from(apart)].as_ref().filter(|_| is_shaded || kind == Kind::Cast);
        let plain = self.sampled.as_ref().filter(|_| apart).unwrap_or(&self.shader);
        let shader = shaded.unwrap_or(plain);
        let is_painted = matches!(kind, Kind::Painted(_));
        let layout = match (is_shaded, is_painted) {
            (true, _) => &self.with_shadows[usize::from(is_painted)],
            (false, true) => &self.painted,
            (false, false) => &self.layout,
        };
        let (vertex, fragment) = match kind {
            Kind::Depth if self.clipped => ("bare", Some("deep_cut")),
            Kind::Depth => ("depth_only", gpu.writes_depth().then_some("deep")),
            Kind::Bare(_) => ("bare", Some("bared")),
            Kind::Colored(_) => ("indexed", Some("colored")),
            Kind::Painted(_) => ("pulled_painted", Some("painted")),
            Kind::Wired(_) => ("pulled", Some("wired")),
            Kind::Identified => ("pulled", Some("identified")),
            Kind::Cast if self.clipped => ("mapped_cut", Some("uncut")),
            Kind::Cast => ("mapped", None),
        };

        let target = [kind.format().map(wgpu::ColorTargetState::from)];
        let targets = if kind.format().is_none() { &[][..] } else { &target };
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
            layout: Some(layout),
            vertex: wgpu::VertexState {
                module: shader,
                entry_point: Some(vertex),
                compilation_options: options.clone(),
                buffers: if kind.is_indexed() { &vertices } else { &[] },
            },
            primitive: wgpu::PrimitiveState {
                // Light is stopped by both sides of a surface, whichever is drawn.
                cull_mode: (self.one_sided && kind != Kind::Cast).then_some(wgpu::Face::Back),
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
        (kind, self.one_sided, self.clipped, self.shaded && kind.is_lit(), samples)
    }

    /// A pipeline that was prepared.
    pub fn get(&self, kind: Kind, samples: u32) -> Option<&wgpu::RenderPipeline> {
        let wanted = self.way(kind, samples);
        self.made.iter().find(|(made, _)| *made == wanted).map(|(_, pipeline)| pipeline)
    }
}

/// The shaders that draw clusters: for pixels or for each sample of one, and with shadows or without.
fn module(gpu: &Gpu, has_sheets: bool, apart: bool, shaded: bool) -> wgpu::ShaderModule {
    let shown = include_str!("../shaders/depth_shown.wgsl");
    let kept = match (gpu.writes_depth(), apart) {
        (true, true) => [include_str!("../shaders/depth_sampled.wgsl"), shown],
        (true, false) => [include_str!("../shaders/depth_written.wgsl"), shown],
        (false, _) => [include_str!("../shaders/depth_kept.wgsl"), ""],
    };
    let sheets = if has_sheets { include_str!("../shaders/sheets.wgsl") } else { "" };
    let mut clusters = [include_str!("../shaders/clusters.wgsl"), sheets].concat();
    if shaded {
        for (plain, with_shadows) in SHADED {
            clusters = clusters.replace(plain, with_shadows);
        }
        clusters.push_str(include_str!("../shaders/shadows.wgsl"));
    }
    if apart {
        clusters = clusters.replace("@location(0) at:", "@location(0) @interpolate(perspective, sample) at:");
    }
    gpu.shader(&[camera_uniform::WGSL, kept[0], kept[1], &clusters])
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

/// Depth that is compared with.
pub const DEPTH_MAP: BindingType = BindingType::Texture {
    sample_type: wgpu::TextureSampleType::Depth,
    view_dimension: wgpu::TextureViewDimension::D2,
    multisampled: false,
};
/// How it is.
pub const COMPARES: BindingType = BindingType::Sampler(wgpu::SamplerBindingType::Comparison);

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shadows_find_what_they_change() {
        let clusters = include_str!("../shaders/clusters.wgsl");
        let sheets = include_str!("../shaders/sheets.wgsl");
        for (plain, _) in SHADED {
            assert!(clusters.contains(plain), "{plain}");
        }
        for plain in [SHADED[0].0, SHADED[1].0, SHADED[4].0] {
            assert!(sheets.contains(plain), "{plain}");
        }
    }
}
