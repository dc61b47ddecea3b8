//! The map of the key light's shadows: depth as the light has it, and how shaders look it up.

use super::buffers::{Canvas, buffer};
use super::camera_uniform::FrameUniform;
use super::context::Gpu;
use super::passes::{DrawBuffers, DrawList, Drawn};
use super::pipelines::{DEPTH, Kind, Pipelines, group};
use super::{Arena, passes};
use bytemuck::{Pod, Zeroable};
use std::ops::Range;
use wgpu::{BindingResource, BufferUsages};

/// Most parts of a map.
pub const PARTS: usize = 4;
/// Sides of a map, texels.
const SIDES: Range<u32> = 512..4096;

/// A part of the map as shaders have it; see `shadows.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PartUniform {
    /// To the right, upward and toward the light.
    pub rows: [[f32; 4]; 3],
    /// Its middle in the map, and half of its sides.
    pub place: [f32; 4],
    /// Depth over a texel; what is granted; how far it reaches.
    pub texel: [f32; 4],
}

/// All of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ShadowUniform {
    /// The finest first.
    pub parts: [PartUniform; PARTS],
    /// How many there are.
    pub count: [u32; 4],
}

/// The map, of all models together.
#[derive(Debug)]
pub struct ShadowMap {
    depth: Canvas,
    compares: wgpu::Sampler,
}

impl ShadowMap {
    /// Side of a map for an image: two texels for a pixel where there is room. Where a processor draws, filling it is what takes long: a smaller
    /// one has to do.
    pub fn side(gpu: &Gpu, [width, height]: [u32; 2]) -> u32 {
        let most = if gpu.is_software() { SIDES.end / 2 } else { SIDES.end };
        let wanted = (2 * width.max(height)).next_power_of_two().clamp(SIDES.start, most);
        wanted.min(1 << gpu.device.limits().max_texture_dimension_2d.ilog2())
    }

    /// An empty map.
    pub fn new(gpu: &Gpu, side: u32) -> Self {
        let compares = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadows"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::GreaterEqual),
            ..Default::default()
        });
        ShadowMap { depth: Canvas::new(gpu, "shadows", [side; 2], DEPTH), compares }
    }

    /// Texels of a side.
    pub fn size(&self) -> u32 {
        self.depth.size()[0]
    }

    /// Begins the pass that draws it anew.
    pub fn begin<'a>(&self, encoder: &'a mut wgpu::CommandEncoder) -> wgpu::RenderPass<'a> {
        passes::begin(encoder, None, self.depth.view(), Some(wgpu::Color::BLACK))
    }
}

/// Column, row and side of a part, texels: one has all of the map, several have a quarter each.
pub fn place(side: u32, part: usize, parts: usize) -> [u32; 3] {
    if parts == 1 {
        return [0, 0, side];
    }
    let half = side / 2;
    [half * (part as u32 % 2), half * (part as u32 / 2), half]
}

/// The clusters of one model that throw shadows, for each part of the map, and the map as this model's pixels have it.
#[derive(Debug)]
pub struct Casters {
    parts: Vec<(DrawList, DrawBuffers)>,
    uniform: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl Casters {
    /// None yet, for a map.
    pub fn new(gpu: &Gpu, pipelines: &Pipelines, map: &ShadowMap) -> Self {
        let size = size_of::<ShadowUniform>() as u64;
        let uniform = buffer(gpu, "shadows", size, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        let bound = [
            uniform.as_entire_binding(),
            BindingResource::TextureView(map.depth.view()),
            BindingResource::Sampler(&map.compares),
        ];
        let group = group(gpu, &pipelines.shadows, &bound);
        let parts = (0..PARTS).map(|_| (DrawList::new(Kind::Cast), DrawBuffers::new(gpu, pipelines)));
        Casters { parts: parts.collect(), uniform, group }
    }

    /// The list of a part.
    pub fn list(&mut self, part: usize) -> &mut DrawList {
        &mut self.parts[part].0
    }

    /// Triangles of all parts.
    pub fn triangles(&self) -> u64 {
        self.parts.iter().map(|(list, _)| list.triangles()).sum()
    }

    /// Sends how the map is looked up.
    pub fn look_up(&self, gpu: &Gpu, uniform: &ShadowUniform) {
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(uniform));
    }

    /// Sends the list of a part and what it is seen through.
    pub fn write(&mut self, gpu: &Gpu, pipelines: &Pipelines, part: usize, uniform: &FrameUniform) {
        let (list, buffers) = &mut self.parts[part];
        buffers.write(gpu, pipelines, list, uniform);
    }

    /// Draws the list of a part, which was sent.
    pub fn draw(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        (pipelines, arena): (&Pipelines, &Arena),
        part: usize,
    ) {
        let (list, buffers) = &self.parts[part];
        let pipeline = pipelines.get(Kind::Cast, 1);
        let drawn = Drawn { pipeline, arena, list, sheets: None, shadows: None };
        buffers.draw(gpu, pass, &drawn, 0..list.count());
    }

    /// The map as shaders see it.
    pub fn group(&self) -> &wgpu::BindGroup {
        &self.group
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_places_beside_each_other() {
        assert_eq!(place(1024, 0, 1), [0, 0, 1024]);
        let places: Vec<_> = (0..4).map(|part| place(1024, part, 4)).collect();
        assert_eq!(places, [[0, 0, 512], [512, 0, 512], [0, 512, 512], [512, 512, 512]]);
    }
}
