//! Every mesh that is hard to simplify, and what its file must be; flat plates and absent attributes.
//!
//! Small variants in small clusters, so that each has several levels. `benches/hard_cases.sh` builds them at full size.

use super::harness::{Folder, root};
use chpm_format::Chpm;
use chpm_mesh::{Aabb, ClusterId, Level, TriMesh};
use chpm_refine::{Cut, Member, extract, random_cut};
use chpm_synth::hand;
use chpm_synth::hard::{CASES, Case};
use rayon::prelude::*;
use std::fs;
use std::sync::Mutex;

/// Triangles of a case and of a leaf cluster.
const SIZE: [u32; 2] = [3000, 128];
/// The same where all levels are measured.
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
fn hard_cases_are_sound_and_hold_what_the_source_has() {
    for_each_case(SIZE, |case, mode, folder, model| {
        let what = format!("hard:{} {mode}", case.name);
        is_the_same_again_and_sound(folder, mode, &what);
        holds_what_the_source_has(case, model, &what);
    });
}

/// Same bytes for other threads and memory, and nothing that is checked is amiss.
fn is_the_same_again_and_sound(folder: &Folder, mode: &str, what: &str) {
    let cluster = SIZE[1];
    let again =
        format!("-o again.chpm -q --cluster-triangles {cluster} --threads 3 --memory 64K --any-memory");
    folder.stdout(&format!("build in.ply {again} {mode}"));
    assert!(folder.read("in.chpm") == folder.read("again.chpm"), "{what} differs from itself");
    let verify = folder.chpm("verify in.chpm --against in.ply --cuts 12 -q");
    let output = verify.get_output();
    assert!(output.status.success(), "{what}: {}", String::from_utf8_lossy(&output.stdout));
}

/// Finite numbers, and cuts with vertices and boundaries of the source alone.
fn holds_what_the_source_has(case: &Case, model: &Model, what: &str) {
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
        let page = page.view();
        assert!(finite(page.positions.as_flattened()) && finite(page.normals.as_flattened()), "{what}");
        let errors = (page.base_vertex_count..=page.vertex_count()).map(|n| page.error_at(n));
        assert!(errors.into_iter().all(|error| error.is_finite() && error >= 0.0), "{what}");
    }
    let all = model.clusters().iter().fold(Aabb::EMPTY, |mut all, cluster| {
        all.merge(&cluster.aabb());
        all
    });
    for group in model.groups() {
        // Errors are stored in 16 bits, rounded up.
        assert!(f64::from(group.max_error) <= all.diagonal() * 1.001, "{what}: {group:?}");
    }
    let source = case.mesh(SIZE[0]);
    let known = (case.offset == [0.0; 3]).then(|| places(&source));
    let border = odd_ends(&extract(model, &Cut::at_level(model, Level(0))).expect("the source"));
    for cut in cuts(model, 6) {
        let lod = extract(model, &cut).expect("a mesh");
        assert!(lod.triangles.len() <= source.triangles.len(), "{what}");
        let count = lod.positions.len() as u32;
        let legal = |[a, b, c]: &[u32; 3]| a.max(b).max(c) < &count && a != b && b != c && c != a;
        assert!(lod.triangles.iter().all(legal), "{what}");
        let mine = places(&lod);
        assert!(known.as_ref().is_none_or(|known| is_within(&mine, known)), "{what}: a vertex moved");
        assert!(is_within(&odd_ends(&lod), &border), "{what}: an edge came open");
    }
}

/// The places of all vertices, by their bits, ascending.
fn places(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let mut places: Vec<[u32; 3]> = mesh.positions.iter().map(|p| p.map(f32::to_bits)).collect();
    places.sort_unstable();
    places
}

