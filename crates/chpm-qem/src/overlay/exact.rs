//! The oracle of the bound: the same map in exact rational arithmetic, with none of its code. Every displacement that the map makes
//! has to be in the box that was stored, to the last bit.

use super::Overlay;
use crate::displacement::Displacement;
use crate::ring::{NO_FACE, Ring};
use dashu_ratio::RBig;
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;
use std::cmp::Ordering;

/// A point along the normal: its place across and its height, so that the point is `(x, y, 0) + height * normal` with the
/// third axis last.
#[derive(Clone, Debug)]
struct ExactPoint {
    x: RBig,
    y: RBig,
    height: RBig,
}

/// A corner of what two faces have in common: how far it goes along the normal, and its share of u.
struct Corner {
    along: RBig,
    of_u: RBig,
}

fn exact(x: f64) -> RBig {
    RBig::try_from(x).expect("a finite number")
}

fn exact3(p: [f64; 3]) -> [RBig; 3] {
    p.map(exact)
}

/// The one-rings about a loop, exactly.
struct BothOneRings {
    normal: [RBig; 3],
    /// Motion of u within the plane, before it goes along the normal.
    slide: [RBig; 3],
    /// u, once it has slid.
    foot: ExactPoint,
    ring: Vec<ExactPoint>,
}

impl BothOneRings {
    fn new(ring: &Ring, normal: Vector3<f64>, slide: [RBig; 3]) -> Self {
        // Across the axis that the normal is nearest to.
        let third = normal.iamax();
        let axes = [(third + 1) % 3, (third + 2) % 3, third];
        let normal = exact3(normal.into());
        let apex = exact3(ring.apex().coords.into());
        let foot = place([0, 1, 2].map(|axis| &apex[axis] + &slide[axis]), &axes, &normal);
        let ring =
            (0..ring.len()).map(|i| place(exact3(ring.point(i).coords.into()), &axes, &normal)).collect();
        BothOneRings { normal, slide, foot, ring }
    }

    /// The corners of what old face `old` and new face `new` have in common; none where that is no more than an edge.
    fn overlap(&self, old: usize, new: usize) -> Vec<Corner> {
        let before = [&self.foot, &self.ring[old], &self.ring[(old + 1) % self.ring.len()]];
        let after = [&self.ring[0], &self.ring[new], &self.ring[new + 1]];
        let mut polygon: Vec<ExactPoint> = before.into_iter().cloned().collect();

        let sense = area(after[0], after[1], after[2]).cmp(&RBig::ZERO);
        for side in 0..3 {
            polygon = clip(&polygon, after[side], after[(side + 1) % 3], sense);
        }

        // Faces that only touch have no cell in common.
        let twice: RBig = polygon
            .iter()
            .zip(polygon.iter().cycle().skip(1))
            .map(|(p, q)| &p.x * &q.y - &p.y * &q.x)
            .fold(RBig::ZERO, |sum, part| sum + part);
        if twice == RBig::ZERO {
            return vec![];
        }

        polygon
            .iter()
            .map(|at| {
                let (of_u, from) = height_over(before, at);
                let (_, to) = height_over(after, at);
                Corner { along: to - from, of_u }
            })
            .collect()
    }
}

fn place(p: [RBig; 3], axes: &[usize; 3], normal: &[RBig; 3]) -> ExactPoint {
    let height = &p[axes[2]] / &normal[axes[2]];
    let across = |axis: usize| &p[axis] - &height * &normal[axis];
    ExactPoint { x: across(axes[0]), y: across(axes[1]), height }
}

fn area(a: &ExactPoint, b: &ExactPoint, c: &ExactPoint) -> RBig {
    (&b.x - &a.x) * (&c.y - &a.y) - (&b.y - &a.y) * (&c.x - &a.x)
}

