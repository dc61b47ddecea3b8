//! Two models in one picture, each put somewhere.

use crate::models::{self, Model};
use crate::raster::Raster;
use crate::screen::{PLENTY, exact, ids, open, open_all};
use chpm_build::Settings;
use chpm_mesh::{Bytes, TriMesh};
use chpm_refine::{Camera, CameraPath, Hierarchy, View, select};
use chpm_synth::{Shape, Synth};
use chpm_viewer::{Budgets, Clip, FrameRequest, Look, Shading, Transform, Viewer, ViewerError, headless};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use std::fs;

const VIEWPORT: [u32; 2] = [160, 120];

/// A rigid motion, beside the viewer's.
#[derive(Clone, Copy)]
struct Motion {
    turn: Matrix3<f64>,
    shift: Vector3<f64>,
}

impl Motion {
    fn new(turn: [f64; 3], shift: [f64; 3]) -> Self {
        Motion { turn: *Rotation3::new(turn.into()).matrix(), shift: shift.into() }
    }

    fn place(&self) -> Transform {
        let rows = [0, 1, 2].map(|row| [0, 1, 2].map(|column| self.turn[(row, column)]));
        Transform::new(rows, self.shift.into())
    }

    fn apply(&self, point: [f64; 3]) -> Vector3<f64> {
        self.turn * Vector3::from(point) + self.shift
    }

    /// A camera as the model has it.
    fn back(&self, camera: &Camera) -> Camera {
        let way = |point: [f64; 3]| self.turn.transpose() * (Vector3::from(point) - self.shift);
        let up = self.turn.transpose() * Vector3::from(camera.up);
        Camera {
            position: way(camera.position).into(),
            target: way(camera.target).into(),
            up: up.into(),
            ..*camera
        }
    }
}

/// Around both, near both, and from between them.
fn cameras(viewer: &Viewer, each: usize) -> Vec<Camera> {
    let bounds = viewer.bounds();
    let mut all = CameraPath::orbit(&bounds, each).cameras;
    all.extend(CameraPath::random(&bounds, 4, 30 * each).cameras.into_iter().step_by(30));
    all.iter().map(|camera| camera.relative_to(viewer.origin().map(|x| -x))).collect()
}

/// Wherever rounding cannot decide, the picture is what a processor makes of both cuts, and culling changes no pixel of it. Answers
/// pixels of the first, of the second, and clusters that were hidden.
fn agrees(pair: [(&Model, Motion); 2], each: usize, poe: f64) -> [u64; 3] {
    let placed = pair.map(|(model, motion)| (model, motion.place()));
    let mut viewer = open_all(&placed, PLENTY).expect("a viewer");
    let mut all = open_all(&placed, PLENTY).expect("a viewer");
    let files = pair.map(|(model, _)| model.open());
    let near = files.iter().map(|file| 1e-6 * file.header().aabb().diagonal()).fold(f64::INFINITY, f64::min);
    let (zero, mut counts) = (viewer.origin(), [0; 3]);
    let (mut uncertain, mut pixels) = (0, 0);
    for (frame, camera) in cameras(&viewer, each).into_iter().enumerate() {
        let request = exact(camera, VIEWPORT, poe);
        let (got, stats) = ids(&mut viewer, &request);
        let (complete, _) = ids(&mut all, &request.without_culling());
        assert!(got == complete, "frame {frame}: culling shows");

        let mut raster = Raster::new(&camera.relative_to(zero), VIEWPORT, near).expect("a raster");
        for (model, (file, (_, motion))) in (0..).zip(files.iter().zip(&pair)) {
            let origin = file.header().origin;
            let view = View::new(&motion.back(&camera).relative_to(origin), VIEWPORT, poe).expect("a view");
            let cut = select(file, &Hierarchy::new(file), &view).expect("a cut");
            // What is far away cancels before anything is lost.
            let from = motion.apply(origin) - Vector3::from(zero);
            let place = |position: [f64; 3]| (motion.turn * Vector3::from(position) + from).into();
            raster.draw_cut(file, &cut, model, place).expect("sound pages");
        }
        let expected = raster.ids();
        for (place, (got, expected)) in got.pixels.iter().zip(&expected.pixels).enumerate() {
            assert!(
                got == expected || !raster.is_certain(place),
                "frame {frame}, pixel {}, {}: {got:?}, expected {expected:?}; {camera:?}",
                place % 160,
                place / 160
            );
            uncertain += usize::from(!raster.is_certain(place));
            if let Some(got) = got {
                counts[got.model as usize] += 1;
            }
        }
        pixels += got.pixels.len();
        counts[2] += stats.occluded;
    }
    println!("{counts:?}, {uncertain} of {pixels} uncertain");
    assert!(50 * uncertain < pixels, "{uncertain} of {pixels} pixels are uncertain");
    assert!(counts[0] > 100 && counts[1] > 100, "both are seen: {counts:?}");
    counts
}

