//! Small meshes with exact answers.

use crate::play::{corner_sets, free, played, run};
use chpm_measure::{boundary_vertices, deviation, edge_counts, topology};
use chpm_mesh::{TriMesh, geom};
use chpm_qem::Refusal;
use chpm_synth::hand;
use proptest::prelude::*;

fn doubled_area(mesh: &TriMesh, triangle: &[u32; 3]) -> f64 {
    let [a, b, c] = mesh.corners(*triangle);
    geom::area_vector(a, b, c).norm()
}

fn area(mesh: &TriMesh) -> f64 {
    0.5 * mesh.triangles.iter().map(|t| doubled_area(mesh, t)).sum::<f64>()
}

/// Whatever can collapse does, and components, loops and Euler characteristic stay.
fn keeps_its_topology(name: &str, mesh: &TriMesh) {
    let (before, after) = (topology(mesh), topology(&free(mesh, 0).mesh));
    let shape = |t: chpm_measure::Topology| (t.components, t.boundary_loops, t.euler, t.is_manifold());
    assert_eq!(shape(before), shape(after), "{name}");
}

#[test]
fn a_plane_ends_as_two_triangles_without_error() {
    for (nx, ny) in [(2, 2), (8, 8), (13, 5), (40, 25)] {
        let mesh = hand::grid(nx, ny);
        let run = free(&mesh, 2);
        assert_eq!((run.triangle_count, run.max_error()), (2, 0.0), "{nx} x {ny}");
        assert_eq!(area(&run.mesh), f64::from(nx * ny), "{nx} x {ny}");
        let corners = [0, nx, (nx + 1) * ny, (nx + 1) * (ny + 1) - 1];
        assert_eq!(boundary_vertices(&run.mesh), corners, "{nx} x {ny}");
        assert_eq!(deviation(&mesh, &run.mesh, 4).max(), 0.0);
    }
}

#[test]
fn a_plane_halves_without_touching_its_outline() {
    let mesh = hand::grid(16, 16);
    let run = free(&mesh, 256);
    assert!(matches!(run.triangle_count, 255 | 256));
    assert_eq!((run.stalled, run.max_error()), (false, 0.0));
    assert_eq!(area(&run.mesh), 256.0);
}

#[test]
fn no_triangle_loses_its_area() {
    for mesh in [hand::grid(9, 9), hand::strip(40), subdivided_cube(5)] {
        let run = free(&mesh, 0);
        for n in 0..=run.collapses.len() {
            let lod = played(&mesh, &run.collapses[..n]);
            let least = lod.triangles.iter().map(|t| doubled_area(&lod, t)).fold(f64::INFINITY, f64::min);
            assert!(least > 0.0, "after {n} collapses");
        }
    }
}

#[test]
fn a_target_is_met_exactly_or_undercut_by_one() {
    let mesh = hand::grid(12, 12);
    for target in [287, 286, 200, 101, 7, 2] {
        let run = free(&mesh, target);
        assert!(run.triangle_count == target || run.triangle_count + 1 == target, "{target}");
    }
    let all = free(&mesh, 288);
    assert!(all.collapses.is_empty() && !all.stalled && all.triangle_count == 288);
}

#[test]
fn a_cube_goes_back_to_its_corners() {
    // Edges of a subdivided cube are straight and faces flat, so all but a few collapses are free but for rounding. Of larger ones
    // some triangles more are left before nothing flat is legal.
    let mesh = subdivided_cube(3);
    let run = free(&mesh, 12);
    assert_eq!(run.triangle_count, 12);
    assert!(run.max_error() < 1e-10, "{}", run.max_error());
    assert_eq!(area(&run.mesh), 6.0 * 9.0);
    let kept = run.record.new_to_old[..run.record.base_vertex_count()].iter();
    let corner = |v: &&u16| mesh.positions[usize::from(**v)].iter().all(|x| *x == 0.0 || *x == 3.0);
    assert_eq!(kept.filter(corner).count(), 8);
}

