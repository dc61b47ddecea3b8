use super::harness::{Folder, skipped};
use std::path::PathBuf;
use std::process::Command;

/// An example that was compiled with these tests; none if only this package's tests were.
fn example(name: &str) -> Option<PathBuf> {
    let tests = std::env::current_exe().expect("a path");
    let path = tests.ancestors().nth(2)?.join("examples").join(name);
    if !path.exists() {
        skipped(format_args!("examples: {} is compiled by `cargo test --workspace`", path.display()));
    }
    path.exists().then_some(path)
}

fn told(mut command: Command) -> String {
    let output = command.output().expect("it runs");
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn a_patch_is_simplified() {
    let Some(example) = example("simplify_patch") else { return };
    let mut command = Command::new(example);
    command.arg("2000");
    let text = told(command);
    assert!(text.starts_with("2000 of 8192 triangles are left"), "{text}");
}

#[test]
fn a_mesh_is_built_and_selected_from() {
    let Some(example) = example("build_and_select") else { return };
    let folder = Folder::new();
    folder.chpm("synth sphere --triangles 20000 -o scan.ply").success();
    let mut command = Command::new(example);
    command.arg(folder.path("scan.ply"));

    let text = told(command);
    let (triangles, distance) = text.trim().split_once(" triangles, within ").expect("both numbers");
    assert!(triangles.parse::<usize>().expect("a number") < 20_000, "{text}");
    assert!(distance.parse::<f64>().expect("a number") <= 0.1, "{text}");
}

#[test]
fn the_smallest_file_is_one() {
    let Some(example) = example("smallest_file") else { return };
    let folder = Folder::new();
    let mut command = Command::new(example);
    command.arg(folder.path("smallest.chpm"));
    assert!(told(command).contains("within 0.5: 3 vertices"));
    folder.chpm("verify smallest.chpm").success();
}

#[test]
fn a_view_is_drawn_with_few_pages() {
    let Some(example) = example("draw_a_view") else { return };
    let folder = Folder::new();
    folder.chpm("synth isosurface --triangles 60000 -o in.ply").success();
    folder.chpm("build in.ply").success();
    let frames = |mib: &str| {
        let mut command = Command::new(&example);
        command.arg(folder.path("in.chpm")).args(["0.5", mib]);
        told(command)
    };
    let triangles = |text: &str| -> Vec<usize> {
        let number = |line: &str| line.split(' ').nth(4)?.parse().ok();
        text.lines().filter_map(number).collect()
    };
    let (much, little) = (triangles(&frames("64")), triangles(&frames("1")));
    assert_eq!((much.len(), little.len()), (8, 8));
    assert!(
        much.iter().zip(&little).all(|(much, little)| much >= little && *little > 0),
        "{much:?} {little:?}"
    );
    assert!(much.iter().sum::<usize>() > little.iter().sum::<usize>(), "{much:?} {little:?}");
}