/// Part of a convex polygon on the inner side of a line.
fn clip(polygon: &[ExactPoint], a: &ExactPoint, b: &ExactPoint, sense: Ordering) -> Vec<ExactPoint> {
    let beside: Vec<RBig> = polygon.iter().map(|p| area(a, b, p)).collect();
    let is_in = |i: usize| beside[i].cmp(&RBig::ZERO) != sense.reverse();

    let mut left = Vec::new();
    for i in 0..polygon.len() {
        let next = (i + 1) % polygon.len();
        if is_in(i) {
            left.push(polygon[i].clone());
        }
        if is_in(i) != is_in(next) && beside[i] != beside[next] {
            let share = &beside[i] / (&beside[i] - &beside[next]);
            fn between(p: &RBig, q: &RBig, share: &RBig) -> RBig {
                p + share * (q - p)
            }
            let (p, q) = (&polygon[i], &polygon[next]);
            left.push(ExactPoint {
                x: between(&p.x, &q.x, &share),
                y: between(&p.y, &q.y, &share),
                height: between(&p.height, &q.height, &share),
            });
        }
    }

    left
}

/// The share that a triangle's first corner has of a place in it, and the triangle's height there.
fn height_over([a, b, c]: [&ExactPoint; 3], at: &ExactPoint) -> (RBig, RBig) {
    let whole = area(a, b, c);
    let shares = [area(at, b, c) / &whole, area(a, at, c) / &whole, area(a, b, at) / &whole];
    let height = &shares[0] * &a.height + &shares[1] * &b.height + &shares[2] * &c.height;
    let [first, ..] = shares;
    (first, height)
}

/// Where u slides to: nowhere inside the mesh; on its boundary to the line that its edges become, at the share that was stored.
fn slide(overlay: &Overlay, ring: &Ring) -> [RBig; 3] {
    let last = ring.len() - 1;
    let other = match [ring.faces()[0] == NO_FACE, ring.faces()[last] == NO_FACE] {
        [false, false] => return [RBig::ZERO, RBig::ZERO, RBig::ZERO],
        [true, _] => 1,
        [_, true] => last,
    };
    let share = exact(overlay.laid.expect("a bound").share.expect("a share"));
    let [u, a, b] = [ring.apex(), ring.point(0), ring.point(other)].map(|p| exact3(p.coords.into()));
    let along = [0, 1, 2].map(|axis| &b[axis] - &a[axis]);
    let from = [0, 1, 2].map(|axis| &u[axis] - &a[axis]);
    let crosses = |i: usize, j: usize| &along[i] * &from[j] == &along[j] * &from[i];
    // On the line already: it stays, and the stored share only says where about that is.
    if crosses(0, 1) && crosses(1, 2) && crosses(2, 0) {
        return [RBig::ZERO, RBig::ZERO, RBig::ZERO];
    }
    [0, 1, 2].map(|axis| &share * &along[axis] - &from[axis])
}

/// Bounds the collapse along a normal and holds every box against the exact map. False if the one-rings do not lie over each other.
fn check(overlay: &mut Overlay, ring: &Ring, normal: Vector3<f64>, before: &[Displacement]) -> bool {
    let mut bounds = Vec::new();
    if !overlay.bound_along(normal, ring, before, &mut bounds) {
        return false;
    }

    let unit = normal.try_normalize(0.0).expect("a direction");
    let fans = BothOneRings::new(ring, unit, slide(overlay, ring));
    for new in 1..ring.len() - 1 {
        let (face, stored) = bounds[new - 1];
        assert_eq!(face, ring.faces()[new]);
        let faces = (0..ring.len()).filter(|old| ring.faces()[*old] != NO_FACE);

        for (old, corner) in faces.flat_map(|old| fans.overlap(old, new).into_iter().map(move |c| (old, c))) {
            let of = before[ring.faces()[old] as usize].ends();
            let stored = stored.ends();
            for axis in 0..3 {
                let by = &corner.of_u * &fans.slide[axis] + &corner.along * &fans.normal[axis];
                let [least, most] = of.map(|end| exact(end[axis].into()) + &by);
                let [low, high] = stored.map(|end| exact(end[axis].into()));
                assert!(
                    low <= least && most <= high,
                    "old face {old}, new face {new}, axis {axis}: {} to {} is not in {} to {}",
                    least.to_f64().value(),
                    most.to_f64().value(),
                    stored[0][axis],
                    stored[1][axis],
                );
            }
        }
    }
    true
}