const STILL: [f64; 3] = [0.0; 3];

#[test]
fn models_beside_each_other() {
    let (a, b) = (models::isosurface(), models::shells());
    let [.., hidden] = agrees(
        [(&a, Motion::new(STILL, STILL)), (&b, Motion::new([0.3, -0.8, 0.5], [1.0, 0.4, 0.2]))],
        4,
        1.0,
    );
    assert!(hidden > 100, "{hidden}");
}

#[test]
fn models_that_go_through_each_other_and_are_the_same() {
    let model = models::isosurface();
    let turned = Motion::new([0.2, 0.5, -0.4], [0.01, 0.02, 0.03]);
    agrees([(&model, Motion::new(STILL, STILL)), (&model, turned)], 4, 0.5);
    // Both moved, and alike but for a little.
    let far = Motion { shift: [40.0, -30.0, 20.0].into(), ..turned };
    let near = Motion { shift: far.shift + Vector3::new(0.3, 0.0, 0.0), ..far };
    agrees([(&model, far), (&model, near)], 3, 2.0);
}

#[test]
fn far_from_the_zero_point() {
    let (far, near) = (models::far_away(), models::shells());
    // One is brought to where the other is, and the other way round.
    let home = Motion::new(STILL, [-1e6 + 0.5, 4e6, -3e5]);
    let away = Motion::new([0.0, 0.0, 1.0], [1e6 + 0.25, -4e6, 3e5]);
    let still = Motion::new(STILL, STILL);
    agrees([(&near, still), (&far, home)], 3, 1.0);
    agrees([(&far, still), (&near, away)], 3, 1.0);
}

#[test]
fn a_large_one_hides_a_small_one_and_the_other_way_round() {
    let (large, small) = (models::wall(), models::triangle());
    let still = Motion::new(STILL, STILL);
    agrees([(&large, still), (&small, Motion::new(STILL, [0.0, 0.0, 3.5]))], 3, 1.0);
    // Behind the wall, as seen from its side, nothing of the second is drawn or read beyond its roots.
    let hidden = models::isosurface();
    for order in [false, true] {
        let mut pair =
            [(&large, Transform::STILL), (&hidden, Motion::new(STILL, [-0.5, -0.5, -6.0]).place())];
        if order {
            pair.reverse();
        }
        let mut viewer = open_all(&pair, PLENTY).expect("a viewer");
        let camera = Camera::looking([0.0, 0.0, 9.0], [0.0; 3]);
        let (image, stats) = ids(&mut viewer, &exact(camera, VIEWPORT, 0.5));
        let (bare, alone) = ids(&mut open(&large, PLENTY), &exact(camera, VIEWPORT, 0.5));
        assert!(stats.triangles < alone.triangles + 500, "{} and {}", stats.triangles, alone.triangles);
        let clusters = |image: &chpm_viewer::IdImage| -> Vec<_> {
            image.pixels.iter().map(|id| id.map(|id| (id.cluster, id.triangle))).collect()
        };
        assert_eq!(clusters(&image), clusters(&bare), "{order}");
    }
}

