//! Kernels: the surface that is seen at a point, and how bright it is.

use super::eye::{Eye, Vector};
use super::skin::Corner;
use chpm_mesh::Facing;
use std::f64::consts::TAU;

/// A point that is seen, and all that its light hangs on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    /// On the surface.
    pub(super) at: Vector,
    /// Where rays from it begin.
    pub(super) from: Vector,
    /// To the side that is seen; what light falls on.
    pub(super) normal: Vector,
    /// The same of the triangle.
    pub(super) plane: Vector,
    pub(super) color: [f32; 3],
    pub(super) is_ground: bool,
}

/// By how much rays begin above a surface: that of what coordinates may be, which is far more than doubles lose, and far less than a single has.
pub(super) const LIFT: f64 = 1e-9;

impl Spot {
    /// A point of a triangle, seen along `way`. `size` is that of the model, and of its coordinates; `color` tells that of the corners' shares.
    pub(super) fn new(
        eye: &Eye,
        at: Vector,
        normal: [f64; 3],
        corners: &[Corner; 3],
        way: &Vector,
        size: f64,
        color: impl Fn([f64; 3]) -> [f64; 3],
    ) -> Self {
        let points = [0, 1, 2].map(|i| eye.point(corners[i].at.into()));
        let shares = shares(&points, &at);
        let plane = eye.normal(normal);
        let plane = if plane == Vector::zeros() { -way } else { plane };
        let plane = if plane.dot(way) > 0.0 { -plane } else { plane };

        // As pixels of the GPU have it: what becomes of the plane at each corner, mixed by their shares.
        let bent = [0, 1, 2].map(|i| bent(eye, &corners[i].facing, &plane));
        let mixed: Vector = (0..3).map(|i| bent[i] * shares[i]).sum();
        let normal = if mixed.norm() > 1e-3 { mixed.normalize() } else { plane };
        let normal = facing_eye(&normal, &plane, way);

        // Smooth light on a mesh of planes: where it is round, rays begin on the surface that the corners' normals stand for, not below it on a plane that others of the same round hide.
        let mut raised = at;
        for i in 0..3 {
            let Some(normal) = bent[i].try_normalize(1e-3) else { continue };
            let above = normal.dot(&(points[i] - at));
            raised += normal * (shares[i] * above.max(0.0));
        }
        let color = color(shares).map(|c| c as f32);
        Spot { at, from: raised + plane * (LIFT * size), normal, plane, color, is_ground: false }
    }

    /// A point of the ground, seen from above.
    pub(super) fn ground(at: Vector, sky: Vector, size: f64) -> Self {
        let from = at + sky * (LIFT * size);
        Spot { at, from, normal: sky, plane: sky, color: [0.0; 3], is_ground: true }
    }

    /// A direction of a hemisphere about the normal, the more the nearer to it, as light from everywhere counts; on the outer side of the triangle.
    pub(super) fn outward(&self, [u, v]: [f64; 2]) -> Vector {
        let (sin, cos) = (TAU * u).sin_cos();
        let across = v.sqrt();
        let [x, y] = frame(&self.normal);
        let way = x * (across * cos) + y * (across * sin) + self.normal * (1.0 - v).max(0.0).sqrt();
        let below = way.dot(&self.plane);
        if below < 0.0 { way - self.plane * (2.0 * below) } else { way }
    }
}

/// The shares of a triangle's corners in a point of it.
fn shares(points: &[Vector; 3], at: &Vector) -> [f64; 3] {
    let [u, v, w] = [points[1] - points[0], points[2] - points[0], at - points[0]];
    let (uu, uv, vv) = (u.dot(&u), u.dot(&v), v.dot(&v));
    let (wu, wv) = (w.dot(&u), w.dot(&v));
    let area = uu * vv - uv * uv;
    if area.is_nan() || area <= 0.0 {
        return [1.0 / 3.0; 3];
    }
    let second = ((vv * wu - uv * wv) / area).clamp(0.0, 1.0);
    let third = ((uu * wv - uv * wu) / area).clamp(0.0, 1.0 - second);
    [1.0 - second - third, second, third]
}

/// The change of a plane at a vertex.
fn bent(eye: &Eye, facing: &Facing, plane: &Vector) -> Vector {
    let facing = match facing {
        Facing::Toward(normal) => Facing::Toward(eye.normal(*normal).into()),
        Facing::Along(line) => Facing::Along(eye.line(*line).into()),
        Facing::Flat => Facing::Flat,
    };
    facing.of_plane((*plane).into()).into()
}

/// Near a silhouette a normal may look away from the eye although its triangle does not: the triangle's own takes its place there, by and by.
fn facing_eye(normal: &Vector, plane: &Vector, way: &Vector) -> Vector {
    let share = ((normal.dot(way) + 0.15) / 0.3).clamp(0.0, 1.0);
    let share = share * share * (3.0 - 2.0 * share);
    let mixed = normal * (1.0 - share) + plane * share;
    if mixed.norm() > 1e-3 { mixed.normalize() } else { *plane }
}

/// Two directions across one of length 1, without a seam but at -z (Duff and others, 2017).
fn frame(n: &Vector) -> [Vector; 2] {
    let sign = 1.0_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    [
        Vector::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vector::new(b, sign + n.y * n.y * a, -n.y),
    ]
}

/// A direction to a point of a round light that is seen under an angle, whose half has this tangent.
pub(super) fn toward(light: &Vector, half: f64, [u, v]: [f64; 2]) -> Vector {
    let (sin, cos) = (TAU * u).sin_cos();
    let across = half * v.sqrt();
    let [x, y] = frame(light);
    (light + x * (across * cos) + y * (across * sin)).normalize()
}

