//! Every mesh that is hard to simplify, and what its file must be; flat plates and absent attributes.
//!
//! Small variants in small clusters, so that each has several levels. `benches/hard_cases.sh` builds them at full size.

use super::harness::Folder;
use chpm_format::Chpm;
use chpm_measure::Bvh;
use chpm_mesh::synth::hand;
use chpm_mesh::synth::hard::{CASES, Case};
use chpm_mesh::{ClusterId, Level, TriMesh};
use chpm_refine::{Cut, Member, extract, random_cut};
use nalgebra::Point3;
use rayon::prelude::*;
use std::sync::Mutex;

/// Triangles of a case and of a leaf cluster.
const SIZE: [u32; 2] = [6000, 256];
/// The same where every triangle is measured.
const MEASURED: [u32; 2] = [1000, 64];
const MODES: [&str; 2] = ["", "--boundary lock --topology keep"];

type Model = Chpm<Vec<u8>>;

/// The case built in `mode`, and its folder, in which it is `in.ply` and `in.chpm`.
fn built(case: &Case, mode: &str, [triangles, cluster]: [u32; 2]) -> (Folder, Model) {
    let folder = Folder::new();
    folder.stdout(&format!("synth hard:{} --triangles {triangles} -o in.ply -q", case.name));
    let out = folder.stdout(&format!("build in.ply -q --cluster-triangles {cluster} --threads 1 {mode}"));
    assert!(!out.contains("***"), "{case:?}: the partitioner spoke: {out}");
    let model = Chpm::open(folder.read("in.chpm")).expect("a file");
    (folder, model)
}

