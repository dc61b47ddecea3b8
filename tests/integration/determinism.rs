//! The same bytes for any number of threads and any memory.

use super::harness::Folder;

fn model() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 15000 --seed 5 -o model.ply -q");
    folder
}

fn build(folder: &Folder, options: &str) -> Vec<u8> {
    folder.stdout(&format!("build model.ply -o out.chpm -qf --cluster-triangles 512 {options}"));
    folder.read("out.chpm")
}

#[test]
fn threads_and_memory_do_not_show() {
    let folder = model();
    for partitioner in ["metis", "greedy"] {
        let settings = format!("--partitioner {partitioner}");
        let one = build(&folder, &format!("{settings} --threads 1"));
        for resources in [
            "--threads 2",
            "--threads 3",
            "--memory 1M --any-memory",
            "--memory 16K --any-memory --threads 2",
            "--work-dir .",
        ] {
            let same = build(&folder, &format!("{settings} {resources}")) == one;
            assert!(same, "{partitioner} {resources}");
        }
    }
    assert_eq!(folder.names(), ["model.ply", "out.chpm"]);
}

#[test]
fn settings_do_show() {
    let folder = model();
    let one = build(&folder, "");
    for settings in ["--seed 4", "--partitioner greedy", "--no-layout"] {
        assert!(build(&folder, settings) != one, "{settings}");
    }
}