/// Parts of the light.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Light {
    /// From everywhere; that which comes from above more than from below.
    ambient: f64,
    sky: f64,
    /// From the eye.
    head: f64,
    pub(super) key: f64,
}

impl Light {
    /// As pictures of the GPU have it: their shaders have the same numbers.
    pub(super) fn new(is_studio: bool) -> Self {
        if is_studio {
            Light { ambient: 0.22, sky: 0.20, head: 0.14, key: 0.58 }
        } else {
            Light { ambient: 0.16, sky: 0.0, head: 0.34, key: 0.54 }
        }
    }

    /// The light of a spot that is seen along `way`, but for the key light: `open` of it is not hidden.
    fn soft(&self, spot: &Spot, way: &Vector, sky: &Vector, open: f64) -> f64 {
        let head = (-spot.normal.dot(way)).max(0.0);
        (self.ambient + self.sky * spot.normal.dot(sky) + self.head * head) * open
    }

    /// The colour of a spot, and how much of what is behind it is hidden. `key` is what of the key light comes there, and `free` what would if nothing hid it.
    pub(super) fn on(
        &self,
        spot: &Spot,
        way: &Vector,
        sky: &Vector,
        open: f64,
        [key, free]: [f64; 2],
    ) -> ([f32; 3], f32) {
        if spot.is_ground {
            // A ground that nobody sees but for what falls onto it: as much of what is behind it as of the light is left. The eye does not light it, so that it has no middle.
            let all = self.ambient + self.sky + 0.5 * self.head;
            let left = (all * open + self.key * key) / (all + self.key * free);
            return ([0.0; 3], (1.0 - left).clamp(0.0, 1.0) as f32);
        }
        let lit = self.soft(spot, way, sky, open) + self.key * key;
        (spot.color.map(|c| (c * lit as f32).clamp(0.0, 1.0)), 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_refine::Camera;

    fn spot(facing: [Facing; 3]) -> Spot {
        let eye =
            Eye::new(&Camera::looking([0.0, 0.0, 10.0], [0.0; 3]), [10, 10], 0.0, [1.0; 3], None).unwrap();
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let corner = |i: usize| Corner { at: points[i].into(), facing: facing[i] };
        let color = |shares: [f64; 3]| [0.5, shares[1] + 2.0 * shares[2], 0.0];
        let corners = [corner(0), corner(1), corner(2)];
        let at = Vector::new(0.25, 0.5, 0.0);
        Spot::new(&eye, at, [0.0, 0.0, -1.0], &corners, &-Vector::z(), 1.0, color)
    }

    #[test]
    fn a_spot_has_its_corners_shares() {
        let flat = spot([Facing::Flat; 3]);
        assert_eq!((flat.normal, flat.plane), (Vector::z(), Vector::z()), "to the side of the eye");
        assert!((flat.color[1] - 1.25).abs() < 1e-6 && flat.from.z > 0.0 && flat.from.z < 2e-9);
    }

    /// Corners of a ball: rays begin on it rather than on the plane below.
    #[test]
    fn rays_from_what_is_round_begin_on_it() {
        let center = Vector::new(0.3, 0.3, -2.0);
        let normal = |p: [f64; 3]| Facing::Toward((Vector::from(p) - center).normalize().into());
        let round = spot([normal([0.0; 3]), normal([1.0, 0.0, 0.0]), normal([0.0, 1.0, 0.0])]);
        // Tangent planes are as far above a chord again as the ball is: twice the height of a cap over the corners' circle, at most.
        let most = 0.5 / 2.1;
        assert!(round.from.z > 0.01 && round.from.z < most, "{}", round.from);
        // Hollows stay.
        let turned =
            |p: [f64; 3]| Facing::Toward((Vector::new(0.3, 0.3, 2.0) - Vector::from(p)).normalize().into());
        let hollow = spot([turned([0.0; 3]), turned([1.0, 0.0, 0.0]), turned([0.0, 1.0, 0.0])]);
        assert!(hollow.from.z < 2e-9, "{}", hollow.from);
    }

    #[test]
    fn directions_are_outward_and_have_the_cosine() {
        let flat = spot([Facing::Flat; 3]);
        let sequence = super::super::sequence::Sequence::new(1, 1);
        let ways: Vec<Vector> = (0..4096).map(|n| flat.outward(sequence.square(n))).collect();
        assert!(ways.iter().all(|way| way.z >= 0.0 && (way.norm() - 1.0).abs() < 1e-12));
        let mean = ways.iter().sum::<Vector>() / 4096.0;
        assert!((mean - Vector::new(0.0, 0.0, 2.0 / 3.0)).norm() < 0.01, "{mean}");
        for way in [Vector::z(), -Vector::z(), Vector::new(0.6, 0.0, -0.8)] {
            let [x, y] = frame(&way);
            assert!(
                x.dot(&y).abs() < 1e-12 && x.dot(&way).abs() < 1e-12 && (x.cross(&y) - way).norm() < 1e-12
            );
        }
        let half = 5.0_f64.to_radians().tan();
        let light = Vector::new(0.6, 0.0, 0.8);
        assert!(
            (0..500).all(|n| toward(&light, half, sequence.square(n)).angle(&light) < 5.001_f64.to_radians())
        );
    }

    #[test]
    fn ground_is_as_dark_as_light_is_missing() {
        let light = Light::new(false);
        let ground = Spot::ground(Vector::zeros(), Vector::z(), 1.0);
        let hidden = |open, key| light.on(&ground, &-Vector::z(), &Vector::z(), open, [key, 0.5]).1;
        assert_eq!(hidden(1.0, 0.5), 0.0);
        assert!(hidden(1.0, 0.0) > 0.3 && hidden(0.0, 0.0) == 1.0 && hidden(0.5, 0.5) < hidden(0.5, 0.0));
    }
}
