//! The oracle of errors that are found anew: distances of many points in exact rational arithmetic, with none of the code that they judge.

use super::LOSS;
use super::chain::Chain;
use super::pieces::Pieces;
use super::reference::Reference;
use super::surfaces::{Few, Own};
use super::target::Target;
use super::tree::{BoxTree, Search};
use chpm_mesh::geom::to_f64;
use dashu_ratio::RBig;
use nalgebra::Point3;
use proptest::prelude::*;

type Exact = [RBig; 3];

fn exact(x: f64) -> RBig {
    RBig::try_from(x).expect("a finite number")
}

fn place(p: [f32; 3]) -> Exact {
    p.map(|x| exact(f64::from(x)))
}

fn minus(a: &Exact, b: &Exact) -> Exact {
    [0, 1, 2].map(|i| &a[i] - &b[i])
}

fn dot(a: &Exact, b: &Exact) -> RBig {
    (0..3).fold(RBig::ZERO, |sum, i| sum + &a[i] * &b[i])
}

/// `a + x * s`
fn along(a: &Exact, x: &Exact, s: &RBig) -> Exact {
    [0, 1, 2].map(|i| &a[i] + &x[i] * s)
}

/// The square of the distance of a point from a triangle.
fn squared(point: &Exact, [a, b, c]: &[Exact; 3]) -> RBig {
    let (ab, ac, to) = (minus(b, a), minus(c, a), minus(point, a));
    let (bb, bc, cc) = (dot(&ab, &ab), dot(&ab, &ac), dot(&ac, &ac));
    let (p, q) = (dot(&ab, &to), dot(&ac, &to));
    let area = &bb * &cc - &bc * &bc;
    let (s, t) = (&cc * &p - &bc * &q, &bb * &q - &bc * &p);
    if area > RBig::ZERO && s >= RBig::ZERO && t >= RBig::ZERO && &s + &t <= area {
        let foot = along(&along(a, &ab, &(&s / &area)), &ac, &(&t / &area));
        let way = minus(point, &foot);
        return dot(&way, &way);
    }
    let edges = [(a, b), (b, c), (c, a)];
    let squares = edges.map(|(from, to)| {
        let edge = minus(to, from);
        let length = dot(&edge, &edge);
        let mut share = RBig::ZERO;
        if length > RBig::ZERO {
            share = (dot(&edge, &minus(point, from)) / length).clamp(RBig::ZERO, RBig::ONE);
        }
        let way = minus(point, &along(from, &edge, &share));
        dot(&way, &way)
    });
    squares.into_iter().min().expect("three edges")
}

/// Points of a triangle: its corners, and some between them.
fn points([a, b, c]: &[Exact; 3]) -> Vec<Exact> {
    const STEPS: u32 = 5;
    let (ab, ac) = (minus(b, a), minus(c, a));
    let share = |i: u32| RBig::from(i) / RBig::from(STEPS);
    let pairs = (0..=STEPS).flat_map(|i| (0..=STEPS - i).map(move |j| (i, j)));
    pairs.map(|(i, j)| along(&along(a, &ab, &share(i)), &ac, &share(j))).collect()
}

/// A rough sheet of 3 x 3 squares about the face, or a soup.
fn sheet() -> impl Strategy<Value = Reference> {
    let heights = prop::collection::vec(-0.3f32..0.3, 16);
    let errors = prop::collection::vec(0.0f32..0.1, 18);
    (heights, errors, prop::sample::select(vec![0.0f32, 1e3, 1e6]), 1e-3f32..1.0, any::<bool>()).prop_map(
        |(heights, errors, offset, flat, is_soup)| {
            let mut reference = Reference::default();
            let points: Vec<[f32; 3]> = (0..16)
                .map(|i| {
                    let height = heights[i] * flat;
                    let shift = if is_soup { 3.0 * heights[15 - i] } else { heights[15 - i] };
                    [offset + (i % 4) as f32 - 1.0 + shift, (i / 4) as f32 - 1.0, height]
                })
                .collect();
            let squares = (0..9_u16).map(|i| 4 * (i / 3) + i % 3);
            let corners = squares.flat_map(|a| [[a, a + 1, a + 5], [a, a + 5, a + 4]]);
            reference.add(&points, corners.zip(errors.iter().copied()));
            reference.join();
            reference
        },
    )
}

fn triangles(reference: &Reference) -> Vec<[[f32; 3]; 3]> {
    reference.triangles.iter().map(|t| t.map(|v| reference.points[v as usize])).collect()
}

