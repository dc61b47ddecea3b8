//! Lists of clusters to draw, and passes that draw them.

use super::arena::{Arena, Position, Resident};
use super::buffers::Growing;
use super::context::Gpu;
use super::pipelines::{Kind, Pipelines, group};
use super::sheets::Sheets;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::ClusterId;
use std::ops::Range;
use wgpu::{BufferUsages, Features};

/// One cluster to draw; see `clusters.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Draw {
    vertices: u32,
    corners: u32,
    key: u32,
    tint: u32,
}

/// Mark on a draw, beside its shape.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mark {
    key: u32,
    tint: u32,
    /// The texture that its sheet is in.
    texture: Option<usize>,
}

impl Mark {
    /// Id of the first triangle, and the colour where colours are of clusters: red, green, blue.
    pub fn tinted(key: u32, [r, g, b]: [u8; 3]) -> Self {
        Mark { key, tint: u32::from_le_bytes([r, g, b, 255]), texture: None }
    }

    /// A sheet in a texture, by what [`Resident::sheet`] answers.
    pub fn painted(texture: usize, [sheet, numbers]: [u32; 2]) -> Self {
        Mark { key: numbers, tint: sheet, texture: Some(texture) }
    }
}

/// Draws one after the other, those of one slab together.
#[derive(Debug)]
pub struct DrawList {
    kind: Kind,
    draws: Vec<Draw>,
    /// Arguments, as many words for each as the kind has.
    arguments: Vec<u32>,
    /// The slab of some draws in a row, and the texture of those that have a sheet.
    runs: Vec<(usize, Option<usize>, Range<u32>)>,
    /// By draw: the cluster, and whether it is shown in any case.
    clusters: Vec<(ClusterId, bool)>,
    triangles: u64,
}

impl Default for DrawList {
    /// Nothing to draw.
    fn default() -> Self {
        DrawList::new(Kind::Depth)
    }
}

impl DrawList {
    /// Nothing to draw.
    pub fn new(kind: Kind) -> Self {
        DrawList {
            kind,
            draws: Vec::new(),
            arguments: Vec::new(),
            runs: Vec::new(),
            clusters: Vec::new(),
            triangles: 0,
        }
    }

    /// Nothing to draw, in the memory of what was.
    pub fn restart(&mut self, kind: Kind) {
        self.kind = kind;
        self.draws.clear();
        self.arguments.clear();
        self.runs.clear();
        self.clusters.clear();
        self.triangles = 0;
    }

    /// Adds a cluster at the position that it is at. One that is not `shown` is drawn only if a test of its box shows it.
    pub fn push(&mut self, cluster: ClusterId, resident: &Resident, mark: Mark, shown: bool) {
        let index = self.draws.len() as u32;
        let Position { triangles, .. } = resident.position();
        self.clusters.push((cluster, shown));

        // What shaders look up by the number of the draw.
        let (first, corners) = (resident.first, resident.first_corner());
        self.draws.push(Draw { vertices: first, corners, key: mark.key, tint: mark.tint });

        // One instance where it is shown; a test sets it where not.
        let (count, instances) = (3 * triangles, u32::from(shown));
        if self.kind.is_indexed() {
            self.arguments.extend([count, instances, corners, first, index]);
        } else {
            self.arguments.extend([count, instances, 0, index]);
        }
        if shown {
            self.triangles += u64::from(triangles);
        }

        // Draws of one slab, and of one texture, are bound together.
        match self.runs.last_mut() {
            Some((slab, texture, range))
                if *slab == resident.slab
                    && (texture.is_none() || mark.texture.is_none() || *texture == mark.texture) =>
            {
                *texture = texture.or(mark.texture);
                range.end = index + 1;
            }
            _ => self.runs.push((resident.slab, mark.texture, index..index + 1)),
        }
    }

    /// By draw: the cluster, and whether it is shown in any case.
    pub fn clusters(&self) -> impl Iterator<Item = (ClusterId, bool)> + '_ {
        self.clusters.iter().copied()
    }

    /// Number of draws.
    pub fn count(&self) -> usize {
        self.draws.len()
    }

    /// Triangles of the draws that are shown in any case.
    pub fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Output of the draws.
    pub fn kind(&self) -> Kind {
        self.kind
    }
}

/// Draws of a pass, with their resources.
#[derive(Clone, Copy, Debug)]
pub struct Drawn<'a> {
    /// How; a pipeline that was prepared.
    pub pipeline: Option<&'a wgpu::RenderPipeline>,
    /// Where clusters are.
    pub arena: &'a Arena,
    /// Which.
    pub list: &'a DrawList,
    /// Their sheets.
    pub sheets: Option<&'a Sheets>,
    /// The map of shadows that falls on them, where the pipeline is one with shadows.
    pub shadows: Option<&'a wgpu::BindGroup>,
}

/// The buffers of a list on the GPU.
#[derive(Debug)]
pub struct DrawBuffers {
    uniform: wgpu::Buffer,
    draws: Growing,
    arguments: Growing,
    group: wgpu::BindGroup,
}

