//! Two models in a window: where they are nearest is marked where `chpm distance` says.

use super::harness::Folder;
use super::window::{Display, finish};
use chpm_refine::{Camera, CameraPath};
use serde_json::Value;
use std::fs;

const SIZE: [f64; 2] = [800.0, 600.0];

/// Where a camera that looks along -z has a point, and pixels of a unit there.
fn seen(camera: &Camera, point: &Value) -> [f64; 2] {
    let at = |axis: usize| point[axis].as_f64().expect("a number") - camera.position[axis];
    let scale = 0.5 * SIZE[1] / (0.5 * camera.fov.to_radians()).tan() / -at(2);
    [0.5 * SIZE[0] + scale * at(0), 0.5 * SIZE[1] - scale * at(1)]
}

#[test]
fn the_shortest_segment_is_where_the_distance_says() {
    let Some(display) = Display::open() else { return };
    let folder = Folder::new();
    // Few, since all pairs of triangles are regions that are near.
    folder.stdout("synth sphere --triangles 1200 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 64");
    folder.stdout("synth torus --triangles 900 -o other.ply -q");
    folder.stdout("build other.ply -q --pages packed --cluster-triangles 64");
    // Above the middle, where neither panel is.
    let at = [1.5, -3.0, 12.0];
    let camera = Camera::looking(at, [at[0], at[1], 0.0]);
    let path = CameraPath { cameras: vec![camera; 3] };
    fs::write(folder.path("still.path"), path.to_string()).expect("a file");
    fs::write(folder.path("motion.txt"), "3,0,0\n3,0,1\n").expect("a file");
    for how in ["--pose 3,0,0", "--motion motion.txt"] {
        let words = format!("view in.chpm other.chpm {how} --path still.path --within 100% --error 1%");
        let child = display.spawn(&folder, &words);
        display.window("in.chpm");
        let window = display.hand("search --onlyvisible --name in.chpm");
        display.hand(&format!("windowsize --sync {window} 800 600"));
        let asked = "distance in.chpm other.chpm --pose 3,0,0 --error 1% --json";
        let told: Value = serde_json::from_str(&folder.stdout(asked)).expect("JSON");
        let ends = [0, 1].map(|end| seen(&camera, &told["answers"][0]["points"][end]));
        // A red ring about each end, a line between them, and the boxes of regions.
        let is_red = |[red, green, blue]: [u8; 3]| red > 180 && green < 140 && blue < 140;
        let is_mark = |[red, green, blue]: [u8; 3]| red > 200 && green > 150 && blue < 130;
        let near = |pixels: &[[u8; 3]], [x, y]: [f64; 2]| {
            let around = (0..13).flat_map(|row| (0..13).map(move |column| [column, row]));
            let place = |[column, row]: [usize; 2]| (y as usize + row - 6) * 800 + x as usize + column - 6;
            around.filter(|offset| is_red(pixels[place(*offset)])).count()
        };
        display.wait_until(&|| {
            let pixels = display.dump();
            let marked = pixels.iter().filter(|pixel| is_mark(**pixel)).count();
            ends.iter().all(|end| near(&pixels, *end) > 8) && marked > 100
        });
        display.hand("key ctrl+q");
        finish(child);
        assert!(!folder.path("state").exists(), "nothing is remembered of two");
    }
}

#[test]
fn what_cannot_be_shown_together_is_told_before_a_window_opens() {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 400 -o in.ply -q");
    folder.stdout("build in.ply -q");
    for (words, told) in [
        ("view in.chpm in.chpm --pose 2,0,0,1,0,2,0,0,0,0,2,0", "changes lengths"),
        ("view in.chpm --pose 1,0,0", "second"),
        ("view in.chpm none.chpm", "none.chpm"),
        ("view in.chpm in.chpm --motion none.txt", "none.txt"),
        ("view in.chpm in.chpm --motion in.ply", "in.ply"),
        ("view in.chpm in.chpm --memory 1M", "--memory"),
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.to_lowercase().contains(told), "{words}: {error}");
    }
}
