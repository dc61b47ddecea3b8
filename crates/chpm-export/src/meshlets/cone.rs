//! Bounds of a meshlet, for culling: a sphere about its vertices, and a cone about the normals of its triangles.

use chpm_mesh::geom::{Sphere, area_vector};
use nalgebra::Vector3;

/// The cone of a meshlet that is never culled: no direction has such a sine.
const NEVER: f32 = 2.0;
/// Cosine of the angle to a normal from which on a cone culls nothing worth a test.
const LEAST: f64 = 0.1;
/// Room for a test in single precision.
const SLACK: f64 = 1e-5;
/// Steps of the search for the axis. The sum of all normals makes 1.4 to 3 times as many cones too wide.
const STEPS: u32 = 24;

/// The cone about the normals of triangles.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Cone {
    /// Its axis, of length 1.
    pub(super) axis: [f32; 3],
    /// Sine of the widest angle between the axis and a normal.
    pub(super) sine: f32,
}

/// Bounds of triangles.
///
/// All face away from an eye where `dot(center - eye, axis) >= sine * |center - eye| + radius`: a normal that is at most θ off the axis then has at least the sine of ψ - θ with the
/// way to the centre, where sin ψ ≥ sin θ + radius / way, and sin(ψ - θ) ≥ sin ψ - sin θ between 0 and a right angle.
pub(super) fn bounds(triangles: impl Iterator<Item = [[f32; 3]; 3]> + Clone) -> (Sphere, Cone) {
    let points: Vec<[f32; 3]> = triangles.clone().flatten().collect();
    let sphere = Sphere::of_points(&points);

    // What has no area faces nowhere.
    let normals: Vec<Vector3<f64>> = triangles
        .filter_map(|[a, b, c]| {
            let area = area_vector(a, b, c);
            let largest = area.amax();
            (largest > 0.0).then(|| (area / largest).normalize())
        })
        .collect();
    let axis = middle(&normals).try_normalize(1e-6).map(|axis| axis.map(|x| x as f32));
    let Some(axis) = axis else { return (sphere, Cone { axis: [0.0, 0.0, 1.0], sine: NEVER }) };

    // Of the axis as it is stored.
    let stored = axis.map(f64::from).normalize();
    let cosine = normals.iter().map(|normal| normal.dot(&stored)).fold(1.0, f64::min);
    let sine = if cosine > LEAST { ((1.0 - cosine * cosine).max(0.0).sqrt() + SLACK) as f32 } else { NEVER };
    (sphere, Cone { axis: axis.into(), sine })
}

/// About the middle of the smallest ball around points: from their mean, always less far towards the farthest.
fn middle(points: &[Vector3<f64>]) -> Vector3<f64> {
    let mut middle = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
    for step in 2..2 + STEPS {
        let away = points.iter().map(|point| point - middle);
        let farthest = away.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
        middle += farthest.unwrap_or_default() / f64::from(step);
    }
    middle
}
