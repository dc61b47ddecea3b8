//! Clusters' blocks in GPU memory, within a budget.
//!
//! Memory is taken from the system in slabs, as large as a shader may see at once, until the budget is used up. In a slab a block has any
//! free place that is large enough. Where none is, blocks that are not drawn make room, the longest unused first; where the free
//! places are too scattered even then, all are given up, and what is drawn is written anew, without gaps.

use super::block::{Block, Layout};
use super::buffers;
use super::context::Gpu;
use super::pipelines::Pipelines;
use crate::error::ViewerError;
use chpm_mesh::{Bytes, ClusterId, ProgressiveMesh};
use chpm_refine::PmCursor;
use std::collections::BTreeMap;
use wgpu::BufferUsages;

/// Largest slab. A smaller budget makes a smaller one.
const SLAB: u64 = 64 << 20;

/// Name of the operation that fails where there is less memory than the budget has.
const TAKING: &str = "taking GPU memory (allow less of it)";

/// A block that is on the GPU.
#[derive(Clone, Debug)]
pub struct Resident {
    /// Which slab.
    pub slab: usize,
    /// Its first unit there.
    pub first: u32,
    /// Its parts.
    pub layout: Layout,
    position: Position,
    /// The first vertex of which it is not known yet which way it faces; as many as there are where all is known.
    turned: u32,
    /// Whether it has been told where its sheet is.
    is_painted: bool,
    /// The frame that it was last drawn in.
    used: u64,
    /// The frame that it was written in.
    since: u64,
}

impl Resident {
    /// The position whose triangles it has.
    pub fn position(&self) -> Position {
        self.position
    }

    /// The first vertex of which it is not known yet which way it faces.
    pub fn turned(&self) -> u32 {
        self.turned
    }

    /// Its first corner, where corners are numbered from the start of the slab.
    pub fn first_corner(&self) -> u32 {
        (self.first + self.layout.vertices) * (self.layout.unit / 2)
    }

    /// Whether it has been told where its sheet is.
    pub fn is_painted(&self) -> bool {
        self.is_painted
    }

    /// Where its sheet is told of, and the charts of its triangles: words from the start of the slab; none without a sheet.
    pub fn sheet(&self) -> Option<[u32; 2]> {
        let words = self.first * (self.layout.unit / 4);
        let places = [self.layout.sheet_at(), self.layout.chart_numbers_at()];
        (self.layout.charts > 0).then(|| places.map(|place| words + place))
    }

    /// The frame that it was written in.
    pub fn since(&self) -> u64 {
        self.since
    }
}

/// A position of a progressive mesh; none has no vertices.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Position {
    /// Vertices.
    pub vertices: u32,
    /// Triangles.
    pub triangles: u32,
}

/// All slabs.
#[derive(Debug)]
pub struct Arena {
    layout: wgpu::BindGroupLayout,
    slabs: Vec<Slab>,
    residents: Vec<Option<Resident>>,
    /// Clusters that are there.
    kept: Vec<ClusterId>,
    /// Bytes of slabs that may still be taken.
    room: u64,
    /// Of one slab.
    slab_bytes: u64,
    /// Of a vertex.
    unit: u64,
    /// Plays one cluster after the other.
    cursor: PmCursor,
    corners: Vec<u16>,
    used_bytes: u64,
    uploaded_bytes: u64,
}

#[derive(Debug)]
struct Slab {
    buffer: wgpu::Buffer,
    group: wgpu::BindGroup,
    free: Free,
}

/// Free places of a slab, in units.
#[derive(Clone, Debug)]
struct Free {
    /// By first unit: how many.
    places: BTreeMap<u32, u32>,
}

