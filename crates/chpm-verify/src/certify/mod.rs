//! Whether the stored errors of a file hold, proven and not sampled (I5).
//!
//! The leaves hold the source's triangles, so a cut is held against them, both as surfaces of tiles of which only some are in memory. Every triangle
//! that a cluster draws must be within the cluster's *error* of the source; every triangle of the source must, point by point, be within its
//! *distance* of some cluster that is drawn: borders move, so that what was below one cluster may end up on its neighbour. That is all that the format says
//! of errors and gaps, and `chpm_measure::proof` proves it or finds a point where it is not so. What it can do neither for within the pieces
//! that it may cut a triangle into is undecided, which is a fault, too.
//!
//! Beside it the true distance of either side is enclosed: some point is at least so far, and none is farther than so much. First by what the proofs of all triangles came
//! to, and then anew in those clusters that might have a point farther than the farthest that is known.

mod coarsest;
mod drawn;
mod faults;
mod further;

pub use coarsest::{Proven, coarsest};
pub use faults::faults;
pub use further::{Further, Goal, further, room};

use crate::cuts;
use crate::deviation::{at_position, finest, source_tiles};
use crate::error::VerifyError;
use crate::memory;
use chpm_extmem::{Cancel, MappedFile, Progress};
use chpm_format::Chpm;
use chpm_measure::Tiles;
use chpm_measure::proof::{Allowed, LOSS, Prover, Verdict};
use chpm_mesh::{ClusterId, TriMesh, Units, geom};
use chpm_refine::{Cut, Hierarchy};
use drawn::Drawn;
use rayon::prelude::*;
use std::fmt;

/// Bytes that are found out about each cluster.
pub const FOUND: u64 = 1024;

/// Pieces that a triangle may be cut into for each triangle below it, about, where what is proven is proven to be used.
const EFFORT: u32 = 256;
/// Triangles that one task judges in turn, each search hinting the next one; fixed, so that no result depends on threads.
const CHUNK: usize = 64;
/// Triangles of the other surface that a triangle of no area may lie on.
const LEAST: f64 = 64.0;
/// How much wider than it need be an interval of the true distance may be, as a share of it.
pub const TOLERANCE: f64 = 0.01;

/// Request for a certification.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// Only these levels; all if there are none.
    pub levels: Vec<u32>,
    /// Positions of each level.
    pub positions: u32,
    /// Seed and number of random cuts.
    pub cuts: (u64, u32),
    /// Pieces that a triangle may be cut into for each triangle of the other surface that may lie under it.
    pub effort: u32,
}

/// Result of a certification.
#[derive(Debug, Default)]
pub struct Certified {
    /// A row for each level and position, from the finest on.
    pub levels: Vec<Row>,
    /// A row for each cut.
    pub cuts: Vec<Row>,
    /// A row for each level of a file with remnants: the cut within its largest error.
    pub within: Vec<Row>,
    /// How far the source itself may be from its triangles as singles hold them; the leaves state it.
    pub rounding: f64,
    /// By how much what holds may be beyond what is stored at most: rounding of the proof.
    pub slack: f64,
}

impl Certified {
    /// All rows.
    pub fn rows(&self) -> impl Iterator<Item = &Row> {
        self.levels.iter().chain(&self.within).chain(&self.cuts)
    }
}

/// Which cut a row is about.
#[derive(Clone, Copy, Debug)]
pub enum Which {
    /// All clusters of a level.
    Level {
        /// Its number; 0 is the finest.
        level: u32,
        /// The part of the collapses that is applied.
        collapsed: f64,
    },
    /// A random cut.
    Cut {
        /// It is made of this.
        seed: u64,
    },
    /// The cut within a distance, with the remnants that it takes.
    Within {
        /// That distance, object units.
        distance: f32,
    },
}

impl fmt::Display for Which {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Which::Level { level, collapsed } => {
                write!(f, "level {level}, {:.0} % collapsed", 100.0 * collapsed)
            }
            Which::Cut { seed } => write!(f, "cut of seed {seed}"),
            Which::Within { distance } => write!(f, "cut within {}", Units((*distance).into())),
        }
    }
}

