//! Pictures as they were: small PNGs in data/golden.
//!
//! A picture may differ from its golden one where an edge or a rounding fell otherwise: at most one pixel in 200 by more than 12 of 255, and
//! the mean of all differences is at most 0.5. To draw them anew, after having looked at what has changed:
//! `CHPM_GOLDEN=write cargo test -p chpm-viewer --test pictures golden`.

use crate::models::{self, Model};
use crate::screen::{PLENTY, exact, open};
use chpm_mesh::TriMesh;
use chpm_refine::Camera;
use chpm_synth::{Shape, Synth, hand};
use chpm_viewer::{Coloring, FrameRequest, Image, Look, Shading, headless};
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

const VIEWPORT: [u32; 2] = [160, 120];
/// A difference that is seen, of 255.
const SEEN: u8 = 12;
/// One pixel in so many may differ by more.
const ONE_IN: usize = 200;
/// The mean of all differences may be so large.
const MEAN: f64 = 0.5;

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/golden").join(format!("{name}.png"))
}

fn read(path: &Path) -> Image {
    let file = File::open(path).unwrap_or_else(|error| {
        panic!("{}: {error}; draw it with CHPM_GOLDEN=write, look at it, and keep it", path.display())
    });
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a small PNG")];
    let info = reader.next_frame(&mut pixels).expect("a PNG");
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgba, png::BitDepth::Eight));
    Image { size: [info.width, info.height], pixels }
}

/// How many pixels differ visibly, and the mean difference of a channel.
fn difference(a: &Image, b: &Image) -> (usize, f64) {
    assert_eq!(a.size, b.size);
    let channels = || a.pixels.iter().zip(&b.pixels).map(|(a, b)| a.abs_diff(*b));
    let differences: Vec<u8> = channels().collect();
    let visible = differences.chunks_exact(4).filter(|pixel| pixel.iter().any(|d| *d > SEEN)).count();
    let sum: f64 = differences.iter().map(|d| f64::from(*d)).sum();
    (visible, sum / differences.len() as f64)
}

fn compare(name: &str, image: &Image) {
    let path = path(name);
    if std::env::var_os("CHPM_GOLDEN").is_some_and(|what| what == "write") {
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder made");
        image.write_png(File::create(&path).expect("a file created")).expect("a PNG written");
        return;
    }
    let (visible, mean) = difference(image, &read(&path));
    if visible * ONE_IN > image.pixels.len() / 4 || mean > MEAN {
        let is = std::env::temp_dir().join(format!("chpm-{name}.png"));
        image.write_png(File::create(&is).expect("a file created")).expect("a PNG written");
        panic!(
            "{name}: {visible} pixels differ visibly, {mean:.2} of 255 in the mean; it is now as in {}",
            is.display()
        );
    }
}

fn draw(name: &str, model: &Model, camera: Camera, look: Look, poe: f64) {
    let mut viewer = open(model, PLENTY);
    let request = FrameRequest { look, ..exact(camera, VIEWPORT, poe) };
    let (image, _) = headless::image(&mut viewer, &request).expect("a picture");
    compare(name, &image);
}

/// Flat, so that a picture of colours is one of nothing else.
fn look(colors: Coloring) -> Look {
    Look { colors, shading: Shading::Flat, ..Look::default() }
}

/// A torus whose colours say where each vertex is, with the normals of the surface.
fn colored() -> Model {
    let mut mesh = Synth::new(Shape::Torus, 4000, 1).to_mesh();
    let color = |p: &[f32; 3]| [p[0], p[1], p[2]].map(|x| (127.5 + 90.0 * x) as u8);
    mesh.colors = mesh.positions.iter().map(color).map(|[r, g, b]| [r, g, b, 255]).collect();
    Model::of(&mesh, 256)
}

#[test]
fn flat_and_smooth() {
    let model = Model::synth(Shape::Isosurface, 8000, 256);
    let camera = Camera::looking([0.5, 0.6, 1.0], [0.11, 0.11, 0.5]);
    draw("flat", &model, camera, look(Coloring::Plain), 1.0);
    draw("smooth", &model, camera, Look { shading: Shading::Smooth, ..look(Coloring::Plain) }, 1.0);
}

/// The light of a studio: darker in corners and on the ground below.
#[test]
fn studio() {
    let model = colored();
    let camera = Camera::looking([1.5, 1.9, 2.4], [0.0; 3]);
    let studio =
        Look { shading: Shading::Smooth, studio: true, background: [0.9; 3], ..look(Coloring::Vertex) };
    draw("studio", &model, camera, studio, 1.0);
    draw(
        "studio-plain",
        &Model::of(&hand::cube(), 128),
        Camera::looking([2.4, 1.9, 3.0], [0.5; 3]),
        Look { colors: Coloring::Plain, shading: Shading::Flat, ..studio },
        1.0,
    );
}

