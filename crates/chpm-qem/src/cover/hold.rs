//! Triangles of the reference, held against faces of the mesh.

use super::pieces::{Served, Surface};
use super::surfaces::{Few, Many, Seen, enough};
use super::tree::BoxTree;
use super::{CLOSE, Cover, FACES};
use chpm_mesh::geom::to_f64;
use nalgebra::Point3;

/// Faces that take its time if they are only looked at.
const LOOKED_AT: usize = 256;

/// Faces near the corners of a triangle, and for how many of these one was looked for, from `first` on: what is known of a point that was seen in this turn serves all of its triangles.
fn serve(
    vertices: [u32; 3],
    corners: &[Point3<f64>; 3],
    first: u32,
    (known, seen): (&mut [Served], &mut Seen),
    surface: &mut impl Surface,
) -> ([Served; 3], u64) {
    let mut found = 0;
    let served = [0, 1, 2].map(|corner| {
        let known = &mut known[vertices[corner] as usize];
        if seen.is_new(vertices[corner]) {
            let point = &corners[corner];
            let (face, squared) = surface.nearest(point, (first, surface.target(first).squared(point)));
            *known = (face, squared.sqrt());
            found += 1;
        }
        *known
    });
    (served, found)
}

impl Cover<'_> {
    /// Notes how far a triangle is from the mesh, and which faces it was held against.
    pub(super) fn take(&mut self, triangle: u32, far: f64, error: f32) {
        self.turns[triangle as usize] += 1;
        if far > f64::from(error) && self.is_left_behind(triangle) {
            self.holders[triangle as usize] = u32::MAX;
            return;
        }
        let turn = &self.turns[triangle as usize];
        for face in &self.pieces.used {
            let held = &mut self.held[*face as usize];
            if held.last() != Some(&(triangle, *turn)) {
                held.push((triangle, *turn));
            }
            self.holders[triangle as usize] = *face;
            self.holder = *face;
        }
        if far > f64::from(error) {
            self.pending.push(triangle);
        } else {
            self.reached = self.reached.max(far);
        }
    }

    /// Holds a triangle against the whole mesh, whose faces are in `tree`.
    pub(super) fn hold_first(&mut self, triangle: u32, tree: &BoxTree, error: f32) {
        let beyond = f64::from(self.reference.errors[triangle as usize]);
        let corners = self.corners(triangle);
        let mut far = self.hold_against(&corners, self.holder, beyond);
        if far == f64::INFINITY {
            let enough = enough(self.reached, beyond);
            let mut many = Many { targets: &self.targets, tree, search: &mut self.search, beyond, enough };
            let vertices = self.reference.triangles[triangle as usize];
            let known = (&mut self.served[..], &mut self.seen_points);
            let (served, _) = serve(vertices, &corners, self.holder, known, &mut many);
            far = self.pieces.reach(corners, served, self.reached, &mut many);
        }
        self.take(triangle, far, error);
    }

    /// Holds a triangle against faces near it.
    pub(super) fn hold(&mut self, triangle: u32, near: &[u32], error: f32) {
        let beyond = f64::from(self.reference.errors[triangle as usize]);
        let corners = self.corners(triangle);
        let mut far = f64::INFINITY;
        for face in [self.holders[triangle as usize], self.holder] {
            self.pieces.count += (near.len() / LOOKED_AT) as u64;
            if far == f64::INFINITY && near.contains(&face) {
                far = self.hold_against(&corners, face, beyond);
            }
        }
        if far == f64::INFINITY
            && let Some(first) = near.first()
        {
            let mut few = Few { targets: &self.targets, of: near, beyond };
            let vertices = self.reference.triangles[triangle as usize];
            let known = (&mut self.served[..], &mut self.seen_points);
            let (served, found) = serve(vertices, &corners, *first, known, &mut few);
            let before = self.pieces.count;
            far = self.pieces.reach(corners, served, self.reached, &mut few);
            // Each piece may have looked for the nearest of all.
            self.pieces.count += (found + self.pieces.count - before) * (near.len() / FACES) as u64;
        }
        if far > f64::from(error) && !self.is_left_behind(triangle) {
            far = self.hold_anywhere(triangle);
        }
        self.take(triangle, far, error);
    }

    /// Whether a triangle is of what was left behind.
    fn is_left_behind(&mut self, triangle: u32) -> bool {
        self.pieces.count += (self.balls.len() / LOOKED_AT) as u64;
        self.reference.is_left_behind(triangle, &self.balls)
    }

    /// Holds a triangle against any face.
    pub(super) fn hold_anywhere(&mut self, triangle: u32) -> f64 {
        let beyond = f64::from(self.reference.errors[triangle as usize]);
        let all: Vec<u32> = (0..self.targets.len() as u32).filter(|face| self.is_left(*face)).collect();
        let Some(&first) = all.first() else {
            self.pieces.used.clear();
            return f64::INFINITY;
        };
        let corners = self.corners(triangle);
        let mut few = Few { targets: &self.targets, of: &all, beyond };
        let served = corners.map(|point| {
            let (face, squared) = few.nearest(&point, (first, self.targets[first as usize].squared(&point)));
            (face, squared.sqrt())
        });
        let before = self.pieces.count;
        let far = self.pieces.reach(corners, served, self.reached, &mut few);
        // It is dear, and counts as what it takes.
        self.pieces.count += (3 + self.pieces.count - before) * (all.len() / (2 * FACES)) as u64;
        far
    }

    /// Holds a triangle against one face: how far it is if that is close; most are to a face that they, or the one before them, were held against.
    fn hold_against(&mut self, corners: &[Point3<f64>; 3], face: u32, beyond: f64) -> f64 {
        let close = CLOSE * self.reached - beyond;
        let target = &self.targets[face as usize];
        let squared = corners.iter().try_fold(0.0_f64, |most, corner| {
            let squared = target.squared(corner);
            (close >= 0.0 && squared <= close * close).then_some(most.max(squared))
        });
        let Some(squared) = squared else { return f64::INFINITY };
        self.pieces.count += 1;
        self.pieces.used.clear();
        self.pieces.used.push(face);
        squared.sqrt() + beyond
    }

    fn corners(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.reference.corners(triangle).map(to_f64)
    }
}
