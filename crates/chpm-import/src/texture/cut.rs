//! Faces with texture coordinates as triangles.

use crate::polygon::Triangulator;
use chpm_texture::TexturedTriangle;

/// Cuts faces in the plane of their coordinates: where vertices are is not known yet.
#[derive(Default)]
pub(crate) struct Cutter {
    triangulator: Triangulator,
    places: Vec<[f64; 3]>,
    numbers: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

impl Cutter {
    /// Appends the triangles of a face with a coordinate for each corner.
    pub(crate) fn cut(
        &mut self,
        corners: &[u32],
        uv: &[[f32; 2]],
        material: u32,
        out: &mut Vec<TexturedTriangle>,
    ) {
        if let ([a, b, c], [p, q, r]) = (corners, uv) {
            out.push(TexturedTriangle { vertices: [*a, *b, *c], uv: [*p, *q, *r], material });
            return;
        }

        self.places.clear();
        self.places.extend(uv.iter().map(|[u, v]| [f64::from(*u), f64::from(*v), 0.0]));
        self.numbers.clear();
        self.numbers.extend(0..corners.len() as u32);
        self.triangles.clear();
        self.triangulator.cut(&self.numbers, &self.places, &mut self.triangles);
        out.extend(self.triangles.iter().map(|triangle| TexturedTriangle {
            vertices: triangle.map(|at| corners[at as usize]),
            uv: triangle.map(|at| uv[at as usize]),
            material,
        }));
    }
}
