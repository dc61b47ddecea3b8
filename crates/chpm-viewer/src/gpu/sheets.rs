//! Sheets in textures, within a budget.
//!
//! Textures of one size are taken as they are needed, and in each of them sheets have places by shelves. Where no place is left, those that
//! are not drawn make room, the longest unused first. A cluster whose sheet finds no place is drawn in the colours of its vertices.

use super::block::CHARTS_HEAD;
use super::context::Gpu;
use super::pipelines::group;
use crate::error::ViewerError;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, SheetLayout, SheetRecord};
use chpm_mesh::{Bytes, ClusterId};
use chpm_texture::sheet::{LEVELS, Sizes, fitted};
use etagere::{AllocId, AllocatorOptions, AtlasAllocator, size2};
use wgpu::{Extent3d, FilterMode, TextureFormat, TextureUsages};

/// Places begin at multiples of this, so that the smallest size of a sheet begins with a whole texel.
const STEP: u32 = 1 << (LEVELS - 1);
/// Sides of textures: the usual one, and the least.
const USUAL: u32 = 2048;
const LEAST: u32 = 256;

/// Where a sheet is.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// Which texture.
    pub texture: usize,
    /// Column and row of its first texel.
    pub at: [u32; 2],
    id: AllocId,
    /// The frame that it was last drawn in.
    used: u64,
    bytes: u64,
}

/// Textures, and the sheets in them.
#[derive(Debug)]
pub struct Sheets {
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    textures: Vec<Sheeted>,
    side: u32,
    /// Textures that may still be taken.
    room: u64,
    placed: Vec<Option<Placed>>,
    /// Clusters whose sheets are there.
    kept: Vec<ClusterId>,
    /// Bound where there is no sheet.
    empty: wgpu::BindGroup,
    used_bytes: u64,
    uploaded_bytes: u64,
}

/// A texture with sheets.
struct Sheeted {
    texture: wgpu::Texture,
    group: wgpu::BindGroup,
    places: AtlasAllocator,
}

impl std::fmt::Debug for Sheeted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Sheeted({} texels taken)", self.places.allocated_space())
    }
}

/// Bytes of a texture and all its sizes.
pub fn bytes_of(side: u32) -> u64 {
    Sizes::bytes_of([side as u16; 2], side)
}

/// Side of the textures that a budget has, and how many of them all sheets of a file need at most; none where there is no room for one.
pub fn extent(file: &Chpm<MappedFile>, budget: Bytes, limit: u32) -> Option<(u32, u64)> {
    let longest = file.sheets().iter().flat_map(|sheet| sheet.size).max()?;
    let mut side = USUAL.max(u32::from(longest).next_power_of_two()).min(1 << limit.ilog2());
    while bytes_of(side) > budget.0 {
        side /= 2;
    }
    if side < LEAST {
        return None;
    }
    // Half of a texture may be lost between shelves.
    let texels: u64 =
        file.sheets().iter().map(|sheet| fitted(sheet.size, side).1.map(u64::from)).map(|[w, h]| w * h).sum();
    let needed = (2 * texels).div_ceil(u64::from(side).pow(2)) + 1;
    Some((side, needed.min(budget.0 / bytes_of(side))))
}

impl Placed {
    /// Words that tell shaders where a sheet is, in a texture of such a side, and its charts; see `sheets.wgsl`.
    pub fn words(&self, layout: &SheetLayout, record: &SheetRecord, side: u32) -> Vec<u32> {
        let texel = 1.0 / side as f32;
        let scale = texel / (1u32 << fitted(record.size, side).0) as f32;
        let [column, row] = self.at.map(|at| at as f32 * texel);
        let [x, y, z] = layout.origin;
        let head: [f32; CHARTS_HEAD as usize] = [x, y, z, scale, column, row, 0.0, 0.0];
        let mut words: Vec<u32> = head.map(f32::to_bits).into();
        for chart in &layout.charts {
            words
                .extend(chart.axes.as_flattened().iter().chain(&chart.offset).map(|number| number.to_bits()));
        }
        words
    }
}

