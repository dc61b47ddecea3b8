//! Joins the corners of a soup of facets that have equal positions, bit by bit, in memory that the budget bounds.
//!
//! Corners are sorted by position; equal ones become a vertex, numbered in the order of the sort, which follows a Morton curve so that
//! vertices that are near are near in number. What comes out, corner and vertex, is sorted back by corner.

use super::sorter::{Sorted, Sorter};
use super::stream::Stream;
use crate::error::BuildError;
use chpm_extmem::Store;
use chpm_mesh::Attributes;
use chpm_mesh::import::{Corners, ImportError, StlReader};
use chpm_mesh::ply::{Batch, BatchKind, Place, Tally, VertexFormat};

/// Vertices or triangles of a batch.
const FULL: usize = 1 << 14;
/// Facets whose corners can be numbered.
const MAX_FACETS: u64 = (u32::MAX / 3) as u64;

/// An STL as a mesh.
pub(super) struct Welder {
    reader: StlReader<Stream>,
    store: Store,
    phase: Phase,
    /// Facets that were taken.
    facets: u64,
    vertices: u64,
    triangles: u64,
    degenerate: u64,
}

enum Phase {
    Reading { soup: Vec<Corners>, corners: Sorter<u128> },
    Vertices { corners: Sorted<u128>, last: Option<u128>, back: Sorter<u64> },
    Triangles { back: Sorted<u64> },
    Ended,
}

/// What can go wrong while welding.
pub(super) enum WeldError {
    Import(ImportError),
    Build(Box<BuildError>),
}

impl From<ImportError> for WeldError {
    fn from(error: ImportError) -> Self {
        WeldError::Import(error)
    }
}

impl From<BuildError> for WeldError {
    fn from(error: BuildError) -> Self {
        WeldError::Build(Box::new(error))
    }
}

impl Welder {
    pub(super) fn new(reader: StlReader<Stream>, store: &Store) -> Self {
        let corners = Sorter::new(store, "corners");
        let phase = Phase::Reading { soup: Vec::new(), corners };
        Welder { reader, store: store.clone(), phase, facets: 0, vertices: 0, triangles: 0, degenerate: 0 }
    }

    pub(super) fn vertex_format(&self) -> VertexFormat {
        VertexFormat { double: false, attributes: Attributes { normals: false, colors: false } }
    }

    /// Vertices up to now.
    pub(super) fn vertices(&self) -> u64 {
        self.vertices
    }

    pub(super) fn reader(&self) -> &StlReader<Stream> {
        &self.reader
    }

    pub(super) fn tally(&self) -> Tally {
        let tally = self.reader.tally();
        Tally { degenerate_faces: tally.degenerate_faces + self.degenerate, ..tally }
    }

    /// Does a piece of work. Vertices may be none, while the facets are read.
    pub(super) fn next_batch(&mut self, batch: &mut Batch) -> Result<BatchKind, WeldError> {
        *batch = Batch {
            positions: take(&mut batch.positions),
            triangles: take(&mut batch.triangles),
            ..Batch::default()
        };
        loop {
            match &mut self.phase {
                Phase::Reading { soup, corners } => {
                    if self.reader.next_batch(soup)? {
                        if self.facets + soup.len() as u64 > MAX_FACETS {
                            let place = Place {
                                element: "facet".to_owned(),
                                index: MAX_FACETS,
                                offset: 0,
                                line: None,
                            };
                            return Err(
                                ImportError::TooMany { place, what: "facets", limit: MAX_FACETS }.into()
                            );
                        }
                        for facet in soup.iter() {
                            for (corner, position) in (3 * self.facets..).zip(facet) {
                                corners.push(morton(*position) << 32 | u128::from(corner))?;
                            }
                            self.facets += 1;
                        }
                        return Ok(BatchKind::Vertices);
                    }
                    let Phase::Reading { corners, .. } = std::mem::replace(&mut self.phase, Phase::Ended)
                    else {
                        return Ok(BatchKind::End);
                    };
                    let back = Sorter::new(&self.store, "corners");
                    self.phase = Phase::Vertices { corners: corners.finish()?, last: None, back };
                }
                Phase::Vertices { corners, last, back } => {
                    batch.first = self.vertices;
                    while batch.positions.len() < FULL
                        && let Some(item) = corners.next()?
                    {
                        let (key, corner) = (item >> 32, item as u32);
                        if *last != Some(key) {
                            *last = Some(key);
                            batch.positions.push(position(key));
                            self.vertices += 1;
                        }
                        back.push(u64::from(corner) << 32 | (self.vertices - 1))?;
                    }
                    if !batch.positions.is_empty() {
                        return Ok(BatchKind::Vertices);
                    }
                    let Phase::Vertices { corners, back, .. } =
                        std::mem::replace(&mut self.phase, Phase::Ended)
                    else {
                        return Ok(BatchKind::End);
                    };
                    drop(corners);
                    self.phase = Phase::Triangles { back: back.finish()? };
                }
                Phase::Triangles { back } => {
                    batch.first = self.triangles;
                    while batch.triangles.len() < FULL
                        && let (Some(a), Some(b), Some(c)) = (back.next()?, back.next()?, back.next()?)
                    {
                        let [a, b, c] = [a, b, c].map(|item| item as u32);
                        if a == b || b == c || c == a {
                            self.degenerate += 1;
                        } else {
                            batch.triangles.push([a, b, c]);
                        }
                    }
                    if !batch.triangles.is_empty() {
                        self.triangles += batch.triangles.len() as u64;
                        return Ok(BatchKind::Triangles);
                    }
                    self.phase = Phase::Ended;
                }
                Phase::Ended => return Ok(BatchKind::End),
            }
        }
    }
}

