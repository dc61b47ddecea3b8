//! Joins the corners of a soup of facets that have equal positions, as they are in the file, in memory that the budget bounds.
//!
//! Corners are sorted by position; equal ones become a vertex, numbered in the order of the sort, which follows a Morton curve so that
//! vertices that are near are near in number. What comes out, corner and vertex, is sorted back by corner.

use crate::batch::{Batch, BatchKind, Tally};
use crate::error::ImportError;
use crate::location::SourceLocation;
use crate::reader::{MeshReader, SourceInfo};
use crate::stl::{Corners, StlReader};
use crate::stream::Stream;
use crate::vertex_format::{Coordinates, VertexFormat};
use bytemuck::Pod;
use chpm_extmem::{Sorted, Sorter, Store};
use chpm_mesh::curve::{morton_wide, morton_wide_cell};
use chpm_mesh::{Attributes, Vertices};

/// Vertices or triangles of a batch.
const FULL: usize = 1 << 14;
/// Facets whose corners can be numbered.
const MAX_FACETS: u64 = (u32::MAX / 3) as u64;

/// An STL as a mesh, whose corners are sorted as items `C`.
pub(crate) struct Welder<C> {
    reader: StlReader<Stream>,
    store: Store,
    phase: Phase<C>,
    /// Facets that were taken.
    facets: u64,
    vertices: u64,
    triangles: u64,
    degenerate: u64,
}

enum Phase<C> {
    Reading { soup: Vec<Corners>, corners: Sorter<C> },
    Vertices { corners: Sorted<C>, last: Option<C>, back: Sorter<u64> },
    Triangles { back: Sorted<u64> },
    Ended,
}

impl<C: Corner> Welder<C> {
    pub(crate) fn new(reader: StlReader<Stream>, store: &Store) -> Self {
        let corners = Sorter::new(store, "corners");
        let phase = Phase::Reading { soup: Vec::new(), corners };
        Welder { reader, store: store.clone(), phase, facets: 0, vertices: 0, triangles: 0, degenerate: 0 }
    }

    fn tally(&self) -> Tally {
        let tally = self.reader.tally();
        Tally { degenerate_faces: tally.degenerate_faces + self.degenerate, ..tally }
    }

    /// Hands the corners of the facets that come next to the sort; false if there are none.
    fn read_facets(&mut self, soup: &mut Vec<Corners>, corners: &mut Sorter<C>) -> Result<bool, ImportError> {
        if !self.reader.next_batch(soup)? {
            return Ok(false);
        }
        if self.facets + soup.len() as u64 > MAX_FACETS {
            let place =
                SourceLocation { element: "facet".to_owned(), index: MAX_FACETS, offset: 0, line: None };
            return Err(ImportError::TooMany { place, what: "facets", limit: MAX_FACETS });
        }
        for facet in soup.iter() {
            for (corner, position) in (3 * self.facets..).zip(facet) {
                corners.push(C::new(*position, corner as u32))?;
            }
            self.facets += 1;
        }
        Ok(true)
    }

    /// Gives equal corners, which now follow one another, the number of one vertex, and sends the numbers back by corner; false if
    /// no corner is left. Many corners may be one vertex, so that there may be none for the batch.
    fn join_corners(
        &mut self,
        corners: &mut Sorted<C>,
        last: &mut Option<C>,
        back: &mut Sorter<u64>,
        batch: &mut Batch,
    ) -> Result<bool, ImportError> {
        batch.first = self.vertices;
        let mut taken = 0;
        while taken < FULL
            && let Some(corner) = corners.next()?
        {
            if last.is_none_or(|last| last.place() != corner.place()) {
                *last = Some(corner);
                let position = corner.position();
                match C::COORDINATES {
                    Coordinates::Single => batch.vertices.positions.push(position.map(|x| x as f32)),
                    _ => batch.positions_f64.push(position),
                }
                self.vertices += 1;
            }
            back.push(u64::from(corner.number()) << 32 | (self.vertices - 1))?;
            taken += 1;
        }
        Ok(taken > 0)
    }

