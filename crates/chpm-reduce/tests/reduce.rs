//! Meshes that are taken further: they are as near as they may be, and stay what they are.

use chpm_measure::proof::{Allowed, Prover, Verdict};
use chpm_measure::{Tiles, topology};
use chpm_mesh::{Aabb, TriMesh};
use chpm_reduce::{Effort, reduce};
use chpm_synth::{Shape, Synth};

const ALL: Effort = Effort { pieces: u64::MAX, places: 3 };

fn tiles(mesh: &TriMesh) -> Tiles<'_> {
    Tiles::new(vec![Aabb::of_points(&mesh.positions)], u64::MAX, |_| mesh.clone())
}

fn reduced(source: &TriMesh, distance: f64, effort: Effort) -> TriMesh {
    let left = reduce(source, (&tiles(source), source), distance, effort, &|| false);
    let count = source.positions.len() as u32;
    let positions = left.vertices.iter().map(|v| source.positions[(*v % count) as usize]).collect();
    TriMesh::new(positions, left.triangles)
}

/// Whether every triangle of one mesh is within a distance of the other, by proof.
fn is_within(from: &TriMesh, to: &TriMesh, distance: f64) -> bool {
    let used: Vec<[f32; 3]> = to.triangles.as_flattened().iter().map(|v| to.positions[*v as usize]).collect();
    let target = Tiles::new(vec![Aabb::of_points(&used)], u64::MAX, |_| to.clone());
    let mut prover = Prover::new(&target, &|| false);
    let allowed = Allowed::Same(distance);
    from.triangles
        .iter()
        .all(|t| prover.within(from.corners(*t), &allowed, 1 << 20).verdict == Verdict::Within)
}

#[test]
fn what_is_left_is_within_the_distance_both_ways_and_of_the_same_topology() {
    for shape in [Shape::Terrain, Shape::Isosurface] {
        let source = Synth::new(shape, 4000, 3).to_mesh();
        let diagonal = Aabb::of_points(&source.positions).diagonal();
        let mut last = source.triangles.len();
        for share in [1e-4, 1e-3, 1e-2] {
            let distance = share * diagonal;
            let mesh = reduced(&source, distance, ALL);
            assert!(
                is_within(&mesh, &source, distance) && is_within(&source, &mesh, distance),
                "{shape:?} {share}"
            );
            assert!(mesh.triangles.len() < last, "{shape:?} {share}: {} of {last}", mesh.triangles.len());
            last = mesh.triangles.len();

            let (before, after) = (topology(&source), topology(&mesh));
            assert_eq!(after.non_manifold_edges, before.non_manifold_edges, "{shape:?} {share}");
            assert_eq!(after.components, before.components, "{shape:?} {share}");
        }
        assert!(last < source.triangles.len() / 3, "{shape:?}: {last}");
    }
}

#[test]
fn a_plate_becomes_two_triangles_and_a_bent_one_keeps_its_bend() {
    let grid = |height: fn(usize) -> f32| {
        let points = (0..81).map(|i| [(i % 9) as f32, (i / 9) as f32, height(i % 9)]).collect();
        let squares =
            (0..64).map(|i| i / 8 * 9 + i % 8).flat_map(|v| [[v, v + 1, v + 10], [v, v + 10, v + 9]]);
        TriMesh::new(points, squares.collect())
    };
    let flat = grid(|_| 0.0);
    assert_eq!(reduced(&flat, 1e-6, ALL).triangles.len(), 2);
    let bent = grid(|x| if x < 4 { 0.0 } else { x as f32 - 4.0 });
    assert_eq!(reduced(&bent, 1e-6, ALL).triangles.len(), 4);
}

#[test]
fn nothing_goes_where_nothing_may() {
    let source = Synth::new(Shape::Isosurface, 500, 3).to_mesh();
    assert_eq!(reduced(&source, 0.0, ALL).triangles.len(), source.triangles.len());
    let none = Effort { pieces: 0, places: 3 };
    assert_eq!(reduced(&source, 1.0, none).triangles, source.triangles);
}

#[test]
fn odd_meshes_are_left_whole_where_they_are_odd() {
    // Two fans that share their middle, three faces at an edge, a copy, a face of no area.
    let mut bow = vec![[0.0; 3]];
    bow.extend((0..6).map(|i| [(i % 3) as f32 + 1.0, (i / 3) as f32, 0.0]));
    let fans = TriMesh::new(bow.clone(), vec![[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 6]]);
    let book = TriMesh::new(bow.clone(), vec![[0, 1, 2], [0, 1, 4], [0, 1, 5], [0, 1, 2]]);
    let none = TriMesh::new(bow.clone(), vec![[0, 1, 1], [0, 2, 3]]);
    let empty = TriMesh::new(bow, Vec::new());
    for mesh in [fans, book, none, empty] {
        let left = reduced(&mesh, 0.01, ALL);
        assert!(is_within(&mesh, &left, 0.01 + 1e-9), "{:?}", left.triangles);
    }
    // A closed tetrahedron stays one.
    let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let tetrahedron = TriMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]);
    assert_eq!(reduced(&tetrahedron, 10.0, ALL).triangles.len(), 4);
}

#[test]
fn more_places_leave_fewer_triangles_and_each_is_one_of_the_source() {
    let source = Synth::new(Shape::Isosurface, 8000, 3).to_mesh();
    let distance = 0.01 * Aabb::of_points(&source.positions).diagonal();
    let count = |places| reduced(&source, distance, Effort { places, ..ALL }).triangles.len();
    let counts = [0, 3].map(count);
    assert!(counts[1] < counts[0], "{counts:?}");

    // Some vertices were put where neither of two was.
    let left = reduce(&source, (&tiles(&source), &source), distance, ALL, &|| false);
    let others = left
        .triangles
        .as_flattened()
        .iter()
        .filter(|v| left.vertices[**v as usize] >= source.positions.len() as u32);
    assert!(others.count() > 0);
}

#[test]
fn about_a_hub_of_many_faces_its_rim_goes() {
    let rim = (0..300).map(|i| {
        let angle = std::f32::consts::TAU * i as f32 / 300.0;
        [angle.cos(), angle.sin(), 0.0]
    });
    let disc = TriMesh::new(
        std::iter::once([0.0; 3]).chain(rim).collect(),
        (0..300).map(|i| [0, 1 + i, 1 + (i + 1) % 300]).collect(),
    );
    let left = reduced(&disc, 0.02, ALL);
    assert!(left.triangles.len() < 60, "{}", left.triangles.len());
    assert!(is_within(&disc, &left, 0.02) && is_within(&left, &disc, 0.02));
}
