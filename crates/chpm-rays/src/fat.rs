//! Where a ray first comes within a distance of a triangle.

use crate::ray::{Ready, dot};

type Vector = [f64; 3];

fn less(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// How far along the ray, or a little less: what lies within a distance of a triangle is two sheets above and below it, tubes about its edges and balls about its
/// corners. The distance is taken larger by what rounding may lose.
pub(crate) fn enter(ready: &Ready, corners: &[[f32; 3]; 3], distance: f64) -> Option<f64> {
    let way = ready.direction;
    let points = corners.map(|corner| less(corner.map(f64::from), ready.origin));
    let far = points.as_flattened().iter().fold(0.0, |upper: f64, x| upper.max(x.abs()));
    // From the point that is nearest to the triangle's first corner, so that no square is of what is far away.
    let start = dot(points[0], way);
    let points = points.map(|p| less(p, way.map(|x| x * start)));
    let size = points.as_flattened().iter().fold(distance, |upper, x| upper.max(x.abs()));
    let radius = distance * (1.0 + 1e-9) + 1e-7 * size.min(distance) + 1e-13 * (size + far);

    let mut first = f64::INFINITY;
    for i in 0..3 {
        let (p, q) = (points[i], points[(i + 1) % 3]);
        if let Some([near, leave]) = ball(p, way, radius) {
            first = first.min(inside([near, leave], -start));
        }
        first = first.min(tube(p, q, way, radius, -start));
    }
    first = first.min(sheet(&points, way, radius, -start));
    let enter = first + start;
    // Squares lose half of the digits where the ray only just comes near.
    (first < f64::INFINITY).then_some((enter - 1e-7 * radius).max(0.0))
}

/// Where a part of the line begins, if it does not end before the ray does begin.
fn inside([near, leave]: [f64; 2], begin: f64) -> f64 {
    if leave < begin { f64::INFINITY } else { near.max(begin) }
}

/// Where a line through zero is within a radius of a point.
fn ball(p: Vector, way: Vector, radius: f64) -> Option<[f64; 2]> {
    let along = dot(p, way);
    let off = less(p, way.map(|x| x * along));
    let left = radius * radius - dot(off, off);
    (left >= 0.0).then(|| [along - left.sqrt(), along + left.sqrt()])
}

/// The same of the points of a segment but for its ends.
fn tube(p: Vector, q: Vector, way: Vector, radius: f64, begin: f64) -> f64 {
    let edge = less(q, p);
    let length = dot(edge, edge);
    let side = cross(way, edge);
    let sine = dot(side, side);
    if length <= 0.0 || sine <= 1e-24 * length {
        // Along the edge: the balls about its ends are as near.
        return f64::INFINITY;
    }
    // The square of the distance from the edge's line is that of `side * t - off`, over the edge's length squared.
    let off = cross(p, edge);
    let middle = dot(side, off) / sine;
    let rest = less(off, side.map(|x| x * middle));
    let left = radius * radius * length - dot(rest, rest);
    if left < 0.0 {
        return f64::INFINITY;
    }
    let half = (left / sine).sqrt();
    let (mut near, mut leave) = (middle - half, middle + half);
    // Between the planes through its ends.
    let (slope, low) = (dot(way, edge), dot(p, edge));
    if slope != 0.0 {
        let [a, b] = [low / slope, (low + length) / slope];
        near = near.max(a.min(b));
        leave = leave.min(a.max(b));
    } else if low > 0.0 || low + length < 0.0 {
        return f64::INFINITY;
    }
    if near > leave { f64::INFINITY } else { inside([near, leave], begin) }
}

/// The same of the inside of a triangle: between two planes and upright on its edges.
fn sheet(points: &[Vector; 3], way: Vector, radius: f64, begin: f64) -> f64 {
    let normal = cross(less(points[1], points[0]), less(points[2], points[0]));
    let length = dot(normal, normal).sqrt();
    if length <= 0.0 {
        return f64::INFINITY;
    }
    let (mut near, mut leave) = (begin, f64::INFINITY);
    let mut cut = |slope: f64, low: f64, high: f64| {
        // Where low <= slope * t <= high.
        if slope != 0.0 {
            let [a, b] = [low / slope, high / slope];
            near = near.max(a.min(b));
            leave = leave.min(a.max(b));
        } else if low > 0.0 || high < 0.0 {
            leave = f64::NEG_INFINITY;
        }
    };
    let height = dot(normal, points[0]);
    cut(dot(normal, way), height - radius * length, height + radius * length);
    for i in 0..3 {
        let inward = cross(normal, less(points[(i + 1) % 3], points[i]));
        cut(dot(inward, way), dot(inward, points[i]), f64::INFINITY);
    }
    if near > leave { f64::INFINITY } else { near }
}
