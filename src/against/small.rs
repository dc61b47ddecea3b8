//! Components of the source that are smaller than the file says it has: they are not to be in the leaves.
//!
//! The source is read twice. First its triangles' vertices are noted and joined; corners of facets are joined where they have the same
//! position. Then each component gets its box, whose diagonal is its size. Where not all vertices fit into memory, the joining looks up
//! blocks of a file, and takes its time if triangles are in no order.

use super::mesh::{Corners, Triangle};
use super::paged::Paged;
use crate::stop;
use anyhow::{Result, bail, ensure};
use bytemuck::Pod;
use chpm_build::Cancel;
use chpm_extmem::{Buckets, BufferWriter, Column, Reservation, Store};
use chpm_format::Chpm;
use xxhash_rust::xxh3::xxh3_128;

/// Items of a column that are read at once.
const WINDOW: usize = 1 << 14;
/// Buckets of places, vertices of a bucket of pairs, and bytes that each gathers.
const PLACES: usize = 1 << 10;
const VERTICES: usize = 1 << 16;
const BLOCK: usize = 1 << 11;
/// Places that are remembered, so that a million corners in one place are one record.
const RECENT: usize = 1 << 14;

/// Size below which a component is left out.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Size {
    Units(f64),
    /// Percent of the diagonal of the source's box.
    Percent(f64),
}

impl Size {
    /// Size that the file was built with, if it was.
    pub(super) fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Result<Option<Size>> {
        let settings = file.metadata().map(|metadata| metadata.settings).unwrap_or_default();
        let Some((_, told)) = settings.into_iter().find(|(name, _)| name == "min-component") else {
            return Ok(None);
        };
        let number = |text: &str| text.parse().ok().filter(|size: &f64| *size >= 0.0);
        let size = match told.strip_suffix('%') {
            Some(percent) => number(percent).map(Size::Percent),
            None => number(&told).map(Size::Units),
        };
        if size.is_none() {
            bail!("the file names '{told}' as its min-component, which is no size");
        }
        Ok(size)
    }
}

/// Takes the triangles of the source, and then their corners again.
pub(super) struct Search<'a> {
    store: &'a Store,
    vertices: BufferWriter<[u32; 3]>,
    /// The triangles that are noted next.
    fresh: Vec<[u32; 3]>,
    /// Corners of facets: a hash of the position and the corner's number. What has the place of a recent one has its number, too.
    places: Buckets<[u32; 4]>,
    recent: Vec<Option<[u32; 4]>>,
    /// First error.
    failed: Result<()>,
}

impl<'a> Search<'a> {
    pub(super) fn new(store: &'a Store) -> Result<Self> {
        let vertices = BufferWriter::new(store, "vertices of triangles", 0)?;
        let places = Buckets::new(store, "places of corners", PLACES, BLOCK);
        let recent = vec![None; RECENT];
        Ok(Search { store, vertices, fresh: Vec::new(), places, recent, failed: Ok(()) })
    }

    pub(super) fn add(&mut self, triangle: &Triangle) {
        if self.failed.is_ok() {
            self.failed = self.note(triangle);
        }
    }

    fn note(&mut self, triangle: &Triangle) -> Result<()> {
        let mut vertices = triangle.vertices;
        if triangle.is_facet {
            for (corner, vertex) in triangle.corners.iter().zip(&mut vertices) {
                // Positions of one file are nothing to those of another.
                let [x, y, z] = corner.map(f64::to_bits);
                let hash = xxh3_128(bytemuck::cast_slice(&[u64::from(triangle.file), x, y, z]));
                let [a, b, c] = [hash >> 96, hash >> 64, hash >> 32].map(|word| word as u32);
                let place = [a, b, c, *vertex];
                let recent = &mut self.recent[b as usize % RECENT];
                match *recent {
                    Some([.., known]) if recent.is_some_and(|recent| recent[..3] == place[..3]) => {
                        *vertex = known
                    }
                    _ => {
                        *recent = Some(place);
                        self.places.push(a as usize % PLACES, place)?;
                    }
                }
            }
        }
        self.fresh.push(vertices);
        if self.fresh.len() == WINDOW {
            self.vertices.extend_from_slice(&self.fresh)?;
            self.fresh.clear();
        }
        Ok(())
    }

    /// Finds the components of all that was added, which has so many vertices.
    pub(super) fn join(mut self, vertices: u32, cancel: &Cancel) -> Result<Boxes> {
        self.failed?;
        self.vertices.extend_from_slice(&self.fresh)?;
        let triangles = self.vertices.finish_column()?;
        let mut sets = Sets(Paged::zeroed(self.store, "sets of vertices", vertices as usize)?);
        join_places(&self.places, vertices, self.store, &mut sets, cancel)?;
        each(&triangles, cancel, |[a, b, c]| {
            sets.join(a, b)?;
            sets.join(a, c)
        })?;
        let mut numbers = Paged::<u32>::zeroed(self.store, "numbers of components", vertices as usize)?;
        let mut of = BufferWriter::new(self.store, "components of triangles", triangles.len())?;
        let mut count = 0;
        each(&triangles, cancel, |[a, ..]| {
            let root = sets.root(a)? as usize;
            let mut number = numbers.get(root)?;
            if number == 0 {
                count += 1;
                number = count;
                numbers.set(root, number)?;
            }
            Ok(of.extend_from_slice(&[number - 1])?)
        })?;
        let boxes = Paged::zeroed(self.store, "boxes of components", count as usize)?;
        Ok(Boxes { of: of.finish_column()?, at: Window::default(), boxes, count, seen: 0, failed: Ok(()) })
    }
}

