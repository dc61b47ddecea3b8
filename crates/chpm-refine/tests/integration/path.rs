use chpm_mesh::Aabb;
use chpm_refine::{Camera, CameraPath, RefineError, View};
use proptest::prelude::*;

const BOX: Aabb = Aabb { min: [1.0, 2.0, 3.0], max: [5.0, 4.0, 6.0] };

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn comments_and_blanks_are_skipped() {
    let text = "\n# made by hand\n chpm-path  1 # version\n1 2 3 4 5 6 0 1 0 45\n\n\t1 2 3 4 5 7 0 0 1 30 # last\r\n";
    let path: CameraPath = text.parse().unwrap();
    let first = Camera::looking([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]);
    let last = Camera { up: [0.0, 0.0, 1.0], fov: 30.0, target: [4.0, 5.0, 7.0], ..first };
    assert_eq!(path.cameras, [first, last]);
}

#[test]
fn errors_name_the_line() {
    for (text, wrong) in [
        ("", 1),
        ("chpm-path 2\n", 1),
        ("# hello\n1 2 3 4 5 6 0 1 0 45\n", 2),
        ("chpm-path 1\n1 2 3 4 5 6 0 1 0\n", 2),
        ("chpm-path 1\n1 2 3 4 5 6 0 1 0 45\n1 2 3 4 5 6 0 1 0 45 6\n", 3),
        ("chpm-path 1\n\n1 2 3 4 5 six 0 1 0 45\n", 3),
    ] {
        match text.parse::<CameraPath>() {
            Err(RefineError::Path { line, .. }) => assert_eq!(line, wrong, "{text}"),
            other => panic!("{text}: {other:?}"),
        }
    }
}

#[test]
fn paths_have_their_frames_and_every_frame_is_a_view() {
    for frames in [1, 2, 29, 30, 31, 100] {
        let paths = [
            CameraPath::orbit(&BOX, frames),
            CameraPath::dive(&BOX, [2.0, 3.0, 6.0], frames),
            CameraPath::random(&BOX, 7, frames),
        ];
        for path in paths {
            assert_eq!(path.cameras.len(), frames);
            for camera in &path.cameras {
                View::new(camera, [64, 64], 1.0).unwrap();
            }
            assert_eq!(path.to_string().parse::<CameraPath>().unwrap(), path);
        }
    }
}

#[test]
fn an_orbit_keeps_its_distance_and_sees_all() {
    let path = CameraPath::orbit(&BOX, 36);
    assert_eq!(path.cameras[0], Camera::framing(&BOX));
    let away = |camera: &Camera| distance(camera.position, camera.target);
    for camera in &path.cameras {
        assert!((away(camera) - away(&path.cameras[0])).abs() < 1e-9);
        assert!(!View::new(camera, [64, 64], 1.0).unwrap().misses_box(&BOX));
    }
    let step = distance(path.cameras[0].position, path.cameras[1].position);
    let last = distance(path.cameras[35].position, path.cameras[0].position);
    assert!((step - last).abs() < 1e-9, "it closes");
}

#[test]
fn a_dive_comes_nearer_and_nearer() {
    let point = [2.0, 3.0, 6.0];
    let path = CameraPath::dive(&BOX, point, 50);
    let away: Vec<f64> = path.cameras.iter().map(|camera| distance(camera.position, point)).collect();
    assert!(away.is_sorted_by(|a, b| a > b));
    assert!((away[0] / away[49] - 500.0).abs() < 1e-6);
    assert!(distance(path.cameras[49].target, point) < 1e-9);
    // It turns to the point in the first third of the way.
    let aside: Vec<f64> = path.cameras.iter().map(|camera| distance(camera.target, point)).collect();
    assert!(aside[..17].is_sorted_by(|a, b| a > b) && aside[17..].iter().all(|aside| *aside < 1e-9));
}

#[test]
fn a_seed_is_a_path() {
    let path = |seed| CameraPath::random(&BOX, seed, 100);
    assert_eq!(path(3), path(3));
    assert_ne!(path(3), path(4));
    // No jumps: a leg of 30 frames is at most twice as long as the reach, and smooth.
    let cameras = path(3).cameras;
    let reach = 0.5 * BOX.diagonal();
    assert!(cameras.windows(2).all(|two| distance(two[0].position, two[1].position) < 0.7 * reach));
}

proptest! {
    #[test]
    fn text_keeps_every_bit(
        numbers in prop::collection::vec((prop::array::uniform9(prop::num::f64::NORMAL), 1.0..179.0), 0..5),
    ) {
        let camera = |(n, fov): &([f64; 9], f64)| Camera {
            position: [n[0], n[1], n[2]],
            target: [n[3], n[4], n[5]],
            up: [n[6], n[7], n[8]],
            fov: *fov,
            near: 0.0,
        };
        let path = CameraPath { cameras: numbers.iter().map(camera).collect() };
        prop_assert_eq!(path.to_string().parse::<CameraPath>().unwrap(), path);
    }
}
