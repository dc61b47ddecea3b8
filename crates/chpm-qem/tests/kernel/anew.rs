//! Errors found anew are bounds as those that were composed are, and tighter.

use crate::play::{Run, any_mesh, local, played, run_in};
use chpm_measure::deviation;
use chpm_mesh::{Aabb, TriMesh};
use chpm_qem::{Course, Limits, Reference, Topology, tightened};
use chpm_synth::{Shape, Synth};
use proptest::prelude::*;

/// Samples for each triangle of the finer mesh.
const SAMPLES: usize = 10;

/// Rounding error of the sampler, as a share of the model's size.
const SAMPLING: f64 = 1e-9;

/// The same run with errors found anew beside its source.
fn anew(mesh: &TriMesh, mut run: Run) -> Run {
    let triangles = local(mesh);
    let mut reference = Reference::default();
    reference.add(&mesh.positions, triangles.iter().map(|triangle| (*triangle, 0.0)));
    reference.join();
    // A coarser one, which faces are held against first: half of the way.
    let half = &run.collapses[..run.collapses.len() / 2];
    let (coarser, error) = (played(mesh, half), half.last().map_or(0.0, |collapse| collapse.error));
    let mut coarse = Reference::default();
    coarse.add(&coarser.positions, local(&coarser).into_iter().map(|triangle| (triangle, error)));
    coarse.join();
    let place = |vertex: u16| run.collapses.iter().position(|collapse| collapse.from == vertex).expect("one");
    let dropped = run.dropped.iter().zip(&run.last_faces).map(|(ball, last)| (place(last.vertex), *ball));
    let dropped: Vec<_> = dropped.collect();
    let course = Course {
        positions: &mesh.positions,
        triangles: &triangles,
        collapses: &run.collapses,
        dropped: &dropped,
        dropped_before: &[],
    };
    let limits = Limits { ratio: 2, next_ratio: 1 << 20, pieces: u64::MAX };
    let errors = tightened(&course, &[reference, coarse], limits);
    let mut last = 0.0_f32;
    for (collapse, error) in run.collapses.iter_mut().zip(&errors) {
        assert!(*error <= collapse.error, "never more than was composed");
        last = last.max(*error);
        collapse.error = last;
    }
    run
}

/// Stored by measured over the coarsest meshes of all shapes, from a fortieth of the triangles on: composed, and found anew.
#[test]
fn errors_found_anew_are_bounds_and_nearly_what_is_measured() {
    let mut ratios = [const { Vec::new() }; 2];
    for shape in Shape::ALL {
        for seed in 1..2 {
            let mesh = Synth::new(shape, 3000, seed).to_mesh();
            let composed = run_in(Topology::Change, &mesh, 20);
            let size = Aabb::of_points(&mesh.positions).diagonal();
            let before: Vec<f32> = composed.collapses.iter().map(|collapse| collapse.error).collect();
            let run = anew(&mesh, composed);
            for left in [0, 8, 16, 24] {
                let steps = run.collapses.len() - left;
                let measured = deviation(&mesh, &played(&mesh, &run.collapses[..steps]), SAMPLES).max();
                let stored = [before[steps - 1], run.error_after(steps)].map(f64::from);
                let distance = f64::from(run.distance_after(steps));
                assert!(
                    distance + SAMPLING * size >= measured,
                    "{shape} {seed}, {left} to go: {distance:e} {measured:e}"
                );
                if measured > 1e-6 * size && run.dropped.is_empty() {
                    ratios.iter_mut().zip(stored).for_each(|(all, stored)| all.push(stored / measured));
                }
            }
        }
    }
    let at = |all: &mut Vec<f64>, share: f64| {
        all.sort_by(f64::total_cmp);
        all[(share * (all.len() - 1) as f64) as usize]
    };
    let [composed, found] = &mut ratios;
    let shares = [0.5, 0.95].map(|share| (at(composed, share), at(found, share)));
    assert!(
        shares[0].1 < 1.1 && shares[1].1 < 1.6,
        "median, 95th percentile, composed and found: {shares:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// Any triangles over a few vertices.
    #[test]
    fn any_triangles_are_bounded_anew(
        corners in prop::collection::vec(prop::array::uniform3(0u32..14), 1..90),
        positions in prop::collection::vec(prop::array::uniform3(-3i8..4), 14),
        change in any::<bool>(),
    ) {
        let mesh = any_mesh(corners, &positions);
        prop_assume!(mesh.is_some());
        let mesh = mesh.unwrap_or_default();
        let run = anew(&mesh, run_in(if change { Topology::Change } else { Topology::Keep }, &mesh, 0));
        for steps in 1..=run.collapses.len() {
            let measured = deviation(&mesh, &played(&mesh, &run.collapses[..steps]), SAMPLES).max();
            let stored = f64::from(run.distance_after(steps));
            prop_assert!(stored + SAMPLING >= measured, "after {}: {} {}", steps, stored, measured);
        }
    }
}
