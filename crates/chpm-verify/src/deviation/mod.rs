//! How far the meshes of a `.chpm` file really are from its source, beside what the file says, I5.
//!
//! The leaves hold the source's triangles, so a cut is measured against them, both as surfaces of tiles of which only some are in memory.
//! A sample of a cluster's mesh must be within the cluster's stored error of the source. A sample of the source must be
//! within the stored error of *some* cluster of the cut: borders move, so that what was below one cluster may end up on its
//! neighbour. Distances are to whole surfaces, which can only make them smaller; a cluster alone would be farther
//! from its part of the source wherever a border has moved sideways. What has vanished may be farther than the error, but no farther than
//! the gap that the file states; in a file without gaps nothing may.

mod levels;

pub(crate) use levels::at_position;
pub use levels::{LevelDeviation, Spread, levels};

use crate::error::VerifyError;
use chpm_extmem::{Cancel, MappedFile, Progress};
use chpm_format::Chpm;
use chpm_measure::box_tree::BoxTree;
use chpm_measure::sample::{Density, Sampler};
use chpm_measure::sweep::Block;
use chpm_measure::{Searcher, Tally, Tiles};
use chpm_mesh::{Aabb, ClusterId, TriMesh};
use chpm_refine::{Cut, Member};
use nalgebra::Point3;
use rayon::prelude::*;

/// Positions are singles: distances below a 256th of what these round the largest coordinate by are taken for rounding of the measure.
const SLACK: f64 = 1.0 / (1u64 << 32) as f64;

/// A file and its source, ready to be measured.
pub struct Judge<'a> {
    file: &'a Chpm<MappedFile>,
    source: Tiles<'a>,
    leaves: Vec<ClusterId>,
    samples: usize,
    /// Bytes of tiles of either surface to keep in memory.
    budget: u64,
    slack: f64,
}

/// Deviation of one cluster of a cut.
#[derive(Clone, Copy, Debug)]
pub struct MemberDeviation {
    /// The cluster and its position.
    pub member: Member,
    /// Triangles that it draws.
    pub triangles: u64,
    /// The error that the file states for the position.
    pub stored: f32,
    /// The distance that it states: the error, or the gap of what has vanished if that is larger.
    pub distance: f32,
    /// From the source to the cut, where this cluster is what answers for the sample.
    pub of_source: Tally,
    /// From the cluster's mesh to the source.
    pub of_mesh: Tally,
    /// Samples beyond the error, and within the distance.
    pub vanished: Vanished,
    /// Samples beyond what is stored.
    pub violations: Violations,
}

/// Samples of the source that are farther than any error allows, and no farther than a distance.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Vanished {
    /// How many.
    pub samples: u64,
    /// The farthest of them.
    pub max: f64,
}

/// Samples that are farther away than the file states.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Violations {
    /// How many.
    pub samples: u64,
    /// The worst: measured distance and where.
    pub worst: Option<(f64, [f64; 3])>,
}

impl MemberDeviation {
    /// The largest distance, either way.
    pub fn measured(&self) -> f64 {
        self.of_source.max().max(self.of_mesh.max())
    }

    fn merge(&mut self, part: &Part) {
        self.of_source.merge(&part.of_source);
        self.of_mesh.merge(&part.of_mesh);
        self.vanished.merge(&part.vanished);
        self.violations.merge(&part.violations);
    }
}

impl Vanished {
    fn merge(&mut self, other: &Vanished) {
        self.samples += other.samples;
        self.max = self.max.max(other.max);
    }
}

impl Violations {
    fn add(&mut self, distance: f64, point: Point3<f64>) {
        self.merge(&Violations { samples: 1, worst: Some((distance, point.coords.into())) });
    }

    fn merge(&mut self, other: &Violations) {
        self.samples += other.samples;
        if other.worst.is_some_and(|(d, _)| self.worst.is_none_or(|(worst, _)| d > worst)) {
            self.worst = other.worst;
        }
    }
}

/// Share of one task in one cluster.
#[derive(Clone, Copy, Default)]
struct Part {
    of_source: Tally,
    of_mesh: Tally,
    vanished: Vanished,
    violations: Violations,
}

