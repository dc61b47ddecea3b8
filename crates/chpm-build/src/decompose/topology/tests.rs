use super::ledger::{Account, Ledger};
use super::local::Surveyor;
use crate::report::Repairs;
use chpm_extmem::Store;
use chpm_mesh::TriMesh;
use chpm_synth::{Shape, Synth, hand};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// The topology of a mesh whose triangle `t` lies in leaf `leaves[t]`, `step` leaves being a region.
fn topology(mesh: &TriMesh, leaves: &[usize], step: usize) -> Repairs {
    let leaf_count = leaves.iter().max().map_or(0, |last| last + 1);
    let mut users = BTreeMap::<u32, BTreeSet<usize>>::new();
    for (triangle, leaf) in mesh.triangles.iter().zip(leaves) {
        for v in triangle {
            users.entry(*v).or_default().insert(*leaf);
        }
    }
    users.retain(|_, leaves| leaves.len() > 1);
    let regions = |v: u32| users[&v].iter().map(|leaf| leaf / step).collect::<BTreeSet<_>>();
    let (border, inner): (Vec<u32>, Vec<u32>) = users.keys().partition(|v| regions(**v).len() > 1);

    let folder = tempfile::tempdir().unwrap();
    let store = Store::create(folder.path(), 1 << 20).unwrap();
    let mut whole = Account::new(border.len(), &store);
    let mut surveyor = Surveyor::default();
    for region in 0..leaf_count.div_ceil(step) {
        // Numbers of a region: its inner vertices, and then border vertices in an order that is not that of the border.
        let inner: Vec<u32> = inner.iter().copied().filter(|v| regions(*v).contains(&region)).collect();
        let mut outer: Vec<u32> = border.iter().copied().filter(|v| regions(*v).contains(&region)).collect();
        let turn = outer.len() / 2;
        outer.rotate_left(turn);
        let ids: BTreeMap<u32, u32> = inner.iter().chain(&outer).copied().zip(0..).collect();
        let mut ledger = Ledger::new(ids.len());
        for leaf in region * step..leaf_count.min((region + 1) * step) {
            let own = || mesh.triangles.iter().zip(leaves).filter(|(_, l)| **l == leaf).map(|(t, _)| *t);
            let vertices: BTreeSet<u32> = own().flatten().collect();
            let mut vertices: Vec<u32> = vertices.into_iter().collect();
            // Local numbers are in no order of global ones.
            let third = vertices.len() / 3;
            vertices.rotate_left(third * (leaf % 3));
            let locals: BTreeMap<u32, u16> = vertices.iter().copied().zip(0..).collect();
            let local = |v: u32| locals[&v];
            let triangles: Vec<[u16; 3]> = own().map(|t| t.map(local)).collect();
            let shared: Vec<(u16, u32)> =
                (0..).zip(&vertices).filter_map(|(local, v)| Some((local, *ids.get(v)?))).collect();
            ledger.enter(surveyor.survey(&triangles, &vertices, &shared, &mesh.positions));
        }
        let inner_count = inner.len() as u32;
        let global = |id: u32| match id.checked_sub(inner_count) {
            Some(outer_index) => border.partition_point(|v| *v < outer[outer_index as usize]) as u32,
            None => (border.len() + 1000 * region) as u32 + id,
        };
        whole.enter(ledger.close(inner_count).renumbered(global)).unwrap();
    }
    whole.close().unwrap().found
}

fn whole(mesh: &TriMesh) -> Repairs {
    topology(mesh, &vec![0; mesh.triangles.len()], 1)
}

/// How many components the graph of `edges` has.
fn components(edges: impl IntoIterator<Item = [u32; 2]>) -> u64 {
    let mut sets: Vec<BTreeSet<u32>> = Vec::new();
    for edge in edges {
        let (touched, apart): (Vec<_>, Vec<_>) =
            sets.into_iter().partition(|s| edge.iter().any(|v| s.contains(v)));
        sets = apart;
        sets.push(touched.into_iter().flatten().chain(edge).collect());
    }
    sets.len() as u64
}

