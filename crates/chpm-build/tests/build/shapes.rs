//! Well-behaved sources: every shape, attributes, doubles, deep hierarchies.

use crate::site::{Site, check_against, check_height, config, levels_of_detail, moved, with_attributes};
use chpm_build::config::{Normals, Topology};
use chpm_measure::{edge_counts, topology};
use chpm_mesh::{Attributes, Level};
use chpm_partition::Partitioner;
use chpm_refine::{Cut, extract};
use chpm_synth::{Shape, Synth, hand};

#[test]
fn every_shape_builds_and_every_cut_of_it_holds_together() {
    for shape in Shape::ALL {
        for partitioner in [Partitioner::Metis, Partitioner::Greedy] {
            let mesh = Synth::new(shape, 30_000, 7).to_mesh();
            let mut config = config(1024);
            config.settings.partitioner = partitioner;
            let (report, file) = Site::of(&mesh).build(&config);
            assert_eq!((report.triangles, report.roots), (mesh.triangles.len() as u64, 1), "{shape}");
            check_against(&file, &mesh);
            check_height(&file);
            let edges = edge_counts(&mesh);
            assert_eq!(report.repairs.boundary_edges, edges.boundary as u64, "{shape}");
            assert_eq!(report.repairs.components, topology(&mesh).components as u64, "{shape}");
        }
    }
}

#[test]
fn clusters_have_about_the_size_that_was_asked_for() {
    let mesh = Synth::new(Shape::Terrain, 60_000, 1).to_mesh();
    for size in [512, 4096] {
        let (_, file) = Site::of(&mesh).build(&config(size));
        let leaves: Vec<u32> =
            file.clusters().iter().filter(|c| c.level == 0).map(|c| c.triangle_count).collect();
        let mean = mesh.triangles.len() / leaves.len();
        assert!(mean > size as usize / 2 && mean < 2 * size as usize, "{mean} for {size}");
        let largest = leaves.iter().max().copied().unwrap_or_default() as usize;
        assert!(largest < 2 * mean, "{largest} where {mean} is the mean");
    }
}

#[test]
fn a_well_behaved_surface_halves_at_every_level() {
    let mesh = Synth::new(Shape::Terrain, 60_000, 3).to_mesh();
    let (report, file) = Site::of(&mesh).build(&config(2048));
    for level in &report.levels {
        assert_eq!(level.stalled, 0, "level {}", level.level);
        let share = level.base_triangles as f64 / level.triangles as f64;
        assert!(share <= 0.5, "level {}: {share}", level.level);
        // The root goes on, since nothing above it will.
        let is_top = level.level as usize == report.levels.len() - 1;
        assert!(is_top || share > 0.49, "level {}: {share}", level.level);
        assert!(!is_top || level.base_triangles <= 100, "{} triangles", level.base_triangles);
    }
    // A root's finest mesh is the source halved once per level below it.
    let top = file.levels().len() as u32 - 1;
    let coarsest = extract(&file, &Cut::at_level(&file, Level(top))).unwrap();
    let expected = mesh.triangles.len() >> top;
    assert!(coarsest.triangles.len().abs_diff(expected) < expected / 50);
}

#[test]
fn a_deep_hierarchy_of_tiny_clusters_holds_together() {
    for (shape, seed) in [(Shape::Sphere, 0), (Shape::Isosurface, 2), (Shape::Plates, 3)] {
        let mesh = Synth::new(shape, 12_000, seed).to_mesh();
        let (report, file) = Site::of(&mesh).build(&config(64));
        assert!(file.levels().len() >= 7, "{shape}: {} levels", file.levels().len());
        assert_eq!(report.roots, 1);
        check_against(&file, &mesh);
        check_height(&file);
    }
}

#[test]
fn a_closed_surface_stays_a_closed_surface_at_every_level() {
    let mesh = Synth::new(Shape::Sphere, 20_000, 0).to_mesh();
    let mut config = config(256);
    config.settings.topology = Topology::Keep;
    let (_, file) = Site::of(&mesh).build(&config);
    for lod in levels_of_detail(&file) {
        let (edges, shape) = (edge_counts(&lod), topology(&lod));
        assert_eq!((edges.boundary, edges.non_manifold, edges.inconsistent), (0, 0, 0));
        assert_eq!((shape.components, shape.euler), (1, 2));
    }
}

