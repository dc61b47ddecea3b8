//! A step of triangles on their way to regions, as one thread prepares it.

use super::super::copies::{Sieve, Sifted};
use super::super::homes::Homes;
use super::super::load::majority;
use crate::error::BuildError;
use crate::ids::Id;
use crate::trace::Phase;
use chpm_extmem::Column;
use std::ops::Range;

/// Triangles in a row, and then those that are no copies by region, in the order of the source.
pub(super) struct Step<I: Id> {
    triangles: Vec<[I; 3]>,
    sifted: Sifted<I>,
    regions: Vec<u32>,
    sorted: Vec<[I; 3]>,
    /// By region, where its triangles end.
    ends: Vec<u32>,
    /// Corners that a region has from others: the home of the vertex, the vertex, the region; ascending, each there once.
    visiting: Vec<(u32, [I; 2])>,
    /// By home, where they end.
    visit_ends: Vec<u32>,
    /// By region, how many corners it has from others.
    pub(super) uses: Vec<u64>,
}

impl<I: Id> Default for Step<I> {
    fn default() -> Self {
        let (triangles, sifted, regions, sorted) = Default::default();
        let (ends, visiting, visit_ends, uses) = Default::default();
        Step { triangles, sifted, regions, sorted, ends, visiting, visit_ends, uses }
    }
}

impl<I: Id> Step<I> {
    /// Takes triangles, and sifts them by themselves.
    pub(super) fn read(&mut self, from: &Column<[I; 3]>, range: Range<usize>) -> Result<(), BuildError> {
        match from.as_slice() {
            Some(all) => {
                self.triangles.clear();
                self.triangles.extend_from_slice(&all[range]);
            }
            None => {
                from.read(range, &mut self.triangles)?;
            }
        }
        self.sifted.sift(&self.triangles);
        Ok(())
    }

    /// Leaves out copies of what came before, in steps one after another.
    pub(super) fn join(steps: &mut [Step<I>], sieve: &mut Sieve<I>, phase: Phase<'_>) {
        let pieces: Vec<_> = steps.iter().map(|step| (&step.triangles[..], &step.sifted)).collect();
        for (step, triangle) in sieve.join(&pieces, phase) {
            steps[step].sifted.leave_out(triangle);
        }
    }

    /// Puts what is left in order.
    pub(super) fn sort(&mut self, all: &Homes) {
        self.regions.clear();
        self.visiting.clear();
        self.uses.clear();
        self.uses.resize(all.count(), 0);
        self.ends.clear();
        self.ends.resize(all.count() + 1, 0);
        for triangle in self.sifted.passing(&self.triangles) {
            let homes = triangle.map(|v| all.of(v.index()));
            // Where all three differ the first: no number that something far away has a part in.
            let region = majority(homes, || 0);
            self.regions.push(region);
            self.ends[region as usize + 1] += 1;
            // Most triangles are within their region, and visit none.
            if homes != [region; 3] {
                let others = triangle.iter().zip(homes).filter(|(_, home)| *home != region);
                let before = self.visiting.len();
                self.visiting.extend(others.map(|(vertex, home)| (home, [*vertex, I::of(region as usize)])));
                self.uses[region as usize] += (self.visiting.len() - before) as u64;
            }
        }
        for region in 1..self.ends.len() {
            self.ends[region] += self.ends[region - 1];
        }

        // A counting sort: what is an end afterwards is a place until then.
        self.sorted.resize(self.regions.len(), [I::zeroed(); 3]);
        for (triangle, region) in self.sifted.passing(&self.triangles).zip(&self.regions) {
            let place = &mut self.ends[*region as usize];
            self.sorted[*place as usize] = *triangle;
            *place += 1;
        }
        self.ends.pop();
        self.sort_visits(all.count());
    }

    fn sort_visits(&mut self, homes: usize) {
        self.visiting.sort_unstable();
        self.visiting.dedup();
        self.visit_ends.clear();
        let end = |home: usize| self.visiting.partition_point(|visit| visit.0 as usize <= home) as u32;
        self.visit_ends.extend((0..homes).map(end));
    }

    /// The visits of a home's vertices: vertex and region.
    pub(super) fn of_home(&self, home: usize) -> impl Iterator<Item = [I; 2]> {
        let start = if home == 0 { 0 } else { self.visit_ends[home - 1] };
        let visiting = &self.visiting[start as usize..self.visit_ends[home] as usize];
        visiting.iter().map(|(_, visit)| *visit)
    }

    /// The triangles of a region.
    pub(super) fn of_region(&self, region: usize) -> &[[I; 3]] {
        let start = if region == 0 { 0 } else { self.ends[region - 1] };
        &self.sorted[start as usize..self.ends[region] as usize]
    }
}
