//! Shadows of the key light: none where light falls, and all that there are.

use crate::models::{self, Model};
use crate::screen::{PLENTY, exact, open, open_all};
use chpm_mesh::TriMesh;
use chpm_refine::{Camera, CameraPath};
use chpm_synth::{Shape, Synth, hand};
use chpm_viewer::{Clip, Coloring, FrameRequest, Image, Look, Shading, Stats, Transform, Viewer, headless};

const VIEWPORT: [u32; 2] = [240, 180];
/// A difference of brightness that nobody sees, of 255.
const UNSEEN: i32 = 4;

fn look(shadows: bool) -> Look {
    Look { shadows, colors: Coloring::Plain, ..Look::default() }
}

fn request(camera: Camera, look: Look) -> FrameRequest {
    FrameRequest { look, ..exact(camera, VIEWPORT, 1.0) }
}

fn draw(viewer: &mut Viewer, request: &FrameRequest) -> (Image, Stats) {
    headless::image(viewer, request).expect("a picture")
}

/// By pixel, how much darker the second one is.
fn loss(free: &Image, shadowed: &Image) -> Vec<i32> {
    let pixels = free.pixels.chunks_exact(4).zip(shadowed.pixels.chunks_exact(4));
    let channel = |free: &[u8], shadowed: &[u8], n: usize| i32::from(free[n]) - i32::from(shadowed[n]);
    let worst = |free: &[u8], shadowed: &[u8]| {
        let all = [0, 1, 2].map(|n| channel(free, shadowed, n));
        all.into_iter().max_by_key(|loss| loss.abs()).unwrap_or(0)
    };
    pixels.map(|(free, shadowed)| worst(free, shadowed)).collect()
}

/// The same frame without shadows and with them.
fn losses(viewer: &mut Viewer, request: &FrameRequest) -> Vec<i32> {
    let [free, shadowed] = [false, true].map(|shadows| {
        let look = Look { shadows, ..request.look };
        draw(viewer, &FrameRequest { look, ..*request }).0
    });
    loss(&free, &shadowed)
}

fn dark(losses: &[i32]) -> usize {
    losses.iter().filter(|loss| **loss > 20).count()
}

/// All of a mesh, scaled and moved, behind what is there.
fn add(all: &mut TriMesh, mesh: &TriMesh, scale: f32, by: [f32; 3]) {
    let first = all.positions.len() as u32;
    let moved = |p: &[f32; 3]| std::array::from_fn(|axis| scale * p[axis] + by[axis]);
    all.positions.extend(mesh.positions.iter().map(moved));
    all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| first + v)));
}

/// The square from -4 to 4, at height 0.
fn ground() -> TriMesh {
    let grid = hand::grid(60, 60);
    let side = grid.positions.iter().flatten().copied().fold(0.0, f32::max);
    let mut all = TriMesh::default();
    add(&mut all, &grid, 8.0 / side, [-4.0, -4.0, 0.0]);
    all
}

fn ball() -> TriMesh {
    Synth::new(Shape::Sphere, 4000, 1).to_mesh()
}

/// From above, upright along y: what is to the left of the light's way is in its shadow to the right.
fn from_above(x: f64, height: f64) -> Camera {
    Camera::looking([x, 0.0, height], [x, 0.0, 0.0])
}

/// The light comes from 45 degrees to the left.
const LEFT: [f64; 2] = [-45.0, 0.0];

#[test]
fn a_lit_sphere_has_no_dark_pixels() {
    let model = Model::synth(Shape::Sphere, 20_000, 256);
    let mut viewer = open(&model, PLENTY);
    let camera = viewer.framing();
    for (poe, viewport) in [(0.0, [400, 400]), (1.0, [160, 160]), (1.0, [640, 480]), (8.0, [300, 300])] {
        for shading in [Shading::Smooth, Shading::Flat] {
            // Where light comes from beside, planes of a coarse mesh, which is not convex, are in the shadow of others.
            let lights = [[50.0, 30.0], [0.0, 0.0], [-85.0, 5.0], [20.0, -80.0]];
            let is_convex = shading == Shading::Smooth || poe == 0.0;
            for light in &lights[..if is_convex { 4 } else { 2 }] {
                let look = Look { shading, light: *light, ..look(true) };
                let frame = FrameRequest { look, ..exact(camera, viewport, poe) };
                let losses = losses(&mut viewer, &frame);
                // A triangle that is seen from its edge, at the silhouette, has no plane that a pixel could tell: without shadows some are too bright.
                let (shown, _) = headless::ids(&mut viewer, &frame).expect("ids");
                let is_shown = |n: Option<usize>| n.and_then(|n| *shown.pixels.get(n)?).is_some();
                let steps = [1, viewport[0] as usize];
                let is_inside = |n: usize| {
                    steps.iter().all(|step| is_shown(n.checked_sub(*step)) && is_shown(Some(n + step)))
                };
                let inside: Vec<i32> =
                    (0..losses.len()).filter(|n| is_inside(*n)).map(|n| losses[n]).collect();
                let worst = inside.iter().copied().max().unwrap_or(0);
                assert!(worst <= UNSEEN, "{poe} {viewport:?} {shading:?} {light:?}: {worst}");
                assert!(losses.iter().all(|loss| *loss >= -1) && inside.len() > 5000, "{}", inside.len());
            }
        }
    }
}

