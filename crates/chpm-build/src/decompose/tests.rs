//! Leaves against the source, by definition, for regions of every kind.

use super::*;
use crate::ids::Triangles;
use crate::ingest::SourceFacts;
use crate::vertex_columns::VertexColumns;
use chpm_extmem::{BufferWriter, Store};
use chpm_extmem::{Cancel, Silent};
use chpm_mesh::{Aabb, TriMesh, VertexSlices};
use chpm_synth::{Shape, Synth, hand};
use std::collections::{BTreeMap, BTreeSet};

/// A vertex as bits: position, normal, colour.
type Bits = ([u32; 3], ([u32; 3], [u8; 4]));

fn bits_of(vertices: VertexSlices<'_>, v: usize) -> Bits {
    let vertex = vertices.vertex(v);
    (vertex.position.map(f32::to_bits), vertex.look())
}

fn bits(mesh: &TriMesh, v: u32) -> Bits {
    bits_of(mesh.view(), v as usize)
}

fn source(mesh: &TriMesh, store: &Store) -> Source {
    fn column<T: bytemuck::Pod>(store: &Store, items: &[T]) -> chpm_extmem::Column<T> {
        let mut writer = BufferWriter::new(store, "items", items.len()).unwrap();
        writer.extend_from_slice(items).unwrap();
        writer.finish_column().unwrap()
    }
    Source {
        vertices: VertexColumns::of(mesh.view(), store),
        triangles: Triangles::Narrow(column(store, &mesh.triangles)),
        bounds: Aabb::of_points(&mesh.positions),
        rounding: 0.0,
        facts: SourceFacts::default(),
        painted: None,
    }
}

/// Everything that a decomposition says, in numbers that can be compared.
#[derive(PartialEq, Debug)]
struct Outcome {
    leaves: Vec<Vec<[Bits; 3]>>,
    shared: Vec<Vec<(Bits, u32)>>,
    users: Vec<Vec<u32>>,
    repairs: Repairs,
}

fn outcome(mesh: &TriMesh, settings: &Settings, threads: usize, memory: u64) -> Outcome {
    let parent = tempfile::tempdir().unwrap();
    let store = Store::create(parent.path(), memory).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let context = Context::new(store, pool, &Silent, Cancel::default());

    let mut repairs = Repairs::default();
    let decomposition =
        context.pool.install(|| run(source(mesh, &context.store), settings, &context, &mut repairs)).unwrap();

    let mut outcome = Outcome { leaves: vec![], shared: vec![], users: vec![], repairs };
    let mut bytes = Vec::new();
    for leaf in 0..decomposition.leaves.len() as u32 {
        let leaf = decomposition.read_leaf(leaf, &mut bytes).unwrap();
        let vertex = |v: u16| bits_of(leaf.page.vertices, usize::from(v));
        outcome.leaves.push(leaf.page.triangles.iter().map(|t| t.map(vertex)).collect());
        outcome.shared.push(leaf.shared().map(|(v, id)| (vertex(v), id)).collect());
        assert!(leaf.shared().is_sorted_by(|a, b| a.0 < b.0));
    }

    let shared = &decomposition.shared;
    outcome.users = (0..shared.len() as u32).map(|id| shared.users(id).to_vec()).collect();
    let mut counts = BTreeMap::<&[u32], u32>::new();
    outcome.users.iter().for_each(|users| *counts.entry(users).or_default() += 1);
    let mut told = BTreeMap::<&[u32], u32>::new();
    shared.interfaces().for_each(|(users, count)| *told.entry(users).or_default() += count);
    assert_eq!(counts, told);
    outcome
}

