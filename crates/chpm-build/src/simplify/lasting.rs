//! Remnants while a build is on its way: of each component that vanished alone, the triangle that was left last.
//!
//! Only the vertex is kept whose collapse took it away. Where its other corners are is known once the page has its order.

use super::PageRef;
use crate::error::BuildError;
use bytemuck::{Pod, Zeroable};
use chpm_extmem::Spool;
use chpm_format::{FormatError, Page, Remnant};
use chpm_mesh::{ClusterId, Places};
use chpm_qem::DroppedComponent;

/// Remnants that a file has at most, about, however large it is: they are in memory when its tables are made.
const MOST: usize = 1 << 19;
/// Bytes of a remnant then: as the layout finds it, in the tables, and as it is written.
pub(crate) const REMNANT_BYTES: u64 = 96;

/// Remnants that a cluster has at most in a tree of so many; the smallest components beyond go without.
pub(super) fn most(nodes: usize) -> usize {
    (MOST / nodes.max(1)).clamp(2, 256)
}

/// A remnant of a cluster.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Lasting {
    /// Where the component was.
    pub(super) ball: DroppedComponent,
    /// How far its points and the triangle are from each other.
    pub(super) bound: f32,
    /// The vertex, in the numbers of the page.
    pub(super) vertex: u32,
}

impl Lasting {
    pub(super) fn size(&self) -> f32 {
        self.ball.sphere().1
    }
}

/// The remnants of a page that is in its order, those that vanish last first. The cluster is still to be named.
pub(crate) fn remnants(of: &PageRef, pages: &Spool, page: &Page<'_>) -> Result<Vec<Remnant>, BuildError> {
    if of.lasting_count == 0 {
        return Ok(Vec::new());
    }
    let mut bytes = Vec::new();
    pages.read(of.lasting, of.lasting_count as usize * size_of::<Lasting>(), &mut bytes)?;
    let mut places = Places::default();
    let each = bytes.chunks_exact(size_of::<Lasting>()).map(bytemuck::pod_read_unaligned::<Lasting>);

    let found = each.map(|Lasting { ball, bound, vertex }| {
        let corners = Remnant::corners_of(page, vertex as usize, &mut places)?;
        let (center, radius) = ball.sphere();
        Ok(Remnant { center, radius, cluster: ClusterId::NONE.0, corners, reserved: [0; 2], bound })
    });
    let mut found = found.collect::<Result<Vec<_>, FormatError>>()?;
    found.sort_unstable_by_key(|remnant| remnant.corners);
    Ok(found)
}