/// Frames that do not wait: once nothing changes, the map is kept, and it is drawn anew where the camera or the light moves.
#[test]
fn a_map_is_drawn_once_while_nothing_moves() {
    let model = models::isosurface();
    let mut viewer = open(&model, PLENTY);
    let camera = viewer.framing();
    let still = FrameRequest { wait: false, ..request(camera, look(true)) };
    let maps = |viewer: &mut Viewer, request: &FrameRequest, frames: usize| -> Vec<u64> {
        (0..frames).map(|_| draw(viewer, request).1.shadow_maps).collect()
    };
    assert!(maps(&mut viewer, &still, 60).iter().sum::<u64>() >= 1);
    assert_eq!(maps(&mut viewer, &still, 20).iter().sum::<u64>(), 0, "at rest");
    let moved = FrameRequest { camera: Camera { position: [1.0, 0.5, 2.0], ..camera }, ..still };
    assert_eq!(maps(&mut viewer, &moved, 1), [1]);
    maps(&mut viewer, &moved, 40);
    let lit = FrameRequest { look: Look { light: [60.0, 10.0], ..still.look }, ..moved };
    assert_eq!(maps(&mut viewer, &lit, 3)[0], 1);
    let (_, stats) = draw(&mut viewer, &lit);
    assert!(stats.shadow_casters > 0 && stats.shadow_triangles > 0, "{stats:?}");

    // All samples of a picture have one.
    let (_, stats) = draw(&mut viewer, &FrameRequest { wait: true, samples: 8, ..lit });
    assert!(stats.shadow_maps <= 1, "{}", stats.shadow_maps);
    assert_eq!(draw(&mut viewer, &FrameRequest { wait: true, samples: 8, ..lit }).1.shadow_maps, 0);
}

/// A frame that is at rest has the shadows of one that waited.
#[test]
fn frames_come_to_the_shadows_of_those_that_wait() {
    let model = models::isosurface();
    let camera = Camera::looking([0.5, 0.6, 1.0], [0.11, 0.11, 0.5]);
    let (mut hasty, mut patient) = (open(&model, PLENTY), open(&model, PLENTY));
    let exact = request(camera, look(true));
    let mut last = |samples| {
        let frame = FrameRequest { wait: false, samples, ..exact };
        (0..40).for_each(|_| drop(draw(&mut hasty, &frame)));
        draw(&mut hasty, &frame).0
    };
    let waited = draw(&mut patient, &exact).0;
    let differ = |last: &Image| loss(last, &waited).iter().filter(|loss| loss.abs() > UNSEEN).count();
    let [hard, smooth] = [1, 4].map(|samples| differ(&last(samples)));
    assert!(hard * 500 < 240 * 180, "{hard} pixels");
    // Of several samples a pixel, edges alone are others.
    let edges = differ(&draw(&mut patient, &FrameRequest { samples: 4, ..exact }).0);
    assert!(smooth < 2 * edges, "{smooth} pixels, {edges} at edges");
    assert!(dark(&losses(&mut patient, &exact)) > 500);
}

