//! What the records say of normals and colours, beside what samples find.

use crate::site::{ChpmFile, Site, config};
use chpm_mesh::{ClusterId, Level, TriMesh};
use chpm_refine::{Cut, extract};
use chpm_synth::hand;

/// Cells of a plate along each side.
const CELLS: u32 = 80;

/// A flat square, with a normal and a colour for each place.
fn plate(normal: impl Fn(u32, u32) -> [f32; 3], color: impl Fn(u32, u32) -> [u8; 4]) -> TriMesh {
    let mut mesh = hand::grid(CELLS, CELLS);
    let vertices = &mut mesh.vertices;
    let places = vertices.positions.iter().map(|p| (p[0] as u32, p[1] as u32));
    vertices.normals = places.clone().map(|(x, y)| normal(x, y)).collect();
    vertices.colors = places.map(|(x, y)| color(x, y)).collect();
    mesh
}

fn noise(x: u32, y: u32, channel: u32) -> u8 {
    let mixed = (x << 20 ^ y << 10 ^ channel).wrapping_mul(0x9e37_79b9);
    ((mixed ^ mixed >> 15).wrapping_mul(0x85eb_ca6b) >> 24) as u8
}

/// The largest deviations of the clusters of a level: chord of the normals, units of colour.
fn said(file: &ChpmFile, level: u32) -> [f64; 2] {
    let clusters = || file.clusters().iter().filter(|c| c.level == level);
    let degrees = clusters().map(|c| f64::from(c.normal_deviation)).fold(0.0, f64::max);
    let units = clusters().map(|c| f64::from(c.color_deviation)).fold(0.0, f64::max);
    [2.0 * (degrees / 2.0).to_radians().sin(), units]
}

/// Normal, between unit normals, and colour of a mesh at a place of the plate.
fn look(mesh: &TriMesh, at: [f64; 2]) -> Option<([f64; 3], [f64; 4])> {
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    mesh.triangles.iter().find_map(|corners| {
        let p = mesh.corners(*corners).map(|c| [f64::from(c[0]) - at[0], f64::from(c[1]) - at[1]]);
        let parts = [cross(p[1], p[2]), cross(p[2], p[0]), cross(p[0], p[1])];
        let area: f64 = parts.iter().sum();
        if parts.iter().any(|x| x / area < -1e-9) {
            return None;
        }
        let (mut normal, mut color) = ([0.0; 3], [0.0; 4]);
        for (v, part) in corners.iter().zip(parts) {
            let n = mesh.normals[*v as usize].map(f64::from);
            let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
            (0..3).for_each(|i| normal[i] += part / area * n[i] / length);
            (0..4).for_each(|i| color[i] += part / area * f64::from(mesh.colors[*v as usize][i]));
        }
        Some((normal, color))
    })
}

/// In a plane nothing moves, so that the source and a level can be compared place by place: across group borders, and over all levels.
#[test]
fn no_place_of_a_level_deviates_more_than_its_clusters_say() {
    let mesh = plate(
        |x, y| [noise(x, y, 4), noise(x, y, 5), 200].map(|c| f32::from(c) - 127.5),
        |x, y| [0, 1, 2, 3].map(|channel| noise(x, y, channel)),
    );
    let (report, file) = Site::of(&mesh).build(&config(512));
    let mut above = [0.0; 2];
    for level in 0..file.levels().len() as u32 {
        let lod = extract(&file, &Cut::at_level(&file, Level(level + 1))).unwrap();
        let mut measured = [0f64; 2];
        for i in 0..400 {
            let along = |step: f64| f64::from(CELLS) * (0.5 + f64::from(i) * step).fract();
            let at = [along(0.754_877_666), along(0.569_840_291)];
            let (old, new) = (look(&mesh, at).expect("a place"), look(&lod, at).expect("a place"));
            let normal = (0..3).map(|i| (old.0[i] - new.0[i]).powi(2)).sum::<f64>().sqrt();
            let color = (0..4).map(|i| (old.1[i] - new.1[i]).abs()).fold(0.0, f64::max);
            measured = [measured[0].max(normal), measured[1].max(color)];
        }
        let said = said(&file, level);
        for kind in 0..2 {
            assert!(said[kind] + 1e-6 >= measured[kind], "level {level}: {said:?} {measured:?}");
            assert!(said[kind] >= above[kind], "level {level}: {said:?} {above:?}");
            assert!(said[kind] < 2.0 * measured[kind], "level {level}: {said:?} {measured:?}");
        }
        let row = report.levels[level as usize];
        assert_eq!(f64::from(row.color_deviation), said[1]);
        above = said;
    }
}

