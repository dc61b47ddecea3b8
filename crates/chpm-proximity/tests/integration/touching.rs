//! Contacts and crossings against looking at every pair of triangles.

use crate::brute;
use crate::site::{Built, Random};
use chpm_mesh::{Bytes, TriMesh};
use chpm_proximity::contacts::Near;
use chpm_proximity::{Contacts, Crossing, Model, Pose, ProximityError, contacts, crossings};
use chpm_synth::hard::Case;
use chpm_synth::{Shape, Synth, hand};
use nalgebra::Vector3;
use rayon::{ThreadPool, ThreadPoolBuilder};

fn pool() -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(2).build().unwrap()
}

pub(crate) fn find(a: &Built, b: &Built, pose: &Pose, near: &Near) -> Contacts {
    let [x, y] = [a, b].map(|built| Model::new(&built.file, Bytes(1 << 20)).unwrap());
    contacts(&x, &y, [&Pose::IDENTITY, pose], near, &pool(), &mut |_| true).unwrap()
}

/// All pairs of triangles that are within a distance, and the points of the first model's there.
pub(crate) fn near_pairs(
    a: &Built,
    b: &Built,
    pose: &Pose,
    within: f64,
) -> Vec<([usize; 2], [Vector3<f64>; 3])> {
    let (t, u) = (a.placed(&Pose::IDENTITY), b.placed(pose));
    brute::pairs_within(&t, &u, within)
        .into_iter()
        .map(|pair| (pair, t[pair[0]].map(Vector3::from)))
        .collect()
}

#[test]
fn nothing_within_is_missed_and_nothing_far_beyond_is_told() {
    let models = [
        Built::new("torus", Synth::new(Shape::Torus, 300, 0).to_mesh(), [0.0; 3], false),
        Built::new("terrain", Synth::new(Shape::Terrain, 300, 5).to_mesh(), [0.0; 3], true),
        Built::new("plates", Synth::new(Shape::Plates, 300, 5).to_mesh(), [0.0; 3], false),
        Built::new("soup", hand::soup(100), [0.0; 3], false),
    ];
    let mut random = Random::new(11);
    let mut regions = 0;
    for turn in 0..45 {
        let [a, b] = [0; 2].map(|_| &models[random.next() as usize % models.len()]);
        let pose = random.pose(a, b, [0.5, 0.8, 1.0][turn % 3]);
        let size = a.diagonal() + b.diagonal();
        let within = [0.0, 0.01, 0.05][turn / 3 % 3] * size;
        let told = format!("{turn}: {} and {}, within {within}", a.name, b.name);
        let truth = near_pairs(a, b, &pose, within);

        // At the triangles of the sources, all of them and no others.
        let near = Near { within, error: 0.0, limit: 1 << 20 };
        let exact = find(a, b, &pose, &near);
        let slack = 1e-12 * size;
        assert!(exact.complete && exact.pairs >= truth.len() as u64, "{told}: {exact:?}");
        let upper = near_pairs(a, b, &pose, within + slack).len() as u64;
        assert!(exact.pairs <= upper, "{told}: {} of {upper}", exact.pairs);

        // With an error, each true one is in a region, and each region is near.
        for error in [0.02, 0.2].map(|share| share * size) {
            let found = find(a, b, &pose, &Near { error, ..near });
            for (pair, t) in &truth {
                let is_in = |low: [f64; 3], high: [f64; 3]| {
                    (0..3).all(|axis| {
                        let [x, y, z] = t.map(|corner| corner[axis]);
                        x.max(y).max(z) >= low[axis] - error && x.min(y).min(z) <= high[axis] + error
                    })
                };
                let known = found.regions.iter().any(|region| is_in(region.low, region.high));
                assert!(known, "{told}, error {error}: {pair:?}");
            }
            let beyond =
                brute::distance(&a.placed(&Pose::IDENTITY), &b.placed(&pose)) > within + error + slack;
            assert!(!beyond || found.regions.is_empty(), "{told}, error {error}: {:?}", found.regions);
            for region in &found.regions {
                assert!(
                    region.lower <= within && region.upper <= within + error + slack,
                    "{told}: {region:?}"
                );
            }
            regions += found.regions.len();
        }
    }
    assert!(regions > 10, "{regions}");
}