/// A one-ring in a plane of any tilt: how flat it is in one direction of the plane, and how far from the plane its vertices are.
#[derive(Clone, Debug)]
struct OneRing {
    tilt: [f64; 3],
    /// Turn to the next vertex and distance from u, both as shares.
    ring: Vec<(f64, f64)>,
    squash: f64,
    heights: Vec<f64>,
    roughness: f64,
    /// Displacements that the faces have.
    before: Vec<([f64; 3], [f64; 3])>,
    open: Option<bool>,
    /// So far behind u, seen from v, is a vertex: whether u is to the left or to the right of the edge there is up to rounding.
    behind: Option<f64>,
}

impl OneRing {
    fn strategy() -> impl Strategy<Value = OneRing> {
        fn unit() -> prop::array::UniformArrayStrategy<std::ops::Range<f64>, [f64; 3]> {
            prop::array::uniform3(-1.0..1.0f64)
        }
        let squash = prop_oneof![Just(1.0), Just(1e-4), Just(1e-8), Just(3e-10)];
        let roughness = prop_oneof![Just(1.0), Just(0.01), Just(1e-7), Just(1e-13), Just(0.0)];
        let any = (squash, roughness, prop::option::of(any::<bool>()));
        // Where areas are so small, what rounding does to a place on an edge is the most.
        let sliver = (prop_oneof![Just(1e-9), Just(3e-10), Just(1e-10)], Just(1.0), Just(None));
        let ring = prop::collection::vec((0.2..1.0f64, 0.3..1.0f64), 3..7);
        let kind = prop_oneof![3 => any, 1 => sliver];
        let behind = prop_oneof![3 => Just(None), 1 => (0.3..1.0f64).prop_map(Some)];
        (ring, unit(), kind, prop::collection::vec(-1.0..1.0f64, 8), behind)
            .prop_flat_map(move |(ring, tilt, kind, heights, behind)| {
                let count = ring.len();
                let before = prop::collection::vec((unit(), unit()), count);
                (Just((ring, tilt, kind, heights, behind)), before)
            })
            .prop_map(|((ring, tilt, (squash, roughness, open), heights, behind), before)| OneRing {
                tilt,
                ring,
                squash,
                heights,
                roughness,
                before,
                open,
                behind,
            })
    }

