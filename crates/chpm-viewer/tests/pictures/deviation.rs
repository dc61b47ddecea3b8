//! How far a picture is from that of the full model: silhouettes move by no more than the pixels of error.

use crate::models::{self, Model};
use crate::raster::Raster;
use crate::screen::{PLENTY, exact, ids, open};
use chpm_mesh::Level;
use chpm_refine::{Camera, Cut};
use chpm_synth::Shape;

const VIEWPORT: [u32; 2] = [200, 150];

/// The pixels that show something.
type Mask = Vec<bool>;

/// The largest distance from a pixel of one mask to the nearest of the other, pixels; none if the other shows nothing and the one does.
fn farthest(from: &Mask, to: &Mask) -> f64 {
    let [width, height] = VIEWPORT.map(|side| side as i32);
    let is_set =
        |x: i32, y: i32| (0..width).contains(&x) && (0..height).contains(&y) && to[(y * width + x) as usize];
    let nearest = |x: i32, y: i32| {
        // Squares of growing size: when one holds a pixel, those up to its diagonal are to be looked at.
        let mut best = f64::INFINITY;
        for reach in 0..width.max(height) {
            if f64::from(reach) > best {
                break;
            }
            for along in -reach..=reach {
                for (dx, dy) in [(along, reach), (along, -reach), (reach, along), (-reach, along)] {
                    if is_set(x + dx, y + dy) {
                        best = best.min(f64::from(dx).hypot(f64::from(dy)));
                    }
                }
            }
        }
        best
    };
    let pixels = (0..width * height).filter(|place| from[*place as usize]);
    pixels.map(|place| nearest(place % width, place / width)).fold(0.0, f64::max)
}

/// A pixel of error is the angle of one in the middle; this is how much longer it is in a corner.
fn stretch(camera: &Camera) -> f64 {
    let rise = (0.5 * camera.fov.to_radians()).tan();
    let run = rise * f64::from(VIEWPORT[0]) / f64::from(VIEWPORT[1]);
    1.0 + rise * rise + run * run
}

/// Silhouettes from all sides, at several accuracies, both ways. A pixel more is allowed, since samples are a pixel apart.
fn silhouettes(model: &Model) {
    let file = model.open();
    let full = Cut::at_level(&file, Level(0));
    let mut viewer = open(model, PLENTY);
    for camera in models::cameras(&file, 6).into_iter().take(6) {
        // From so far away that all of it is in the image: what is seen through its edge could be outside.
        let position = [0, 1, 2].map(|a| camera.target[a] + 1.1 * (camera.position[a] - camera.target[a]));
        let camera = Camera { position, ..camera };
        let raster = Raster::of_cut(&file, &full, &camera, VIEWPORT, 0.0).expect("a picture");
        let reference: Mask = raster.ids().pixels.iter().map(Option::is_some).collect();
        assert!(reference.iter().filter(|seen| **seen).count() > 50, "it is seen");
        for poe in [0.0, 1.0, 3.0, 8.0] {
            let (got, _) = ids(&mut viewer, &exact(camera, VIEWPORT, poe));
            let got: Mask = got.pixels.iter().map(Option::is_some).collect();
            let distance = farthest(&got, &reference).max(farthest(&reference, &got));
            assert!(
                distance <= poe * stretch(&camera) + 1.0,
                "{distance} pixels at {poe} of error; {camera:?}"
            );
        }
    }
}

#[test]
fn of_a_sphere() {
    silhouettes(&Model::synth(Shape::Sphere, 12_000, 128));
}

#[test]
fn of_a_torus() {
    silhouettes(&Model::synth(Shape::Torus, 12_000, 128));
}

/// Sharp edges and holes, and parts that are thin: some of them thinner than the error.
#[test]
fn of_drilled_plates() {
    silhouettes(&Model::synth(Shape::Plates, 12_000, 128));
}

#[test]
fn of_an_open_surface() {
    silhouettes(&models::terrain());
}

/// A coarser mesh is asked for and comes: or else the test above would say nothing.
#[test]
fn error_saves_triangles() {
    let model = Model::synth(Shape::Sphere, 12_000, 128);
    let mut viewer = open(&model, PLENTY);
    let camera = viewer.framing();
    let triangles =
        [0.0, 1.0, 3.0, 8.0].map(|poe| ids(&mut viewer, &exact(camera, VIEWPORT, poe)).1.triangles);
    assert!(triangles.windows(2).all(|pair| pair[1] < pair[0]), "{triangles:?}");
}

#[test]
fn masks_are_as_far_apart_as_they_are() {
    let mask = |set: &[(usize, usize)]| {
        let mut mask = vec![false; 200 * 150];
        set.iter().for_each(|(x, y)| mask[y * 200 + x] = true);
        mask
    };
    let (one, two) = (mask(&[(10, 10)]), mask(&[(13, 14), (10, 16)]));
    assert_eq!(farthest(&one, &two), 5.0);
    assert_eq!(farthest(&two, &one), 6.0);
    assert_eq!(farthest(&one, &one), 0.0);
    assert_eq!(farthest(&one, &mask(&[])), f64::INFINITY);
    assert_eq!(farthest(&mask(&[]), &one), 0.0);
}