impl Arena {
    /// An empty arena for a file of `clusters` clusters, none of which has a block of more than `largest` bytes.
    pub fn new(gpu: &Gpu, pipelines: &Pipelines, clusters: usize, budget: Bytes, largest: u64) -> Self {
        let unit = pipelines.unit();
        let limits = gpu.device.limits();
        let most = SLAB.min(limits.max_storage_buffer_binding_size).min(limits.max_buffer_size);
        // Slabs of one size, so that as few as possible of them end in a place that is too small for a block.
        let count = budget.0.div_ceil(most.max(1)).max(1);
        let slab_bytes = (budget.0 / count).max(largest).min(most) / unit * unit;
        Arena {
            layout: pipelines.slab.clone(),
            slabs: Vec::new(),
            residents: (0..clusters).map(|_| None).collect(),
            kept: Vec::new(),
            room: budget.0,
            slab_bytes,
            unit,
            cursor: PmCursor::default(),
            corners: Vec::new(),
            used_bytes: 0,
            uploaded_bytes: 0,
        }
    }

    /// Bytes that blocks together can count on, whatever their sizes up to `largest`: what is left at the ends of slabs is lost.
    pub fn capacity(&self, largest: u64) -> Bytes {
        let whole = self.room / self.slab_bytes.max(1);
        Bytes(whole * (self.slab_bytes - largest.min(self.slab_bytes)))
    }

    /// The block of a cluster, if it is there.
    pub fn get(&self, cluster: ClusterId) -> Option<&Resident> {
        self.residents[cluster.index()].as_ref()
    }

    /// Notes that a cluster is drawn in a frame: its block stays.
    pub fn touch(&mut self, cluster: ClusterId, frame: u64) {
        if let Some(resident) = &mut self.residents[cluster.index()] {
            resident.used = frame;
        }
    }

    /// Writes the vertices of a cluster that is not there, and no triangles yet; `false` where there is no room, even without all that is not drawn in this frame.
    ///
    /// # Errors
    /// [`ViewerError::Device`] where the system refuses the memory.
    pub fn insert(
        &mut self,
        gpu: &Gpu,
        cluster: ClusterId,
        (block, turned): (&Block, u32),
        frame: u64,
    ) -> Result<bool, ViewerError> {
        let layout = block.layout();
        let Some((slab, first)) = self.place(gpu, layout.units, frame)? else { return Ok(false) };
        gpu.queue.write_buffer(&self.slabs[slab].buffer, u64::from(first) * self.unit, block.bytes());
        self.used_bytes += layout.bytes();
        self.uploaded_bytes += layout.vertex_bytes();
        let position = Position::default();
        self.residents[cluster.index()] = Some(Resident {
            slab,
            first,
            layout,
            position,
            turned,
            is_painted: false,
            used: frame,
            since: frame,
        });
        self.kept.push(cluster);
        Ok(true)
    }

    /// Writes the vertices of a cluster that is there once more, which has become known which way they face.
    pub fn turn(&mut self, gpu: &Gpu, cluster: ClusterId, (block, turned): (&Block, u32)) {
        let Some(resident) = &mut self.residents[cluster.index()] else { return };
        let place = u64::from(resident.first) * self.unit;
        gpu.queue.write_buffer(&self.slabs[resident.slab].buffer, place, block.bytes());
        self.uploaded_bytes += block.layout().vertex_bytes();
        resident.turned = turned;
    }

