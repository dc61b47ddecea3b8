//! The same pictures from the processor: triangle by triangle, in double precision.

use crate::models::{self, Model};
use crate::raster::Raster;
use crate::screen::{PLENTY, exact, ids, open};
use chpm_format::Chpm;
use chpm_mesh::ClusterId;
use chpm_refine::{Camera, Cut, Hierarchy, View, extract, select};
use chpm_viewer::{FrameRequest, TriangleId};

const VIEWPORT: [u32; 2] = [160, 120];
/// Where pictures begin for a camera without a near plane, relative to the model's diagonal.
const NEAR: f64 = 1e-6;

fn cut<D: AsRef<[u8]>>(file: &Chpm<D>, camera: &Camera, poe: f64) -> Cut {
    let view = View::new(&camera.relative_to(file.header().origin), VIEWPORT, poe).expect("a view");
    select(file, &Hierarchy::new(file), &view).expect("a cut")
}

/// Pixels of a path: all, those where rounding could decide, and those of them where it did.
#[derive(Default, Debug)]
struct Pixels {
    all: usize,
    uncertain: usize,
    different: usize,
}

/// Wherever rounding cannot decide, the picture is the reference, to the triangle.
fn agrees(model: &Model, each: usize, poe: f64) -> Pixels {
    let file = model.open();
    let mut viewer = open(model, PLENTY);
    let near = NEAR * file.header().aabb().diagonal();
    let mut pixels = Pixels::default();
    for (frame, camera) in models::cameras(&file, each).into_iter().enumerate() {
        let request: FrameRequest = exact(camera, VIEWPORT, poe).without_culling();
        let (got, _) = ids(&mut viewer, &request);
        let raster =
            Raster::of_cut(&file, &cut(&file, &camera, poe), &camera, VIEWPORT, near).expect("a picture");
        let expected = raster.ids();
        for place in 0..got.pixels.len() {
            let (got, expected) = (got.pixels[place], expected.pixels[place]);
            let [x, y] = [place % 160, place / 160];
            assert!(
                got == expected || !raster.is_certain(place),
                "frame {frame}, pixel {x}, {y}: {got:?}, expected {expected:?}; {camera:?}"
            );
            pixels.uncertain += usize::from(!raster.is_certain(place));
            pixels.different += usize::from(got != expected);
        }
        pixels.all += got.pixels.len();
    }
    println!("{pixels:?}");
    pixels
}

/// Few pixels are uncertain: the comparison is about something.
fn mostly_certain(pixels: &Pixels) {
    assert!(100 * pixels.uncertain < pixels.all, "{pixels:?}");
}

#[test]
fn nested_shells() {
    mostly_certain(&agrees(&models::shells(), 5, 1.0));
}

#[test]
fn an_open_surface() {
    mostly_certain(&agrees(&models::terrain(), 5, 1.0));
}

#[test]
fn a_surface_of_many_parts() {
    mostly_certain(&agrees(&models::isosurface(), 5, 1.0));
}

#[test]
fn far_from_the_zero_point() {
    mostly_certain(&agrees(&models::far_away(), 5, 1.0));
}

#[test]
fn a_single_triangle() {
    mostly_certain(&agrees(&models::triangle(), 5, 1.0));
}

/// The rasteriser finds its triangles in pages; the same mesh, welded by the extraction, gives the same picture.
#[test]
fn a_cut_is_its_extracted_mesh() {
    let model = models::isosurface();
    let file = model.open();
    for camera in models::cameras(&file, 2) {
        let cut = cut(&file, &camera, 2.0);
        let mesh = extract(&file, &cut).expect("a mesh");
        let mut welded = Raster::new(&camera, VIEWPORT, 0.0).expect("a raster");
        for (triangle, corners) in (0..).zip(&mesh.triangles) {
            let id = TriangleId { model: 0, cluster: ClusterId(0), triangle };
            welded.draw(id, mesh.corners(*corners).map(|corner| corner.map(f64::from)));
        }
        let raster = Raster::of_cut(&file, &cut, &camera, VIEWPORT, 0.0).expect("a raster");
        assert_eq!(raster.depths(), welded.depths());
    }
}