/// Checks I1 on a mesh whose vertices all differ in their bits.
fn check(mesh: &TriMesh, outcome: &Outcome) {
    let mut all: Vec<[Bits; 3]> = outcome.leaves.concat();
    // By their corners from the least on, each once, as each is in the leaves.
    let turned = |[a, b, c]: [Bits; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap();
    all.iter_mut().for_each(|t| *t = turned(*t));
    let mut expected: Vec<[Bits; 3]> =
        mesh.triangles.iter().map(|t| turned(t.map(|v| bits(mesh, v)))).collect();
    all.sort_unstable();
    expected.sort_unstable();
    let before = expected.len();
    expected.dedup();
    assert_eq!(before - expected.len(), outcome.repairs.merged_copies as usize);
    assert!(all == expected, "every triangle is in one leaf");
    let mut users = BTreeMap::<Bits, BTreeSet<u32>>::new();
    for (leaf, triangles) in (0..).zip(&outcome.leaves) {
        triangles.concat().into_iter().for_each(|v| {
            users.entry(v).or_default().insert(leaf);
        });
    }
    let used = users.len();
    users.retain(|_, leaves| leaves.len() > 1);
    let mut ids = BTreeMap::<u32, Bits>::new();
    for (leaf, shared) in (0..).zip(&outcome.shared) {
        for (vertex, id) in shared {
            assert_eq!(ids.entry(*id).or_insert(*vertex), vertex, "one id, one vertex");
            assert!(users[vertex].contains(&leaf) && outcome.users[*id as usize].contains(&leaf));
        }
    }
    assert_eq!((ids.len(), users.len()), (outcome.users.len(), outcome.users.len()));
    for (id, vertex) in ids {
        assert!(users[&vertex].iter().eq(&outcome.users[id as usize]), "users of {id}");
        let listed = outcome.shared.iter().flatten().filter(|(_, other)| *other == id).count();
        assert_eq!(listed, users[&vertex].len());
    }
    assert_eq!(outcome.repairs.unreferenced_vertices as usize, mesh.positions.len() - used);
}

fn settings(cluster_triangles: u32) -> Settings {
    Settings { cluster_triangles, cell_vertices: 4, ..Settings::default() }
}

/// The mesh with a normal and a colour for every vertex that no other has, and some vertices that nothing uses.
fn dressed(mut mesh: TriMesh) -> TriMesh {
    mesh.positions.extend([[0.25; 3], [0.5; 3]]);
    mesh.normals = (0..mesh.positions.len()).map(|v| [v as f32, 0.5, -(v as f32)]).collect();
    mesh.colors =
        (0..mesh.positions.len() as u32).map(|v| v.wrapping_mul(0x9e37_79b9).to_le_bytes()).collect();
    mesh
}

#[test]
fn leaves_are_the_source_in_one_region_and_in_many() {
    for shape in [Shape::Isosurface, Shape::Terrain, Shape::Plates] {
        let mesh = dressed(Synth::new(shape, 9000, 3).to_mesh());
        for (cluster_triangles, most_leaves) in [(600, 16), (128, 128), (16, 1024)] {
            let settings = settings(cluster_triangles);
            let first = outcome(&mesh, &settings, 1, 1 << 30);
            check(&mesh, &first);
            assert!(first.leaves.len() <= most_leaves && 4 * first.leaves.len() > most_leaves, "{shape}");
            for (threads, memory) in [(1, 0), (2, 1 << 30), (3, 1 << 17), (2, 0)] {
                assert!(outcome(&mesh, &settings, threads, memory) == first, "{shape} {threads} {memory}");
            }
        }
    }
}

#[test]
fn the_topology_does_not_depend_on_regions() {
    let mut damaged = Synth::new(Shape::Isosurface, 9000, 8).to_mesh();
    damaged.triangles.swap_remove(4321);
    (17..8000).step_by(611).for_each(|t| damaged.triangles[t].swap(0, 1));
    for mesh in
        [damaged, Synth::new(Shape::Plates, 9000, 2).to_mesh(), hand::moebius(2000), hand::klein_bottle(40)]
    {
        let whole = outcome(&mesh, &settings(16384), 1, 1 << 30).repairs;
        assert_eq!(outcome(&mesh, &settings(16), 2, 0).repairs, whole);
        assert_eq!(outcome(&mesh, &settings(64), 2, 1 << 30).repairs, whole);
    }
}

#[test]
fn triangles_that_jump_about_are_cut_into_leaves_too() {
    // Vertices of no coherence, each in some triangles; many triangles over few vertices; all of them in one place.
    let hash = |i: u32| i.wrapping_mul(2_654_435_761).rotate_left(13).wrapping_mul(0x85eb_ca6b);
    let points = |count: u32| -> Vec<[f32; 3]> {
        (0..count).map(|v| [v as f32, (hash(v) & 255) as f32, (hash(v) >> 24) as f32]).collect()
    };
    let triangles = |count: u32, vertices: u32| -> Vec<[u32; 3]> {
        let corners = |t| [hash(3 * t), hash(3 * t + 1), hash(3 * t + 2)].map(|h| h % vertices);
        (0..count).map(corners).filter(|[a, b, c]| a != b && b != c && c != a).collect()
    };
    let coincident = TriMesh::new(vec![[1.0; 3]; 3000], triangles(9000, 3000));
    for mesh in [
        dressed(TriMesh::new(points(5000), triangles(9000, 5000))),
        dressed(TriMesh::new(points(40), triangles(9000, 40))),
        dressed(coincident),
    ] {
        let first = outcome(&mesh, &settings(16), 2, 1 << 30);
        check(&mesh, &first);
        assert!(first.leaves.iter().all(|leaf| leaf.len() <= 21_845));
        assert!(outcome(&mesh, &settings(16), 3, 0) == first);
    }
}

#[test]
fn a_cloud_of_vertices_about_few_triangles_is_left_out() {
    let mut mesh = hand::icosphere(2);
    let used = mesh.positions.len();
    mesh.positions.extend((0..20_000).map(|v| [v as f32, 3.0, 0.0]));
    let outcome = outcome(&mesh, &settings(16), 2, 0);
    check(&mesh, &outcome);
    assert_eq!(outcome.repairs.unreferenced_vertices as usize, mesh.positions.len() - used);
}
