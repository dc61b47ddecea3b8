//! Poses one after the other against each pose on its own.

use crate::brute;
use crate::site::Built;
use chpm_mesh::Bytes;
use chpm_proximity::{Answer, End, Front, Model, Pose, Question, distance, follow};
use chpm_synth::{Shape, Synth};

/// A part that turns as it goes by, through the other one, and every so often is put elsewhere.
fn pose(a: &Built, b: &Built, step: u32) -> Pose {
    let time = f64::from(if step.is_multiple_of(250) { step + 500 } else { step }) / 1000.0;
    let turn = [0.3 * time, 0.2, 0.1, 1.0];
    let (from, to) = (Pose::of_quaternion(turn, [0.0; 3]).unwrap().apply(b.center()), a.center());
    let way = [3.0 - 6.0 * time, 0.4, 0.3].map(|x| x * 0.5 * a.diagonal());
    Pose::of_quaternion(turn, [0, 1, 2].map(|axis| to[axis] - from[axis] + way[axis])).unwrap()
}

#[test]
fn steps_are_as_narrow_as_questions_of_their_own_and_cost_less() {
    let a = Built::new("torus", Synth::new(Shape::Torus, 400, 0).to_mesh(), [0.0; 3], false);
    let b = Built::new("terrain", Synth::new(Shape::Terrain, 300, 5).to_mesh(), [1e6, 0.0, -3e5], true);
    let [x, y] = [&a, &b].map(|built| Model::new(&built.file, Bytes(1 << 24)).unwrap());
    let error = 1e-3 * a.diagonal();
    for above in [None, Some(0.05 * a.diagonal())] {
        let question =
            Question { error: if above.is_some() { 0.0 } else { error }, above, most_pairs: 1 << 20 };
        let mut front = Front::new();
        let (mut followed, mut fresh) = (0, 0);
        let (mut clear, mut met) = (0, 0);
        for step in 0..1000 {
            let pose = pose(&a, &b, step);
            let poses = [&Pose::IDENTITY, &pose];
            let own = distance(&x, &y, poses, &question, &mut |_| true).unwrap();
            let answer = follow(&mut front, &x, &y, poses, &question, &mut |_| true).unwrap();
            let told = format!("{above:?}, step {step}: {answer:?}, on its own {own:?}");
            followed += answer.pairs;
            fresh += own.pairs;
            assert!(answer.lower <= own.upper && own.lower <= answer.upper, "{told}");
            match above {
                None => assert!(answer.upper - answer.lower <= error || answer.end == End::Exact, "{told}"),
                Some(above) => {
                    let verdict = |answer: &Answer| (answer.lower > above, answer.upper <= above);
                    assert_eq!(verdict(&answer), verdict(&own), "{told}");
                    clear += u32::from(answer.lower > above);
                }
            }
            met += u32::from(answer.lower == 0.0);
            if step % 50 == 7 {
                let truth = brute::distance(&a.placed(&Pose::IDENTITY), &b.placed(&pose));
                let rounding = answer.margin + 1e-8;
                assert!(
                    answer.lower <= truth + rounding && truth <= answer.upper + rounding,
                    "{told}: {truth}"
                );
            }
        }
        assert!(2 * followed < fresh, "{followed} of {fresh}");
        assert!(met > 50 && (above.is_none() || clear > 50), "{met} {clear}");
    }
}

#[test]
fn a_step_that_was_stopped_is_no_harm_to_the_next() {
    let a = Built::new("torus", Synth::new(Shape::Torus, 400, 0).to_mesh(), [0.0; 3], false);
    let x = Model::new(&a.file, Bytes(1 << 24)).unwrap();
    let question = Question { error: 1e-3 * a.diagonal(), above: None, most_pairs: 1 << 20 };
    let mut front = Front::new();
    for step in 0..120 {
        let pose = pose(&a, &a, 3 * step);
        let poses = [&Pose::IDENTITY, &pose];
        let mut left = if step % 3 == 1 { 4 } else { u32::MAX };
        let mut go_on = |_| {
            left -= 1;
            left > 0
        };
        // Few pairs may wait now and then, too.
        let question = Question { most_pairs: if step % 5 == 2 { 6 } else { 1 << 20 }, ..question };
        let answer = follow(&mut front, &x, &x, poses, &question, &mut go_on).unwrap();
        let own =
            distance(&x, &x, poses, &Question { most_pairs: 1 << 20, ..question }, &mut |_| true).unwrap();
        assert!(answer.lower <= own.upper && own.lower <= answer.upper, "{step}: {answer:?} {own:?}");
        if !matches!(answer.end, End::Stopped | End::Crowded) {
            assert!(answer.upper - answer.lower <= question.error, "{step}: {answer:?}");
        }
    }
}
