//! Cells: a uniform grid whose dense cells are subdivided, until none holds many vertices (Yoon 4.2.1, second vertex pass).
//!
//! Only counts are kept, so the memory follows the number of cells and not of vertices. Counting is a sum, hence
//! the same for any number of threads.

use super::cell_graph::Cell;
use crate::error::BuildError;
use crate::trace::Trace;
use chpm_extmem::Column;
use chpm_mesh::Aabb;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Times that a cell may be halved along each axis below the uniform grid. What is still dense then lies in one point.
const MAX_DEPTH: u32 = 20;
/// log2 of the most cells of the uniform grid along its longest axis.
const MAX_UNIFORM_LOG: u32 = 7;

/// A slot of the grid: what lies in a cell before and after it is numbered.
const LINK: u32 = 1 << 31;

/// Points that are looked at again and again, from all threads.
pub(crate) trait Points: Sync {
    /// How many there are.
    fn count(&self) -> usize;
    /// Shows all of them to `look`, some at a time, in any order, until it fails.
    fn each(&self, look: &Look<'_>) -> Result<(), BuildError>;
}

type Look<'a> = dyn Fn(&[[f32; 3]]) -> Result<(), BuildError> + Sync + 'a;

/// Points that are shown at a time.
const CHUNK: usize = 1 << 14;

impl Points for [[f32; 3]] {
    fn count(&self) -> usize {
        self.len()
    }

    fn each(&self, look: &Look<'_>) -> Result<(), BuildError> {
        self.par_chunks(CHUNK).try_for_each(look)
    }
}

impl Points for Column<[f32; 3]> {
    fn count(&self) -> usize {
        self.len()
    }

    fn each(&self, look: &Look<'_>) -> Result<(), BuildError> {
        (0..self.len().div_ceil(CHUNK)).into_par_iter().try_for_each_init(Vec::new, |scratch, chunk| {
            let start = chunk * CHUNK;
            look(self.read(start..self.len().min(start + CHUNK), scratch)?)
        })
    }
}

/// Fails where the work is to end.
pub(crate) type Check<'a> = dyn Fn() -> Result<(), BuildError> + Sync + 'a;

/// Halvings ahead that a path tells.
const AHEAD: u32 = 10;

/// The vertices in a slot: how many, and the least and largest of their paths, with hashes behind. They are one where all lie in one point;
/// and the children that both paths go through first are those of all vertices.
#[derive(Debug)]
struct Counter {
    count: AtomicU32,
    least: AtomicU64,
    largest: AtomicU64,
}

/// Facts of a slot's vertices once they are counted.
#[derive(Clone, Copy, Debug)]
struct Counted {
    least: u64,
    largest: u64,
}

impl Default for Counter {
    fn default() -> Self {
        Counter { count: AtomicU32::new(0), least: AtomicU64::new(u64::MAX), largest: AtomicU64::new(0) }
    }
}

impl Counter {
    fn add(&self, p: [f32; 3], within: [f64; 3]) {
        let bits = p.map(|x| u64::from((x + 0.0).to_bits()));
        let mixed = (bits[0] << 32 ^ bits[1]).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ bits[2];
        let hash = mixed.wrapping_mul(0xd6e8_feb8_6659_fd93) >> 32;
        let key = u64::from(path(within)) << 32 | hash;
        self.count.fetch_add(1, Relaxed);
        // Most do not change them, and looking is cheaper.
        if key < self.least.load(Relaxed) {
            self.least.fetch_min(key, Relaxed);
        }
        if key > self.largest.load(Relaxed) {
            self.largest.fetch_max(key, Relaxed);
        }
    }

    fn counted(&self) -> Counted {
        Counted { least: self.least.load(Relaxed), largest: self.largest.load(Relaxed) }
    }
}

impl Counted {
    /// Whether the vertices are apart.
    fn differ(self) -> bool {
        self.least != self.largest
    }

