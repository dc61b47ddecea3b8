//! Nothing gets out of a closed surface, wherever it is aimed and whatever the levels.

use super::scene::{Dice, File, built, cast, less, mesh_within};
use chpm_rays::{Bound, Ray, Seek};
use chpm_synth::{Shape, Synth, hand};

/// Rays from inside at vertices, points of edges, and faces of the meshes of several bounds.
fn rays(file: &File, inside: [f64; 3], count: usize, dice: &mut Dice) -> Vec<Ray> {
    let largest = file.groups().iter().map(|group| f64::from(group.max_error)).fold(0.0, f64::max);
    let meshes: Vec<_> = [-1.0, 0.02, 0.2, 2.0].map(|share| mesh_within(file, share * largest)).into();
    (0..count)
        .map(|number| {
            let mesh = &meshes[dice.below(meshes.len())];
            let (corners, ..) = mesh[dice.below(mesh.len())];
            let [a, b, c] = corners.map(|corner| corner.map(f64::from));
            let (s, t) = (dice.share(), dice.share());
            let target: [f64; 3] = match number % 4 {
                0 | 1 => a,
                2 => std::array::from_fn(|i| a[i] + s * (b[i] - a[i])),
                _ => std::array::from_fn(|i| a[i] + s * t * (b[i] - a[i]) + s * (1.0 - t) * (c[i] - a[i])),
            };
            Ray::new(inside, less(target, inside))
        })
        .collect()
}

fn bounds(file: &File, eye: [f64; 3]) -> Vec<Bound> {
    let largest = file.groups().iter().map(|group| f64::from(group.max_error)).fold(0.0, f64::max);
    vec![
        Bound::LEAVES,
        Bound::within(0.02 * largest),
        Bound::within(0.2 * largest),
        // From the leaves on one side to the root's error on the other.
        Bound::from_eye(eye, 0.1 * largest),
        Bound::from_eye(eye, 0.3 * largest),
        Bound { spread: 0.1 * largest, ..Bound::from_eye(eye, 0.05 * largest) },
    ]
}

#[test]
fn nothing_leaks_out_of_closed_surfaces() {
    let mut dice = Dice(11);
    let mut cast_rays = 0;
    let sphere = Synth::new(Shape::Sphere, 6000, 1).to_mesh();
    for (mesh, inside, many) in [
        (sphere, [[0.0; 3], [0.3, -0.2, 0.1]], 80_000),
        (hand::icosphere(4), [[0.0; 3], [0.1, 0.2, -0.3]], 20_000),
    ] {
        let file = built(&mesh);
        for inside in inside {
            for bound in bounds(&file, [1.5, 0.4, 0.2]) {
                let rays = rays(&file, inside, many, &mut dice);
                cast_rays += rays.len();
                let missed =
                    cast(&file, &rays, &bound, Seek::Nearest).iter().filter(|(hit, _)| hit.is_none()).count();
                assert_eq!(missed, 0, "of {} rays from {inside:?} at {bound:?}", rays.len());
            }
        }
    }
    assert!(cast_rays > 1_000_000, "{cast_rays}");
}

/// Meshes of mixed levels have clusters of several.
#[test]
fn bounds_that_grow_mix_levels() {
    let file = built(&Synth::new(Shape::Sphere, 6000, 1).to_mesh());
    let mut dice = Dice(3);
    let rays = rays(&file, [0.0; 3], 4000, &mut dice);
    for bound in &bounds(&file, [1.5, 0.4, 0.2])[3..] {
        let hits = cast(&file, &rays, bound, Seek::Nearest);
        let mut levels: Vec<u32> = hits
            .iter()
            .filter_map(|(hit, _)| hit.map(|hit| file.clusters()[hit.cluster.index()].level))
            .collect();
        levels.sort_unstable();
        levels.dedup();
        assert!(levels.len() > 1, "{bound:?}: {levels:?}");
    }
}

/// From a vertex, its own triangles are not met.
#[test]
fn a_ray_from_a_vertex_leaves_it() {
    let file = built(&hand::icosphere(3));
    let mesh = mesh_within(&file, -1.0);
    for (corners, ..) in &mesh {
        let from = corners[0].map(f64::from);
        let inward = from.map(|x| -x);
        let ray = Ray { is_from_vertex: true, ..Ray::new(from, inward) };
        let outward = Ray { direction: from, ..ray };
        let hits = cast(&file, &[ray, outward], &Bound::LEAVES, Seek::Nearest);
        let across = hits[0].0.expect("the other side").distance;
        assert!((1.9..2.01).contains(&across), "{across}");
        assert_eq!(hits[1].0, None);
    }
}
