//! Which triangles of the source each face of a mesh may have to be near to.

use chpm_measure::box_tree::BoxTree;
use chpm_mesh::Aabb;

/// Triangles of the source by the faces that they may be near to: all whose boxes, grown by the distance that is allowed, meet the face's box. A proof that
/// a triangle is near the mesh uses no other faces.
pub(crate) struct Cover<'a> {
    source: &'a [[[f32; 3]; 3]],
    reach: f64,
    /// By face, in ascending order.
    of: Vec<Vec<u32>>,
}

impl<'a> Cover<'a> {
    /// For the faces of these corners.
    pub(crate) fn new(source: &'a [[[f32; 3]; 3]], faces: &[[[f32; 3]; 3]], reach: f64) -> Self {
        let tree = BoxTree::of_triangles(faces);
        let boxes: Vec<Aabb> = faces.iter().map(Aabb::of_points).collect();
        let mut cover = Cover { source, reach, of: vec![Vec::new(); faces.len()] };
        for (number, triangle) in source.iter().enumerate() {
            let grown = cover.grown(triangle);
            let around = 0.5 * grown.diagonal();
            let mut squared = around * around * (1.0 + 1e-6);
            tree.search(grown.center(), &mut squared, |place, _| {
                let face = tree.order()[place] as usize;
                if meet(&grown, &boxes[face]) {
                    cover.of[face].push(number as u32);
                }
            });
        }
        cover
    }

    /// The box that faces must meet which are near enough to a triangle.
    fn grown(&self, triangle: &[[f32; 3]; 3]) -> Aabb {
        let mut grown = Aabb::of_points(triangle);
        for axis in 0..3 {
            grown.min[axis] = chpm_mesh::geom::round_down(f64::from(grown.min[axis]) - self.reach);
            grown.max[axis] = chpm_mesh::geom::round_up(f64::from(grown.max[axis]) + self.reach);
        }
        grown
    }

    /// Triangles that some of these faces may be near to, each once.
    pub(crate) fn under(&self, faces: impl Iterator<Item = u32>, found: &mut Vec<u32>) {
        found.clear();
        faces.for_each(|face| found.extend_from_slice(&self.of[face as usize]));
        found.sort_unstable();
        found.dedup();
    }

    /// Nothing is under a face any more.
    pub(crate) fn clear(&mut self, face: u32) {
        self.of[face as usize] = Vec::new();
    }

    /// Puts those of `triangles` under a face that it may be near to.
    pub(crate) fn add(&mut self, face: u32, corners: &[[f32; 3]; 3], triangles: &[u32]) {
        let own = Aabb::of_points(corners);
        let is_near = |t: &&u32| meet(&self.grown(&self.source[**t as usize]), &own);
        let known = &self.of[face as usize];
        let new: Vec<u32> =
            triangles.iter().filter(is_near).filter(|t| known.binary_search(t).is_err()).copied().collect();
        let all = &mut self.of[face as usize];
        all.extend(new);
        all.sort_unstable();
    }
}

fn meet(a: &Aabb, b: &Aabb) -> bool {
    (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis])
}
