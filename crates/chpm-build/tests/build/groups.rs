//! Dependency groups and topology changes: whatever the model and the settings, nothing cracks, and both do help.

use crate::site::{ChpmFile, Site, config, leaks, odd_vertices, without_copies};
use chpm_build::config::Topology;
use chpm_build::{BuildConfig, BuildReport};
use chpm_format::{BoundaryMode, checksum};
use chpm_mesh::{Bytes, TriMesh};
use chpm_partition::Partitioner;
use chpm_refine::{CameraPath, Cut, Hierarchy, View, extract, random_cut, select};
use chpm_synth::{Shape, Synth, hand};
use proptest::prelude::*;

const MODES: [(BoundaryMode, Topology); 4] = [
    (BoundaryMode::Lock, Topology::Keep),
    (BoundaryMode::Lock, Topology::Change),
    (BoundaryMode::Dependencies, Topology::Keep),
    (BoundaryMode::Dependencies, Topology::Change),
];

fn with_mode(cluster_triangles: u32, (boundary, topology): (BoundaryMode, Topology)) -> BuildConfig {
    let mut config = config(cluster_triangles);
    (config.settings.boundary, config.settings.topology) = (boundary, topology);
    config
}

/// Every second quad of a board: all inner vertices are bow ties.
fn bow_ties(side: u32) -> TriMesh {
    let mut mesh = hand::grid(side, side);
    let mut quad = 0..;
    mesh.triangles = (mesh.triangles.chunks(2))
        .filter(|_| quad.next().is_some_and(|q: u32| (q / side + q % side).is_multiple_of(2)))
        .flatten()
        .copied()
        .collect();
    mesh
}

fn beside(mut a: TriMesh, b: &TriMesh) -> TriMesh {
    let first = a.positions.len() as u32;
    a.positions.extend(b.positions.iter().map(|p| [p[0] + 3.0, p[1], p[2]]));
    a.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + first)));
    a
}

fn mixed_winding(mut mesh: TriMesh) -> TriMesh {
    mesh.triangles.iter_mut().step_by(3).for_each(|t| t.swap(0, 1));
    mesh
}

fn of(shape: Shape, triangles: u64) -> TriMesh {
    Synth::new(shape, triangles, 3).to_mesh()
}

/// One model of every kind.
fn models() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("sphere", of(Shape::Sphere, 3000)),
        ("torus", of(Shape::Torus, 3000)),
        ("terrain", of(Shape::Terrain, 3000)),
        ("isosurface", of(Shape::Isosurface, 4000)),
        ("plates", of(Shape::Plates, 3000)),
        ("bow ties", bow_ties(40)),
        ("moebius", hand::moebius(800)),
        ("klein bottle", hand::klein_bottle(36)),
        ("two components", beside(of(Shape::Torus, 1500), &of(Shape::Sphere, 1500))),
        ("soup", hand::soup(800)),
        ("mixed winding", mixed_winding(of(Shape::Torus, 2500))),
        ("edge fan", hand::edge_fan(400)),
        ("odd edge fan", hand::edge_fan(401)),
        ("two cubes", hand::two_cubes_sharing_an_edge()),
    ]
}

/// What a random camera selects: by its seed, from coarse to the finest there is.
fn seen(file: &ChpmFile, seed: u64) -> Cut {
    let path = CameraPath::random(&file.header().aabb(), seed, 1);
    let pixels = 16.0 * 0.5_f64.powi((seed % 12) as i32);
    let view = View::new(&path.cameras[0], [512, 512], pixels).unwrap();
    select(file, &Hierarchy::new(file), &view).unwrap()
}

/// Draws random cuts and random cameras in turn; answers what the first one that leaks has to say.
pub(crate) fn first_leak(file: &ChpmFile, source: &TriMesh, cuts: u64) -> Option<String> {
    let source = &without_copies(source);
    let border = odd_vertices(source);
    (0..cuts).find_map(|seed| {
        let cut = if seed % 2 == 0 { random_cut(file, seed).unwrap() } else { seen(file, seed / 2) };
        let lod = extract(file, &cut).unwrap();
        let found = leaks(&lod, &border);
        (!found.is_empty()).then(|| format!("cut {seed}: {} odd edges, as {:?}", found.len(), found[0]))
    })
}

#[test]
fn no_cut_of_any_model_in_any_mode_cracks() {
    for (name, mesh) in models() {
        let site = Site::of(&mesh);
        for mode in MODES {
            let (_, file) = site.build(&with_mode(64, mode));
            assert_eq!(first_leak(&file, &mesh, 200), None, "{name}, {mode:?}");
        }
    }
}