    fn lay(&self) -> (Ring, Vector3<f64>, Vec<Displacement>) {
        let normal = Vector3::from(self.tilt).try_normalize(1e-3).unwrap_or(Vector3::z());
        let axis = Vector3::ith(normal.iamin(), 1.0);
        let x = normal.cross(&axis).normalize();
        let y = normal.cross(&x);
        let count = self.ring.len();
        let mut ring = Ring::default();
        let apex = Point3::new(0.1, -0.7, 0.4);
        let turns: f64 = self.ring.iter().map(|(turn, _)| turn).sum();
        // An open fan is a half turn, from one end to the other.
        let whole = if self.open.is_some() { std::f64::consts::PI } else { std::f64::consts::TAU };
        let scale = whole / (turns - if self.open.is_some() { self.ring[0].0 } else { 0.0 });
        let mut angle = 0.0;
        let mut places: Vec<Point3<f64>> = Vec::new();
        let mut behind = self.behind.filter(|_| self.open.is_none());
        for (i, (turn, reach)) in self.ring.iter().enumerate() {
            if i > 0 {
                angle += turn * scale;
            }
            if i > 1
                && angle > std::f64::consts::FRAC_PI_2
                && let Some(far) = behind.take()
            {
                let across = (apex - places[0]) - normal * normal.dot(&(apex - places[0]));
                places.push(apex + across * far + normal * (self.heights[i] * self.roughness));
                continue;
            }
            let across = x * (angle.cos() * reach) + y * (angle.sin() * reach * self.squash);
            places.push(apex + across + normal * (self.heights[i] * self.roughness));
        }
        // v is the first of the loop. The edge that has no face leads from v, or to it.
        let no_face = match self.open {
            None => None,
            Some(true) => {
                // v is at the end of the half turn, and the other end follows it.
                places.rotate_right(1);
                Some(0)
            }
            Some(false) => Some(count - 1),
        };
        for i in 0..places.len() {
            let face = if Some(i) == no_face { NO_FACE } else { i as u32 };
            ring.push(i as u16, face);
        }
        ring.turn_to(0, apex.coords.into(), |vertex| places[usize::from(vertex)].coords.into());
        let size = self.roughness.max(1e-13);
        (
            ring,
            normal,
            self.before
                .iter()
                .map(|(a, b)| {
                    let (a, b) = (Vector3::from(*a) * size, Vector3::from(*b) * size);
                    Displacement::default().moved(a.inf(&b), a.sup(&b))
                })
                .collect(),
        )
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn boxes_hold_the_exact_map(one_ring in OneRing::strategy(), displaced in any::<bool>()) {
        let (ring, normal, mut before) = one_ring.lay();
        if !displaced {
            before.fill(Displacement::default());
        }
        check(&mut Overlay::default(), &ring, normal, &before);
    }
}

/// The property above says something: most one-rings lie over each other, of every kind.
#[test]
fn the_oracle_is_asked() {
    let base = OneRing {
        tilt: [0.3, -0.5, 0.6],
        ring: vec![(0.5, 0.8), (0.4, 0.8), (0.5, 0.8), (0.6, 0.8), (0.45, 0.8)],
        squash: 1.0,
        heights: vec![0.2, -0.7, 0.4, 0.9, -0.3, 0.1, 0.6, -0.2],
        roughness: 1e-13,
        before: vec![([0.1; 3], [-0.2; 3]); 5],
        open: None,
        behind: None,
    };

    for (squash, roughness) in [(1.0, 1.0), (1.0, 1e-13), (1e-8, 1.0), (1e-8, 1e-7), (1e-9, 0.01)] {
        for open in [None, Some(true), Some(false)] {
            let one_ring = OneRing { squash, roughness, open, ..base.clone() };
            let (ring, normal, before) = one_ring.lay();
            assert!(check(&mut Overlay::default(), &ring, normal, &before), "{squash} {roughness} {open:?}");
        }
    }
}

/// On which side of an edge from v such a u is, rounding decides, and either way no old face's box may be left out.
#[test]
fn a_vertex_behind_u_is_on_either_side() {
    let mut uncertain = 0;
    for step in 0..200 {
        let far = 0.3 + 0.003 * f64::from(step);
        let one_ring = OneRing {
            tilt: [0.3 - 0.002 * f64::from(step), -0.5, 0.6],
            ring: vec![(0.5, 0.8), (0.4, 0.8), (0.5, far), (0.6, 0.8), (0.45, 0.8)],
            squash: 1.0,
            heights: vec![0.2, -0.7, 0.4, 0.9, -0.3, 0.1, 0.6, -0.2],
            roughness: 1e-13,
            before: (1..6).map(|i| ([0.2 * f64::from(i); 3], [0.0; 3])).collect(),
            open: None,
            behind: Some(far),
        };
        let (ring, normal, before) = one_ring.lay();
        let mut overlay = Overlay::default();
        assert!(check(&mut overlay, &ring, normal, &before), "{far}");
        uncertain += u32::from(overlay.sectors().count() > 1);
    }
    assert!(uncertain > 150, "{uncertain}");
}
