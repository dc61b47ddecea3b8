//! What coarse meshes prove of the source: misses, and lower bounds of hits.

use super::scene::{ROOM, built, cast, mesh_within, rays_at};
use chpm_rays::{Bound, Caster, Ray, Seek};
use chpm_synth::hard::CASES;
use chpm_synth::{Shape, Synth};

#[test]
fn no_ray_meets_the_source_before_the_proven_bound() {
    let mut tight = [0; 2];
    let meshes = CASES.iter().map(|case| (case.name, case.mesh(1500)));
    for (name, mesh) in meshes.chain([("torus", Synth::new(Shape::Torus, 6000, 2).to_mesh())]) {
        let file = built(&mesh);
        let largest = file.groups().iter().map(|group| f64::from(group.max_error)).fold(0.0, f64::max);
        let rays = rays_at(&mesh_within(&file, -1.0), 300, 9);
        let source = cast(&file, &rays, &Bound::LEAVES, Seek::Nearest);
        for share in [0.0, 0.01, 0.1, 1.0] {
            let bound = Bound::within(share * largest);
            let distance = Caster::new(&file, ROOM).distance(&bound).unwrap();
            let proven = cast(&file, &rays, &bound, Seek::Within(distance));
            for ((ray, (_, hit)), (_, lower)) in rays.iter().zip(&source).zip(&proven) {
                assert!(
                    lower <= hit,
                    "{name} at {share}: {ray:?} meets the source at {hit}, not from {lower} on"
                );
                tight[0] += usize::from(hit.is_finite() && *lower > 0.9 * hit);
                tight[1] += usize::from(lower.is_infinite());
            }
        }
    }
    // Bounds of 0 would prove nothing.
    assert!(tight[0] > 5000 && tight[1] > 1000, "{tight:?}");
}

#[test]
fn the_distance_of_the_leaves_is_their_rounding() {
    let file = built(&Synth::new(Shape::Sphere, 3000, 2).to_mesh());
    let caster = Caster::new(&file, ROOM);
    assert_eq!(caster.distance(&Bound::LEAVES).unwrap(), 0.0);
    let largest = file.groups().iter().map(|group| f64::from(group.max_error)).fold(0.0, f64::max);
    assert!(caster.distance(&Bound::within(f64::INFINITY)).unwrap() >= largest);
}

/// A ray at a known distance from one sheet.
#[test]
fn a_ray_comes_near_where_it_should() {
    let mut mesh = chpm_synth::hand::grid(8, 8);
    mesh.positions.iter_mut().for_each(|p| p[2] = 0.0);
    let file = built(&mesh);
    let high = mesh.positions.iter().map(|p| f64::from(p[0])).fold(0.0, f64::max);
    let middle = [0.4 * high, 0.4 * high, 2.0];
    let down = Ray::new(middle, [0.0, 0.0, -1.0]);
    let beside = Ray::new([-0.3, 0.4 * high, 2.0], [0.0, 0.0, -1.0]);
    let level = Ray::new([-5.0, 0.4 * high, 0.1], [1.0, 0.0, 0.0]);
    let far = Ray::new([-5.0, 0.4 * high, 0.6], [1.0, 0.0, 0.0]);
    let got = cast(&file, &[down, beside, level, far], &Bound::LEAVES, Seek::Within(0.5));
    let expected = [1.5, 2.0 - 0.16_f64.sqrt(), 5.0 - 0.24_f64.sqrt(), f64::INFINITY];
    for ((_, got), expected) in got.iter().zip(expected) {
        assert!(got == &expected || (expected - got).abs() < 1e-6 && *got <= expected, "{got} {expected}");
    }
}