impl Sheets {
    /// No sheets yet, for a file of so many clusters, in at most so many textures of such a side.
    pub fn new(
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        clusters: usize,
        (side, textures): (u32, u64),
    ) -> Self {
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("sheets"),
            mag_filter: FilterMode::Linear,
            min_filter: FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            anisotropy_clamp: if gpu.is_software() { 1 } else { 8 },
            ..Default::default()
        });
        let texture = texture(gpu, STEP);
        let empty = bind(gpu, layout, &texture, &sampler);
        Sheets {
            layout: layout.clone(),
            sampler,
            textures: Vec::new(),
            side,
            room: textures,
            placed: vec![None; clusters],
            kept: Vec::new(),
            empty,
            used_bytes: 0,
            uploaded_bytes: 0,
        }
    }

    /// Side of its textures.
    pub fn side(&self) -> u32 {
        self.side
    }

    /// Where the sheet of a cluster is, if it is there.
    pub fn get(&self, cluster: ClusterId) -> Option<Placed> {
        self.placed[cluster.index()]
    }

    /// Notes that a cluster is drawn in a frame: its sheet stays.
    pub fn touch(&mut self, cluster: ClusterId, frame: u64) {
        if let Some(placed) = &mut self.placed[cluster.index()] {
            placed.used = frame;
        }
    }

    /// Finds a place for a sheet that is not there, of a record's size; `false` where there is none, even without all that is not drawn in this frame.
    ///
    /// # Errors
    /// [`ViewerError::Device`] where the system refuses the memory.
    pub fn place(
        &mut self,
        gpu: &Gpu,
        cluster: ClusterId,
        record: &SheetRecord,
        frame: u64,
    ) -> Result<bool, ViewerError> {
        let (_, size) = fitted(record.size, self.side);
        let mut found = self.find(size);
        if found.is_none() && self.room > 0 {
            self.room -= 1;
            let texture =
                gpu.attempt("taking GPU memory for textures (allow less of it)", || texture(gpu, self.side))?;
            let group = bind(gpu, &self.layout, &texture, &self.sampler);
            let options = AllocatorOptions {
                alignment: size2(STEP as i32, STEP as i32),
                ..AllocatorOptions::default()
            };
            let places = AtlasAllocator::with_options(size2(self.side as i32, self.side as i32), &options);
            self.textures.push(Sheeted { texture, group, places });
            found = self.find(size);
        }
        if found.is_none() {
            found = self.make_room(size, frame);
        }
        let Some((texture, at, id)) = found else { return Ok(false) };
        let bytes = Sizes::bytes_of(record.size, self.side);
        self.placed[cluster.index()] = Some(Placed { texture, at, id, used: frame, bytes });
        self.kept.push(cluster);
        self.used_bytes += bytes;
        Ok(true)
    }

    /// Writes the texels of a sheet that has a place.
    pub fn write(&mut self, gpu: &Gpu, cluster: ClusterId, texels: &Sizes) {
        let Some(Placed { texture, at, .. }) = self.placed[cluster.index()] else { return };
        for (level, ([width, height], pixels)) in (0..).zip(&texels.levels) {
            let origin = wgpu::Origin3d { x: at[0] >> level, y: at[1] >> level, z: 0 };
            let into = wgpu::TexelCopyTextureInfo {
                texture: &self.textures[texture].texture,
                mip_level: level,
                origin,
                aspect: wgpu::TextureAspect::All,
            };
            let rows = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(4 * width),
                rows_per_image: None,
            };
            let size = Extent3d { width: *width, height: *height, depth_or_array_layers: 1 };
            let bytes = pixels.as_flattened();
            gpu.queue.write_texture(into, bytes, rows, size);
            self.uploaded_bytes += bytes.len() as u64;
        }
    }

    /// Gives the place of a sheet back.
    pub fn give_up(&mut self, cluster: ClusterId) {
        self.release(cluster);
        self.kept.retain(|kept| *kept != cluster);
    }

    fn release(&mut self, cluster: ClusterId) {
        let Some(placed) = self.placed[cluster.index()].take() else { return };
        self.textures[placed.texture].places.deallocate(placed.id);
        self.used_bytes -= placed.bytes;
    }

    fn find(&mut self, size: [u32; 2]) -> Option<(usize, [u32; 2], AllocId)> {
        let [width, height] = size.map(|side| side as i32);
        self.textures.iter_mut().enumerate().find_map(|(texture, it)| {
            let place = it.places.allocate(size2(width, height))?;
            Some((texture, [place.rectangle.min.x as u32, place.rectangle.min.y as u32], place.id))
        })
    }

    /// Gives up what this frame does not draw, the longest unused first, until there is a place.
    fn make_room(&mut self, size: [u32; 2], frame: u64) -> Option<(usize, [u32; 2], AllocId)> {
        let used = |cluster: &ClusterId| self.placed[cluster.index()].map_or(0, |placed| placed.used);
        let mut idle: Vec<(u64, ClusterId)> =
            self.kept.iter().map(|cluster| (used(cluster), *cluster)).collect();
        idle.retain(|(used, _)| *used < frame);
        idle.sort_unstable();
        let mut found = None;
        for (_, cluster) in idle {
            self.release(cluster);
            found = self.find(size);
            if found.is_some() {
                break;
            }
        }
        let placed = &self.placed;
        self.kept.retain(|cluster| placed[cluster.index()].is_some());
        found
    }

    /// A texture as shaders see it; one without sheets for none.
    pub fn group(&self, texture: Option<usize>) -> &wgpu::BindGroup {
        texture.and_then(|texture| self.textures.get(texture)).map_or(&self.empty, |it| &it.group)
    }

    /// Bytes of sheets that are there.
    pub fn used(&self) -> Bytes {
        Bytes(self.used_bytes)
    }

    /// Bytes written since the last call.
    pub fn take_uploaded(&mut self) -> u64 {
        std::mem::take(&mut self.uploaded_bytes)
    }
}

fn texture(gpu: &Gpu, side: u32) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("sheets"),
        size: Extent3d { width: side, height: side, depth_or_array_layers: 1 },
        mip_level_count: LEVELS,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: TextureFormat::Rgba8Unorm,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn bind(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    texture: &wgpu::Texture,
    sampler: &wgpu::Sampler,
) -> wgpu::BindGroup {
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    group(gpu, layout, &[wgpu::BindingResource::TextureView(&view), wgpu::BindingResource::Sampler(sampler)])
}
