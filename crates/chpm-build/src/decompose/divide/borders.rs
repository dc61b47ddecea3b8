//! Border vertices: those that other regions use than the one that they are at home in. Their numbers hold everywhere.

use super::super::homes::Homes;
use super::super::size::Size;
use super::route::{Routed, block};
use crate::context::Context;
use crate::error::BuildError;
use bytemuck::{Pod, Zeroable};
use chpm_extmem::Buckets;
use rayon::prelude::*;

/// A vertex of another region.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Foreign {
    pub(crate) vertex: u32,
    /// Its border number.
    pub(crate) border: u32,
}

/// The border vertices of all regions.
pub(crate) struct Borders {
    /// By home, its vertices that others use, ascending: so they are numbered, home after home.
    own: Buckets<u32>,
    /// Home h has the border numbers `starts[h]..starts[h + 1]`.
    starts: Vec<u32>,
    /// By region, the vertices of others that it uses.
    pub(crate) foreign: Buckets<Foreign>,
}

impl Borders {
    /// Numbers what regions visit. The visits are of no use afterwards.
    pub(crate) fn of(routed: &mut Routed, homes: &Homes, context: &Context<'_>) -> Result<Self, BuildError> {
        let store = &context.store;
        let block = block(homes.count()) / 4;
        let mut own = Buckets::new(store, "border vertices", homes.count(), block);
        let mut foreign = Buckets::new(store, "vertices of other regions", routed.region_count(), block);
        let (mut visiting, mut starts, mut count) = (Vec::new(), vec![0], 0);
        for home in 0..homes.count() {
            context.check()?;
            visiting.clear();
            let bytes = 8 * routed.visits.len(home) as u64;
            let _share = store.budget.reserve_work("uses of border vertices", bytes)?;
            routed.visits.read(home, &mut visiting)?;
            // Triangles of a split region have gone to others, which visit for themselves.
            visiting.retain(|[_, region]| routed.was_split.get(*region as usize) != Some(&true));
            visiting.par_sort_unstable();
            visiting.dedup();
            for visits in visiting.chunk_by(|a, b| a[0] == b[0]) {
                let vertex = visits[0][0];
                own.push(home, vertex)?;
                for [_, region] in visits {
                    foreign.push(*region as usize, Foreign { vertex, border: count })?;
                }
                count += 1;
            }
            starts.push(count);
        }
        routed.visits = Buckets::new(store, "uses of other regions", 0, block);
        Ok(Borders { own, starts, foreign })
    }

    /// Number of border vertices.
    pub(crate) fn count(&self) -> u32 {
        self.starts[self.starts.len() - 1]
    }

    /// How much a region of so many triangles has.
    pub(crate) fn size(&self, region: usize, triangles: usize, homes: &Homes) -> Size {
        let border = if region < self.own.count() { self.own.len(region) } else { 0 };
        let counts = [triangles, homes.own(region), border, self.foreign.len(region)];
        let [triangles, own, border, foreign] = counts.map(|count| count as u64);
        Size { triangles, own, border, foreign }
    }

    /// The border number of the first that is at home in a region.
    pub(crate) fn first(&self, region: usize) -> u32 {
        self.starts.get(region).copied().unwrap_or_default()
    }

    /// Those at home in a region, ascending.
    pub(crate) fn own(&self, region: usize) -> Result<Vec<u32>, BuildError> {
        let mut own = Vec::new();
        if region < self.own.count() {
            self.own.read(region, &mut own)?;
        }
        Ok(own)
    }
}