    /// The children that all of the vertices are in, one in another, as far as it is known.
    fn children(self) -> impl Iterator<Item = usize> {
        fn path(level: u32, key: u64) -> u64 {
            key >> (32 + 3 * (AHEAD - 1 - level))
        }
        (0..AHEAD)
            .take_while(move |level| path(*level, self.least) == path(*level, self.largest))
            .map(move |level| (path(level, self.least) & 7) as usize)
    }
}

/// The children that a place in a cell of side 1 is in, one in another, three bits each.
fn path(within: [f64; 3]) -> u32 {
    spread(within[0]) | spread(within[1]) << 1 | spread(within[2]) << 2
}

/// Three bits further apart, each.
fn spread(w: f64) -> u32 {
    let mut bits = ((w * f64::from(1 << AHEAD)) as u32).min((1 << AHEAD) - 1);
    bits = (bits | bits << 16) & 0x0300_00ff;
    bits = (bits | bits << 8) & 0x0300_f00f;
    bits = (bits | bits << 4) & 0x030c_30c3;
    (bits | bits << 2) & 0x0924_9249
}

/// Where the cells of a uniform grid lie.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Placement {
    /// From a corner of the box on, a number of them along its longest side.
    InBox,
    /// At multiples of their side, which is a power of two: no cell moves because of what lies elsewhere.
    AtMultiples,
}

/// Place of a cell along a curve through the octree that all cells of a grid are in: three bits for each halving, the first ones on top.
pub(crate) type OctreeKey = u128;

/// log2 of the uniform cells along each axis that an octree has in one: as many as there can be, and twice as many again, as they need not begin at a multiple.
const UNIFORM_BITS: u32 = MAX_UNIFORM_LOG + 2;

/// The grid. Every vertex has a cell; cells that hold vertices are numbered from 0 in the order of slots.
pub(crate) struct Grid {
    origin: [f64; 3],
    /// Cells per object unit in the uniform grid.
    scale: f64,
    dims: [u32; 3],
    /// Uniform cells of the octree before the first ones here.
    first: [u32; 3],
    /// Uniform cells, then blocks of eight. A slot is a link to a block, or a cell's number.
    slots: Vec<u32>,
    /// Centre and vertex count of each numbered cell.
    pub(crate) cells: Vec<Cell>,
    /// Their places in the octree, if they lie at multiples of their side.
    pub(crate) keys: Vec<OctreeKey>,
    placement: Placement,
}

impl Grid {
    /// Without any vertices, `n` cells along the longest side of a box.
    fn empty(bounds: &Aabb, n: u32, placement: Placement) -> Self {
        let extent: [f64; 3] = std::array::from_fn(|a| f64::from(bounds.max[a]) - f64::from(bounds.min[a]));
        let longest = extent.into_iter().fold(0.0, f64::max);
        let min = bounds.min.map(f64::from);
        let (scale, origin, dims, first) = match placement {
            _ if longest <= 0.0 => (0.0, min, [1; 3], [0; 3]),
            Placement::InBox => {
                let scale = f64::from(n) / longest;
                (scale, min, extent.map(|e| ((e * scale).ceil() as u32).clamp(1, n)), [0; 3])
            }
            Placement::AtMultiples => {
                let scale = f64::from(n) / libm::exp2(libm::log2(longest).ceil());
                let ends = bounds.max.map(|x| (f64::from(x) * scale).floor());
                let starts = min.map(|x| (x * scale).floor());
                // One more than the side is long may be touched.
                let dims = std::array::from_fn(|a| ((ends[a] - starts[a]) as u32).min(n) + 1);
                let octree = f64::from(1 << MAX_UNIFORM_LOG);
                let first = starts.map(|start| (start - (start / octree).floor() * octree) as u32);
                (scale, starts.map(|start| start / scale), dims, first)
            }
        };
        let slots = vec![0; dims.iter().product::<u32>() as usize];
        Grid { origin, scale, dims, first, slots, cells: Vec::new(), keys: Vec::new(), placement }
    }

