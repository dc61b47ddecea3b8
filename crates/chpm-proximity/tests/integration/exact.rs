//! Answers held against whole numbers of any length: doubles far from zero, where the leaves round.

use crate::site::Built;
use chpm_mesh::{Bytes, ClusterId, TriMesh};
use chpm_proximity::contacts::Near;
use chpm_proximity::{Gauge, Model, Pose, Question, contacts, distance};
use chpm_synth::hand;
use chpm_synth::hard::Case;
use dashu_ratio::Relaxed;
use rayon::ThreadPoolBuilder;
use std::collections::HashMap;

type Point = [Relaxed; 3];

fn exact(x: f64) -> Relaxed {
    Relaxed::try_from(x).expect("a finite number")
}

fn minus(a: &Point, b: &Point) -> Point {
    [0, 1, 2].map(|i| &a[i] - &b[i])
}

fn dot(a: &Point, b: &Point) -> Relaxed {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

fn cross(a: &Point, b: &Point) -> Point {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| &a[i] * &b[j] - &a[j] * &b[i])
}

/// The squared distance of a point from a triangle, which may have no area.
fn squared(p: &Point, [a, b, c]: &[Point; 3]) -> Relaxed {
    let normal = cross(&minus(b, a), &minus(c, a));
    let area = dot(&normal, &normal);
    let inside = area > Relaxed::ZERO
        && [(a, b), (b, c), (c, a)]
            .iter()
            .all(|(from, to)| dot(&cross(&normal, &minus(to, from)), &minus(p, from)) >= Relaxed::ZERO);
    if inside {
        let height = dot(&normal, &minus(p, a));
        return &height * &height / area;
    }
    [(a, b), (b, c), (c, a)].into_iter().map(|(from, to)| from_segment(p, from, to)).min().unwrap()
}

fn from_segment(p: &Point, from: &Point, to: &Point) -> Relaxed {
    let (along, way) = (minus(to, from), minus(p, from));
    let (length, reach) = (dot(&along, &along), dot(&along, &way));
    if reach <= Relaxed::ZERO || length == Relaxed::ZERO {
        dot(&way, &way)
    } else if reach >= length {
        let way = minus(p, to);
        dot(&way, &way)
    } else {
        dot(&way, &way) - &reach * &reach / length
    }
}

/// Whether the root of a square is within `tolerance` of a number, exactly.
fn is_root(square: &Relaxed, told: f64, tolerance: f64) -> bool {
    let (told, tolerance) = (exact(told.abs()), exact(tolerance));
    let (low, high) = (&told - &tolerance, &told + &tolerance);
    (low <= Relaxed::ZERO || &low * &low <= *square) && *square <= &high * &high
}

/// A mesh of doubles: where a file has its vertices, and where its source has them.
struct Doubles {
    built: Built,
    source: Vec<[f64; 3]>,
}

impl Doubles {
    /// `scale` makes of singles doubles that no single holds.
    fn new(name: &str, mesh: &TriMesh, scale: f64, offset: [f64; 3]) -> Self {
        let source: Vec<[f64; 3]> = mesh
            .positions
            .iter()
            .map(|p| [0, 1, 2].map(|axis| f64::from(p[axis]) * scale + offset[axis]))
            .collect();
        Doubles { built: Built::of_doubles(name, mesh.clone(), &source), source }
    }

    fn corners(&self) -> Vec<[Point; 3]> {
        let corner = |v: u32| self.source[v as usize].map(exact);
        self.built.mesh.triangles.iter().map(|t| t.map(corner)).collect()
    }

    fn squared_from(&self, point: [f64; 3]) -> Relaxed {
        let point = point.map(exact);
        self.corners().iter().map(|t| squared(&point, t)).min().unwrap()
    }

