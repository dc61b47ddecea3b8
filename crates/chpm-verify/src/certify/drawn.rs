//! Parts that a cut draws: its members, and behind them the remnants beside them, in one part if there are any.

use crate::deviation::mesh_of;
use crate::error::VerifyError;
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::Chpm;
use chpm_measure::Tiles;
use chpm_mesh::{Aabb, TriMesh};
use chpm_refine::{Cut, Member};

/// Parts of a cut.
pub(super) struct Drawn<'a> {
    file: &'a Chpm<MappedFile>,
    members: &'a [Member],
    specks: TriMesh,
}

impl<'a> Drawn<'a> {
    pub(super) fn new(file: &'a Chpm<MappedFile>, cut: &'a Cut) -> Result<Self, VerifyError> {
        Ok(Drawn { file, members: cut.members(), specks: cut.remnant_mesh(file)? })
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.members.len() + usize::from(!self.specks.triangles.is_empty())
    }

    /// Mesh of one.
    pub(super) fn part(&self, index: usize) -> TriMesh {
        match self.members.get(index) {
            Some(member) => mesh_of(self.file, *member),
            None => self.specks.clone(),
        }
    }

    /// All of them as a surface; tiles may take so many bytes.
    pub(super) fn tiles(&'a self, budget: u64, cancel: &'a Cancel) -> Tiles<'a> {
        let bounds = |index: usize| match self.members.get(index) {
            Some(member) => self.file.clusters()[member.cluster.index()].aabb(),
            None => Aabb::of_points(&self.specks.positions),
        };
        let load = |index: usize| if cancel.is_cancelled() { TriMesh::default() } else { self.part(index) };
        Tiles::new((0..self.len()).map(bounds).collect(), budget, load)
    }
}
