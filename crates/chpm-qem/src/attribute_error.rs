//! How far normals and colours are from the source's: what the collapses so far have done to them.
//!
//! An attribute is interpolated over each face. The map of a collapse (see `overlay`) is linear on each cell that an old and
//! a new face have in common, and so is the difference of the attribute before and after it: it is largest at a corner of the
//! cell. Along a chain of collapses these differences add up. Where attributes jump about, their sum says too much, and the range of what
//! the source points in a face look like says more; of the two bounds the smaller one holds.

use crate::overlay::{CellPoint, Overlay};
use crate::patch::Patch;
use crate::ring::Ring;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::geom::round_up;
use chpm_mesh::{Octahedral, VertexSlices};
use nalgebra::{Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// Relative rounding error of a difference of attributes, with room.
const LOST: f64 = 1.0 / (1u64 << 48) as f64;

/// Normals and colours are handled alike, as values from 0 to 255: this is what coordinates of a unit normal are scaled by.
const NORMAL_SCALE: f64 = 127.0;
const NORMAL: usize = 0;
const COLOR: usize = 1;

/// A vertex's normal, scaled, or its colour.
type Value = Vector4<f64>;

/// Attributes of a patch's vertices, and how far its triangles deviate from the source's attributes.
#[derive(Clone, Copy, Debug, Default)]
pub struct AttributeErrors<'a> {
    /// Normals of any length, one a vertex or none.
    pub normals: &'a [[f32; 3]],
    /// Normals of three bytes, one a vertex or none.
    pub octahedral: &'a [Octahedral],
    /// Colours (RGBA), one a vertex or none.
    pub colors: &'a [[u8; 4]],
    /// One a triangle; empty if the patch is the source.
    pub faces: &'a [FaceAttributeError],
}

impl<'a> AttributeErrors<'a> {
    /// Attribute error of `faces` over these vertices.
    pub fn new(vertices: VertexSlices<'a>, faces: &'a [FaceAttributeError]) -> Self {
        let VertexSlices { normals, octahedral, colors, .. } = vertices;
        AttributeErrors { normals, octahedral, colors, faces }
    }

    /// Whether the vertices have no attributes.
    pub fn is_empty(&self) -> bool {
        self.normals.is_empty() && self.octahedral.is_empty() && self.colors.is_empty()
    }

    /// Appends the attribute errors of the source's own triangles, which are zero; none where there are no attributes.
    pub fn of_source(&self, triangles: &[[u16; 3]], faces: &mut Vec<FaceAttributeError>) {
        let mut values = [Vec::new(), Vec::new()];
        self.append_values(&mut values);
        if !self.is_empty() {
            append_faces(&values, triangles, faces);
        }
    }

    /// Appends the values of the vertices, by attribute.
    fn append_values(&self, values: &mut [Vec<Value>; 2]) {
        values[NORMAL].extend(self.normals.iter().map(normal_value));
        values[NORMAL].extend(self.octahedral.iter().map(|code| normal_value(&code.vector())));
        values[COLOR].extend(self.colors.iter().map(color_value));
    }
}

/// Appends attribute errors of zero, with the range of values of each triangle.
fn append_faces(values: &[Vec<Value>; 2], triangles: &[[u16; 3]], faces: &mut Vec<FaceAttributeError>) {
    faces.extend(triangles.iter().map(|corners| {
        let mut error = FaceAttributeError::default();
        for (range, values) in error.ranges.iter_mut().zip(values).filter(|(_, values)| !values.is_empty()) {
            *range = Range::of(corners.map(|v| values[usize::from(v)]));
        }
        error
    }));
}

fn normal_value(normal: &[f32; 3]) -> Value {
    let unit = Vector3::from(normal.map(f64::from)).try_normalize(0.0).unwrap_or_default();
    (unit.insert_row(3, 0.0) * NORMAL_SCALE).add_scalar(NORMAL_SCALE)
}

fn color_value(color: &[u8; 4]) -> Value {
    Value::from(color.map(f64::from))
}

/// A bound on how far the interpolated attributes at a point of a mesh are from those of the source at the point that the
/// collapses took there. Rounded up; 0 for attributes that are not there.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Deviation {
    /// Length of the difference of the normals, each interpolated between unit normals.
    pub normal: f32,
    /// Largest difference of a channel, in units of which a channel has 255.
    pub color: f32,
}

