//! How far points are from a model, each within a tolerance.

use crate::error::ProximityError;
use crate::patch::{Search, Spot};
use crate::pose::{Between, Frame, Pose};
use chpm_mesh::curve::morton;
use chpm_mesh::{ClusterId, GroupId};
use chpm_space::{Block, Model, Patch};
use nalgebra::Vector3;
use std::collections::{BTreeSet, BinaryHeap};
use std::sync::Arc;

/// Measures points of one model against another, the reference.
pub struct Gauge<'m, 'a, D> {
    reference: &'m Model<'a, D>,
    between: Between,
    /// Error of the points: against their source, and by rounding.
    points: f64,
    tolerance: f64,
}

/// A patch in its box.
type Boxed = (Block, Arc<Patch>);

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
        Ok(Gauge { reference, between, points, tolerance })
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
            let (patches, wrong) = self.candidates(run, points)?;
            coarsest = coarsest.max(wrong);
            let mut last = None;
            let mut order: Vec<(f64, usize)> = Vec::with_capacity(patches.len());
            for number in run {
                let point = &points[*number as usize];
                let mut spot = Spot::beyond(f64::INFINITY);
                // What is nearest to one is near to the next.
                if let Some((patch, triangle)) = last {
                    let (_, patch): &Boxed = &patches[patch];
                    patch.take(triangle, point, &mut spot);
                    spot = spot.again();
                }
                order.clear();
                order
                    .extend(patches.iter().enumerate().map(|(i, (block, _))| (block.squared_from(point), i)));
                order.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
                for (away, i) in &order {
                    if *away > spot.reach() {
                        break;
                    }
                    if let Some(triangle) = patches[*i].1.nearest_to(point, &mut spot) {
                        last = Some((*i, triangle));
                    }
                }
                found[*number as usize] = spot.distance();
                disputed.extend(spot.is_disputed().then_some(*number as usize));
                unsure = unsure.max(spot.unsure());
            }
        }
        Ok((found, (self.points + coarsest + unsure) * (1.0 + 4.0 * f64::EPSILON), disputed))
    }

    /// Whether the meshes of a group are as near to the source as they have to be.
    fn is_fine(&self, group: GroupId) -> bool {
        let wrong = self.reference.wrong(group);
        self.reference.is_leaf(group)
            || wrong.error.max(wrong.distance) <= self.tolerance - self.points - UNSURE * self.tolerance
    }

    /// Patches of which one is nearest to each point of a run, and how far the coarsest of them is from the source at most.
    fn candidates(&self, run: &[u32], points: &[Vector3<f64>]) -> Result<(Vec<Boxed>, f64), ProximityError> {
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
        let near = found.iter().filter(|(away, _)| *away <= upper + 2.0 * radius);
        let mut patches = Vec::new();
        for (_, cluster) in near {
            patches.push((self.reference.cluster_block(*cluster), self.reference.patch_for_many(*cluster)?));
        }
        Ok((patches, coarsest))
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

/// The share of the tolerance that is kept for where formulas cannot tell.
const UNSURE: f64 = 1e-6;

/// Points that look for the patches that they may be near to together.
const RUN: usize = 256;

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