#[test]
fn threads_and_memory_do_not_show_in_any_mode() {
    let chosen = ["terrain", "isosurface", "bow ties"];
    for (name, mesh) in models().into_iter().filter(|(name, _)| chosen.contains(name)) {
        let site = Site::of(&mesh);
        for mode in MODES {
            let mut config = with_mode(64, mode);
            let mut sums = Vec::new();
            for (threads, memory) in [(1, 1 << 28), (2, 1 << 28), (4, 1 << 28), (1, 1 << 16), (4, 1 << 16)] {
                (config.resources.threads, config.resources.memory) = (threads, Bytes(memory));
                sums.push(checksum(&site.bytes(&config).1));
            }
            assert!(sums.iter().all(|sum| *sum == sums[0]), "{name}, {mode:?}: {sums:x?}");
        }
    }
}

/// The share of vertices that clusters share, from level 1 up.
fn shared_share(report: &BuildReport) -> f64 {
    let above = || report.levels.iter().skip(1);
    let shared: u64 = above().map(|level| level.shared_vertices).sum();
    shared as f64 / above().map(|level| level.vertices).sum::<u64>() as f64
}

/// Triangles of the finest meshes of the top level.
fn top(report: &BuildReport) -> u64 {
    report.levels.last().unwrap().triangles
}

#[test]
fn groups_occur_and_leave_fewer_shared_vertices_and_a_smaller_top() {
    for topology in [Topology::Keep, Topology::Change] {
        let mut all_tops = [0; 2];
        for shape in Shape::ALL {
            let site = Site::of(&of(shape, 12_000));
            let (locked, lock) = site.build(&with_mode(64, (BoundaryMode::Lock, topology)));
            let (grouped, file) = site.build(&with_mode(64, (BoundaryMode::Dependencies, topology)));
            assert!(lock.groups().iter().all(|group| group.coarse_count == 1), "{shape}");
            assert!(file.groups().iter().any(|group| group.coarse_count > 2), "{shape}");
            let shares = [&grouped, &locked].map(shared_share);
            assert!(shares[0] < shares[1], "{shape}, {topology:?}: {shares:?}");
            all_tops = [all_tops[0] + top(&grouped), all_tops[1] + top(&locked)];
        }
        // Of a single shape the top may be no smaller: where components are all that is left.
        assert!(all_tops[0] < all_tops[1], "{topology:?}: {all_tops:?}");
    }
}

/// Where nothing about a terrain is special, none of a level's clusters stores much more than others: what its borders lose is not what its error is for.
#[test]
fn errors_of_a_level_are_alike() {
    let site = Site::of(&of(Shape::Terrain, 200_000));
    let (_, file) = site.build(&with_mode(1024, (BoundaryMode::Dependencies, Topology::Change)));
    let root_level = file.clusters().iter().map(|cluster| cluster.level).max().unwrap();
    for level in 0..root_level {
        let of_level = file.clusters().iter().filter(|cluster| cluster.level == level);
        let mut errors: Vec<f32> = of_level.map(|cluster| cluster.max_error).collect();
        errors.sort_unstable_by(f32::total_cmp);
        let (median, most) = (errors[errors.len() / 2], errors[errors.len() - 1]);
        assert!(most < 2.0 * median, "level {level}: {most} beside {median}");
    }
}

/// Where most vertices are shared, the rest of a cluster need not go whatever it costs: a level stores no more than a few times what larger clusters do.
#[test]
fn small_clusters_have_no_errors_that_run_away() {
    let site = Site::of(&of(Shape::Terrain, 100_000));
    let median = |cluster_triangles: u32| {
        let (_, file) =
            site.build(&with_mode(cluster_triangles, (BoundaryMode::Dependencies, Topology::Change)));
        let of_level = file.clusters().iter().filter(|cluster| cluster.level == 3);
        let mut errors: Vec<f32> = of_level.map(|cluster| cluster.max_error).collect();
        errors.sort_unstable_by(f32::total_cmp);
        errors[errors.len() / 2]
    };
    let [small, large] = [128, 2048].map(median);
    println!("{small} beside {large}");
    assert!(small < 6.0 * large, "{small} beside {large}");
}

#[test]
fn a_group_has_no_more_members_than_it_may() {
    let mesh = of(Shape::Torus, 12_000);
    for members in [1, 2, 3, 8] {
        let mut config = with_mode(64, (BoundaryMode::Dependencies, Topology::Change));
        config.settings.dependency_members = members;
        let (_, file) = Site::of(&mesh).build(&config);
        let largest = file.groups().iter().map(|group| group.coarse_count).max().unwrap();
        assert_eq!(largest, members);
        assert_eq!(first_leak(&file, &mesh, 40), None, "{members} members");
    }
}

#[test]
fn topology_changes_only_if_it_may_and_then_helps() {
    let site = Site::of(&of(Shape::Isosurface, 12_000));
    let [keep, change] = [Topology::Keep, Topology::Change]
        .map(|topology| site.build(&with_mode(64, (BoundaryMode::Dependencies, topology))).0);
    let forced = |report: &BuildReport| report.levels.iter().map(|level| level.forced).sum::<u64>();
    let base = |report: &BuildReport| report.levels.last().unwrap().base_triangles;
    assert_eq!(forced(&keep), 0);
    assert!(forced(&change) > 0);
    assert!(base(&change) < base(&keep), "{} {}", base(&change), base(&keep));
}

