//! Properties of any mesh: random pieces, random vertex order, random locks.

use crate::play::{Run, corner_sets, local, run, run_with};
use chpm_measure::{edge_counts, topology};
use chpm_mesh::{ProgressiveMesh, TriMesh};
use chpm_qem::{Collapse, Decimator, Patch, Topology};
use chpm_synth::{Shape, Synth, hand};
use proptest::prelude::*;

/// A consistently oriented manifold; its description is what a failing test prints.
#[derive(Clone, Debug)]
enum Piece {
    Icosphere(u32),
    Grid(u32, u32),
    Synth(Shape, u64, u64),
    Tetrahedron,
}

impl Piece {
    fn mesh(&self) -> TriMesh {
        match *self {
            Piece::Icosphere(level) => hand::icosphere(level),
            Piece::Grid(nx, ny) => hand::grid(nx, ny),
            Piece::Synth(shape, triangles, seed) => Synth::new(shape, triangles, seed).to_mesh(),
            Piece::Tetrahedron => hand::tetrahedron(),
        }
    }
}

/// Pieces side by side with their vertices in another order, a share of them locked, and the share of triangles to keep.
#[derive(Clone, Debug)]
struct Case {
    pieces: Vec<Piece>,
    seed: u64,
    locks: f64,
    keep: f64,
}

fn cases() -> impl Strategy<Value = Case> {
    let piece = prop_oneof![
        (0u32..3).prop_map(Piece::Icosphere),
        (1u32..12, 1u32..12).prop_map(|(x, y)| Piece::Grid(x, y)),
        (50u64..800, any::<u64>()).prop_map(|(n, s)| Piece::Synth(Shape::Terrain, n, s)),
        (200u64..800, any::<u64>()).prop_map(|(n, s)| Piece::Synth(Shape::Isosurface, n, s)),
        (200u64..600, any::<u64>()).prop_map(|(n, s)| Piece::Synth(Shape::Plates, n, s)),
        Just(Piece::Tetrahedron),
    ];
    let locks = prop_oneof![Just(0.0), Just(0.05), Just(0.5)];
    (prop::collection::vec(piece, 1..4), any::<u64>(), locks, 0.0f64..1.0)
        .prop_map(|(pieces, seed, locks, keep)| Case { pieces, seed, locks, keep })
}

impl Case {
    fn mesh(&self) -> TriMesh {
        let mut all = TriMesh::default();
        for piece in &self.pieces {
            let (first, piece) = (all.positions.len() as u32, piece.mesh());
            all.positions.extend(piece.vertices.positions);
            all.triangles.extend(piece.triangles.iter().map(|t| t.map(|v| v + first)));
        }
        let mut order: Vec<u32> = (0..all.positions.len() as u32).collect();
        order.sort_unstable_by_key(|v| (scramble(self.seed ^ u64::from(*v)), *v));
        let mut new = vec![0; order.len()];
        order.iter().enumerate().for_each(|(i, v)| new[*v as usize] = i as u32);
        all.positions = order.iter().map(|v| all.positions[*v as usize]).collect();
        all.triangles.iter_mut().for_each(|t| *t = t.map(|v| new[v as usize]));
        all
    }

    fn locked(&self, mesh: &TriMesh) -> Vec<bool> {
        let unit = |v: u64| scramble(self.seed ^ v << 20) as f64 / u64::MAX as f64;
        (0..mesh.positions.len() as u64).map(|v| unit(v) < self.locks).collect()
    }

    fn target(&self, mesh: &TriMesh) -> usize {
        (mesh.triangles.len() as f64 * self.keep) as usize
    }

    fn run(&self, mesh: &TriMesh) -> Run {
        run(mesh, &self.locked(mesh), self.target(mesh))
    }
}

fn scramble(x: u64) -> u64 {
    let x = (x ^ 0x51ed_270b).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) ^ (x >> 32)
}

