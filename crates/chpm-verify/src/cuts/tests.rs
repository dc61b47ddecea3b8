use super::borders::Borders;
use super::glance::Glance;
use super::walk::{Found, Walker};
use super::*;
use chpm_build::{BuildConfig, build};
use chpm_extmem::Silent;
use chpm_format::{ChpmWriter, Invariant, PageParts, Tables, checksum};
use chpm_import::ply::{self, Encoding};
use chpm_mesh::{ClusterId, GroupId, Level, TriMesh, VertexSlices};
use chpm_refine::{Member, extract};
use chpm_synth::hard::CASES;
use chpm_synth::odd::Odd;
use chpm_synth::{Shape, Synth, hand};
use std::fs::{self, File};
use std::sync::atomic::{AtomicU64, Ordering};

type Model = Chpm<Vec<u8>>;

fn built(mesh: &TriMesh) -> Model {
    let folder = tempfile::tempdir().unwrap();
    let [source, output] = ["in.ply", "out.chpm"].map(|name| folder.path().join(name));
    ply::write_mesh(File::create(&source).unwrap(), mesh, Encoding::BinaryLittleEndian).unwrap();
    let mut config = BuildConfig::default();
    config.settings.cluster_triangles = 64;
    build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
    Chpm::open(fs::read(&output).unwrap()).unwrap()
}

fn synth(shape: Shape) -> TriMesh {
    Synth::new(shape, 3000, 5).to_mesh()
}

/// Looks at cuts of a file in `memory` bytes.
fn look<'a>(file: &Model, memory: u64, cuts: impl IntoIterator<Item = &'a Cut>) -> Vec<Found> {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::create(folder.path(), memory).unwrap();
    let borders = Borders::of(file, &store, memory, &Silent, &Cancel::default()).unwrap();
    let [mut lists, mut quick] = [false, true].map(|is_even| Walker::new(memory, is_even));
    let faults = chpm_format::verify(file, |_, _| ()).faults;
    let is_even = faults.iter().all(|fault| fault.invariant != Invariant::Coverage);
    let look = |cut: &Cut| {
        let found = lists.look(file, &borders, cut).unwrap();
        if is_even {
            // A glance tells the same, and without lists where nothing is wrong.
            let glance = Glance::new(memory).look(file, &borders, cut).unwrap();
            assert_eq!((glance.triangles, glance.is_whole), (found.triangles, found.places == 0));
            let quick = quick.look(file, &borders, cut).unwrap();
            assert_eq!((quick.places, &quick.first), (found.places, &found.first));
        }
        found
    };
    cuts.into_iter().map(look).collect()
}

fn places(file: &Model, cut: &Cut) -> u64 {
    look(file, 1 << 24, [cut])[0].places
}

/// Edges of an odd number of triangles.
fn odd_edges(mesh: &TriMesh) -> usize {
    let sides = |[a, b, c]: &[u32; 3]| [[*a, *b], [*b, *c], [*c, *a]].map(|[u, v]| [u.min(v), u.max(v)]);
    let mut edges: Vec<[u32; 2]> = mesh.triangles.iter().flat_map(sides).collect();
    local::keep_odd(&mut edges, |edge| *edge);
    edges.len()
}

/// The cut with every member of a group but its first at the base mesh, the first at the finest.
fn torn(file: &Model, level: Level) -> (Cut, Cut, Member) {
    let group = file
        .groups()
        .iter()
        .find(|group| group.coarse_count > 1 && group.level == level.0)
        .expect("a group of several clusters");
    let members = file.coarse(file.clusters()[file.members()[group.coarse_first as usize] as usize].group());
    let at = |cut: &Cut, base: &[u32]| {
        let placed = cut.members().iter().map(|member| {
            let record = &file.clusters()[member.cluster.index()];
            let vertices =
                if base.contains(&member.cluster.0) { record.base_vertex_count } else { member.vertices };
            Member { vertices, ..*member }
        });
        Cut::new(placed.collect())
    };
    let whole = Cut::at_level(file, level);
    let record = &file.clusters()[members[0] as usize];
    let first = Member { cluster: ClusterId(members[0]), vertices: record.base_vertex_count };
    (at(&whole, members), at(&whole, &members[1..]), first)
}

#[test]
fn a_closed_surface_is_open_where_this_says_so() {
    for shape in [Shape::Torus, Shape::Isosurface] {
        // Large enough that some groups have a border of several vertices.
        let file = built(&Synth::new(shape, 9000, 5).to_mesh());
        let mut found = [0; 2];
        let legal: Vec<Cut> = (0..40).map(|seed| random_cut(&file, seed).unwrap()).collect();
        // And positions that no rule gives: where groups come apart, borders open.
        let shifted = (1..).zip(&legal).map(|(step, cut)| {
            let moved = cut.members().iter().map(|member| {
                let record = &file.clusters()[member.cluster.index()];
                let step = step * (member.cluster.0 % 3);
                let vertices = member.vertices.saturating_sub(step).max(record.base_vertex_count);
                Member { vertices, ..*member }
            });
            Cut::new(moved.collect())
        });
        let all: Vec<Cut> = legal.iter().cloned().chain(shifted).collect();
        for (i, (cut, looked)) in all.iter().zip(look(&file, 1 << 24, &all)).enumerate() {
            let mesh = extract(&file, cut).unwrap();
            assert_eq!(looked.triangles, mesh.triangles.len() as u64);
            let odd = odd_edges(&mesh);
            assert!(
                odd == 0 || looked.places > 0,
                "{shape:?}: cut {i} has {odd} open edges that were not found"
            );
            assert_eq!(looked.places > 0, looked.first.is_some());
            found[usize::from(i >= legal.len())] += looked.places;
        }
        assert!(found[0] == 0 && found[1] > 0, "{shape:?}: {found:?}");
    }
}