#[test]
fn colours() {
    let model = colored();
    let camera = Camera::looking([1.5, 2.5, 2.0], [0.0; 3]);
    for (name, colors) in [
        ("colors", Coloring::Vertex),
        ("cluster", Coloring::Cluster),
        ("level", Coloring::Level),
        ("error", Coloring::Error),
        ("group", Coloring::Group),
    ] {
        draw(name, &model, camera, look(colors), 1.2);
    }
}

/// Lit from both sides, smooth shading has no dark dots: no pixel of a torus is half as bright as the torus on all four sides of it.
#[test]
fn no_dots_along_silhouettes() {
    let model = colored();
    let mut viewer = open(&model, PLENTY);
    let look = Look { shading: Shading::Smooth, background: [1.0; 3], ..look(Coloring::Plain) };
    for position in [[1.5, 2.5, 2.0], [3.0, 0.4, 1.0], [0.2, 0.9, 3.0], [-2.5, 0.7, 1.5]] {
        let camera = Camera::looking(position, [0.0; 3]);
        let request = FrameRequest { look, ..exact(camera, [320, 240], 1.0) };
        let (image, _) = headless::image(&mut viewer, &request).expect("a picture");
        let value = |x: u32, y: u32| u32::from(image.pixel(x, y)[1]);
        let is_dot = |(x, y): &(u32, u32)| {
            let beside = [value(x - 1, *y), value(x + 1, *y), value(*x, y - 1), value(*x, y + 1)];
            beside.iter().all(|beside| *beside < 255 && 2 * value(*x, *y) < *beside)
        };
        let dots: Vec<_> = (1..319).flat_map(|x| (1..239).map(move |y| (x, y))).filter(is_dot).collect();
        assert!(dots.is_empty(), "{position:?}: {dots:?}");
    }
}

#[test]
fn wires() {
    let cube = Model::of(&hand::cube(), 128);
    let camera = Camera::looking([2.4, 1.9, 3.0], [0.5; 3]);
    draw("wires", &cube, camera, Look { wireframe: true, ..look(Coloring::Plain) }, 1.0);
}

/// A landscape from close by, up to its horizon.
#[test]
fn a_landscape_to_its_horizon() {
    let camera = Camera::looking([0.5, 0.05, 0.1], [0.5, 1.0, 0.0]);
    let camera = Camera { up: [0.0, 0.0, 1.0], ..camera };
    draw("terrain", &models::terrain(), camera, look(Coloring::Plain), 1.0);
}

/// Far from the zero point, a picture is as sharp as anywhere.
#[test]
fn the_same_picture_far_away() {
    let mesh: TriMesh = Synth::new(Shape::Isosurface, 6000, 2).to_mesh();
    let offset = [1e6, -4e6, 3e5];
    let (here, there) = (Model::of(&mesh, 256), Model::far(&mesh, offset, 256));
    let picture = |model: &Model| {
        let mut viewer = open(model, PLENTY);
        // A crease may be one here and none there, where rounding moves a face past the angle.
        let request = FrameRequest { look: look(Coloring::Plain), ..exact(viewer.framing(), VIEWPORT, 0.0) };
        headless::image(&mut viewer, &request).expect("a picture").0
    };
    let (visible, mean) = difference(&picture(&here), &picture(&there));
    // Doubles near 4e6 round the model's vertices by 2e-10 of a pixel or so; the file's origin rounds them to single precision anew.
    assert!(visible * ONE_IN <= 160 * 120 && mean <= MEAN, "{visible} pixels differ, {mean} in the mean");
}

/// Singles hold coordinates whose squares they do not: a model of any size is lit as any other.
#[test]
fn the_same_picture_at_any_size() {
    let mesh: TriMesh = Synth::new(Shape::Isosurface, 3000, 2).to_mesh();
    for studio in [false, true] {
        let picture = |scale: f32| {
            let mut scaled = mesh.clone();
            scaled.positions.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
            let mut viewer = open(&Model::of(&scaled, 256), PLENTY);
            let look = Look { studio, ..Look::default() };
            let request = FrameRequest { look, ..exact(viewer.framing(), VIEWPORT, 0.0) };
            headless::image(&mut viewer, &request).expect("a picture").0
        };
        let usual = picture(1.0);
        // By powers of two, so that nothing is rounded otherwise: 9e-13, 1e12 and, without the depths that a studio compares, 1e30.
        for power in [-40, 40, 100].into_iter().filter(|power| !studio || *power < 100) {
            let (visible, mean) = difference(&usual, &picture(2_f32.powi(power)));
            assert!(
                visible * ONE_IN <= 160 * 120 && mean <= MEAN,
                "2^{power}: {visible} pixels differ, {mean} in the mean"
            );
        }
    }
}

#[test]
fn a_difference_is_found() {
    let black = Image { size: [20, 20], pixels: vec![0; 1600] };
    let mut other = black.clone();
    other.pixels[4 * 7 + 1] = SEEN;
    assert_eq!(difference(&black, &other), (0, f64::from(SEEN) / 1600.0));
    other.pixels[4 * 7 + 2] = SEEN + 1;
    assert_eq!(difference(&black, &other).0, 1);
}