    /// The source's vertex of each position of a leaf: the one that is rounded to it.
    fn originals(&self) -> HashMap<[u32; 3], [f64; 3]> {
        let origin = self.built.file.header().origin;
        let stored = |p: &[f64; 3]| [0, 1, 2].map(|i| ((p[i] - origin[i]) as f32).to_bits());
        self.source.iter().map(|p| (stored(p), *p)).collect()
    }
}

/// Hard meshes and plain ones, as doubles near zero, at the ends of single precision, and where a double has few digits left.
fn pairs(triangles: u32, halvings: u32) -> Vec<[Doubles; 2]> {
    let places = [
        ([0.1, 0.2, 0.3], [0.1, 0.2, 100_000.1]),
        ([4.5e6 + 0.123, -3.1e6, 1.7e6], [4.5e6 + 100_000.7, -3.0e6, 1.7e6 + 0.9]),
        ([1e9 + 0.5, 1e9, -1e9], [1e9 + 1.75, 1e9 + 0.25, -1e9 + 0.125]),
    ];
    let meshes = || {
        let case = |name: &str| (name.to_owned(), Case::find(name).unwrap().mesh(triangles));
        let ball = |name: &str| (name.to_owned(), hand::icosphere(halvings));
        [[ball("ball"), ball("other")], [case("needles"), case("line")], [case("cubes"), ball("ball")]]
    };
    let mut all = Vec::new();
    for (from, to) in places {
        for [(a, first), (b, second)] in meshes() {
            let scale = |k: f64| (1.0 + k) / 3.0;
            all.push([Doubles::new(&a, &first, scale(0.1), from), Doubles::new(&b, &second, scale(0.2), to)]);
        }
    }
    all
}

#[test]
fn distances_of_points_hold_in_exact_arithmetic() {
    for [scan, reference] in pairs(60, 1) {
        let told = format!("{} from {}", scan.built.name, reference.built.name);
        let [x, y] = [&scan, &reference].map(|d| Model::new(&d.built.file, Bytes(1 << 20)).unwrap());
        let originals = scan.originals();
        for tolerance in [0.0, 0.01 * reference.built.diagonal()] {
            let still = Pose::IDENTITY;
            let gauge = Gauge::new(&x, &y, [&still, &still], tolerance).unwrap();
            let mut looked = 0;
            for (id, record) in (0..).map(ClusterId).zip(scan.built.file.clusters()) {
                if !record.is_leaf() {
                    continue;
                }
                let page = scan.built.file.page(id).unwrap();
                let positions = page.view().positions;
                let mut found = Vec::new();
                let within = gauge.measure(positions, &mut found).unwrap();
                let lower = gauge.rounding() + 1e-14 * found.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                assert!(within <= tolerance.max(lower), "{told}: {within} of {lower}");
                for (position, distance) in positions.iter().zip(&found).step_by(5) {
                    let truth = reference.squared_from(originals[&position.map(f32::to_bits)]);
                    assert!(is_root(&truth, *distance, within), "{told}: {distance} within {within}");
                    looked += 1;
                }
            }
            assert!(looked > 5, "{told}: {looked}");
        }
    }
}

/// The squared distance of two triangles that are apart.
fn apart(t: &[Point; 3], u: &[Point; 3]) -> Relaxed {
    let corners = t.iter().map(|p| squared(p, u)).chain(u.iter().map(|p| squared(p, t)));
    let edge = |t: &[Point; 3], i: usize| (t[i].clone(), t[(i + 1) % 3].clone());
    let edges = (0..9).filter_map(|k| {
        let ((a, b), (c, d)) = (edge(t, k / 3), edge(u, k % 3));
        let (e, f, way) = (minus(&b, &a), minus(&d, &c), minus(&c, &a));
        let normal = cross(&e, &f);
        let size = dot(&normal, &normal);
        if size == Relaxed::ZERO {
            return None;
        }
        let s = dot(&cross(&way, &f), &normal) / &size;
        let r = dot(&cross(&way, &e), &normal) / &size;
        let inside = |x: &Relaxed| *x >= Relaxed::ZERO && *x <= Relaxed::ONE;
        let height = dot(&way, &normal);
        (inside(&s) && inside(&r)).then(|| &height * &height / size)
    });
    corners.chain(edges).min().unwrap()
}

