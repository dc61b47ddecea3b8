//! Sources that are anything but well-behaved.

use crate::site::{
    Site, check_against, check_height, config, levels_of_detail, triangle_bits, without_copies,
};
use chpm_build::config::Topology;
use chpm_build::report::Repairs;
use chpm_build::{BuildError, Cancel, Silent};
use chpm_format::BoundaryMode;
use chpm_mesh::{Level, TriMesh};
use chpm_refine::{Cut, extract};
use chpm_synth::{Shape, Synth, hand};

/// Builds and checks that the leaves hold what the source holds; cracks make no sense for some of these.
fn builds(name: &str, mesh: &TriMesh, cluster_triangles: u32) -> chpm_build::BuildReport {
    let (report, file) = Site::of(mesh).build(&config(cluster_triangles));
    let finest = extract(&file, &Cut::at_level(&file, Level(0))).unwrap();
    assert!(
        triangle_bits(&finest) == triangle_bits(&without_copies(mesh)),
        "{name}: the leaves are not the source"
    );
    check_height(&file);
    for lod in levels_of_detail(&file) {
        assert!(lod.triangles.len() <= mesh.triangles.len(), "{name}");
    }
    report
}

#[test]
fn hand_made_meshes_build() {
    for (name, mesh) in [
        ("bow tie", hand::bow_tie()),
        ("moebius", hand::moebius(300)),
        ("klein bottle", hand::klein_bottle(30)),
        ("two cubes", hand::two_cubes_sharing_an_edge()),
        ("isolated vertex", hand::isolated_vertex()),
        ("duplicate faces", hand::duplicate_faces()),
        ("mixed winding", hand::mixed_winding()),
        ("soup", hand::soup(500)),
        ("edge fan", hand::edge_fan(400)),
        ("fan", hand::fan(700)),
        ("strip", hand::strip(2000)),
    ] {
        for size in [64, 4096] {
            builds(name, &mesh, size);
        }
    }
}

#[test]
fn oddities_are_counted() {
    assert_eq!(builds("isolated vertex", &hand::isolated_vertex(), 64).repairs.unreferenced_vertices, 1);
    assert_eq!(builds("duplicates", &hand::duplicate_faces(), 64).repairs.merged_copies, 1);
    assert_eq!(builds("mixed winding", &hand::mixed_winding(), 64).repairs.mixed_winding_edges, 1);
    assert_eq!(builds("two cubes", &hand::two_cubes_sharing_an_edge(), 64).repairs.non_manifold_edges, 1);
    assert_eq!(builds("bow tie", &hand::bow_tie(), 64).repairs.non_manifold_vertices, 1);
    assert_eq!(builds("soup", &hand::soup(77), 64).repairs.components, 77);
    let mut mesh = hand::grid(3, 3);
    mesh.triangles.push([4, 4, 5]);
    assert_eq!(builds("degenerate", &mesh, 64).repairs.degenerate_faces, 1);
}

#[test]
fn a_soup_that_does_not_fit_one_cluster_has_several_roots() {
    let mesh = hand::soup(60_000);
    let mut config = config(4096);
    (config.settings.boundary, config.settings.topology) = (BoundaryMode::Lock, Topology::Keep);
    let (report, _) = Site::of(&mesh).build(&config);
    // Three vertices each and nothing that may collapse: a root holds at most 21,845 triangles.
    assert!(report.roots >= 3, "{} roots", report.roots);
    assert!(report.levels.iter().all(|level| level.base_triangles == level.triangles));
}

#[test]
fn a_soup_may_vanish_piece_by_piece() {
    let report = builds("soup", &hand::soup(60_000), 4096);
    assert_eq!(report.roots, 1);
    assert!(report.levels.iter().all(|level| 2 * level.base_triangles <= level.triangles));
}

#[test]
fn a_hundred_thousand_triangles_about_one_vertex_build() {
    let mesh = hand::fan(100_000);
    let report = builds("fan", &mesh, 4096);
    assert_eq!(report.repairs.components, 1);
    assert_eq!(report.repairs.boundary_loops, 1);
}