impl<'a> Judge<'a> {
    /// Reads every page once. `samples` go on each triangle of the source; tiles may take `budget` bytes.
    ///
    /// # Errors
    /// Damaged pages, or [`VerifyError::Cancelled`].
    pub fn new(
        file: &'a Chpm<MappedFile>,
        samples: usize,
        budget: u64,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Self, VerifyError> {
        let count = file.clusters().len();
        progress.begin("pages", count as u64);
        (0..count as u32).into_par_iter().try_for_each(|id: u32| -> Result<(), VerifyError> {
            cancel.check()?;
            file.page_checked(ClusterId(id))?;
            progress.advance(1);
            Ok(())
        })?;
        progress.end();
        let budget = budget / 2;
        let (leaves, source) = source_tiles(file, budget, cancel);
        let bounds = file.header().aabb();
        let largest = bounds.min.iter().chain(&bounds.max).fold(0.0, |most: f32, x| most.max(x.abs()));
        let slack = SLACK * f64::from(largest);
        Ok(Judge { file, source, leaves, samples, budget, slack })
    }

    /// Measures a cut, both ways. Returns its members in their order.
    ///
    /// # Errors
    /// [`VerifyError::Cancelled`], or those of a file that was changed meanwhile.
    pub fn cut(
        &self,
        cut: &Cut,
        label: &str,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Vec<MemberDeviation>, VerifyError> {
        let (file, members) = (self.file, cut.members());
        let mut found = Vec::with_capacity(members.len());
        for member in members {
            let stored = file.page(member.cluster)?.view().error_at(member.vertices as usize);
            let group = file.clusters()[member.cluster.index()].group();
            found.push(MemberDeviation {
                member: *member,
                triangles: 0,
                stored,
                distance: file.gaps(group).distance(stored),
                of_source: Tally::default(),
                of_mesh: Tally::default(),
                vanished: Vanished::default(),
                violations: Violations::default(),
            });
        }
        let boxes: Vec<Aabb> = members.iter().map(|m| file.clusters()[m.cluster.index()].aabb()).collect();
        let drawn = drawn_tiles(file, members, boxes.clone(), self.budget, cancel);
        progress.begin(label, (self.leaves.len() + members.len()) as u64);
        let near = BoxTree::reaching(&boxes, |index| f64::from(found[index].distance) + self.slack);
        let view = View { judge: self, drawn: &drawn, near, found: &found, cancel };

        let from_leaves = (0..self.leaves.len()).into_par_iter().map(|leaf| {
            let found = view.of_leaf(leaf)?;
            progress.advance(1);
            Ok(found)
        });
        let from_leaves = from_leaves.collect::<Result<Vec<_>, VerifyError>>()?;

        // A coarse mesh gets its share of the source's samples: its triangles were twice as many with every level below.
        let record = |id: ClusterId| &file.clusters()[id.index()];
        let source: f64 = self.leaves.iter().map(|id| f64::from(record(*id).triangle_count)).sum();
        let weights = members
            .iter()
            .map(|m| record(m.cluster))
            .map(|record| f64::from(record.triangle_count) * f64::from(record.level).exp2());
        let weights: Vec<f64> = weights.collect();
        let density = source / weights.iter().sum::<f64>().max(1.0);
        let from_members = (0..members.len()).into_par_iter().map(|index| {
            let budget = (self.samples as f64 * density * weights[index]) as usize;
            let found = view.of_member(index, budget)?;
            progress.advance(1);
            Ok(found)
        });
        let from_members = from_members.collect::<Result<Vec<_>, VerifyError>>()?;
        progress.end();

        // Sums of floats depend on their order: leaves by id, then members by id.
        for (index, part) in from_leaves.iter().flatten() {
            found[*index].merge(part);
        }
        for (member, (triangles, part)) in found.iter_mut().zip(&from_members) {
            member.triangles = *triangles;
            member.merge(part);
        }
        Ok(found)
    }

    /// The file.
    pub fn file(&self) -> &'a Chpm<MappedFile> {
        self.file
    }

    /// Distances up to this count as none.
    pub fn slack(&self) -> f64 {
        self.slack
    }
}

impl Part {
    fn merge(&mut self, other: &Part) {
        self.of_source.merge(&other.of_source);
        self.of_mesh.merge(&other.of_mesh);
        self.vanished.merge(&other.vanished);
        self.violations.merge(&other.violations);
    }
}

/// A cut and all that its samples are held against.
struct View<'a> {
    judge: &'a Judge<'a>,
    drawn: &'a Tiles<'a>,
    /// The members by how far each may answer for.
    near: BoxTree,
    found: &'a [MemberDeviation],
    /// Looked at before every sample: thousands may be on one triangle. Whoever asked for them tells.
    cancel: &'a Cancel,
}

/// The largest distances by cluster, of the few that a task comes to.
#[derive(Default)]
struct Largest(Vec<(usize, f64)>);

impl Largest {
    fn of(&self, index: usize) -> f64 {
        self.0.iter().find(|(i, _)| *i == index).map_or(0.0, |(_, largest)| *largest)
    }

    fn raise(&mut self, index: usize, distance: f64) {
        match self.0.iter_mut().find(|(i, _)| *i == index) {
            Some((_, largest)) => *largest = largest.max(distance),
            None => self.0.push((index, distance)),
        }
    }
}