/// The same by definition, on the whole mesh; only duplicates are looked for in each leaf.
fn naive(mesh: &TriMesh, leaves: &[usize]) -> Repairs {
    let mut edges = BTreeMap::<[u32; 2], [u32; 2]>::new();
    let mut links = BTreeMap::<u32, Vec<[u32; 2]>>::new();
    let mut copies = BTreeMap::<(usize, BTreeSet<u32>), u64>::new();
    let mut found = Repairs::default();

    for (&[a, b, c], leaf) in mesh.triangles.iter().zip(leaves) {
        for (v, from, to) in [(a, b, c), (b, c, a), (c, a, b)] {
            edges.entry([from.min(to), from.max(to)]).or_default()[usize::from(from > to)] += 1;
            links.entry(v).or_default().push([from, to]);
        }
        *copies.entry((*leaf, BTreeSet::from([a, b, c]))).or_default() += 1;
        let [p, q, r] = mesh.corners([a, b, c]).map(|p| p.map(f64::from));
        let minor = |i: usize, j: usize| (q[i] - p[i]) * (r[j] - p[j]) - (q[j] - p[j]) * (r[i] - p[i]);
        found.zero_area_faces += u64::from([minor(0, 1), minor(1, 2), minor(2, 0)] == [0.0; 3]);
    }

    found.two_sided_faces = copies.values().map(|n| n - 1).sum();
    let of_degree = |wanted: fn(u32) -> bool| edges.iter().filter(move |(_, n)| wanted(n[0] + n[1]));
    found.boundary_edges = of_degree(|n| n == 1).count() as u64;
    found.boundary_loops = components(of_degree(|n| n == 1).map(|(ends, _)| *ends));
    found.non_manifold_edges = of_degree(|n| n > 2).count() as u64;
    found.mixed_winding_edges = of_degree(|n| n == 2).filter(|(_, n)| **n != [1, 1]).count() as u64;
    found.components = components(edges.keys().copied());

    let is_manifold = |link: &Vec<[u32; 2]>| {
        let mut degrees = BTreeMap::<u32, u32>::new();
        link.iter().flatten().for_each(|v| *degrees.entry(*v).or_default() += 1);
        degrees.values().all(|n| *n <= 2) && components(link.iter().copied()) == 1
    };
    found.non_manifold_vertices = links.values().filter(|link| !is_manifold(link)).count() as u64;
    found
}

/// Counts of a clean closed mesh of one component.
fn clean() -> Repairs {
    Repairs { components: 1, ..Repairs::default() }
}

#[test]
fn closed_surfaces_are_clean() {
    for mesh in [hand::tetrahedron(), hand::cube(), hand::icosphere(3)] {
        assert_eq!(whole(&mesh), clean());
    }
}

#[test]
fn open_surfaces_have_loops() {
    assert_eq!(whole(&hand::grid(5, 3)), Repairs { boundary_edges: 16, boundary_loops: 1, ..clean() });
    let mut ring = hand::grid(3, 3);
    ring.triangles.drain(8..10);
    assert_eq!(whole(&ring), Repairs { boundary_edges: 16, boundary_loops: 2, ..clean() });
    // A hole that touches the rim is one curve with it.
    let mut notched = hand::grid(3, 3);
    notched.triangles.remove(8);
    assert_eq!(whole(&notched), Repairs { boundary_edges: 15, boundary_loops: 2, ..clean() });
    notched.triangles.remove(0);
    let expected = Repairs { boundary_edges: 16, boundary_loops: 1, non_manifold_vertices: 1, ..clean() };
    assert_eq!(whole(&notched), expected);
    let soup = Repairs { boundary_edges: 21, boundary_loops: 7, components: 7, ..clean() };
    assert_eq!(whole(&hand::soup(7)), soup);
    assert_eq!(whole(&TriMesh::default()), Repairs { components: 0, ..clean() });
}

