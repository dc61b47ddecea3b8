//! Deviations of normals and colours: exact where the answer is known, and never below what samples find.

use crate::play::{local, played, went};
use chpm_measure::deviation;
use chpm_mesh::{TriMesh, geom};
use chpm_qem::{AttributeErrors, Collapse, Decimator, Deviation, FaceAttributeError, Patch, Topology};
use chpm_synth::{Shape, Synth, hand};
use proptest::prelude::*;

/// Mesh and deviations after a decimation.
struct Run {
    collapses: Vec<Collapse>,
    /// Triangles and how they look.
    left: Vec<([u32; 3], FaceAttributeError)>,
    largest: Deviation,
}

fn run(mesh: &TriMesh, before: &[FaceAttributeError], topology: Topology, target: usize) -> Run {
    run_with(mesh, before, &vec![false; mesh.positions.len()], topology, target)
}

fn run_with(
    mesh: &TriMesh,
    before: &[FaceAttributeError],
    locked: &[bool],
    topology: Topology,
    target: usize,
) -> Run {
    let mut decimator = Decimator::default();
    decimator.topology = topology;
    let patch = Patch {
        positions: &mesh.positions,
        triangles: &local(mesh),
        locked,
        attribute_errors: AttributeErrors::new(mesh.view(), before),
        ..Patch::default()
    };
    let collapses = decimator.decimate(&patch, target, 0.0).collapses.to_vec();
    let ends = went(mesh.positions.len(), &collapses);
    let living = (0..mesh.triangles.len()).filter(|face| decimator.is_left(*face));
    let look = |face: usize| decimator.face_attribute_errors().get(face).copied().unwrap_or_default();
    let left = living.map(|face| (mesh.triangles[face].map(|v| ends[v as usize]), look(face))).collect();
    let before = before.iter().map(FaceAttributeError::deviation);
    let largest = before.fold(decimator.deviation(), Deviation::max);
    Run { collapses, left, largest }
}

/// From the source, keeping the topology.
fn free(mesh: &TriMesh, target: usize) -> Run {
    run(mesh, &[], Topology::Keep, target)
}

fn near(got: f32, expected: f64) -> bool {
    (expected..expected + 1e-4).contains(&f64::from(got))
}

#[test]
fn a_linear_gradient_costs_nothing() {
    let mut mesh = hand::grid(16, 12);
    mesh.colors = mesh
        .positions
        .iter()
        .map(|p| [8.0 * p[0], 20.0 * p[1], p[0] + p[1], 255.0].map(|c| c as u8))
        .collect();
    mesh.normals = vec![[0.0, 3.0, -4.0]; mesh.positions.len()];
    let run = free(&mesh, 2);
    assert_eq!(run.left.len(), 2);
    assert!(run.largest.color < 1e-9, "{:?}", run.largest);
    assert_eq!(run.largest.degrees(), 0.0);
}

#[test]
fn one_look_all_over_deviates_by_exactly_nothing() {
    for shape in Shape::ALL {
        let mut mesh = Synth::new(shape, 3000, 1).to_mesh();
        mesh.colors = vec![[3, 250, 17, 255]; mesh.positions.len()];
        mesh.normals = vec![[0.3, 0.5, -0.2]; mesh.positions.len()];
        let run = run(&mesh, &[], Topology::Change, 0);
        assert!(!run.collapses.is_empty());
        assert_eq!(run.largest, Deviation::default(), "{shape}");
    }
}

/// A square of four triangles about a vertex that differs from all others.
fn square_with_a_spot() -> TriMesh {
    let mut mesh = hand::fan(4);
    mesh.colors = vec![[10, 20, 30, 255]; mesh.positions.len()];
    mesh.normals = vec![[0.0, 0.0, 1.0]; mesh.positions.len()];
    mesh
}

#[test]
fn a_spot_costs_its_contrast() {
    let mut mesh = square_with_a_spot();
    mesh.colors[0] = [10, 220, 0, 255];
    // Length is no matter.
    mesh.normals[0] = [0.0, 7.0, 0.0];
    let run = free(&mesh, 2);
    assert_eq!(run.collapses.len(), 1);
    assert!(near(run.largest.units(), 200.0), "{:?}", run.largest);
    assert!(near(run.largest.degrees(), 90.0), "{:?}", run.largest);
}

