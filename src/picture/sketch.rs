//! A coarse mesh of triangles that come one by one, in little memory: something to look at while the model is built.
//!
//! Corners go to the first corner that came into their cell of a grid; triangles that keep three different ones stay. Where there are too many
//! cells, they are made twice as large.

use chpm_mesh::TriMesh;
use std::collections::{HashMap, HashSet};

/// Cells beyond which they are made larger.
const MOST: usize = 60_000;

type Cell = [i64; 3];

/// The triangles so far.
#[derive(Debug, Default)]
pub(crate) struct Sketch {
    /// Cells are counted from here; the first corner.
    origin: Option<[f64; 3]>,
    /// Width of a cell; 0 before a triangle with an extent came.
    width: f64,
    corners: HashMap<Cell, [f64; 3]>,
    triangles: HashSet<[Cell; 3]>,
}

impl Sketch {
    /// A triangle more. One that is nowhere is left out.
    pub(crate) fn push(&mut self, corners: [[f64; 3]; 3]) {
        if !corners.as_flattened().iter().all(|x| x.is_finite()) {
            return;
        }
        let origin = *self.origin.get_or_insert(corners[0]);
        let extents = [0, 1, 2].map(|axis| {
            let all = corners.map(|corner| corner[axis]);
            all.into_iter().fold(f64::MIN, f64::max) - all.into_iter().fold(f64::MAX, f64::min)
        });
        let longest = extents.into_iter().fold(0.0, f64::max);
        if self.width == 0.0 {
            self.width = longest;
        }
        if self.width == 0.0 {
            return;
        }

        // Far away in a fine grid, numbers would overflow.
        let far = corners.as_flattened().iter().zip(origin.iter().cycle());
        let far = far.map(|(x, o)| (x - o).abs()).fold(0.0, f64::max);
        while far / self.width > (1_i64 << 40) as f64 {
            self.coarsen();
        }

        let cells = corners
            .map(|corner| [0, 1, 2].map(|axis| ((corner[axis] - origin[axis]) / self.width).floor() as i64));
        if is_triangle(&cells) && self.triangles.insert(cells) {
            for (cell, corner) in cells.into_iter().zip(corners) {
                self.corners.entry(cell).or_insert(corner);
            }
        }
        while self.corners.len() > MOST {
            self.coarsen();
        }
    }

    fn coarsen(&mut self) {
        self.width *= 2.0;
        fn above(cell: Cell) -> [i64; 3] {
            cell.map(|x| x.div_euclid(2))
        }
        let mut corners: Vec<_> = std::mem::take(&mut self.corners).into_iter().collect();
        // Whatever order the map had.
        corners.sort_unstable_by_key(|(cell, _)| *cell);
        for (cell, corner) in corners {
            self.corners.entry(above(cell)).or_insert(corner);
        }
        let triangles = std::mem::take(&mut self.triangles).into_iter().map(|cells| cells.map(above));
        self.triangles = triangles.filter(is_triangle).collect();
    }

    /// The mesh; none if nothing of the triangles is left.
    pub(crate) fn finish(self) -> Option<TriMesh> {
        let mut triangles: Vec<_> = self.triangles.into_iter().collect();
        triangles.sort_unstable();
        let (mut numbers, mut positions) = (HashMap::new(), Vec::new());
        let indices = triangles.iter().map(|cells| {
            cells.map(|cell| {
                *numbers.entry(cell).or_insert_with(|| {
                    positions.push(self.corners[&cell].map(|x| x as f32));
                    positions.len() as u32 - 1
                })
            })
        });
        let indices: Vec<[u32; 3]> = indices.collect();
        (!indices.is_empty()).then(|| TriMesh::new(positions, indices))
    }
}

fn is_triangle([a, b, c]: &[Cell; 3]) -> bool {
    a != b && b != c && c != a
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_synth::{Shape, Synth};

    fn sketch(mesh: &TriMesh, shift: f64) -> Option<TriMesh> {
        let mut sketch = Sketch::default();
        for triangle in &mesh.triangles {
            sketch.push(triangle.map(|v| mesh.positions[v as usize].map(|x| f64::from(x) + shift)));
        }
        sketch.finish()
    }

    #[test]
    fn what_is_left_is_coarse_and_where_the_model_is() {
        let mesh = Synth::new(Shape::Isosurface, 300_000, 1).to_mesh();
        let coarse = sketch(&mesh, 0.0).expect("triangles");
        assert!(coarse.triangles.len() < mesh.triangles.len() / 2 && coarse.triangles.len() > 20_000);
        assert!(coarse.positions.len() <= MOST);
        let ends = |mesh: &TriMesh| {
            let axis = |a: usize| mesh.positions.iter().map(move |p| p[a]);
            [0, 1, 2].map(|a| (axis(a).fold(f32::MAX, f32::min), axis(a).fold(f32::MIN, f32::max)))
        };
        for ((low, high), (least, most)) in ends(&coarse).into_iter().zip(ends(&mesh)) {
            let near = 0.05 * (most - least);
            assert!((low - least).abs() < near && (high - most).abs() < near);
        }
        assert_eq!(coarse.triangles, sketch(&mesh, 0.0).expect("triangles").triangles, "the same again");
    }

    #[test]
    fn odd_sources_are_survived() {
        let few = Synth::new(Shape::Sphere, 200, 1).to_mesh();
        assert!(sketch(&few, 1e7).is_some());
        assert!(Sketch::default().finish().is_none());
        let mut points = Sketch::default();
        points.push([[1.0; 3]; 3]);
        points.push([[f64::NAN; 3], [0.0; 3], [1.0; 3]]);
        assert!(points.finish().is_none());
        // One that is large after many that are tiny.
        let mut sizes = Sketch::default();
        sizes.push([[0.0; 3], [1e-30, 0.0, 0.0], [0.0, 1e-30, 0.0]]);
        sizes.push([[0.0; 3], [1e30, 0.0, 0.0], [0.0, 1e30, 0.0]]);
        assert_eq!(sizes.finish().expect("the large one").triangles.len(), 1);
    }
}