/// Joins corners of equal position.
fn join_places(
    places: &Buckets<[u32; 4]>,
    vertices: u32,
    store: &Store,
    sets: &mut Sets,
    cancel: &Cancel,
) -> Result<()> {
    // In the order of the source again, in which neighbours are near.
    let mut pairs = Buckets::new(store, "corners of equal position", vertices as usize / VERTICES + 1, BLOCK);
    let mut corners = Vec::new();
    for bucket in 0..places.count() {
        stop::check(cancel)?;
        corners.clear();
        places.read(bucket, &mut corners)?;
        corners.sort_unstable();
        for same in corners.chunk_by(|a, b| a[..3] == b[..3]) {
            for corner in &same[1..] {
                pairs.push(corner[3] as usize / VERTICES, [corner[3], same[0][3]])?;
            }
        }
    }
    let mut block = Vec::new();
    for bucket in 0..pairs.count() {
        for number in 0..pairs.block_count(bucket) {
            stop::check(cancel)?;
            pairs.read_block(bucket, number, &mut block)?;
            for [a, b] in &block {
                sets.join(*a, *b)?;
            }
        }
    }
    Ok(())
}

/// Sets of vertices. Each vertex has how far before it another one of its set is, and the first of a set has zero.
struct Sets(Paged<u32>);

impl Sets {
    fn root(&mut self, mut vertex: u32) -> Result<u32> {
        loop {
            let back = self.0.get(vertex as usize)?;
            if back == 0 {
                return Ok(vertex);
            }
            let further = self.0.get((vertex - back) as usize)?;
            if further > 0 {
                self.0.set(vertex as usize, back + further)?;
            }
            vertex -= back + further;
        }
    }

    fn join(&mut self, a: u32, b: u32) -> Result<()> {
        let (a, b) = (self.root(a)?, self.root(b)?);
        if a == b { Ok(()) } else { self.0.set(a.max(b) as usize, a.abs_diff(b)) }
    }
}

/// The components, numbered by their first triangles, while they get their boxes.
pub(super) struct Boxes {
    /// By triangle its component.
    of: Column<u32>,
    at: Window,
    /// Least and largest coordinates.
    boxes: Paged<[f64; 6]>,
    count: u32,
    /// Components that have a box.
    seen: u32,
    failed: Result<()>,
}

impl Boxes {
    /// Takes the next triangle.
    pub(super) fn add(&mut self, corners: Corners) {
        if self.failed.is_ok() {
            self.failed = self.extend(corners);
        }
    }

    fn extend(&mut self, corners: Corners) -> Result<()> {
        let number = self.at.next(&self.of)?;
        let mut extent = match number == self.seen {
            true => EMPTY,
            false => self.boxes.get(number as usize)?,
        };
        self.seen += u32::from(number == self.seen);
        for corner in corners {
            for (axis, x) in corner.into_iter().enumerate() {
                extent[axis] = extent[axis].min(x);
                extent[3 + axis] = extent[3 + axis].max(x);
            }
        }
        self.boxes.set(number as usize, extent)
    }

    /// Tells the small ones.
    pub(super) fn finish(mut self, size: Size, store: &Store) -> Result<Small> {
        self.failed?;
        let mut whole = EMPTY;
        for number in 0..self.count as usize {
            let extent = self.boxes.get(number)?;
            for axis in 0..3 {
                whole[axis] = whole[axis].min(extent[axis]);
                whole[3 + axis] = whole[3 + axis].max(extent[3 + axis]);
            }
        }
        let least = match size {
            Size::Units(least) => least,
            Size::Percent(percent) => percent / 100.0 * diagonal(whole),
        };
        let words = self.count as usize / 64 + 1;
        let share = store.budget.reserve_work("small components", 8 * words as u64)?;
        let mut small = Small { of: self.of, words: vec![0; words], components: 0, _share: share };
        for number in 0..self.count as usize {
            if diagonal(self.boxes.get(number)?) < least {
                small.words[number / 64] |= 1 << (number % 64);
                small.components += 1;
            }
        }
        Ok(small)
    }
}

