//! Small meshes with known answers, for tests: well-behaved ones first, then every way in which a mesh can be odd.
//!
//! Closed orientable ones are wound counter-clockwise seen from outside. Sizes below the least that makes sense are
//! raised to it.

use super::noise::turn;
use chpm_mesh::TriMesh;
use std::collections::BTreeMap;

/// Four vertices, four faces: the least closed surface.
pub fn tetrahedron() -> TriMesh {
    TriMesh::new(
        vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    )
}

/// The unit cube: 8 vertices, 12 triangles.
pub fn cube() -> TriMesh {
    let positions = (0..8u8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(f32::from)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    TriMesh::new(positions, quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// An open plane of `nx` by `ny` unit quads at z = 0, two triangles each; row by row.
pub fn grid(nx: u32, ny: u32) -> TriMesh {
    let positions = (0..=ny).flat_map(|y| (0..=nx).map(move |x| [x as f32, y as f32, 0.0])).collect();
    let row = nx + 1;
    fn quad(x: u32, y: u32, row: u32) -> [[u32; 3]; 2] {
        let a = y * row + x;
        [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]
    }
    let triangles = (0..ny).flat_map(|y| (0..nx).flat_map(move |x| quad(x, y, row))).collect();
    TriMesh::new(positions, triangles)
}

/// A flat disc of `n >= 3` triangles about vertex 0.
pub fn fan(n: u32) -> TriMesh {
    let n = n.max(3);
    let rim = (0..n).map(|i| circle(i, n, 1.0, 0.0));
    let positions = std::iter::once([0.0; 3]).chain(rim).collect();
    TriMesh::new(positions, (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect())
}

/// A flat zigzag strip of `n` triangles over `n + 2` vertices.
pub fn strip(n: u32) -> TriMesh {
    let positions = (0..n + 2).map(|i| [(i / 2) as f32, (i % 2) as f32, 0.0]).collect();
    TriMesh::new(
        positions,
        (0..n).map(|i| if i.is_multiple_of(2) { [i, i + 2, i + 1] } else { [i, i + 1, i + 2] }).collect(),
    )
}

/// A ball of `20 * 4^level` triangles: an icosahedron, subdivided onto the unit sphere.
///
/// ```
/// let sphere = chpm_synth::hand::icosphere(2);
/// assert_eq!(sphere.triangles.len(), 20 * 4 * 4);
/// ```
pub fn icosphere(level: u32) -> TriMesh {
    let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let corners = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];

    let mut points: Vec<[f64; 3]> = corners.map(unit).to_vec();
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];

    for _ in 0..level {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let [p, q] = [points[a as usize], points[b as usize]];
                points.push(unit(std::array::from_fn(|i| p[i] + q[i])));
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [x, y, z] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, x, z], [x, b, y], [z, y, c], [x, y, z]]
            })
            .collect();
    }
    TriMesh::new(points.iter().map(|p| p.map(|x| x as f32)).collect(), triangles)
}

/// Two triangles that share one vertex and nothing else.
pub fn bow_tie() -> TriMesh {
    TriMesh::new(
        vec![[0.0; 3], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0]],
        vec![[0, 1, 2], [0, 3, 4]],
    )
}

/// A Moebius band of `n >= 3` quads: one boundary loop, Euler characteristic 0, not orientable, so one of its edges
/// is walked the same way by both its faces.
pub fn moebius(n: u32) -> TriMesh {
    let n = n.max(3);
    fn point(i: u32, side: f64, n: u32) -> [f32; 3] {
        let (half_cos, half_sin) = turn(0.5 * f64::from(i) / f64::from(n));
        let [x, y, _] = circle_f64(i, n);
        let reach = 1.0 + 0.3 * side * half_cos;
        [reach * x, reach * y, 0.3 * side * half_sin].map(|c| c as f32)
    }
    let positions = (0..n).flat_map(|i| [point(i, -1.0, n), point(i, 1.0, n)]).collect();
    TriMesh::new(
        positions,
        (0..n)
            .flat_map(|i| {
                let (a, b) = (2 * i, 2 * i + 1);
                let (c, d) = if i + 1 < n { (a + 2, a + 3) } else { (1, 0) };
                [[a, c, b], [b, c, d]]
            })
            .collect(),
    )
}

