//! Normals that the build computes, against those of a second computation by definition.

use crate::site::{ChpmFile, Site, config, levels_of_detail};
use chpm_build::BuildConfig;
use chpm_build::config::{Length, Normals};
use chpm_format::checksum;
use chpm_mesh::{Attributes, Bytes, Level, TriMesh};
use chpm_refine::{Cut, extract};
use chpm_synth::{Shape, Synth, hand};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Degrees: what three bytes lose, and some rounding.
const KEPT: f64 = 0.06;

fn computed(cluster_triangles: u32) -> BuildConfig {
    let mut config = config(cluster_triangles);
    config.settings.normals = Normals::Computed;
    config
}

type V = [f64; 3];

fn minus(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn length(a: V) -> f64 {
    dot(a, a).sqrt()
}

fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Degrees between two directions.
fn angle(a: V, b: V) -> f64 {
    length(cross(a, b)).atan2(dot(a, b)).to_degrees()
}

/// By vertex, the normals of all faces about it, each by area and angle, and the sum of their lengths. Of copies of a face one counts.
fn by_definition(mesh: &TriMesh) -> Vec<(V, f64)> {
    let mut faces: BTreeMap<u32, BTreeSet<[u32; 3]>> = BTreeMap::new();
    for [a, b, c] in mesh.triangles.iter().copied().filter(|[a, b, c]| a != b && b != c && c != a) {
        // Each about each of its corners, from that one on.
        for face in [[a, b, c], [b, c, a], [c, a, b]] {
            faces.entry(face[0]).or_default().insert(face);
        }
    }
    let mut all = vec![([0.0; 3], 0.0); mesh.positions.len()];
    for (vertex, faces) in faces {
        for face in faces {
            let [at, next, last] = face.map(|v| mesh.positions[v as usize].map(f64::from));
            let (out, back) = (minus(next, at), minus(last, at));
            let area = cross(out, back);
            let cosine = dot(out, back) / (length(out) * length(back));
            let weight = cosine.clamp(-1.0, 1.0).acos();
            if length(area) > 0.0 {
                let (sum, lengths) = &mut all[vertex as usize];
                (0..3).for_each(|axis| sum[axis] += weight * area[axis]);
                *lengths += weight * length(area);
            }
        }
    }
    all
}

/// What vertices have in the leaves, by their positions; all that are in one place, in any order.
fn stored(file: &ChpmFile) -> BTreeMap<[u32; 3], Vec<V>> {
    let leaves = extract(file, &Cut::at_level(file, Level(0))).unwrap();
    let mut all: BTreeMap<[u32; 3], Vec<V>> = BTreeMap::new();
    for (position, normal) in leaves.positions.iter().zip(&leaves.normals) {
        all.entry(position.map(f32::to_bits)).or_default().push(normal.map(f64::from));
    }
    all
}

/// Every vertex of the leaves has the normal of the source's faces about it; answers how many were compared.
fn agree(file: &ChpmFile, mesh: &TriMesh) -> usize {
    let expected = by_definition(mesh);
    let mut places: BTreeMap<[u32; 3], Vec<(V, f64)>> = BTreeMap::new();
    let used: BTreeSet<u32> = mesh.triangles.concat().into_iter().collect();
    for vertex in used {
        let place = mesh.positions[vertex as usize].map(f32::to_bits);
        places.entry(place).or_default().push(expected[vertex as usize]);
    }
    let mut compared = 0;
    for (place, normals) in stored(file) {
        let expected = &places[&place];
        for normal in normals {
            let fits = |(sum, lengths): &(V, f64)| match length(*sum) / lengths {
                // What nearly cancels out depends on the last bits.
                share if share < 1e-6 => true,
                share if share.is_finite() => {
                    (length(normal) - 1.0).abs() < 1e-6 && angle(*sum, normal) < KEPT
                }
                _ => normal == [0.0; 3],
            };
            assert!(
                expected.iter().any(fits),
                "{:?}: {normal:?}, not {expected:?}",
                place.map(f32::from_bits)
            );
            compared += 1;
        }
    }
    compared
}

#[test]
fn normals_are_those_of_all_faces_about_a_vertex() {
    for shape in Shape::ALL {
        let mesh = Synth::new(shape, 12_000, 5).to_mesh();
        let site = Site::of(&mesh);
        // One leaf, many leaves of one region, and many regions.
        for cluster_triangles in [16_384, 512, 16] {
            let (_, file) = site.build(&computed(cluster_triangles));
            let attributes = Attributes { octahedral: true, ..Attributes::NONE };
            let version = if file.has_remnants() { 5 } else { 3 };
            assert_eq!((file.header().attributes(), file.header().version_minor), (attributes, version));
            let compared = agree(&file, &mesh);
            assert!(compared >= 5_000, "{shape}, {cluster_triangles}: {compared}");
        }
    }
}

/// Odd ones, and those that are no manifold.
#[test]
fn any_topology_has_normals() {
    for mesh in [
        hand::bow_tie(),
        hand::moebius(400),
        hand::klein_bottle(30),
        hand::two_cubes_sharing_an_edge(),
        hand::duplicate_faces(),
        hand::mixed_winding(),
        hand::soup(300),
        hand::edge_fan(40),
        hand::fan(300),
        hand::cube(),
    ] {
        for cluster_triangles in [16, 4096] {
            assert!(agree(&Site::of(&mesh).build(&computed(cluster_triangles)).1, &mesh) > 0);
        }
    }
}

/// Far away, tiny and huge: directions are the same.
#[test]
fn size_and_place_do_not_count() {
    let mesh = Synth::new(Shape::Isosurface, 4_000, 5).to_mesh();
    for scale in [1e-30, 1e-10, 1e10, 1e30] {
        let mut scaled = mesh.clone();
        scaled.positions.iter_mut().for_each(|p| *p = p.map(|x| x * scale));
        agree(&Site::of(&scaled).build(&computed(64)).1, &scaled);
    }
    let site = Site::of_doubles(&mesh, [1e6, -4e6, 3e5]);
    let (_, file) = site.build(&computed(64));
    let leaves = extract(&file, &Cut::at_level(&file, Level(0))).unwrap();
    let relative = TriMesh::new(leaves.positions.clone(), leaves.triangles.clone());
    agree(&file, &relative);
}

#[test]
fn what_cancels_out_has_no_direction() {
    // Both sides of a sheet, over the same vertices; and a face without area.
    let mut sheet = hand::grid(40, 40);
    let backs: Vec<[u32; 3]> = sheet.triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    sheet.triangles.extend(backs);
    let line = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], vec![[0, 1, 2]]);
    for (mesh, cluster_triangles) in [(&sheet, 16), (&sheet, 4096), (&line, 64)] {
        let (_, file) = Site::of(mesh).build(&computed(cluster_triangles));
        assert!(stored(&file).values().flatten().all(|normal| *normal == [0.0; 3]));
    }
    // A single triangle has its plane's.
    let one = TriMesh::new(vec![[0.0; 3], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]], vec![[0, 1, 2]]);
    let (_, file) = Site::of(&one).build(&computed(64));
    assert!(stored(&file).values().flatten().all(|normal| *normal == [1.0, 0.0, 0.0]));
}