/// What is beside the image throws its shadow into it, as fine as the camera wants it there: no pixel is otherwise without culling.
#[test]
fn what_is_beside_the_image_throws_its_shadow() {
    let mut mesh = ground();
    // Shadows go to the right as far as the ball is high.
    add(&mut mesh, &ball(), 0.6, [-2.5, 0.0, 2.5]);
    let model = Model::of(&mesh, 128);
    let mut viewer = open(&model, PLENTY);
    let look = Look { light: LEFT, ..look(true) };
    let frame = request(from_above(0.2, 2.2), look);
    let (mut ids, shadows) = (open(&model, PLENTY), losses(&mut viewer, &frame));
    assert!(dark(&shadows) > 1000, "{}", dark(&shadows));
    let (_, alone) = headless::ids(&mut ids, &frame).expect("ids");
    assert!(alone.frustum_culled > 1, "{alone:?}");
    let (culled, stats) = draw(&mut viewer, &frame);
    let all = draw(&mut open(&model, PLENTY), &frame.without_culling()).0;
    let differ = loss(&culled, &all).iter().filter(|loss| **loss != 0).count();
    assert_eq!(differ, 0, "{stats:?}");

    // The same with frames that do not wait.
    let mut hasty = open(&model, PLENTY);
    let mut last = None;
    for _ in 0..40 {
        last = Some(draw(&mut hasty, &FrameRequest { wait: false, ..frame }).0);
    }
    let differ = last.map(|last| loss(&last, &culled).iter().filter(|loss| loss.abs() > UNSEEN).count());
    assert!(differ.is_some_and(|differ| differ < 60), "{differ:?}");
}

/// Where geometry says, of two models as of one.
#[test]
fn models_throw_shadows_on_each_other() {
    let (plane, sphere) = (Model::of(&ground(), 256), Model::of(&ball(), 256));
    let at = [-1.0, 0.2, 1.5];
    let rows = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let mut viewer = open_all(&[(&plane, Transform::STILL), (&sphere, Transform::new(rows, at))], PLENTY)
        .expect("a viewer");
    let camera = from_above(0.0, 8.0);
    let frame = request(camera, Look { light: LEFT, ..look(true) });
    let got = losses(&mut viewer, &frame);
    let half = 22.5_f64.to_radians().tan();
    let [width, height] = VIEWPORT.map(f64::from);
    let mut counts = [0; 2];
    for (n, loss) in got.iter().enumerate() {
        let (x, y) = ((n % 240) as f64 + 0.5, (n / 240) as f64 + 0.5);
        let way = [(2.0 * x / width - 1.0) * half * width / height, (1.0 - 2.0 * y / height) * half, -1.0];
        // The ground that is seen there, and how far the light's way from it passes the ball; that of the eye, too.
        let spot = [8.0 * way[0], 8.0 * way[1], 0.0];
        let passes = |from: [f64; 3], way: [f64; 3]| {
            let to = [0, 1, 2].map(|axis| at[axis] - from[axis]);
            let along =
                (0..3).map(|axis| to[axis] * way[axis]).sum::<f64>() / way.iter().map(|x| x * x).sum::<f64>();
            (0..3).map(|axis| (to[axis] - along * way[axis]).powi(2)).sum::<f64>().sqrt()
        };
        let (shadow, seen) = (passes(spot, [-1.0, 0.0, 1.0]), passes(camera.position, way));
        if spot.iter().any(|x| x.abs() > 3.9) || seen < 1.05 || (0.95..1.05).contains(&shadow) {
            continue;
        }
        assert_eq!(*loss > 20, shadow < 1.0, "{x},{y}: {loss}, {shadow}");
        counts[usize::from(shadow < 1.0)] += 1;
    }
    assert!(counts[0] > 5000 && counts[1] > 500, "{counts:?}");
}

/// What is clipped stops no light.
#[test]
fn what_is_clipped_throws_no_shadow() {
    let mut mesh = ground();
    add(&mut mesh, &ball(), 0.8, [0.0, 0.0, 2.0]);
    let model = Model::of(&mesh, 128);
    let mut viewer = open(&model, PLENTY);
    let frame = request(from_above(1.0, 8.0), Look { light: LEFT, ..look(true) });
    let whole = dark(&losses(&mut viewer, &frame));
    let clip = |z: f64| Clip::new([0.0, 0.0, 1.0], z);
    let half = dark(&losses(&mut viewer, &FrameRequest { clip: clip(2.0), ..frame }));
    let none = dark(&losses(&mut viewer, &FrameRequest { clip: clip(1.0), ..frame }));
    assert!(whole > 500 && half > 500 && none == 0, "{whole}, {half}, {none}");
}

