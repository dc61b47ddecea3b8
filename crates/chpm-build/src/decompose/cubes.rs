//! Regions as cubes of an octree: each depends on what lies in it and beside it alone, so that a change somewhere leaves all others as they were.

use super::cell_graph::Cell;
use super::grid::OctreeKey;
use std::ops::Range;

/// Bits of a place for each halving of a cube.
const DIGIT: u32 = 3;

/// The region of each cell, of at most `most` vertices if the cell has no more: the largest cubes that have as many, and of those that share a cube the next along
/// the curve with it, as long as they fit.
pub(super) fn regions(cells: &[Cell], keys: &[OctreeKey], most: u64) -> Vec<u32> {
    let mut order: Vec<usize> = (0..cells.len()).collect();
    order.sort_by_key(|cell| keys[*cell]);
    let along: Vec<OctreeKey> = order.iter().map(|cell| keys[*cell]).collect();
    let ends = order.iter().scan(0, |end, cell| {
        *end += u64::from(cells[*cell].count);
        Some(*end)
    });
    let mut cubes = Cubes { along, before: std::iter::once(0).chain(ends).collect(), most, starts: vec![0] };
    cubes.divide(0..cells.len(), OctreeKey::BITS.next_multiple_of(DIGIT));

    let mut regions = vec![0; cells.len()];
    for (region, start) in (0..).zip(&cubes.starts) {
        let end = cubes.starts.get(region as usize + 1).copied().unwrap_or(cells.len());
        order[*start..end].iter().for_each(|cell| regions[*cell] = region);
    }
    regions
}

/// Cells along the curve, and the regions that they have come to be in.
struct Cubes {
    along: Vec<OctreeKey>,
    /// Vertices before each cell, and all of them.
    before: Vec<u64>,
    most: u64,
    /// Where each region begins.
    starts: Vec<usize>,
}

impl Cubes {
    fn count(&self, range: &Range<usize>) -> u64 {
        self.before[range.end] - self.before[range.start]
    }

    /// Divides the cells of one cube, all of whose places are the same above `bit`.
    fn divide(&mut self, cells: Range<usize>, bit: u32) {
        let mut at = cells.start;
        // Whether the last region has nothing but cells of this cube, and of cubes in it that were not divided.
        let mut open = false;
        while at < cells.end {
            let end = self.end_of_child(at, cells.end, bit);
            let (child, below) = (at..end, bit.saturating_sub(DIGIT));
            let is_whole = self.count(&child) <= self.most || bit == 0;
            let last = self.starts[self.starts.len() - 1];
            if !(is_whole && open && self.count(&(last..end)) <= self.most) && at > last {
                self.starts.push(at);
            }
            if !is_whole {
                self.divide(child, below);
            }
            (at, open) = (end, is_whole);
        }
    }

    /// Where the child ends that the cell `at` is in; below the least cubes it is a cell.
    fn end_of_child(&self, at: usize, end: usize, bit: u32) -> usize {
        if bit == 0 {
            return at + 1;
        }
        let digit = |key: OctreeKey| key >> (bit - DIGIT);
        at + self.along[at..end].partition_point(|key| digit(*key) == digit(self.along[at]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(count: u32) -> Cell {
        Cell { center: [0.0; 3], count }
    }

    /// Regions of cells that have these places and vertices.
    fn of(cells: &[(OctreeKey, u32)], most: u64) -> Vec<u32> {
        let keys: Vec<OctreeKey> = cells.iter().map(|(key, _)| *key).collect();
        let cells: Vec<Cell> = cells.iter().map(|(_, count)| cell(*count)).collect();
        regions(&cells, &keys, most)
    }

    #[test]
    fn cells_of_a_cube_are_one_region_while_they_fit() {
        assert!(of(&[], 9).is_empty());
        assert_eq!(of(&[(0o1, 9)], 9), [0]);
        // Two cubes of 10 and one of 4, in any order.
        assert_eq!(
            of(&[(0o21, 2), (0o11, 5), (0o12, 5), (0o30, 1), (0o22, 8), (0o31, 3)], 10),
            [1, 0, 0, 2, 1, 2]
        );
        // A cube that is divided leaves its last region to itself.
        assert_eq!(of(&[(0o11, 9), (0o12, 2), (0o20, 3), (0o30, 3)], 10), [0, 1, 2, 2]);
        assert_eq!(of(&[(0o10, 3), (0o21, 9), (0o22, 2)], 10), [0, 1, 2]);
    }

    #[test]
    fn pieces_of_a_cell_that_is_too_large_are_apart() {
        assert_eq!(of(&[(0o7, 6), (0o7, 6), (0o7, 3), (0o1, 12)], 10), [1, 2, 2, 0]);
    }

    #[test]
    fn a_change_leaves_other_cubes_as_they_are() {
        let count = |i: u32| i.wrapping_mul(2654435761) >> 24;
        let mut cells: Vec<(OctreeKey, u32)> =
            (0..4096).map(|i| (OctreeKey::from(i), 100 + count(i))).collect();
        let before = of(&cells, 5000);
        cells[777].1 *= 9;
        let after = of(&cells, 5000);
        let starts = |regions: &[u32]| -> Vec<usize> {
            (1..regions.len()).filter(|i| regions[*i] != regions[*i - 1]).collect()
        };
        let (before, after) = (starts(&before), starts(&after));
        assert!(before.len() > 100);
        let elsewhere = |start: &&usize| **start < 777 - 64 || **start > 777 + 64;
        assert!(before.iter().filter(elsewhere).eq(after.iter().filter(elsewhere)));
        assert_ne!(before, after);
    }
}