#[test]
fn opposite_normals_are_half_a_turn_apart() {
    let mut mesh = square_with_a_spot();
    mesh.colors.clear();
    mesh.normals[0] = [0.0, 0.0, -1.0];
    let run = free(&mesh, 2);
    assert_eq!(run.collapses.len(), 1);
    assert!(near(run.largest.degrees(), 180.0));
    assert_eq!(run.largest.units(), 0.0);
}

#[test]
fn a_boundary_vertex_is_compared_with_the_edge_that_it_leaves() {
    // On the edge of 0 and 200 at a quarter, where the edge has 50.
    for reverse in [false, true] {
        let mut mesh = TriMesh::new(
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [4.0, 0.0, 0.0], [2.0, 3.0, 0.0]],
            vec![[0, 1, 3], [1, 2, 3]],
        );
        mesh.colors = vec![[0; 4], [100; 4], [200; 4], [90; 4]];
        if reverse {
            mesh.triangles.iter_mut().for_each(|t| t.reverse());
        }
        let run = free(&mesh, 1);
        assert_eq!(run.left.len(), 1);
        assert!(near(run.largest.units(), 50.0), "{:?}", run.largest);
    }
}

/// Three triangles on a vertex that is forced to a neighbour, and who is locked.
fn three_about_a_vertex() -> (TriMesh, [bool; 7]) {
    let far = |x: f32, y: f32| [9.0 * x, 9.0 * y, 1.0];
    let mut mesh = TriMesh::new(
        vec![
            [0.0; 3],
            [0.125, 0.0, 0.0],
            [0.0, 0.125, 0.0],
            far(-1.0, 0.0),
            far(0.0, -1.0),
            far(1.0, 1.0),
            far(0.0, 1.0),
        ],
        vec![[0, 1, 2], [0, 3, 4], [0, 5, 6]],
    );
    mesh.colors = [100, 130, 170, 0, 255, 0, 255].map(|c| [c; 4]).to_vec();
    (mesh, [false, true, true, false, false, false, false])
}

/// One becomes an edge, whose points go on to the neighbour and to a face there; the others come along.
#[test]
fn a_face_that_comes_along_costs_what_its_corner_does() {
    let (mesh, locked) = three_about_a_vertex();
    let run = run_with(&mesh, &[], &locked, Topology::Change, 2);
    let ends: Vec<(u16, u16)> = run.collapses.iter().map(|c| (c.from, c.to)).collect();
    assert_eq!(ends, [(0, 1)]);
    let said: Vec<f32> = run.left.iter().map(|(_, look)| look.deviation().color).collect();
    // 30 for what comes along; 30 to the edge and 40 from there to its end.
    assert!(near(said[0], 70.0) && near(said[1], 30.0) && run.largest.color == said[0], "{said:?}");
}

/// A face that gets points keeps its own deviation, whatever the points come with: here it looks like a spot that has gone.
#[test]
fn a_face_that_gets_points_keeps_its_own_deviation() {
    let mut square = square_with_a_spot();
    square.normals.clear();
    square.colors[0] = [210; 4];
    let spotted = free(&square, 2).left[0].1;
    assert!(spotted.deviation().color >= 180.0, "{spotted:?}");

    let (mesh, locked) = three_about_a_vertex();
    let mut before = Vec::new();
    AttributeErrors::new(mesh.view(), &[]).of_source(&local(&mesh), &mut before);
    before[1] = spotted;
    let run = run_with(&mesh, &before, &locked, Topology::Change, 2);
    let said: Vec<f32> = run.left.iter().map(|(_, look)| look.deviation().color).collect();
    // 30 more, since it comes along itself.
    let own = f64::from(spotted.deviation().color) + 30.0;
    assert!(near(said[0], own) && near(said[1], 30.0), "{said:?} {own}");
}

#[test]
fn nothing_to_look_at_takes_nothing() {
    let mesh = hand::grid(6, 6);
    let mut decimator = Decimator::default();
    let (triangles, locked) = (local(&mesh), vec![false; mesh.positions.len()]);
    let colors = vec![[1; 4]; mesh.positions.len()];
    let plain =
        Patch { positions: &mesh.positions, triangles: &triangles, locked: &locked, ..Patch::default() };
    let colored = Patch {
        attribute_errors: AttributeErrors { colors: &colors, ..AttributeErrors::default() },
        ..plain
    };
    decimator.decimate(&colored, 10, 0.0);
    assert_eq!(decimator.face_attribute_errors().len(), triangles.len());
    decimator.decimate(&plain, 10, 0.0);
    assert!(decimator.face_attribute_errors().is_empty());
}

