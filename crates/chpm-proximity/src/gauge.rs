//! How far points are from a model, each within a tolerance.

use crate::error::ProximityError;
use crate::patch::{Search, Spot};
use crate::pose::{Between, Frame, Pose};
use crate::wanted::{self, Wanted};
use chpm_format::Chpm;
use chpm_mesh::curve::morton;
use chpm_mesh::{ClusterId, GroupId};
use chpm_space::{Corners, Model};
use nalgebra::Vector3;
use std::collections::{BTreeSet, BinaryHeap};

/// Measures points of one model against another, the reference.
pub struct Gauge<'m, 'a, D> {
    reference: &'m Model<'a, D>,
    between: Between,
    /// Error of the points: against their source, and by rounding.
    points: f64,
    tolerance: f64,
    /// Bytes of patches to hold at once.
    held: u64,
}

/// Bytes of patches that a call holds, about.
const HELD: u64 = 2 << 20;

/// A point on its way to what is nearest to it.
struct Seeker {
    spot: Spot,
    /// How far the last patch was that was looked at, and its place.
    passed: Option<(f64, usize)>,
    /// The triangle that is nearest so far.
    nearest: Option<Corners>,
}

/// A group of the reference that may be nearest to a point.
struct Waiting {
    lower: f64,
    group: GroupId,
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    /// The nearest is the greatest.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        other.lower.total_cmp(&self.lower).then(other.group.cmp(&self.group))
    }
}

impl<'m, 'a, D: AsRef<[u8]>> Gauge<'m, 'a, D> {
    /// Points are positions of `scan`, relative to its origin; poses are the scan's and the reference's.
    ///
    /// # Errors
    /// A tolerance that is no length.
    pub fn new<E: AsRef<[u8]>>(
        scan: &Model<'_, E>,
        reference: &'m Model<'a, D>,
        poses: [&Pose; 2],
        tolerance: f64,
    ) -> Result<Self, ProximityError> {
        if tolerance.is_nan() || tolerance < 0.0 {
            return Err(ProximityError::Length { what: "tolerance", got: tolerance });
        }
        let between = Between::new(&Frame::of(reference, poses[1]), &Frame::of(scan, poses[0]));
        let points = between.margin + scan.rounding();
        Ok(Gauge { reference, between, points, tolerance, held: HELD })
    }

    /// Bytes that a call of [`measure`](Self::measure) takes at most beside its points and what the reference keeps.
    pub fn memory(reference: &Chpm<D>) -> u64 {
        let (clusters, groups) = (reference.clusters().len() as u64, reference.groups().len() as u64);
        HELD + wanted::memory(reference) + FOUND * clusters + WAITING * groups
    }

    /// How much of a distance cannot be known, whatever the tolerance: what f64 may have lost, the poses, and what the leaves of both are from their sources.
    pub fn rounding(&self) -> f64 {
        self.points + self.reference.rounding()
    }

    /// Appends the distance of each point to `out`: negative on the side that the surface turns its back to where it is nearest. Answers how far their sizes may be
    /// from those of the sources, all counted: the tolerance or less, unless the [rounding](Self::rounding) leaves no room for it.
    ///
    /// # Errors
    /// A damaged page.
    pub fn measure(&self, points: &[[f32; 3]], out: &mut Vec<f64>) -> Result<f64, ProximityError> {
        let points: Vec<Vector3<f64>> = points.iter().map(|point| self.between.apply(*point)).collect();
        let (mut found, within, disputed) = self.find(&points)?;
        // Where coarse meshes of several levels meet, parts of the surface are there twice; the leaves are one surface.
        let far: Vec<usize> = disputed.into_iter().filter(|i| found[*i].abs() > self.tolerance).collect();
        if self.tolerance > 0.0 && !far.is_empty() {
            let exact = Gauge {
                reference: self.reference,
                between: self.between,
                points: self.points,
                tolerance: 0.0,
                held: self.held,
            };
            let points: Vec<Vector3<f64>> = far.iter().map(|i| points[*i]).collect();
            let (signed, ..) = exact.find(&points)?;
            far.iter().zip(signed).for_each(|(i, signed)| found[*i] = found[*i].abs().copysign(signed));
        }
        out.append(&mut found);
        Ok(within)
    }

    /// The distance of each point, how far their sizes may be off, and the numbers of those whose sign is disputed.
    fn find(&self, points: &[Vector3<f64>]) -> Result<(Vec<f64>, f64, Vec<usize>), ProximityError> {
        let (mut found, mut disputed) = (vec![0.0; points.len()], Vec::new());
        let (mut coarsest, mut unsure) = (0.0_f64, 0.0_f64);
        // In runs that are near each other, each with the patches that it may be near to.
        for run in along_a_curve(points).chunks(RUN) {
            let (mut wanted, wrong) = self.candidates(run, points)?;
            coarsest = coarsest.max(wrong);
            for (number, spot) in run.iter().zip(self.seek(run, points, &mut wanted)?) {
                found[*number as usize] = spot.distance();
                disputed.extend(spot.is_disputed().then_some(*number as usize));
                unsure = unsure.max(spot.unsure());
            }
        }
        Ok((found, (self.points + coarsest + unsure) * (1.0 + 4.0 * f64::EPSILON), disputed))
    }

