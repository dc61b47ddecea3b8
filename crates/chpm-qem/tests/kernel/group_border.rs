//! Two patches that are simplified apart, with the vertices that they share locked, must still fit together.

use crate::play::run;
use chpm_measure::{cracks, edge_counts, topology};
use chpm_mesh::TriMesh;
use chpm_qem::{BorderGoal, Collapse, Decimator, Patch, Topology};
use chpm_synth::{Shape, Synth};

/// Simplifies the triangles of each part apart and puts the results side by side, over the mesh's vertices.
fn in_parts(mesh: &TriMesh, part_of: impl Fn(&[u32; 3]) -> usize, parts: usize, keep: f64) -> TriMesh {
    let mut users = vec![0u64; mesh.positions.len()];
    for t in &mesh.triangles {
        t.iter().for_each(|v| users[*v as usize] |= 1 << part_of(t));
    }
    let mut union = TriMesh::new(mesh.positions.clone(), Vec::new());
    for part in 0..parts {
        let own: Vec<[u32; 3]> = mesh.triangles.iter().copied().filter(|t| part_of(t) == part).collect();
        let mut used: Vec<u32> = own.concat();
        used.sort_unstable();
        used.dedup();
        let number = |v: u32| used.partition_point(|u| *u < v) as u32;
        let patch = TriMesh::new(
            used.iter().map(|v| mesh.positions[*v as usize]).collect(),
            own.iter().map(|t| t.map(number)).collect(),
        );
        let locked: Vec<bool> = used.iter().map(|v| users[*v as usize].count_ones() > 1).collect();
        let run = run(&patch, &locked, (own.len() as f64 * keep) as usize);
        union.triangles.extend(run.mesh.triangles.iter().map(|t| t.map(|v| used[v as usize])));
    }
    union
}

/// Which of eight boxes about the middle a triangle's first corner is in.
fn octant(mesh: &TriMesh) -> impl Fn(&[u32; 3]) -> usize {
    let middle = chpm_mesh::Aabb::of_points(&mesh.positions).center();
    move |t| {
        let p = mesh.positions[t[0] as usize];
        (0..3).map(|a| usize::from(f64::from(p[a]) > middle[a]) << a).sum()
    }
}

/// A group border vertex of two clusters goes to one of three by force, and no face is left at the edges that its faces become. What they
/// stood for goes on with faces of the two: the third has no part in the collapse, and its error does not tell of it.
#[test]
fn points_are_not_handed_to_who_does_not_know() {
    // u is 0, v is 1; then an apex of each face about the edge, and faces beyond.
    let positions = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.5, 1.0, 0.0],
        [0.5, -1.0, 0.0],
        [0.5, 0.0, 1.0],
        [2.0, 0.0, 0.1],
        [2.0, 1.0, 0.0],
        [0.0, 2.0, 0.0],
        [1.0, 2.0, 0.0],
        [0.0, -2.0, 0.0],
        [1.0, -2.0, 0.0],
        [0.0, 0.0, 2.0],
        [1.0, 0.0, 2.0],
    ];
    let triangles: [[u16; 3]; 7] =
        [[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 5, 6], [2, 7, 8], [3, 9, 10], [4, 11, 12]];
    let (a, b, c) = (1, 2, 4);
    let sides = [a | b, a | b | c, a, b, a, c, c, a, a, b, b, a, a];
    let locked = [false; 13];
    let patch = Patch { positions: &positions, triangles: &triangles, locked: &locked, ..Patch::default() };
    let mut decimator = Decimator::default();
    decimator.topology = Topology::Change;
    let outcome = decimator.decimate_group_border(&patch, &sides, BorderGoal::Vertices(1), 0.0);
    assert_eq!(outcome.collapses.len(), 1);
    let Collapse { from, to, error } = outcome.collapses[0];
    assert_eq!((from, to), (0, 1));
    let displaced: Vec<bool> = decimator.displacements()[3..].iter().map(|d| d.norm() > 0.0).collect();
    assert_eq!(displaced, [false, true, true, true], "the third cluster's face is none of them");
    assert!(decimator.displacements()[3..].iter().all(|d| d.error() <= error));
}

