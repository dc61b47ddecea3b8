//! Coarse meshes, trimmed models and poses of few digits: however loose the question, the answer holds.

use crate::brute;
use crate::site::{Built, Random};
use crate::touching::find;
use chpm_build::Settings;
use chpm_build::config::Length;
use chpm_measure::Bvh;
use chpm_mesh::{Bytes, TriMesh, geom};
use chpm_proximity::contacts::Near;
use chpm_proximity::{Answer, Front, Gauge, Model, Pose, Question, distance, follow};
use chpm_synth::{Shape, Synth, hand};

fn ask(a: &Built, b: &Built, poses: [&Pose; 2], error: f64) -> Answer {
    let [x, y] = [a, b].map(|built| Model::new(&built.file, Bytes(1 << 24)).unwrap());
    let question = Question { error, above: None, most_pairs: 1 << 20 };
    distance(&x, &y, poses, &question, &mut |_| true).unwrap()
}

fn at(translation: [f64; 3]) -> Pose {
    Pose::of_quaternion([0.0, 0.0, 0.0, 1.0], translation).unwrap()
}

/// Groups have several parents, each of which stands for a part of them: what is known by one way is not known by another. And what is within a
/// distance is found, though what is drawn for it is farther away.
#[test]
fn many_small_clusters_hold_with_large_errors() {
    let mesh = |shape, triangles| Synth::new(shape, triangles, 5).to_mesh();
    let [a, b, c] = [(Shape::Terrain, 4000), (Shape::Isosurface, 3000), (Shape::Sphere, 1500)]
        .map(|(shape, triangles)| Built::new(&shape.to_string(), mesh(shape, triangles), [0.0; 3], false));
    let mut random = Random::new(31);
    let (mut apart, mut coarse) = (0, 0);
    for turn in 0..TURNS {
        let (fixed, moved) = [(&a, &b), (&b, &c), (&c, &a)][turn % 3];
        let pose = random.pose(fixed, moved, [0.6, 0.9, 1.2][turn / 3 % 3]);
        let truth = brute::distance(&fixed.placed(&Pose::IDENTITY), &moved.placed(&pose));
        let size = fixed.diagonal() + moved.diagonal();
        let slack = 1e-13 * size;
        for share in [0.003, 0.01, 0.03, 0.1] {
            let told = format!("{turn}: {} and {} at {share}", fixed.name, moved.name);
            let answer = ask(fixed, moved, [&Pose::IDENTITY, &pose], share * size);
            let holds = answer.lower <= truth + slack && truth <= answer.upper + slack;
            assert!(holds, "{told}: {truth} outside of {answer:?}");
            if truth > 0.0 {
                let near = Near { within: truth + slack, error: share * size, limit: 1 << 20 };
                let found = find(fixed, moved, &pose, &near);
                assert!(!found.regions.is_empty(), "{told}: nothing within {truth}");
                coarse += u32::from(found.regions[0].levels.iter().any(|level| *level > 0));
            }
        }
        apart += u32::from(truth > 0.0);
    }
    assert!(apart > TURNS as u32 / 3 && coarse > apart, "{apart} apart, {coarse} of coarse meshes");
}

const TURNS: usize = 60;

/// A few points far from each other are one run: what is nearest to one of them is twice as far from the middle as the run is wide, and more than what is nearest to that.
#[test]
fn points_far_from_each_other_find_what_is_near_to_each() {
    let torus = Synth::new(Shape::Torus, 1500, 0).to_mesh();
    let (soup, balls) = (hand::soup(60), scattered(&hand::icosphere(1), 12, 8.0));
    let mut random = Random::new(17);
    for (name, mesh) in [("torus", torus), ("soup", soup), ("balls", balls)] {
        let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
        let built = Built::new(name, mesh, [0.0; 3], false);
        let (center, size) = (built.center(), built.diagonal());
        let [scan, model] = [0, 1 << 24].map(|bytes| Model::new(&built.file, Bytes(bytes)).unwrap());
        let gauge = Gauge::new(&scan, &model, [&Pose::IDENTITY; 2], 0.0).unwrap();
        for _ in 0..100 {
            let count = 2 + random.next() as usize % 3;
            let point = |random: &mut Random| center.map(|x| (x + 0.3 * size * random.signed()) as f32);
            let points: Vec<[f32; 3]> = (0..count).map(|_| point(&mut random)).collect();
            let mut found = Vec::new();
            gauge.measure(&points, &mut found).unwrap();
            for (point, distance) in points.iter().zip(&found) {
                let truth = bvh.distance(geom::to_f64(*point));
                let off = (distance.abs() - truth).abs();
                assert!(off <= 1e-9 * size, "{name}, {point:?} of {count}: {distance} is not {truth}");
            }
        }
    }
}

