//! Bounds: how wrong the mesh that a ray meets may be, from place to place.

use chpm_mesh::Aabb;

/// Error that is allowed in a group's box: `base + slope * (distance of the eye) + spread * (distance of the ray's origin)`, and no more than the ray's own
/// [`crate::Ray::cap`]. Each part is no larger for a box that holds another, so neither is the sum.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Bound {
    /// Everywhere; negative for leaves alone.
    pub base: f64,
    /// Point that pixels are seen from, relative to the file's origin.
    pub eye: [f64; 3],
    /// Error by distance from the eye.
    pub slope: f64,
    /// Error by distance from the ray's origin.
    pub spread: f64,
}

impl Bound {
    /// The source's own triangles.
    pub const LEAVES: Bound = Bound { base: -1.0, eye: [0.0; 3], slope: 0.0, spread: 0.0 };

    /// The same everywhere; 0 for meshes that are no worse than the leaves.
    pub fn within(error: f64) -> Self {
        Bound { base: error, ..Bound::LEAVES }
    }

    /// Growing with the distance from an eye, as what a pixel covers does.
    pub fn from_eye(eye: [f64; 3], slope: f64) -> Self {
        Bound { base: 0.0, eye, slope, spread: 0.0 }
    }

    /// Whether it is the same for all rays without a cap, so that they meet the same mesh.
    pub fn is_common(&self) -> bool {
        self.spread == 0.0
    }

    /// Whether it allows the leaves alone.
    pub fn is_leaves(&self) -> bool {
        self.base < 0.0 && self.slope == 0.0 && self.spread == 0.0
    }

    /// The error that a ray is allowed in a box.
    #[inline]
    pub(crate) fn allows(&self, bounds: &Aabb, origin: &[f64; 3], cap: f64) -> f64 {
        let mut allowed = self.base;
        if self.slope > 0.0 {
            allowed += self.slope * away(bounds, &self.eye);
        }
        if self.spread > 0.0 {
            allowed += self.spread * away(bounds, origin);
        }
        allowed.min(cap)
    }
}

/// The distance of a point from a box. Rounded sums and roots grow with what goes in, so boxes that nest keep their order.
fn away(Aabb { min, max }: &Aabb, point: &[f64; 3]) -> f64 {
    let beyond =
        |axis: usize| (f64::from(min[axis]) - point[axis]).max(point[axis] - f64::from(max[axis])).max(0.0);
    let [x, y, z] = [0, 1, 2].map(beyond);
    (x * x + y * y + z * z).sqrt()
}