#[test]
fn looks_do_not_change_what_collapses() {
    let plain = Synth::new(Shape::Terrain, 3000, 4).to_mesh();
    let mut painted = plain.clone();
    paint(&mut painted, 5);
    let bits = |c: &Collapse| (c.from, c.to, c.error.to_bits());
    let order = |mesh: &TriMesh| free(mesh, 100).collapses.iter().map(bits).collect::<Vec<_>>();
    assert_eq!(order(&plain), order(&painted));
}

/// Gives every vertex some colour and some normal.
fn paint(mesh: &mut TriMesh, seed: u32) {
    let random = |v: u32, what: u32| {
        let x = (v ^ seed << 16 ^ what << 24).wrapping_mul(0x9e37_79b9);
        (x ^ x >> 15).wrapping_mul(0x85eb_ca6b) >> 24
    };
    let vertices = 0..mesh.positions.len() as u32;
    mesh.colors = vertices.clone().map(|v| [0, 1, 2, 3].map(|c| random(v, c) as u8)).collect();
    mesh.normals = vertices.map(|v| [4, 5, 6].map(|c| random(v, c) as f32 - 127.5)).collect();
}

/// A rectangle with its inner vertices moved about in its plane, and painted.
fn plate(seed: u32) -> TriMesh {
    let mut mesh = hand::grid(12, 9);
    for (v, p) in mesh.positions.iter_mut().enumerate() {
        let x = (v as u32 ^ seed << 20).wrapping_mul(0x9e37_79b9);
        if p[0] % 12.0 != 0.0 && p[1] % 9.0 != 0.0 {
            (p[0], p[1]) =
                (p[0] + ((x >> 24) as f32 - 128.0) / 500.0, p[1] + ((x >> 16 & 255) as f32 - 128.0) / 500.0);
        }
    }
    paint(&mut mesh, seed);
    mesh
}

fn barycentric(corners: [[f32; 3]; 3], at: [f64; 2]) -> Option<[f64; 3]> {
    let p = corners.map(|c| [f64::from(c[0]) - at[0], f64::from(c[1]) - at[1]]);
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let parts = [cross(p[1], p[2]), cross(p[2], p[0]), cross(p[0], p[1])];
    let area: f64 = parts.iter().sum();
    let parts = parts.map(|x| x / area);
    parts.iter().all(|x| *x >= -1e-9).then_some(parts)
}

/// Normal and colour of a point of a triangle.
fn look(mesh: &TriMesh, triangle: [u32; 3], at: [f64; 2]) -> Option<([f64; 3], [f64; 4])> {
    let shares = barycentric(mesh.corners(triangle), at)?;
    let (mut normal, mut color) = ([0.0; 3], [0.0; 4]);
    for (v, share) in triangle.iter().zip(shares) {
        let unit = geom::to_f64(*mesh.normals.get(*v as usize).unwrap_or(&[1.0; 3])).coords.normalize();
        (0..3).for_each(|i| normal[i] += share * unit[i]);
        (0..4).for_each(|i| color[i] += share * f64::from(mesh.colors[*v as usize][i]));
    }
    Some((normal, color))
}

/// The largest differences of normals and colours between a plane mesh and what is left of it, where no point moves; and that
/// no triangle's are above what it says.
fn measured(mesh: &TriMesh, run: &Run) -> (f64, f64) {
    let mut all = (0f64, 0f64);
    let mut compare = |at: [f64; 2]| {
        let old = mesh.triangles.iter().find_map(|t| look(mesh, *t, at));
        let new = run.left.iter().find_map(|(t, d)| Some((look(mesh, *t, at)?, d)));
        let (Some(old), Some((new, said))) = (old, new) else { return };
        let normal = (0..3).map(|i| (old.0[i] - new.0[i]).powi(2)).sum::<f64>().sqrt();
        let color = (0..4).map(|i| (old.1[i] - new.1[i]).abs()).fold(0.0, f64::max);
        let said = said.deviation();
        assert!(f64::from(said.normal) >= normal - 1e-6, "{said:?} {normal} at {at:?}");
        assert!(f64::from(said.color) >= color - 1e-6, "{said:?} {color} at {at:?}");
        all = (all.0.max(normal), all.1.max(color));
    };
    for p in &mesh.positions {
        compare([f64::from(p[0]), f64::from(p[1])]);
    }
    for i in 0..2000 {
        // Two irrational steps spread the points evenly.
        let at = |step: f64, size: f64| size * (f64::from(i) * step).fract();
        compare([at(0.754_877_666, 12.0), at(0.569_840_291, 9.0)]);
    }
    all
}