impl Deviation {
    /// The larger of both, for each attribute.
    #[must_use]
    pub fn max(self, other: Deviation) -> Deviation {
        Deviation { normal: self.normal.max(other.normal), color: self.color.max(other.color) }
    }

    /// The angle between two unit normals whose difference has the length of `normal`: 0 to 180 degrees.
    pub fn degrees(self) -> f32 {
        let half = libm::asin((f64::from(self.normal) / 2.0).min(1.0));
        round_up(2.0 * half.to_degrees()).min(180.0)
    }

    /// The difference of the colours: 0 to 255.
    pub fn units(self) -> f32 {
        self.color.min(255.0)
    }
}

/// Attribute error of a face: its deviation from the source, and the range of the source's values at the points that are in it now.
#[derive(Clone, Copy, PartialEq, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct FaceAttributeError {
    deviations: [f32; 2],
    ranges: [Range; 2],
}

/// The least and the largest value of each channel, rounded outward.
#[derive(Clone, Copy, PartialEq, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct Range {
    low: [u8; 4],
    high: [u8; 4],
}

impl Range {
    fn of(corners: [Value; 3]) -> Range {
        let [a, b, c] = corners;
        Range {
            low: a.inf(&b).inf(&c).map(|x| x.floor() as u8).into(),
            high: a.sup(&b).sup(&c).map(|x| x.ceil() as u8).into(),
        }
    }

    fn merge(&mut self, other: &Range) {
        for channel in 0..4 {
            self.low[channel] = self.low[channel].min(other.low[channel]);
            self.high[channel] = self.high[channel].max(other.high[channel]);
        }
    }

    /// How far a value of the range may be from one between the corners.
    fn reach(&self, attribute: usize, corners: [Value; 3]) -> f64 {
        let [a, b, c] = corners;
        let (low, high) = (Value::from(self.low.map(f64::from)), Value::from(self.high.map(f64::from)));
        let reach = length(attribute, &(high - a.inf(&b).inf(&c)).sup(&(a.sup(&b).sup(&c) - low)));
        if attribute == COLOR {
            return reach;
        }
        // No normal is longer than a unit, so that the square of a difference is at most 2 less twice the least product.
        let origin = Value::repeat(NORMAL_SCALE);
        let (low, high) = (low - origin, high - origin);
        let least = corners
            .map(|corner| {
                let corner = corner - origin;
                corner.component_mul(&low).inf(&corner.component_mul(&high)).sum()
            })
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        reach.min((2.0 * (NORMAL_SCALE * NORMAL_SCALE * (1.0 + LOST) - least)).max(0.0).sqrt())
    }
}

impl FaceAttributeError {
    /// Deviation of the face as it is now.
    pub fn deviation(&self) -> Deviation {
        let [normal, color] = self.deviations;
        Deviation { normal: round_up(f64::from(normal) / NORMAL_SCALE), color }
    }

    /// The same after a further difference.
    fn after(mut self, differences: [f32; 2]) -> FaceAttributeError {
        for (deviation, more) in self.deviations.iter_mut().zip(differences) {
            if more != 0.0 {
                *deviation = round_up(f64::from(*deviation) + f64::from(more));
            }
        }
        self
    }

    /// Takes in points of another face.
    fn merge(&mut self, other: &FaceAttributeError) {
        self.deviations = larger(self.deviations, other.deviations);
        for (range, other) in self.ranges.iter_mut().zip(&other.ranges) {
            range.merge(other);
        }
    }
}

fn larger(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].max(b[0]), a[1].max(b[1])]
}

/// Size of a difference: the length of a normal, the largest channel of a colour.
fn length(attribute: usize, difference: &Value) -> f64 {
    if attribute == NORMAL { difference.norm() } else { difference.amax() }
}

/// The attribute errors of a patch while it is decimated. Does nothing where there are no attributes.
#[derive(Debug, Default)]
pub(crate) struct AttributeErrorTracker {
    /// By attribute, of the vertices; empty if they do not have it.
    values: [Vec<Value>; 2],
    pub(crate) faces: Vec<FaceAttributeError>,
    /// The largest deviations that a collapse left.
    largest: [f32; 2],
    /// Differences at the corners of the cells.
    corners: Vec<[f32; 2]>,
    /// Deviations of the faces about v after the collapse.
    changed: Vec<FaceAttributeError>,
}

