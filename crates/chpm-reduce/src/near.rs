//! Faces near a change, and proofs that triangles of the source are within a distance of them.

use chpm_measure::box_tree::squared_distance_to_box;
use chpm_measure::bvh::squared_distance;
use chpm_mesh::Aabb;
use nalgebra::Point3;

/// Halvings of a triangle after which it is left to others to prove.
const DEEPEST: u32 = 6;

/// Some faces of a mesh.
#[derive(Default)]
pub(crate) struct Near {
    faces: Vec<u32>,
    corners: Vec<[[f32; 3]; 3]>,
    boxes: Vec<Aabb>,
    /// Place of the face that was nearest last.
    last: usize,
    stack: Vec<([Point3<f64>; 3], u32)>,
}

/// Answer for one triangle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Answer {
    /// All of it is within the distance.
    Within,
    /// Its middle, or that of a part, is not.
    Beyond,
    /// Too many parts would have to be looked at.
    Unknown,
}

impl Near {
    pub(crate) fn clear(&mut self) {
        self.faces.clear();
        self.corners.clear();
        self.boxes.clear();
        self.last = 0;
    }

    pub(crate) fn push(&mut self, face: u32, corners: [[f32; 3]; 3]) {
        self.faces.push(face);
        self.corners.push(corners);
        self.boxes.push(Aabb::of_points(&corners));
    }

    pub(crate) fn corners(&self) -> &[[[f32; 3]; 3]] {
        &self.corners
    }

    pub(crate) fn faces(&self) -> &[u32] {
        &self.faces
    }

    /// Whether a triangle is within the root of `most` of these faces. Calls `used` with the numbers of faces that it is near to, in `faces`.
    pub(crate) fn proves(
        &mut self,
        triangle: [Point3<f64>; 3],
        most: f64,
        pieces: &mut u64,
        mut used: impl FnMut(usize),
    ) -> Answer {
        self.stack.clear();
        self.stack.push((triangle, 0));
        while let Some((piece, depth)) = self.stack.pop() {
            *pieces += 1;
            let middle = Point3::from((piece[0].coords + piece[1].coords + piece[2].coords) / 3.0);
            let Some(face) = self.nearest(middle, most) else { return Answer::Beyond };
            // The distance to one face is convex: near at the corners is near everywhere.
            if piece.iter().all(|corner| squared_distance(*corner, self.corners[face]) <= most) {
                used(face);
                continue;
            }
            if depth == DEEPEST {
                return Answer::Unknown;
            }
            let length = |i: usize| (piece[(i + 1) % 3] - piece[i]).norm_squared();
            let longest = (0..3).fold(0, |best, i| if length(i) > length(best) { i } else { best });
            let [a, b, c] = [0, 1, 2].map(|i| piece[(longest + i) % 3]);
            let between = nalgebra::center(&a, &b);
            self.stack.push(([a, between, c], depth + 1));
            self.stack.push(([between, b, c], depth + 1));
        }
        Answer::Within
    }

    /// The nearest face within the root of `most`.
    fn nearest(&mut self, point: Point3<f64>, most: f64) -> Option<usize> {
        let mut best = most;
        let mut found = None;
        let last = self.last;
        let others = (0..self.corners.len()).filter(|face| *face != last);
        for face in std::iter::once(last).chain(others) {
            let Some(bounds) = self.boxes.get(face) else { continue };
            if squared_distance_to_box(point, bounds) > best {
                continue;
            }
            let square = squared_distance(point, self.corners[face]);
            if square < best || (found.is_none() && square <= best) {
                (best, found) = (square, Some(face));
            }
        }
        self.last = found.unwrap_or(last);
        found
    }
}