/// In a plane all points stay where they are, so that looks can be compared point by point. Said over measured: 1.04 to 1.30,
/// median 1.19.
#[test]
fn no_point_of_a_plate_deviates_more_than_its_triangle_says() {
    let mut ratios = Vec::new();
    for seed in 0..12 {
        let mesh = plate(seed);
        let first = free(&mesh, 120);
        // From there in a second run, as a parent goes on from its children.
        let half = TriMesh { triangles: first.left.iter().map(|l| l.0).collect(), ..mesh.clone() };
        let before: Vec<FaceAttributeError> = first.left.iter().map(|l| l.1).collect();
        let second = run(&half, &before, Topology::Keep, 40);
        for run in [&first, &second] {
            let (normal, color) = measured(&mesh, run);
            ratios.extend([f64::from(run.largest.normal) / normal, f64::from(run.largest.color) / color]);
        }
    }
    ratios.sort_by(f64::total_cmp);
    assert!(ratios[ratios.len() / 2] < 1.5, "{ratios:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Painted with their own coordinates, points deviate by what they move: so the colours bound the distance, for any triangles
    /// and in either mode. A part that vanished counts as the point that it went to.
    #[test]
    fn colors_that_are_coordinates_bound_the_distance(
        corners in prop::collection::vec(prop::array::uniform3(0u32..12), 1..40),
        positions in prop::collection::vec(prop::array::uniform3(0u8..7), 12),
        change in any::<bool>(),
        share in 0usize..4,
    ) {
        let triangles: Vec<_> = corners.into_iter().filter(|[a, b, c]| a != b && b != c && c != a).collect();
        prop_assume!(!triangles.is_empty());
        let mut mesh = TriMesh::new(positions.iter().map(|p| p.map(f32::from)).collect(), triangles);
        mesh.colors = positions.iter().map(|[x, y, z]| [40 * x, 40 * y, 40 * z, 9]).collect();
        let topology = if change { Topology::Change } else { Topology::Keep };
        let run = run(&mesh, &[], topology, share * mesh.triangles.len() / 4);
        let mut lod = played(&mesh, &run.collapses);
        prop_assert_eq!(lod.triangles.len(), run.left.len());
        let ends = went(12, &run.collapses);
        lod.triangles.extend(mesh.triangles.as_flattened().iter().map(|v| [ends[*v as usize]; 3]));
        let measured = deviation(&mesh, &lod, 10).max();
        let said = f64::from(run.largest.color) / 40.0 * 3f64.sqrt();
        prop_assert!(said + 1e-9 >= measured, "{} {}", said, measured);
    }

    /// So they do for what goes on with another component: the speck that is left answers for the colours of both.
    #[test]
    fn a_speck_that_goes_elsewhere_keeps_its_deviation(colors in prop::array::uniform4(any::<u8>()), other in any::<u8>()) {
        let mut mesh = hand::tetrahedron();
        let beside = mesh.positions.iter().map(|[x, y, z]| [x + 1.5, *y, *z]).collect::<Vec<_>>();
        mesh.triangles.extend(mesh.triangles.clone().iter().map(|t| t.map(|v| v + 4)));
        mesh.positions.extend(beside);
        // The one beside is locked, so that it is the one that stays.
        mesh.colors = colors.iter().map(|c| [*c; 4]).chain([[other; 4]; 4]).collect();
        let locked = std::array::from_fn::<_, 8, _>(|v| v >= 4);
        let run = run_with(&mesh, &[], &locked, Topology::Change, 4);
        prop_assert_eq!(run.left.len(), 4);
        let farthest = colors.iter().map(|c| c.abs_diff(other)).max().unwrap_or(0);
        let said = run.largest.units();
        prop_assert!(said >= f32::from(farthest) && said <= 255.0, "{} {}", said, farthest);
    }
}
