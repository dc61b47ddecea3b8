//! Hard for their connections: surfaces upon surfaces, edges of many faces, vertices of many fans or of one large one.

use super::sheet::{one_step, quads, sheet, side};
use crate::hand;
use crate::noise::{hash, turn, value2, wave};
use crate::{Shape, Synth};
use chpm_mesh::TriMesh;

pub(super) fn sheets(triangles: u32) -> TriMesh {
    let one = Synth::new(Shape::Terrain, u64::from(triangles / 4), 1).to_mesh();
    let count = one.positions.len() as u32;
    let mut mesh = TriMesh::default();
    for copy in 0..4u32 {
        mesh.positions.extend(one.positions.iter().map(|&[x, y, z]| match copy {
            0 | 1 => [x, y, z],
            2 => [x, y, one_step(z)],
            _ => [x, y, z + 1e-6],
        }));
        let over = !copy.is_multiple_of(2);
        fn turned(&[a, b, c]: &[u32; 3], over: bool) -> [u32; 3] {
            if over { [a, c, b] } else { [a, b, c] }
        }
        mesh.triangles.extend(one.triangles.iter().map(|t| turned(t, over).map(|v| v + copy * count)));
    }
    mesh
}

pub(super) fn doubled(triangles: u32) -> TriMesh {
    let mut mesh = Synth::new(Shape::Terrain, u64::from(triangles / 2), 1).to_mesh();
    let turned: Vec<[u32; 3]> = mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    mesh.triangles.extend(turned);
    mesh
}

pub(super) fn winding(triangles: u32) -> TriMesh {
    let mut mesh = Synth::new(Shape::Isosurface, u64::from(triangles), 1).to_mesh();
    for (triangle, number) in mesh.triangles.iter_mut().zip(0..) {
        if hash(9, [number, 0, 0]) & 1 == 1 {
            triangle.swap(1, 2);
        }
    }
    mesh
}

/// Quads whose column and row have an even sum.
pub(super) fn bow_ties(triangles: u32) -> TriMesh {
    let n = side(2 * triangles);
    let mesh = sheet(n, n, |x, y| {
        let height = 2.0 * value2(4, [f64::from(x) / 16.0, f64::from(y) / 16.0]);
        [x as f32, y as f32, height as f32]
    });
    let quads = mesh.triangles.chunks(2).zip(0..);
    let black = quads.filter(|(_, quad)| (quad % n + quad / n).is_multiple_of(2));
    let black: Vec<[u32; 3]> = black.flat_map(|(two, _)| two.iter().copied()).collect();
    // A corner of the board may belong to a white square alone.
    compact(TriMesh::new(mesh.vertices.positions, black))
}

/// The mesh without vertices that no triangle uses.
fn compact(mesh: TriMesh) -> TriMesh {
    let mut new = vec![u32::MAX; mesh.positions.len()];
    let mut positions = Vec::new();
    for v in mesh.triangles.as_flattened() {
        let new = &mut new[*v as usize];
        if *new == u32::MAX {
            *new = positions.len() as u32;
            positions.push(mesh.positions[*v as usize]);
        }
    }
    TriMesh::new(positions, mesh.triangles.iter().map(|t| t.map(|v| new[v as usize])).collect())
}

/// Books in a row, their spines along z; pages of `deep` by `high` quads.
pub(super) fn pages(triangles: u32) -> TriMesh {
    const PAGES: u32 = 48 * 53 / 2;
    let wanted = f64::from(triangles) / f64::from(2 * PAGES);
    let deep = ((wanted / 4.0).sqrt().round() as u32).max(1);
    let high = ((wanted / f64::from(deep)).round() as u32).max(1);

    let mut mesh = TriMesh::default();
    for faces in 3..=50u32 {
        let spine = mesh.positions.len() as u32;
        let x = f64::from(3 * faces);
        fn steps(n: u32) -> f64 {
            1.0 / f64::from(n)
        }
        fn height(i: u32, high: u32) -> f64 {
            4.0 * steps(high) * f64::from(i)
        }
        mesh.positions.extend((0..=high).map(|i| [x, 0.0, height(i, high)].map(|c| c as f32)));

        for page in 0..faces {
            let (cos, sin) = turn(f64::from(page) / f64::from(faces));
            let first = mesh.positions.len() as u32;
            for along in 1..=deep {
                let reach = steps(deep) * f64::from(along);
                let bent = 0.05 * wave(reach);
                let place = [x + reach * cos - bent * sin, reach * sin + bent * cos];
                let column = (0..=high).map(|i| [place[0], place[1], height(i, high)].map(|c| c as f32));
                mesh.positions.extend(column);
            }

            mesh.triangles.extend(quads(deep, high, |along: u32, i: u32| match along {
                0 => spine + i,
                _ => first + (along - 1) * (high + 1) + i,
            }));
        }
    }
    mesh
}

