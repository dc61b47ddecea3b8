//! A `.chpm` as meshlets, for engines that draw with mesh shaders: `docs/MESHLETS.md` has every byte.
//!
//! The meshes are those of 3D Tiles: each cluster at its coarsest, and under each leaf its finest mesh. So is the rule: a mesh is drawn where the group in which it is coarse need not be
//! refined and the group above is. All members of a group decide by the same number and the same box, and both are nested, so that no mesh is drawn together with what replaces it.

mod block;
mod cone;
mod cut;
#[cfg(test)]
mod tests;
mod writer;

pub use block::{Block, block};
pub use writer::{Totals, Writer};

use crate::tiles::{GroupBounds, Mesh};
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, GroupId};

/// Most triangles, and most vertices, that a meshlet may be allowed: indices within one have eight bits.
pub const MOST: u32 = 256;

/// The groups by which meshes are chosen.
pub struct Rule {
    bounds: GroupBounds,
    /// By cluster: the group in which it is fine; of roots, the one in which they are coarse.
    above: Vec<GroupId>,
}

impl Rule {
    /// The rule of a file.
    pub fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let mut above: Vec<GroupId> = file.clusters().iter().map(|cluster| cluster.group()).collect();
        for group in (0..file.groups().len() as u32).map(GroupId) {
            for fine in file.fine(group) {
                above[*fine as usize] = group;
            }
        }
        Rule { bounds: GroupBounds::of(file), above }
    }

    /// Where a mesh is drawn: from the first error on, and below the second; each with its group.
    fn range<D: AsRef<[u8]>>(&self, file: &Chpm<D>, cluster: ClusterId, mesh: Mesh) -> [(f32, GroupId); 2] {
        let own = file.clusters()[cluster.index()].group();
        let above = self.above[cluster.index()];
        let error = self.bounds.error(own);
        match (mesh, Mesh::of(file, cluster)) {
            (Mesh::Finest, _) => [(0.0, own), (error, own)],
            // The source itself: nothing replaces it.
            (Mesh::Base, [_]) if file.groups()[own.index()].is_leaf() => {
                [(0.0, own), self.before(own, above)]
            }
            (Mesh::Base, _) => [(error, own), self.before(own, above)],
        }
    }

    /// The error below which the members of a group are drawn. Nothing is above roots.
    fn before(&self, own: GroupId, above: GroupId) -> (f32, GroupId) {
        if above == own { (f32::INFINITY, own) } else { (self.bounds.error(above), above) }
    }
}