#[test]
fn attributes_stay_with_their_vertices_bit_by_bit() {
    let mesh = with_attributes(Synth::new(Shape::Torus, 20_000, 0).to_mesh());
    let (_, file) = Site::of(&mesh).build(&config(512));
    assert_eq!(file.header().attributes(), Attributes::ALL);
    check_against(&file, &mesh);
}

#[test]
fn attributes_that_nobody_wants_are_left_out() {
    let mut mesh = with_attributes(Synth::new(Shape::Torus, 5_000, 0).to_mesh());
    let mut config = config(512);
    (config.settings.normals, config.settings.colors) = (Normals::None, true);
    let (_, file) = Site::of(&mesh).build(&config);
    assert_eq!(file.header().attributes(), Attributes { colors: true, ..Attributes::NONE });
    mesh.normals.clear();
    check_against(&file, &mesh);
}

#[test]
fn doubles_far_from_the_origin_keep_their_detail() {
    let mesh = Synth::new(Shape::Terrain, 20_000, 5).to_mesh();
    let offset = [1e7 + 0.3, -1e7 - 0.7, 3e6 + 0.1];
    let (report, file) = Site::of_doubles(&mesh, offset).build(&config(1024));
    assert!(report.warnings.iter().any(|w| w.contains("rounded")), "{:?}", report.warnings);
    let origin = file.header().origin;
    let finest = extract(&file, &Cut::at_level(&file, Level(0))).unwrap();
    assert_eq!(finest.triangles.len(), mesh.triangles.len());
    assert_eq!(topology(&finest), topology(&mesh));
    // The origin is a whole number at this distance, so coordinates about it are below 2 and rounded by at most 2^-24.
    let mut expected: Vec<[f64; 3]> = mesh.positions.iter().map(|p| moved(*p, offset)).collect();
    let mut got: Vec<[f64; 3]> = finest.positions.iter().map(|p| moved(*p, origin)).collect();
    let by_place = |a: &[f64; 3], b: &[f64; 3]| {
        let cell = |p: &[f64; 3]| [p[0], p[1]].map(|x| (x * 1e5).round() as i64);
        cell(a).cmp(&cell(b))
    };
    expected.sort_by(by_place);
    got.sort_by(by_place);
    for (a, b) in expected.iter().zip(&got) {
        assert!((0..3).all(|axis| (a[axis] - b[axis]).abs() <= (-24f64).exp2()), "{a:?} became {b:?}");
    }
    for lod in levels_of_detail(&file) {
        assert_eq!(chpm_measure::cracks(&lod, &finest), []);
    }
}

#[test]
fn doubles_that_are_singles_keep_their_bits() {
    let mesh = Synth::new(Shape::Sphere, 4_000, 0).to_mesh();
    let (report, file) = Site::of_doubles(&mesh, [0.0; 3]).build(&config(1024));
    assert_eq!((file.header().origin, report.warnings.len()), ([0.0; 3], 0));
    check_against(&file, &mesh);
}

#[test]
fn a_source_smaller_than_a_cluster_is_one_cluster() {
    for mesh in [hand::tetrahedron(), hand::cube(), hand::grid(20, 20), hand::strip(1)] {
        let (report, file) = Site::of(&mesh).build(&config(4096));
        assert_eq!((report.clusters, report.roots, file.levels().len()), (1, 1, 1));
        assert_eq!(file.header().shared_vertex_count, 0);
        check_against(&file, &mesh);
    }
}

#[test]
fn errors_grow_with_the_level() {
    let mesh = Synth::new(Shape::Terrain, 30_000, 2).to_mesh();
    let (report, _) = Site::of(&mesh).build(&config(512));
    for pair in report.levels.windows(2) {
        assert!(pair[0].max_error <= pair[1].max_error && pair[0].min_error <= pair[1].min_error);
    }
    assert_eq!(report.levels[0].min_error, 0.0);
}
