//! What must hold on any mesh: random pieces, random vertex order, random locks.

use crate::play::{Run, corner_sets, local, run, run_with};
use chpm_measure::{edge_census, topology};
use chpm_mesh::synth::{Shape, Synth, hand};
use chpm_mesh::{ProgressiveMesh, TriMesh};
use chpm_qem::Decimator;
use proptest::prelude::*;

/// A few pieces side by side, all of them consistently oriented manifolds.
fn pieces() -> impl Strategy<Value = TriMesh> {
    let piece = prop_oneof![
        (0u32..3).prop_map(hand::icosphere),
        (1u32..12, 1u32..12).prop_map(|(x, y)| hand::grid(x, y)),
        (50u64..800, any::<u64>()).prop_map(|(n, s)| Synth::new(Shape::Terrain, n, s).to_mesh()),
        (200u64..800, any::<u64>()).prop_map(|(n, s)| Synth::new(Shape::Isosurface, n, s).to_mesh()),
        (200u64..600, any::<u64>()).prop_map(|(n, s)| Synth::new(Shape::Plates, n, s).to_mesh()),
        Just(hand::cube()),
        Just(hand::tetrahedron()),
    ];
    prop::collection::vec(piece, 1..4).prop_map(|pieces| {
        let mut all = TriMesh::default();
        for piece in pieces {
            let first = all.positions.len() as u32;
            all.positions.extend(piece.positions);
            all.triangles.extend(piece.triangles.iter().map(|t| t.map(|v| v + first)));
        }
        all
    })
}

/// Pieces with their vertices in another order, some vertices locked, and a share to keep.
fn cases() -> impl Strategy<Value = (TriMesh, Vec<bool>, f64)> {
    (pieces(), any::<u64>(), prop_oneof![Just(0.0), Just(0.05), Just(0.5)], 0.0f64..1.0).prop_map(
        |(mut mesh, seed, locks, keep)| {
            let keys: Vec<u64> = (0..mesh.positions.len() as u64).map(|v| scramble(seed ^ v)).collect();
            let mut order: Vec<u32> = (0..mesh.positions.len() as u32).collect();
            order.sort_unstable_by_key(|v| keys[*v as usize]);
            let mut new = vec![0; order.len()];
            order.iter().enumerate().for_each(|(i, v)| new[*v as usize] = i as u32);
            mesh.positions = order.iter().map(|v| mesh.positions[*v as usize]).collect();
            mesh.triangles.iter_mut().for_each(|t| *t = t.map(|v| new[v as usize]));
            let locked = keys.iter().map(|k| (scramble(*k) as f64 / u64::MAX as f64) < locks).collect();
            (mesh, locked, keep)
        },
    )
}

fn scramble(x: u64) -> u64 {
    let x = (x ^ 0x51ed_270b).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) ^ (x >> 32)
}

fn target(mesh: &TriMesh, keep: f64) -> usize {
    (mesh.triangles.len() as f64 * keep) as usize
}

/// Carries the collapses out one by one on plain triangles, looking at every step.
fn check_by_replay(mesh: &TriMesh, locked: &[bool], run: &Run) -> Result<(), TestCaseError> {
    let mut alive = vec![true; mesh.positions.len()];
    let mut triangles = mesh.triangles.clone();
    let mut error = 0.0;
    let (vertex_count, record) = (mesh.positions.len(), &run.record);
    let (new, base) = (&record.old_to_new, record.base_vertex_count());
    let renumbered: Vec<[u16; 3]> =
        local(mesh).iter().map(|t| t.map(|v| new[usize::from(v)])).collect();
    let pm = ProgressiveMesh {
        vertex_count,
        base_vertex_count: base,
        triangles: &renumbered,
        targets: &record.targets,
    };
    for (step, collapse) in run.collapses.iter().enumerate() {
        let (u, v) = (u32::from(collapse.from), u32::from(collapse.to));
        prop_assert!(alive[u as usize] && alive[v as usize] && !locked[u as usize]);
        prop_assert!(triangles.iter().any(|t| t.contains(&u) && t.contains(&v)), "{} is no edge", step);
        alive[u as usize] = false;
        for corner in triangles.as_flattened_mut() {
            if *corner == u {
                *corner = v;
            }
        }
        triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        prop_assert!(collapse.error >= error && collapse.error.is_finite());
        error = collapse.error;

        let n = vertex_count - step - 1;
        prop_assert_eq!(usize::from(record.new_to_old[n]), u as usize);
        prop_assert_eq!(record.targets[n - base], new[v as usize]);
        prop_assert!(usize::from(record.targets[n - base]) < n);
        prop_assert_eq!(record.errors[n - base], error);
        if step % 16 == 0 || n == base {
            let mut at = Vec::new();
            pm.triangles_at(n, &mut at);
            let renamed: Vec<[u16; 3]> = triangles.iter().map(|t| t.map(|v| new[v as usize])).collect();
            prop_assert_eq!(at, renamed);
        }
    }
    prop_assert_eq!(triangles.len(), run.triangle_count);
    prop_assert_eq!(&triangles, &run.mesh.triangles);
    let mut numbers = record.new_to_old.clone();
    numbers.sort_unstable();
    prop_assert!(numbers.iter().enumerate().all(|(i, v)| i == usize::from(*v)));
    prop_assert!(record.new_to_old[..base].is_sorted());
    Ok(())
}