    /// Writes the triangles of another position of a cluster that is there, O(finest mesh); they take effect with the next submission.
    /// With a sheet, the charts of the triangles go with them: `chart_of` those of the finest mesh.
    pub fn move_to(
        &mut self,
        gpu: &Gpu,
        cluster: ClusterId,
        (mesh, chart_of): (&ProgressiveMesh<'_>, Option<&[u16]>),
        vertices: u32,
    ) {
        let Some(resident) = &mut self.residents[cluster.index()] else { return };
        // From scratch each time: what a cursor needs to go step by step would have to be kept, and takes more than its page.
        self.cursor.load(mesh);
        self.cursor.move_to(vertices as usize);
        let triangles = self.cursor.triangles();
        self.corners.clear();
        self.corners.extend_from_slice(triangles.as_flattened());
        // Copies are of whole words.
        self.corners.extend((self.corners.len() % 2 == 1).then_some(0));
        let bytes: &[u8] = bytemuck::cast_slice(&self.corners);
        let place = 2 * u64::from(resident.first_corner());
        gpu.queue.write_buffer(&self.slabs[resident.slab].buffer, place, bytes);
        self.uploaded_bytes += bytes.len() as u64;
        resident.position = Position { vertices, triangles: triangles.len() as u32 };
        let (Some([_, numbers]), Some(chart_of)) = (resident.sheet(), chart_of) else { return };
        self.corners.clear();
        let all = mesh.triangles.iter().zip(chart_of);
        let drawn = all.filter(|(corners, _)| mesh.birth(**corners) <= vertices as usize);
        self.corners.extend(drawn.map(|(_, chart)| *chart));
        self.corners.extend((self.corners.len() % 2 == 1).then_some(0));
        let bytes: &[u8] = bytemuck::cast_slice(&self.corners);
        gpu.queue.write_buffer(&self.slabs[resident.slab].buffer, 4 * u64::from(numbers), bytes);
        self.uploaded_bytes += bytes.len() as u64;
    }

    /// Writes where the sheet of a cluster that is there is, and its charts.
    pub fn paint(&mut self, gpu: &Gpu, cluster: ClusterId, words: &[u32]) {
        let Some(resident) = &mut self.residents[cluster.index()] else { return };
        resident.is_painted = true;
        let Some([place, _]) = resident.sheet() else { return };
        let bytes: &[u8] = bytemuck::cast_slice(words);
        gpu.queue.write_buffer(&self.slabs[resident.slab].buffer, 4 * u64::from(place), bytes);
        self.uploaded_bytes += bytes.len() as u64;
    }

    /// Triangles of a position of a cluster, O(finest mesh).
    pub fn triangles_of(&mut self, mesh: &ProgressiveMesh<'_>, vertices: u32) -> u64 {
        self.cursor.load(mesh);
        self.cursor.move_to(vertices as usize);
        self.cursor.triangles().len() as u64
    }

    /// A place for so many units.
    fn place(&mut self, gpu: &Gpu, units: u32, frame: u64) -> Result<Option<(usize, u32)>, ViewerError> {
        if let Some(place) = self.find(units) {
            return Ok(Some(place));
        }

        // As long as the budget lasts, nothing has to go.
        if self.room >= self.slab_bytes && self.slab_bytes > 0 {
            self.room -= self.slab_bytes;
            let slab = Slab::new(gpu, &self.layout, self.slab_bytes, self.unit)?;
            self.slabs.push(slab);
            return Ok(self.find(units));
        }

        // What this frame does not draw, the longest unused first.
        let mut idle: Vec<(u64, ClusterId)> = Vec::new();
        for cluster in &self.kept {
            let used = self.residents[cluster.index()].as_ref().map_or(0, |resident| resident.used);
            if used < frame {
                idle.push((used, *cluster));
            }
        }
        idle.sort();

        let mut freed = 0;
        for (_, cluster) in idle {
            freed += self.release(cluster);
            // A few at a time: the search is not for free.
            if freed >= units {
                if let Some(place) = self.find(units) {
                    self.forget_released();
                    return Ok(Some(place));
                }
                freed = 0;
            }
        }
        self.forget_released();
        Ok(self.find(units))
    }

    fn find(&mut self, units: u32) -> Option<(usize, u32)> {
        let mut slabs = self.slabs.iter_mut().enumerate();
        slabs.find_map(|(slab, it)| it.free.take(units).map(|first| (slab, first)))
    }

    /// Gives a block's place back; answers its units.
    fn release(&mut self, cluster: ClusterId) -> u32 {
        let Some(resident) = self.residents[cluster.index()].take() else { return 0 };
        self.slabs[resident.slab].free.give(resident.first, resident.layout.units);
        self.used_bytes -= resident.layout.bytes();
        resident.layout.units
    }

    fn forget_released(&mut self) {
        let residents = &self.residents;
        self.kept.retain(|cluster| residents[cluster.index()].is_some());
    }

    /// Gives all blocks up; the slabs stay.
    pub fn clear(&mut self) {
        for cluster in std::mem::take(&mut self.kept) {
            self.release(cluster);
        }
    }

    /// The storage of a slab as shaders see it.
    pub fn group(&self, slab: usize) -> &wgpu::BindGroup {
        &self.slabs[slab].group
    }

    /// A slab's buffer, for vertices and indices.
    pub fn buffer(&self, slab: usize) -> &wgpu::Buffer {
        &self.slabs[slab].buffer
    }

    /// Bytes of blocks that are there.
    pub fn used(&self) -> Bytes {
        Bytes(self.used_bytes)
    }

    /// Bytes written since the last call.
    pub fn take_uploaded(&mut self) -> u64 {
        std::mem::take(&mut self.uploaded_bytes)
    }
}

impl Slab {
    fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout, bytes: u64, unit: u64) -> Result<Self, ViewerError> {
        let usage =
            BufferUsages::VERTEX | BufferUsages::INDEX | BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let buffer = gpu.attempt(TAKING, || buffers::buffer(gpu, "clusters", bytes, usage))?;
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("clusters"),
            layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        });
        Ok(Slab { buffer, group, free: Free::new((bytes / unit) as u32) })
    }
}

