//! How far two triangles are from each other: a bound from below and one from above, whatever the arithmetic loses.

use chpm_space::Corners;
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};

/// Two points, one of each triangle, and what their distance proves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Near {
    /// No two points of the triangles are nearer, but for rounding.
    pub(crate) lower: f64,
    /// The points' distance.
    pub(crate) upper: f64,
    pub(crate) a: Vector3<f64>,
    pub(crate) b: Vector3<f64>,
}

/// Finds points that are nearest, and proves it: whatever direction is taken, the triangles are at least as far apart as they are along it. Where
/// the search is off by rounding, the bounds are apart, and still hold.
pub(crate) fn distance(t: &Corners, u: &Corners) -> Near {
    let mut best = Best { squared: f64::INFINITY, a: t[0], b: u[0] };
    each_near(t, u, &mut |a, b| best.take(a, b));
    // What rounding alone may leave between the bounds.
    let noise = 4e-15 * (t[0].amax() + u[0].amax());
    fn is_wide(lower: f64, upper: f64, noise: f64) -> bool {
        upper - lower > WIDTH * upper + noise
    }
    // What is apart along the way between these points is not pierced, and no others are nearer.
    let Best { squared, a, b } = best;
    let upper = squared.sqrt();
    let lower = apart_along(a - b, t, u);
    if lower > 0.0 && !is_wide(lower, upper, noise) {
        return Near { lower: lower.min(upper), upper, a, b };
    }
    for i in 0..3 {
        if let Some(at) = pierce(t[i], t[(i + 1) % 3], u) {
            best.take(at, nearest_point(&at, u));
        }
        if let Some(at) = pierce(u[i], u[(i + 1) % 3], t) {
            best.take(nearest_point(&at, t), at);
        }
    }
    let Best { squared, a, b } = best;
    let upper = squared.sqrt();
    let mut lower = apart_along(a - b, t, u);
    if is_wide(lower, upper, noise) {
        // Squares do not tell points apart that are off by half of their digits; what lies along the way between them does.
        each_near(t, u, &mut |a, b| lower = lower.max(apart_along(a - b, t, u)));
    }
    if is_wide(lower, upper, noise) {
        lower = separations(t, u).map(|direction| apart_along(direction, t, u)).fold(lower, f64::max);
    }
    Near { lower: lower.min(upper), upper, a, b }
}

/// Of the distance: bounds that are as near to each other are good enough.
const WIDTH: f64 = 1e-12;

/// Points that may be the nearest: a corner and what is nearest to it, or on an edge of each.
fn each_near(t: &Corners, u: &Corners, take: &mut impl FnMut(Vector3<f64>, Vector3<f64>)) {
    for corner in u {
        take(nearest_point(corner, t), *corner);
    }
    for corner in t {
        take(*corner, nearest_point(corner, u));
    }
    for i in 0..3 {
        for j in 0..3 {
            if let Some((a, b)) = cross_points(t[i], t[(i + 1) % 3], u[j], u[(j + 1) % 3]) {
                take(a, b);
            }
        }
    }
}

/// The nearest points so far.
#[derive(Clone, Copy)]
struct Best {
    squared: f64,
    a: Vector3<f64>,
    b: Vector3<f64>,
}

impl Best {
    fn take(&mut self, a: Vector3<f64>, b: Vector3<f64>) {
        let squared = (a - b).norm_squared();
        if squared < self.squared {
            *self = Best { squared, a, b };
        }
    }
}

/// Directions along which triangles that are apart are, too: upright on one, or on an edge of each.
fn separations(t: &Corners, u: &Corners) -> impl Iterator<Item = Vector3<f64>> {
    fn edges(c: &Corners) -> [Vector3<f64>; 3] {
        [c[1] - c[0], c[2] - c[1], c[0] - c[2]]
    }
    let (e, f) = (edges(t), edges(u));
    let faces = [e[0].cross(&e[1]), f[0].cross(&f[1])];
    let pairs = e.into_iter().flat_map(move |e| f.into_iter().map(move |f| e.cross(&f)));
    faces.into_iter().chain(pairs).flat_map(|direction| [direction, -direction])
}

/// How far all of `t` is beyond all of `u` in a direction; 0 where it is not.
pub(crate) fn apart_along(direction: Vector3<f64>, t: &Corners, u: &Corners) -> f64 {
    let Some(direction) = direction.try_normalize(f64::MIN_POSITIVE) else { return 0.0 };
    let low = t.iter().map(|x| direction.dot(x)).fold(f64::INFINITY, f64::min);
    let high = u.iter().map(|x| direction.dot(x)).fold(f64::NEG_INFINITY, f64::max);
    (low - high).max(0.0)
}

