//! Hard for their numbers: far, small, large, and of every size at once.

use super::sheet::{quads, sheet, side};
use crate::noise::{turn, value2};
use crate::{Shape, Synth};
use chpm_mesh::TriMesh;

fn scaled(shape: Shape, triangles: u32, by: f32) -> TriMesh {
    let mut mesh = Synth::new(shape, u64::from(triangles), 1).to_mesh();
    mesh.positions.as_flattened_mut().iter_mut().for_each(|x| *x *= by);
    mesh
}

pub(super) fn unit(triangles: u32) -> TriMesh {
    scaled(Shape::Terrain, triangles, 1.0)
}

pub(super) fn far(triangles: u32) -> TriMesh {
    let mut mesh = scaled(Shape::Sphere, triangles, 1000.0);
    mesh.positions.as_flattened_mut().iter_mut().for_each(|x| *x += 1e7);
    mesh
}

pub(super) fn tiny(triangles: u32) -> TriMesh {
    across(triangles, 1e-9)
}

pub(super) fn huge(triangles: u32) -> TriMesh {
    across(triangles, 1e9)
}

/// An isosurface whose longest side is `extent`.
fn across(triangles: u32, extent: f64) -> TriMesh {
    let mut mesh = scaled(Shape::Isosurface, triangles, 1.0);
    let bounds = chpm_mesh::Aabb::of_points(&mesh.positions);
    let longest = (0..3).map(|a| f64::from(bounds.max[a]) - f64::from(bounds.min[a])).fold(0.0, f64::max);
    let by = extent / longest;
    mesh.positions.as_flattened_mut().iter_mut().for_each(|x| *x = (by * f64::from(*x)) as f32);
    mesh
}

/// 40 octaves: a power of two times 1 to 2, so that no power function is asked for.
pub(super) fn orders(triangles: u32) -> TriMesh {
    const OCTAVES: u32 = 40;
    let around = (side(triangles) / 4).max(8);
    let along = (triangles / (2 * around)).max(OCTAVES);
    fn ring(y: u32, along: u32) -> f64 {
        let t = f64::from(OCTAVES) * f64::from(y) / f64::from(along);
        (1.0 + t.fract()) * 2.0_f64.powi(t.floor() as i32 - OCTAVES as i32 / 2)
    }
    fn place(x: u32, y: u32, around: u32, along: u32) -> [f32; 3] {
        let (cos, sin) = turn(f64::from(x) / f64::from(around));
        let (reach, wave) = (ring(y, along), value2(3, [f64::from(x), f64::from(y)]));
        let radius = (0.5 + 0.02 * wave) * reach;
        [radius * cos, radius * sin, reach].map(|c| c as f32)
    }
    let rings = (0..=along).flat_map(|y| (0..around).map(move |x| (x, y)));
    let positions = rings.map(|(x, y)| place(x, y, around, along)).collect();
    TriMesh::new(positions, quads(around, along, |x, y| y * around + x % around).collect())
}

pub(super) fn denormals(triangles: u32) -> TriMesh {
    scaled(Shape::Terrain, triangles, 1e-40)
}

/// The two halves share no vertex: -0.0 and 0.0 are equal numbers and different bits.
pub(super) fn zeros(triangles: u32) -> TriMesh {
    let n = side(triangles / 2);
    let mut mesh = half(1.0, n);
    let first = mesh.positions.len() as u32;
    let other = half(-1.0, n);
    mesh.positions.extend(other.vertices.positions);
    // Mirrored, so turned over to look up again.
    mesh.triangles.extend(other.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|v| v + first)));
    mesh
}

fn half(sign: f32, n: u32) -> TriMesh {
    sheet(n, n, move |x, y| {
        let height = if (x + y).is_multiple_of(2) { 0.0 } else { -0.0 };
        let rise = if x.is_multiple_of(7) && y.is_multiple_of(5) { 0.25 } else { height };
        [sign * x as f32, y as f32 - (n / 2) as f32, sign * rise]
    })
}