/// A vertex has one normal, in every cluster and at every level.
#[test]
fn levels_have_the_normals_of_the_leaves() {
    let mesh = Synth::new(Shape::Terrain, 20_000, 2).to_mesh();
    let (report, file) = Site::of(&mesh).build(&computed(64));
    let stored = stored(&file);
    assert!(stored.values().all(|normals| normals.len() == 1));
    for lod in levels_of_detail(&file) {
        for (position, normal) in lod.positions.iter().zip(&lod.normals) {
            assert_eq!(stored[&position.map(f32::to_bits)], [normal.map(f64::from)]);
        }
    }
    assert!(report.levels.iter().all(|level| level.normal_deviation > 0.0), "{:?}", report.levels);
}

#[test]
fn what_is_asked_for_is_there() {
    let bare = Synth::new(Shape::Torus, 4_000, 2).to_mesh();
    let mut given = bare.clone();
    given.normals = vec![[0.0, 3.0, 4.0]; bare.positions.len()];
    given.colors = vec![[1, 2, 3, 4]; bare.positions.len()];
    let of = |mesh: &TriMesh, normals| {
        let mut config = config(256);
        config.settings.normals = normals;
        Site::of(mesh).build(&config).1
    };
    let colors = Attributes { colors: true, ..Attributes::NONE };
    let octahedral = Attributes { octahedral: true, ..Attributes::NONE };
    for (normals, of_bare, of_given) in [
        (Normals::Source, Attributes::NONE, Attributes::ALL),
        (Normals::Computed, octahedral, octahedral.joined(colors)),
        (Normals::None, Attributes::NONE, colors),
    ] {
        assert_eq!(of(&bare, normals).header().attributes(), of_bare);
        assert_eq!(of(&given, normals).header().attributes(), of_given);
    }
    agree(&of(&given, Normals::Computed), &given);
    // The geometry is the same in all.
    let files = [Normals::Source, Normals::Computed].map(|normals| of(&bare, normals));
    let coarse = |file: &ChpmFile| extract(file, &Cut::at_level(file, Level(1))).unwrap();
    let [bare, computed] = files.each_ref().map(coarse);
    assert_eq!((&bare.positions, &bare.triangles), (&computed.positions, &computed.triangles));
}

