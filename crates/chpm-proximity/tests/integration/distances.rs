//! Intervals against the true distance, of many poses.

use crate::brute;
use crate::site::{Built, Random};
use chpm_mesh::Bytes;
use chpm_proximity::{Answer, End, Model, Pose, Question, distance};
use chpm_synth::hard::Case;
use chpm_synth::{Shape, Synth, hand};

/// Random pairs of poses; more with CHPM_PAIRS, for a run by hand.
fn pairs() -> usize {
    std::env::var("CHPM_PAIRS").ok().and_then(|n| n.parse().ok()).unwrap_or(1000)
}

fn models() -> Vec<Built> {
    let mut built: Vec<Built> = Shape::ALL
        .into_iter()
        .map(|shape| Built::new(&shape.to_string(), Synth::new(shape, 300, 3).to_mesh(), [0.0; 3], false))
        .collect();
    built.push(Built::new("packed", hand::icosphere(2), [0.0; 3], true));
    built.push(Built::new("soup", hand::soup(200), [0.0; 3], false));
    for name in ["far", "far-double", "line", "cubes"] {
        let case = Case::find(name).unwrap();
        built.push(Built::new(name, case.mesh(200), case.offset, false));
    }
    built
}

fn ask(a: &Built, b: &Built, poses: [&Pose; 2], question: &Question) -> Answer {
    let (x, y) = (Model::new(&a.file, Bytes(1 << 20)).unwrap(), Model::new(&b.file, Bytes(1 << 20)).unwrap());
    distance(&x, &y, poses, question, &mut |_| true).unwrap()
}

fn within(error: f64) -> Question {
    Question { error, above: None, most_pairs: 1 << 20 }
}

/// Holds an answer against the truth, which is itself known up to `rounding`.
fn check(answer: &Answer, truth: f64, rounding: f64, error: f64, told: &str) {
    let Answer { lower, upper, margin, end, .. } = *answer;
    assert!(
        lower <= truth + rounding && truth <= upper + rounding,
        "{told}: {truth} outside of {lower} to {upper}"
    );
    // What the source's leaves are rounded by counts like the margin: twice for each model.
    let width = error + 2.0 * margin + rounding;
    assert!(upper - lower <= width, "{told}: {lower} to {upper} is wider than {width}");
    assert!(matches!(end, End::Decided | End::Exact), "{told}: {end:?}");
}

#[test]
fn intervals_hold_and_are_as_narrow_as_asked_for() {
    let models = models();
    let mut random = Random::new(7);
    let (mut meet, mut apart) = (0, 0);
    for turn in 0..pairs() {
        let [a, b] = [0; 2].map(|_| &models[random.next() as usize % models.len()]);
        let times = [0.3, 0.7, 1.0, 1.5, 4.0][turn % 5];
        let (still, pose) = (Pose::IDENTITY, random.pose(a, b, times));
        let told = format!("pair {turn}, {} and {}", a.name, b.name);
        let truth = brute::distance(&a.placed(&still), &b.placed(&pose));
        // Of coordinates up to 1e7, and the far ball's are singles.
        let size =
            a.center().iter().chain(&b.center()).fold(a.diagonal() + b.diagonal(), |m, x| m.max(x.abs()));
        let rounding = 1e-13 * size;
        let stored = f64::from(leaf_error(a) + leaf_error(b));
        for error in [0.0, 0.01 * (a.diagonal() + b.diagonal())] {
            let answer = ask(a, b, [&still, &pose], &within(error));
            check(&answer, truth, rounding + 2.0 * stored, error, &told);
        }
        // Half way above and below the truth, both are decided and right.
        let above = truth * [0.5, 1.5][turn % 2];
        let answer = ask(a, b, [&still, &pose], &Question { above: Some(above), ..within(0.0) });
        if truth > above + rounding + stored + answer.margin {
            assert!(answer.lower > above, "{told}: {truth} is above {above}: {answer:?}");
        } else if truth < above - rounding - stored - answer.margin {
            assert!(answer.upper <= above, "{told}: {truth} is below {above}: {answer:?}");
        }
        if truth > 0.0 { apart += 1 } else { meet += 1 }
    }
    assert!(meet > pairs() / 20 && apart > pairs() / 20, "{meet} meet, {apart} are apart");
}

fn leaf_error(model: &Built) -> f32 {
    model.file.levels()[0]
        .min_error
        .max(model.file.clusters().iter().filter(|c| c.is_leaf()).map(|c| c.min_error).fold(0.0, f32::max))
}