#[test]
fn intervals_and_their_points_hold_in_exact_arithmetic() {
    for [a, b] in pairs(20, 0) {
        let told = format!("{} and {}", a.built.name, b.built.name);
        let [x, y] = [&a, &b].map(|d| Model::new(&d.built.file, Bytes(1 << 20)).unwrap());
        let (t, u) = (a.corners(), b.corners());
        let truth = t.iter().flat_map(|t| u.iter().map(|u| apart(t, u))).min().unwrap();
        let still = Pose::IDENTITY;
        for error in [0.0, 0.01 * a.built.diagonal()] {
            let question = Question { error, above: None, most_pairs: 1 << 20 };
            let answer = distance(&x, &y, [&still, &still], &question, &mut |_| true).unwrap();
            let square = |x: f64| exact(x) * exact(x);
            assert!(square(answer.lower) <= truth && truth <= square(answer.upper), "{told}: {answer:?}");
            // What is told of rounding is what an answer is wide for it.
            let width = answer.upper - answer.lower;
            assert!(width <= error.max(2.0 * answer.rounding + 1e-14 * answer.upper), "{told}: {answer:?}");
            let closest_points = answer.closest_points.unwrap();
            for (model, i) in [(&a, 0), (&b, 1)] {
                let (point, error) = (closest_points.points[i], closest_points.errors[i]);
                assert!(is_root(&model.squared_from(point), 0.0, error), "{told}: {closest_points:?}");
            }
        }
    }
}

#[test]
fn contacts_hold_in_exact_arithmetic() {
    let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for offset in [[0.1, 0.2, 0.3], [4.5e6 + 0.123, -3.1e6, 1.7e6], [1e9 + 0.5, 1e9, -1e9]] {
        let a = Doubles::new("first", &hand::icosphere(1), 1.1 / 3.0, offset);
        let [x, y, z] = offset;
        let b = Doubles::new("second", &hand::icosphere(0), 1.2 / 3.0, [x + 0.9, y + 0.07, z - 0.03]);
        let [x, y] = [&a, &b].map(|d| Model::new(&d.built.file, Bytes(1 << 20)).unwrap());
        let (still, near) = (Pose::IDENTITY, Near { within: 0.3, error: 0.0, limit: 1 << 16 });
        let found = contacts(&x, &y, [&still, &still], &near, &pool, &mut |_| true).unwrap();
        let (t, u) = (a.corners(), b.corners());
        let squares: Vec<Relaxed> = t.iter().flat_map(|t| u.iter().map(|u| apart(t, u))).collect();
        let count =
            |within: f64| squares.iter().filter(|s| **s <= exact(within) * exact(within)).count() as u64;
        let (lower, upper) = (count(near.within), count(found.farthest));
        assert!(lower > 0 && lower <= found.pairs && found.pairs <= upper, "{lower} {} {upper}", found.pairs);
        assert!(found.farthest <= near.within + 2.0 * found.rounding * (1.0 + 1e-9) + 1e-12, "{found:?}");
        let square = |x: f64| exact(x) * exact(x);
        let truth = squares.iter().min().unwrap();
        let nearest = found.regions.iter().map(|region| region.lower).fold(f64::INFINITY, f64::min);
        assert!(square(nearest) <= *truth && *truth <= square(found.regions[0].upper));
        for region in &found.regions {
            for (model, i) in [(&a, 0), (&b, 1)] {
                let (point, error) = (region.closest_points.points[i], region.closest_points.errors[i]);
                assert!(is_root(&model.squared_from(point), 0.0, error), "{region:?}");
            }
        }
    }
}
