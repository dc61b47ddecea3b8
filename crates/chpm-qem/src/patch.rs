//! Input and output of a decimation.

use crate::attribute_error::AttributeErrors;
use crate::displacement::Displacement;
use crate::dropped::{DroppedComponent, LastFace};
use crate::refusal::Refusals;
use chpm_mesh::geom::to_f64;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// One cluster's mesh: positions, triangles over local indices, and which vertices must stay.
#[derive(Clone, Copy, Debug, Default)]
pub struct Patch<'a> {
    /// Vertex positions, at most 65,535.
    pub positions: &'a [[f32; 3]],
    /// Triangles with three different corners.
    pub triangles: &'a [[u16; 3]],
    /// Per triangle, how far it is from the source surface; empty if the patch is the source.
    pub displacements: &'a [Displacement],
    /// Per vertex, whether another cluster shares it, so that it may not collapse.
    pub locked: &'a [bool],
    /// Attributes of the vertices; they have no influence on the order of collapses.
    pub attribute_errors: AttributeErrors<'a>,
}

/// Whether a simplification may change the topology.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Topology {
    /// Every collapse satisfies the link condition: components, handles and holes stay.
    #[default]
    Keep,
    /// Where no collapse of a vertex is legal it may be forced: small components vanish, tiny handles close, vertices that are
    /// not manifold do not stay for ever. The last component stays.
    Change,
}

/// One half-edge collapse.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Collapse {
    /// The vertex that goes.
    pub from: u16,
    /// The neighbour that it goes to.
    pub to: u16,
    /// Error of the mesh after this collapse, object units: an upper bound of its distance from the source surface, both ways, but
    /// for the points of the source in [`Outcome::dropped`].
    pub error: f32,
}

/// Result of a decimation.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<'a> {
    /// The collapses in the order in which they were carried out.
    pub collapses: &'a [Collapse],
    /// Triangles that are left.
    pub triangle_count: usize,
    /// Whether it ended above the target because nothing more could collapse.
    pub stalled: bool,
    /// Collapses that changed the topology or turned a face over.
    pub forced: usize,
    /// Where components were that lay apart and have vanished.
    pub dropped: &'a [DroppedComponent],
    /// Of each of them, what was left last.
    pub last_faces: &'a [LastFace],
    /// The least error of a mesh in which one of them is missing; infinite without any.
    pub vanishing: f32,
    /// Collapses refused, by reason.
    pub refusals: Refusals,
}

/// Input of a run: a patch, and for a group border the members that have each vertex.
#[derive(Clone, Copy)]
pub(crate) struct Given<'a> {
    pub(crate) patch: &'a Patch<'a>,
    /// Members that have a vertex, a bit each, while group borders are decimated; else empty.
    pub(crate) sides: &'a [u8],
}

impl Given<'_> {
    #[inline]
    pub(crate) fn position(&self, vertex: u16) -> Point3<f64> {
        to_f64(self.patch.positions[usize::from(vertex)])
    }

    /// The way from u to v.
    pub(crate) fn offset(&self, u: u16, v: u16) -> Vector3<f64> {
        self.position(v) - self.position(u)
    }

    #[inline]
    pub(crate) fn is_locked(&self, vertex: u16) -> bool {
        self.patch.locked[usize::from(vertex)]
    }

    /// Whether all members that have u have v.
    #[inline]
    pub(crate) fn is_known_with(&self, u: u16, v: u16) -> bool {
        self.sides.is_empty() || self.sides[usize::from(u)] & !self.sides[usize::from(v)] == 0
    }

    /// Whether a member that has u may have the face: one that has all of its corners.
    pub(crate) fn has_member_of(&self, u: u16, corners: [u16; 3]) -> bool {
        self.sides.is_empty()
            || corners.into_iter().fold(self.sides[usize::from(u)], |all: u8, corner: u16| {
                all & self.sides[usize::from(corner)]
            }) != 0
    }
}