    /// Three numbers are a facet again; those with two equal ones are counted. False if none are left.
    fn take_triangles(&mut self, back: &mut Sorted<u64>, batch: &mut Batch) -> Result<bool, ImportError> {
        batch.first = self.triangles;
        let mut taken = 0;
        while taken < FULL
            && let (Some(a), Some(b), Some(c)) = (back.next()?, back.next()?, back.next()?)
        {
            taken += 1;
            let [a, b, c] = [a, b, c].map(|item| item as u32);
            if a == b || b == c || c == a {
                self.degenerate += 1;
            } else {
                batch.triangles.push([a, b, c]);
            }
        }
        self.triangles += batch.triangles.len() as u64;
        Ok(taken > 0)
    }
}

impl<C: Corner> MeshReader for Welder<C> {
    fn format(&self) -> VertexFormat {
        VertexFormat { coordinates: C::COORDINATES, attributes: Attributes::NONE }
    }

    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        *batch = Batch {
            vertices: Vertices::new(take(&mut batch.vertices.positions)),
            positions_f64: take(&mut batch.positions_f64),
            triangles: take(&mut batch.triangles),
            ..Batch::default()
        };

        loop {
            match std::mem::replace(&mut self.phase, Phase::Ended) {
                Phase::Reading { mut soup, mut corners } => {
                    if self.read_facets(&mut soup, &mut corners)? {
                        self.phase = Phase::Reading { soup, corners };
                        return Ok(BatchKind::Vertices);
                    }
                    let back = Sorter::new(&self.store, "corners");
                    self.phase = Phase::Vertices { corners: corners.finish()?, last: None, back };
                }
                Phase::Vertices { mut corners, mut last, mut back } => {
                    if self.join_corners(&mut corners, &mut last, &mut back, batch)? {
                        self.phase = Phase::Vertices { corners, last, back };
                        return Ok(BatchKind::Vertices);
                    }
                    drop(corners);
                    self.phase = Phase::Triangles { back: back.finish()? };
                }
                Phase::Triangles { mut back } => {
                    if self.take_triangles(&mut back, batch)? {
                        self.phase = Phase::Triangles { back };
                        return Ok(BatchKind::Triangles);
                    }
                }
                Phase::Ended => return Ok(BatchKind::End),
            }
        }
    }

    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError> {
        Ok(SourceInfo {
            encoding: self.reader.encoding().to_owned(),
            vertex_count: self.vertices,
            face_count: self.reader.facets(),
            tally: self.tally(),
            warnings: self.reader.warnings().to_vec(),
            ..SourceInfo::default()
        })
    }
}

/// An empty vector with the memory of this one.
fn take<T>(vector: &mut Vec<T>) -> Vec<T> {
    vector.clear();
    std::mem::take(vector)
}

/// A corner as an item to sort: where its position is on the curve, then its number.
///
/// The bits of a position's coordinates that have equal weight are together. Numbers keep their order, negative ones included.
pub(crate) trait Corner: Pod + Ord + Send {
    /// Type of delivered positions.
    const COORDINATES: Coordinates;

    fn new(position: [f64; 3], number: u32) -> Self;

    fn position(self) -> [f64; 3];

    fn number(self) -> u32;

    /// The same for all corners of equal position.
    fn place(self) -> Self;
}

/// Singles: 96 bits and the number.
impl Corner for u128 {
    const COORDINATES: Coordinates = Coordinates::Single;

    fn new(position: [f64; 3], number: u32) -> Self {
        let bits = position.map(|x| {
            let bits = (x as f32).to_bits();
            if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
        });
        interleave(bits) << 32 | u128::from(number)
    }

    fn position(self) -> [f64; 3] {
        fn single(bits: u32) -> f32 {
            f32::from_bits(if bits >> 31 == 1 { bits & !(1 << 31) } else { !bits })
        }
        part(self >> 32).map(|bits| f64::from(single(bits)))
    }