#[test]
fn all_vertices_in_one_point_build() {
    let mut mesh = hand::grid(70, 70);
    mesh.positions.fill([1.0, 2.0, 3.0]);
    let report = builds("a point", &mesh, 512);
    assert_eq!(report.repairs.zero_area_faces, 9800);
    let top = report.levels.last().unwrap();
    assert_eq!(top.max_error, 0.0);
}

#[test]
fn copies_of_a_triangle_are_one_with_a_count() {
    let mut mesh = hand::strip(1);
    let triangle = mesh.triangles[0];
    let [x, y, z] = triangle;
    mesh.triangles = [triangle, [y, z, x], [z, x, y]].into_iter().cycle().take(50_000).collect();
    let (report, file) = Site::of(&mesh).build(&config(4096));
    assert_eq!((report.triangles, report.levels[0].clusters, report.repairs.merged_copies), (1, 1, 49_999));
    assert!(file.metadata().unwrap().repairs.contains(&("merged-copies".to_owned(), 49_999)));
    // The other side of a sheet is a face of its own.
    mesh.triangles.extend([[y, x, z]; 7]);
    let repairs = Site::of(&mesh).build(&config(4096)).0.repairs;
    assert_eq!((repairs.merged_copies, repairs.two_sided_faces), (49_999 + 6, 1));
}

#[test]
fn a_mesh_whose_copies_lie_anywhere_is_the_mesh_without_them() {
    let once = Synth::new(Shape::Isosurface, 9_000, 4).to_mesh();
    let mut often = once.clone();
    let n = once.triangles.len();
    // In an order of no coherence, so that copies come far apart.
    often.triangles.extend((0..4 * n).map(|i| once.triangles[i * 7919 % n]));
    for cluster_triangles in [16, 128, 4096] {
        let (report, file) = Site::of(&often).build(&config(cluster_triangles));
        assert_eq!((report.triangles, report.repairs.merged_copies), (n as u64, 4 * n as u64));
        let finest = extract(&file, &Cut::at_level(&file, Level(0))).unwrap();
        assert!(triangle_bits(&finest) == triangle_bits(&once));
        let plain = Site::of(&once).build(&config(cluster_triangles)).0;
        assert_eq!(
            Repairs { merged_copies: 0, ..report.repairs },
            plain.repairs,
            "what is odd about it does not depend on copies"
        );
        assert_eq!(report.roots, plain.roots);
    }
}

#[test]
fn thousands_of_components_build_and_hold_together() {
    let tetrahedron = hand::tetrahedron();
    let mut mesh = TriMesh::default();
    for i in 0..3000u32 {
        let shift = [(i % 20) as f32 * 2.0, (i / 20 % 20) as f32 * 2.0, (i / 400) as f32 * 2.0];
        mesh.positions.extend(tetrahedron.positions.iter().map(|p| [0, 1, 2].map(|a| p[a] + shift[a])));
        mesh.triangles.extend(tetrahedron.triangles.iter().map(|t| t.map(|v| v + 4 * i)));
    }
    let (report, file) = Site::of(&mesh).build(&config(512));
    assert_eq!(report.repairs.components, 3000);
    check_against(&file, &mesh);
}

#[test]
fn coordinates_of_any_size_build() {
    for scale in [1e-30f32, 1e-12, 1e12, 1e30] {
        let mut mesh = Synth::new(Shape::Terrain, 4_000, 1).to_mesh();
        mesh.positions.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
        let (report, file) = Site::of(&mesh).build(&config(512));
        check_against(&file, &mesh);
        let stalled: u32 = report.levels.iter().map(|l| l.stalled).sum();
        assert_eq!(stalled, 0, "at a scale of {scale}");
        assert!(report.levels.iter().all(|l| l.max_error.is_finite()));
    }
}

#[test]
fn nothing_to_build_is_an_error() {
    for mesh in [
        TriMesh::new(vec![[0.0; 3]; 3], vec![[0, 0, 1]]),
        TriMesh::new(vec![[0.0; 3]; 4], vec![[1, 1, 1], [2, 3, 2]]),
    ] {
        let site = Site::of(&mesh);
        let result = site.try_build(&config(64), &Silent, &Cancel::default());
        assert!(matches!(result, Err(BuildError::Empty { .. })), "{result:?}");
        assert_eq!(site.files(), ["mesh.ply"]);
    }
}