#[test]
fn no_legal_cut_of_any_surface_has_a_crack() {
    let named = [Shape::Terrain, Shape::Plates, Shape::Sphere].map(synth);
    let by_hand = [
        hand::moebius(300),
        hand::klein_bottle(25),
        hand::edge_fan(301),
        hand::soup(90),
        hand::two_cubes_sharing_an_edge(),
        hand::mixed_winding(),
        hand::duplicate_faces(),
    ];
    let hard = CASES.iter().map(|case| case.mesh(1500));
    for (i, mesh) in named.into_iter().chain(by_hand).chain(hard).enumerate() {
        let file = built(&mesh);
        let cuts: Vec<Cut> = (0..24).map(|seed| draw(&file, &Hierarchy::new(&file), seed).unwrap()).collect();
        for (seed, found) in look(&file, 0, &cuts).iter().enumerate() {
            assert_eq!(found.first, None, "mesh {i}, cut of seed {seed}");
        }
    }
}

#[test]
fn a_member_at_another_position_and_a_missing_one_are_found() {
    for mesh in [synth(Shape::Torus), synth(Shape::Terrain), synth(Shape::Plates), hand::moebius(600)] {
        let file = built(&mesh);
        let (legal, one_fine, _) = torn(&file, Level(0));
        for memory in [0, 1 << 24] {
            let [whole, torn] = [&legal, &one_fine].map(|cut| look(&file, memory, [cut])[0].places);
            assert_eq!(whole, 0);
            assert!(torn > 0);
        }
        for cut in [legal, random_cut(&file, 8).unwrap()] {
            for missing in 0..cut.members().len().min(5) {
                let mut members = cut.members().to_vec();
                let shared = file.clusters()[members.remove(missing).cluster.index()].shared_count;
                assert!(shared < 3 || members.is_empty() || places(&file, &Cut::new(members)) > 0);
            }
        }
    }
}

/// A page in pieces that can be changed.
struct Parts {
    positions: Vec<[f32; 3]>,
    targets: Vec<u16>,
    shared: Vec<(u16, u32)>,
    base: usize,
}

/// The file with the page of one cluster changed, and everything else as it must be for that.
fn changed(file: &Model, cluster: ClusterId, change: impl FnOnce(&mut Parts)) -> Model {
    let mut tables = Tables::of(file).unwrap();
    let page = file.page(cluster).unwrap();
    let page = page.view();
    let mut parts = Parts {
        positions: page.positions.to_vec(),
        targets: page.targets.to_vec(),
        shared: page.shared().collect(),
        base: page.base_vertex_count,
    };
    change(&mut parts);
    let errors: Vec<f32> = (parts.base..page.vertex_count()).map(|n| page.error_at(n)).collect();
    let mut payload = Vec::new();
    PageParts {
        vertices: VertexSlices { positions: &parts.positions, ..page.vertices },
        triangles: page.triangles,
        targets: &parts.targets,
        errors: &errors,
        shared: &parts.shared,
        min_error: page.min_error,
        scale_error: page.error_scale,
    }
    .encode(&mut payload)
    .unwrap();
    let record = &mut tables.clusters[cluster.index()];
    record.page_checksum = checksum(&payload);
    record.shared_count = parts.shared.len() as u32;
    record.page_len = payload.len() as u32;
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).unwrap();
    for id in (0..file.clusters().len() as u32).map(ClusterId) {
        writer.page(if id == cluster { &payload } else { file.page_bytes(id) }).unwrap();
    }
    Chpm::open(writer.finish().unwrap()).unwrap()
}

/// A shared vertex of a page that collapses, and a vertex that is not shared and comes before it.
fn on_border(file: &Model, cluster: ClusterId) -> (u16, u16) {
    let page = file.page(cluster).unwrap();
    let page = page.view();
    let shared = page.shared().map(|(vertex, _)| vertex).find(|v| usize::from(*v) >= page.base_vertex_count);
    let inner = (0..page.base_vertex_count as u16).find(|v| !page.is_shared(*v));
    (shared.expect("a collapse on the border"), inner.expect("an inner vertex"))
}

