//! Border vertices: those that other regions use than the one that they are at home in. Their numbers hold everywhere.

use super::super::homes::Homes;
use super::super::leaf;
use super::super::size::Size;
use super::route::{Routed, block};
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use chpm_extmem::Buckets;
use rayon::prelude::*;

/// A vertex of another region, and its border number.
pub(crate) type Foreign<I> = [I; 2];

/// The most border vertices: leaves mark other numbers by the highest bit.
const MOST: u32 = leaf::INNER - 1;

/// The border vertices of all regions.
pub(crate) struct Borders<I: Id> {
    /// By home, its vertices that others use, ascending: so they are numbered, home after home.
    own: Buckets<I>,
    /// Home h has the border numbers `starts[h]..starts[h + 1]`.
    starts: Vec<u32>,
    /// By region, the vertices of others that it uses.
    pub(crate) foreign: Buckets<Foreign<I>>,
}

impl<I: Id> Borders<I> {
    /// Numbers what regions visit. The visits are of no use afterwards.
    pub(crate) fn of(
        routed: &mut Routed<I>,
        homes: &Homes,
        context: &Context<'_>,
    ) -> Result<Self, BuildError> {
        Self::within(MOST, routed, homes, context)
    }

    /// At most so many of them.
    fn within(
        most: u32,
        routed: &mut Routed<I>,
        homes: &Homes,
        context: &Context<'_>,
    ) -> Result<Self, BuildError> {
        let store = &context.store;
        let block = block(homes.count()) / 4;
        let mut own = Buckets::new(store, "border vertices", homes.count(), block);
        let mut foreign = Buckets::new(store, "vertices of other regions", routed.region_count(), block);
        let (mut visiting, mut starts, mut count) = (Vec::new(), vec![0], 0);
        for home in 0..homes.count() {
            context.check()?;
            visiting.clear();
            let bytes = (size_of::<[I; 2]>() * routed.visits.len(home)) as u64;
            let _share = store.budget.reserve_work("uses of border vertices", bytes)?;
            routed.visits.read(home, &mut visiting)?;
            // Triangles of a split region have gone to others, which visit for themselves.
            visiting.retain(|[_, region]| routed.was_split.get(region.index()) != Some(&true));
            visiting.par_sort_unstable();
            visiting.dedup();
            for visits in visiting.chunk_by(|a, b| a[0] == b[0]) {
                let vertex = visits[0][0];
                own.push(home, vertex)?;
                for [_, region] in visits {
                    foreign.push(region.index(), [vertex, I::of(count as usize)])?;
                }
                if count == most {
                    return Err(BuildError::TooManyShared { most: most.into() });
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
    pub(crate) fn own(&self, region: usize) -> Result<Vec<I>, BuildError> {
        let mut own = Vec::new();
        if region < self.own.count() {
            self.own.read(region, &mut own)?;
        }
        Ok(own)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::number::Cells;
    use super::*;
    use chpm_extmem::{Cancel, Silent, Store};

    #[test]
    fn border_vertices_are_numbered_up_to_the_most_and_then_refused() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), 1 << 24).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let context = Context::new(store, pool, &Silent, Cancel::default());
        let homes = Homes::new(Cells::new([10, 10].into_iter()), &[0, 1]);
        let within = |most| {
            let mut routed = Routed::<u32>::new(2, &context.store);
            for vertex in [13, 12, 19, 12] {
                routed.visit(1, vertex, 0)?;
            }
            Borders::within(most, &mut routed, &homes, &context)
        };
        let borders = within(3).unwrap();
        assert_eq!((borders.count(), borders.own(1).unwrap()), (3, vec![12, 13, 19]));
        let mut foreign = Vec::new();
        borders.foreign.read(0, &mut foreign).unwrap();
        assert_eq!(foreign, [[12, 0], [13, 1], [19, 2]]);
        assert!(matches!(within(2), Err(BuildError::TooManyShared { most: 2 })));
    }
}