/// Every level of detail, not only the last.
fn check_levels_of_detail(mesh: &TriMesh, run: &Run) -> Result<(), TestCaseError> {
    let before = topology(mesh);
    for part in [1, 2, 3, 4] {
        let lod = crate::play::played(mesh, &run.collapses[..run.collapses.len() * part / 4]);
        let sets = corner_sets(&lod);
        prop_assert!(sets.windows(2).all(|w| w[0] != w[1]), "a triangle is there twice");
        let (census, after) = (edge_census(&lod), topology(&lod));
        prop_assert_eq!((census.non_manifold, census.inconsistent), (0, 0));
        prop_assert!(after.is_manifold());
        prop_assert_eq!(
            (after.components, after.boundary_loops, after.euler),
            (before.components, before.boundary_loops, before.euler)
        );
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_decimation_is_what_it_says((mesh, locked, keep) in cases()) {
        let run = run(&mesh, &locked, target(&mesh, keep));
        prop_assert_eq!(run.stalled, run.triangle_count > target(&mesh, keep));
        prop_assert!(run.stalled || run.triangle_count + 1 >= target(&mesh, keep));
        check_by_replay(&mesh, &locked, &run)?;
    }

    #[test]
    fn every_level_of_detail_is_a_manifold_of_the_same_topology((mesh, locked, keep) in cases()) {
        check_levels_of_detail(&mesh, &run(&mesh, &locked, target(&mesh, keep)))?;
    }

    #[test]
    fn a_used_kernel_answers_as_a_fresh_one((mesh, locked, keep) in cases(), (other, locks, _) in cases()) {
        let mut decimator = Decimator::default();
        let fresh = run(&mesh, &locked, target(&mesh, keep));
        run_with(&mut decimator, &other, &locks, 0, 0.0);
        for _ in 0..2 {
            let used = run_with(&mut decimator, &mesh, &locked, target(&mesh, keep), 0.0);
            prop_assert_eq!(&used.collapses, &fresh.collapses);
            prop_assert_eq!(used.refusals, fresh.refusals);
        }
    }

    #[test]
    fn a_longer_run_begins_as_a_shorter_one((mesh, locked, keep) in cases()) {
        let long = run(&mesh, &locked, 0);
        let short = run(&mesh, &locked, target(&mesh, keep));
        prop_assert_eq!(&long.collapses[..short.collapses.len()], &short.collapses[..]);
    }

    /// Coordinates on a lattice of 2^-12, so that moving them is exact.
    #[test]
    fn moving_the_mesh_changes_nothing(
        (mut mesh, locked, keep) in cases(),
        offset in prop::array::uniform3(-1000i16..1000),
    ) {
        for x in mesh.positions.as_flattened_mut() {
            *x = (*x * 4096.0).round() / 4096.0;
        }
        let here = run(&mesh, &locked, target(&mesh, keep));
        for p in &mut mesh.positions {
            *p = std::array::from_fn(|a| p[a] + f32::from(offset[a]));
        }
        let there = run(&mesh, &locked, target(&mesh, keep));
        prop_assert_eq!(here.collapses, there.collapses);
    }

    #[test]
    fn scaling_by_a_power_of_two_scales_the_errors(
        (mut mesh, locked, keep) in cases(),
        exponent in -40i32..40,
    ) {
        let here = run(&mesh, &locked, target(&mesh, keep));
        let scale = (f64::from(exponent)).exp2() as f32;
        for x in mesh.positions.as_flattened_mut() {
            *x *= scale;
        }
        let there = run(&mesh, &locked, target(&mesh, keep));
        let scaled: Vec<_> =
            here.collapses.iter().map(|c| chpm_qem::Collapse { error: c.error * scale, ..*c }).collect();
        prop_assert_eq!(scaled, there.collapses);
    }
}