impl AttributeErrorTracker {
    pub(crate) fn begin(&mut self, patch: &Patch<'_>) {
        self.values.iter_mut().for_each(Vec::clear);
        self.faces.clear();
        self.largest = [0.0; 2];
        let attribute_errors = &patch.attribute_errors;
        if attribute_errors.is_empty() {
            return;
        }
        attribute_errors.append_values(&mut self.values);
        self.faces.extend_from_slice(attribute_errors.faces);
        if self.faces.is_empty() {
            append_faces(&self.values, patch.triangles, &mut self.faces);
        }
    }

    /// Whether the vertices have no attributes.
    pub(crate) fn is_empty(&self) -> bool {
        self.faces.is_empty()
    }

    /// The largest deviation that a collapse of the run left.
    pub(crate) fn largest(&self) -> Deviation {
        FaceAttributeError { deviations: self.largest, ..FaceAttributeError::default() }.deviation()
    }

    /// Carries the attribute errors of the faces about u on over the collapse u -> v, cell by cell.
    pub(crate) fn carry_over(&mut self, overlay: &Overlay, ring: &Ring, u: u16, v: u16) {
        let mut at = std::mem::take(&mut self.corners);
        let mut changed = std::mem::take(&mut self.changed);
        changed.clear();

        for sector in overlay.sectors() {
            at.clear();
            at.push([0.0; 2]);
            overlay.places(ring, sector, |place| at.push(self.differences(u, v, &place)));
            Overlay::cells(ring, sector, |new, old, corners| {
                let differences = corners.iter().map(|corner| at[usize::from(*corner)]);
                let after = self.faces[old as usize].after(differences.fold([0.0; 2], larger));
                match changed.get_mut(new - 1) {
                    Some(all) => all.merge(&after),
                    None => changed.push(after),
                }
            });
        }

        for (new, error) in (1..).zip(&changed) {
            let (face, corners) = Overlay::new_face(ring, new);
            self.keep(Some(face), *error, corners);
        }
        (self.changed, self.corners) = (changed, at);
    }

    /// A face takes its points along, linearly.
    pub(crate) fn sweep(&mut self, face: u32, moved: [f32; 2], corners: [u16; 3]) {
        self.keep(Some(face), self.faces[face as usize].after(moved), corners);
    }

    /// Hands the points of a face over to another, which has the given corners, or to the point where they end for good.
    pub(crate) fn hand_over(&mut self, from: u32, moved: [f32; 2], to: Option<u32>, corners: [u16; 3]) {
        let mut error = self.faces[from as usize].after(moved);
        if let Some(face) = to {
            error.merge(&self.faces[face as usize]);
        }
        self.keep(to, error, corners);
    }

    fn keep(&mut self, face: Option<u32>, mut error: FaceAttributeError, corners: [u16; 3]) {
        for (attribute, values) in self.values.iter().enumerate().filter(|(_, v)| !v.is_empty()) {
            let reach = error.ranges[attribute].reach(attribute, corners.map(|v| values[usize::from(v)]));
            let deviation = &mut error.deviations[attribute];
            *deviation = deviation.min(round_up(reach));
        }
        self.largest = larger(self.largest, error.deviations);
        if let Some(face) = face {
            self.faces[face as usize] = error;
        }
    }

    /// How far the attributes at a place of the new one-ring are from those at the same place of the old one, rounded up. Taken from
    /// differences of vertices, so that it is zero where they have one value.
    pub(crate) fn differences(&self, u: u16, v: u16, place: &CellPoint) -> [f32; 2] {
        [NORMAL, COLOR].map(|attribute| {
            let values = &self.values[attribute];
            if values.is_empty() {
                return 0.0;
            }
            let (at_u, at_v) = (values[usize::from(u)], values[usize::from(v)]);
            let (step, along) = (at_v - at_u, values[usize::from(place.old.0)] - at_u);
            let mut difference = along * place.old.1 - step;
            let mut spread = step.amax() + along.amax();
            for (vertex, share) in place.new {
                let along = values[usize::from(vertex)] - at_v;
                difference -= along * share;
                spread += along.amax();
            }
            // A vector is no longer than twice its largest coordinate.
            round_up(length(attribute, &difference) + 2.0 * (place.loss + LOST) * spread)
        })
    }
}