/// Runs `check` on every case in every mode, some at a time; the command is a process of its own.
fn for_each_case(size: [u32; 2], check: impl Fn(&'static Case, &str, &Folder, &Model) + Sync) {
    let all: Vec<_> = CASES.iter().flat_map(|case| MODES.map(|mode| (case, mode))).collect();
    all.par_iter().for_each(|(case, mode)| {
        let (folder, model) = built(case, mode, size);
        check(case, mode, &folder, &model);
    });
}

/// Some cuts of every kind: each level's finest meshes, the base mesh, and random ones.
fn cuts(model: &Model, random: u64) -> Vec<Cut> {
    let levels = (0..model.levels().len() as u32).map(|level| Cut::at_level(model, Level(level)));
    let base =
        |id: ClusterId| Member { cluster: id, vertices: model.clusters()[id.index()].base_vertex_count };
    let base = Cut::new(model.roots().map(base).collect());
    let random = (0..random).map(|seed| random_cut(model, seed).expect("a cut"));
    levels.chain([base]).chain(random).collect()
}

#[test]
fn hard_cases_are_sound_without_cracks_and_always_the_same() {
    for_each_case(SIZE, |case, mode, folder, _| {
        let what = format!("hard:{} {mode}", case.name);
        let again = "-o again.chpm -q --cluster-triangles 256 --threads 3 --memory 64K --any-memory";
        folder.stdout(&format!("build in.ply {again} {mode}"));
        assert!(folder.read("in.chpm") == folder.read("again.chpm"), "{what} differs from itself");
        let verify = folder.chpm("verify in.chpm --against in.ply --cuts 12 -q");
        let output = verify.get_output();
        assert!(output.status.success(), "{what}: {}", String::from_utf8_lossy(&output.stdout));
    });
}

#[test]
fn hard_cases_hold_numbers_and_meshes_of_the_source() {
    for_each_case(SIZE, |case, mode, _, model| {
        let what = format!("hard:{} {mode}", case.name);
        let finite = |numbers: &[f32]| numbers.iter().all(|x| x.is_finite());
        for cluster in model.clusters() {
            assert!(finite(&[cluster.min_error, cluster.max_error, cluster.radius]), "{what}: {cluster:?}");
            assert!(finite([cluster.aabb_min, cluster.aabb_max, cluster.center].as_flattened()), "{what}");
            assert!(0.0 <= cluster.min_error && cluster.min_error <= cluster.max_error, "{what}");
        }
        for group in model.groups() {
            assert!(finite(&[group.min_error, group.max_error, group.radius]), "{what}: {group:?}");
            assert!(finite(&group.center), "{what}: {group:?}");
        }
        for id in (0..model.clusters().len() as u32).map(ClusterId) {
            let page = model.page_checked(id).expect("a page");
            assert!(finite(page.positions.as_flattened()) && finite(page.normals.as_flattened()), "{what}");
            let errors = (page.base_vertex_count..=page.vertex_count()).map(|n| page.error_at(n));
            assert!(errors.into_iter().all(|error| error.is_finite() && error >= 0.0), "{what}");
        }
        let source = case.mesh(SIZE[0]);
        let known = (case.offset == [0.0; 3]).then(|| places(&source));
        for cut in cuts(model, 6) {
            let lod = extract(model, &cut).expect("a mesh");
            assert!(lod.triangles.len() <= source.triangles.len(), "{what}");
            let count = lod.positions.len() as u32;
            let legal = |[a, b, c]: &[u32; 3]| a.max(b).max(c) < &count && a != b && b != c && c != a;
            assert!(lod.triangles.iter().all(legal), "{what}");
            let mine = places(&lod);
            assert!(known.as_ref().is_none_or(|known| is_within(&mine, known)), "{what}: a vertex moved");
        }
    });
}

/// The places of all vertices, by their bits, ascending.
fn places(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let mut places: Vec<[u32; 3]> = mesh.positions.iter().map(|p| p.map(f32::to_bits)).collect();
    places.sort_unstable();
    places
}

fn is_within(some: &[[u32; 3]], all: &[[u32; 3]]) -> bool {
    some.iter().all(|place| all.binary_search(place).is_ok())
}

#[test]
fn a_far_model_in_doubles_keeps_its_vertices() {
    let case = Case::find("far-double").expect("a case");
    let (_, model) = built(case, "", SIZE);
    let (origin, source) = (model.header().origin, case.mesh(SIZE[0]));
    assert!(origin.iter().zip(case.offset).all(|(o, offset)| (o - offset).abs() <= 1.0), "{origin:?}");
    let exact: Vec<[u64; 3]> = {
        let moved = |p: &[f32; 3]| [0, 1, 2].map(|a| f64::from(p[a]) + case.offset[a] - origin[a]);
        let rounded = |p: [f64; 3]| p.map(|x| f64::from(x as f32).to_bits());
        let mut all: Vec<_> = source.positions.iter().map(|p| rounded(moved(p))).collect();
        all.sort_unstable();
        all
    };
    for cut in cuts(&model, 2) {
        for p in extract(&model, &cut).expect("a mesh").positions {
            assert!(exact.binary_search(&p.map(|x| f64::from(x).to_bits())).is_ok(), "{p:?}");
        }
    }
}

/// Where the vertices of a cut that nothing is left of were last: what a stored error may be measured to.
mod remains {
    use super::*;
    use std::collections::BTreeMap;

    /// The last places of the parts that have vanished, for the vertices of each cluster.
    pub(super) struct Remains<'a> {
        model: &'a Model,
        /// Where a cluster of the cut is refined to.
        positions: BTreeMap<u32, usize>,
        /// What was found for a cluster's vertices.
        known: BTreeMap<u32, Vec<Vec<[f32; 3]>>>,
    }

    impl<'a> Remains<'a> {
        pub(super) fn of(model: &'a Model, cut: &Cut) -> Self {
            let positions = cut.members().iter().map(|m| (m.cluster.0, m.vertices as usize)).collect();
            Remains { model, positions, known: BTreeMap::new() }
        }

        /// For each vertex of a cluster's finest mesh: the places of contracted parts that it ended in; none for a vertex that
        /// a triangle of the cut uses. Vertices of one place are not told apart from one level to the next, so all their ends count.
        pub(super) fn ends(&mut self, cluster: u32) -> Vec<Vec<[f32; 3]>> {
            if let Some(known) = self.known.get(&cluster) {
                return known.clone();
            }
            let page = self.model.page(ClusterId(cluster)).expect("a page");
            let mesh = page.progressive_mesh();
            let position = self.positions.get(&cluster).copied();
            let n = position.unwrap_or(page.base_vertex_count);
            let mut used = vec![false; n];
            let mut triangles = Vec::new();
            mesh.triangles_at(n, &mut triangles);
            triangles.as_flattened().iter().for_each(|v| used[usize::from(*v)] = true);
            let above = if position.is_some() { BTreeMap::new() } else { self.above(cluster) };
            let end = |v: usize| {
                let place = page.positions[v];
                if !used[v] {
                    return vec![place];
                }
                above.get(&place.map(f32::to_bits)).cloned().unwrap_or_default()
            };
            let survivors: Vec<Vec<[f32; 3]>> = (0..n).map(end).collect();
            let ends: Vec<_> = (0..page.vertex_count() as u16)
                .map(|v| survivors[usize::from(mesh.resolve(v, n))].clone())
                .collect();
            self.known.insert(cluster, ends.clone());
            ends
        }

        /// By place, the ends of the vertices of the clusters that replace this one.
        fn above(&mut self, cluster: u32) -> BTreeMap<[u32; 3], Vec<[f32; 3]>> {
            let group = self.model.clusters()[cluster as usize].parent_group();
            let mut above: BTreeMap<_, Vec<[f32; 3]>> = BTreeMap::new();
            for parent in self.model.coarse(group).to_vec() {
                let ends = self.ends(parent);
                let page = self.model.page(ClusterId(parent)).expect("a page");
                for (place, ends) in page.positions.iter().zip(ends) {
                    above.entry(place.map(f32::to_bits)).or_default().extend(ends);
                }
            }
            above
        }
    }
}