/// Carries the collapses out one by one on plain triangles, looking at every step.
fn check_by_replay(mesh: &TriMesh, locked: &[bool], run: &Run) -> Result<(), TestCaseError> {
    let mut alive = vec![true; mesh.positions.len()];
    let mut triangles = mesh.triangles.clone();
    let mut error = 0.0;
    let (vertex_count, record) = (mesh.positions.len(), &run.record);
    let (new, base) = (&record.old_to_new, record.base_vertex_count());
    let renumbered: Vec<[u16; 3]> = local(mesh).iter().map(|t| t.map(|v| new[usize::from(v)])).collect();
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
        let (edges, after) = (edge_counts(&lod), topology(&lod));
        prop_assert_eq!((edges.non_manifold, edges.inconsistent), (0, 0));
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
    fn a_decimation_is_what_it_says(case in cases()) {
        let mesh = case.mesh();
        let (run, target) = (case.run(&mesh), case.target(&mesh));
        prop_assert_eq!(run.stalled, run.triangle_count > target);
        prop_assert!(run.stalled || run.triangle_count + 1 >= target);
        check_by_replay(&mesh, &case.locked(&mesh), &run)?;
    }

    #[test]
    fn every_level_of_detail_is_a_manifold_of_the_same_topology(case in cases()) {
        let mesh = case.mesh();
        check_levels_of_detail(&mesh, &case.run(&mesh))?;
    }

    #[test]
    fn a_used_kernel_answers_as_a_fresh_one(case in cases(), other in cases()) {
        let (mesh, before) = (case.mesh(), other.mesh());
        let fresh = case.run(&mesh);
        let mut decimator = Decimator::default();
        run_with(&mut decimator, &before, &other.locked(&before), 0, 0.0);
        for _ in 0..2 {
            let used = run_with(&mut decimator, &mesh, &case.locked(&mesh), case.target(&mesh), 0.0);
            prop_assert_eq!(&used.collapses, &fresh.collapses);
            prop_assert_eq!(used.refusals, fresh.refusals);
        }
    }

    /// The first of its collapses once more leave what they left, with other topology, too.
    #[test]
    fn a_decimation_is_carried_out_again_as_far_as_is_asked(case in cases(), part in 0.0f64..1.0, change in any::<bool>()) {
        let (mesh, mut decimator) = (case.mesh(), Decimator::default());
        let (locked, triangles) = (case.locked(&mesh), local(&mesh));
        let patch = Patch { positions: &mesh.positions, triangles: &triangles, locked: &locked, ..Patch::default() };
        decimator.topology = if change { Topology::Change } else { Topology::Keep };
        let state = |decimator: &Decimator| -> Vec<_> {
            let left = (0..triangles.len()).filter(|face| decimator.is_left(*face));
            left.map(|face| (decimator.corners(face), decimator.displacements()[face])).collect()
        };

        let all = decimator.decimate(&patch, 0, 0.0).collapses.to_vec();
        let steps = (all.len() as f64 * part) as usize;
        let again = decimator.decimate_again(&patch, &all[..steps], 0, 0.0);
        prop_assert_eq!(again.collapses, &all[..steps]);
        let (forced, dropped, left) = (again.forced, again.dropped.to_vec(), again.triangle_count);
        let after = state(&decimator);
        prop_assert_eq!(after.len(), left);

        // A run that ends there by itself, as far as one does.
        let short = decimator.decimate(&patch, left, 0.0);
        if short.collapses.len() == steps {
            prop_assert_eq!((short.forced, short.dropped), (forced, &dropped[..]));
            prop_assert_eq!(state(&decimator), after);
        }
    }

    #[test]
    fn a_longer_run_begins_as_a_shorter_one(case in cases()) {
        let mesh = case.mesh();
        let (long, short) = (run(&mesh, &case.locked(&mesh), 0), case.run(&mesh));
        prop_assert_eq!(&long.collapses[..short.collapses.len()], &short.collapses[..]);
    }

    /// Whatever was refused gets another chance where the mesh about it changes, so nothing legal is left behind.
    #[test]
    fn a_stalled_mesh_stays_stalled(case in cases()) {
        let mesh = case.mesh();
        let locked = case.locked(&mesh);
        let least = run(&mesh, &locked, 0);
        prop_assert_eq!(run(&least.mesh, &locked, 0).collapses, []);
    }

    /// Coordinates on a lattice of 2^-12, so that moving them is exact.
    #[test]
    fn moving_the_mesh_changes_nothing(case in cases(), offset in prop::array::uniform3(-1000i16..1000)) {
        let mut mesh = case.mesh();
        mesh.positions.as_flattened_mut().iter_mut().for_each(|x| *x = (*x * 4096.0).round() / 4096.0);
        let here = case.run(&mesh);
        for p in &mut mesh.positions {
            *p = std::array::from_fn(|a| p[a] + f32::from(offset[a]));
        }
        prop_assert_eq!(here.collapses, case.run(&mesh).collapses);
    }

    #[test]
    fn scaling_by_a_power_of_two_scales_the_errors(case in cases(), exponent in -60i32..60) {
        let mut mesh = case.mesh();
        let here = case.run(&mesh);
        let scale = f64::from(exponent).exp2() as f32;
        mesh.positions.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
        let scaled: Vec<_> = here.collapses.iter().map(|c| Collapse { error: c.error * scale, ..*c }).collect();
        prop_assert_eq!(scaled, case.run(&mesh).collapses);
    }
}
