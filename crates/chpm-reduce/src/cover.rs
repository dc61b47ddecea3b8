//! Which triangles of the source each face of a mesh proves.

use chpm_mesh::Aabb;

/// Triangles of the source by the faces that prove them to be near the mesh: as long as all of these are there, so is the proof.
pub(crate) struct Cover {
    /// By face, in ascending order.
    of: Vec<Vec<u32>>,
}

impl Cover {
    pub(crate) fn new(faces: usize) -> Self {
        Cover { of: vec![Vec::new(); faces] }
    }

    /// Triangles that some of these faces prove, each once.
    pub(crate) fn under(&self, faces: impl Iterator<Item = u32>, found: &mut Vec<u32>) {
        found.clear();
        faces.for_each(|face| found.extend_from_slice(&self.of[face as usize]));
        found.sort_unstable();
        found.dedup();
    }

    /// A face proves nothing any more.
    pub(crate) fn clear(&mut self, face: u32) {
        self.of[face as usize] = Vec::new();
    }

    /// A face proves these triangles, too.
    pub(crate) fn add(&mut self, face: u32, triangles: impl Iterator<Item = u32>) {
        let all = &mut self.of[face as usize];
        let before = all.len();
        all.extend(triangles);
        if all.len() > before {
            all.sort_unstable();
            all.dedup();
        }
    }
}

/// The box that faces must meet which are near enough to a triangle.
pub(crate) fn grown(triangle: &[[f32; 3]; 3], reach: f64) -> Aabb {
    let mut grown = Aabb::of_points(triangle);
    for axis in 0..3 {
        grown.min[axis] = chpm_mesh::geom::round_down(f64::from(grown.min[axis]) - reach);
        grown.max[axis] = chpm_mesh::geom::round_up(f64::from(grown.max[axis]) + reach);
    }
    grown
}

pub(crate) fn meet(a: &Aabb, b: &Aabb) -> bool {
    (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis])
}
