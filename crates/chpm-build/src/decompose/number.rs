//! New numbers for the vertices: by coarse cell, so that whatever lies together is stored together (Quick-VDR 4.1, second and
//! third vertex pass; the mapping of Yoon 4.2.1).
//!
//! Every pass is sequential over the source's order. Where the arrays are on disk, vertices go to their places by way of
//! buckets of consecutive places.

use super::cell_graph::Cell;
use super::grid::{Grid, OctreeKey, Placement};
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use crate::per_thread::PerThread;
use crate::vertex_columns::ColumnMap;
use bytemuck::Pod;
use chpm_extmem::{Buckets, BufferWriter, Column, Part};
use chpm_mesh::Aabb;
use rayon::prelude::*;

/// Vertices that are looked at in one step, where they go to their places.
const STEP: usize = 1 << 18;
/// Vertices that a thread looks at in a row.
const SLICE: usize = 1 << 13;
/// Slices of a step for each thread.
const SLICES: usize = 4;
/// Places of a bucket.
const PLACES: usize = 1 << 19;
/// Bytes that a bucket gathers.
const BLOCK: usize = 1 << 13;
/// Parts of a permutation in memory, if there are no more threads.
const PARTS: usize = 16;

/// Cells as ranges of vertex numbers.
#[derive(Debug)]
pub(crate) struct Cells {
    /// Cell c has the vertices `starts[c]..starts[c + 1]`.
    starts: Vec<usize>,
    /// The cell of every vertex whose number is a multiple of `1 << shift`.
    hints: Vec<u32>,
    shift: u32,
}

