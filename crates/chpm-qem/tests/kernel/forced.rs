//! Collapses that change the topology: where they are needed, and where waiting does better.

use crate::play::{any_mesh, played, run, run_in, run_with};
use chpm_mesh::TriMesh;
use chpm_qem::{Decimator, Refusal, Topology};
use chpm_synth::hard::Case;
use chpm_synth::{Shape, Synth};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// Pages of one quad across about a straight spine; the spine's vertices come first.
fn book(pages: u32, quads: u32) -> TriMesh {
    let column = |x: f64, y: f64| (0..=quads).map(move |z| [x as f32, y as f32, z as f32]);
    let mut mesh = TriMesh::new(column(0.0, 0.0).collect(), Vec::new());
    for page in 0..pages {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(page) / f64::from(pages)).sin_cos();
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(column(cos, sin));
        for [a, b] in (0..quads).map(|z| [z, first + z]) {
            mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }
    mesh
}

#[test]
fn a_spine_of_any_number_of_pages_goes_along_itself() {
    for pages in [3, 4, 15, 16, 17, 40, 50] {
        let mesh = book(pages, 12);
        // Two triangles a page; in the outermost rows nothing is wrong with four.
        let run = run_in(Topology::Change, &mesh, 4 * pages as usize);
        assert!(!run.stalled, "{pages} pages: {} triangles", run.triangle_count);
        // Of an even number only the ends are on the mesh boundary, which leads off the spine.
        if pages % 2 == 0 {
            continue;
        }
        let off = run.collapses.iter().filter(|c| c.from <= 12 && c.to > 12).count();
        assert_eq!(off, 0, "{pages} pages");
    }
}

/// A vertex that may be forced can be in the queue twice; what was kept of it goes at its own price only. The kernel asserts it.
#[test]
fn what_was_kept_goes_at_its_own_price() {
    for seed in 0..4 {
        let mesh = Synth::new(Shape::Isosurface, 12_000, seed).to_mesh();
        let run = run_in(Topology::Change, &mesh, 200);
        assert!(!run.stalled && run.triangle_count <= 200);
    }
}

/// Every corner inside has 48 faces or so, and more with each collapse.
#[test]
fn cubes_that_touch_become_few_triangles() {
    for name in ["cubes", "voxels"] {
        let mesh = Case::find(name).expect("a case").mesh(6000);
        let run = run_in(Topology::Change, &mesh, 100);
        assert!(!run.stalled, "{name}: {} triangles are left", run.triangle_count);
    }
}

#[test]
fn what_locks_hold_back_waits_for_their_release() {
    // About the origin; the first corner is a spike from which two of the others are out of sight.
    let ring = [[3.0, 0.0], [0.3, 0.1], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [0.3, -0.1]];
    let positions = [[0.0; 2]].iter().chain(&ring).map(|[x, y]| [*x, *y, 0.0]).collect();
    let mesh = TriMesh::new(positions, (1..=6).map(|i| [0, i, i % 6 + 1]).collect());
    let locked: Vec<bool> = (0..7).map(|v| v >= 2).collect();
    let run = run(&mesh, &locked, 0);
    assert!(run.stalled && run.collapses.is_empty(), "{:?}", run.collapses);
    assert!(run.refused(Refusal::LockedEdge) > 0 && run.refused(Refusal::Flip) > 0);
}

/// Edges whose both ends are locked, and triangles whose corners all are.
fn between_locked(mesh: &TriMesh, locked: &[bool]) -> BTreeSet<Vec<u32>> {
    let sides = |t: &[u32; 3]| [vec![t[0], t[1]], vec![t[1], t[2]], vec![t[2], t[0]], t.to_vec()];
    let mut all: Vec<Vec<u32>> = mesh.triangles.iter().flat_map(sides).collect();
    all.iter_mut().for_each(|corners| corners.sort_unstable());
    all.into_iter().filter(|corners| corners.iter().all(|v| locked[*v as usize])).collect()
}

/// Vertices of edges that an odd number of faces have.
fn on_odd_edges(mesh: &TriMesh) -> BTreeSet<u32> {
    let mut odd = BTreeSet::new();
    for [a, b] in mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]) {
        let edge = [a.min(b), a.max(b)];
        if !odd.remove(&edge) {
            odd.insert(edge);
        }
    }
    odd.into_iter().flatten().collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Whatever is forced, no boundary appears where there was none: edges of an odd number of faces stay among the vertices that had some. Here
    /// they are those of a few faces on closed pieces that hang together anyhow.
    #[test]
    fn the_boundary_stays_where_it_is(
        pieces in prop::collection::vec(prop::array::uniform4(0u32..12), 1..12),
        faces in prop::collection::vec(prop::array::uniform3(0u32..12), 1..4),
        positions in prop::collection::vec(prop::array::uniform3(-3i8..4), 12),
    ) {
        let whole = pieces.iter().filter(|piece| piece.iter().collect::<BTreeSet<_>>().len() == 4);
        let closed = whole.flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d], [a, d, b], [b, d, c]]);
        let mesh = any_mesh(closed.chain(faces).collect(), &positions);
        prop_assume!(mesh.is_some());
        let mesh = mesh.unwrap_or_default();
        let run = run_in(Topology::Change, &mesh, 0);
        let border = on_odd_edges(&mesh);
        for steps in 1..=run.collapses.len() {
            let left = on_odd_edges(&played(&mesh, &run.collapses[..steps]));
            prop_assert!(left.is_subset(&border), "after {}: {:?}", steps, left.difference(&border));
        }
    }

    /// Another cluster may have, or make, an edge or a triangle of vertices that are locked: no collapse makes one, forced or not.
    #[test]
    fn locked_vertices_get_no_new_edge(
        corners in prop::collection::vec(prop::array::uniform3(0u32..12), 1..40),
        positions in prop::collection::vec(prop::array::uniform3(-3i8..4), 12),
        locked in prop::collection::vec(any::<bool>(), 12),
    ) {
        let mesh = any_mesh(corners, &positions);
        prop_assume!(mesh.is_some());
        let mesh = mesh.unwrap_or_default();
        let mut decimator = Decimator::default();
        decimator.topology = Topology::Change;
        let run = run_with(&mut decimator, &mesh, &locked, 0, 0.0);
        let (before, after) = (between_locked(&mesh, &locked), between_locked(&run.mesh, &locked));
        prop_assert!(after.is_subset(&before), "{:?}", after.difference(&before));
    }
}