#[test]
fn threads_and_memory_do_not_show_in_normals() {
    let mut mesh = Synth::new(Shape::Isosurface, 20_000, 4).to_mesh();
    mesh.colors = vec![[9, 8, 7, 6]; mesh.positions.len()];
    let site = Site::of(&mesh);
    for (packed, trimmed) in [(false, None), (true, Some(Length::OfDiagonal(0.2)))] {
        let mut first = None;
        for (threads, memory) in [(1, 1 << 30), (2, 128 << 20), (2, 1 << 16), (4, 1 << 22)] {
            let mut config = computed(32);
            (config.resources.threads, config.resources.memory) = (threads, Bytes(memory));
            (config.settings.packed, config.settings.finest_error) = (packed, trimmed);
            let bytes = site.bytes(&config).1;
            let told = (checksum(&bytes), bytes.len());
            assert_eq!(*first.get_or_insert(told), told, "{threads} threads, {memory} bytes");
        }
    }
}

/// Few vertices and many faces among them: every kind of neighbour, copies, opposite faces and faces without area.
fn any_mesh() -> impl Strategy<Value = TriMesh> {
    let positions = prop::collection::vec(prop::array::uniform3(-3i8..3), 3..60);
    let triangles = prop::collection::vec(any::<[u8; 3]>(), 1..200);
    (positions, triangles).prop_map(|(places, triangles)| {
        // Each vertex has a place of its own.
        let place =
            |(v, p): (usize, &[i8; 3])| [f32::from(p[0]), f32::from(p[1]) + v as f32 / 64.0, f32::from(p[2])];
        let positions: Vec<_> = places.iter().enumerate().map(place).collect();
        let count = positions.len() as u32;
        let mut triangles: Vec<_> = triangles.iter().map(|t| t.map(|v| u32::from(v) % count)).collect();
        triangles.push([0, 1, 2]);
        TriMesh::new(positions, triangles)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_faces_about_any_vertices(mesh in any_mesh(), cluster_triangles in prop::sample::select(vec![16u32, 64, 4096])) {
        let (_, file) = Site::of(&mesh).build(&computed(cluster_triangles));
        prop_assert!(agree(&file, &mesh) >= 3);
    }
}
