//! How much a region has: the memory that it takes, and the leaves that it is cut into.

use super::normals::BorderSum;
use super::region::Mesh;
use crate::config::{Division, Normals, Settings};
use crate::pairs::graph_bytes;
use chpm_mesh::Attributes;
use serde::{Deserialize, Serialize};

/// Bytes for each triangle and each vertex of a region while it is worked on, and for each vertex that its triangles cannot have.
pub(super) const TRIANGLE_COST: u64 = 48;
pub(super) const VERTEX_COST: u64 = 72;
const PASSED_COST: u64 = 16;
/// Bytes for each triangle of a region that is joined to all others, and for each vertex beside what it carries, while cells are cut: every
/// other triangle joins three pairs of cells that nothing else joins.
const GRAPH_COST: u64 = 12 + graph_bytes(3) / 2;
const MESH_COST: u64 = 11;
/// Bytes for what faces come to at a border vertex.
const SUM_COST: u64 = size_of::<BorderSum>() as u64;

/// How much a region has.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Size {
    pub(crate) triangles: u64,
    /// Vertices at home in it.
    pub(crate) own: u64,
    /// Those that others use.
    pub(crate) border: u64,
    /// Vertices of others that it uses.
    pub(crate) foreign: u64,
}

impl Size {
    /// Memory that the region takes while it is worked on.
    pub(crate) fn cost(&self, carried: Attributes, settings: &Settings) -> u64 {
        let Size { triangles, own, border, foreign } = *self;
        let used = (own + foreign).min(3 * triangles);
        let sums = if settings.normals == Normals::Computed { border + foreign } else { 0 };
        // Words are read, kept, and written, those of vertices that triangles do not have read alone.
        let words = 4 * u64::from(carried.scalar_words);
        let sorted = TRIANGLE_COST * triangles
            + (VERTEX_COST + 3 * words) * used
            + (PASSED_COST + words) * (own + foreign - used)
            + SUM_COST * sums;
        // Where triangles have corners anywhere, and not only along the border, cells are joined to all others. They are cut before leaves
        // are gathered: of both the larger one.
        let cut = GRAPH_COST * triangles + (MESH_COST + carried.vertex_len() as u64) * used + SUM_COST * sums;
        if 4 * foreign > triangles { sorted.max(cut) } else { sorted }
    }
}

/// Counts that decide how many leaves a region is cut into, besides its mesh.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Shares {
    /// Leaves that are wanted of all.
    pub(super) leaves: u32,
    pub(super) homes: u32,
    pub(super) regions: u32,
    /// Copies of triangles that were left out on the way to the regions.
    pub(super) copies: u64,
}

impl Shares {
    /// An equal share, unless regions are as large as it comes, were cut, or have fewer triangles than it seemed.
    pub(super) fn of(self, mesh: &Mesh, settings: &Settings) -> u32 {
        let is_equal = settings.division == Division::Graph
            && self.regions == self.homes
            && self.copies + mesh.copies == 0;
        if is_equal { self.leaves.div_ceil(self.homes) } else { leaf_count(mesh.triangles.len(), settings) }
    }
}

/// Clusters of the leaf level: the power of two for which a leaf comes closest to the wanted size, so that the hierarchy is a
/// complete tree and all clusters of a level have a similar history.
pub(crate) fn leaf_count(triangles: usize, settings: &Settings) -> u32 {
    let exact = triangles as f64 / f64::from(settings.cluster_triangles.max(1));
    1 << libm::log2(exact.max(1.0)).round().min(31.0) as u32
}