/// Points of a triangle in quarters of its sides: corners, edges and inside, 15 in all.
fn samples(corners: [[f32; 3]; 3]) -> impl Iterator<Item = Point3<f64>> {
    let corners = corners.map(|p| Point3::from(p.map(f64::from)));
    (0..=4).flat_map(|i| (0..=4 - i).map(move |j| [i, j, 4 - i - j])).map(move |weights| {
        let [a, b, c] = weights.map(|w| f64::from(w) / 4.0);
        Point3::from(corners[0].coords * a + corners[1].coords * b + corners[2].coords * c)
    })
}

/// The largest distance found between the source and a cut, both ways; the parts that vanished are points.
fn measured(model: &Model, cut: &Cut) -> f64 {
    let bvh = |mesh: &TriMesh| Bvh::new(&mesh.positions, &mesh.triangles);
    let source = extract(model, &Cut::at_level(model, Level(0))).expect("the source");
    let lod = extract(model, cut).expect("a mesh");
    let (to_source, to_lod) = (bvh(&source), bvh(&lod));
    let from_lod = lod.triangles.iter().flat_map(|t| samples(lod.corners(*t)));
    let backward = from_lod.map(|p| to_source.distance(p)).fold(0.0, f64::max);
    let mut remains = remains::Remains::of(model, cut);
    let mut forward = 0.0_f64;
    for (id, _) in (0..).zip(model.clusters()).filter(|(_, cluster)| cluster.is_leaf()) {
        let ends = remains.ends(id);
        let page = model.page(ClusterId(id)).expect("a page");
        for triangle in page.triangles {
            let corners = triangle.map(usize::from);
            for p in samples(corners.map(|v| page.positions[v])) {
                let points = corners.iter().flat_map(|v| &ends[*v]);
                let to_point = points.map(|q| (p - Point3::from(q.map(f64::from))).norm());
                forward = forward.max(to_point.fold(to_lod.distance(p), f64::min));
            }
        }
    }
    forward.max(backward)
}

/// The error that a cut promises.
fn stored(model: &Model, cut: &Cut) -> f64 {
    let of = |m: &Member| model.page(m.cluster).expect("a page").error_at(m.vertices as usize);
    cut.members().iter().map(of).fold(0.0, f32::max).into()
}