/// The places of the ends of all edges of an odd number of faces, ascending.
fn odd_ends(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let sides = |[a, b, c]: &[u32; 3]| [[*a, *b], [*b, *c], [*c, *a]].map(|[u, v]| [u.min(v), u.max(v)]);
    let mut edges: Vec<[u32; 2]> = mesh.triangles.iter().flat_map(sides).collect();
    edges.sort_unstable();
    let odd = edges.chunk_by(|a, b| a == b).filter(|same| same.len() % 2 == 1).flat_map(|same| same[0]);
    let mut places: Vec<_> = odd.map(|v| mesh.positions[v as usize].map(f32::to_bits)).collect();
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
        for p in extract(&model, &cut).expect("a mesh").vertices.positions {
            assert!(exact.binary_search(&p.map(|x| f64::from(x).to_bits())).is_ok(), "{p:?}");
        }
    }
}

/// The error that a cut promises.
fn stored(model: &Model, cut: &Cut) -> f64 {
    let of = |m: &Member| model.page(m.cluster).expect("a page").view().error_at(m.vertices as usize);
    cut.members().iter().map(of).fold(0.0, f32::max).into()
}

#[test]
fn stored_errors_bound_what_is_measured() {
    let violations = Mutex::new(Vec::new());
    for_each_case(MEASURED, |case, mode, folder, _| {
        // Every level, twice, and some cuts, without any allowance.
        let out = folder.chpm("measure in.chpm --against in.ply --levels --cuts 4 --threads 1 -q");
        let output = out.get_output();
        if !output.status.success() {
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            violations.lock().expect("no panic before").push(format!("hard:{} {mode}: {told}", case.name));
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
fn cubes_that_touch_have_a_small_root() {
    for name in ["cubes", "voxels"] {
        let (_, model) = built(Case::find(name).expect("a case"), "", [12_000, 512]);
        let root = Cut::new(
            model
                .roots()
                .map(|id| Member { cluster: id, vertices: model.clusters()[id.index()].base_vertex_count })
                .collect(),
        );
        let triangles = extract(&model, &root).expect("a mesh").triangles.len();
        assert!(triangles <= 1000, "{name}: {triangles}");
    }
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
    assert_eq!(list.lines().filter(|line| line.starts_with("hard:")).count(), CASES.len());
    for case in &CASES {
        assert!(list.contains(&format!("hard:{} ", case.name)) && list.contains(case.is), "{case:?}");
    }
    assert!(folder.stderr("synth hard:soft -o x.ply", 2).contains("no hard mesh"));
    assert!(folder.stderr("synth hard:plane", 2).contains("--output"));
    assert!(folder.names().is_empty());
}

/// The table of `data/HARD_CASES.md`: what the suite says, and the newest record.
fn table() -> String {
    let read = |path: &str| fs::read_to_string(root().join(path)).expect("a file of the repository");
    let names =
        fs::read_dir(root().join("benches/records")).expect("records").map(|entry| entry.expect("one"));
    let names = names.map(|entry| entry.file_name().into_string().expect("a name"));
    let newest = names.filter(|name| name.ends_with("-hard-cases.csv")).max().expect("a record");
    let record = read(&format!("benches/records/{newest}"));
    let rows: Vec<Vec<&str>> = record.lines().map(|line| line.split(',').collect()).collect();
    let mut table = format!("Measured: `benches/records/{newest}`.\n\n");
    table += "| case | what it is | what it must give | triangles | time | forced | stalled | top |\n";
    table += "|---|---|---|---|---|---|---|---|\n";
    for case in &CASES {
        let of = |column: &str| {
            let at = rows[0].iter().position(|name| *name == column).expect("a column");
            let row = rows.iter().find(|row| row.get(2) == Some(&case.name)).expect("a row for every case");
            row[at]
        };
        let [count, time, forced, stalled, top] =
            ["triangles", "cpu_ratio", "forced", "stalled", "top_triangles"].map(of);
        assert!(
            time.parse::<f64>().expect("a ratio") <= case.slowest,
            "{case:?} takes {time} times as long as a terrain"
        );
        let Case { name, is, gives, .. } = case;
        table += &format!("| {name} | {is} | {gives} | {count} | {time} | {forced} | {stalled} | {top} |\n");
    }
    table
}

#[test]
fn the_table_of_the_suite_is_what_the_suite_says() {
    let document = fs::read_to_string(root().join("data/HARD_CASES.md")).expect("the document");
    assert!(document.ends_with(&table()), "data/HARD_CASES.md has to end with:\n{}", table());
}
