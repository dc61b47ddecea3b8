//! Positions on a lattice: what is drawn is near the source, errors know how near, and nothing cracks.

use super::harness::{Folder, shell};
use super::sheets::textured;
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, TriMesh};
use chpm_synth::{Shape, Synth, hand};

fn open(folder: &Folder, name: &str) -> Chpm<Vec<u8>> {
    Chpm::open(folder.read(name)).expect("a file")
}

fn step(file: &Chpm<Vec<u8>>) -> f64 {
    file.metadata().expect("metadata").lattice_step().expect("a step").expect("a lattice")
}

/// All coordinates are multiples of the step.
fn is_on_lattice(file: &Chpm<Vec<u8>>) -> bool {
    let step = step(file);
    (0..file.clusters().len() as u32).all(|id| {
        let page = file.page(ClusterId(id)).expect("a page");
        page.view().positions.as_flattened().iter().all(|x| (f64::from(*x) / step).fract() == 0.0)
    })
}

/// What a text says in doubles, so that the origin is not zero.
fn far_away(mesh: &TriMesh) -> String {
    let mut text = String::new();
    for p in &mesh.positions {
        let [x, y, z] = [0, 1, 2].map(|axis| f64::from(p[axis]) + [4.5e6, -3.25e5, 117.0][axis]);
        text += &format!("v {x:.9} {y:.9} {z:.9}\n");
    }
    for [a, b, c] in &mesh.triangles {
        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    text
}

#[test]
fn stored_errors_hold_of_what_the_source_was() {
    let folder = Folder::new();
    let mesh = Synth::new(Shape::Isosurface, 4_000, 1).to_mesh();
    folder.write_mesh("near.ply", &mesh);
    folder.write("far.obj", far_away(&mesh));
    for source in ["near.ply", "far.obj"] {
        let mut lens = Vec::new();
        for (bits, pages) in [(8, "raw"), (12, "packed"), (16, "packed")] {
            let how = format!("--positions lattice:{bits} --pages {pages} --cluster-triangles 256");
            folder.stdout(&format!("build {source} -o out.chpm -qf {how}"));
            let told = folder.stdout(&format!("verify out.chpm --against {source} --errors --cuts 3 -q"));
            assert!(!told.contains("fault"), "{told}");
            let file = open(&folder, "out.chpm");
            assert!(is_on_lattice(&file), "{how}");
            let leaves = file.clusters().iter().filter(|cluster| cluster.is_leaf());
            let least = leaves.map(|leaf| f64::from(leaf.min_error)).fold(0.0, f64::max);
            // Some coordinate is about half a step off, and none more.
            let most = step(&file) * 3f64.sqrt() / 2.0;
            assert!((0.9 * most..1.001 * most).contains(&least), "{least} of {most}");
            let info = folder.stdout("info out.chpm --settings");
            assert!(info.contains(&format!("positions lattice:{bits}")), "{info}");
            lens.push(file.bytes().len());
        }
        folder.stdout(&format!("build {source} -o exact.chpm -qf --pages packed --cluster-triangles 256"));
        let exact = folder.read("exact.chpm").len();
        assert!(lens[1] < lens[2] && 5 * lens[2] < 4 * exact, "{lens:?} {exact}");
    }
    // Another source than that of the file is told from it.
    let mut moved = mesh.clone();
    moved.positions[7][0] += 0.25;
    folder.write_mesh("moved.ply", &moved);
    folder.stdout("build near.ply -o out.chpm -qf --positions lattice:12");
    let said = folder.chpm("verify out.chpm --against moved.ply -q").code(1).get_output().stdout.clone();
    let said = String::from_utf8_lossy(&said);
    assert!(said.contains("I1 coverage"), "{said}");
}

#[test]
fn settings_of_batch_and_words_that_are_no_lattice() {
    let folder = Folder::new();
    let torus = Synth::new(Shape::Torus, 500, 0).to_mesh();
    std::fs::create_dir(folder.path("in")).expect("a folder");
    folder.write_mesh("in/a.ply", &torus);
    folder.write_mesh("in.ply", &torus);
    folder.stdout("batch in -o built -q --positions lattice:10");
    assert!(is_on_lattice(&open(&folder, "built/a.chpm")));
    let said = folder.stderr("build in.ply -o out.chpm -q --positions lattice:7", 2);
    assert!(said.contains("lattice:BITS with BITS from 8 to 24"), "{said}");
    let default = folder.stdout("build in.ply -o out.chpm -qf");
    let exact = folder.stdout("build in.ply -o same.chpm -qf --positions exact");
    assert!(folder.read("out.chpm") == folder.read("same.chpm"), "{default} {exact}");
}

#[test]
fn a_step_by_the_models_detail_shows_neither_threads_nor_memory_nor_pipes() {
    let folder = Folder::new();
    let mesh = Synth::new(Shape::Isosurface, 20_000, 1).to_mesh();
    folder.write_mesh("near.ply", &mesh);
    folder.write("far.obj", far_away(&mesh));
    for (source, pipe) in [("near.ply", true), ("far.obj", false)] {
        let sized = "--pages packed --cluster-triangles 512 -f";
        let how = &format!("--positions lattice:auto {sized}");
        let told = folder.stdout(&format!("build {source} -o out.chpm {how} --threads 1"));
        let bytes = folder.read("out.chpm");
        for more in ["--threads 2", "--threads 2 --memory 128M", "--threads 1 --memory 4G"] {
            folder.stdout(&format!("build {source} -o same.chpm -q {how} {more}"));
            assert!(folder.read("same.chpm") == bytes, "{more}");
        }
        let file = open(&folder, "out.chpm");
        let step = step(&file);
        assert!(is_on_lattice(&file));
        assert!(told.contains(&format!("coordinates are multiples of {step}, ")), "{told}");
        let settings = folder.stdout("info out.chpm --settings");
        assert!(settings.contains("positions lattice:auto"), "{settings}");
        let json = folder.stdout(&format!("build {source} -o same.chpm -q {how} --json"));
        let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        assert_eq!(json["lattice_step"].as_f64(), Some(step));
        let told = folder.stdout(&format!("verify out.chpm --against {source} --errors --cuts 3 -q"));
        assert!(!told.contains("fault"), "{told}");

        // The same as by so many bits, but for what the file says of itself; and every vertex is near where it was.
        let bounds = file.header().aabb();
        let side = (0..3).map(|axis| bounds.max[axis] - bounds.min[axis]).fold(0.0, f32::max);
        let bits = (f64::from(side) / step).log2().ceil();
        folder.stdout(&format!("build {source} -o bits.chpm -q {sized} --positions lattice:{bits}"));
        let same = folder.stdout("verify bits.chpm --same-as out.chpm -q");
        assert!(!same.contains("fault"), "{same}");
        let least = file.clusters().iter().filter(|c| c.is_leaf()).map(|leaf| f64::from(leaf.min_error));
        let (least, most) = (least.fold(0.0, f64::max), step * 3f64.sqrt() / 2.0);
        assert!((0.8 * most..1.001 * most).contains(&least), "{least} of {most}");

        if pipe {
            let out = shell(&folder, &format!("cat {source} | chpm build - -o piped.chpm -q {how}"));
            assert!(out.status.success(), "{out:?}");
            let piped = open(&folder, "piped.chpm");
            assert_eq!(self::step(&piped), step);
        }
    }
}

#[test]
fn a_flat_model_stays_exact_and_a_shared_mesh_has_a_lattice() {
    let folder = Folder::new();
    folder.write_mesh("flat.ply", &hand::grid(40, 40));
    let told = folder.stdout("build flat.ply -o flat.chpm --positions lattice:auto");
    assert!(told.contains("coordinates are exact"), "{told}");
    assert_eq!(
        open(&folder, "flat.chpm").metadata().expect("metadata").lattice_step().expect("a step"),
        None
    );

    if cfg!(feature = "web") {
        let mesh = Synth::new(Shape::Isosurface, 20_000, 1).to_mesh();
        folder.write_mesh("in.ply", &mesh);
        folder.stdout("share in.ply -o shared -q");
        folder.stdout("share in.ply -o exact -q --positions exact");
        let (shared, exact) = (open(&folder, "shared/model.chpm"), open(&folder, "exact/model.chpm"));
        assert!(is_on_lattice(&shared));
        assert_eq!(exact.metadata().expect("metadata").lattice_step().expect("a step"), None);
        assert!(4 * shared.bytes().len() < 3 * exact.bytes().len());
        let said = folder.stderr("share exact/model.chpm -o again -q --positions lattice:auto", 2);
        assert!(said.contains("keeps its positions"), "{said}");
    }
}

#[test]
fn a_textured_model_has_a_step_and_bounds_that_hold() {
    let folder = textured();
    folder.stdout("build a.obj -o out.chpm -qf --positions lattice:auto --cluster-triangles 256");
    let file = open(&folder, "out.chpm");
    assert!(is_on_lattice(&file));
    let told = folder.stdout("verify out.chpm --against a.obj --errors -q");
    assert!(!told.contains("fault"), "{told}");
}