/// Copies of a mesh, that far from each other at most.
fn scattered(mesh: &TriMesh, copies: u32, size: f64) -> TriMesh {
    let (mut all, mut random) = (TriMesh::default(), Random::new(5));
    for _ in 0..copies {
        let (first, by) = (all.positions.len() as u32, [0; 3].map(|_| (size * random.signed()) as f32));
        all.positions.extend(mesh.positions.iter().map(|p| [0, 1, 2].map(|axis| p[axis] + by[axis])));
        all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    all
}

/// Of a trimmed model the leaves are not the source: what has vanished from them is still a part of it.
#[test]
fn what_was_trimmed_away_is_still_in_the_way() {
    // A board that is not flat, or nothing would cost as little as its triangles, and specks above it that lie apart.
    let mut mesh = hand::grid(24, 24);
    for (vertex, position) in mesh.positions.iter_mut().enumerate() {
        position[2] = 0.1 * (vertex * 7 % 5) as f32;
    }
    let speck = hand::tetrahedron();
    let places = [[5.0, 5.0], [18.0, 7.0], [9.0, 19.0], [20.0, 20.0]];
    for [x, y] in places {
        let first = mesh.positions.len() as u32;
        let place = |p: &[f32; 3]| [x + 0.1 * p[0], y + 0.1 * p[1], 4.0 + 0.1 * p[2]];
        mesh.positions.extend(speck.positions.iter().map(place));
        mesh.triangles.extend(speck.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    let settings = Settings { finest_error: Some(Length::Units(6.0)), ..Settings::default() };
    let board = Built::with("board", mesh, &settings);
    let file = &board.file;
    let vanished = file.groups().iter().filter(|group| group.is_leaf() && group.gaps.fine > group.min_error);
    assert!(file.is_trimmed() && vanished.count() > 0, "leaves without specks");
    let probe = Built::new("probe", hand::icosphere(1), [0.0; 3], false);
    for [x, y] in places {
        for z in [5.5, 6.0, 8.0] {
            let pose = at([x.into(), y.into(), z]);
            let truth = brute::distance(&board.placed(&Pose::IDENTITY), &probe.placed(&pose));
            assert!(truth < z - 4.0, "the speck is nearest");
            for poses in [[&Pose::IDENTITY, &pose], [&pose, &Pose::IDENTITY]] {
                let (a, b) = if poses[0] == &pose { (&probe, &board) } else { (&board, &probe) };
                let answer = ask(a, b, poses, 0.0);
                assert!(answer.lower <= truth && truth <= answer.upper, "{truth} outside of {answer:?}");
            }
            let near = Near { within: truth + 1e-9, error: 0.0, limit: 1 << 20 };
            assert!(!find(&board, &probe, &pose, &near).regions.is_empty(), "nothing within {truth}");
        }
    }
}

/// A turn about z that is told by few digits: the rows, and the points that they give, which no rotation gives.
fn few_digits(angle: f64, scale: f64, translation: [f64; 3]) -> (Pose, impl Fn([f64; 3]) -> [f64; 3]) {
    let (sin, cos) = angle.sin_cos();
    let rows = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]].map(|row| row.map(|x| scale * x));
    let given = move |p: [f64; 3]| {
        [0, 1, 2].map(|i| rows[i][0] * p[0] + rows[i][1] * p[1] + rows[i][2] * p[2] + translation[i])
    };
    (Pose::of_matrix(rows, translation).unwrap(), given)
}

/// The triangles of a model where a pose that was given puts them.
fn given(built: &Built, place: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<[[f64; 3]; 3]> {
    built.placed(&Pose::IDENTITY).into_iter().map(|t| t.map(&place)).collect()
}

/// Missing digits of either pose widen the answer, so that it holds for what was given.
#[test]
fn poses_of_few_digits_count_on_both_sides() {
    let ball = Built::new("ball", hand::icosphere(2), [0.0; 3], false);
    let far = Built::new("far", hand::icosphere(2), [40.0, -30.0, 0.0], false);
    for scale in [1.0 - 2e-5, 1.0 + 2e-5] {
        for (a, b, towards) in [(&ball, &ball, [3.0, 0.0, 0.0]), (&far, &ball, [44.0, -33.0, 0.0])] {
            let (rough, place) = few_digits(0.0, scale, [0.0; 3]);
            let exact = at(towards);
            let truth = brute::distance(&given(a, place), &b.placed(&exact));
            for (answer, which) in
                [(ask(a, b, [&rough, &exact], 0.0), "first"), (ask(b, a, [&exact, &rough], 0.0), "second")]
            {
                let holds = answer.lower <= truth && truth <= answer.upper;
                assert!(holds, "{which}, {scale}: {truth} outside of {answer:?}");
                assert!(answer.upper - answer.lower < 0.02, "{which}, {scale}: {answer:?}");
            }
        }
    }
}

/// A step from a pose that is known well to one that is not moves nothing, and yet the model may have come nearer.
#[test]
fn a_step_to_a_pose_of_few_digits_is_a_motion() {
    let ball = Built::new("ball", hand::icosphere(3), [0.0; 3], false);
    let [x, y] = [0; 2].map(|_| Model::new(&ball.file, Bytes(1 << 24)).unwrap());
    let question = Question { error: 0.0, above: None, most_pairs: 1 << 20 };
    let mut front = Front::new();
    let towards = [3.0, 0.0, 0.0];
    for (step, scale) in [1.0, 1.0 + 2e-5, 1.0, 1.0 - 2e-5, 1.0 + 1e-5].into_iter().enumerate() {
        let (pose, place) = few_digits(0.0, scale, towards);
        let truth = brute::distance(&ball.placed(&Pose::IDENTITY), &given(&ball, place));
        let poses = [&Pose::IDENTITY, &pose];
        let answer = follow(&mut front, &x, &y, poses, &question, &mut |_| true).unwrap();
        let slack = 1e-12;
        let holds = answer.lower <= truth + slack && truth <= answer.upper + slack;
        assert!(holds, "step {step}: {truth} outside of {answer:?}");
    }
}
