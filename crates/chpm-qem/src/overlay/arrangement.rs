//! Which cells the two fans over a loop have in common. The loop's length and the new face that u lies over decide that, so it is
//! found once for each pair of them and then only looked up, by all threads: 0.2 MiB for valences up to 20, 8.4 MiB for all.

use crate::ring::MAX_LOOP;
use std::ops::Range;
use std::sync::OnceLock;

/// A corner on the loop: of both one-rings, so that nothing changes there.
pub(super) const LOOP: u16 = 0;
/// Where u was.
pub(super) const APEX: u16 = 1;
/// The first crossing of an old edge and a new one; the others follow.
pub(super) const CROSSINGS: u16 = 2;
/// Room for all corners, and one: a loop of 49 has at most 1,081 crossings.
pub(super) const CORNERS: usize = 2048;
/// Most corners of what an old and a new face have in common.
const MAX_CORNERS: usize = 4;

/// Intersection of an old and a new face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// The old face.
    pub(super) old: u16,
    /// The last one again where there are fewer.
    pub(super) corners: [u16; MAX_CORNERS],
}

/// The cells of a loop of one length with u over one face.
#[derive(Debug)]
pub(super) struct Arrangement {
    /// Pairs (a, b): the old edge (u, l_a) crosses the new edge (v, l_b).
    pub(super) crossings: Vec<(u16, u16)>,
    /// By new face, in order.
    cells: Vec<Cell>,
    /// Where the cells of each new face end.
    ends: Vec<u16>,
}

/// Those that were needed so far, at `count * MAX_LOOP + sector`.
static KNOWN: [OnceLock<Arrangement>; (MAX_LOOP + 1) * MAX_LOOP] =
    [const { OnceLock::new() }; (MAX_LOOP + 1) * MAX_LOOP];

impl Arrangement {
    /// Of a loop of `count` vertices with u over the new face `sector`.
    #[inline]
    pub(super) fn of(count: usize, sector: usize) -> &'static Self {
        KNOWN[count * MAX_LOOP + sector].get_or_init(|| Self::new(count, sector))
    }

    fn new(count: usize, sector: usize) -> Self {
        let last = count - 1;
        let mut arrangement = Arrangement { crossings: vec![], cells: vec![], ends: vec![0] };
        // Where the crossings of each old edge begin.
        let mut starts = vec![0; count];
        for (a, start) in starts.iter_mut().enumerate().skip(1) {
            *start = arrangement.crossings.len();
            arrangement.crossings.extend(crossed(a, sector).map(|b| (a as u16, b as u16)));
        }
        for new in 1..last {
            for old in 0..count {
                let meet = match old {
                    0 => new <= sector,
                    _ if old == last => new >= sector,
                    _ => new >= old.min(sector) && new <= old.max(sector),
                };
                if meet {
                    let found = corners(&starts, old, new, sector, last);
                    let mut corners = [found[found.len() - 1]; MAX_CORNERS];
                    corners[..found.len()].copy_from_slice(&found);
                    arrangement.cells.push(Cell { old: old as u16, corners });
                }
            }
            arrangement.ends.push(arrangement.cells.len() as u16);
        }
        arrangement
    }

    /// The cells of each new face, from the first on.
    #[inline]
    pub(super) fn faces(&self) -> impl ExactSizeIterator<Item = &[Cell]> {
        self.ends.array_windows().map(|[start, end]| &self.cells[usize::from(*start)..usize::from(*end)])
    }
}

/// The new edges that the old edge to l_a crosses: those between the place of u and l_a, seen from v.
fn crossed(a: usize, sector: usize) -> Range<usize> {
    if a > sector { sector + 1..a } else { a + 1..sector + 1 }
}

/// The corners of a cell, given where the crossings of each old edge begin.
fn corners(starts: &[usize], old: usize, new: usize, sector: usize, last: usize) -> Vec<u16> {
    let mut found = Vec::with_capacity(MAX_CORNERS);
    if old == 0 || old == last {
        found.push(LOOP);
    }
    if new == sector {
        found.push(APEX);
    }
    for a in [old, (old + 1) % (last + 1)] {
        for b in [new, new + 1] {
            if a == b {
                found.push(LOOP);
            }
            let crossed = if a == 0 { 0..0 } else { crossed(a, sector) };
            if crossed.contains(&b) {
                found.push(CROSSINGS + (starts[a] + b - crossed.start) as u16);
            }
        }
    }
    found.sort_unstable();
    found.dedup();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// A convex loop seen from u over the given face, so that all places can be worked out: the cells must be those pairs of
    /// triangles that share more than an edge.
    #[test]
    fn cells_are_where_triangles_overlap() {
        for count in 3..9 {
            let angle = |i: usize| 0.1 + std::f64::consts::TAU * i as f64 / count as f64;
            let ring: Vec<[f64; 2]> = (0..count).map(|i| [angle(i).cos(), angle(i).sin()]).collect();
            for sector in 1..count - 1 {
                let u =
                    [0, 1].map(|k| 0.31 * ring[0][k] + 0.33 * ring[sector][k] + 0.36 * ring[sector + 1][k]);

                let arrangement = Arrangement::new(count, sector);
                let mut expected = BTreeSet::new();
                let mut found = BTreeSet::new();

                for new in 1..count - 1 {
                    let cells = arrangement.faces().nth(new - 1).unwrap();
                    found.extend(cells.iter().map(|c| (new, usize::from(c.old))));
                    for old in 0..count {
                        let a = [u, ring[old], ring[(old + 1) % count]];
                        let b = [ring[0], ring[new], ring[new + 1]];
                        if overlap(a, b) > 1e-9 {
                            expected.insert((new, old));
                        }
                    }
                }

                assert_eq!(found, expected, "loop of {count}, u over face {sector}");
            }
        }
    }

    /// The area that two triangles have in common: one is clipped by the other's edges.
    fn overlap(a: [[f64; 2]; 3], b: [[f64; 2]; 3]) -> f64 {
        let mut polygon = a.to_vec();
        for i in 0..3 {
            let (p, q) = (b[i], b[(i + 1) % 3]);
            let side = |x: &[f64; 2]| (q[0] - p[0]) * (x[1] - p[1]) - (q[1] - p[1]) * (x[0] - p[0]);
            let mut kept = Vec::new();
            for (j, x) in polygon.iter().enumerate() {
                let y = &polygon[(j + 1) % polygon.len()];
                if side(x) >= 0.0 {
                    kept.push(*x);
                }
                if (side(x) > 0.0 && side(y) < 0.0) || (side(x) < 0.0 && side(y) > 0.0) {
                    let t = side(x) / (side(x) - side(y));
                    kept.push([0, 1].map(|k| x[k] + t * (y[k] - x[k])));
                }
            }
            polygon = kept;
        }

        let doubled = |i: usize| {
            let (x, y) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            x[0] * y[1] - x[1] * y[0]
        };
        (0..polygon.len()).map(doubled).sum::<f64>() / 2.0
    }
}
