//! Smooth pictures of a cut against those of the same mesh as one cluster, with the same normals and without any.

use crate::models::Model;
use crate::screen::{PLENTY, exact, ids, open};
use chpm_build::Settings;
use chpm_build::config::Normals;
use chpm_mesh::TriMesh;
use chpm_refine::{Camera, Cut, Hierarchy, View, extract, select};
use chpm_synth::{Shape, Synth, hand};
use chpm_viewer::{FrameRequest, IdImage, Look, Shading, headless};

const VIEWPORT: [u32; 2] = [320, 240];

fn model(mesh: &TriMesh, normals: Normals) -> Model {
    Model::built(mesh, [0.0; 3], Settings { cluster_triangles: 128, normals, ..Settings::default() })
}

fn request(camera: Camera, poe: f64, shading: Shading) -> FrameRequest {
    FrameRequest { look: Look { shading, ..Look::default() }, ..exact(camera, VIEWPORT, poe) }
}

/// The mesh that is drawn, as one cluster of its own.
fn as_one(model: &Model, camera: Camera, poe: f64) -> Model {
    let file = model.open();
    let view = View::new(&camera, VIEWPORT, poe).expect("a view");
    let cut: Cut = select(&file, &Hierarchy::new(&file), &view).expect("a cut");
    assert!(cut.members().len() > 4, "{} clusters", cut.members().len());
    let one = Model::of(&extract(&file, &cut).expect("a mesh"), 16_384);
    assert_eq!(one.open().header().leaf_count, 1);
    one
}

/// Whether a pixel has one beside it that shows another cluster.
fn is_border(ids: &IdImage, place: usize) -> bool {
    let [width, height] = ids.size.map(|size| size as usize);
    let (x, y) = (place % width, place / width);
    let cluster = |x: usize, y: usize| ids.pixels[y * width + x].map(|id| id.cluster);
    let beside = (y.saturating_sub(1)..height.min(y + 2))
        .flat_map(|y| (x.saturating_sub(1)..width.min(x + 2)).map(move |x| cluster(x, y)));
    beside.flatten().any(|other| Some(other) != cluster(x, y))
}

/// The largest differences between a smooth picture at one pixel of error and that of the same mesh in one piece, of 255: along borders of
/// clusters, and elsewhere; and how many pixels are at borders.
fn differences(drawn: &Model, as_one: &Model, camera: Camera) -> ([u8; 2], usize) {
    let (mut viewer, mut reference) = (open(drawn, PLENTY), open(as_one, PLENTY));
    let smooth = request(camera, 1.0, Shading::Smooth);
    let (picture, _) = headless::image(&mut viewer, &smooth).expect("a picture");
    let ids = ids(&mut viewer, &smooth).0;
    let (expected, _) =
        headless::image(&mut reference, &request(camera, 0.0, Shading::Smooth)).expect("a picture");
    let mut largest = [0; 2];
    let mut count = 0;
    for (place, (a, b)) in picture.pixels.chunks_exact(4).zip(expected.pixels.chunks_exact(4)).enumerate() {
        let elsewhere = usize::from(!is_border(&ids, place));
        count += 1 - elsewhere;
        let difference = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
        largest[elsewhere] = largest[elsewhere].max(difference.unwrap_or_default());
    }
    (largest, count)
}

#[test]
fn smooth_pictures_show_no_borders_of_clusters() {
    for (shape, position, target) in [
        (Shape::Isosurface, [0.5, 0.6, 1.0], [0.11, 0.11, 0.5]),
        (Shape::Terrain, [0.5, -0.4, 0.7], [0.5, 0.5, 0.0]),
        (Shape::Torus, [1.5, 2.5, 2.0], [0.0; 3]),
    ] {
        let mesh = Synth::new(shape, 16_000, 1).to_mesh();
        let camera = Camera::looking(position, target);
        let computed = model(&mesh, Normals::Computed);
        let reference = as_one(&computed, camera, 1.0);
        let ([border, elsewhere], count) = differences(&computed, &reference, camera);
        assert!(count > 500, "{shape}: {count} pixels along borders");
        // The last of 255 steps may be rounded either way.
        assert!(border <= elsewhere.max(1), "{shape}: {border} along borders, {elsewhere} elsewhere");
    }
}

/// Smoothness depends on the file alone: on nothing that was drawn or left out before.
#[test]
fn the_same_picture_whatever_was_drawn_before() {
    for (shape, seed) in [(Shape::Isosurface, 1), (Shape::Isosurface, 2), (Shape::Plates, 1)] {
        let model = model(&Synth::new(shape, 16_000, seed).to_mesh(), Normals::None);
        let (mut culled, mut all) = (open(&model, PLENTY), open(&model, PLENTY));
        let cameras = crate::models::cameras(&model.open(), 3);
        for (frame, camera) in cameras.iter().enumerate() {
            let other = request(cameras[(5 * frame + 1) % cameras.len()], 0.5, Shading::Smooth);
            let hasty = FrameRequest { wait: false, ..other };
            headless::image(&mut culled, &hasty).expect("a picture");
            let exact = request(*camera, [0.5, 2.0, 8.0][frame % 3], Shading::Smooth);
            let (got, _) = headless::image(&mut culled, &exact).expect("a picture");
            let (expected, _) = headless::image(&mut all, &exact.without_culling()).expect("a picture");
            let fresh = headless::image(&mut open(&model, PLENTY), &exact).expect("a picture").0;
            assert!(got == expected && got == fresh, "{shape} {seed}, frame {frame}");
        }
    }
}

/// Vertices without a direction are drawn by their plane, as flat shading does.
#[test]
fn vertices_without_a_direction_are_flat() {
    let mut sheet = hand::grid(8, 8);
    for (vertex, position) in sheet.positions.iter_mut().enumerate() {
        position[2] += [0.0, 0.3, 0.1][vertex % 3];
    }
    let backs: Vec<[u32; 3]> = sheet.triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    sheet.triangles.extend(backs);
    let mut viewer = open(&model(&sheet, Normals::Computed), PLENTY);
    let camera = viewer.framing();
    let mut draw =
        |shading| headless::image(&mut viewer, &request(camera, 0.0, shading)).expect("a picture").0;
    let (smooth, flat) = (draw(Shading::Smooth), draw(Shading::Flat));
    let largest = smooth.pixels.iter().zip(&flat.pixels).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(largest <= Some(1), "{largest:?}");
    assert!(flat.pixels.chunks_exact(4).any(|pixel| pixel != &flat.pixels[..4]), "something is seen");
}