#[test]
#[ignore = "stored errors are estimates: to be enabled with certified ones"]
fn stored_errors_bound_what_is_measured() {
    let violations = Mutex::new(Vec::new());
    for_each_case(MEASURED, |case, mode, _, model| {
        let bounds = model.header().aabb();
        let largest = [bounds.min, bounds.max].concat().into_iter().map(f32::abs).fold(0.0, f32::max);
        // What the measure itself rounds: coordinates times a few steps of f64.
        let rounding = f64::from(largest) * 2.0_f64.powi(-48);
        let told = cuts(model, 4).into_iter().map(|cut| (stored(model, &cut), measured(model, &cut)));
        let wrong: Vec<_> = told.filter(|(stored, measured)| *measured > stored + rounding).collect();
        if let Some((stored, measured)) = wrong.first() {
            let first = format!("the first says {stored:e} and deviates by {measured:e}");
            let told = format!("hard:{} {mode}: {} cuts, {first}", case.name, wrong.len());
            violations.lock().expect("no panic before").push(told);
        }
    });
    let violations = violations.into_inner().expect("no panic before");
    assert!(violations.is_empty(), "{violations:#?}");
}

#[test]
fn what_costs_nothing_says_so() {
    let (_, model) = built(Case::find("point").expect("a case"), "", SIZE);
    assert!(model.clusters().iter().all(|cluster| cluster.max_error == 0.0));
}

/// Triangles of the coarsest cut without error.
fn triangles_without_error(folder: &Folder) -> usize {
    let model = Chpm::open(folder.read("in.chpm")).expect("a file");
    let cut = Cut::at_error(&model, 0.0).expect("a cut");
    assert_eq!(stored(&model, &cut), 0.0);
    extract(&model, &cut).expect("a mesh").triangles.len()
}

#[test]
#[ignore = "forced collapses tell their whole displacement: to be enabled with certified errors"]
fn a_flat_plate_becomes_its_outline_for_nothing() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &hand::grid(80, 80));
    folder.stdout("build in.ply -q --cluster-triangles 256");
    // The root of a file keeps about a hundred triangles whatever they cost.
    assert!(triangles_without_error(&folder) <= 100, "{}", triangles_without_error(&folder));
    folder.write_mesh("in.ply", &Case::find("plane").expect("a case").mesh(SIZE[0]));
    folder.stdout("build in.ply -qf --cluster-triangles 256");
    assert!(triangles_without_error(&folder) <= 100, "{}", triangles_without_error(&folder));
}

#[test]
fn attributes_that_are_not_there_take_no_bytes() {
    let mut mesh = Case::find("orders").expect("a case").mesh(3000);
    let bare = mesh.clone();
    mesh.normals = vec![[0.0, 0.0, 1.0]; mesh.positions.len()];
    mesh.colors = vec![[1, 2, 3, 255]; mesh.positions.len()];
    let folder = Folder::new();
    let page_bytes = |mesh: &TriMesh, options: &str| {
        folder.write_mesh("in.ply", mesh);
        folder.stdout(&format!("build in.ply -qf --cluster-triangles 256 {options}"));
        let model = Chpm::open(folder.read("in.chpm")).expect("a file");
        let sum = |of: fn(&chpm_format::ClusterRecord) -> u32| -> u64 {
            model.clusters().iter().map(|cluster| u64::from(of(cluster))).sum()
        };
        (sum(|cluster| cluster.page_len), sum(|cluster| cluster.vertex_count))
    };
    let (full, vertices) = page_bytes(&mesh, "");
    let (without, _) = page_bytes(&bare, "");
    assert_eq!(full - without, 16 * vertices);
    assert_eq!(page_bytes(&mesh, "--no-colors").0 - without, 12 * vertices);
    assert_eq!(page_bytes(&mesh, "--no-normals").0 - without, 4 * vertices);
    assert_eq!(page_bytes(&mesh, "--no-normals --no-colors").0, without);
}

#[test]
fn hard_cases_are_listed_and_unknown_ones_refused() {
    let folder = Folder::new();
    let list = folder.stdout("synth --list");
    assert_eq!(list.lines().count(), CASES.len());
    for case in &CASES {
        assert!(list.contains(&format!("hard:{} ", case.name)) && list.contains(case.is), "{case:?}");
    }
    assert!(folder.stderr("synth hard:soft -o x.ply", 2).contains("no hard mesh"));
    assert!(folder.stderr("synth hard:plane", 2).contains("--output"));
    assert!(folder.names().is_empty());
}