const COLUMNS: u16 = 60;
const SPIKES: usize = COLUMNS as usize / 6;

/// Collapses of a group border between two clusters that is nearly straight but for some spikes, and how many of them are spikes.
fn thin_out(goal: BorderGoal, min_error: f32) -> (Vec<Collapse>, usize) {
    let height = |i: u16| if i % 6 == 3 { 1.0 } else { 0.01 * f32::from(i).sin() };
    let at = |i: u16, row: u16| 3 * i + row;
    let positions: Vec<[f32; 3]> = (0..COLUMNS)
        .flat_map(|i| [[-1.0, 0.0], [0.0, height(i)], [1.0, 0.0]].map(|[y, z]| [f32::from(i), y, z]))
        .collect();
    let mut triangles = Vec::new();
    for i in 0..COLUMNS - 1 {
        for row in 0..2 {
            let [a, b, c, d] = [at(i, row), at(i + 1, row), at(i + 1, row + 1), at(i, row + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let sides: Vec<u8> = (0..3 * COLUMNS).map(|v| [1, 3, 2][usize::from(v % 3)]).collect();
    let locked = vec![false; positions.len()];
    let patch = Patch { positions: &positions, triangles: &triangles, locked: &locked, ..Patch::default() };
    let mut decimator = Decimator::default();
    let outcome = decimator.decimate_group_border(&patch, &sides, goal, min_error);
    let spikes = outcome.collapses.iter().filter(|c| positions[usize::from(c.from)][2] == 1.0).count();
    (outcome.collapses.to_vec(), spikes)
}

/// Nobody asks for so many collapses of a group border that a spike has to go.
#[test]
fn group_borders_are_not_halved_at_any_price() {
    let count = usize::from(COLUMNS) - SPIKES + 3;
    let (collapses, spikes) = thin_out(BorderGoal::Vertices(count), 0.0);
    assert!(collapses.len() > count / 2, "{}", collapses.len());
    assert_eq!(spikes, 0);
    assert!(collapses.iter().all(|collapse| collapse.error < 0.2), "{:?}", collapses.last());
}

/// A group border goes as far as the error that its members have already, and no farther.
#[test]
fn group_borders_add_nothing_to_the_error_that_is_there() {
    let (collapses, _) = thin_out(BorderGoal::Error(0.0), 0.0);
    assert!(collapses.is_empty(), "none of its vertices stands for nothing");
    let given = 0.05;
    let (collapses, spikes) = thin_out(BorderGoal::Error(given), given);
    assert!(collapses.len() > usize::from(COLUMNS) / 3, "{}", collapses.len());
    assert_eq!(spikes, 0);
    assert!(collapses.iter().all(|collapse| collapse.error == given), "{:?}", collapses.last());
}

#[test]
fn halves_of_a_sphere_close_up() {
    let mesh = Synth::new(Shape::Sphere, 4000, 0).to_mesh();
    for keep in [0.5, 0.1, 0.0] {
        let union = in_parts(&mesh, |t| usize::from(mesh.positions[t[0] as usize][2] > 0.0), 2, keep);
        assert!(union.triangles.len() < mesh.triangles.len() / 2 + 2);
        let edges = edge_counts(&union);
        assert_eq!((edges.boundary, edges.non_manifold, edges.inconsistent), (0, 0, 0), "{keep}");
        assert_eq!((topology(&union).euler, topology(&union).components), (2, 1), "{keep}");
        assert_eq!(cracks(&union, &mesh), []);
    }
}

#[test]
fn octants_of_every_shape_fit_together() {
    for shape in Shape::ALL {
        let mesh = Synth::new(shape, 4000, 9).to_mesh();
        let (before, part) = (topology(&mesh), octant(&mesh));
        for keep in [0.5, 0.0] {
            let union = in_parts(&mesh, &part, 8, keep);
            let (after, edges) = (topology(&union), edge_counts(&union));
            assert_eq!(cracks(&union, &mesh), [], "{shape}");
            assert_eq!((edges.non_manifold, edges.inconsistent), (0, 0), "{shape}");
            assert_eq!(
                (after.components, after.boundary_loops, after.euler),
                (before.components, before.boundary_loops, before.euler),
                "{shape} at {keep}"
            );
        }
    }
}