    /// Subdivides until no cell holds more than `limit` of the `positions`, all of which lie in `bounds`, but in one point. `check` is
    /// asked between pieces of work whether to go on.
    pub(crate) fn build<P: Points + ?Sized>(
        positions: &P,
        bounds: &Aabb,
        limit: u32,
        placement: Placement,
        trace: &Trace,
        check: &Check<'_>,
    ) -> Result<Self, BuildError> {
        // A surface meets about four n * n of n * n * n cells: start where those would hold twice the limit.
        let wanted = (positions.count() as f64 / (8.0 * f64::from(limit))).sqrt().max(1.0);
        let mut n = 1u32 << (libm::log2(wanted).ceil() as u32).min(MAX_UNIFORM_LOG);
        let (mut grid, mut apart) = loop {
            let mut grid = Grid::empty(bounds, n, placement);
            let apart = grid.count(positions, 0, trace, check)?;
            // A cloud fills the cells of a volume: begin where they hold a sixteenth of the limit or more.
            let filled = grid.slots.iter().filter(|count| **count > 0).count();
            if n == 1 || filled * limit as usize <= 16 * positions.count() {
                break (grid, apart);
            }
            n /= 2;
        };

        // Cells of too many vertices are halved, all that there are, and then the new ones, until none is left.
        let mut depths = vec![0; grid.slots.len()];
        let mut fresh = 0;
        loop {
            let first_block = grid.slots.len();
            let mut below = Vec::new();
            for slot in fresh..first_block {
                // What lies in one point stays together, however often its cell is halved.
                let (count, counted, depth) = (grid.slots[slot], apart[slot - fresh], depths[slot - fresh]);
                if count & LINK == 0 && count > limit && counted.differ() && depth < MAX_DEPTH {
                    grid.divide(slot, counted, depth, &mut below);
                }
            }
            if grid.slots.len() == first_block {
                break;
            }
            apart = grid.count(positions, first_block, trace, check)?;
            (fresh, depths) = (first_block, below);
        }
        grid.number_cells();
        Ok(grid)
    }

    /// Puts a block in the place of a slot whose cell was halved `depth` times, and as long as one child has all vertices, another in the place
    /// of that; appends how often each new cell was halved.
    fn divide(&mut self, mut slot: usize, counted: Counted, mut depth: u32, depths: &mut Vec<u32>) {
        let mut children = counted.children();
        loop {
            let block = self.slots.len();
            self.slots[slot] = LINK | block as u32;
            self.slots.resize(block + 8, 0);
            depth += 1;
            depths.resize(depths.len() + 8, depth);
            match children.next() {
                Some(child) if depth < MAX_DEPTH => slot = block + child,
                _ => return,
            }
        }
    }

    /// Counts vertices into the slots from `first` on, all of which are zero but for links; answers for each what its vertices are.
    fn count<P: Points + ?Sized>(
        &mut self,
        positions: &P,
        first: usize,
        trace: &Trace,
        check: &Check<'_>,
    ) -> Result<Vec<Counted>, BuildError> {
        let counters: Vec<Counter> = (first..self.slots.len()).map(|_| Counter::default()).collect();
        let phase = trace.phase();
        positions.each(&|chunk| {
            let _traced = phase.task("count");
            check()?;
            for p in chunk {
                let (slot, within) = self.find(*p);
                if slot >= first {
                    counters[slot - first].add(*p, within);
                }
            }
            Ok(())
        })?;
        for (slot, counter) in self.slots[first..].iter_mut().zip(&counters) {
            // In a link there are none.
            *slot |= counter.count.load(Relaxed);
        }
        Ok(counters.iter().map(Counter::counted).collect())
    }

    /// The slot that a point lies in, and where in its cell, of side 1, that is.
    fn find(&self, p: [f32; 3]) -> (usize, [f64; 3]) {
        let at: [f64; 3] = std::array::from_fn(|a| (f64::from(p[a]) - self.origin[a]) * self.scale);
        let cell: [u32; 3] = std::array::from_fn(|a| (at[a] as u32).min(self.dims[a] - 1));
        let mut slot = ((cell[2] * self.dims[1] + cell[1]) * self.dims[0] + cell[0]) as usize;
        let mut within: [f64; 3] = std::array::from_fn(|a| at[a] - f64::from(cell[a]));
        while self.slots[slot] & LINK != 0 {
            let mut child = 0;
            for (axis, w) in within.iter_mut().enumerate() {
                let upper = *w >= 0.5;
                child |= usize::from(upper) << axis;
                *w = 2.0 * *w - f64::from(u8::from(upper));
            }
            slot = (self.slots[slot] & !LINK) as usize + child;
        }
        (slot, within)
    }

    /// The number of the cell of one of the counted positions.
    pub(crate) fn cell_of(&self, p: [f32; 3]) -> u32 {
        self.slots[self.find(p).0]
    }