    /// Places nearest to each point of a run. Only some of the wanted patches are held at once: whoever comes to another one waits for the others. No point's way depends on how many
    /// are held.
    fn seek(
        &self,
        run: &[u32],
        points: &[Vector3<f64>],
        wanted: &mut Wanted<'_, 'a, D>,
    ) -> Result<Vec<Spot>, ProximityError> {
        let mut seekers: Vec<Seeker> = Vec::with_capacity(run.len());
        seekers.resize_with(run.len(), || Seeker {
            spot: Spot::beyond(f64::INFINITY),
            passed: None,
            nearest: None,
        });
        for (stride, before) in STRIDES.into_iter().zip([RUN].into_iter().chain(STRIDES)) {
            let is_new = |at: &usize| stride == RUN || !at.is_multiple_of(before);
            let mut open: Vec<usize> = (0..run.len()).step_by(stride).filter(is_new).collect();
            for at in &open {
                // What is near to one is near to the next.
                if let Some(corners) = seekers[at / before * before].nearest {
                    let spot = &mut seekers[*at].spot;
                    spot.take(&points[run[*at] as usize], &corners);
                    *spot = spot.again();
                }
            }
            while !open.is_empty() {
                let mut left = Vec::new();
                for at in open {
                    if !seekers[at].go_on(&points[run[at] as usize], wanted)? {
                        left.push(at);
                    }
                }
                open = left;
                if !open.is_empty() {
                    wanted.forget();
                }
            }
        }
        Ok(seekers.into_iter().map(|seeker| seeker.spot).collect())
    }

    /// Whether the meshes of a group are as near to the source as they have to be.
    fn is_fine(&self, group: GroupId) -> bool {
        let wrong = self.reference.wrong(group);
        self.reference.is_leaf(group)
            || wrong.error.max(wrong.distance) <= self.tolerance - self.points - UNSURE * self.tolerance
    }

    /// Patches of which one is nearest to each point of a run, and how far the coarsest of them is from the source at most.
    fn candidates(
        &self,
        run: &[u32],
        points: &[Vector3<f64>],
    ) -> Result<(Wanted<'m, 'a, D>, f64), ProximityError> {
        let run = run.iter().map(|number| &points[*number as usize]);
        let (low, high) = ends(run.clone());
        let center = (low + high) * 0.5;
        let radius = run.map(|point| (point - center).norm()).fold(0.0, f64::max);
        let (mut upper, mut coarsest) = (f64::INFINITY, 0.0_f64);
        let mut waiting = BinaryHeap::new();
        let mut known = BTreeSet::new();
        let mut found: Vec<(f64, ClusterId)> = Vec::new();
        for group in self.reference.top() {
            self.put(group, &center, &mut known, &mut waiting);
        }
        while let Some(Waiting { lower, group }) = waiting.pop() {
            // The middle's nearest point is this near to all others, but for twice the way to them.
            if lower > upper + 2.0 * radius {
                break;
            }
            if !self.is_fine(group) {
                for fine in self.reference.below(group) {
                    self.put(fine, &center, &mut known, &mut waiting);
                }
                continue;
            }
            let wrong = self.reference.wrong(group);
            coarsest = coarsest.max(wrong.error.max(wrong.distance));
            for cluster in self.reference.coarse(group) {
                let away = self.reference.cluster_block(cluster).squared_from(&center).sqrt();
                if away > upper + 2.0 * radius {
                    continue;
                }
                found.push((away, cluster));
                if away < upper {
                    let mut spot = Spot::beyond(upper);
                    self.reference.patch_for_many(cluster)?.nearest_to(&center, &mut spot);
                    upper = upper.min(spot.distance().abs() * (1.0 + 1e-9));
                }
            }
        }
        found.retain(|(away, _)| *away <= upper + 2.0 * radius);
        let near = found.into_iter().map(|(_, cluster)| cluster);
        Ok((Wanted::new(self.reference, self.held, near), coarsest))
    }

    fn put(
        &self,
        group: GroupId,
        center: &Vector3<f64>,
        known: &mut BTreeSet<GroupId>,
        waiting: &mut BinaryHeap<Waiting>,
    ) {
        if known.insert(group) {
            let lower = self.reference.block(group).squared_from(center).sqrt();
            waiting.push(Waiting { lower, group });
        }
    }
}