/// Three of its points: a face as a collapse would leave one.
fn face(reference: &Reference, of: [usize; 3]) -> [[f32; 3]; 3] {
    of.map(|i| reference.points[i * (reference.points.len() - 1) / 15])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// Every point of a face is as near to some triangle of the reference, with its error, as is said.
    #[test]
    fn pieces_hold_all_of_a_face(
        reference in sheet(),
        of in prop::array::uniform3(0usize..16),
        lift in -0.5f32..0.5,
        allowed in 0.0f64..0.5,
        enough in 0.0f64..0.5,
    ) {
        let mut face = face(&reference, of);
        face[0][2] += lift;
        let targets: Vec<Target> = triangles(&reference).iter().map(|t| Target::new(t.map(to_f64))).collect();
        let (tree, mut search) = (BoxTree::new(&targets, (0..targets.len() as u32).collect()), Search::default());
        let errors = &reference.errors;
        let mut own = Own { targets: &targets, tree: &tree, search: &mut search, errors, enough: enough * enough };
        let corners: [Point3<f64>; 3] = face.map(to_f64);
        let served = corners.map(|point| {
            let (index, squared) = super::pieces::Surface::nearest(&mut own, &point, (0, f64::INFINITY));
            (index, squared.sqrt())
        });
        let far = Pieces::default().reach(corners, served, allowed, &mut own) + LOSS * reference.scale();
        let exactly: Vec<[Exact; 3]> = triangles(&reference).iter().map(|t| t.map(place)).collect();
        for point in points(&face.map(place)) {
            let near = exactly.iter().zip(&reference.errors).any(|(triangle, error)| {
                let left = exact(far) - exact(f64::from(*error));
                left >= RBig::ZERO && squared(&point, triangle) <= &left * &left
            });
            prop_assert!(near, "{point:?} is not within {far}");
        }
    }

    /// Where triangles are said to lie over a face, every point of it is as near to one of them, with its error, as was allowed, or in a part that is steep.
    #[test]
    fn a_sheet_holds_all_of_a_face(
        reference in sheet(),
        of in prop::array::uniform3(0usize..16),
        lift in -0.5f32..0.5,
        allowed in 0.0f64..0.7,
        kept in prop::collection::vec(prop::bool::weighted(0.95), 18),
    ) {
        let mut face = face(&reference, of);
        face[0][2] += lift;
        let over = (0..reference.triangle_count() as u32).filter(|index| kept[*index as usize % 18]);
        let over: Vec<u32> = over.collect();
        let (mut chain, loss) = (Chain::default(), LOSS * reference.scale());
        let Some(beyond) = chain.hold(&face.map(to_f64), &reference, &over, allowed, loss) else { return Ok(()) };
        let exactly: Vec<[Exact; 3]> = triangles(&reference).iter().map(|t| t.map(place)).collect();
        let steep: Vec<[Exact; 3]> =
            chain.steep.iter().map(|part| part.map(|p| [p.x, p.y, p.z].map(exact))).collect();
        let around = exact(beyond + loss);
        for point in points(&face.map(place)) {
            let near = exactly.iter().zip(&reference.errors).any(|(triangle, error)| {
                let left = exact(allowed + loss) - exact(f64::from(*error));
                left >= RBig::ZERO && squared(&point, triangle) <= &left * &left
            });
            let is_steep = || steep.iter().any(|part| squared(&point, part) <= &around * &around);
            prop_assert!(near || is_steep(), "{point:?} is not within {allowed}");
        }
    }

    /// No point of a triangle is farther than its pieces are said to be.
    #[test]
    fn pieces_hold_all_of_a_triangle(
        reference in sheet(),
        of in prop::array::uniform3(0usize..16),
        lift in -0.5f32..0.5,
        allowed in 0.0f64..0.5,
    ) {
        let mut triangle = face(&reference, of);
        triangle[0][2] += lift;
        let targets: Vec<Target> = triangles(&reference).iter().map(|t| Target::new(t.map(to_f64))).collect();
        let all: Vec<u32> = (0..targets.len() as u32).collect();
        let mut few = Few { targets: &targets, of: &all, beyond: 0.25 };
        let corners: [Point3<f64>; 3] = triangle.map(to_f64);
        let served = corners.map(|point| {
            let (index, squared) = super::pieces::Surface::nearest(&mut few, &point, (0, f64::INFINITY));
            (index, squared.sqrt())
        });
        let far = Pieces::default().reach(corners, served, allowed, &mut few);
        let reach = exact(far + LOSS * reference.scale() - 0.25);
        let exactly: Vec<[Exact; 3]> = triangles(&reference).iter().map(|t| t.map(place)).collect();
        for point in points(&triangle.map(place)) {
            let near = exactly.iter().any(|target| squared(&point, target) <= &reach * &reach);
            prop_assert!(near, "{point:?} is not within {far}");
        }
    }
}