/// Spots so far from each other that the deviation of a cluster is that of one or two: where one goes with a group border, nothing else hides
/// whether the members of the group were told.
#[test]
fn a_spot_that_is_gone_is_told_by_the_cluster_that_lies_there() {
    let is_spot = |x: u32, y: u32| noise(x, y, 9) < 8;
    let mesh = plate(
        |x, y| if is_spot(x, y) { [0.0, 1.0, 1.0] } else { [0.0, 0.0, 1.0] },
        |x, y| if is_spot(x, y) { [250, 100, 0, 255] } else { [0, 100, 0, 255] },
    );
    let (_, file) = Site::of(&mesh).build(&config(64));
    assert!(file.groups().iter().any(|group| group.coarse_count > 1));
    let spots: Vec<[f64; 2]> = (0..mesh.positions.len())
        .filter(|v| mesh.colors[*v][0] == 250)
        .map(|v| [mesh.positions[v][0].into(), mesh.positions[v][1].into()])
        .collect();
    let (mut seen, mut gone) = (0, 0);
    for level in 0..file.levels().len() as u32 {
        let of_level = |id: &ClusterId| file.clusters()[id.index()].level == level;
        let clusters = (0..file.clusters().len() as u32).map(ClusterId).filter(of_level);
        let bases: Vec<(ClusterId, TriMesh)> = clusters.map(|id| (id, base_mesh(&file, id))).collect();
        for at in &spots {
            // Two where it is on the group border between them: one of them has the points that were there.
            let there = bases.iter().filter_map(|(id, mesh)| Some((id, look(mesh, *at)?)));
            let mut found = Vec::new();
            for (id, (normal, color)) in there {
                let record = &file.clusters()[id.index()];
                let chord = [0.0 - normal[0], 0.5_f64.sqrt() - normal[1], 0.5_f64.sqrt() - normal[2]];
                let chord = chord.iter().map(|x| x * x).sum::<f64>().sqrt();
                let said = 2.0 * (f64::from(record.normal_deviation) / 2.0).to_radians().sin();
                let units = 250.0 - color[0];
                found.push(said + 1e-4 >= chord && f64::from(record.color_deviation) + 1e-4 >= units);
                gone += u32::from(units > 1.0);
            }
            // Not all of a plate has a cluster of its own on each level.
            assert!(found.is_empty() || found.contains(&true), "level {level}, {at:?}: {found:?}");
            seen += u32::from(!found.is_empty());
        }
    }
    assert!(seen > 500 && gone > 200, "{} spots, {seen} places, {gone} gone", spots.len());
}

/// The base mesh of a cluster, on its own.
fn base_mesh(file: &ChpmFile, id: ClusterId) -> TriMesh {
    let page = file.page(id).unwrap();
    let page = page.view();
    let mut triangles = Vec::new();
    page.progressive_mesh().triangles_at(page.base_vertex_count, &mut triangles);
    let mut mesh = TriMesh::default();
    mesh.extend_from_slices(page.vertices);
    mesh.triangles = triangles.iter().map(|t| t.map(u32::from)).collect();
    mesh
}

#[test]
fn a_gradient_costs_nothing_at_any_level() {
    let mesh = plate(|_, _| [0.0, 0.5, 0.5], |x, y| [2 * x, 3 * y, x + y, 255].map(|c| c as u8));
    let (_, file) = Site::of(&mesh).build(&config(512));
    assert!(file.levels().len() > 3);
    for cluster in file.clusters() {
        assert!(cluster.color_deviation < 1e-6 && cluster.normal_deviation == 0.0, "{cluster:?}");
    }
}

#[test]
fn positions_alone_have_no_deviations() {
    let (report, file) = Site::of(&hand::grid(CELLS, CELLS)).build(&config(512));
    assert!(file.clusters().iter().all(|c| c.normal_deviation == 0.0 && c.color_deviation == 0.0));
    assert!(report.levels.iter().all(|l| l.normal_deviation == 0.0 && l.color_deviation == 0.0));
}
