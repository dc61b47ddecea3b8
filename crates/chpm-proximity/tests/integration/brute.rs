//! Distances by looking at every pair of triangles, with formulas of its own.

use nalgebra::Vector3;

type V = Vector3<f64>;

/// Triangles, and balls about them: middle and radius, which are looked at one after the other.
struct Balled {
    triangles: Vec<[V; 3]>,
    balls: Vec<[f64; 4]>,
}

/// The distance of two sets of triangles.
pub(crate) fn distance(a: &[[[f64; 3]; 3]], b: &[[[f64; 3]; 3]]) -> f64 {
    let (a, b) = (Balled::new(a), Balled::new(b));
    // Some corners first, so that most of a scan is seen to be too far away.
    let (p, q) = (a.some(), b.some());
    let mut best = p.iter().flat_map(|p| q.iter().map(move |q| (p - q).norm())).fold(f64::INFINITY, f64::min);
    for i in a.within_box(&b, best) {
        for j in 0..b.balls.len() {
            if are_near(&a.balls[i], &b.balls[j], best) {
                best = best.min(of_triangles(&a.triangles[i], &b.triangles[j]));
            }
        }
    }
    best
}

/// The pairs of triangles that are within a distance.
pub(crate) fn pairs_within(a: &[[[f64; 3]; 3]], b: &[[[f64; 3]; 3]], within: f64) -> Vec<[usize; 2]> {
    let (a, b) = (Balled::new(a), Balled::new(b));
    let mut found = Vec::new();
    for i in a.within_box(&b, within) {
        for j in 0..b.balls.len() {
            let near = are_near(&a.balls[i], &b.balls[j], within);
            if near && of_triangles(&a.triangles[i], &b.triangles[j]) <= within {
                found.push([i, j]);
            }
        }
    }
    found
}

/// Whether something in two balls may be within a distance.
fn are_near([x, y, z, radius]: &[f64; 4], [u, v, w, reach]: &[f64; 4], within: f64) -> bool {
    let near = within + radius + reach;
    let [dx, dy, dz] = [x - u, y - v, z - w];
    dx * dx + dy * dy + dz * dz <= near * near
}

impl Balled {
    fn new(all: &[[[f64; 3]; 3]]) -> Self {
        let triangles: Vec<[V; 3]> = all.iter().map(|t| t.map(V::from)).collect();
        let ball = |t: &[V; 3]| {
            let center = (t[0] + t[1] + t[2]) / 3.0;
            let radius = t.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
            [center.x, center.y, center.z, radius * (1.0 + 1e-12)]
        };
        let balls = triangles.iter().map(ball).collect();
        Balled { triangles, balls }
    }

    fn some(&self) -> Vec<V> {
        self.triangles.iter().step_by(1 + self.triangles.len() / 500).map(|t| t[0]).collect()
    }

    /// Those whose balls are within a distance of the box about all of `other`.
    fn within_box(&self, other: &Balled, within: f64) -> Vec<usize> {
        let corners = || other.triangles.as_flattened().iter();
        let low = corners().fold(V::repeat(f64::INFINITY), |m, p| m.inf(p));
        let high = corners().fold(V::repeat(f64::NEG_INFINITY), |m, p| m.sup(p));
        let is_near = |i: &usize| {
            let [x, y, z, radius] = self.balls[*i];
            let center = V::new(x, y, z);
            let outside = (low - center).sup(&(center - high)).sup(&V::zeros());
            outside.norm() <= (within + radius) * (1.0 + 1e-12)
        };
        (0..self.balls.len()).filter(is_near).collect()
    }
}

/// The distance of two triangles: 0 where an edge of one goes through the other, else that of two edges, or of a corner and a face.
pub(crate) fn of_triangles(t: &[V; 3], u: &[V; 3]) -> f64 {
    let mut best = f64::INFINITY;
    for i in 0..3 {
        let (p, q) = (t[i], t[(i + 1) % 3]);
        let (r, s) = (u[i], u[(i + 1) % 3]);
        if goes_through(p, q, u) || goes_through(r, s, t) {
            return 0.0;
        }
        best = best.min(above(p, u)).min(above(r, t));
        for j in 0..3 {
            best = best.min(of_segments(p, q, u[j], u[(j + 1) % 3]));
        }
    }
    best
}

fn volume(a: V, b: V, c: V, d: V) -> f64 {
    (b - a).cross(&(c - a)).dot(&(d - a))
}

fn goes_through(p: V, q: V, [a, b, c]: &[V; 3]) -> bool {
    let (from, to) = (volume(*a, *b, *c, p), volume(*a, *b, *c, q));
    let sides = [volume(p, q, *a, *b), volume(p, q, *b, *c), volume(p, q, *c, *a)];
    // What rounding may give of a face that is far smaller than its distance from the edge's ends is no crossing; there its edges are near.
    let reach = [a, b, c].into_iter().map(|x| (x - p).norm()).fold(0.0, f64::max);
    let noise = 1e-15 * (q - p).norm() * reach * reach;
    from * to < 0.0 && (sides.iter().all(|x| *x > noise) || sides.iter().all(|x| *x < -noise))
}

/// The height above a face, infinite where the foot is outside.
fn above(p: V, [a, b, c]: &[V; 3]) -> f64 {
    let n = (b - a).cross(&(c - a));
    let inside =
        [(a, b), (b, c), (c, a)].iter().all(|(from, to)| n.cross(&(*to - *from)).dot(&(p - *from)) >= 0.0);
    if n.norm() > 0.0 && inside { n.normalize().dot(&(p - a)).abs() } else { f64::INFINITY }
}

/// By the ends of each, and by where their lines come nearest.
fn of_segments(a: V, b: V, c: V, d: V) -> f64 {
    let to = |p: V, a: V, b: V| {
        let length = (b - a).norm_squared();
        let s = if length > 0.0 { ((p - a).dot(&(b - a)) / length).clamp(0.0, 1.0) } else { 0.0 };
        (a.lerp(&b, s) - p).norm()
    };
    let ends = to(a, c, d).min(to(b, c, d)).min(to(c, a, b)).min(to(d, a, b));
    let n = (b - a).cross(&(d - c));
    let nn = n.norm_squared();
    if nn <= 0.0 {
        return ends;
    }
    let s = (c - a).cross(&(d - c)).dot(&n) / nn;
    let t = (c - a).cross(&(b - a)).dot(&n) / nn;
    let inside = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    if inside { ends.min((a.lerp(&b, s) - c.lerp(&d, t)).norm()) } else { ends }
}

#[test]
fn known_triangles_are_as_far_as_they_are() {
    let flat = [V::zeros(), V::x(), V::y()];
    let moved = |by: V| flat.map(|p| p + by);
    assert_eq!(of_triangles(&flat, &moved(V::z() * 2.0)), 2.0);
    assert_eq!(of_triangles(&flat, &moved(V::x() * 3.0)), 2.0);
    assert_eq!(
        of_triangles(&flat, &[V::new(0.2, 0.2, -1.0), V::new(0.2, 0.2, 1.0), V::new(5.0, 5.0, 0.0)]),
        0.0
    );
    assert_eq!(of_triangles(&flat, &moved(V::new(0.1, 0.1, 0.0))), 0.0);
    assert_eq!(
        of_triangles(&flat, &[V::new(0.5, -1.0, 1.0), V::new(0.5, -1.0, -1.0), V::new(0.5, -3.0, 0.0)]),
        1.0
    );
}