/// A cube of edge `n`, `n` by `n` quads a side.
fn subdivided_cube(n: u32) -> TriMesh {
    type Place = fn(f32, f32, f32) -> [f32; 3];
    let mut mesh = TriMesh::default();
    let side = hand::grid(n, n);
    let far = n as f32;
    let map: [Place; 6] = [
        |x, y, _| [y, x, 0.0],
        |x, y, n| [x, y, n],
        |x, y, _| [x, 0.0, y],
        |x, y, n| [y, n, x],
        |x, y, _| [0.0, y, x],
        |x, y, n| [n, x, y],
    ];
    for place in map {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(side.positions.iter().map(|p| place(p[0], p[1], far)));
        mesh.triangles.extend(side.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    let mut welded = chpm_measure::weld(&mesh);
    // Numbers without gaps.
    let mut used: Vec<u32> = welded.triangles.concat();
    used.sort_unstable();
    used.dedup();
    for corner in welded.triangles.as_flattened_mut() {
        *corner = used.partition_point(|v| v < corner) as u32;
    }
    welded.positions = used.iter().map(|v| welded.positions[*v as usize]).collect();
    welded
}

#[test]
fn the_subdivided_cube_is_one() {
    let mesh = subdivided_cube(6);
    let shape = topology(&mesh);
    assert!(shape.is_closed() && shape.is_manifold() && shape.euler == 2);
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (6 * 36 + 2, 12 * 36));
    assert_eq!(edge_counts(&mesh).inconsistent, 0);
}

#[test]
fn a_tetrahedron_cannot_collapse() {
    let run = free(&hand::tetrahedron(), 0);
    assert!(run.collapses.is_empty() && run.stalled);
    assert_eq!(run.triangle_count, 4);
    assert_eq!(run.refused(Refusal::Link), 12, "each of the four vertices has three neighbours");
}

#[test]
fn a_lone_triangle_is_the_last_of_its_component() {
    for n in [1, 7] {
        let run = free(&hand::soup(n), 0);
        assert!(run.collapses.is_empty() && run.stalled);
        assert_eq!(run.refused(Refusal::Component), u64::from(6 * n));
    }
}

#[test]
fn a_strip_ends_as_one_triangle() {
    let run = free(&hand::strip(30), 0);
    assert_eq!(topology(&run.mesh).components, 1);
    assert!(run.triangle_count <= 2, "{}", run.triangle_count);
}

#[test]
fn locked_vertices_stay() {
    let mesh = hand::icosphere(3);
    let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v % 5 == 0).collect();
    let run = run(&mesh, &locked, 0);
    assert!(run.collapses.iter().all(|c| !locked[usize::from(c.from)]));
    assert!(run.refused(Refusal::LockedEdge) > 0);
    assert!(run.triangle_count < mesh.triangles.len() / 2, "{}", run.triangle_count);
}

#[test]
fn no_edge_appears_between_locked_vertices() {
    let edges = |mesh: &TriMesh, locked: &[bool]| {
        let mut edges: Vec<[u32; 2]> = mesh
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .filter(|e| e.iter().all(|v| locked[*v as usize]))
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    };
    for step in [2, 3, 7, 20] {
        let mesh = hand::icosphere(3);
        let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v % step == 0).collect();
        let run = run(&mesh, &locked, 0);
        let before = edges(&mesh, &locked);
        let new = edges(&run.mesh, &locked).into_iter().filter(|e| before.binary_search(e).is_err()).count();
        assert_eq!(new, 0, "every {step}th vertex locked");
    }
}

#[test]
fn nothing_goes_where_all_is_locked() {
    let mesh = hand::icosphere(2);
    let run = run(&mesh, &vec![true; mesh.positions.len()], 100);
    assert!(run.stalled && run.collapses.is_empty());
    assert_eq!((run.triangle_count, run.refusals), (320, Default::default()));
}