#[test]
fn poses_of_both_count_and_far_origins_cancel() {
    let case = Case::find("far-double").unwrap();
    let a = Built::new("far-double", case.mesh(200), case.offset, false);
    let turn = Pose::of_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]).unwrap();
    // Turned alike and moved along an axis by 3: one is above the other.
    let lifted =
        Pose::of_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [0.0, 0.0, 3.0]).unwrap();
    let still = ask(&a, &a, [&turn, &turn], &within(0.0));
    assert!(still.lower == 0.0 && still.upper <= 1e-6, "{still:?}");
    let answer = ask(&a, &a, [&turn, &lifted], &within(0.0));
    let truth = brute::distance(&a.placed(&turn), &a.placed(&lifted));
    check(&answer, truth, 4.0 * f64::from(leaf_error(&a)) + 1e-8, 0.0, "lifted");
    assert!(answer.margin < 1e-12, "{}", answer.margin);
}

#[test]
fn models_that_meet_in_many_places_are_asked_about_one() {
    let torus = Built::new("torus", Synth::new(Shape::Torus, 4000, 0).to_mesh(), [0.0; 3], false);
    let turned = Pose::of_quaternion([0.1, 0.2, 0.3, 1.0], [0.1, 0.0, 0.0]).unwrap();
    for pose in [Pose::IDENTITY, turned] {
        let answer = ask(&torus, &torus, [&Pose::IDENTITY, &pose], &within(0.0));
        assert!(answer.lower == 0.0 && answer.upper <= 2.0 * answer.margin, "{answer:?}");
        // Levels of groups, and a few beside each; all that meet are thousands.
        assert!(answer.end == End::Exact && answer.pairs < 300, "{answer:?}");
    }
}

#[test]
fn a_search_that_is_stopped_tells_what_is_proven() {
    let sphere = Built::new("sphere", hand::icosphere(3), [0.0; 3], false);
    let pose = Pose::of_quaternion([0.1, 0.2, 0.3, 1.0], [2.5, 0.0, 0.0]).unwrap();
    let truth = brute::distance(&sphere.placed(&Pose::IDENTITY), &sphere.placed(&pose));
    let mut before = f64::INFINITY;
    for limit in [0, 2, 5, 20, 1000] {
        let [a, b] = [0; 2].map(|_| Model::new(&sphere.file, Bytes(0)).unwrap());
        let mut left = limit;
        let mut go_on = |_| {
            left -= 1;
            left >= 0
        };
        let answer = distance(&a, &b, [&Pose::IDENTITY, &pose], &within(0.0), &mut go_on).unwrap();
        assert!(answer.lower <= truth && truth <= answer.upper, "{limit}: {answer:?}");
        assert!(answer.upper - answer.lower <= before, "{limit}");
        before = answer.upper - answer.lower;
        assert_eq!(answer.end == End::Stopped, limit < 1000, "{limit}: {answer:?}");
    }
    assert!(before < 1e-12);
}

/// A library of others, in single precision.
mod peer {
    use super::*;
    use parry3d::math::{Pose as Place, Rotation, Vector};
    use parry3d::query;
    use parry3d::shape::TriMesh;

    #[test]
    fn another_library_finds_the_same() {
        let models = models();
        // Those whose numbers single precision can move about.
        let models: Vec<&Built> =
            models.iter().filter(|m| m.diagonal() < 100.0 && m.offset == [0.0; 3]).collect();
        let mesh = |built: &Built| {
            let points = built.mesh.positions.iter().map(|p| Vector::new(p[0], p[1], p[2])).collect();
            TriMesh::new(points, built.mesh.triangles.clone()).unwrap()
        };
        let meshes: Vec<TriMesh> = models.iter().map(|m| mesh(m)).collect();
        let mut random = Random::new(23);
        let mut apart = 0;
        for turn in 0..pairs() / 5 {
            let [i, j] = [0; 2].map(|_| random.next() as usize % models.len());
            let turned = [0; 4].map(|_| random.signed() as f32);
            let about = Rotation::from_xyzw(turned[0], turned[1], turned[2], turned[3]).normalize();
            let away = (models[i].diagonal() + models[j].diagonal()) * [0.5, 1.0, 2.0][turn % 3];
            let to = [0; 3].map(|_| (away * random.signed()) as f32);
            let place = Place::from_parts(Vector::new(to[0], to[1], to[2]), about);
            let theirs = query::distance(&Place::IDENTITY, &meshes[i], &place, &meshes[j]).unwrap().distance;
            let pose = Pose::of_quaternion(turned.map(f64::from), to.map(f64::from)).unwrap();
            let ours = ask(models[i], models[j], [&Pose::IDENTITY, &pose], &within(0.0));
            // Theirs is of singles, and its search stops early: by some 1e-5 of the models' size.
            let slack = 1e-4 * (away + models[i].diagonal() + models[j].diagonal());
            let theirs = f64::from(theirs);
            let (a, b) = (&models[i].name, &models[j].name);
            assert!(
                ours.lower <= theirs + slack && theirs - slack <= ours.upper,
                "{a} {b}: {ours:?} {theirs}"
            );
            apart += usize::from(theirs > 0.0);
        }
        assert!(apart > pairs() / 20, "{apart}");
    }
}
