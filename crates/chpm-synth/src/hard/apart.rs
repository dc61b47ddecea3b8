//! Hard for their pieces: many, tiny, unconnected, or one that is larger than all others together.

use super::sheet::one_step;
use crate::hand;
use crate::noise::{hash, unit};
use crate::{Shape, Synth};
use chpm_mesh::TriMesh;

/// A number in [0, 1) for part `part` of piece `piece`.
fn chance(piece: u32, part: i64) -> f64 {
    unit(hash(7, [piece.into(), part, 0]))
}

/// As large as their mean distance.
pub(super) fn soup(triangles: u32) -> TriMesh {
    let size = 1.0 / libm::cbrt(f64::from(triangles.max(1)));
    let positions = (0..triangles.max(1)).flat_map(|t| (0..3).map(move |k| (t, k)));
    let positions = positions.map(|(t, k)| corner(t, k, size)).collect();
    TriMesh::new(positions, (0..triangles.max(1)).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect())
}

fn corner(t: u32, k: i64, size: f64) -> [f32; 3] {
    [0, 1, 2].map(|axis| (chance(t, axis) + size * (chance(t, 3 + 3 * k + axis) - 0.5)) as f32)
}

/// In a cube of cells of side 1; sizes fall with the square of chance, from 0.5 down to 0.0005.
pub(super) fn components(triangles: u32) -> TriMesh {
    let count = (triangles / 4).max(1);
    let row = (libm::cbrt(f64::from(count)).ceil() as u32).max(1);
    let piece = hand::tetrahedron();
    let mut mesh = TriMesh::default();
    for i in 0..count {
        let size = (0.5 * chance(i, 0) * chance(i, 0)).max(0.0005) as f32;
        let cell = [i % row, i / row % row, i / row / row].map(|c| c as f32);
        mesh.positions.extend(piece.positions.iter().map(|p| [0, 1, 2].map(|a| cell[a] + size * p[a])));
        mesh.triangles.extend(piece.triangles.iter().map(|t| t.map(|v| v + 4 * i)));
    }
    mesh
}

pub(super) fn unwelded(triangles: u32) -> TriMesh {
    let ball = Synth::new(Shape::Sphere, u64::from(triangles), 0).to_mesh();
    let corners = ball.triangles.iter().flatten().zip(0..);
    let positions = corners.map(|(v, corner)| moved(corner, ball.positions[*v as usize])).collect();
    TriMesh::new(positions, (0..ball.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect())
}

fn moved(corner: u32, p: [f32; 3]) -> [f32; 3] {
    match hash(3, [corner.into(), 0, 0]) % 3 {
        0 => p,
        1 => p.map(one_step),
        _ => p.map(|x| x + 1e-6),
    }
}

pub(super) fn giant(triangles: u32) -> TriMesh {
    let mut mesh = Synth::new(Shape::Terrain, u64::from(triangles), 1).to_mesh();
    let first = mesh.positions.len() as u32;
    mesh.positions.extend([[-1e6, -1e6, 0.0], [1e6, -1e6, 1e6]]);
    mesh.triangles.push([0, first, first + 1]);
    mesh
}