#[test]
fn surfaces_that_do_not_orient_have_mixed_winding() {
    let moebius = whole(&hand::moebius(8));
    assert_eq!(moebius, Repairs { boundary_edges: 16, boundary_loops: 1, mixed_winding_edges: 1, ..clean() });
    let quad = whole(&hand::mixed_winding());
    assert_eq!(quad, Repairs { boundary_edges: 4, boundary_loops: 1, mixed_winding_edges: 1, ..clean() });
    let mut ball = hand::icosphere(2);
    ball.triangles[100].swap(0, 1);
    assert_eq!(whole(&ball), Repairs { mixed_winding_edges: 3, ..clean() });
    let bottle = whole(&hand::klein_bottle(6));
    assert!(bottle.mixed_winding_edges > 0);
    assert_eq!(bottle, Repairs { mixed_winding_edges: bottle.mixed_winding_edges, ..clean() });
}

#[test]
fn surfaces_that_touch_are_not_manifold() {
    let bow_tie = whole(&hand::bow_tie());
    assert_eq!(
        bow_tie,
        Repairs { boundary_edges: 6, boundary_loops: 1, non_manifold_vertices: 1, ..clean() }
    );
    let pages = whole(&hand::edge_fan(3));
    let expected = Repairs { boundary_edges: 6, boundary_loops: 1, ..clean() };
    assert_eq!(pages, Repairs { non_manifold_edges: 1, non_manifold_vertices: 2, ..expected });
    let edge = whole(&hand::two_cubes_sharing_an_edge());
    assert_eq!(edge, Repairs { non_manifold_edges: 1, non_manifold_vertices: 2, ..clean() });

    let mut corner = hand::cube();
    corner.positions.extend(hand::cube().positions[1..].iter().map(|p| p.map(|x| -x)));
    corner.triangles.extend(hand::cube().triangles.iter().map(|t| t.map(|v| if v == 0 { 0 } else { v + 7 })));
    assert_eq!(whole(&corner), Repairs { non_manifold_vertices: 1, ..clean() });
}

#[test]
fn copies_are_found_in_any_orientation() {
    let quad = Repairs { boundary_edges: 4, boundary_loops: 1, ..clean() };
    // The copy gives two edges of the quad a second face in the same direction, and the diagonal a third one.
    let copied = whole(&hand::duplicate_faces());
    let expected = Repairs { boundary_edges: 2, mixed_winding_edges: 2, non_manifold_edges: 1, ..quad };
    assert_eq!(copied, Repairs { two_sided_faces: 1, non_manifold_vertices: 2, ..expected });
    // Two sides of one triangle are a closed surface.
    let mut pillow = hand::fan(3);
    pillow.triangles = vec![[0, 1, 2], [0, 2, 1]];
    assert_eq!(whole(&pillow), Repairs { two_sided_faces: 1, ..clean() });
    pillow.triangles = vec![[0, 1, 2], [1, 2, 0], [2, 1, 0]];
    let expected = Repairs { two_sided_faces: 2, non_manifold_edges: 3, non_manifold_vertices: 3, ..clean() };
    assert_eq!(whole(&pillow), expected);
    // In two leaves they pass for two faces.
    assert_eq!(topology(&pillow, &[0, 1, 1], 1), Repairs { two_sided_faces: 1, ..expected });
}

#[test]
fn faces_without_area_are_those_with_corners_in_line() {
    let mut mesh = hand::strip(3);
    mesh.positions[0] = mesh.positions[1];
    assert_eq!(whole(&mesh), Repairs { zero_area_faces: 1, boundary_edges: 5, boundary_loops: 1, ..clean() });
    mesh.positions =
        vec![[1e30, 0.0, 0.0], [1e30, 1e-30, 0.0], [1e30, 0.0, 1e-30], [0.0, 3.0, 1.0], [0.0, 4.0, 1.0]];
    assert_eq!(whole(&mesh).zero_area_faces, 0);
}

