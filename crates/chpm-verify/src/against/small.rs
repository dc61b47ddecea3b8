//! Components of the source that are smaller than the file says it has: they are not to be in the leaves.
//!
//! The vertices of each triangle are joined, and each component gets its box, whose diagonal is its size. Where not all vertices fit into
//! memory, the joining looks up blocks of a file, and takes its time if triangles are in no order.

use super::source::{Corners, Source};
use crate::error::VerifyError;
use chpm_extmem::{BufferWriter, Cancel, Column, Paged, Progress, Reservation, Store};
use chpm_format::Chpm;

/// Items of a column that are read at once.
const WINDOW: usize = 1 << 14;

/// Size below which a component is left out.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Size {
    Units(f64),
    /// Percent of the diagonal of the source's box.
    Percent(f64),
}

impl Size {
    /// Size that the file was built with, if it was.
    pub(super) fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Result<Option<Size>, VerifyError> {
        let settings = file.metadata().map(|metadata| metadata.settings).unwrap_or_default();
        let Some((_, told)) = settings.into_iter().find(|(name, _)| name == "min-component") else {
            return Ok(None);
        };
        let (number, size): (&str, fn(f64) -> Size) = match told.strip_suffix('%') {
            Some(percent) => (percent, Size::Percent),
            None => (&told, Size::Units),
        };
        match number.parse().ok().filter(|number| *number >= 0.0) {
            Some(number) => Ok(Some(size(number))),
            None => Err(VerifyError::Size { got: told }),
        }
    }
}

