//! Rays, and what they meet.

use chpm_mesh::{Aabb, ClusterId};
use std::array;

/// A ray, relative to the file's origin.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Ray {
    /// Where it begins.
    pub origin: [f64; 3],
    /// Where it goes; of any length but zero.
    pub direction: [f64; 3],
    /// How far it goes, in units of the model.
    pub reach: f64,
    /// Largest error that it allows, whatever the bound.
    pub cap: f64,
    /// Whether it begins at a vertex: triangles that have a corner at its origin are not met.
    pub is_from_vertex: bool,
}

impl Ray {
    /// A ray without an end.
    pub fn new(origin: [f64; 3], direction: [f64; 3]) -> Self {
        Ray { origin, direction, reach: f64::INFINITY, cap: f64::INFINITY, is_from_vertex: false }
    }

    /// Whether a direction has one, and all numbers are some.
    pub fn is_sound(&self) -> bool {
        let numbers = self.origin.iter().chain(&self.direction);
        numbers.copied().all(f64::is_finite) && unit(self.direction).is_some() && self.reach >= 0.0
    }
}

/// Kind of answer.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Seek {
    /// The first triangle that is met; of several at one distance the one of the least cluster and place.
    Nearest,
    /// Any, in an order that hangs on the file alone.
    Any,
    /// Not a hit, but how far the ray goes at least until it is within this distance of the mesh.
    Within(f64),
}

/// A triangle that is met.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Hit {
    /// From the ray's origin, in units of the model.
    pub distance: f64,
    /// Where, relative to the file's origin.
    pub point: [f64; 3],
    /// Of length 1, on the side that the corners turn left for; zero where the triangle has no area.
    pub normal: [f64; 3],
    /// The cluster.
    pub cluster: ClusterId,
    /// The triangle's place among those of the cluster's finest mesh.
    pub triangle: u32,
}

impl Hit {
    /// Whether it comes before another.
    #[inline]
    pub(crate) fn is_before(&self, distance: f64, cluster: u32, triangle: u32) -> bool {
        (self.distance, self.cluster.0, self.triangle) < (distance, cluster, triangle)
    }
}

/// A direction of length 1.
pub(crate) fn unit(direction: [f64; 3]) -> Option<[f64; 3]> {
    let largest = direction.iter().fold(0.0, |upper: f64, x| upper.max(x.abs()));
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let scaled = direction.map(|x| x / largest);
    let length = dot(scaled, scaled).sqrt();
    Some(scaled.map(|x| x / length))
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A ray made ready for boxes and triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ready {
    pub(crate) origin: [f64; 3],
    pub(crate) direction: [f64; 3],
    /// Axes: the one that the ray goes along most comes last.
    axes: [usize; 3],
    shear: [f64; 3],
    /// For boxes, from a point where it comes to the model's box.
    pub(crate) slabs: Slabs,
    corner: Option<[f32; 3]>,
}

/// Part of a ray that boxes are asked about, in f32: every rounding is made up for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slabs {
    /// Distance from the ray's origin at which it begins.
    pub(crate) start: f64,
    inverse: [f32; 3],
    near: [f32; 3],
    far: [f32; 3],
    pub(crate) is_back: [bool; 3],
}

/// Relative rounding of a distance to a box's side, twice.
pub(crate) const LOST: f32 = 8.0 * f32::EPSILON;
/// Below this a component of a direction moves a ray by less than boxes are widened.
const LEVEL: f64 = 1e-7;