/// A block of cubes that have their corners in common, each with twelve triangles of its own: between two cubes every triangle is there twice.
pub(super) fn cubes(triangles: u32) -> TriMesh {
    let n = libm::cbrt(f64::from(triangles) / 12.0).round().max(1.0) as u32;
    let high = (f64::from(triangles) / f64::from(12 * n * n)).round().max(1.0) as u32;
    faces_of_cells([n, n, high], |_, _| true)
}

/// Cells of a lattice that are full or not, by chance: their hull touches itself along edges and at corners.
pub(super) fn voxels(triangles: u32) -> TriMesh {
    let n = libm::cbrt(f64::from(triangles) / 3.0).round().max(2.0) as u32;
    fn is_full(cell: [i64; 3], n: u32) -> bool {
        cell.iter().all(|c| (0..i64::from(n)).contains(c)) && hash(5, cell) & 1 == 1
    }
    compact(faces_of_cells([n; 3], |cell, next| is_full(cell, n) && !is_full(next, n)))
}

/// The faces of a block of cells, of two triangles each, looking from a cell to the next one, where they are wanted.
fn faces_of_cells(size: [u32; 3], wanted: impl Fn([i64; 3], [i64; 3]) -> bool) -> TriMesh {
    let [w, h, d] = size;
    let corners = (0..=d).flat_map(|z| (0..=h).flat_map(move |y| (0..=w).map(move |x| [x, y, z])));
    let at = |[x, y, z]: [u32; 3]| (z * (h + 1) + y) * (w + 1) + x;

    let mut mesh = TriMesh::new(corners.map(|corner| corner.map(|c| c as f32)).collect(), Vec::new());
    for cell in (0..d).flat_map(|z| (0..h).flat_map(move |y| (0..w).map(move |x| [x, y, z]))) {
        for (axis, side) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)] {
            let mut next = cell.map(i64::from);
            next[axis] += if side == 1 { 1 } else { -1 };
            if !wanted(cell.map(i64::from), next) {
                continue;
            }

            let [a, b, c, e] = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[along, up]| {
                let mut corner = cell;
                corner[axis] += side;
                corner[(axis + 1) % 3] += along;
                corner[(axis + 2) % 3] += up;
                at(corner)
            });
            let two = if side == 1 { [[a, b, c], [a, c, e]] } else { [[a, c, b], [a, e, c]] };
            mesh.triangles.extend(two);
        }
    }
    mesh
}

pub(super) fn fan(triangles: u32) -> TriMesh {
    let mut mesh = hand::fan(triangles);
    let count = f64::from(triangles.max(3));
    for (p, i) in mesh.positions.iter_mut().zip(0..).skip(1) {
        p[2] = (0.1 * wave(7.0 * f64::from(i) / count)) as f32;
    }
    mesh
}

/// Four times as many meridians as parallels.
pub(super) fn poles(triangles: u32) -> TriMesh {
    let across = (side(triangles) / 2).max(2);
    let around = (triangles / (2 * across)).max(3);
    let mut mesh = TriMesh::new(vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], Vec::new());
    for y in 1..=across {
        let (up, out) = turn(0.5 * f64::from(y) / f64::from(across + 1));
        for x in 0..around {
            let (cos, sin) = turn(f64::from(x) / f64::from(around));
            mesh.positions.push([out * cos, out * sin, up].map(|c| c as f32));
        }
    }
    let at = |x: u32, y: u32| 2 + y * around + x % around;
    mesh.triangles.extend((0..around).map(|x| [0, at(x, 0), at(x + 1, 0)]));
    // Parallels go down, so that columns and rows are changed over to look outward.
    mesh.triangles.extend(quads(around, across - 1, at).map(|[a, b, c]| [a, c, b]));
    mesh.triangles.extend((0..around).map(|x| [1, at(x + 1, across - 1), at(x, across - 1)]));
    mesh
}