#[test]
fn a_fan_of_twenty_thousand_faces_is_one_fan() {
    assert_eq!(whole(&hand::fan(20_000)), Repairs { boundary_edges: 20_000, boundary_loops: 1, ..clean() });
}

#[test]
fn larger_meshes_agree_with_the_definition_in_slabs_of_triangles() {
    for shape in [Shape::Terrain, Shape::Isosurface, Shape::Torus, Shape::Plates] {
        let mesh = Synth::new(shape, 3000, 5).to_mesh();
        let count = mesh.triangles.len();
        let leaves: Vec<usize> = (0..count).map(|t| 7 * t / count).collect();
        assert_eq!(topology(&mesh, &leaves, 2), naive(&mesh, &leaves), "{shape}");
    }
}

/// Triangles of three different vertices below `vertex_count`.
fn triangles(vertex_count: u32, most: usize) -> impl Strategy<Value = Vec<[u32; 3]>> {
    let triangle = (0..vertex_count, 1..vertex_count, 1..vertex_count - 1).prop_map(move |(a, b, c)| {
        let c = if c < b { c } else { c + 1 };
        [a, (a + b) % vertex_count, (a + c) % vertex_count]
    });
    prop::collection::vec(triangle, 1..most)
}

fn positions(vertex_count: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
    let coordinate = (0..3u8).prop_map(f32::from);
    prop::collection::vec([coordinate.clone(), coordinate.clone(), coordinate], vertex_count)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1024))]

    #[test]
    fn any_soup_agrees_with_the_definition(
        (positions, triangles) in (4..12u32).prop_flat_map(|n| (positions(n as usize), triangles(n, 24))),
        leaves in prop::collection::vec(0..4usize, 24),
        step in 1..5usize,
    ) {
        let mesh = TriMesh::new(positions, triangles);
        let leaves = &leaves[..mesh.triangles.len()];
        prop_assert_eq!(topology(&mesh, leaves, step), naive(&mesh, leaves));
    }

    #[test]
    fn a_damaged_surface_agrees_with_the_definition(
        base in prop::sample::select(vec![hand::icosphere(1), hand::grid(6, 5), hand::moebius(9), hand::klein_bottle(4)]),
        missing in prop::collection::vec(0..1000usize, 0..6),
        flipped in prop::collection::vec(0..1000usize, 0..3),
        copied in prop::collection::vec(0..1000usize, 0..3),
        welded in prop::collection::vec((0..1000u32, 0..1000u32), 0..3),
        runs in prop::collection::vec((1..12usize, 0..4usize), 100),
        step in 1..5usize,
    ) {
        let mut mesh = base;

        for i in copied {
            mesh.triangles.push(mesh.triangles[i % mesh.triangles.len()]);
        }
        for i in flipped {
            let at = i % mesh.triangles.len();
            mesh.triangles[at].swap(0, 2);
        }
        for i in missing {
            mesh.triangles.swap_remove(i % mesh.triangles.len());
        }

        let vertex_count = mesh.positions.len() as u32;
        for (from, to) in welded {
            let (from, to) = (from % vertex_count, to % vertex_count);
            mesh.triangles.iter_mut().for_each(|t| *t = t.map(|v| if v == from { to } else { v }));
        }
        mesh.triangles.retain(|[a, b, c]| a != b && b != c && c != a);

        let leaves: Vec<usize> = runs.iter().flat_map(|&(length, leaf)| std::iter::repeat_n(leaf, length)).collect();
        let leaves = &leaves[..mesh.triangles.len()];
        prop_assert_eq!(topology(&mesh, leaves, step), naive(&mesh, leaves));
    }
}
