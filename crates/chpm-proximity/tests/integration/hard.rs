//! Hard meshes, one against another, where they touch, lie in one another's planes, or are the same: against looking at every pair of triangles.

use crate::brute;
use crate::site::Built;
use crate::touching::{find, near_pairs};
use chpm_mesh::Bytes;
use chpm_proximity::contacts::Near;
use chpm_proximity::{Answer, End, Model, Pose, Question, distance};
use chpm_synth::hard::CASES;

/// Of each case.
const TRIANGLES: u32 = 150;

/// The second model is moved so that the middles of both boxes agree, and from there by so many of its box's sides along each axis; turned by a
/// quarter about z, or not.
const PLACES: [([f64; 3], bool); 9] = [
    ([0.0, 0.0, 0.0], false),
    ([1.0, 0.0, 0.0], false),
    ([0.0, 1.0, 0.0], false),
    ([0.0, 0.0, 1.0], false),
    ([0.5, 0.0, 0.0], false),
    ([0.25, 0.25, 0.0], true),
    ([1.0, 1.0, 1.0], true),
    ([0.0, 0.0, 1.000001], false),
    ([3.0, 0.5, 0.0], true),
];

fn placed(a: &Built, b: &Built, sides: [f64; 3], turned: bool) -> Pose {
    let rows = if turned {
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    } else {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    };
    let about = Pose::of_matrix(rows, [0.0; 3]).unwrap();
    let (from, to) = (about.apply(b.center()), a.center());
    let bounds = b.file.header().aabb();
    let side = |axis: usize| f64::from(bounds.max[axis]) - f64::from(bounds.min[axis]);
    Pose::of_matrix(rows, [0, 1, 2].map(|axis| to[axis] - from[axis] + sides[axis] * side(axis))).unwrap()
}

/// Rounding error at coordinates like these, in formulas as those of the truth.
pub(crate) fn rounding(a: &Built, b: &Built) -> f64 {
    let away = a.center().iter().chain(&b.center()).fold(0.0, |m: f64, x| m.max(x.abs()));
    1e-12 * (a.diagonal() + b.diagonal() + away)
}

/// How far the leaves are from the source, of both.
pub(crate) fn stored(a: &Built, b: &Built) -> f64 {
    let of = |built: &Built| {
        built.file.clusters().iter().filter(|c| c.is_leaf()).map(|c| c.min_error).fold(0.0, f32::max)
    };
    f64::from(of(a)) + f64::from(of(b))
}

pub(crate) fn ask(a: &Built, b: &Built, pose: &Pose, error: f64) -> Answer {
    let [x, y] = [a, b].map(|built| Model::new(&built.file, Bytes(1 << 20)).unwrap());
    let question = Question { error, above: None, most_pairs: 1 << 20 };
    distance(&x, &y, [&Pose::IDENTITY, pose], &question, &mut |_| true).unwrap()
}

#[test]
fn intervals_and_contacts_hold_where_hard_meshes_touch() {
    let built: Vec<Built> =
        CASES.iter().map(|case| Built::new(case.name, case.mesh(TRIANGLES), case.offset, false)).collect();
    let (mut touching, mut apart) = (0, 0);
    for (i, a) in built.iter().enumerate() {
        // Itself, and one other.
        for b in [a, &built[(i + 7) % built.len()]] {
            for (place, (sides, turned)) in PLACES.into_iter().enumerate() {
                let told = format!("{} and {}, place {place}", a.name, b.name);
                let pose = placed(a, b, sides, turned);
                let truth = brute::distance(&a.placed(&Pose::IDENTITY), &b.placed(&pose));
                let (slack, stored) = (rounding(a, b), stored(a, b));
                for error in [0.0, 0.01 * (a.diagonal() + b.diagonal())] {
                    let Answer { lower, upper, margin, end, .. } = ask(a, b, &pose, error);
                    let held = lower <= truth + slack + stored && truth <= upper + slack + stored;
                    assert!(held, "{told}: {truth} outside of {lower} to {upper}");
                    let width = error + 2.0 * margin + slack + 4.0 * stored;
                    assert!(upper - lower <= width, "{told}: {lower} to {upper} is wider than {width}");
                    assert!(matches!(end, End::Decided | End::Exact), "{told}: {end:?}");
                }

                // All pairs that are near, and none that is not.
                let (within, slack) = (truth, slack + stored);
                let near = Near { within: within + slack, error: 0.0, limit: 1 << 20 };
                let found = find(a, b, &pose, &near);
                let lower = near_pairs(a, b, &pose, within).len() as u64;
                // Edges that are nearly parallel are told apart to half of the digits.
                let parallel = 1e-8 * (a.diagonal() + b.diagonal());
                let beyond = within + 3.0 * slack + 2.0 * found.margin + parallel;
                let upper = near_pairs(a, b, &pose, beyond).len() as u64;
                assert!(lower > 0 && found.complete, "{told}");
                assert!(
                    (lower..=upper).contains(&found.pairs),
                    "{told}: {} of {lower} to {upper}",
                    found.pairs
                );
                if truth > slack { apart += 1 } else { touching += 1 }
            }
        }
    }
    assert!(touching > 100 && apart > 100, "{touching} touch, {apart} are apart");
}