impl Free {
    fn new(units: u32) -> Self {
        Free { places: BTreeMap::from([(0, units)]) }
    }

    /// The smallest place that is large enough, its front.
    fn take(&mut self, units: u32) -> Option<u32> {
        let large = self.places.iter().filter(|(_, len)| **len >= units);
        let (first, len) = large.min_by_key(|(first, len)| (**len, **first)).map(|(f, l)| (*f, *l))?;
        self.places.remove(&first);
        if len > units {
            self.places.insert(first + units, len - units);
        }
        Some(first)
    }

    /// A place comes back, and joins those beside it.
    fn give(&mut self, mut first: u32, mut units: u32) {
        if let Some(behind) = self.places.remove(&(first + units)) {
            units += behind;
        }
        if let Some((before, len)) = self.places.range(..first).next_back().map(|(f, l)| (*f, *l))
            && before + len == first
        {
            self.places.remove(&before);
            (first, units) = (before, len + units);
        }
        self.places.insert(first, units);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn places_are_split_and_joined() {
        let mut free = Free::new(10);
        assert_eq!(
            [free.take(3), free.take(3), free.take(3), free.take(2)],
            [Some(0), Some(3), Some(6), None]
        );
        free.give(3, 3);
        assert_eq!(free.take(1), Some(9), "the smallest that fits");
        free.give(0, 3);
        assert_eq!(free.take(6), Some(0));
        free.give(6, 3);
        free.give(9, 1);
        free.give(0, 6);
        assert_eq!(free.places, BTreeMap::from([(0, 10)]));
    }

    proptest! {
        #[test]
        fn nothing_overlaps_and_nothing_is_lost(steps in prop::collection::vec((1_u32..20, any::<bool>()), 1..200)) {
            let mut free = Free::new(100);
            let mut taken: Vec<(u32, u32)> = Vec::new();
            for (units, gives) in steps {
                if gives && !taken.is_empty() {
                    let (first, len) = taken.swap_remove(units as usize % taken.len());
                    free.give(first, len);
                } else if let Some(first) = free.take(units) {
                    taken.push((first, units));
                }
                let mut all: Vec<(u32, u32)> = taken.clone();
                all.extend(free.places.iter().map(|(first, len)| (*first, *len)));
                all.sort();
                let end = all.iter().try_fold(0, |at, (first, len)| (at == *first).then_some(first + len));
                prop_assert_eq!(end, Some(100));
            }
        }
    }
}