/// Joins the results of a leaf's tasks by member.
fn together(parts: impl Iterator<Item = Vec<(usize, Part)>>) -> Vec<(usize, Part)> {
    let mut all: Vec<(usize, Part)> = Vec::new();
    for (index, part) in parts.flatten() {
        match all.iter_mut().find(|(i, _)| *i == index) {
            Some((_, known)) => known.merge(&part),
            None => all.push((index, part)),
        }
    }
    all
}

impl View<'_> {
    /// Samples of a leaf, by the member that answers for them.
    fn of_leaf(&self, leaf: usize) -> Result<Vec<(usize, Part)>, VerifyError> {
        self.cancel.check()?;
        let (mesh, samples) = (self.judge.source.mesh(leaf), self.judge.samples);
        let budget = samples * mesh.triangles.len();
        let sampler = Sampler::new(&mesh, Density { per_triangle: samples, budget, seed: 0 });
        let parts: Vec<_> = Block::all(&sampler).map(|block| self.of_source(&sampler, block)).collect();
        self.cancel.check()?;
        Ok(together(parts.into_iter().flatten()))
    }

    /// Triangles of a member, and `budget` samples of it.
    fn of_member(&self, index: usize, budget: usize) -> Result<(u64, Part), VerifyError> {
        self.cancel.check()?;
        let (mesh, per_triangle) = (self.drawn.mesh(index), self.judge.samples);
        let sampler = Sampler::new(&mesh, Density { per_triangle, budget, seed: 0 });
        let parts: Vec<Vec<Part>> =
            Block::all(&sampler).map(|block| self.of_mesh(index, &sampler, block)).collect();
        let mut all = Part::default();
        parts.iter().flatten().for_each(|part| all.merge(part));
        self.cancel.check()?;
        Ok((mesh.triangles.len() as u64, all))
    }

    /// Samples of the source: credited to who answers for them.
    fn of_source(&self, sampler: &Sampler<'_>, block: Block) -> Vec<Vec<(usize, Part)>> {
        block.sweep(
            sampler,
            || (Searcher::new(self.drawn), Largest::default()),
            |(drawn, most), point, area| self.credit(drawn, most, point, area),
            |parts: &mut Vec<(usize, Part)>, point, area, (index, distance, keeps)| {
                let at = parts.iter().position(|(i, _)| *i == index).unwrap_or_else(|| {
                    parts.push((index, Part::default()));
                    parts.len() - 1
                });
                let part = &mut parts[at].1;
                part.of_source.add(point, distance, area);
                if !keeps {
                    part.violations.add(distance, point);
                } else if distance > f64::from(self.found[index].stored) + self.judge.slack {
                    part.vanished.merge(&Vanished { samples: 1, max: distance });
                }
            },
        )
    }

    /// The member that answers for a sample of the source, how far it is, and whether it keeps its word.
    fn credit(
        &self,
        drawn: &mut Searcher<'_>,
        most: &mut Largest,
        point: Point3<f64>,
        area: f64,
    ) -> (usize, f64, bool) {
        // Nothing is found any more, nor looked at.
        if self.cancel.is_cancelled() {
            return (0, f64::INFINITY, true);
        }

        // What only the maximum knows of is not searched for where its cluster has a larger one, and keeps its word.
        let hit = if area == 0.0 {
            drawn.near_enough(point, true, |index| most.of(index).min(f64::from(self.found[index].stored)))
        } else {
            drawn.nearest(point)
        };
        let distance = hit.map_or(f64::INFINITY, |hit| hit.distance);
        let nearest = hit.map_or(0, |hit| hit.tile);
        match self.answer(drawn, nearest, distance, point) {
            Some((index, distance)) => {
                most.raise(index, distance);
                (index, distance, true)
            }
            None => (nearest, distance, false),
        }
    }

    fn bound(&self, index: usize) -> f64 {
        f64::from(self.found[index].distance) + self.judge.slack
    }

    /// The nearest member if it keeps its word, else the nearest of those that do, each with how far it is.
    fn answer(
        &self,
        drawn: &mut Searcher<'_>,
        nearest: usize,
        distance: f64,
        point: Point3<f64>,
    ) -> Option<(usize, f64)> {
        if distance <= self.bound(nearest) {
            return Some((nearest, distance));
        }
        let (mut best, mut found) = (f64::INFINITY, None);
        self.near.search(point, &mut best, |place, best| {
            let index = self.near.order()[place] as usize;
            let bound = self.bound(index);
            let mut own = best.min((bound * bound).next_up());
            if drawn.improve(index, point, &mut own) && own.sqrt() <= bound {
                *best = own;
                found = Some(index);
            }
        });
        found.map(|index| (index, best.sqrt()))
    }

    fn of_mesh(&self, index: usize, sampler: &Sampler<'_>, block: Block) -> Vec<Part> {
        let stored = f64::from(self.found[index].stored);
        block.sweep(
            sampler,
            || (Searcher::new(&self.judge.source), 0.0_f64),
            |(source, most), point, area| {
                if self.cancel.is_cancelled() {
                    return f64::INFINITY;
                }
                let hit = if area == 0.0 {
                    source.near_enough(point, false, |_| most.min(stored))
                } else {
                    source.nearest(point)
                };
                let distance = hit.map_or(f64::INFINITY, |hit| hit.distance);
                *most = most.max(distance);
                distance
            },
            |part: &mut Part, point, area, distance| {
                part.of_mesh.add(point, distance, area);
                // Nothing is drawn that is farther from the source than the error: what has vanished is not there.
                if distance > stored + self.judge.slack {
                    part.violations.add(distance, point);
                }
            },
        )
    }
}