const EMPTY: [f64; 6] = {
    let (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
    [low, low, low, high, high, high]
};

fn diagonal([x, y, z, far_x, far_y, far_z]: [f64; 6]) -> f64 {
    let (x, y, z) = (far_x - x, far_y - y, far_z - z);
    (x * x + y * y + z * z).sqrt()
}

/// Which triangles belong to small components.
pub(super) struct Small {
    of: Column<u32>,
    /// A bit for each component.
    words: Vec<u64>,
    pub(super) components: u64,
    _share: Reservation,
}

impl Small {
    /// Whether the next triangle does.
    pub(super) fn next(&self, at: &mut Window) -> Result<bool> {
        let number = at.next(&self.of)? as usize;
        Ok(self.words[number / 64] >> (number % 64) & 1 == 1)
    }
}

/// A place in a column of numbers that are read one after the other.
#[derive(Default)]
pub(super) struct Window {
    start: usize,
    at: usize,
    numbers: Vec<u32>,
    scratch: Vec<u32>,
}

impl Window {
    fn next(&mut self, column: &Column<u32>) -> Result<u32> {
        if self.at == self.numbers.len() {
            self.start += self.numbers.len();
            let end = column.len().min(self.start + WINDOW);
            ensure!(self.start < end, CHANGED);
            self.numbers.clear();
            self.numbers.extend_from_slice(column.read(self.start..end, &mut self.scratch)?);
            self.at = 0;
        }
        self.at += 1;
        Ok(self.numbers[self.at - 1])
    }
}

const CHANGED: &str = "the source has changed while it was read";

/// Shows all items in their order.
fn each<T: Pod>(column: &Column<T>, cancel: &Cancel, mut look: impl FnMut(T) -> Result<()>) -> Result<()> {
    let mut scratch = Vec::new();
    for start in (0..column.len()).step_by(WINDOW) {
        stop::check(cancel)?;
        let items = column.read(start..column.len().min(start + WINDOW), &mut scratch)?;
        items.iter().try_for_each(|item| look(*item))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether each triangle belongs to a component below a size of 2, and how many such components there are.
    fn small(triangles: &[Triangle], vertices: u32, memory: u64) -> (Vec<bool>, u64) {
        let folder = tempfile::tempdir().unwrap();
        let (store, cancel) = (Store::create(folder.path(), memory).unwrap(), Cancel::default());
        let mut search = Search::new(&store).unwrap();
        triangles.iter().for_each(|triangle| search.add(triangle));
        let mut boxes = search.join(vertices, &cancel).unwrap();
        triangles.iter().for_each(|triangle| boxes.add(triangle.corners));
        let small = boxes.finish(Size::Units(2.0), &store).unwrap();
        let mut at = Window::default();
        let is_small = triangles.iter().map(|_| small.next(&mut at).unwrap()).collect();
        assert!(small.next(&mut at).is_err(), "no triangle more");
        (is_small, small.components)
    }

    fn triangle(place: impl Fn(u32) -> [f64; 3], vertices: [u32; 3], file: u32) -> Triangle {
        let corners = vertices.map(place);
        Triangle { corners, vertices, is_facet: false, is_told_single: false, file }
    }

    /// Strips along an axis, of 2 to 6 triangles each, with all triangles in any order.
    #[test]
    fn strips_are_small_by_their_own_length_in_any_memory() {
        let mut triangles = Vec::new();
        let place = |v: u32| [0.5 * f64::from(v % 10), f64::from(v / 10), 0.0];
        for strip in 0..40_000u32 {
            let first = 10 * strip;
            triangles.extend((first..first + 2 + strip % 5).map(|v| triangle(place, [v, v + 1, v + 2], 0)));
        }
        triangles.sort_by_key(|t| t.vertices[0].wrapping_mul(0x9e37_79b9));
        // Half a unit for each of up to 8 vertices: those of three triangles more than the first measure 2.
        let expected: Vec<bool> = triangles.iter().map(|t| (t.vertices[0] / 10) % 5 < 1).collect();
        for memory in [0, 1 << 30] {
            let (found, components) = small(&triangles, 400_000, memory);
            assert_eq!(components, 8_000);
            assert!(found == expected);
        }
    }

    #[test]
    fn facets_are_joined_by_position_within_their_file() {
        let square = |x: f64| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0], [x + 1.0, 1.0, 0.0]];
        let facets = |x: f64, file: u32| {
            let [a, b, c, d] = square(x);
            [[a, b, c], [c, b, d]].map(|corners| (corners, file))
        };
        let all = [facets(0.0, 0), facets(1.0, 0), facets(9.0, 0), facets(10.0, 12)].concat();
        let facet = |(n, (corners, file)): (usize, &(Corners, u32))| {
            let first = 3 * n as u32;
            let vertices = [first, first + 1, first + 2];
            Triangle { corners: *corners, vertices, is_facet: true, is_told_single: false, file: *file }
        };
        let triangles: Vec<Triangle> = all.iter().enumerate().map(facet).collect();
        for memory in [0, 1 << 30] {
            let (found, components) = small(&triangles, 24, memory);
            assert_eq!(components, 2);
            assert_eq!(found, [false, false, false, false, true, true, true, true]);
        }
    }
}