/// Finds the small components of a source.
pub(super) fn find(
    source: &mut Source,
    size: Size,
    store: &Store,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Small, VerifyError> {
    progress.begin("components", 2 * source.triangle_count());
    let (of, count) = components(source, store, progress, cancel)?;
    let boxes = boxes(source, &of, count, store, progress, cancel)?;
    progress.end();
    small(of, boxes, size, store)
}

/// By triangle its component, numbered by their first triangles; and how many there are.
fn components(
    source: &Source,
    store: &Store,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<(Column<u32>, u32), VerifyError> {
    let vertices = source.vertex_count();
    let mut sets = Sets(Paged::zeroed(store, "sets of vertices", vertices)?);
    source.each_triangle(cancel, |[a, b, c]| {
        sets.join(a, b)?;
        sets.join(a, c)
    })?;
    progress.advance(source.triangle_count());

    let mut numbers = Paged::<u32>::zeroed(store, "numbers of components", vertices)?;
    let mut of = BufferWriter::new(store, "components of triangles", source.triangle_count() as usize)?;
    let mut count = 0;
    source.each_triangle(cancel, |[a, ..]| {
        let root = sets.root(a)? as usize;
        let mut number = numbers.get(root)?;
        if number == 0 {
            count += 1;
            number = count;
            numbers.set(root, number)?;
        }
        Ok(of.extend_from_slice(&[number - 1])?)
    })?;
    Ok((of.finish_column()?, count))
}

/// Least and largest coordinates of each component.
fn boxes(
    source: &mut Source,
    of: &Column<u32>,
    count: u32,
    store: &Store,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Paged<[f64; 6]>, VerifyError> {
    let mut boxes = Paged::zeroed(store, "boxes of components", count as usize)?;
    let (mut at, mut seen) = (Window::default(), 0);
    source.each_corners(cancel, |corners| {
        let number = at.next(of)?;
        let before = if number == seen { EMPTY } else { boxes.get(number as usize)? };
        seen += u32::from(number == seen);
        Ok(boxes.set(number as usize, enclosing(before, corners))?)
    })?;
    progress.advance(source.triangle_count());
    Ok(boxes)
}

fn enclosing(mut extent: [f64; 6], corners: Corners) -> [f64; 6] {
    for corner in corners {
        for (axis, x) in corner.into_iter().enumerate() {
            extent[axis] = extent[axis].min(x);
            extent[3 + axis] = extent[3 + axis].max(x);
        }
    }
    extent
}

/// Tells the small ones by their boxes.
fn small(
    of: Column<u32>,
    mut boxes: Paged<[f64; 6]>,
    size: Size,
    store: &Store,
) -> Result<Small, VerifyError> {
    let count = boxes.len();
    let mut whole = EMPTY;
    for number in 0..count {
        let extent = boxes.get(number)?;
        for axis in 0..3 {
            whole[axis] = whole[axis].min(extent[axis]);
            whole[3 + axis] = whole[3 + axis].max(extent[3 + axis]);
        }
    }
    let least = match size {
        Size::Units(least) => least,
        Size::Percent(percent) => percent / 100.0 * diagonal(whole),
    };

    let words = count / 64 + 1;
    let share = store.budget.reserve_work("small components", 8 * words as u64)?;
    let mut small = Small { of, words: vec![0; words], components: 0, _share: share };
    for number in 0..count {
        if diagonal(boxes.get(number)?) < least {
            small.words[number / 64] |= 1 << (number % 64);
            small.components += 1;
        }
    }
    Ok(small)
}

/// Sets of vertices. Each vertex has how far before it another one of its set is, and the first of a set has zero.
struct Sets(Paged<u32>);

impl Sets {
    fn root(&mut self, mut vertex: u32) -> Result<u32, VerifyError> {
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

    fn join(&mut self, a: u32, b: u32) -> Result<(), VerifyError> {
        let (a, b) = (self.root(a)?, self.root(b)?);
        if a == b { Ok(()) } else { Ok(self.0.set(a.max(b) as usize, a.abs_diff(b))?) }
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
    pub(super) fn next(&self, at: &mut Window) -> Result<bool, VerifyError> {
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
    fn next(&mut self, column: &Column<u32>) -> Result<u32, VerifyError> {
        if self.at == self.numbers.len() {
            self.start += self.numbers.len();
            // Beyond the end the column says so.
            let end = column.len().min(self.start + WINDOW).max(self.start + 1);
            self.numbers.clear();
            self.numbers.extend_from_slice(column.read(self.start..end, &mut self.scratch)?);
            self.at = 0;
        }
        self.at += 1;
        Ok(self.numbers[self.at - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_extmem::Silent;
    use chpm_import::ply::{Encoding, write_mesh};
    use chpm_mesh::TriMesh;
    use std::fs::File;

    /// Strips along an axis, of 2 to 6 triangles each, with all triangles in any order.
    #[test]
    fn strips_are_small_by_their_own_length_in_any_memory() {
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        for strip in 0..40_000u32 {
            let first = 10 * strip;
            triangles.extend((first..first + 2 + strip % 5).map(|v| [v, v + 1, v + 2]));
        }
        triangles.sort_by_key(|t| t[0].wrapping_mul(0x9e37_79b9));
        // Half a unit for each of up to 8 vertices: those of three triangles more than the first measure 2.
        let expected: Vec<bool> = triangles.iter().map(|t| (t[0] / 10) % 5 < 1).collect();
        let place = |v: u32| [0.5 * (v % 10) as f32, (v / 10) as f32, 0.0];
        let mesh = TriMesh::new((0..400_000).map(place).collect(), triangles);

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("strips.ply");
        write_mesh(File::create(&path).unwrap(), &mesh, Encoding::BinaryLittleEndian).unwrap();
        for memory in [0, 1 << 30] {
            let (store, cancel) = (Store::create(folder.path(), memory).unwrap(), Cancel::default());
            let mut source = Source::read(&path, false, Vec::new(), &store, &cancel, |_| ()).unwrap();
            let small = find(&mut source, Size::Units(2.0), &store, &Silent, &cancel).unwrap();
            let mut at = Window::default();
            let found: Vec<bool> = expected.iter().map(|_| small.next(&mut at).unwrap()).collect();
            assert!(small.next(&mut at).is_err(), "no triangle more");
            assert_eq!(small.components, 8_000);
            assert!(found == expected);
        }
    }
}