impl Cells {
    /// Cells that hold so many vertices each.
    pub(crate) fn new(counts: impl Iterator<Item = u32>) -> Self {
        let mut starts = vec![0];
        starts.extend(counts.scan(0, |end, count| {
            *end += count as usize;
            Some(*end)
        }));

        // About one hint a cell: so a look-up begins next to its cell.
        let (end, count) = (starts[starts.len() - 1], starts.len() - 1);
        let shift = (end / count.max(1)).max(1).ilog2();
        let mut hints = vec![0; (end >> shift) + 2];
        let mut cell = 0;
        for (hint, vertex) in hints.iter_mut().zip((0..).step_by(1 << shift)) {
            while cell + 1 < count && starts[cell + 1] <= vertex {
                cell += 1;
            }
            *hint = cell as u32;
        }
        Cells { starts, hints, shift }
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Vertices of all of them.
    pub(crate) fn end(&self) -> usize {
        self.starts[self.count()]
    }

    /// The cell of a vertex.
    #[inline]
    pub(crate) fn of(&self, vertex: usize) -> u32 {
        let hint = vertex >> self.shift;
        let (low, high) = (self.hints[hint] as usize, self.hints[hint + 1] as usize);
        (low + self.starts[low + 1..=high].partition_point(|start| *start <= vertex)) as u32
    }

    /// The vertices of a cell.
    pub(crate) fn range(&self, cell: u32) -> std::ops::Range<usize> {
        self.starts[cell as usize]..self.starts[cell as usize + 1]
    }
}

/// Vertices by cell.
pub(crate) struct Numbered<I: Id> {
    /// The cells, in the order of the new numbers.
    pub(crate) cells: Vec<Cell>,
    /// Their places in the octree, if they lie at multiples of their side.
    pub(crate) keys: Vec<OctreeKey>,
    /// By vertex, its new number: by cell, in the source's order within one.
    pub(crate) mapping: Column<I>,
}

/// The cells, those of more than `limit` vertices cut into pieces that follow one another; and as many times what each has in `of`, if that is not empty.
fn cut(cells: &[Cell], of: &[OctreeKey], limit: u32) -> (Vec<Cell>, Vec<OctreeKey>) {
    let (mut list, mut keys) = (Vec::with_capacity(cells.len()), Vec::with_capacity(of.len()));
    for (index, cell) in cells.iter().enumerate() {
        let pieces = cell.count.div_ceil(limit.max(1));
        let share = |piece: u32| (u64::from(cell.count) * u64::from(piece) / u64::from(pieces)) as u32;
        list.extend((0..pieces).map(|p| Cell { count: share(p + 1) - share(p), ..*cell }));
        keys.extend(of.get(index).into_iter().flat_map(|key| std::iter::repeat_n(*key, pieces as usize)));
    }
    (list, keys)
}

/// Cells of at most `limit` vertices each, and the new number of every vertex.
pub(crate) fn run<I: Id>(
    positions: &Column<[f32; 3]>,
    bounds: &Aabb,
    limit: u32,
    placement: Placement,
    context: &Context<'_>,
) -> Result<Numbered<I>, BuildError> {
    let grid = Grid::build(positions, bounds, limit, placement, &context.trace, &|| context.check())?;
    let mut next = Vec::with_capacity(grid.cells.len());
    let mut end = 0;
    for cell in &grid.cells {
        next.push(end);
        end += cell.count as usize;
    }

    // A counting sort by cell, of which only the places are kept. Slices are counted side by side, and so are their places given out.
    let mut mapping = BufferWriter::new(&context.store, "vertex mapping", positions.len())?;
    let (mut scratch, mut slices) = (Vec::new(), Vec::new());
    let [counting, placing, storing] = [(); 3].map(|()| context.trace.phase());
    let by_cell: PerThread<Vec<I>> = PerThread::new();
    let zeros = || {
        let mut zeros = by_cell.own();
        zeros.resize(grid.cells.len(), I::of(0));
        zeros
    };
    let count = |points: &[[f32; 3]]| {
        let _traced = counting.task("cells");
        Slice::count(points.iter().map(|p| grid.cell_of(*p)), &mut zeros())
    };
    let step = SLICE * SLICES * rayon::current_num_threads();
    for start in (0..positions.len()).step_by(step) {
        context.check()?;
        let points = positions.read(start..positions.len().min(start + step), &mut scratch)?;
        points.par_chunks(SLICE).map(count).collect_into_vec(&mut slices);
        slices.iter_mut().for_each(|slice| slice.take_places(&mut next));
        slices.par_iter_mut().for_each(|slice| {
            let _traced = placing.task("number");
            slice.place(&mut zeros());
        });
        let numbers: Vec<&[I]> = slices.iter().map(|slice| &slice.numbers[..]).collect();
        mapping.extend_from_slices(&numbers, || storing.task("store"))?;
    }
    let (cells, keys) = cut(&grid.cells, &grid.keys, limit);
    Ok(Numbered { cells, keys, mapping: mapping.finish_column()? })
}

/// Vertices in a row, as one thread counts them.
struct Slice<I> {
    /// Their cells, and then their places.
    numbers: Vec<I>,
    /// Each cell that they lie in, with their number, and then with the first of their places.
    cells: Vec<(u32, I)>,
}

impl<I: Id> Slice<I> {
    /// Counts vertices in these cells; `counts` is zero for each cell, before and after.
    fn count(cells: impl Iterator<Item = u32>, counts: &mut [I]) -> Self {
        let mut met = Vec::new();
        let numbers = cells.inspect(|cell| {
            let count = &mut counts[*cell as usize];
            if *count == I::of(0) {
                met.push((*cell, I::of(0)));
            }
            *count = I::of(count.index() + 1);
        });
        let numbers = numbers.map(|cell| I::of(cell as usize)).collect();
        for (cell, count) in &mut met {
            *count = std::mem::replace(&mut counts[*cell as usize], I::of(0));
        }
        Slice { numbers, cells: met }
    }

    /// Takes the next places of each cell.
    fn take_places(&mut self, next: &mut [usize]) {
        for (cell, count) in &mut self.cells {
            let next = &mut next[*cell as usize];
            (*count, *next) = (I::of(*next), *next + count.index());
        }
    }

    /// Gives each vertex its place; `next` is zero for each cell, before and after.
    fn place(&mut self, next: &mut [I]) {
        self.cells.iter().for_each(|(cell, first)| next[*cell as usize] = *first);
        for number in &mut self.numbers {
            let next = &mut next[number.index()];
            *number = *next;
            *next = I::of(next.index() + 1);
        }
        self.cells.iter().for_each(|(cell, _)| next[*cell as usize] = I::of(0));
    }
}

/// New places of all vertices.
pub(crate) struct Permutation<'a, I: Id> {
    /// By vertex, its place.
    pub(crate) mapping: &'a Column<I>,
    pub(crate) context: &'a Context<'a>,
}

impl<I: Id> ColumnMap for Permutation<'_, I> {
    fn map<T: Pod + Send + Sync>(
        &self,
        from: Column<T>,
        what: &'static str,
    ) -> Result<Column<T>, BuildError> {
        permute(from, self.mapping, what, self.context)
    }
}

