//! Hard for their shape: one-sided, through itself, or with spikes.

use super::sheet::{quads, side};
use crate::hand;
use crate::noise::{hash, turn};
use crate::{Shape, Synth};
use chpm_mesh::TriMesh;

/// `4 n` quads around, `n` across.
pub(super) fn moebius(triangles: u32) -> TriMesh {
    let across = (side(triangles) / 2).max(1);
    let around = (triangles / (2 * across)).max(3);
    let columns = (0..around).flat_map(|x| (0..=across).map(move |y| (x, y)));
    // After a whole turn the band has made half a one.
    TriMesh::new(
        columns
            .map(|(x, y)| {
                let t = f64::from(x) / f64::from(around);
                let ((cos, sin), (half_cos, half_sin)) = (turn(t), turn(0.5 * t));
                let off = 0.6 * (f64::from(y) / f64::from(across) - 0.5);
                let reach = 1.0 + off * half_cos;
                [reach * cos, reach * sin, off * half_sin].map(|c| c as f32)
            })
            .collect(),
        quads(around, across, |x: u32, y: u32| if x < around { x * (across + 1) + y } else { across - y })
            .collect(),
    )
}

pub(super) fn klein(triangles: u32) -> TriMesh {
    hand::klein_bottle(side(triangles))
}

pub(super) fn crossing(triangles: u32) -> TriMesh {
    let mut mesh = Synth::new(Shape::Sphere, u64::from(triangles / 2), 0).to_mesh();
    let count = mesh.positions.len();
    let second = mesh.triangles.clone();
    mesh.positions.extend_from_within(..);
    // No vertex of one lies on a vertex of the other.
    mesh.positions[count..].iter_mut().for_each(|p| *p = [p[0] + 0.613, p[1] + 0.271, p[2] - 0.137]);
    mesh.triangles.extend(second.iter().map(|t| t.map(|v| v + count as u32)));
    mesh
}

pub(super) fn spikes(triangles: u32) -> TriMesh {
    let mut mesh = Synth::new(Shape::Sphere, u64::from(triangles), 0).to_mesh();
    for (p, v) in mesh.positions.iter_mut().zip(0..) {
        if hash(11, [v, 0, 0]).is_multiple_of(100) {
            *p = p.map(|x| 10.0 * x);
        }
    }
    mesh
}
