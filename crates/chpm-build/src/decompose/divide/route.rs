//! Triangles on their way to regions.

use super::super::copies::Sieve;
use super::super::homes::Homes;
use super::super::size::Shares;
use super::BLOCKS;
use super::step::Step;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use chpm_extmem::{Buckets, Column, Store};
use rayon::prelude::*;
use std::ops::Range;

/// Triangles that are prepared for their regions in one step.
const ROUTED: usize = 1 << 16;

/// Triangles by region, and who visits whom.
pub(crate) struct Routed<I: Id> {
    /// In the order of the source.
    pub(crate) triangles: Buckets<[I; 3]>,
    /// By home, which regions use its vertices: vertex and region.
    pub(crate) visits: Buckets<[I; 2]>,
    /// Visits that come soon again are there once.
    known: Sieve<I>,
    /// By home, how many corners its triangles have from others.
    pub(crate) uses: Vec<u64>,
    /// By home: whether its triangles were sent to regions of their own.
    pub(super) was_split: Vec<bool>,
    /// Copies of a triangle that were left out.
    pub(crate) copies: u64,
}

impl<I: Id> Routed<I> {
    /// None so far, on the way to so many regions.
    pub(crate) fn new(homes: usize, store: &Store) -> Self {
        let block = block(homes);
        Routed {
            triangles: Buckets::new(store, "triangles by region", homes, block),
            visits: Buckets::new(store, "uses of other regions", homes, block / 4),
            known: Sieve::default(),
            uses: vec![0; homes],
            was_split: vec![false; homes],
            copies: 0,
        }
    }

    /// Regions so far. Those after the homes have no vertices of their own.
    pub(crate) fn region_count(&self) -> usize {
        self.triangles.count()
    }

    /// Shares of the regions in so many leaves.
    pub(crate) fn shares(&self, leaves: u32, homes: &Homes) -> Shares {
        let [homes, regions] = [homes.count(), self.region_count()].map(|count| count as u32);
        Shares { leaves, homes, regions, copies: self.copies }
    }

    /// Sends each triangle of a range to its region, and notes who uses the vertices of another. Several steps are prepared side by side,
    /// and what each has for a region goes there in their order. What a range has does not depend on what other ranges there are.
    pub(crate) fn take(
        &mut self,
        triangles: &Column<[I; 3]>,
        range: Range<usize>,
        homes: &Homes,
        context: &Context<'_>,
    ) -> Result<(), BuildError> {
        let mut sieve = Sieve::behind(triangles, range.start)?;
        let [sifting, joining, sorting, appending, visiting] = [(); 5].map(|()| context.trace.phase());
        let mut steps: Vec<Step<I>> = (0..rayon::current_num_threads()).map(|_| Step::default()).collect();
        let starts: Vec<usize> = range.clone().step_by(ROUTED).collect();
        for starts in starts.chunks(steps.len()) {
            let steps = &mut steps[..starts.len()];
            steps.par_iter_mut().zip(starts).try_for_each(|(step, start)| {
                let _traced = sifting.task("sift");
                context.check()?;
                step.read(triangles, *start..range.end.min(start + ROUTED))
            })?;
            Step::join(steps, &mut sieve, joining);
            steps.par_iter_mut().for_each(|step| {
                let _traced = sorting.task("sort");
                step.sort(homes);
            });

            self.triangles.parts_mut().into_par_iter().enumerate().try_for_each(|(region, mut own)| {
                let _traced = appending.task("append");
                steps.iter().try_for_each(|step| own.extend_from_slice(step.of_region(region)))
            })?;
            self.visits.parts_mut().into_par_iter().enumerate().try_for_each(|(home, mut own)| {
                let _traced = visiting.task("visit");
                steps.iter().try_for_each(|step| own.extend(step.of_home(home)))
            })?;
            for step in steps {
                self.uses.iter_mut().zip(&step.uses).for_each(|(uses, more)| *uses += more);
            }
            let end = range.end.min(starts[starts.len() - 1] + ROUTED);
            context.progress.advance((end - starts[0]) as u64);
        }
        self.copies += sieve.dropped;
        Ok(())
    }

    /// Notes that a region uses a vertex of a home.
    pub(super) fn visit(&mut self, home: u32, vertex: I, region: usize) -> Result<(), BuildError> {
        if self.known.is_new([vertex, I::of(region), I::NONE]) {
            self.visits.push(home as usize, [vertex, I::of(region)])?;
        }
        Ok(())
    }
}

/// Bytes that the triangles of one of so many regions gather.
pub(super) fn block(regions: usize) -> usize {
    (BLOCKS / regions.max(1)).clamp(1 << 9, 1 << 15)
}