impl Ready {
    /// None for a ray that does not come to the box, which is widened by `wider`, or has no direction.
    pub(crate) fn new(ray: &Ray, bounds: &Aabb, wider: f64) -> Option<Self> {
        let direction = unit(ray.direction)?;
        let origin = ray.origin;
        let [low, high] = [bounds.min, bounds.max].map(|corner| corner.map(f64::from));
        let size = (0..3).fold(0.0, |upper: f64, axis| upper.max(low[axis].abs()).max(high[axis].abs()));
        let far = origin.iter().fold(size, |upper, x| upper.max(x.abs()));
        let margin = wider + 16.0 * f64::EPSILON * far + f64::from(f32::MIN_POSITIVE);

        let (mut enter, mut leave) = (0.0_f64, ray.reach);
        for axis in 0..3 {
            let (low, high) = (low[axis] - margin - origin[axis], high[axis] + margin - origin[axis]);
            if direction[axis] == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let [a, b] = [low / direction[axis], high / direction[axis]];
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        let rounding = 16.0 * f64::EPSILON;
        if enter * (1.0 - rounding) > leave * (1.0 + rounding) + margin {
            return None;
        }

        // A little before, so that nothing at the border begins behind.
        let start = (enter * (1.0 - rounding) - margin).max(0.0);
        let from: [f64; 3] = array::from_fn(|axis| origin[axis] + direction[axis] * start);
        let reach = from.iter().fold(size, |upper, x| upper.max(x.abs()));
        let pad = margin + 16.0 * f64::EPSILON * (far + start) + f64::from(8.0 * f32::EPSILON) * reach;
        let is_back = direction.map(|x| x < 0.0);
        let side = |axis: usize, up: bool| {
            if up { ((from[axis] + pad) as f32).next_up() } else { ((from[axis] - pad) as f32).next_down() }
        };
        let slabs = Slabs {
            start,
            inverse: array::from_fn(|axis| {
                let inverse = (1.0 / direction[axis].abs().max(LEVEL)) as f32;
                if is_back[axis] { -inverse } else { inverse }
            }),
            near: array::from_fn(|axis| side(axis, !is_back[axis])),
            far: array::from_fn(|axis| side(axis, is_back[axis])),
            is_back,
        };

        let most = (0..3).fold(
            0,
            |best, axis| {
                if direction[axis].abs() > direction[best].abs() { axis } else { best }
            },
        );
        let [mut x, mut y] = [(most + 1) % 3, (most + 2) % 3];
        if direction[most] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let shear = [direction[x] / direction[most], direction[y] / direction[most], 1.0 / direction[most]];
        // What is no f32 number is no vertex.
        let corner = origin.map(|x| x as f32);
        let is_vertex = ray.is_from_vertex && corner.map(f64::from) == origin;
        Some(Ready {
            origin,
            direction,
            axes: [x, y, most],
            shear,
            slabs,
            corner: is_vertex.then_some(corner),
        })
    }

    /// Where a triangle is met: the distance, and the shares of its corners, which sum to 1.
    #[inline]
    pub(crate) fn meet(&self, corners: &[[f32; 3]; 3]) -> Option<(f64, [f64; 3])> {
        if self.corner.is_some_and(|corner| corners.contains(&corner)) {
            return None;
        }
        let [x, y, z] = self.axes;
        let [sx, sy, sz] = self.shear;
        let flat = |p: &[f32; 3]| {
            let away = |axis: usize| f64::from(p[axis]) - self.origin[axis];
            let deep = away(z);
            [away(x) - sx * deep, away(y) - sy * deep, deep]
        };
        let [a, b, c] = [flat(&corners[0]), flat(&corners[1]), flat(&corners[2])];
        let [mut u, mut v, mut w] = [[&c, &b], [&a, &c], [&b, &a]].map(|[p, q]| p[0] * q[1] - p[1] * q[0]);
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let is_clear = |side: f64, p: &[f64; 3], q: &[f64; 3]| side.abs() > CLEAR * (p[0] * q[1]).abs();
        if !(is_clear(u, &c, &b) && is_clear(v, &a, &c) && is_clear(w, &b, &a)) {
            // Rounding may have made nothing of what has a sign, and where a triangle is a needle shares of anything.
            [u, v, w] = [side(&c, &b), side(&a, &c), side(&b, &a)];
            if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
                return None;
            }
        }
        let sum = u + v + w;
        if sum == 0.0 {
            return None;
        }
        let shares = [u / sum, v / sum, w / sum];
        let distance = sz * (shares[0] * a[2] + shares[1] * b[2] + shares[2] * c[2]);
        (distance >= 0.0).then_some((distance, shares))
    }
}

/// Twice the area of a triangle whose first corner is where the ray is, right to the last digits, as Kahan takes a difference of products.
#[cold]
fn side(p: &[f64; 3], q: &[f64; 3]) -> f64 {
    let product = p[1] * q[0];
    let lost = (-p[1]).mul_add(q[0], product);
    p[0].mul_add(q[1], -product) + lost
}

/// Share of a product that is left of its difference from another, above which a few digits are lost at most.
const CLEAR: f64 = 1e-4;

impl Slabs {
    /// Where the ray comes into a box, from where the slabs begin; infinite where it does not, or only beyond `upper`.
    #[inline]
    pub(crate) fn enter(&self, min: &[f32; 3], max: &[f32; 3], upper: f32) -> f32 {
        let (mut enter, mut leave) = (0.0_f32, upper);
        for axis in 0..3 {
            let (near, far) = if self.is_back[axis] { (max, min) } else { (min, max) };
            enter = enter.max((near[axis] - self.near[axis]) * self.inverse[axis]);
            leave = leave.min((far[axis] - self.far[axis]) * self.inverse[axis]);
        }
        if enter * (1.0 - LOST) <= leave * (1.0 + LOST) { enter } else { f32::INFINITY }
    }

    /// The same of four boxes.
    #[inline]
    pub(crate) fn enter4(&self, min: &[[f32; 4]; 3], max: &[[f32; 4]; 3], upper: f32) -> [f32; 4] {
        let (mut enter, mut leave) = ([0.0_f32; 4], [upper; 4]);
        for axis in 0..3 {
            let (near, far) =
                if self.is_back[axis] { (&max[axis], &min[axis]) } else { (&min[axis], &max[axis]) };
            let a = near.map(|x| (x - self.near[axis]) * self.inverse[axis]);
            let b = far.map(|x| (x - self.far[axis]) * self.inverse[axis]);
            enter = array::from_fn(|i| if a[i] > enter[i] { a[i] } else { enter[i] });
            leave = array::from_fn(|i| if b[i] < leave[i] { b[i] } else { leave[i] });
        }
        array::from_fn(|i| {
            let is_met = enter[i] * (1.0 - LOST) <= leave[i] * (1.0 + LOST);
            if is_met { enter[i] } else { f32::INFINITY }
        })
    }
}