/// The point of a triangle that is nearest to a point.
pub(crate) fn nearest_point(point: &Vector3<f64>, [a, b, c]: &Corners) -> Vector3<f64> {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let normal = ab.cross(&ac);
    let area = normal.norm_squared();
    if area > 0.0 {
        // Shares of the corners b and c at the foot of the perpendicular.
        let (v, w) = (ap.cross(&ac).dot(&normal) / area, ab.cross(&ap).dot(&normal) / area);
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            return a + ab * v + ac * w;
        }
    }
    let on = [on_segment(point, a, b), on_segment(point, b, c), on_segment(point, c, a)];
    let [x, y, z] = on.map(|on| (on - point).norm_squared());
    if x <= y && x <= z {
        on[0]
    } else if y <= z {
        on[1]
    } else {
        on[2]
    }
}

/// How near a point comes to a triangle: what is certain, whatever the formulas lose, and the shortest way that was found, at least from a corner. For needles, and
/// where the point is so near that squares do not tell it from the triangle.
pub(crate) fn distance_of_point(point: &Vector3<f64>, t: &Corners) -> (f64, Vector3<f64>) {
    let [a, b, c] = t;
    let ways =
        [nearest_point(point, t), on_segment(point, a, b), on_segment(point, b, c), on_segment(point, c, a)]
            .map(|on| point - on);
    let shortest = ways[1..].iter().fold(ways[0], |shortest, way| {
        if way.norm_squared() < shortest.norm_squared() { *way } else { shortest }
    });
    // Upright on an edge, and on the face: twice, since the first time leaves what it has lost.
    let edges = [b - a, c - b, a - c];
    let of_edges = [0, 1, 2].map(|i| upright(ways[i + 1], &edges[i]));
    let face = edges[0].cross(&edges[1]);
    let face = upright(upright(face, &edges[0]), &edges[1]);
    let lower = ways.into_iter().chain(of_edges).chain([face, -face]);
    let lower = lower.map(|way| beyond(&way, point, t)).fold(0.0, f64::max);
    (lower.min(shortest.norm()), shortest)
}

/// The normal of a triangle, as long as the angle that the triangle fills about a point of it, which may be off by `noise`.
pub(crate) fn facing(at: &Vector3<f64>, t: &Corners, noise: f64) -> Vector3<f64> {
    let normal = (t[1] - t[0]).cross(&(t[2] - t[0]));
    let area = normal.norm();
    if area <= 0.0 {
        return normal;
    }
    let is_at = |place: &Vector3<f64>| (at - place).amax() <= noise;
    let ends = |i: usize| (&t[(i + 1) % 3], &t[(i + 2) % 3]);
    let angle = if let Some(i) = (0..3).find(|i| is_at(&t[*i])) {
        let (b, c) = ends(i);
        f64::atan2(area, (b - t[i]).dot(&(c - t[i])))
    } else if (0..3).any(|i| is_at(&on_segment(at, &t[i], ends(i).0))) {
        PI
    } else {
        TAU
    };
    normal * (angle / area)
}

fn upright(way: Vector3<f64>, edge: &Vector3<f64>) -> Vector3<f64> {
    let length = edge.norm_squared();
    if length > 0.0 { way - edge * (way.dot(edge) / length) } else { way }
}

/// How far a point is beyond all of a triangle in a direction; negative or 0 where it is not.
pub(crate) fn beyond(direction: &Vector3<f64>, point: &Vector3<f64>, t: &Corners) -> f64 {
    let Some(direction) = direction.try_normalize(f64::MIN_POSITIVE) else { return 0.0 };
    t.iter().map(|corner| direction.dot(&(point - corner))).fold(f64::INFINITY, f64::min)
}

fn on_segment(point: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    let along = b - a;
    let length = along.norm_squared();
    let reach = along.dot(&(point - a));
    // Also where it has no length.
    if reach <= 0.0 || length <= 0.0 {
        *a
    } else if reach >= length {
        *b
    } else {
        a + along * (reach / length)
    }
}

/// The points inside two segments where the lines are nearest; ends are left to those who ask for corners.
fn cross_points(
    a: Vector3<f64>,
    b: Vector3<f64>,
    c: Vector3<f64>,
    d: Vector3<f64>,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, uv, vv, uw, vw) = (u.dot(&u), u.dot(&v), v.dot(&v), u.dot(&w), v.dot(&w));
    let det = uu * vv - uv * uv;
    if det <= 0.0 {
        return None;
    }
    let s = ((uv * vw - vv * uw) / det).clamp(0.0, 1.0);
    let t = ((uv * s + vw) / vv).clamp(0.0, 1.0);
    Some((a + u * s, c + v * t))
}

/// Where a segment goes through the plane of a triangle.
fn pierce(from: Vector3<f64>, to: Vector3<f64>, [a, b, c]: &Corners) -> Option<Vector3<f64>> {
    let normal = (b - a).cross(&(c - a));
    let (above, below) = (normal.dot(&(from - a)), normal.dot(&(to - a)));
    if above * below > 0.0 || above == below {
        return None;
    }
    Some(from + (to - from) * (above / (above - below)).clamp(0.0, 1.0))
}
