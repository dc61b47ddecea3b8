//! The cells of an overlay, for what is interpolated over the faces.

use super::{AREA_LOSS, Crossing, Laid, NO_FACE, Overlay, crossing};

/// What a share of an edge can be off by, as a share of the size squared over the area that it was divided by: twice what an area
/// loses, and as much again for the area's own loss.
const PLACE_LOSS: f64 = 4.0 * AREA_LOSS;
/// Most corners that are looked at for a cell: at v, at u, and four pairs of edges.
const MAX_CORNERS: usize = 6;

/// A corner of a cell that an old and a new face have in common.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Corner {
    /// On the loop: of both fans, so that nothing changes there.
    Loop,
    /// Where u was.
    Apex,
    /// Where the old edge (u, l_a) crosses the new edge (v, l_b).
    Crossing(usize, usize),
}

/// Where a corner is in the old fan and in the new one, by vertices of the patch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// From u so far towards a vertex of the loop.
    pub(crate) old: (u16, f64),
    /// From v so far towards two vertices of the loop.
    pub(crate) new: [(u16, f64); 2],
    /// What each of the shares may be off by.
    pub(crate) loss: f64,
}

impl Overlay {
    /// The corners of a new face, by vertices of the patch.
    pub(crate) fn new_corners(&self, new: usize) -> [u16; 3] {
        [self.vertices[0], self.vertices[new], self.vertices[new + 1]]
    }

    /// Whether the last bound succeeded.
    pub(crate) fn is_laid(&self) -> bool {
        self.laid.is_some()
    }

    /// Calls `visit` with the corners off the loop, and where they are.
    pub(crate) fn places(&self, mut visit: impl FnMut(Corner, Place)) {
        let Some(Laid { foot, share, sector, size }) = self.laid else { return };
        let (p, vertices) = (&self.projected, &self.vertices);
        let loss = |area: f64| (PLACE_LOSS * size * size / area.abs()).min(1.0);
        let ([of_a, of_b], area) = match share {
            None => self.apex_shares(sector),
            // Beside the edge to v that the boundary edges become, which is that to l_1 or that to the last.
            Some(share) if self.faces[0] == NO_FACE => ([share, 0.0], f64::INFINITY),
            Some(share) => ([0.0, share], f64::INFINITY),
        };
        let new = [(vertices[sector], of_a), (vertices[sector + 1], of_b)];
        visit(Corner::Apex, Place { old: (vertices[0], 0.0), new, loss: loss(area) });
        for a in 1..p.len() {
            let old = p[a].minus(foot);
            for b in Self::crossed(a, sector) {
                let Crossing { on_old, on_new, area } = crossing(old, p[b].minus(p[0]), p[0].minus(foot));
                let new = [(vertices[b], on_new), (vertices[0], 0.0)];
                visit(Corner::Crossing(a, b), Place { old: (vertices[a], on_old), new, loss: loss(area) });
            }
        }
    }

    /// Calls `visit` with each new face and each old one that it has a cell in common with, new faces in order, and with the
    /// cell's corners.
    pub(crate) fn cells(&self, mut visit: impl FnMut(u32, u32, &[Corner])) {
        let Some(Laid { sector, .. }) = self.laid else { return };
        let last = self.ring.len() - 1;
        for new in 1..last {
            for old in (0..=last).filter(|&old| self.meet(old, new, sector)) {
                let mut corners = [Corner::Loop; MAX_CORNERS];
                let mut slots = corners.iter_mut();
                self.corners(old, new, sector, |corner| {
                    if let Some(slot) = slots.next() {
                        *slot = corner;
                    }
                });
                visit(self.faces[new], self.faces[old], &corners);
            }
        }
    }
}