#[test]
fn a_border_vertex_that_goes_elsewhere_in_one_member_is_found() {
    for shape in [Shape::Torus, Shape::Terrain] {
        let file = built(&synth(shape));
        let (legal, _, first) = torn(&file, Level(0));
        assert_eq!(places(&file, &legal), 0);
        let (vertex, inner) = on_border(&file, first.cluster);
        let bad =
            changed(&file, first.cluster, |parts| parts.targets[usize::from(vertex) - parts.base] = inner);
        let found = &look(&bad, 1 << 24, [&legal])[0];
        assert!(found.places > 0, "{shape:?}");
        // Which of both shows first depends on where the vertex goes.
        let told = found.first.as_ref().unwrap();
        let is_open = told.contains("has no partner in the cluster beside it");
        assert!(is_open || told.starts_with("shared vertex ") && told.contains(" and at "), "{told}");
        // In the finest meshes nothing has gone anywhere yet.
        assert_eq!(places(&bad, &Cut::at_level(&bad, Level(0))), 0);
    }
}

#[test]
fn a_shared_vertex_that_is_one_ulp_away_in_one_member_is_found() {
    for shape in [Shape::Torus, Shape::Terrain] {
        let file = built(&synth(shape));
        let leaf = ClusterId(file.clusters().iter().position(|record| record.is_leaf()).unwrap() as u32);
        let bad = changed(&file, leaf, |parts| {
            let x = &mut parts.positions[usize::from(parts.shared[0].0)][0];
            // Towards zero, so that the box still holds it.
            *x = if *x > 0.0 { x.next_down() } else { x.next_up() };
        });
        let finest = Cut::at_level(&bad, Level(0));
        assert_eq!(places(&file, &finest), 0);
        assert!(places(&bad, &finest) > 0, "{shape:?}");
    }
}

#[test]
fn a_coarse_cluster_that_lost_a_shared_vertex_is_found_beside_others() {
    let file = built(&synth(Shape::Torus));
    let group = file.groups().iter().position(|group| group.level == 1).unwrap();
    let coarse = ClusterId(file.coarse(GroupId(group as u32))[0]);
    let bad = changed(&file, coarse, |parts| parts.shared.truncate(parts.shared.len() / 2));
    let level = Cut::at_level(&file, Level(1));
    assert_eq!(places(&file, &level), 0);
    assert!(places(&bad, &level) > 0);
    // Where it is not drawn nothing is missing.
    assert_eq!(places(&bad, &Cut::at_level(&bad, Level(0))), 0);
}

#[test]
fn a_vertex_that_is_in_two_places_is_found_where_no_edge_is_odd() {
    let file = built(&synth(Shape::Torus));
    let finest = Cut::at_level(&file, Level(0));
    let leaf = finest.members()[0].cluster;
    let bad = changed(&file, leaf, |parts| {
        let z = &mut parts.positions[usize::from(parts.shared[0].0)][2];
        *z = if *z > 0.0 { z.next_down() } else { z.next_up() };
    });
    let folder = tempfile::tempdir().unwrap();
    let store = Store::create(folder.path(), 1 << 20).unwrap();
    let borders = Borders::none(&store, file.clusters().len());
    let [good, found] =
        [&file, &bad].map(|file| Walker::new(0, false).look(file, &borders, &finest).unwrap());
    assert_eq!((good.places, good.first), (0, None));
    assert_eq!(found.places, 1);
    let first = found.first.unwrap();
    assert!(first.starts_with("shared vertex ") && first.contains(" in cluster "), "{first}");
}

/// A file's bytes, and how many of its pages' were asked for.
struct Counted(Vec<u8>, AtomicU64);

impl AsRef<[u8]> for Counted {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

/// Triangles between vertices by chance, so that nearly every vertex is shared by many clusters and hardly any collapses.
#[test]
fn pages_are_read_a_few_times_for_each_cut_in_little_memory() {
    let plan = Odd::find("random").unwrap().plan(6000);
    let positions = (0..plan.vertices).map(|v| plan.place(v).map(|x| x as f32)).collect();
    let mesh = TriMesh::new(positions, (0..plan.triangles).map(|t| plan.corners(t)).collect());
    let bytes = built(&mesh).into_inner();
    let file = Chpm::open(Counted(bytes, AtomicU64::new(0))).unwrap();
    let file = file.watched(|counted, _, bytes| {
        counted.1.fetch_add(bytes, Ordering::Relaxed);
    });
    let folder = tempfile::tempdir().unwrap();
    let memory = 200_000 * rayon::current_num_threads() as u64;
    let store = Store::create(folder.path(), memory).unwrap();
    let (progress, cancel, count) = (Silent, Cancel::default(), 20);
    let sound = Checked { file: &file, is_even: true };
    let found = check(sound, count, 0, &store, memory, &progress, &cancel).unwrap();
    assert_eq!(found.fault_count, 0);
    let pages: u64 = file.clusters().iter().map(|record| u64::from(record.page_len)).sum();
    let read = file.get_ref().1.load(Ordering::Relaxed);
    // Choosing a cut, its triangles and borders, what has gone, what has not; and all of that for fewer pages than there are.
    assert!(read <= (10 + 5 * u64::from(count)) * pages, "{} times", read / pages);
}