/// A turn by 90 degrees and a move by whole numbers lose nothing: a model that is put there, seen by a camera that went with it, is the
/// same picture to the last bit, light, ground, clipping plane and all.
#[test]
fn a_model_that_is_put_somewhere_is_seen_as_it_was() {
    let model = colored();
    let place = Transform::new([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [2.0, -4.0, 8.0]);
    let moved = |p: [f64; 3]| place.apply(p);
    let turned = |[x, y, z]: [f64; 3]| [-y, x, z];
    let mut here = open(&model, PLENTY);
    let mut there = open_all(&[(&model, place)], PLENTY).expect("a viewer");
    let center = here.bounds().center();
    let camera = Camera::looking([center.x + 2.0, center.y + 1.0, center.z + 1.5], center.into());
    let gone = Camera {
        position: moved(camera.position),
        target: moved(camera.target),
        up: turned(camera.up),
        ..camera
    };
    for studio in [false, true] {
        for clip in [None, Some([0.0, 1.0, 0.0])] {
            let look = Look { studio, shading: Shading::Smooth, light: [60.0, 20.0], ..Look::default() };
            let clips = clip.map(|normal| {
                let at = |normal: [f64; 3], p: [f64; 3]| Vector3::from(normal).dot(&Vector3::from(p));
                let c: [f64; 3] = center.into();
                let plane =
                    |normal: [f64; 3], p: [f64; 3]| Clip::new(normal, at(normal, p)).expect("a plane");
                [plane(normal, c), plane(turned(normal), moved(c))]
            });
            let draw = |viewer: &mut Viewer, camera, clip| {
                let request = FrameRequest { look, clip, samples: 2, ..exact(camera, VIEWPORT, 1.0) };
                headless::image(viewer, &request).expect("a picture").0
            };
            let a = draw(&mut here, camera, clips.map(|clips| clips[0]));
            let b = draw(&mut there, gone, clips.map(|clips| clips[1]));
            let differ =
                a.pixels.chunks_exact(4).zip(b.pixels.chunks_exact(4)).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "studio {studio}, clipped {}", clip.is_some());
        }
    }
}

fn sphere(triangles: u64) -> TriMesh {
    Synth::new(Shape::Sphere, triangles, 1).to_mesh()
}

/// With a colour for each vertex, packed.
fn colored() -> Model {
    let mut mesh = sphere(6000);
    let color = |p: &[f32; 3]| p.map(|x| (127.0 + 100.0 * x) as u8);
    mesh.colors = mesh.positions.iter().map(color).map(|[r, g, b]| [r, g, b, 255]).collect();
    let settings = Settings { cluster_triangles: 128, packed: true, ..Settings::default() };
    Model::built(&mesh, [0.0; 3], settings)
}

/// Each as it looks alone, in front of the other or beside it; whatever was drawn before, waiting or not.
#[test]
fn each_has_its_own_attributes() {
    let (colored, plain) = (colored(), models::shells());
    let aside = Motion::new(STILL, [40.0, 0.0, 0.0]);
    let both = [(&plain, aside.place()), (&colored, Transform::STILL)];
    let mut viewer = open_all(&both, PLENTY).expect("a viewer");
    for look in [Look::default(), Look { shading: Shading::Smooth, wireframe: true, ..Look::default() }] {
        for (model, shift) in [(&colored, 0.0), (&plain, 40.0)] {
            let camera = Camera::looking([0.5 + shift, 0.8, 3.0], [shift, 0.0, 0.0]);
            let request = FrameRequest { look, ..exact(camera, VIEWPORT, 1.0) };
            let alone = camera.relative_to([shift, 0.0, 0.0]);
            let (got, _) = headless::image(&mut viewer, &request).expect("a picture");
            let alone = FrameRequest { camera: alone, ..request };
            let (expected, _) = headless::image(&mut open(model, PLENTY), &alone).expect("a picture");
            // The camera was rounded in another place: edges may fall the other way.
            let pairs = got.pixels.chunks_exact(4).zip(expected.pixels.chunks_exact(4));
            let differ = pairs.filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 2)).count();
            assert!(differ < 20, "{differ} pixels of {shift}");
        }
    }
    // Of two without colours, the second one is bluish, lit or not.
    let pair = [(&plain, Transform::STILL), (&plain, aside.place())];
    let mut viewer = open_all(&pair, PLENTY).expect("a viewer");
    for (shift, is_first) in [(0.0, true), (40.0, false)] {
        for shading in [Shading::Flat, Shading::Smooth] {
            let camera = Camera::looking([0.5 + shift, 0.8, 3.0], [shift, 0.0, 0.0]);
            let look = Look { shading, background: [0.0; 3], ..Look::default() };
            let request = FrameRequest { look, ..exact(camera, VIEWPORT, 1.0) };
            let (got, _) = headless::image(&mut viewer, &request).expect("a picture");
            let lit: Vec<_> = got.pixels.chunks_exact(4).filter(|p| p[0] > 20).collect();
            assert!(lit.len() > 1000 && lit.iter().all(|p| (p[0] > p[2]) == is_first), "{shift} {shading:?}");
        }
    }
}