#[test]
fn a_vertex_of_two_fans_stays_and_its_fans_too() {
    let run = free(&hand::bow_tie(), 0);
    assert!(run.collapses.iter().all(|c| c.from != 0));
    assert!(run.refused(Refusal::NonManifold) >= 1);
    assert_eq!(run.triangle_count, 2, "each triangle is the last of its one_ring");
    assert!(run.refused(Refusal::Component) > 0);
}

#[test]
fn an_edge_of_three_faces_stays() {
    for k in [3, 4, 9] {
        let run = free(&hand::edge_fan(k), 0);
        assert!(run.collapses.iter().all(|c| c.from > 1), "{k}: {:?}", run.collapses);
        assert!(run.refused(Refusal::NonManifold) >= 2, "{k}");
    }
    let cubes = free(&hand::two_cubes_sharing_an_edge(), 0);
    assert!(cubes.collapses.iter().all(|c| c.from != 3 && c.from != 7));
}

#[test]
fn what_is_not_orientable_keeps_its_topology() {
    for n in [8, 20, 60] {
        keeps_its_topology("moebius", &hand::moebius(n));
    }
    for n in [6, 15] {
        keeps_its_topology("klein bottle", &hand::klein_bottle(n));
    }
    assert!(free(&hand::moebius(60), 0).refused(Refusal::NonManifold) > 0, "the seam");
    assert!(free(&hand::klein_bottle(15), 0).triangle_count < 450 / 2);
}

#[test]
fn manifolds_keep_their_topology() {
    for (name, mesh) in [
        ("tetrahedron", hand::tetrahedron()),
        ("cube", hand::cube()),
        ("grid", hand::grid(9, 4)),
        ("fan", hand::fan(12)),
        ("strip", hand::strip(17)),
        ("icosphere", hand::icosphere(3)),
        ("soup", hand::soup(5)),
        ("isolated vertex", hand::isolated_vertex()),
    ] {
        keeps_its_topology(name, &mesh);
    }
}

#[test]
fn mixed_winding_and_duplicates_are_left_alone_or_stay_a_surface() {
    let mixed = free(&hand::mixed_winding(), 0);
    assert!(mixed.triangle_count >= 1 && mixed.refused(Refusal::NonManifold) > 0);
    let duplicate = free(&hand::duplicate_faces(), 0);
    assert!(duplicate.refused(Refusal::NonManifold) > 0);
    // The two equal faces must not take their third with them.
    assert!(duplicate.triangle_count >= 2, "{:?}", duplicate.collapses);
}

#[test]
fn an_isolated_vertex_stays() {
    let run = free(&hand::isolated_vertex(), 0);
    assert_eq!((run.triangle_count, run.record.base_vertex_count()), (1, 4));
    assert_eq!(run.refused(Refusal::NonManifold), 1);
}

#[test]
fn nothing_and_points_alone_are_no_case_for_panic() {
    let nothing = free(&TriMesh::default(), 0);
    assert_eq!((nothing.triangle_count, nothing.stalled), (0, false));
    let points = free(&TriMesh::new(vec![[1.0; 3]; 5], Vec::new()), 0);
    assert_eq!((points.triangle_count, points.collapses.len()), (0, 0));
}

#[test]
fn a_hub_stays_while_its_rim_collapses() {
    let mesh = hand::fan(1000);
    let run = free(&mesh, 0);
    assert!(run.collapses.iter().all(|c| c.from != 0 && c.to != 0));
    assert!(run.refused(Refusal::Valence) > 0);
    assert_eq!(topology(&run.mesh).boundary_loops, 1);
    assert!(run.triangle_count < 20, "{}", run.triangle_count);
    let half = free(&mesh, 500);
    // An inscribed 500-gon: its chords lie 1 - cos(pi / 500) inside the circle.
    assert_eq!(half.triangle_count, 500);
    let depth = deviation(&mesh, &half.mesh, 4).max();
    assert!(depth < 4.0 * (1.0 - (std::f64::consts::PI / 500.0).cos()), "{depth}");
}