/// A cluster's finest mesh. Its page was read before, as below.
pub(crate) fn finest(file: &Chpm<MappedFile>, cluster: ClusterId) -> TriMesh {
    let vertices = file.clusters()[cluster.index()].vertex_count;
    mesh_of(file, Member { cluster, vertices })
}

/// The leaves, and the source that they hold, of which about `budget` bytes are in memory. After a stop tiles are empty: whoever asked for it
/// looks again before anything that was found in them is used.
pub(crate) fn source_tiles<'a>(
    file: &'a Chpm<MappedFile>,
    budget: u64,
    cancel: &Cancel,
) -> (Vec<ClusterId>, Tiles<'a>) {
    let all = (0..file.clusters().len() as u32).map(ClusterId);
    let leaves: Vec<ClusterId> = all.filter(|id| file.clusters()[id.index()].is_leaf()).collect();
    let boxes = leaves.iter().map(|id| file.clusters()[id.index()].aabb()).collect();
    let (ids, cancel) = (leaves.clone(), cancel.clone());
    (
        leaves,
        Tiles::new(boxes, budget, move |tile: usize| {
            if cancel.is_cancelled() { TriMesh::default() } else { finest(file, ids[tile]) }
        }),
    )
}

/// Triangles that members with these boxes draw, likewise.
pub(crate) fn drawn_tiles<'a>(
    file: &'a Chpm<MappedFile>,
    members: &'a [Member],
    boxes: Vec<Aabb>,
    budget: u64,
    cancel: &'a Cancel,
) -> Tiles<'a> {
    Tiles::new(boxes, budget, move |tile: usize| {
        if cancel.is_cancelled() { TriMesh::default() } else { mesh_of(file, members[tile]) }
    })
}

/// A cluster's mesh at a position; an empty one where the file was changed since its page was read the first time, which
/// whoever opened the file looks at in the end, whatever came of it.
pub(crate) fn mesh_of(file: &Chpm<MappedFile>, member: Member) -> TriMesh {
    let Ok(page) = file.page(member.cluster) else {
        assert!(file.get_ref().check_unchanged().is_err(), "all pages were read before");
        return TriMesh::default();
    };
    let page = page.view();
    let mut triangles = Vec::with_capacity(page.triangles.len());
    page.progressive_mesh().triangles_at(member.vertices as usize, &mut triangles);
    let triangles = triangles.iter().map(|t| t.map(u32::from)).collect();
    TriMesh::new(page.positions[..member.vertices as usize].to_vec(), triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_build::{BuildConfig, build};
    use chpm_extmem::Silent;
    use chpm_import::ply::{Encoding, write_mesh};
    use chpm_synth::hand;
    use std::fs::File;

    #[test]
    fn what_is_cut_while_it_is_measured_is_no_panic() {
        let folder = tempfile::tempdir().unwrap();
        let [source, path] = ["in.ply", "out.chpm"].map(|name| folder.path().join(name));
        write_mesh(File::create(&source).unwrap(), &hand::icosphere(3), Encoding::BinaryLittleEndian)
            .unwrap();
        build(&source, &path, &BuildConfig::default(), &Silent, &Cancel::default()).unwrap();
        let file = Chpm::open(MappedFile::open(&path).unwrap()).unwrap();
        assert_eq!(finest(&file, ClusterId(0)).triangles.len(), 1280);
        let other = File::options().write(true).open(&path).unwrap();
        other.set_len(file.clusters()[0].page_offset).unwrap();
        assert!(finest(&file, ClusterId(0)).triangles.is_empty());
        assert!(file.get_ref().check_unchanged().unwrap_err().to_string().contains("was cut short"));
    }
}
