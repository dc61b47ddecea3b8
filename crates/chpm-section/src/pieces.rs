//! Pieces of lines: what planes cut out of the mesh of one cluster.

use crate::chain::{End, chains};
use crate::planes::Planes;
use chpm_format::Page;
use chpm_mesh::Places;
use std::cmp::Ordering;
use std::ops::Range;

/// Edge of a cluster's mesh that crosses a plane: the vertex above it, and the one below, in local indices.
type Edge = [u16; 2];
/// The same by shared ids, which all clusters know it by.
pub(crate) type SharedEdge = [u32; 2];

/// A piece of a line.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    /// Which plane.
    pub(crate) plane: u32,
    /// Where its points are in [`Pieces::points`]; one after the other differ.
    pub(crate) points: Range<usize>,
    /// The edges at its ends, where other clusters may have them.
    pub(crate) ends: [Option<SharedEdge>; 2],
    pub(crate) is_closed: bool,
}

/// Pieces of one cluster.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pieces {
    /// Relative to the file's origin.
    pub(crate) points: Vec<[f64; 3]>,
    pub(crate) pieces: Vec<Piece>,
}

/// Shared id of a vertex that is not shared.
const INTERIOR: u32 = u32::MAX;

impl Pieces {
    /// Cuts the mesh of `n` vertices of a page by some of the planes. A triangle with corners on both sides of a plane has one edge that
    /// goes down and one that goes up; from the former to the latter its segment has the inside of what it bounds on its left.
    pub(crate) fn cut(page: &Page<'_>, n: usize, planes: &Planes, range: Range<usize>) -> Self {
        let offsets = &planes.offsets()[range.clone()];
        let below = |point: &[f32; 3]| {
            let height = planes.height(*point);
            // Most clusters are crossed by a single plane.
            match offsets {
                [offset] => u32::from(*offset <= height),
                _ => offsets.partition_point(|offset| *offset <= height) as u32,
            }
        };
        let ranks: Vec<u32> = page.positions[..n].iter().map(below).collect();
        let mut segments = Segments { ranks: &ranks, planes, first: range.start, ends: Vec::new() };
        if n == page.vertex_count() {
            page.triangles.iter().for_each(|corners| segments.add(*corners));
        } else {
            let mut places = Places::default();
            places.go_to(&page.progressive_mesh(), n);
            places.triangles(page.triangles).for_each(|corners| segments.add(corners));
        }
        segments.joined(page)
    }

    /// Bytes of memory that pieces like these take until their lines are there.
    pub(crate) fn bytes(&self) -> u64 {
        144 * self.points.len() as u64 + 192 * self.pieces.len() as u64
    }
}

/// The segments of a cluster by the edges at their ends.
struct Segments<'a> {
    /// By vertex: how many of the planes it is above.
    ranks: &'a [u32],
    planes: &'a Planes,
    /// The first of these planes.
    first: usize,
    ends: Vec<[Option<(u32, Edge)>; 2]>,
}

impl Segments<'_> {
    #[inline]
    fn add(&mut self, corners: [u16; 3]) {
        let ranks = corners.map(|corner| self.ranks[usize::from(corner)]);
        if ranks[0] != ranks[1] || ranks[1] != ranks[2] {
            self.cross(corners, ranks);
        }
    }

    /// Adds the segments of a triangle that is on both sides of a plane.
    fn cross(&mut self, corners: [u16; 3], ranks: [u32; 3]) {
        let (low, high) = (ranks[0].min(ranks[1]).min(ranks[2]), ranks[0].max(ranks[1]).max(ranks[2]));
        for plane in low..high {
            let is_above = ranks.map(|rank| rank > plane);
            let falls = |i: usize| is_above[i] && !is_above[(i + 1) % 3];
            let rises = |i: usize| !is_above[i] && is_above[(i + 1) % 3];
            let (Some(down), Some(up)) = ((0..3).find(|i| falls(*i)), (0..3).find(|i| rises(*i))) else {
                continue;
            };
            let first = [corners[down], corners[(down + 1) % 3]];
            let second = [corners[(up + 1) % 3], corners[up]];
            let plane = self.first as u32 + plane;
            self.ends.push([first, second].map(|edge| Some((plane, edge))));
        }
    }

    fn joined(self, page: &Page<'_>) -> Pieces {
        let mut found = Pieces::default();
        if self.ends.is_empty() {
            return found;
        }
        let mut ids = vec![INTERIOR; page.vertex_count()];
        for (vertex, id) in page.shared() {
            ids[usize::from(vertex)] = id;
        }

        // Of two ends on one edge, the one whose other end is first in space, or where that is the same vertex, the edge there; whatever order triangles are in.
        let far = |(index, side): End| {
            let end = self.ends[index][1 - side]?;
            let edge = end.1.map(|vertex| page.positions[usize::from(vertex)]);
            Some((self.point(page, end), edge))
        };
        let compare = |a: End, b: End| far(a).partial_cmp(&far(b)).unwrap_or(Ordering::Equal);
        let is_shared = |edge: Edge| edge.iter().all(|vertex| ids[usize::from(*vertex)] != INTERIOR);
        // Other clusters may have the edge, too: where many surfaces meet, each goes on where it is its own continuation.
        chains(
            &self.ends,
            |(_, edge)| is_shared(edge),
            compare,
            |chain, is_closed| {
                let start = found.points.len();
                let mut edges = chain.iter().flat_map(|link| {
                    let [a, b] = self.ends[link.index];
                    if link.is_turned { [b, a] } else { [a, b] }
                });
                let (mut first, mut last) = (None, None);
                // Each segment but the first begins where the one before it ended.
                for (number, end) in edges.by_ref().flatten().enumerate() {
                    first = first.or(Some(end));
                    last = Some(end);
                    if number == 0 || number % 2 == 1 {
                        let point = self.point(page, end);
                        if found.points[start..].last() != Some(&point) {
                            found.points.push(point);
                        }
                    }
                }
                let shared = |end: Option<(u32, Edge)>| {
                    let (_, edge) = end.filter(|_| !is_closed)?;
                    is_shared(edge).then(|| edge.map(|vertex| ids[usize::from(vertex)]))
                };
                let plane = first.map_or(0, |(plane, _)| plane);
                let ends = [shared(first), shared(last)];
                found.pieces.push(Piece { plane, points: start..found.points.len(), ends, is_closed });
            },
        );
        found
    }

    /// Where an edge crosses a plane, from above to below: the same bits in every triangle that has the edge.
    fn point(&self, page: &Page<'_>, (plane, [above, below]): (u32, Edge)) -> [f64; 3] {
        let [a, b] = [above, below].map(|vertex| page.positions[usize::from(vertex)]);
        let [high, low] = [a, b].map(|point| self.planes.height(point));
        let [a, b] = [a, b].map(|point| point.map(f64::from));
        let t = (high - self.planes.offsets()[plane as usize]) / (high - low);
        std::array::from_fn(|axis| a[axis] + t * (b[axis] - a[axis]))
    }
}
