//! How models stand and what is framed: stills and paths.

use super::harness::{Folder, text};
use super::render::{house, json, picture};
use chpm_synth::{Shape, Synth};

/// Hills over a square of a tenth of a degree, in metres.
fn terrain_in_degrees() -> String {
    let side = 30;
    let point = |n: usize| {
        let (x, y) = (n % side, n / side);
        let height = 900.0 + 400.0 * (0.5 * x as f64).sin() * (0.4 * y as f64).cos();
        format!("v {} {} {height}\n", 8.0 + 0.1 * x as f64 / side as f64, 46.0 + 0.1 * y as f64 / side as f64)
    };
    let squares = (0..side * (side - 1)).filter(|n| n % side + 1 < side).map(|n| n + 1);
    let halves =
        |n: usize| format!("f {n} {} {}\nf {} {} {}\n", n + 1, n + side, n + 1, n + side + 1, n + side);
    (0..side * side).map(point).chain(squares.map(halves)).collect()
}

#[test]
fn a_terrain_of_degrees_and_metres_is_seen_and_says_so() {
    let folder = Folder::new();
    folder.write("hills.obj", terrain_in_degrees());
    let output = folder.chpm("render hills.obj --viewport 120x90 -o hills.png -q --json").code(0);
    let output = output.get_output();
    let told = text(&output.stderr);
    assert!(told.contains("warning: heights divided by 111320") && told.contains("project"), "{told}");
    let stance = json(&text(&output.stdout))["stance"].to_string();
    assert!(stance.contains("up is z") || stance.contains("from"), "{stance}");
    let (_, _, pixels) = picture(&folder, "hills.png");
    // Above the words, hills from side to side.
    let drawn = pixels[..60 * 120].iter().filter(|pixel| **pixel != pixels[0]).count();
    assert!(drawn > 1500, "{drawn}");
    // Whoever tells a camera means the coordinates of the file.
    let words =
        "render hills.obj --camera 8.05,46.05,3000,8.05,46.05,900 --up y --viewport 64x64 -o line.png -q";
    let told = folder.chpm(words).code(0);
    assert!(!text(&told.get_output().stderr).contains("divided"));
}

#[test]
fn a_speck_far_away_does_not_move_the_frame() {
    let folder = Folder::new();
    folder.write_mesh("ball.ply", &Synth::new(Shape::Sphere, 2_000, 1).to_mesh());
    let mut mesh = Synth::new(Shape::Sphere, 2_000, 1).to_mesh();
    let first = mesh.positions.len() as u32;
    mesh.positions.extend([[90.0, 0.0, 0.0], [90.01, 0.0, 0.0], [90.0, 0.01, 0.0]]);
    mesh.triangles.push([first, first + 1, first + 2]);
    folder.write_mesh("specked.ply", &mesh);
    let covered = |name: &str| {
        let said = folder.stdout(&format!("render {name}.ply --viewport 80x60 -o {name}.png -q"));
        let (_, _, pixels) = picture(&folder, &format!("{name}.png"));
        (pixels.iter().filter(|pixel| **pixel != pixels[0]).count(), said)
    };
    let ((all, _), (specked, said)) = (covered("ball"), covered("specked"));
    assert!(all > 1000 && all.abs_diff(specked) < all / 20, "{all} {specked}");
    assert!(said.contains("specks far away"), "{said}");
}

#[test]
fn paths_go_around_what_is_up() {
    let folder = Folder::new();
    house(&folder, 2, 0.0);
    let cameras = |way: &str| -> Vec<Vec<f64>> {
        folder.stdout(&format!("path {way} house.chpm --frames 8 -o {way}.path"));
        let text = text(&folder.read(&format!("{way}.path")));
        let lines = text.lines().filter(|line| !line.starts_with(['c', '#']));
        lines.map(|line| line.split(' ').map(|n| n.parse().expect("a number")).collect()).collect()
    };
    for way in ["orbit", "dive", "random"] {
        let all = cameras(way);
        assert!(all.len() == 8 && all.iter().all(|camera| camera[6..9] == [0.0, 0.0, 1.0]), "{way}: {all:?}");
        // At one height, from one distance.
        let away = |c: &[f64]| (0..3).map(|axis| (c[axis] - c[3 + axis]).powi(2)).sum::<f64>().sqrt();
        let same = |c: &Vec<f64>| (c[2] - all[0][2]).abs() < 1e-9 && (away(c) - away(&all[0])).abs() < 1e-9;
        assert!(way != "orbit" || all.iter().all(same), "{all:?}");
    }
}