/// An empty vector with the memory of this one.
fn take<T>(vector: &mut Vec<T>) -> Vec<T> {
    vector.clear();
    std::mem::take(vector)
}

/// The bits of a position, those of equal weight together. Numbers keep their order, negative ones included.
fn morton(position: [f32; 3]) -> u128 {
    let [x, y, z] = position.map(|x| {
        let bits = x.to_bits();
        spread(if bits >> 31 == 1 { !bits } else { bits | 1 << 31 })
    });
    x << 2 | y << 1 | z
}

fn position(key: u128) -> [f32; 3] {
    [key >> 2, key >> 1, key].map(|key| {
        let bits = gather(key);
        f32::from_bits(if bits >> 31 == 1 { bits & !(1 << 31) } else { !bits })
    })
}

/// Puts two zeros in front of each bit.
fn spread(bits: u32) -> u128 {
    let half = |bits: u32| {
        let mut x = u64::from(bits & 0xffff);
        x = (x | x << 16) & 0xff00_00ff;
        x = (x | x << 8) & 0x00f0_0f00_f00f;
        x = (x | x << 4) & 0x0c30_c30c_30c3;
        (x | x << 2) & 0x2492_4924_9249
    };
    u128::from(half(bits)) | u128::from(half(bits >> 16)) << 48
}

/// Takes every third bit.
fn gather(bits: u128) -> u32 {
    (0..32).fold(0, |all, i| all | ((bits >> (3 * i)) as u32 & 1) << i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_mesh::import::Format;
    use chpm_mesh::ply::Invalid;
    use std::collections::BTreeMap;

    fn stl(facets: &[Corners]) -> Vec<u8> {
        let mut bytes = vec![0; 80];
        bytes.extend((facets.len() as u32).to_le_bytes());
        for facet in facets {
            bytes.extend([0; 12]);
            bytes.extend(facet.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn weld(facets: &[Corners], limit: u64) -> (Vec<[f32; 3]>, Vec<[u32; 3]>, u64) {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), limit).unwrap();
        let stream: Stream = Box::new(std::io::Cursor::new(stl(facets)));
        let reader = StlReader::new(stream, Format::StlBinary, Invalid::Refuse).unwrap();
        let mut welder = Welder::new(reader, &store);
        let (mut positions, mut triangles, mut batch) = (Vec::new(), Vec::new(), Batch::default());
        loop {
            match welder.next_batch(&mut batch).unwrap_or_else(|_| panic!("a batch")) {
                BatchKind::Vertices => positions.append(&mut batch.positions),
                BatchKind::Triangles => triangles.append(&mut batch.triangles),
                BatchKind::End => return (positions, triangles, welder.tally().degenerate_faces),
            }
        }
    }

    #[test]
    fn corners_of_equal_bits_are_one_vertex_in_any_budget() {
        // A lattice of 11 by 13 by 7 places, negative ones included, and corners all over it: 90,000 corners are two runs of
        // a megabyte.
        let place =
            |i: u64| [(i % 11) as f32 - 5.0, (i / 11 % 13) as f32 * 0.1 - 0.3, (i / 143 % 7) as f32 * -1e-20];
        let random = |i: u64| i.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
        let facets: Vec<Corners> = (0..30_000)
            .map(|i| std::array::from_fn(|k| place(random(3 * i + k as u64)).map(|x| x + 0.0)))
            .collect();
        let (positions, triangles, degenerate) = weld(&facets, 0);
        assert!(weld(&facets, 1 << 30) == (positions.clone(), triangles.clone(), degenerate));
        // By a map from bits to vertices.
        let bits = |p: &[f32; 3]| p.map(f32::to_bits);
        let vertices: BTreeMap<[u32; 3], usize> =
            positions.iter().enumerate().map(|(i, p)| (bits(p), i)).collect();
        assert_eq!(vertices.len(), positions.len(), "no position twice");
        let expected: Vec<[u32; 3]> = (facets.iter().map(|facet| facet.map(|p| vertices[&bits(&p)] as u32)))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        assert_eq!(triangles, expected);
        assert_eq!(degenerate as usize, facets.len() - expected.len());
    }

    #[test]
    fn positions_come_back_from_their_place_on_the_curve() {
        for x in [0.0f32, 1.0, -1.0, 1e-42, -3e38, f32::MAX, 0.1] {
            let p = [x, -x, 7.25];
            assert_eq!(position(morton(p)).map(f32::to_bits), p.map(f32::to_bits));
        }
        assert!(morton([-2.0, 0.0, 0.0]) < morton([-1.0, 0.0, 0.0]) && morton([-1.0; 3]) < morton([1.0; 3]));
    }
}