    fn number_cells(&mut self) {
        let side = if self.scale > 0.0 { 1.0 / self.scale } else { 0.0 };
        for z in 0..self.dims[2] {
            for y in 0..self.dims[1] {
                for x in 0..self.dims[0] {
                    let slot = ((z * self.dims[1] + y) * self.dims[0] + x) as usize;
                    let corner = [x, y, z].map(f64::from);
                    let corner = std::array::from_fn(|a| self.origin[a] + corner[a] * side);
                    self.number(slot, corner, side, uniform_key([x, y, z], self.first), MAX_DEPTH);
                }
            }
        }
    }

    /// Numbers the cells in a slot, of which `key` is the place, and `below` how often the least cells are halved more often than it.
    fn number(&mut self, slot: usize, corner: [f64; 3], side: f64, key: OctreeKey, below: u32) {
        let value = self.slots[slot];
        if value & LINK != 0 {
            let half = 0.5 * side;
            for child in 0..8 {
                let corner =
                    std::array::from_fn(|a| corner[a] + if child >> a & 1 == 1 { half } else { 0.0 });
                self.number(
                    (value & !LINK) as usize + child,
                    corner,
                    half,
                    key << 3 | child as u128,
                    below - 1,
                );
            }
        } else if value > 0 {
            self.slots[slot] = self.cells.len() as u32;
            self.cells.push(Cell { center: corner.map(|x| (x + 0.5 * side) as f32), count: value });
            if self.placement == Placement::AtMultiples {
                self.keys.push(key << (3 * below));
            }
        }
    }
}

