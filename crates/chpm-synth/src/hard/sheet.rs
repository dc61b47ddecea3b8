//! Rectangles of quads with any places for their vertices.

use chpm_mesh::TriMesh;

/// The side of a square of quads with about `triangles`.
pub(super) fn side(triangles: u32) -> u32 {
    (f64::from(triangles) / 2.0).sqrt().round().max(2.0) as u32
}

/// An open sheet of `nx` by `ny` quads, row by row, looking up where `place` maps columns to x and rows to y.
pub(super) fn sheet(nx: u32, ny: u32, place: impl Fn(u32, u32) -> [f32; 3]) -> TriMesh {
    let positions = (0..=ny).flat_map(|y| (0..=nx).map(move |x| (x, y))).map(|(x, y)| place(x, y)).collect();
    TriMesh::new(positions, quads(nx, ny, |x, y| y * (nx + 1) + x).collect())
}

/// The triangles of `nx` by `ny` quads over the vertices that `at` names.
pub(super) fn quads(nx: u32, ny: u32, at: impl Fn(u32, u32) -> u32) -> impl Iterator<Item = [u32; 3]> {
    (0..ny).flat_map(move |y| (0..nx).map(move |x| (x, y))).flat_map(move |(x, y)| {
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
        [[a, b, c], [a, c, d]]
    })
}

/// The next f32 away from zero.
pub(super) fn one_step(x: f32) -> f32 {
    f32::from_bits(x.to_bits() + 1)
}