impl DrawBuffers {
    /// Empty ones.
    pub fn new(gpu: &Gpu, pipelines: &Pipelines) -> Self {
        let size = size_of::<super::camera_uniform::FrameUniform>() as u64;
        let uniform =
            super::buffers::buffer(gpu, "frame", size, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        let draws = Growing::new(gpu, "draws", BufferUsages::STORAGE);
        let arguments = Growing::new(gpu, "arguments", BufferUsages::STORAGE | BufferUsages::INDIRECT);
        let group = bind(gpu, pipelines, &uniform, &draws);
        DrawBuffers { uniform, draws, arguments, group }
    }

    /// Sends a list and what it is seen through.
    pub fn write(
        &mut self,
        gpu: &Gpu,
        pipelines: &Pipelines,
        list: &DrawList,
        uniform: &super::camera_uniform::FrameUniform,
    ) {
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(uniform));
        self.arguments.write(gpu, bytemuck::cast_slice(&list.arguments));
        if self.draws.write(gpu, bytemuck::cast_slice(&list.draws)) {
            self.group = bind(gpu, pipelines, &self.uniform, &self.draws);
        }
    }

    /// The uniform.
    pub fn uniform(&self) -> &wgpu::Buffer {
        &self.uniform
    }

    /// The arguments of the draws.
    pub fn arguments(&self) -> &wgpu::Buffer {
        self.arguments.get()
    }

    /// Draws a part of the list that was sent.
    pub fn draw(&self, gpu: &Gpu, pass: &mut wgpu::RenderPass<'_>, drawn: &Drawn<'_>, part: Range<usize>) {
        let Drawn { pipeline: Some(pipeline), arena, list, sheets, shadows } = *drawn else { return };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        if let Some(shadows) = shadows {
            pass.set_bind_group(3, shadows, &[]);
        }
        for (slab, texture, run) in &list.runs {
            let (start, end) = (run.start.max(part.start as u32), run.end.min(part.end as u32));
            if start >= end {
                continue;
            }

            // A slab is read as storage where shaders fetch, else as vertices and indices.
            pass.set_bind_group(1, arena.group(*slab), &[]);
            if let (Some(sheets), Kind::Painted(_)) = (sheets, list.kind) {
                pass.set_bind_group(2, sheets.group(*texture), &[]);
            }
            if list.kind.is_indexed() {
                pass.set_vertex_buffer(0, arena.buffer(*slab).slice(..));
                pass.set_index_buffer(arena.buffer(*slab).slice(..), wgpu::IndexFormat::Uint16);
            }

            if gpu.features.contains(Features::INDIRECT_FIRST_INSTANCE) {
                let offset = u64::from(start) * 4 * list.kind.stride() as u64;
                let (arguments, count) = (self.arguments.get(), end - start);
                match list.kind.is_indexed() {
                    true => pass.multi_draw_indexed_indirect(arguments, offset, count),
                    false => pass.multi_draw_indirect(arguments, offset, count),
                }
            } else {
                for index in start..end {
                    draw_directly(pass, list, index);
                }
            }
        }
    }
}

/// For adapters whose indirect draws cannot tell which draw they are.
fn draw_directly(pass: &mut wgpu::RenderPass<'_>, list: &DrawList, index: u32) {
    let stride = list.kind.stride();
    let arguments = &list.arguments[index as usize * stride..][..stride];
    let instances = index..index + arguments[1];
    if list.kind.is_indexed() {
        pass.draw_indexed(arguments[2]..arguments[2] + arguments[0], arguments[3] as i32, instances);
    } else {
        pass.draw(0..arguments[0], instances);
    }
}

fn bind(gpu: &Gpu, pipelines: &Pipelines, uniform: &wgpu::Buffer, draws: &Growing) -> wgpu::BindGroup {
    group(gpu, &pipelines.frame, &[uniform.as_entire_binding(), draws.get().as_entire_binding()])
}

/// Begins a pass that draws clusters; `clears` with a colour, or goes on where the last one ended.
pub fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    color: Option<&wgpu::TextureView>,
    depth: &wgpu::TextureView,
    clears: Option<wgpu::Color>,
) -> wgpu::RenderPass<'a> {
    let load = clears.map_or(wgpu::LoadOp::Load, wgpu::LoadOp::Clear);
    let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
    // Infinitely far.
    let far = clears.map_or(wgpu::LoadOp::Load, |_| wgpu::LoadOp::Clear(0.0));
    let depth_ops = wgpu::Operations { load: far, store: wgpu::StoreOp::Store };
    let color = color.map(|view| wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops,
    });
    pass(encoder, color, depth, depth_ops)
}

/// Begins a pass that draws clusters with several samples a pixel, anew; the picture has their mean when it ends, and nothing else is kept.
pub fn begin_sampled<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    picture: &wgpu::TextureView,
    (color, depth): (&wgpu::TextureView, &wgpu::TextureView),
    background: wgpu::Color,
) -> wgpu::RenderPass<'a> {
    let store = wgpu::StoreOp::Discard;
    let attachment = wgpu::RenderPassColorAttachment {
        view: color,
        depth_slice: None,
        resolve_target: Some(picture),
        ops: wgpu::Operations { load: wgpu::LoadOp::Clear(background), store },
    };
    pass(encoder, Some(attachment), depth, wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store })
}

fn pass<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    color: Option<wgpu::RenderPassColorAttachment<'_>>,
    depth: &wgpu::TextureView,
    depth_ops: wgpu::Operations<f32>,
) -> wgpu::RenderPass<'a> {
    let colors = [color];
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("clusters"),
        color_attachments: if colors[0].is_some() { &colors } else { &[] },
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depth,
            depth_ops: Some(depth_ops),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}
