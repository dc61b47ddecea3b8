//! Hard for their quadrics, which have no single minimum, and for their triangles, which have almost no area.

use super::sheet::{quads, sheet, side};
use crate::hand;
use crate::noise::{hash, turn, value2, wave};
use chpm_mesh::TriMesh;

/// Multiples of a quarter at heights of `(x + 2 y) / 4` are exact in f32.
pub(super) fn plane(triangles: u32) -> TriMesh {
    let n = side(triangles);
    sheet(n, n, |x, y| {
        let inside = (1..n).contains(&x) && (1..n).contains(&y);
        let [shift_x, shift_y] = [0, 1]
            .map(|axis| if inside && hash(1, [x.into(), y.into(), axis]) & 1 == 1 { 0.25 } else { 0.0 });
        let (x, y) = (x as f32 + shift_x, y as f32 + shift_y);
        [x, y, 0.25 * x + 0.5 * y]
    })
}

/// Every ring has the same bits in x and y.
pub(super) fn cylinder(triangles: u32) -> TriMesh {
    let around = side(triangles).max(3);
    let along = (triangles / (2 * around)).max(1);
    let rings = (0..=along).flat_map(|y| (0..around).map(move |x| (x, y)));
    TriMesh::new(
        rings
            .map(|(x, y)| {
                let (cos, sin) = turn(f64::from(x) / f64::from(around));
                [cos as f32, sin as f32, y as f32 / 64.0]
            })
            .collect(),
        quads(around, along, |x, y| y * around + x % around).collect(),
    )
}

/// Whole multiples of (1, 2, 4), all different: column after column.
pub(super) fn line(triangles: u32) -> TriMesh {
    let n = side(triangles);
    sheet(n, n, |x, y| {
        let at = (x * (n + 1) + y) as f32;
        [at, 2.0 * at, 4.0 * at]
    })
}

pub(super) fn point(triangles: u32) -> TriMesh {
    let n = side(triangles);
    sheet(n, n, |_, _| [1.0, 2.0, 3.0])
}

/// Blocks of 3 by 3 at heights 0 to 3.
pub(super) fn ties(triangles: u32) -> TriMesh {
    let n = side(triangles);
    sheet(n, n, |x, y| {
        let height = hash(5, [i64::from(x / 3), i64::from(y / 3), 0]) % 4;
        [x as f32, y as f32, height as f32]
    })
}

pub(super) fn strip(triangles: u32) -> TriMesh {
    let mut mesh = hand::strip(triangles.max(1));
    mesh.positions.iter_mut().for_each(|p| p[2] = (4.0 * wave(f64::from(p[0]) / 64.0)) as f32);
    mesh
}

/// Layers of eight columns.
pub(super) fn folded(triangles: u32) -> TriMesh {
    const LAYER: u32 = 8;
    let n = side(triangles);
    sheet(n, n, |x, y| {
        let (layer, along) = (x / LAYER, x % LAYER);
        let along = if layer.is_multiple_of(2) { along } else { LAYER - along };
        [along as f32, y as f32, 0.0]
    })
}

/// Rows a millionth of a column apart, and rough by a tenth of that.
pub(super) fn needles(triangles: u32) -> TriMesh {
    let n = side(triangles);
    sheet(n, n, |x, y| {
        let wave = 0.25 * value2(2, [f64::from(x) / 4.0, 0.0]);
        let height = wave + 1e-7 * value2(3, [f64::from(x), f64::from(y)]);
        [x as f32, (1e-6 * f64::from(y)) as f32, height as f32]
    })
}

/// A cap stands on the lower side of every quad.
pub(super) fn caps(triangles: u32) -> TriMesh {
    let n = side(triangles / 2);
    let mut mesh = sheet(n, n, |x, y| [x as f32, y as f32, 0.0]);
    mesh.triangles.clear();
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            let [b, c, d, m] = [a + 1, a + n + 2, a + n + 1, mesh.positions.len() as u32];
            mesh.positions.push([x as f32 + 0.5, y as f32, 1e-6]);
            mesh.triangles.extend([[a, b, m], [m, b, c], [m, c, d], [m, d, a]]);
        }
    }
    mesh
}