/// Result for the clusters of a level, or for a cut.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Which.
    pub which: Which,
    /// Clusters that were drawn.
    pub clusters: u64,
    /// Triangles that they drew.
    pub triangles: u64,
    /// Largest stored error.
    pub error: f32,
    /// Largest stored distance.
    pub distance: f32,
    /// From the mesh to the source, which the errors bound.
    pub of_mesh: Side,
    /// From the source to the mesh, which the distances bound.
    pub of_source: Side,
}

/// Result in one direction.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Side {
    /// Some point is at least so far.
    pub lower: f64,
    /// That point.
    pub at: Option<[f64; 3]>,
    /// No point is farther.
    pub upper: f64,
    /// Triangles with a point that is farther than the file states.
    pub violations: u64,
    /// The worst of those points.
    pub worst: Option<Violation>,
    /// Triangles of which nothing was shown.
    pub undecided: u64,
    /// Pieces that were looked at.
    pub pieces: u64,
}

/// A point that is farther than the file states.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Violation {
    /// How far it is at least.
    pub distance: f64,
    /// Stored error.
    pub stored: f64,
    /// Where it is.
    pub at: [f64; 3],
}

impl Row {
    /// Its name: `level 3, 50 % collapsed`.
    pub fn name(&self) -> String {
        self.which.to_string()
    }

    /// Triangles that violate what is stored, both ways.
    pub fn violations(&self) -> u64 {
        self.of_mesh.violations + self.of_source.violations
    }

    /// Triangles that are undecided, both ways.
    pub fn undecided(&self) -> u64 {
        self.of_mesh.undecided + self.of_source.undecided
    }
}

impl Side {
    fn merge(&mut self, other: &Side) {
        if other.lower > self.lower {
            (self.lower, self.at) = (other.lower, other.at);
        }
        self.upper = self.upper.max(other.upper);
        self.violations += other.violations;
        if other.worst.is_some_and(|w| self.worst.is_none_or(|worst| w.excess() > worst.excess())) {
            self.worst = other.worst;
        }
        self.undecided += other.undecided;
        self.pieces += other.pieces;
    }

    /// Widens the interval by what a surface may be from the one that it stands for.
    fn widen(&mut self, by: f64) {
        self.lower = (self.lower - by).max(0.0);
        self.upper += by;
    }
}

impl Violation {
    fn excess(&self) -> f64 {
        self.distance - self.stored
    }
}

/// A file and its source.
struct Certifier<'a> {
    file: &'a Chpm<MappedFile>,
    leaves: Vec<ClusterId>,
    source: Tiles<'a>,
    /// Triangles and area of the source.
    size: Size,
    /// Bytes of tiles of either surface to keep in memory.
    budget: u64,
    effort: f64,
    progress: &'a dyn Progress,
    cancel: &'a Cancel,
}

#[derive(Clone, Copy, Debug, Default)]
struct Size {
    triangles: f64,
    area: f64,
}