    fn number(self) -> u32 {
        self as u32
    }

    fn place(self) -> Self {
        self >> 32
    }
}

/// Doubles: 192 bits, 32 that stay zero, and the number.
impl Corner for [u128; 2] {
    const COORDINATES: Coordinates = Coordinates::Text;

    fn new(position: [f64; 3], number: u32) -> Self {
        let bits = position.map(ordered);
        let (high, low) =
            (interleave(bits.map(|bits| (bits >> 32) as u32)), interleave(bits.map(|bits| bits as u32)));
        [high << 32 | low >> 64, low << 64 | u128::from(number)]
    }

    fn position(self) -> [f64; 3] {
        let high = part(self[0] >> 32);
        let low = part((self[0] & 0xffff_ffff) << 64 | self[1] >> 64);
        std::array::from_fn(|axis| plain(u64::from(high[axis]) << 32 | u64::from(low[axis])))
    }

    fn number(self) -> u32 {
        self[1] as u32
    }

    fn place(self) -> Self {
        [self[0], self[1] >> 64]
    }
}

/// Bits whose order is that of numbers.
pub(crate) fn ordered(x: f64) -> u64 {
    let bits = x.to_bits();
    if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
}

/// The number of such bits.
pub(crate) fn plain(bits: u64) -> f64 {
    f64::from_bits(if bits >> 63 == 1 { bits & !(1 << 63) } else { !bits })
}

/// 96 bits, those of equal weight together, those of x the highest.
fn interleave([x, y, z]: [u32; 3]) -> u128 {
    morton_wide([z, y, x])
}