/// Place in the octree of a uniform cell, when `first` are before the first ones.
fn uniform_key(cell: [u32; 3], first: [u32; 3]) -> OctreeKey {
    let at: [u32; 3] = std::array::from_fn(|a| cell[a] + first[a]);
    (0..UNIFORM_BITS).rev().fold(0, |key, bit| {
        let child = (0..3).map(|a| (at[a] >> bit & 1) << a).sum::<u32>();
        key << 3 | OctreeKey::from(child)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn in_box(positions: &[[f32; 3]], limit: u32, check: &Check<'_>) -> Result<Grid, BuildError> {
        let bounds = Aabb::of_points(positions);
        Grid::build(positions, &bounds, limit, Placement::InBox, &Trace::default(), check)
    }

    #[test]
    fn every_vertex_is_counted_once_and_found_again() {
        let positions: Vec<[f32; 3]> = (0..5000u32)
            .map(|i| {
                let h = i.wrapping_mul(2654435761);
                [(h & 1023) as f32, (h >> 10 & 1023) as f32 * 0.1, ((h >> 20) as f32).powi(3) * 1e-6]
            })
            .collect();
        let grid = in_box(&positions, 16, &|| Ok(())).unwrap();
        let mut counts = vec![0; grid.cells.len()];
        for p in &positions {
            counts[grid.cell_of(*p) as usize] += 1;
        }
        assert!(grid.cells.iter().zip(&counts).all(|(cell, count)| cell.count == *count && *count <= 16));
        assert_eq!(counts.iter().sum::<u32>(), 5000);
    }

    #[test]
    fn a_cloud_gets_no_cell_for_every_vertex() {
        let at = |i: u32, k: u32| (i.wrapping_mul(2654435761).wrapping_add(k) >> (10 * k)) % 1009;
        let positions: Vec<[f32; 3]> =
            (0..60_000u32).map(|i| [at(i, 0), at(i, 1), at(i / 7, 2)].map(|x| x as f32)).collect();
        let grid = in_box(&positions, 48, &|| Ok(())).unwrap();
        assert!(grid.cells.len() < 60_000 / 3, "{} cells", grid.cells.len());
        assert!(grid.cells.iter().all(|cell| cell.count <= 48));
    }

    #[test]
    fn tiny_things_in_a_large_box_are_found_in_few_looks() {
        let at = |i: u32, k: u32| (i.wrapping_mul(2654435761) >> (10 * k) & 1023) as f32 * 1e-3;
        let mut positions: Vec<[f32; 3]> = (0..4000).map(|i| [at(i, 0), at(i, 1), at(i, 2)]).collect();
        positions.push([3e4, 2e4, 1e4]);
        let looks = AtomicU32::new(0);
        let check = || {
            looks.fetch_add(1, Relaxed);
            Ok(())
        };
        let grid = in_box(&positions, 48, &check).unwrap();
        assert!(grid.cells.len() > 80 && grid.cells.iter().all(|cell| cell.count <= 48));
        let looks = looks.into_inner();
        assert!(looks < 12, "{looks} looks at all of them");
    }

    #[test]
    fn coincident_vertices_end_in_one_full_cell() {
        let positions = [[1.0, 2.0, 3.0]; 100];
        let grid = in_box(&positions, 16, &|| Ok(())).unwrap();
        assert_eq!(grid.cells.len(), 1);
        assert_eq!(grid.cells[0].count, 100);
        assert_eq!(grid.slots.len(), 1, "halving does not tell them apart");
        // Nor does it where another point keeps the box from being empty.
        let mut positions = vec![[1.0, 2.0, 3.0]; 1000];
        positions[17] = [9.0, 2.0, 3.0];
        let looks = AtomicU32::new(0);
        let check = || {
            looks.fetch_add(1, Relaxed);
            Ok(())
        };
        let grid = in_box(&positions, 16, &check).unwrap();
        assert_eq!(grid.cells.iter().map(|cell| cell.count).collect::<Vec<_>>(), [999, 1]);
        assert!(grid.slots.len() < 16 && looks.into_inner() < 8);
        let two = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]];
        assert_eq!(in_box(&two, 2, &|| Ok(())).unwrap().cells.len(), 2);
    }

    #[test]
    fn a_request_to_stop_is_looked_at_between_chunks() {
        let positions: Vec<[f32; 3]> = (0..8 * CHUNK).map(|i| [i as f32, 0.0, 0.0]).collect();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        for after in [0, 3, 20] {
            let looks = AtomicU32::new(0);
            let check = || match looks.fetch_add(1, Relaxed) {
                n if n < after => Ok(()),
                _ => Err(BuildError::Cancelled),
            };
            let built = pool.install(|| in_box(&positions, 48, &check));
            assert!(built.is_err_and(|error| error.is_cancelled()));
            assert_eq!(looks.into_inner(), after + 1, "no chunk is looked at after the request");
        }
    }

    /// Cells at multiples of their side stay where they are when something comes far away, and so does their order.
    #[test]
    fn cells_at_multiples_of_their_side_do_not_move() {
        let at = |i: u32, k: u32| (i.wrapping_mul(2654435761) >> (10 * k) & 1023) as f32 * 1e-3 - 0.6;
        let positions: Vec<[f32; 3]> = (0..4000).map(|i| [at(i, 0), at(i, 1), at(i, 2) * 0.3]).collect();
        let aligned = |positions: &[[f32; 3]]| {
            let bounds = Aabb::of_points(positions);
            Grid::build(positions, &bounds, 48, Placement::AtMultiples, &Trace::default(), &|| Ok(()))
                .unwrap()
        };
        let of = |grid: &Grid| -> Vec<Vec<usize>> {
            let mut cells = vec![Vec::new(); grid.cells.len()];
            (0..positions.len()).for_each(|v| cells[grid.cell_of(positions[v]) as usize].push(v));
            assert!(grid.cells.iter().all(|cell| cell.count <= 48) && grid.keys.len() == cells.len());
            cells.sort_by_key(|cell| cell.first().map(|v| grid.keys[grid.cell_of(positions[*v]) as usize]));
            cells.retain(|cell| !cell.is_empty());
            cells
        };
        let alone = of(&aligned(&positions));
        assert!(alone.len() > 80);
        for more in [[0.45, -0.61, 0.0], [-0.65, 0.3, 0.2], [0.1, 0.2, -0.4]] {
            let with = [&positions[..], &[more]].concat();
            let with = of(&aligned(&with));
            let same = alone.iter().filter(|cell| with.contains(cell)).count();
            assert!(same + 8 >= alone.len(), "{same} of {}", alone.len());
            let order: Vec<_> = with.iter().filter(|cell| alone.contains(cell)).collect();
            assert!(alone.iter().filter(|cell| with.contains(cell)).eq(order), "in the same order");
        }
    }
}