#[test]
fn regions_are_told_apart_and_measured() {
    // A plate over two cubes that stand apart, which it touches.
    let cube = hand::cube();
    let mut two = cube.clone();
    two.positions.extend(cube.positions.iter().map(|[x, y, z]| [x + 5.0, *y, *z]));
    let far = cube.positions.len() as u32;
    two.triangles.extend(cube.triangles.iter().map(|t| t.map(|v| v + far)));
    let plate = TriMesh::new(
        vec![[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [9.0, 9.0, 0.0], [-9.0, 9.0, 0.0]],
        vec![[0, 1, 2], [0, 2, 3]],
    );
    let (two, plate) = (Built::new("two", two, [0.0; 3], false), Built::new("plate", plate, [0.0; 3], false));
    let at = |z: f64| Pose::of_quaternion([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, z]).unwrap();
    let near = |within: f64| Near { within, error: 0.0, limit: 1000 };
    let lid = two.file.header().aabb().max[2];
    assert!(find(&two, &plate, &at(f64::from(lid) + 0.5), &near(0.4)).regions.is_empty());
    let found = find(&two, &plate, &at(f64::from(lid) + 0.5), &near(0.5));
    // The plate's two triangles are one piece, so that both cubes are near to one.
    assert_eq!(found.regions.len(), 1);
    let region = found.regions[0];
    assert!((region.lower - 0.5).abs() < 1e-12 && (region.upper - 0.5).abs() < 1e-12, "{region:?}");
    assert_eq!(region.triangles[1], 2);
    assert!((region.area[1] - 18.0 * 18.0).abs() < 1e-9 && region.depth == 0.0);
    // Lower, triangles cross. The plate faces upward, and three quarters of the cubes are behind it.
    let found = find(&two, &plate, &at(f64::from(lid) - 0.25), &near(0.0));
    assert!(found.regions[0].lower == 0.0 && (found.regions[0].depth - 0.75).abs() < 1e-12, "{found:?}");
}

#[test]
fn too_many_triangles_are_an_error_that_says_so() {
    let sphere = Built::new("sphere", hand::icosphere(2), [0.0; 3], false);
    let [a, b] = [0; 2].map(|_| Model::new(&sphere.file, Bytes(1 << 20)).unwrap());
    let near = Near { within: 1.0, error: 0.0, limit: 50 };
    let poses = [&Pose::IDENTITY, &Pose::IDENTITY];
    let error = contacts(&a, &b, poses, &near, &pool(), &mut |_| true).unwrap_err();
    assert!(matches!(error, ProximityError::TooMany { limit: 50, .. }), "{error}");
}

fn self_crossings(built: &Built, budget: u64) -> Vec<Crossing> {
    let model = Model::new(&built.file, Bytes(budget)).unwrap();
    let mut all = Vec::new();
    let mut take = |crossing: &Crossing| {
        all.push(*crossing);
        Ok::<(), ProximityError>(())
    };
    assert!(crossings(&model, &pool(), &mut take, &mut || true).unwrap());
    all
}

/// Pairs that share no vertex and are at no distance, by formulas that round.
fn brute_crossings(mesh: &TriMesh) -> usize {
    let corners: Vec<[Vector3<f64>; 3]> =
        mesh.triangles.iter().map(|t| mesh.corners(*t).map(|p| Vector3::from(p.map(f64::from)))).collect();
    let mut count = 0;
    for (i, t) in corners.iter().enumerate() {
        for (j, u) in corners.iter().enumerate().skip(i + 1) {
            let shared = mesh.triangles[i].iter().any(|v| mesh.triangles[j].contains(v));
            count += usize::from(!shared && brute::of_triangles(t, u) == 0.0);
        }
    }
    count
}

#[test]
fn a_source_that_meets_itself_is_found_to() {
    let soup = hand::soup(300);
    let bottle = hand::klein_bottle(16);
    let mut knot = hand::icosphere(2);
    // A second sphere through the first.
    let (count, first) = (knot.positions.len() as u32, knot.clone());
    knot.positions.extend(first.positions.iter().map(|[x, y, z]| [x + 0.7, y + 0.1, z + 0.05]));
    knot.triangles.extend(first.triangles.iter().map(|t| t.map(|v| v + count)));
    for (name, mesh) in [("soup", soup), ("bottle", bottle), ("knot", knot)] {
        let expected = brute_crossings(&mesh);
        let built = Built::new(name, mesh, [0.0; 3], name == "knot");
        let found = self_crossings(&built, 1 << 20);
        assert_eq!(found.len(), expected, "{name}");
        assert!(expected > 0 || name == "soup", "{name}");
        // In the memory of one page, the same.
        assert_eq!(self_crossings(&built, 0), found, "{name}");
    }
}

#[test]
fn a_source_that_does_not_meet_itself_is_not_found_to() {
    for mesh in [hand::icosphere(3), Synth::new(Shape::Torus, 600, 0).to_mesh(), hand::grid(9, 9)] {
        assert_eq!(self_crossings(&Built::new("clean", mesh, [0.0; 3], false), 1 << 20), []);
    }
    // Far from the origin, too, where singles have steps of 1: what the numbers say counts.
    let case = Case::find("far").unwrap();
    let mesh = case.mesh(400);
    let expected = brute_crossings(&mesh);
    assert_eq!(self_crossings(&Built::new("far", mesh, case.offset, false), 1 << 20).len(), expected);
}

/// Two clusters may have any number of near triangles.
#[test]
fn near_triangles_of_two_clusters_are_stopped_among() {
    let built = Built::in_large_clusters("sphere", Synth::new(Shape::Sphere, 600, 0).to_mesh());
    let near = Near { within: built.diagonal(), error: 0.0, limit: 1 << 20 };
    let run = |asks: u64| {
        let [x, y] = [0; 2].map(|_| Model::new(&built.file, Bytes(1 << 20)).unwrap());
        let mut asked = 0;
        let mut go_on = |_| {
            asked += 1;
            asked <= asks
        };
        let found = contacts(&x, &y, [&Pose::IDENTITY; 2], &near, &pool(), &mut go_on).unwrap();
        (found, asked)
    };
    let (whole, asked) = run(u64::MAX);
    assert!(whole.complete && whole.pairs > 200_000, "{}", whole.pairs);
    let (part, _) = run(asked - 1);
    assert!(!part.complete && (1..whole.pairs).contains(&part.pairs), "{} of {}", part.pairs, whole.pairs);
}