#[test]
fn clusters_of_which_nothing_is_left_merge() {
    // Halving a single triangle leaves none, and then there is none in the parent either.
    for mesh in [hand::soup(2), hand::soup(9), hand::edge_fan(6), hand::bow_tie()] {
        for mode in MODES {
            let (_, file) = Site::of(&mesh).build(&with_mode(1, mode));
            assert_eq!(first_leak(&file, &mesh, 40), None, "{mode:?}");
        }
    }
}

/// What happens to a model before it is built; numbers are taken modulo what there is.
#[derive(Clone, Copy, Debug)]
enum Damage {
    Remove(u32),
    Turn(u32),
    Copy(u32),
    /// Both vertices become the first one, wherever they are.
    Merge(u32, u32),
    /// A triangle of any three vertices.
    Add([u32; 3]),
    /// A vertex goes where another one is, and stays another.
    Cover(u32, u32),
}

impl Damage {
    fn any() -> impl Strategy<Value = Self> {
        let number = || 0..u32::from(u16::MAX);
        prop_oneof![
            number().prop_map(Damage::Remove),
            number().prop_map(Damage::Turn),
            number().prop_map(Damage::Copy),
            (number(), number()).prop_map(|(a, b)| Damage::Merge(a, b)),
            [number(), number(), number()].prop_map(Damage::Add),
            (number(), number()).prop_map(|(a, b)| Damage::Cover(a, b)),
        ]
    }

    fn happen(self, mesh: &mut TriMesh) {
        let (vertices, triangles) = (mesh.positions.len() as u32, mesh.triangles.len() as u32);
        let triangle = |n: u32| (n % triangles) as usize;
        match self {
            Damage::Remove(n) if triangles > 1 => drop(mesh.triangles.swap_remove(triangle(n))),
            Damage::Remove(_) => {}
            Damage::Turn(n) => mesh.triangles[triangle(n)].swap(0, 1),
            Damage::Copy(n) => mesh.triangles.push(mesh.triangles[triangle(n)]),
            Damage::Merge(a, b) => {
                let (a, b) = (a % vertices, b % vertices);
                mesh.triangles.as_flattened_mut().iter_mut().filter(|v| **v == b).for_each(|v| *v = a);
            }
            Damage::Add(corners) => mesh.triangles.push(corners.map(|n| n % vertices)),
            Damage::Cover(a, b) => {
                mesh.positions[(a % vertices) as usize] = mesh.positions[(b % vertices) as usize];
            }
        }
    }
}

pub(crate) fn any_mesh() -> impl Strategy<Value = TriMesh> {
    let random = prop::collection::vec(any::<[u8; 3]>(), 1..600).prop_map(|corners| {
        // Triangles among few vertices: edges of many faces everywhere.
        let positions = (0..=255u8).map(|i| [i & 7, i >> 3 & 7, i >> 6].map(f32::from)).collect();
        TriMesh::new(positions, corners.iter().map(|t| t.map(u32::from)).collect())
    });
    let well = (prop::sample::select(Shape::ALL.to_vec()), 100..2500u64, 0..50u64)
        .prop_map(|(shape, triangles, seed)| Synth::new(shape, triangles, seed).to_mesh());
    let odd = prop_oneof![
        (3..30u32).prop_map(bow_ties),
        (3..400u32).prop_map(hand::moebius),
        (3..25u32).prop_map(hand::klein_bottle),
        (1..300u32).prop_map(hand::edge_fan),
        (3..300u32).prop_map(hand::fan),
        (1..600u32).prop_map(hand::strip),
    ];
    let damage = prop::collection::vec(Damage::any(), 0..60);
    (prop_oneof![1 => random, 4 => well, 2 => odd], damage).prop_map(|(mut mesh, damage)| {
        damage.into_iter().for_each(|damage| damage.happen(&mut mesh));
        mesh
    })
}

pub(crate) fn any_config() -> impl Strategy<Value = BuildConfig> {
    let groups = (1..10u32, 0..4u32, 1..10u32, prop::sample::select(vec![1.0, 4.0, f32::MAX]));
    (32..256u32, prop::sample::select(MODES.to_vec()), any::<bool>(), 0..1000u64, groups).prop_map(
        |(cluster_triangles, mode, greedy, seed, (shared, levels, members, ratio))| {
            let mut config = with_mode(cluster_triangles, mode);
            let settings = &mut config.settings;
            settings.partitioner = if greedy { Partitioner::Greedy } else { Partitioner::Metis };
            settings.seed = seed;
            settings.dependency_shared = shared;
            settings.dependency_levels = levels;
            settings.dependency_members = members;
            settings.dependency_error_ratio = ratio;
            config
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_cracks_whatever_is_built(mesh in any_mesh(), config in any_config()) {
        let proper = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        prop_assume!(mesh.triangles.iter().any(proper));
        let (_, file) = Site::of(&mesh).build(&config);
        let leak = first_leak(&file, &mesh, 25);
        prop_assert!(leak.is_none(), "{leak:?}");
    }
}
