//! The patches that a run of points may be near to, of which some are held.

use crate::error::ProximityError;
use chpm_format::Chpm;
use chpm_mesh::ClusterId;
use chpm_space::{Block, Model, Patch};
use nalgebra::Vector3;
use std::sync::Arc;

/// Patches, by their places in a list.
pub(crate) struct Wanted<'m, 'a, D> {
    model: &'m Model<'a, D>,
    near: Vec<Near>,
    /// Squared distances from a point, and places, ascending.
    order: Vec<(f64, usize)>,
    /// Bytes to hold at once: one patch, however large, and more up to so many.
    budget: u64,
    held: u64,
}

struct Near {
    block: Block,
    cluster: ClusterId,
    patch: Option<Arc<Patch>>,
}

/// Bytes that wanting all patches of a model takes at most, with the largest one, and what is there while it is made: its page and its boxes.
pub(crate) fn memory<D: AsRef<[u8]>>(model: &Chpm<D>) -> u64 {
    let largest = model.clusters().iter().map(Patch::bytes_of).max().unwrap_or(0);
    4 * largest + (size_of::<Near>() + size_of::<(f64, usize)>()) as u64 * model.clusters().len() as u64
}

impl<'m, 'a, D: AsRef<[u8]>> Wanted<'m, 'a, D> {
    pub(crate) fn new(
        model: &'m Model<'a, D>,
        budget: u64,
        near: impl ExactSizeIterator<Item = ClusterId>,
    ) -> Self {
        let near = near.map(|cluster| Near { block: model.cluster_block(cluster), cluster, patch: None });
        let near: Vec<Near> = near.collect();
        let order = Vec::with_capacity(near.len());
        Wanted { model, near, order, budget, held: 0 }
    }

    /// Puts them in the order of their distances from a point.
    pub(crate) fn sort_by_distance(&mut self, point: &Vector3<f64>) {
        self.order.clear();
        self.order
            .extend(self.near.iter().enumerate().map(|(at, near)| (near.block.squared_from(point), at)));
        self.order.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
    }

    /// Squared distances and places, in that order.
    pub(crate) fn order(&self) -> &[(f64, usize)] {
        &self.order
    }

    /// The patch at a place; none where as much is held as may be, and this one is not.
    pub(crate) fn patch(&mut self, at: usize) -> Result<Option<&Patch>, ProximityError> {
        let near = &mut self.near[at];
        if near.patch.is_none() {
            let bytes = Patch::bytes_of(&self.model.file().clusters()[near.cluster.index()]);
            if self.held > 0 && self.held + bytes > self.budget {
                return Ok(None);
            }
            near.patch = Some(self.model.patch_for_many(near.cluster)?);
            self.held += bytes;
        }
        Ok(near.patch.as_deref())
    }

    /// How many are held.
    #[cfg(test)]
    pub(crate) fn held_count(&self) -> usize {
        self.near.iter().filter(|near| near.patch.is_some()).count()
    }

    /// Holds nothing any more.
    pub(crate) fn forget(&mut self) {
        self.near.iter_mut().for_each(|near| near.patch = None);
        self.held = 0;
    }
}
