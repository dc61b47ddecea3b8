//! The coarsest cut within a distance, by proof: stored distances add up from level to level, and the coarser a mesh is, the farther are they
//! from the truth.
//!
//! Cuts by ever larger stored distances are held against the leaves, as surfaces, until one is not proven to be within what was asked for; then halfway. Each that
//! is taken has been proven by itself, so nothing rests on how distances grow.

use super::drawn::Drawn;
use super::{Certifier, EFFORT, Side, Way};
use crate::deviation::finest;
use crate::error::VerifyError;
use chpm_extmem::{Cancel, MappedFile, Progress};
use chpm_format::Chpm;
use chpm_measure::Tiles;
use chpm_measure::proof::{Allowed, Verdict};
use chpm_mesh::geom::round_up;
use chpm_mesh::{ClusterId, TriMesh};
use chpm_refine::Cut;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Cuts that are tried: they end within some percent of the last that can be proven.
const TRIED: u32 = 8;
/// What the stored distance grows by until a cut fails.
const GROWTH: f64 = 1.5;

/// A cut, and how far it is from the source, and the source from it, at most.
#[derive(Clone, Debug)]
pub struct Proven {
    /// The cut.
    pub cut: Cut,
    /// That distance, object units; nothing is exempt.
    pub distance: f32,
}

/// The coarsest cut that could be proven to be within a distance of the source, both ways; none where stored distances tell as much. Tiles may take `budget` bytes.
///
/// # Errors
/// [`VerifyError::Format`] for a damaged page, [`VerifyError::Cancelled`], and what selecting a cut comes to.
pub fn coarsest(
    file: &Chpm<MappedFile>,
    distance: f32,
    budget: u64,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Option<Proven>, VerifyError> {
    // What is missing in a file of version 1.0 may be anywhere.
    if !file.has_gaps() {
        return Ok(None);
    }
    for id in 0..file.clusters().len() as u32 {
        cancel.check()?;
        file.page(ClusterId(id))?;
    }
    let work = |certifier: &Certifier<'_>| coarsest_by(certifier, distance);
    Certifier::on_few((file, 0), EFFORT, budget, (progress, cancel), work)
}

/// As [`coarsest`], as far as a certifier proves it.
fn coarsest_by(certifier: &Certifier<'_>, distance: f32) -> Result<Option<Proven>, VerifyError> {
    let file = certifier.file;
    let beside = certifier.beside();
    let limit = certifier.to_prove(distance);
    if limit <= 0.0 {
        return Ok(None);
    }

    let (mut near, mut far) = (f64::from(distance), None);
    let mut last = Cut::at_distance(file, distance)?;
    let mut found = None;
    for _ in 0..TRIED {
        let bound = far.map_or(near * GROWTH, |far: f64| (near * far).sqrt());
        let cut = Cut::at_distances(file, bound as f32, limit as f32)?;
        if cut == last {
            near = bound;
        } else if let Some(reached) = certifier.reach(&cut, limit)? {
            near = bound;
            last = cut.clone();
            found = Some(Proven { cut, distance: round_up(reached + beside) });
        } else {
            far = Some(bound);
        }
    }
    Ok(found)
}

impl Certifier<'_> {
    /// How far a cut and the leaves are from each other at most, if that is proven to be within a limit.
    fn reach(&self, cut: &Cut, limit: f64) -> Result<Option<f64>, VerifyError> {
        let drawn = Drawn::new(self.file, cut)?;
        let tiles = drawn.tiles(self.budget, self.cancel);
        self.reach_both(drawn.len(), |index| drawn.part(index), &tiles, limit)
    }

    /// How far the parts of a mesh, whose tiles are `drawn`, and the leaves are from each other at most, if that is proven to be within a limit.
    pub(super) fn reach_both(
        &self,
        count: usize,
        part: impl Fn(usize) -> TriMesh + Sync + Copy,
        drawn: &Tiles<'_>,
        limit: f64,
    ) -> Result<Option<f64>, VerifyError> {
        let size = super::size_of(count, part, self.cancel)?;
        let of_mesh = Way { certifier: self, target: &self.source, limits: self.limits(size, self.size) };
        let of_source = Way { certifier: self, target: drawn, limits: self.limits(self.size, size) };

        self.progress.begin("proving", (self.leaves.len() + count) as u64);
        let far = of_mesh.reach(count, part, limit)?;
        let back = match far {
            Some(_) => {
                of_source.reach(self.leaves.len(), |leaf| finest(self.file, self.leaves[leaf]), limit)?
            }
            None => None,
        };
        self.progress.end();
        Ok(far.zip(back).map(|(far, back)| far.max(back)))
    }
}

impl Way<'_> {
    /// How far the parts are at most, if all of them are within a limit; ends at the first triangle that is not.
    fn reach(
        &self,
        count: usize,
        part: impl Fn(usize) -> TriMesh + Sync,
        limit: f64,
    ) -> Result<Option<f64>, VerifyError> {
        let (allowed, is_beyond) = (Allowed::Same(limit), AtomicBool::new(false));
        let sides = (0..count).into_par_iter().map(|index| {
            if is_beyond.load(Ordering::Relaxed) {
                return Ok(Side::default());
            }
            self.each_chunk(&part(index), |prover, chunk| {
                let mut side = Side::default();
                for triangle in chunk {
                    if is_beyond.load(Ordering::Relaxed) {
                        break;
                    }
                    let found = prover.within(*triangle, &allowed, self.limit(triangle));
                    side.upper = side.upper.max(found.reached);
                    if found.verdict != Verdict::Within {
                        is_beyond.store(true, Ordering::Relaxed);
                    }
                }
                side
            })
        });
        let sides: Vec<Side> = sides.collect::<Result<_, VerifyError>>()?;
        let farthest = sides.iter().map(|side| side.upper).fold(0.0, f64::max);
        Ok((!is_beyond.into_inner()).then_some(farthest))
    }
}