impl Seeker {
    /// Looks at patches, the nearest first, until the rest is too far, which is the end, or has to be waited for.
    fn go_on<D: AsRef<[u8]>>(
        &mut self,
        point: &Vector3<f64>,
        wanted: &mut Wanted<'_, '_, D>,
    ) -> Result<bool, ProximityError> {
        wanted.sort_by_distance(point);
        let passed = |&(away, at): &(f64, usize)| {
            self.passed.is_some_and(|(last, before)| away.total_cmp(&last).then(at.cmp(&before)).is_le())
        };
        for place in wanted.order().partition_point(passed)..wanted.order().len() {
            let (away, at) = wanted.order()[place];
            if away > self.spot.reach() {
                break;
            }
            let Some(patch) = wanted.patch(at)? else { return Ok(false) };
            if let Some(triangle) = patch.nearest_to(point, &mut self.spot) {
                self.nearest = Some(patch.triangle(triangle).0);
            }
            self.passed = Some((away, at));
        }
        Ok(true)
    }
}

/// The share of the tolerance that is kept for where formulas cannot tell.
const UNSURE: f64 = 1e-6;

/// Bytes of a cluster that may be near, and of a group that waits.
const FOUND: u64 = 32;
const WAITING: u64 = 48;

/// Points that look for the patches that they may be near to together.
const RUN: usize = 256;
/// In a run go first these, each so many behind the one before; each of the others begins with what was found for one of them.
const STRIDES: [usize; 3] = [RUN, 16, 1];

/// The corners of the box about points.
fn ends<'p>(points: impl Iterator<Item = &'p Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let none = Vector3::repeat(f64::INFINITY);
    points.fold((none, -none), |(low, high), point| (low.inf(point), high.sup(point)))
}

/// The numbers of points in an order in which those beside each other are near: by cells of a grid, digits of the three axes in turn.
fn along_a_curve(points: &[Vector3<f64>]) -> Vec<u32> {
    let (low, high) = ends(points.iter());
    let scale = (high - low).map(|size| if size > 0.0 { CELLS / size } else { 0.0 });
    let mut order: Vec<(u64, u32)> = points
        .iter()
        .map(|point| {
            let cell = (point - low).component_mul(&scale);
            morton([0, 1, 2].map(|axis| cell[axis] as u16))
        })
        .zip(0..)
        .collect();
    order.sort_unstable();
    order.into_iter().map(|(_, number)| number).collect()
}

/// Binary digits of a cell along an axis.
const BITS: u32 = 8;
/// The last cell along an axis.
const CELLS: f64 = ((1 << BITS) - 1) as f64;

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_build::{BuildConfig, Cancel, Resources, Settings, Silent, build};
    use chpm_import::ply::{Encoding, write_mesh};
    use chpm_mesh::Bytes;
    use chpm_space::Patch;
    use chpm_synth::hand;
    use std::fs::{self, File};

    /// Points about the middle of a ball, to which all of it is near.
    #[test]
    fn few_patches_are_held_at_once_and_answers_do_not_depend_on_how_many() {
        let folder = tempfile::tempdir().unwrap();
        let [source, path] = ["in.ply", "out.chpm"].map(|name| folder.path().join(name));
        write_mesh(File::create(&source).unwrap(), &hand::icosphere(4), Encoding::BinaryLittleEndian)
            .unwrap();
        let settings = Settings { cluster_triangles: 64, cell_vertices: 4, ..Settings::default() };
        let resources = Resources { threads: 1, ..Resources::default() };
        let config = BuildConfig { settings, resources, ..BuildConfig::default() };
        build(&source, &path, &config, &Silent, &Cancel::default()).unwrap();
        let file = Chpm::open(fs::read(&path).unwrap()).unwrap();
        let largest = file.clusters().iter().map(Patch::bytes_of).max().unwrap();
        let points: Vec<Vector3<f64>> =
            (0..300).map(f64::from).map(|i| Vector3::new(i.sin(), i.cos(), (2.0 * i).sin()) * 0.01).collect();
        let find = |held: u64| {
            let model = Model::new(&file, Bytes(0)).unwrap();
            let still = Pose::IDENTITY;
            let mut gauge = Gauge::new(&model, &model, [&still; 2], 0.0).unwrap();
            gauge.held = held;
            let run = along_a_curve(&points);
            let (mut wanted, _) = gauge.candidates(&run[..RUN], &points).unwrap();
            gauge.seek(&run[..RUN], &points, &mut wanted).unwrap();
            let reads = model.reads().pages;
            (gauge.find(&points).unwrap(), wanted.held_count(), reads)
        };
        let (all, most, reads) = find(u64::MAX);
        assert!(most > 40, "{most}");
        // Others are dropped and read again.
        for (held, few) in [(0, 1), (8 * largest, 32)] {
            let (found, count, more) = find(held);
            assert_eq!(found, all);
            assert!((1..=few).contains(&count), "{count} of {few}");
            assert!(more > reads, "{more} of {reads}");
        }
    }
}
