//! Shares of vertices, added up.

use crate::VertexColors;
use crate::footprint::Share;
use crate::srgb::encode;
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{Buckets, BufferWriter, ExtmemError, Reservation, Store};

/// Colour of a vertex that nothing says anything about.
const WHITE: [u8; 4] = [255; 4];

/// Bits of the number of a vertex among those that are added up at once.
const RANGE: u32 = 16;
/// Shares that are at hand: neighbours come one after the other.
const AT_HAND: usize = 1 << 14;
/// Bytes that are gathered for each range.
const BLOCK: usize = 1 << 13;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Entry {
    share: Share,
    vertex: u32,
    is_used: u32,
}

/// Takes shares in any order. Sums are of whole numbers, so that no order shows.
pub(crate) struct Shares {
    store: Store,
    count: usize,
    at_hand: Vec<Entry>,
    ranges: Buckets<Entry>,
    _memory: Reservation,
}

impl Shares {
    /// None yet, of `count` vertices.
    pub(crate) fn new(store: &Store, count: usize) -> Result<Self, ExtmemError> {
        let what = "colours of vertices";
        let ranges = count.div_ceil(1 << RANGE).max(1);
        let bytes = AT_HAND * size_of::<Entry>() + ranges * BLOCK + (size_of::<Entry>() << RANGE);
        let memory = store.budget.reserve_work(what, bytes as u64)?;
        let at_hand = vec![Entry::zeroed(); AT_HAND];
        let ranges = Buckets::new(store, what, ranges, BLOCK);
        Ok(Shares { store: store.clone(), count, at_hand, ranges, _memory: memory })
    }

    /// Adds shares of vertices that there are.
    pub(crate) fn add_to_all(&mut self, vertices: [u32; 3], shares: &[Share; 3]) -> Result<(), ExtmemError> {
        vertices.into_iter().zip(shares).try_for_each(|(vertex, share)| self.add(vertex, share))
    }

    fn add(&mut self, vertex: u32, share: &Share) -> Result<(), ExtmemError> {
        let held = &mut self.at_hand[vertex as usize % AT_HAND];
        if held.is_used != 0 && held.vertex != vertex {
            self.ranges.push((held.vertex >> RANGE) as usize, *held)?;
            held.share = Share::default();
        }
        (held.vertex, held.is_used) = (vertex, 1);
        held.add(share);
        Ok(())
    }

    /// Colours of all vertices.
    pub(crate) fn finish(mut self) -> Result<VertexColors, ExtmemError> {
        for held in self.at_hand.iter().filter(|held| held.is_used != 0) {
            self.ranges.push((held.vertex >> RANGE) as usize, *held)?;
        }
        self.at_hand = Vec::new();

        let mut colors = BufferWriter::new(&self.store, "colours of vertices", self.count)?;
        let (mut entries, mut sums) = (Vec::new(), Vec::new());
        for range in 0..self.ranges.count() {
            sums.clear();
            sums.resize((self.count - (range << RANGE)).min(1 << RANGE), Entry::zeroed());
            for block in 0..self.ranges.block_count(range) {
                self.ranges.read_block(range, block, &mut entries)?;
                for entry in &entries {
                    sums[entry.vertex as usize % (1 << RANGE)].add(&entry.share);
                }
            }
            self.ranges.clear(range);
            let found: Vec<[u8; 4]> = sums.iter().map(|sum| color(&sum.share)).collect();
            colors.extend_from_slice(&found)?;
        }
        Ok(VertexColors(colors.finish_column()?))
    }
}

impl Entry {
    fn add(&mut self, share: &Share) {
        let Share { near, third } = &mut self.share;
        for (sum, part) in near.iter_mut().chain(third).zip(share.near.iter().chain(&share.third)) {
            *sum = sum.saturating_add(*part);
        }
    }
}

/// The colour that sums stand for.
///
/// A mean over all triangles of a vertex is that of a place larger than what the vertex shows: twice the mean by nearness less the mean of the triangles is nearer
/// to the colours between corners that least squares would find. Where little is left of the weight, nearness has to do.
fn color(share: &Share) -> [u8; 4] {
    let near = share.near.map(|part| part as f64);
    let third = share.third.map(|part| part as f64);
    let sharp: [f64; 5] = std::array::from_fn(|i| 2.0 * near[i] - third[i]);
    let is_left = sharp[3] * 4.0 >= near[3] && sharp[4] * 4.0 >= near[4];
    let [r, g, b, shown, weight] = if is_left { sharp } else { near };
    if weight <= 0.0 || shown <= 0.0 {
        return WHITE;
    }
    let [r, g, b] = [r, g, b].map(|part| encode(part * (255.0 * 256.0) / shown));
    [r, g, b, (shown / weight - 1.0).round() as u8]
}