/// The items, each at its new place.
fn permute<T: Pod + Send + Sync, I: Id>(
    from: Column<T>,
    mapping: &Column<I>,
    what: &'static str,
    context: &Context<'_>,
) -> Result<Column<T>, BuildError> {
    let mut to = Column::zeroed(&context.store, what, from.len())?;
    if let (Some(items), Some(places), Some(out)) = (from.as_slice(), mapping.as_slice(), to.as_mut_slice()) {
        put(items, places, out, context);
        return Ok(to);
    }

    let (mut items, mut places) = (Vec::new(), Vec::new());
    let mut each = |put: &mut dyn FnMut(I, T) -> Result<(), BuildError>| {
        for start in (0..from.len()).step_by(STEP) {
            context.check()?;
            let range = start..from.len().min(start + STEP);
            let items = from.read(range.clone(), &mut items)?;
            for (place, item) in mapping.read(range, &mut places)?.iter().zip(items) {
                put(*place, *item)?;
            }
        }
        Ok::<(), BuildError>(())
    };

    // If only the result is in memory, each item still goes to its place at once.
    if let Some(out) = to.as_mut_slice() {
        each(&mut |place, item| {
            out[place.index()] = item;
            Ok(())
        })?;
        return Ok(to);
    }

    // On disk that would be a write for each: items are gathered by bucket, and buckets put in order in memory.
    let count = from.len().div_ceil(PLACES);
    let mut placed = Buckets::new(&context.store, what, count, BLOCK);
    let mut sorted = Buckets::new(&context.store, what, count, BLOCK);
    each(&mut |place, item| {
        placed.push(place.index() / PLACES, place)?;
        Ok(sorted.push(place.index() / PLACES, item)?)
    })?;

    let phase = context.trace.phase();
    let place = |(out, items, places): &mut (Vec<T>, Vec<T>, Vec<I>), part: Part<'_, T>| {
        let _traced = phase.task("place");
        context.check()?;
        let (start, bucket) = (part.start(), part.start() / PLACES);
        items.clear();
        places.clear();
        sorted.read(bucket, items)?;
        placed.read(bucket, places)?;
        part.update(out, |out| {
            for (place, item) in places.iter().zip(&*items) {
                out[place.index() - start] = *item;
            }
            Ok::<(), BuildError>(())
        })
    };
    to.parts_mut(PLACES).into_par_iter().try_for_each_init(Default::default, place)?;
    Ok(to)
}

/// Puts each item at its place in `out`. Each part of it is a task that looks at all places, which costs far less than the writes; in a part these
/// are closer together, too.
fn put<T: Pod + Send + Sync, I: Id>(items: &[T], places: &[I], out: &mut [T], context: &Context<'_>) {
    let part = out.len().div_ceil(rayon::current_num_threads().max(PARTS)).max(1);
    let phase = context.trace.phase();
    out.par_chunks_mut(part).enumerate().for_each(|(index, out)| {
        let _traced = phase.task("permute");
        let start = index * part;
        for (place, item) in places.iter().zip(items) {
            if let Some(out) = out.get_mut(place.index().wrapping_sub(start)) {
                *out = *item;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_vertex_finds_its_cell() {
        for (counts, limit) in
            [(vec![1, 1, 1], 5), (vec![70, 1, 1, 1, 900, 3], 1000), (vec![1000, 1, 2000], 64), (vec![5], 5)]
        {
            let cells: Vec<Cell> =
                counts.iter().map(|count| Cell { center: [0.0; 3], count: *count }).collect();
            let (list, keys) = cut(&cells, &vec![7; cells.len()], limit);
            assert_eq!(keys.len(), list.len());
            assert!(list.iter().all(|cell| (1..=limit).contains(&cell.count)));
            let cells = Cells::new(list.iter().map(|cell| cell.count));
            assert_eq!(cells.count(), list.len());
            let mut vertex = 0;
            for cell in 0..list.len() as u32 {
                assert_eq!(cells.range(cell).start, vertex);
                for _ in 0..list[cell as usize].count {
                    assert_eq!(cells.of(vertex), cell, "{vertex} of {counts:?}");
                    vertex += 1;
                }
            }
            assert_eq!(vertex as u32, counts.iter().sum::<u32>());
        }
    }
}