/// A Klein bottle (the figure-eight one) of `n` by `n` quads, `n >= 3`: closed, Euler characteristic 0, not orientable.
pub fn klein_bottle(n: u32) -> TriMesh {
    let n = n.max(3);
    let positions = (0..n).flat_map(|i| (0..n).map(move |j| point(i, j, n))).collect();
    // After a whole turn the figure eight has made half a one, which sends angle j to -j.
    fn vertex(i: u32, j: u32, n: u32) -> u32 {
        if i < n { i * n + j % n } else { (n - j % n) % n }
    }
    fn quad(i: u32, j: u32, n: u32) -> [[u32; 3]; 2] {
        let [a, b, c, d] =
            [vertex(i, j, n), vertex(i + 1, j, n), vertex(i + 1, j + 1, n), vertex(i, j + 1, n)];
        [[a, b, c], [a, c, d]]
    }
    let triangles = (0..n).flat_map(|i| (0..n).flat_map(move |j| quad(i, j, n))).collect();
    TriMesh::new(positions, triangles)
}

fn point(i: u32, j: u32, n: u32) -> [f32; 3] {
    let (half_cos, half_sin) = turn(0.5 * f64::from(i) / f64::from(n));
    let [x, y, _] = circle_f64(i, n);
    let t = f64::from(j) / f64::from(n);
    let (s1, s2) = (turn(t).1, turn(2.0 * t).1);
    let reach = 2.0 + half_cos * s1 - half_sin * s2;
    [reach * x, reach * y, half_sin * s1 + half_cos * s2].map(|c| c as f32)
}

/// Two unit cubes that share the two vertices of one edge, which so has four faces.
pub fn two_cubes_sharing_an_edge() -> TriMesh {
    let mut mesh = cube();
    // The second cube is the first one moved by (1, 1, 0): its edge at x = y = 0 is the first one's at x = y = 1.
    let second: Vec<u32> = (0..8u32)
        .map(|i| match i {
            0 => 3,
            4 => 7,
            _ => {
                let [x, y, z] = mesh.positions[i as usize];
                mesh.positions.push([x + 1.0, y + 1.0, z]);
                mesh.positions.len() as u32 - 1
            }
        })
        .collect();
    mesh.triangles.extend(cube().triangles.iter().map(|t| t.map(|v| second[v as usize])));
    mesh
}

/// A triangle and, last, a vertex that no triangle uses.
pub fn isolated_vertex() -> TriMesh {
    TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 5.0, 5.0]], vec![[0, 1, 2]])
}

/// A quad whose first triangle is there twice, the second time starting at another corner.
pub fn duplicate_faces() -> TriMesh {
    let mut mesh = grid(1, 1);
    let [a, b, c] = mesh.triangles[0];
    mesh.triangles.push([b, c, a]);
    mesh
}

/// A quad whose two triangles are wound in opposite senses.
pub fn mixed_winding() -> TriMesh {
    let mut mesh = grid(1, 1);
    mesh.triangles[1].swap(1, 2);
    mesh
}

/// `n` triangles side by side that share no vertex.
pub fn soup(n: u32) -> TriMesh {
    TriMesh::new(
        (0..n)
            .flat_map(|i| {
                let x = 2.0 * i as f32;
                [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]]
            })
            .collect(),
        (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
    )
}

/// `k` triangles about the one edge between vertices 0 and 1, like pages of an open book.
pub fn edge_fan(k: u32) -> TriMesh {
    let pages = (0..k).map(|i| circle(i, k, 1.0, 0.5));
    let positions = [[0.0; 3], [0.0, 0.0, 1.0]].into_iter().chain(pages).collect();
    TriMesh::new(positions, (0..k).map(|i| [0, 1, 2 + i]).collect())
}

fn circle_f64(i: u32, n: u32) -> [f64; 3] {
    let (cos, sin) = turn(f64::from(i) / f64::from(n));
    [cos, sin, 0.0]
}

fn circle(i: u32, n: u32, radius: f32, z: f32) -> [f32; 3] {
    let [x, y, _] = circle_f64(i, n).map(|c| c as f32);
    [radius * x, radius * y, z]
}

fn unit(p: [f64; 3]) -> [f64; 3] {
    let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
    p.map(|x| x / length)
}