/// Certifies what is wanted. All pages must be sound, and the leaves the source's triangles. Tiles may take `budget` bytes.
///
/// # Errors
/// [`VerifyError::Cancelled`], or those of a file that was changed meanwhile.
pub fn certify(
    file: &Chpm<MappedFile>,
    wanted: &Wanted,
    budget: u64,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Certified, VerifyError> {
    let work = |certifier: &Certifier<'_>| certifier.rows(wanted);
    Certifier::on_few((file, 0), wanted.effort, budget, (progress, cancel), work)
}

/// By how much what a proof tells may be beyond the truth at most.
fn slack(file: &Chpm<MappedFile>) -> f64 {
    let bounds = file.header().aabb();
    let largest = bounds.min.iter().chain(&bounds.max).fold(0.0, |largest: f32, x| largest.max(x.abs()));
    2.0 * LOSS * f64::from(largest)
}

impl<'a> Certifier<'a> {
    /// Does `work` with a certifier, on as many threads as `budget` bytes have room for where no tile has more triangles than a cluster of the file has, or `tile`.
    fn on_few<R: Send>(
        (file, tile): (&Chpm<MappedFile>, u64),
        effort: u32,
        budget: u64,
        (progress, cancel): (&dyn Progress, &Cancel),
        work: impl FnOnce(&Certifier<'_>) -> Result<R, VerifyError> + Send,
    ) -> Result<R, VerifyError> {
        let each = memory::of_searcher(memory::largest(file).max(tile));
        memory::on_few(budget, each, |budget| work(&Certifier::new(file, effort, budget, progress, cancel)?))
    }

    fn new(
        file: &'a Chpm<MappedFile>,
        effort: u32,
        budget: u64,
        progress: &'a dyn Progress,
        cancel: &'a Cancel,
    ) -> Result<Self, VerifyError> {
        let budget = budget / 2;
        let (leaves, source) = source_tiles(file, budget, cancel);
        let size = size_of(leaves.len(), |leaf| finest(file, leaves[leaf]), cancel)?;
        Ok(Certifier { file, leaves, source, size, budget, effort: f64::from(effort), progress, cancel })
    }

    /// All that is wanted.
    fn rows(&self, wanted: &Wanted) -> Result<Certified, VerifyError> {
        let file = self.file;
        let leaf_errors = self.leaves.iter().map(|id| file.clusters()[id.index()].min_error.into());
        let mut found = Certified {
            rounding: leaf_errors.fold(0.0, f64::max),
            slack: slack(file),
            ..Certified::default()
        };
        for level in
            (0..file.levels().len() as u32).filter(|l| wanted.levels.is_empty() || wanted.levels.contains(l))
        {
            for step in (0..wanted.positions).rev() {
                let collapsed = 1.0 - f64::from(step) / f64::from(wanted.positions);
                let cut = at_position(file, level, collapsed)?;
                let label = format!("level {level}, {:.0} %", 100.0 * collapsed);
                let which = Which::Level { level, collapsed };
                found.levels.push(self.cut(&cut, which, &label, found.rounding, |cluster| {
                    file.clusters()[cluster.index()].level == level
                })?);
            }
            // What remnants add to the errors of this level.
            if file.has_remnants() && level > 0 {
                let distance = file.levels()[level as usize].max_error;
                let which = Which::Within { distance };
                let cut = Cut::at_distance(file, distance)?;
                found.within.push(self.cut(&cut, which, &which.to_string(), found.rounding, |_| true)?);
            }
        }
        let hierarchy = Hierarchy::new(file);
        let (first, count) = wanted.cuts;
        for seed in (0..count).map(|i| first.wrapping_add(i.into())) {
            let cut = cuts::draw(file, &hierarchy, seed)?;
            let label = format!("cut {seed}");
            found.cuts.push(self.cut(&cut, Which::Cut { seed }, &label, found.rounding, |_| true)?);
        }
        Ok(found)
    }

    /// Certifies a cut; of what is drawn, the clusters for which `is_asked`, and the remnants.
    fn cut(
        &self,
        cut: &Cut,
        which: Which,
        label: &str,
        rounding: f64,
        is_asked: impl Fn(ClusterId) -> bool,
    ) -> Result<Row, VerifyError> {
        let (file, members) = (self.file, cut.members());
        let parts = Drawn::new(file, cut)?;
        let is_asked = |part: &usize| members.get(*part).is_none_or(|member| is_asked(member.cluster));
        let asked: Vec<usize> = (0..parts.len()).filter(is_asked).collect();
        let bounds = cut.remnants().iter().map(|number| file.remnants()[*number as usize].bound);
        let of_specks = bounds.fold(0.0, f32::max);
        let error = |part: &usize| match members.get(*part) {
            Some(member) => Ok(file.page(member.cluster)?.view().error_at(member.vertices as usize)),
            None => Ok(of_specks),
        };
        let errors = asked.iter().map(error).collect::<Result<Vec<f32>, VerifyError>>()?;
        // Anything near a remnant may be as far from it as anything from the rest.
        let mut distances = cut.distances(file)?;
        distances.resize(parts.len(), distances.iter().copied().fold(of_specks, f32::max));
        let own = asked.iter().map(|part| distances[*part]);

        // What is drawn, and how far each of its tiles may be from the source.
        let drawn = parts.tiles(self.budget, self.cancel);
        let allowed = Allowed::own(&drawn, distances.iter().map(|d| f64::from(*d)).collect());
        let size = size_of(asked.len(), |index| parts.part(asked[index]), self.cancel)?;
        self.progress.begin(label, 2 * (self.leaves.len() + asked.len()) as u64);

        // From the mesh to the source, then from the source to all that is drawn.
        let each: Vec<Allowed> = errors.iter().map(|error| Allowed::Same(f64::from(*error))).collect();
        let of_mesh = Way { certifier: self, target: &self.source, limits: self.limits(size, self.size) };
        let mut of_mesh =
            of_mesh.go(asked.len(), |i| parts.part(asked[i]), |i| &each[i], |i, _| errors[i].into())?;
        let all = match asked.len() == parts.len() {
            true => size,
            false => size_of(parts.len(), |index| parts.part(index), self.cancel)?,
        };
        let of_source = Way { certifier: self, target: &drawn, limits: self.limits(self.size, all) };
        let mut of_source = of_source.go(
            self.leaves.len(),
            |leaf| finest(file, self.leaves[leaf]),
            |_| &allowed,
            |_, tile| distances[tile].into(),
        )?;

        self.progress.end();
        of_mesh.widen(rounding);
        of_source.widen(rounding);
        Ok(Row {
            which,
            clusters: asked.iter().filter(|part| **part < members.len()).count() as u64,
            triangles: size.triangles as u64,
            error: errors.iter().copied().fold(0.0, f32::max),
            distance: own.fold(0.0, f32::max),
            of_mesh,
            of_source,
        })
    }

    /// How far the source may be from its leaves, with the rounding of a proof.
    fn beside(&self) -> f64 {
        let leaves = self.leaves.iter().map(|id| {
            let leaf = &self.file.clusters()[id.index()];
            f64::from(self.file.gaps(leaf.group()).distance(leaf.min_error))
        });
        leaves.fold(0.0, f64::max) + slack(self.file)
    }

    /// How near a mesh has to be to the leaves, so that what is told of it is `distance` at most.
    fn to_prove(&self, distance: f32) -> f64 {
        // A proof may reach its limit, and some more by its own rounding, which `beside` has in it.
        geom::before_round_up(distance) - 2.0 * self.beside()
    }

    /// Pieces for a triangle of `from`, whatever its area, and for its share of the area.
    fn limits(&self, from: Size, to: Size) -> [f64; 2] {
        let by_area = if from.area > 0.0 { to.triangles / from.area } else { 0.0 };
        [self.effort * LEAST, self.effort * by_area]
    }
}

/// One way: from parts of one surface to the whole other one.
struct Way<'a> {
    certifier: &'a Certifier<'a>,
    target: &'a Tiles<'a>,
    limits: [f64; 2],
}

impl Way<'_> {
    /// Judges `count` parts; `stored` is what a part is held to where a tile is nearest.
    fn go<'g>(
        &self,
        count: usize,
        part: impl Fn(usize) -> TriMesh + Sync,
        allowed: impl Fn(usize) -> &'g Allowed + Sync,
        stored: impl Fn(usize, usize) -> f64 + Sync,
    ) -> Result<Side, VerifyError> {
        // First every triangle is judged: within what is allowed, beyond it, or undecided. This also gives a distance that is
        // reached at least.
        let judged = (0..count)
            .into_par_iter()
            .map(|index| self.judge(&part(index), allowed(index), |tile| stored(index, tile)));
        let judged: Vec<Side> = judged.collect::<Result<_, VerifyError>>()?;
        let mut all = Side::default();
        judged.iter().for_each(|side| all.merge(side));
        if all.lower.is_infinite() {
            self.certifier.progress.advance(count as u64);
            return Ok(all);
        }

        // Then the largest distance is enclosed, looking only where it may exceed what is known to be reached.
        let begin = all.lower;
        let enclosed = (0..count).into_par_iter().map(|index| {
            if judged[index].upper <= begin * (1.0 + TOLERANCE) {
                self.certifier.progress.advance(1);
                return Ok(Side { upper: judged[index].upper, ..Side::default() });
            }
            let side = self.enclose(&part(index), begin)?;
            // Where it takes too many pieces to come so near, what was proven before still holds.
            Ok(Side { upper: side.upper.min(judged[index].upper), ..side })
        });
        let enclosed: Vec<Side> = enclosed.collect::<Result<_, VerifyError>>()?;
        all.upper = 0.0;
        enclosed.iter().for_each(|side| all.merge(side));
        Ok(all)
    }

    /// Judges every triangle of a part; `stored` is what it is held to where a tile is nearest.
    fn judge(
        &self,
        part: &TriMesh,
        allowed: &Allowed,
        stored: impl Fn(usize) -> f64 + Sync,
    ) -> Result<Side, VerifyError> {
        self.each_chunk(part, |prover, chunk| {
            let mut side = Side::default();
            for triangle in chunk {
                let found = prover.within(*triangle, allowed, self.limit(triangle));
                side.merge(&Side { upper: found.reached, pieces: found.pieces, ..Side::default() });
                match found.verdict {
                    Verdict::Within => {}
                    Verdict::Undecided => side.undecided += 1,
                    Verdict::Beyond(witness) => {
                        let (lower, at) = (witness.distance, Some(witness.at));
                        let violation =
                            Violation { distance: lower, stored: stored(witness.tile), at: witness.at };
                        let worst = Some(violation);
                        side.merge(&Side { violations: 1, worst, lower, at, ..Side::default() });
                    }
                }
            }
            if let Some((lower, at)) = prover.far() {
                side.merge(&Side { lower, at: Some(at), ..Side::default() });
            }
            side
        })
    }

    /// The largest distance of a part, as far as it exceeds what is reached at least.
    fn enclose(&self, part: &TriMesh, lower: f64) -> Result<Side, VerifyError> {
        self.each_chunk(part, |prover, chunk| {
            let mut side = Side { lower, ..Side::default() };
            for triangle in chunk {
                let (upper, at) =
                    prover.farthest(*triangle, &mut side.lower, TOLERANCE, self.limit(triangle));
                side.upper = side.upper.max(upper);
                side.at = at.or(side.at);
            }
            side
        })
    }

    /// Chunks of a part's triangles, in parallel, and what they come to in their order.
    fn each_chunk(
        &self,
        part: &TriMesh,
        judge: impl Fn(&mut Prover<'_>, &[[[f32; 3]; 3]]) -> Side + Sync,
    ) -> Result<Side, VerifyError> {
        let cancel = self.certifier.cancel;
        cancel.check()?;
        let is_stopped = || cancel.is_cancelled();
        let triangles: Vec<[[f32; 3]; 3]> = part.triangles.iter().map(|t| part.corners(*t)).collect();
        let sides: Vec<Side> = triangles
            .par_chunks(CHUNK)
            .map(|chunk| judge(&mut Prover::new(self.target, &is_stopped), chunk))
            .collect();
        cancel.check()?;
        self.certifier.progress.advance(1);
        let mut all = Side::default();
        sides.iter().for_each(|side| all.merge(side));
        Ok(all)
    }

    fn limit(&self, corners: &[[f32; 3]; 3]) -> u64 {
        (self.limits[0] + self.limits[1] * area(corners)) as u64
    }
}

fn area(&[a, b, c]: &[[f32; 3]; 3]) -> f64 {
    0.5 * geom::area_vector(a, b, c).norm()
}

/// Triangles and area of parts.
fn size_of(
    count: usize,
    part: impl Fn(usize) -> TriMesh + Sync,
    cancel: &Cancel,
) -> Result<Size, VerifyError> {
    let sizes = (0..count).into_par_iter().map(|index| {
        cancel.check()?;
        let part = part(index);
        let area = part.triangles.iter().map(|t| area(&part.corners(*t))).sum();
        Ok(Size { triangles: part.triangles.len() as f64, area })
    });
    let sizes: Vec<Size> = sizes.collect::<Result<_, VerifyError>>()?;
    // Sums of floats depend on their order.
    Ok(sizes.iter().fold(Size::default(), |all, size| Size {
        triangles: all.triangles + size.triangles,
        area: all.area + size.area,
    }))
}
