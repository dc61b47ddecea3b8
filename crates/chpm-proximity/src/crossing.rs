//! Where a source meets itself.

use crate::cross;
use crate::error::ProximityError;
use crate::patch::Search;
use crate::pose::{Between, Frame, Pose};
use chpm_mesh::{Aabb, ClusterId};
use chpm_space::{Model, Patch};
use rayon::ThreadPool;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Two triangles of the source that have a point in common and no vertex: their clusters, their places there and their corners.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Crossing {
    /// Leaf clusters.
    pub clusters: [ClusterId; 2],
    /// Which of their triangles.
    pub triangles: [u32; 2],
    /// Their corners, relative to the file's origin.
    pub corners: [[[f32; 3]; 3]; 2],
}

/// Most crossings of two leaves that are kept until it is their turn; where there are more, they are found again then.
const KEPT: usize = 1 << 12;
/// Pairs of leaves that each thread is given at a time.
const EACH: usize = 16;

/// Tells every pair of triangles of the leaves that meet and have no vertex in common, on the threads of a pool, and whatever their
/// number in the same order. Exact; in the memory of the pages that a model may keep. Answers whether it came to the end; `go_on` is asked before every
/// cluster.
///
/// # Errors
/// A damaged page; what `found` answers.
pub fn crossings<D: AsRef<[u8]> + Sync, X: From<ProximityError>>(
    model: &Model<'_, D>,
    pool: &ThreadPool,
    found: &mut dyn FnMut(&Crossing) -> Result<(), X>,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<bool, X> {
    let clusters = model.file().clusters();
    let mut leaves: Vec<(Aabb, ClusterId)> = (0..)
        .map(ClusterId)
        .zip(clusters)
        .filter(|(_, record)| record.is_leaf())
        .map(|(id, record)| (record.aabb(), id))
        .collect();
    leaves.sort_by(|a, b| a.0.min[0].total_cmp(&b.0.min[0]).then(a.1.cmp(&b.1)));
    let frame = Frame::of(model, &Pose::IDENTITY);
    let finder = Finder { model, pool, still: Between::new(&frame, &frame) };
    let upper = EACH * pool.current_num_threads();
    let mut jobs = Vec::new();
    // Leaves in the order in which they begin along an axis; those that a leaf may meet begin before it ends.
    for (at, (bounds, x)) in leaves.iter().enumerate() {
        if !go_on() {
            return Ok(false);
        }
        for (other, y) in &leaves[at..] {
            if other.min[0] > bounds.max[0] {
                break;
            }
            let apart =
                (1..3).any(|axis| other.min[axis] > bounds.max[axis] || bounds.min[axis] > other.max[axis]);
            if !apart {
                jobs.push([*x, *y]);
            }
        }
        if jobs.len() >= upper {
            finder.work(&mut jobs, found)?;
        }
    }
    finder.work(&mut jobs, found)?;
    Ok(true)
}

struct Finder<'m, 'a, D> {
    model: &'m Model<'a, D>,
    pool: &'m ThreadPool,
    still: Between,
}

impl<D: AsRef<[u8]> + Sync> Finder<'_, '_, D> {
    /// Looks at pairs of leaves by all threads, and tells what they find in the order of the pairs.
    fn work<X: From<ProximityError>>(
        &self,
        jobs: &mut Vec<[ClusterId; 2]>,
        found: &mut dyn FnMut(&Crossing) -> Result<(), X>,
    ) -> Result<(), X> {
        for jobs in jobs.chunks(EACH * self.pool.current_num_threads()) {
            let done: Vec<_> = self.pool.install(|| jobs.par_iter().map(|job| self.compare(*job)).collect());
            for (job, done) in jobs.iter().zip(done) {
                match done? {
                    Some(crossings) => crossings.iter().try_for_each(&mut *found)?,
                    None => self.each(*job, found)?,
                }
            }
        }
        jobs.clear();
        Ok(())
    }

    /// The crossings of two leaves, unless they are too many to keep.
    fn compare(&self, job: [ClusterId; 2]) -> Result<Option<Vec<Crossing>>, ProximityError> {
        let mut all = Vec::new();
        let end = self.each(job, &mut |crossing: &Crossing| {
            if all.len() == KEPT {
                return Err(Halt::Full);
            }
            all.push(*crossing);
            Ok(())
        });
        match end {
            Ok(()) => Ok(Some(all)),
            Err(Halt::Full) => Ok(None),
            Err(Halt::Failed(error)) => Err(error),
        }
    }

    fn patch(&self, cluster: ClusterId) -> Result<Arc<Patch>, ProximityError> {
        Ok(self.model.patch(cluster)?)
    }

    fn each<X: From<ProximityError>>(
        &self,
        [x, y]: [ClusterId; 2],
        found: &mut dyn FnMut(&Crossing) -> Result<(), X>,
    ) -> Result<(), X> {
        let (p, q) = (self.patch(x)?, self.patch(y)?);
        let end = p.pairs_within(&q, &self.still, self.still.margin, &mut |i, j| {
            let is_one = x == y;
            if (is_one && i >= j)
                || p.has_common_vertex(i, &q, j, is_one)
                || !cross::meet(p.corners_of(i), q.corners_of(j))
            {
                return ControlFlow::Continue(());
            }

            let crossing = Crossing {
                clusters: [x, y],
                triangles: [p.place(i), q.place(j)],
                corners: [*p.corners_of(i), *q.corners_of(j)],
            };
            match found(&crossing) {
                Ok(()) => ControlFlow::Continue(()),
                Err(error) => ControlFlow::Break(error),
            }
        });

        match end {
            ControlFlow::Break(error) => Err(error),
            ControlFlow::Continue(()) => Ok(()),
        }
    }
}

/// Why a pair of leaves was not looked at to the end.
enum Halt {
    Full,
    Failed(ProximityError),
}

impl From<ProximityError> for Halt {
    fn from(error: ProximityError) -> Self {
        Halt::Failed(error)
    }
}
