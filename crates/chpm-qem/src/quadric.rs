//! Area-weighted quadrics in f64, each about its own vertex.
//!
//! Every plane of a vertex passes through it, so about that vertex a fresh quadric has no linear and no constant term and
//! nothing cancels, however far the model lies from the origin. Merging moves a quadric by one edge.

use nalgebra::Vector3;
use wide::f64x2;

/// Sum of weighted squared distances to planes, as a function of the offset from the quadric's own point.
///
/// ```
/// use chpm_qem::Quadric;
/// use nalgebra::Vector3;
///
/// // The plane z = 0, through the vertex itself.
/// let mut quadric = Quadric::default();
/// quadric.add_face(Vector3::z());
/// assert_eq!(quadric.at(Vector3::x()), 0.0);
/// assert!(quadric.at(Vector3::new(0.0, 0.0, 2.0)) > 0.0);
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Quadric {
    xx: f64,
    xy: f64,
    xz: f64,
    yy: f64,
    yz: f64,
    zz: f64,
    bx: f64,
    by: f64,
    bz: f64,
    constant: f64,
    /// Total area that the planes stand for; `sqrt(value / area)` is a length.
    pub area: f64,
}

impl Quadric {
    /// Adds a plane through the quadric's own point, given by `normal` (its length is ignored by dividing `weight` by
    /// the squared length beforehand).
    fn add_plane(&mut self, normal: Vector3<f64>, weight: f64) {
        let scaled = normal * weight;
        self.xx += scaled.x * normal.x;
        self.xy += scaled.x * normal.y;
        self.xz += scaled.x * normal.z;
        self.yy += scaled.y * normal.y;
        self.yz += scaled.y * normal.z;
        self.zz += scaled.z * normal.z;
    }

    /// Adds a face at this corner. `area_vector` is the cross product of two edges; a face without area adds nothing.
    pub fn add_face(&mut self, area_vector: Vector3<f64>) {
        self.add_planes(&Quadric::of_face(area_vector));
    }

    /// A face's part of the quadric of each of its corners.
    pub(crate) fn of_face(area_vector: Vector3<f64>) -> Self {
        let mut quadric = Quadric::default();
        let doubled_area = area_vector.norm();
        if doubled_area > 0.0 {
            quadric.add_plane(area_vector, 0.5 / doubled_area);
            quadric.area = 0.5 * doubled_area;
        }
        quadric
    }

    /// Adds planes through the quadric's own point.
    #[inline]
    pub(crate) fn add_planes(&mut self, other: &Quadric) {
        self.xx += other.xx;
        self.xy += other.xy;
        self.xz += other.xz;
        self.yy += other.yy;
        self.yz += other.yz;
        self.zz += other.zz;
        self.area += other.area;
    }

    /// Adds the plane that stands on a boundary edge, perpendicular to its face, with the edge's squared length as weight,
    /// so that the boundary curve keeps its shape. It holds the outline, not the surface, and adds no area.
    pub fn add_boundary(&mut self, edge: Vector3<f64>, area_vector: Vector3<f64>) {
        let normal = edge.cross(&area_vector);
        let squared = normal.norm_squared();
        if squared > 0.0 {
            self.add_plane(normal, edge.norm_squared() / squared);
        }
    }

    /// Value at an offset from the quadric's own point; never negative.
    #[inline]
    pub fn at(&self, d: Vector3<f64>) -> f64 {
        self.in_pairs().at([d.x, d.y, d.z].map(f64x2::splat)).to_array()[0]
    }

    /// The same for two offsets at a time.
    #[inline]
    pub(crate) fn in_pairs(&self) -> QuadricPairs {
        QuadricPairs {
            squares: [self.xx, self.xy, self.xz, self.yy, self.yz, self.zz].map(f64x2::splat),
            linear: [2.0 * self.bx, 2.0 * self.by, 2.0 * self.bz].map(f64x2::splat),
            constant: f64x2::splat(self.constant),
        }
    }

    /// Adds `other`, whose own point lies at `-offset` from this one's (so `offset` leads from the other's point to this).
    pub fn add_moved(&mut self, other: &Quadric, offset: Vector3<f64>) {
        let d = offset;
        let constant = other.at(d);
        self.bx += other.bx + other.xx * d.x + other.xy * d.y + other.xz * d.z;
        self.by += other.by + other.xy * d.x + other.yy * d.y + other.yz * d.z;
        self.bz += other.bz + other.xz * d.x + other.yz * d.y + other.zz * d.z;
        self.constant += constant;
        self.add_planes(other);
    }
}

/// A quadric for two offsets at a time.
pub(crate) struct QuadricPairs {
    squares: [f64x2; 6],
    linear: [f64x2; 3],
    constant: f64x2,
}

impl QuadricPairs {
    /// Values at two offsets, by coordinate; never negative.
    #[inline]
    pub(crate) fn at(&self, [x, y, z]: [f64x2; 3]) -> f64x2 {
        let ([xx, xy, xz, yy, yz, zz], [bx, by, bz]) = (self.squares, self.linear);
        let ax = xx * x + xy * y + xz * z;
        let ay = xy * x + yy * y + yz * z;
        let az = xz * x + yz * y + zz * z;
        let value = (ax + bx) * x + (ay + by) * y + (az + bz) * z + self.constant;
        value.fast_max(f64x2::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat() -> Quadric {
        let mut q = Quadric::default();
        q.add_face(Vector3::new(0.0, 0.0, 4.0)); // area 2 in the plane z = 0
        q
    }

    #[test]
    fn a_plane_measures_squared_distance_times_area() {
        let q = flat();
        assert_eq!(q.at(Vector3::new(5.0, -3.0, 0.0)), 0.0);
        assert_eq!(q.at(Vector3::new(0.0, 0.0, 3.0)), 18.0);
        assert_eq!(q.area, 2.0);
    }

    #[test]
    fn moving_a_quadric_keeps_its_values() {
        let mut source = flat();
        source.add_face(Vector3::new(1.0, 2.0, -0.5));
        let offset = Vector3::new(0.5, -1.0, 2.0);
        let mut moved = Quadric::default();
        moved.add_moved(&source, offset);
        for d in [Vector3::zeros(), Vector3::new(1.0, 2.0, 3.0), Vector3::new(-4.0, 0.0, 0.25)] {
            let (a, b) = (moved.at(d), source.at(d + offset));
            assert!((a - b).abs() <= 1e-12 * b.max(1.0), "{a} against {b}");
        }
    }

    #[test]
    fn degenerate_faces_and_edges_add_nothing() {
        let mut q = Quadric::default();
        q.add_face(Vector3::zeros());
        q.add_boundary(Vector3::zeros(), Vector3::new(0.0, 0.0, 1.0));
        assert_eq!(q.at(Vector3::new(1.0, 1.0, 1.0)), 0.0);
    }

    #[test]
    fn a_boundary_plane_holds_the_outline() {
        let mut q = Quadric::default();
        q.add_boundary(Vector3::new(2.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 1.0));
        assert_eq!(q.at(Vector3::new(7.0, 0.0, 1.0)), 0.0); // along the edge and up: still on the plane
        assert_eq!(q.at(Vector3::new(0.0, 3.0, 0.0)), 36.0); // away from the outline: 4 * 9
    }
}