fn part(key: u128) -> [u32; 3] {
    let [z, y, x] = morton_wide_cell(key);
    [x, y, z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::Invalid;
    use std::collections::BTreeMap;

    fn stl(facets: &[Corners]) -> Vec<u8> {
        let mut bytes = vec![0; 80];
        bytes.extend((facets.len() as u32).to_le_bytes());
        for facet in facets {
            bytes.extend([0; 12]);
            bytes.extend(facet.as_flattened().iter().flat_map(|x| (*x as f32).to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    type Mesh = (Vec<[f64; 3]>, Vec<[u32; 3]>, u64);

    fn weld<C: Corner>(bytes: Vec<u8>, is_text: bool, limit: u64) -> Mesh {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), limit).unwrap();
        let stream: Stream = Box::new(std::io::Cursor::new(bytes));
        let reader = StlReader::new(stream, is_text, Invalid::Refuse).unwrap();
        let mut welder = Welder::<C>::new(reader, &store);
        let (mut positions, mut triangles, mut batch) = (Vec::new(), Vec::new(), Batch::default());
        loop {
            match welder.next(&mut batch).unwrap_or_else(|_| panic!("a batch")) {
                BatchKind::Vertices => {
                    positions.extend(batch.vertices.positions.iter().map(|p| p.map(f64::from)));
                    positions.append(&mut batch.positions_f64);
                }
                BatchKind::Triangles => triangles.append(&mut batch.triangles),
                BatchKind::End => return (positions, triangles, welder.tally().degenerate_faces),
            }
        }
    }

    fn text(facets: &[Corners]) -> Vec<u8> {
        let mut text = "solid\n".to_owned();
        for facet in facets {
            text += "facet\n";
            facet.iter().for_each(|[x, y, z]| text += &format!("vertex {x} {y} {z}\n"));
            text += "endfacet\n";
        }
        (text + "endsolid\n").into_bytes()
    }

    /// Checks one welding against a map from bits to vertices, in any budget.
    fn check<C: Corner>(bytes: Vec<u8>, is_text: bool, facets: &[Corners]) -> Mesh {
        let (positions, triangles, degenerate) = weld::<C>(bytes.clone(), is_text, 0);
        assert!(weld::<C>(bytes, is_text, 1 << 30) == (positions.clone(), triangles.clone(), degenerate));
        let bits = |p: &[f64; 3]| p.map(f64::to_bits);
        let vertices: BTreeMap<[u64; 3], usize> =
            positions.iter().enumerate().map(|(i, p)| (bits(p), i)).collect();
        assert_eq!(vertices.len(), positions.len(), "no position twice");
        let expected: Vec<[u32; 3]> = (facets.iter().map(|facet| facet.map(|p| vertices[&bits(&p)] as u32)))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        assert_eq!(triangles, expected);
        assert_eq!(degenerate as usize, facets.len() - expected.len());
        (positions, triangles, degenerate)
    }

    #[test]
    fn corners_of_equal_bits_are_one_vertex_in_any_budget() {
        // A lattice of 11 by 13 by 7 places, negative ones included, and corners all over it: 90,000 corners are two runs of
        // a megabyte.
        let place = |i: u64| {
            let [x, y, z] =
                [(i % 11) as f32 - 5.0, (i / 11 % 13) as f32 * 0.1 - 0.3, (i / 143 % 7) as f32 * -1e-20];
            [x, y, z].map(|x| f64::from(x + 0.0))
        };
        let random = |i: u64| i.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
        let facets: Vec<Corners> =
            (0..30_000).map(|i| std::array::from_fn(|k| place(random(3 * i + k as u64)))).collect();
        let binary = check::<u128>(stl(&facets), false, &facets);
        // The same numbers as text are the same mesh.
        assert!(check::<[u128; 2]>(text(&facets), true, &facets) == binary);
        // Singles could not tell these from one another.
        let apart: Vec<Corners> =
            facets.iter().map(|facet| facet.map(|p| p.map(|x| 5e6 + 1e-3 * x))).collect();
        let (positions, ..) = check::<[u128; 2]>(text(&apart), true, &apart);
        assert!(positions.len() > 100, "{}", positions.len());
    }

    #[test]
    fn positions_come_back_from_their_place_on_the_curve() {
        for x in [0.0f32, 1.0, -1.0, 1e-42, -3e38, f32::MAX, 0.1] {
            let p = [x, -x, 7.25].map(f64::from);
            let corner = <u128 as Corner>::new(p, u32::MAX - 7);
            assert_eq!(
                (corner.position().map(f64::to_bits), corner.number()),
                (p.map(f64::to_bits), u32::MAX - 7)
            );

            let p = p.map(|x| x * 1.000_000_000_1);
            let corner = <[u128; 2] as Corner>::new(p, u32::MAX - 7);
            assert_eq!(
                (corner.position().map(f64::to_bits), corner.number()),
                (p.map(f64::to_bits), u32::MAX - 7)
            );
        }

        fn order<C: Corner>() {
            let at = |x: f64| C::new([x, 0.0, 0.0], 9);
            assert!(at(-2.0) < at(-1.0) && at(-1.0) < at(0.0) && at(0.0) < at(1e-30) && at(1.0) < at(2.0));
        }
        order::<u128>();
        order::<[u128; 2]>();
    }

    #[test]
    fn many_corners_in_one_place_come_piece_by_piece() {
        let facets: Vec<Corners> = vec![[[1.0; 3]; 3]; 40_000];
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), 0).unwrap();
        let stream: Stream = Box::new(std::io::Cursor::new(stl(&facets)));
        let reader = StlReader::new(stream, false, Invalid::Refuse).unwrap();
        let mut welder = Welder::<u128>::new(reader, &store);
        let (mut batch, mut kinds) = (Batch::default(), [0, 0]);
        loop {
            match welder.next(&mut batch).unwrap_or_else(|_| panic!("a batch")) {
                BatchKind::Vertices => kinds[0] += 1,
                BatchKind::Triangles => kinds[1] += 1,
                BatchKind::End => break,
            }
        }
        assert_eq!(welder.tally().degenerate_faces, 40_000);
        assert!(kinds[0] >= 120_000 / FULL && kinds[1] >= 40_000 / FULL, "{kinds:?}");
    }
}