/// Frames that wait for nothing come to the exact picture, also with several samples a pixel, and when one model moves under a camera
/// that rests.
#[test]
fn what_flows_becomes_exact() {
    let (a, b) = (models::wall(), colored());
    let places =
        [[0.0, 0.0, 5.0], [2.0, 0.5, 2.0], [0.0, 0.0, -3.0]].map(|s| Motion::new([0.1, 0.2, 0.3], s).place());
    let pair = |place| open_all(&[(&a, Transform::STILL), (&b, place)], PLENTY).expect("a viewer");
    let mut moving = pair(places[0]);
    let camera = Camera::looking([1.0, 2.0, 12.0], [0.0; 3]);
    for place in places {
        moving.put(1, place);
        let request = exact(camera, VIEWPORT, 1.0);
        let (expected, _) = headless::image(&mut pair(place), &request).expect("a picture");
        let hasty = FrameRequest { wait: false, ..request };
        let picture = |viewer: &mut Viewer, request| headless::image(viewer, request).expect("a picture").0;
        assert!((0..1000).any(|_| picture(&mut moving, &hasty) == expected), "{place:?}");
        // As hard edges have it, but for edges.
        let smooth = FrameRequest { samples: 4, ..hasty };
        let smooth = (0..9).map(|_| picture(&mut moving, &smooth)).last().expect("a picture");
        let off = |(a, b): (&u8, &u8)| u64::from(a.abs_diff(*b));
        let off: u64 = smooth.pixels.iter().zip(&expected.pixels).map(off).sum();
        assert!(off > 0 && off < 8 * VIEWPORT[0] as u64 * VIEWPORT[1] as u64, "{off}");
    }
}

/// Picked points are on the model that is seen there, wherever it was put.
#[test]
fn what_is_picked_is_where_it_is_seen() {
    let model = Model::of(&sphere(4000), 128);
    let motion = Motion::new([0.4, 0.5, 0.6], [3.0, 1.0, -2.0]);
    let mut viewer =
        open_all(&[(&model, Transform::STILL), (&model, motion.place())], PLENTY).expect("a viewer");
    let camera = Camera::looking([1.5, 4.0, 7.0], [1.5, 0.5, -1.0]);
    let request = exact(camera, VIEWPORT, 0.1);
    let (image, _) = ids(&mut viewer, &request);
    let (centers, mut seen) = ([Vector3::zeros(), motion.shift], [0; 2]);
    for (place, id) in image.pixels.iter().enumerate().step_by(7) {
        let pixel = [place as u32 % VIEWPORT[0], place as u32 / VIEWPORT[0]];
        let point = viewer.pick(pixel).expect("a depth");
        assert_eq!(point.is_some(), id.is_some(), "{pixel:?}");
        let (Some(point), Some(id)) = (point, id) else { continue };
        let model = id.model as usize;
        let radius = (Point3::from(point).coords - centers[model]).norm();
        assert!((radius - 1.0).abs() < 0.03, "{radius} at {pixel:?} of {model}");
        seen[model] += 1;
    }
    assert!(seen[0] > 50 && seen[1] > 50, "{seen:?}");
}

#[test]
fn what_cannot_be_opened_together_is_told() {
    let (a, b) = (models::shells(), models::isosurface());
    let pair = [(&a, Transform::STILL), (&b, Transform::STILL)];
    // Enough for the roots of either, and for all that one of them needs.
    let least = |model: &Model| {
        (1..).find(|kib| open_all(&[(model, Transform::STILL)], small(*kib)).is_ok()).expect("some")
    };
    let (first, second) = (least(&a), least(&b));
    let error = open_all(&pair, small(first.max(second))).map(drop).expect_err("too little");
    assert!(matches!(error, ViewerError::Budget { what: "memory", .. }), "{error}");
    let mut viewer = open_all(&pair, small(first + second)).expect("enough");
    let camera = viewer.framing();
    let (_, stats) = headless::image(&mut viewer, &exact(camera, VIEWPORT, 0.0)).expect("a picture");
    assert!(stats.withheld > 0 && stats.resident_bytes <= (first + second) << 10, "{stats:?}");
    let budgets = Budgets { gpu_memory: Bytes(8 << 10), ..PLENTY };
    let error = open_all(&pair, budgets).map(drop).expect_err("too little");
    assert!(matches!(error, ViewerError::Budget { what: "GPU memory", .. }), "{error}");

    let mut bytes = fs::read(b.path()).expect("a file");
    bytes.truncate(bytes.len() / 2);
    fs::write(b.path(), bytes).expect("a file");
    let error = open_all(&pair, PLENTY).map(drop).expect_err("half a file").to_string();
    assert!(error.contains(&b.path().display().to_string()), "{error}");
}

fn small(kib: u64) -> Budgets {
    Budgets { memory: Bytes(kib << 10), ..PLENTY }
}