#[test]
fn a_closed_hub_of_any_valence_is_no_case_for_panic() {
    for n in [47, 48, 49, 60, 500] {
        // Two cones back to back: every rim vertex has valence four.
        let mut mesh = hand::fan(n);
        mesh.positions[0][2] = 1.0;
        let other = mesh.positions.len() as u32;
        mesh.positions.push([0.0, 0.0, -1.0]);
        let below: Vec<_> = mesh.triangles.iter().map(|&[_, a, b]| [other, b, a]).collect();
        mesh.triangles.extend(below);
        keeps_its_topology("bipyramid", &mesh);
    }
}

#[test]
fn triangles_without_area_go_first_and_cost_nothing() {
    // The middle row of a grid is squeezed onto the row below: 12 triangles lose their area.
    let mut mesh = hand::grid(6, 4);
    for v in 14..21 {
        mesh.positions[v][1] = 1.0;
    }
    let run = free(&mesh, 36);
    assert_eq!((run.triangle_count, run.max_error()), (36, 0.0));
    assert_eq!(area(&run.mesh), 24.0);
    assert_eq!(deviation(&mesh, &run.mesh, 4).max(), 0.0);
}

#[test]
fn all_vertices_in_one_point_is_no_case_for_panic() {
    let mut mesh = hand::icosphere(2);
    mesh.positions.fill([3.0, 4.0, 5.0]);
    let run = free(&mesh, 0);
    assert_eq!(run.max_error(), 0.0);
    assert_eq!(topology(&run.mesh).euler, 2);
    let sets = corner_sets(&run.mesh);
    assert!(sets.windows(2).all(|w| w[0] != w[1]));
}

#[test]
fn errors_start_from_the_error_that_the_patch_comes_with() {
    let mesh = hand::grid(6, 6);
    let mut decimator = chpm_qem::Decimator::default();
    let run = crate::play::run_with(&mut decimator, &mesh, &[false; 49], 10, 0.25);
    assert!(run.collapses.iter().all(|c| c.error == 0.25));
}

#[test]
fn a_spike_goes_last_and_costs_no_more_than_its_height() {
    let mut mesh = hand::grid(10, 10);
    mesh.positions[60][2] = 0.125;
    let flat = free(&mesh, 50);
    assert_eq!((flat.stalled, flat.max_error()), (false, 0.0));
    let none = free(&mesh, 2);
    let spike = none.collapses.iter().find(|c| c.from == 60).expect("two triangles have no room for it");
    assert!(spike.error >= 0.125 && spike.error < 0.25, "{spike:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any triangles over a few vertices: no panic, no face with two equal corners, fewer faces or none less.
    #[test]
    fn any_triangles_are_survived(
        corners in prop::collection::vec(prop::array::uniform3(0u32..14), 0..60),
        positions in prop::collection::vec(prop::array::uniform3(-2i8..3), 14),
        locks in prop::collection::vec(any::<bool>(), 14),
        target in 0usize..60,
    ) {
        let positions = positions.iter().map(|p| p.map(f32::from)).collect();
        let triangles: Vec<_> =
            corners.into_iter().filter(|[a, b, c]| a != b && b != c && c != a).collect();
        let mesh = TriMesh::new(positions, triangles);
        let run = run(&mesh, &locks, target);
        prop_assert_eq!(run.mesh.triangles.len(), run.triangle_count);
        prop_assert_eq!(run.stalled, run.triangle_count > target);
        prop_assert!(run.collapses.iter().all(|c| !locks[usize::from(c.from)]));
        prop_assert_eq!(topology(&mesh).components, topology(&run.mesh).components);
    }
}
