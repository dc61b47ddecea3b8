//! Positions on a lattice: what is drawn is near the source, errors know how near, and nothing cracks.

use super::harness::Folder;
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, TriMesh};
use chpm_synth::{Shape, Synth};

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
