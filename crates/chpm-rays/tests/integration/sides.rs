//! What is turned inside out, where components lie beside, in and across each other.

use crate::scene::{ROOM, built};
use chpm_mesh::TriMesh;
use chpm_rays::{Caster, Sides};
use chpm_synth::{Shape, Synth};

/// Balls about points of the x axis, of some radius, turned inside out or not: components, and how many are turned.
fn told(balls: &[(f32, f32, bool)]) -> (u64, u64) {
    let places: Vec<_> = balls.iter().map(|(x, radius, turn)| ([*x, 0.0, 0.0], *radius, *turn)).collect();
    told_at(&places)
}

/// The same about any points.
fn told_at(balls: &[([f32; 3], f32, bool)]) -> (u64, u64) {
    let ball = Synth::new(Shape::Sphere, 1500, 0).to_mesh();
    let mut all = TriMesh::default();
    for ([x, y, z], radius, is_turned) in balls {
        let first = all.positions.len() as u32;
        all.positions
            .extend(ball.positions.iter().map(|[a, b, c]| [radius * a + x, radius * b + y, radius * c + z]));
        let turn = |[a, b, c]: [u32; 3]| if *is_turned { [a, c, b] } else { [a, b, c] };
        all.triangles
            .extend(ball.triangles.iter().map(|corners| turn(*corners).map(|corner| corner + first)));
    }
    let file = built(&all);
    let sides = Sides::find(&mut Caster::new(&file, ROOM), &|| true).unwrap();
    (sides.components, sides.turned_components)
}

#[test]
fn components_that_overlap_are_judged_each_by_itself() {
    for x in [-1.5, -0.9, -0.5, -0.2, 0.2, 0.5, 0.9, 1.5, 2.5] {
        for (first, second) in [(false, false), (false, true), (true, false), (true, true)] {
            let expected = u64::from(first) + u64::from(second);
            let found = told(&[(0.0, 1.0, first), (x, 1.0, second)]);
            assert_eq!(found, (2, expected), "{x} {first} {second}");
        }
        // A smaller one that reaches out of it; both lie in a hollow ball.
        if x.abs() > 0.4 && x.abs() < 1.2 {
            assert_eq!(told(&[(0.0, 1.0, false), (x, 0.7, true)]), (2, 1), "{x}");
            let hollow = [(0.0, 9.0, false), (0.0, 8.0, true), (0.0, 1.0, false), (x, 0.9, true)];
            assert_eq!(told(&hollow), (4, 1), "{x}");
        }
    }
    // Boxes of small ones lie in the other's, and they do not: they reach out of it, or are beside it.
    for x in [-0.8, -0.6, 0.6, 0.8] {
        assert_eq!(told_at(&[([0.0; 3], 1.0, false), ([x; 3], 0.15, true)]), (2, 1), "{x}");
    }
}

#[test]
fn walls_of_cavities_stay_and_turn_with_what_they_are_in() {
    for x in [-0.5, 0.0, 0.5] {
        let shell = |turn: bool| [(0.0, 1.0, turn), (x, 0.4, !turn)];
        assert_eq!((told(&shell(false)), told(&shell(true))), ((2, 0), (2, 2)), "{x}");
        // A ball in the cavity, two cavities side by side, one that was turned with what is around it.
        assert_eq!(told(&[(0.0, 1.0, false), (x, 0.4, true), (x, 0.2, false)]), (3, 0));
    }
    assert_eq!(told(&[(0.0, 1.0, false), (-0.5, 0.3, true), (0.5, 0.3, true)]), (3, 0));
    assert_eq!(told(&[(0.0, 1.0, true), (-0.5, 0.3, false), (0.5, 0.3, false)]), (3, 3));
}
