//! Normals of the vertices, where they are computed: the sum of the normals of all faces about a vertex, each by the face's area and the
//! angle that it has there.
//!
//! A region knows all faces about its inner vertices. About a border vertex several regions have some: each says what its own come to,
//! and the collector adds that up, region by region. So every sum has one order, whoever was first.

use super::load::INNER;
use super::region::Mesh;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::Octahedral;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Faces whose normals come to less than this share of their lengths cancel out: what is left is rounding.
const LOST: f64 = 1.0 / (1u64 << 40) as f64;

/// Sum of the normals of some faces about a vertex.
#[derive(Clone, Copy, PartialEq, Debug, Default, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub(crate) struct Sum {
    vector: [f64; 3],
    /// How long it would be if all had one direction.
    length: f64,
}

/// Sum of the normals of one region's faces about a border vertex.
#[derive(Clone, Copy, Debug, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub(crate) struct BorderSum {
    sum: Sum,
    pub(crate) border: u64,
}

impl Sum {
    pub(crate) fn add(&mut self, other: &Sum) {
        (0..3).for_each(|axis| self.vector[axis] += other.vector[axis]);
        self.length += other.length;
    }

    fn add_face(&mut self, area: &Vector3<f64>, twice: f64, angle: f64) {
        self.add(&Sum { vector: (area * angle).into(), length: twice * angle });
    }

    /// The direction; none where there is no area, or where faces cancel out.
    pub(crate) fn normal(&self) -> Octahedral {
        if Vector3::from(self.vector).norm() > LOST * self.length {
            Octahedral::of(self.vector)
        } else {
            Octahedral::NONE
        }
    }
}

/// Sums of the faces' normals, by vertex, in the order of the faces.
fn sums(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<Sum> {
    let mut sums = vec![Sum::default(); positions.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|v| Vector3::from(positions[v as usize].map(f64::from)));
        let (ab, bc, ca) = (b - a, c - b, a - c);
        let area = bc.cross(&ca);
        let twice = area.norm();
        if twice > 0.0 {
            let cosines = [-ca.dot(&ab), -ab.dot(&bc), -bc.dot(&ca)];
            for (vertex, cosine) in corners.iter().zip(cosines) {
                sums[*vertex as usize].add_face(&area, twice, libm::atan2(twice, cosine));
            }
        }
    }
    sums
}

/// Gives the vertices of a region their normals, those of the border none yet, and answers what its faces come to there.
pub(super) fn compute(mesh: &mut Mesh) -> Vec<BorderSum> {
    let sums = sums(&mesh.vertices.positions, &mesh.triangles);
    fn is_inner((sum, border): (&Sum, &u32)) -> Octahedral {
        if *border == INNER { sum.normal() } else { Octahedral::NONE }
    }
    mesh.vertices.octahedral = sums.iter().zip(&mesh.border).map(is_inner).collect();
    let at_border = sums.iter().zip(&mesh.border).filter(|(_, border)| **border != INNER);
    at_border.map(|(sum, border)| BorderSum { sum: *sum, border: u64::from(*border) }).collect()
}

/// The normals of the border vertices `first..first + count`, of which `sums` has what each region said, in the order of the regions.
pub(super) fn of_border(first: u64, count: usize, sums: &[BorderSum]) -> impl Iterator<Item = Octahedral> {
    let mut all = vec![Sum::default(); count];
    sums.iter().for_each(|part| all[(part.border - first) as usize].add(&part.sum));
    all.into_iter().map(|sum| sum.normal())
}