/// Whatever colours show, and with edges of triangles: darker where shadows are, and nowhere brighter. Without them a picture is as it was.
#[test]
fn all_looks_have_shadows() {
    let mut mesh = ground();
    add(&mut mesh, &ball(), 0.8, [0.0, 0.0, 2.0]);
    mesh.colors = mesh.positions.iter().map(|p| [200, (20.0 * p[2]) as u8 + 90, 160, 255]).collect();
    let model = Model::of(&mesh, 256);
    let mut viewer = open(&model, PLENTY);
    for (colors, ..) in Coloring::ALL {
        for (shading, wireframe) in
            [(Shading::Flat, false), (Shading::Smooth, false), (Shading::Smooth, true)]
        {
            for one_sided in [false, true] {
                let look = Look {
                    shading,
                    wireframe,
                    one_sided,
                    light: LEFT,
                    shadows: true,
                    colors,
                    ..Look::default()
                };
                let frame = request(from_above(1.0, 8.0), look);
                let plain = FrameRequest { look: Look { shadows: false, ..look }, ..frame };
                let before = draw(&mut viewer, &plain).0;
                let losses = loss(&before, &draw(&mut viewer, &frame).0);
                assert!(dark(&losses) > 200, "{look:?}: {}", dark(&losses));
                assert!(losses.iter().all(|loss| *loss >= -1), "{look:?}");
                assert!(draw(&mut viewer, &plain).0 == before, "{look:?}");
            }
        }
    }
}

/// In a deep picture, what is near has shadows as sharp as what is far.
#[test]
fn what_is_near_has_texels_of_its_own() {
    let mut mesh = ground();
    add(&mut mesh, &ball(), 0.03, [0.03, -3.8, 0.05]);
    let model = Model::of(&mesh, 128);
    let mut viewer = open(&model, PLENTY);
    let camera = Camera { up: [0.0, 0.0, 1.0], ..Camera::looking([0.05, -4.0, 0.15], [0.05, -3.7, 0.03]) };
    let look = Look { light: [-60.0, 40.0], ..look(true) };
    let losses = losses(&mut viewer, &request(camera, look));
    // What is neither lit nor dark is a texel of the map wide: along the edges of this shadow it is no more than a pixel or two.
    let most = losses.iter().copied().max().unwrap_or(0);
    let mixed = losses.iter().filter(|loss| **loss > most / 8 && **loss < most * 7 / 8).count();
    let dark = dark(&losses);
    assert!(dark > 400 && 4 * mixed < dark, "{mixed} of {dark}");
}

/// Corners are darker, and what is behind the model is as it was.
#[test]
fn corners_are_darker_in_frames_that_do_not_wait() {
    let mut mesh = ground();
    add(&mut mesh, &ball(), 0.8, [0.0, 0.0, 0.7]);
    let model = Model::of(&mesh, 256);
    let mut viewer = open(&model, PLENTY);
    let camera = Camera { up: [0.0, 0.0, 1.0], ..Camera::looking([6.0, -7.0, 4.0], [0.0; 3]) };
    for wait in [false, true] {
        for samples in [1, 4] {
            let frame = FrameRequest { wait, samples, ..request(camera, look(false)) };
            (0..20).for_each(|_| drop(draw(&mut viewer, &frame)));
            let bare = draw(&mut viewer, &frame).0;
            let corners = FrameRequest { look: Look { occlusion: true, ..frame.look }, ..frame };
            let darker = loss(&bare, &draw(&mut viewer, &corners).0);
            let count = darker.iter().filter(|loss| **loss > 8).count();
            assert!(count > 100 && count < 8000, "{wait} {samples}: {count}");
            assert!(darker.iter().all(|loss| *loss >= 0));
            assert_eq!((darker[0], darker[239]), (0, 0), "behind the model");
        }
    }
}

/// Cameras from anywhere, flat and smooth: nothing fails, nothing is brighter, and culling changes no shadow.
#[test]
fn culling_changes_no_shadow() {
    let model = models::isosurface();
    let (mut culled, mut all) = (open(&model, PLENTY), open(&model, PLENTY));
    let bounds = culled.bounds();
    let cameras = CameraPath::random(&bounds, 3, 90).cameras.into_iter().step_by(30);
    for camera in cameras.chain(CameraPath::orbit(&bounds, 2).cameras) {
        let frame = request(camera, look(true));
        let losses = losses(&mut culled, &frame);
        assert!(losses.iter().all(|loss| *loss >= -1));
        let (some, every) = (draw(&mut culled, &frame).0, draw(&mut all, &frame.without_culling()).0);
        let differ = loss(&some, &every).iter().filter(|loss| loss.abs() > UNSEEN).count();
        // The map of all that is in the image has other texels than that of what is seen.
        assert!(differ * 100 < 240 * 180, "{differ} pixels; {camera:?}");
    }
}
