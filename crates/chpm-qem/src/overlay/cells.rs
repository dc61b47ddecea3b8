//! The cells of an overlay, for what is interpolated over the faces.

use super::arrangement::Arrangement;
use super::{AREA_LOSS, Crossing, Laid, Overlay};
use crate::ring::{NO_FACE, Ring};
use std::ops::RangeInclusive;

/// Rounding error of a weight on an edge, relative to the squared size over the area that it was divided by: twice what an area
/// loses, and as much again for the area's own loss.
const PLACE_LOSS: f64 = 4.0 * AREA_LOSS;

/// Where a corner is in the old one-ring and in the new one, by vertices of the patch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CellPoint {
    /// From u so far towards a vertex of the loop.
    pub(crate) old: (u16, f64),
    /// From v so far towards two vertices of the loop.
    pub(crate) new: [(u16, f64); 2],
    /// Rounding error of each weight.
    pub(crate) loss: f64,
}

impl Overlay {
    /// A new face, and its corners by vertices of the patch.
    pub(crate) fn new_face(ring: &Ring, new: usize) -> (u32, [u16; 3]) {
        let vertices = ring.vertices();
        (ring.faces()[new], [vertices[0], vertices[new], vertices[new + 1]])
    }

    /// Whether the last bound succeeded.
    pub(crate) fn is_laid(&self) -> bool {
        self.laid.is_some()
    }

    /// The new faces that u may lie over: whoever carries something over takes the cells of all of them.
    pub(crate) fn sectors(&self) -> RangeInclusive<usize> {
        let [first, last] = self.laid.map_or([1, 0], |laid| laid.sectors);
        first..=last
    }

    /// Calls `visit` with the places of all corners off the loop, in order, if u lies over the new face `sector`: corners are
    /// numbered from 1, and 0 is the loop, of both one-rings, so that nothing changes there.
    pub(crate) fn places(&self, ring: &Ring, sector: usize, mut visit: impl FnMut(CellPoint)) {
        let Some(Laid { share, size, .. }) = self.laid else { return };
        let vertices = ring.vertices();
        fn loss(area: f64, size: f64) -> f64 {
            (PLACE_LOSS * size * size / area.abs()).min(1.0)
        }
        let ([of_a, of_b], area) = match share {
            None => self.apex_shares(sector),
            // Beside the edge to v that the boundary edges become, which is that to l_1 or that to the last.
            Some(share) if ring.faces()[0] == NO_FACE => ([share, 0.0], f64::INFINITY),
            Some(share) => ([0.0, share], f64::INFINITY),
        };
        let new = [(vertices[sector], of_a), (vertices[sector + 1], of_b)];
        visit(CellPoint { old: (vertices[0], 0.0), new, loss: loss(area, size) });
        for &(a, b) in &Arrangement::of(ring.len(), sector).crossings {
            let Crossing { on_old, on_new, area, .. } = self.crossings([(a, b); 2]);
            let [on_old, on_new, area] = [on_old, on_new, area].map(|two| two.to_array()[0]);
            let (a, b) = (usize::from(a), usize::from(b));
            let new = [(vertices[b], on_new), (vertices[0], 0.0)];
            visit(CellPoint { old: (vertices[a], on_old), new, loss: loss(area, size) });
        }
    }

    /// Calls `visit` with the place in the loop of each new face, and of each old one that it has a cell in common with, and with
    /// the cell's corners; new faces in order.
    pub(crate) fn cells(ring: &Ring, sector: usize, mut visit: impl FnMut(usize, u32, &[u16])) {
        let arrangement = Arrangement::of(ring.len(), sector);
        for (new, cells) in (1..).zip(arrangement.faces()) {
            for cell in cells {
                let old = ring.faces()[usize::from(cell.old)];
                if old != NO_FACE {
                    visit(new, old, &cell.corners);
                }
            }
        }
    }
}
