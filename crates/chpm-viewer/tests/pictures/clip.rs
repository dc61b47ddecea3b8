//! A clipping plane, the light and roll.

use crate::models::{self, Model};
use crate::screen::{PLENTY, exact, ids, open};
use chpm_mesh::GroupId;
use chpm_refine::{Camera, Side, Up};
use chpm_synth::Shape;
use chpm_viewer::{Clip, Coloring, FrameRequest, Image, Look, Shading, headless};
use std::collections::BTreeSet;

const VIEWPORT: [u32; 2] = [160, 120];

fn clipped(camera: Camera, plane: &str) -> FrameRequest {
    let clip: Clip = plane.parse().expect("a plane");
    FrameRequest { clip: Some(clip), ..exact(camera, VIEWPORT, 1.0) }
}

/// From anywhere, with culling or without, the same triangles are seen of what is left, and nothing of the rest.
#[test]
fn nothing_is_seen_beyond_a_plane_and_nothing_else_is_missing() {
    // The wall is cut away; through the parts; askew.
    for (model, planes) in [
        (models::wall(), ["z:2.5", "-x:0.1", "1,2,3:0.5"]),
        (models::shells(), ["x:0.1", "-y:0.3", "-1,1,1:0"]),
        (models::far_away(), ["x:1000000.5", "-z:300000.4", "-1,1,1:-4700000"]),
    ] {
        let (mut culled, mut all) = (open(&model, PLENTY), open(&model, PLENTY));
        let (mut seen, mut left_out) = (0, 0);
        for (frame, camera) in models::cameras(&model.open(), 3).into_iter().enumerate() {
            let plane = planes[frame % 3];
            let request = clipped(camera, plane);
            let (got, stats) = ids(&mut culled, &request);
            let (expected, _) = ids(&mut all, &request.without_culling());
            assert!(got == expected, "{plane}: {camera:?}");
            left_out += stats.frustum_culled + stats.occluded;

            // What is picked is on this side, and is something exactly where the item buffer has something.
            let clip = request.clip.expect("a plane");
            for pixel in
                (0..VIEWPORT[0]).step_by(7).flat_map(|x| (0..VIEWPORT[1]).step_by(11).map(move |y| [x, y]))
            {
                let point = culled.pick(pixel).expect("a depth");
                let id = got.pixels[(pixel[1] * VIEWPORT[0] + pixel[0]) as usize];
                assert_eq!(point.is_some(), id.is_some(), "{plane}: {pixel:?}");
                let Some(point) = point else { continue };
                let beyond = -clip.offset_from(point);
                // A pixel's middle and rounding.
                let size = culled.bounds().diagonal();
                assert!(beyond < 1e-3 * size, "{plane}: {point:?} is {beyond} beyond");
                seen += 1;
            }
        }
        assert!(seen > 50 && left_out > 50, "{planes:?}: {seen} seen, {left_out} left out");
    }
}

/// Through the cut, the inner side is seen and lit; pages beyond it are not read.
#[test]
fn a_cut_shows_what_is_inside() {
    let model = Model::synth(Shape::Sphere, 20_000, 128);
    let camera = Camera::looking([3.0, 0.0, 0.0], [0.0; 3]);
    let look = Look { colors: Coloring::Plain, background: [0.0; 3], ..Look::default() };
    let (mut whole, mut cut) = (open(&model, PLENTY), open(&model, PLENTY));
    let picture = |viewer: &mut chpm_viewer::Viewer, request: FrameRequest| {
        headless::image(viewer, &FrameRequest { look, ..request }).expect("a picture")
    };
    let (outer, _) = picture(&mut whole, exact(camera, VIEWPORT, 0.3));
    let (inner, _) = picture(&mut cut, clipped(camera, "x:0").with(0.3));
    let [a, b] = [&whole, &cut].map(|viewer| viewer.pick([80, 60]).expect("a depth").expect("a point"));
    assert!(a[0] > 0.9 && b[0] < -0.9, "{a:?} {b:?}");
    // The same outline but for perspective, bright all over.
    let lit = |image: &Image| image.pixels.chunks_exact(4).filter(|pixel| pixel[1] > 40).count();
    let drawn = |image: &Image| image.pixels.chunks_exact(4).filter(|pixel| pixel[1] > 0).count();
    assert!(
        lit(&inner) * 100 > drawn(&inner) * 98 && drawn(&inner) * 2 > drawn(&outer),
        "{} of {}",
        lit(&inner),
        drawn(&inner)
    );
    // Most of it lies beyond, and stays coarse.
    let (mut from_behind, mut behind_cut) = (open(&model, PLENTY), open(&model, PLENTY));
    let back = Camera::looking([-3.0, 0.0, 0.0], [0.0; 3]);
    let without = FrameRequest { occlusion_culling: false, ..exact(back, VIEWPORT, 0.01) };
    let (_, all) = picture(&mut from_behind, without);
    let (_, part) = picture(
        &mut behind_cut,
        FrameRequest { occlusion_culling: false, ..clipped(back, "x:-0.8").with(0.01) },
    );
    assert!(part.gpu_bytes * 3 < all.gpu_bytes && part.triangles * 3 < all.triangles, "{part:?} of {all:?}");
    assert!(part.resident_bytes < all.resident_bytes, "{part:?} of {all:?}");
}

/// Pages are read for what has something on this side of the plane, and for nothing else, by frames that wait and by those of a camera that
/// moves, which read ahead.
#[test]
fn what_is_beyond_a_plane_is_not_read() {
    let model = Model::synth(Shape::Isosurface, 60_000, 128);
    let file = model.open();
    let bounds = file.header().aabb();
    for (axis, share, negative) in [(0, 0.5, false), (1, 0.3, true), (2, 0.15, false)] {
        let place = bounds.min[axis] + share * (bounds.max[axis] - bounds.min[axis]);
        let name = ["x", "y", "z"][axis];
        let plane = if negative { format!("-{name}:{place}") } else { format!("{name}:{place}") };

        // Groups one by one, each by all of the clusters in it and in the groups below.
        let is_left = |id: &u32| {
            let cluster = &file.clusters()[*id as usize];
            if negative { cluster.aabb_max[axis] >= place } else { cluster.aabb_min[axis] <= place }
        };
        let mut pages = 0;
        for group in (0..file.groups().len() as u32).map(GroupId) {
            let mut all = BTreeSet::from([group]);
            let mut next = vec![group];
            while let Some(group) = next.pop() {
                let below = file.fine(group).iter().map(|id| file.clusters()[*id as usize].group());
                next.extend(below.filter(|below| all.insert(*below)));
            }
            let left = all.iter().any(|group| file.coarse(*group).iter().any(is_left));
            let bytes = |id: &u32| u64::from(file.clusters()[*id as usize].page_len);
            pages += if left { file.fine(group).iter().map(bytes).sum() } else { 0 };
        }

        let mut viewer = open(&model, PLENTY);
        let camera = viewer.framing();
        let fine = |camera| FrameRequest { occlusion_culling: false, ..clipped(camera, &plane).with(0.01) };
        let (_, whole) = headless::image(&mut viewer, &fine(camera)).expect("a picture");
        let mut moving = open(&model, PLENTY);
        let portrait = moving.portrait(Up::ALL.first().copied(), Some(Side::Front)).expect("a mesh");
        let turns = moving.turn(&portrait, VIEWPORT, 24);
        // Those who move want less, and read ahead what is wanted next.
        let hasty = |camera| FrameRequest { wait: false, ..fine(camera).with(1.0) };
        let read = |camera: &Camera| {
            headless::image(&mut moving, &hasty(*camera)).expect("a picture").1.requested_bytes
        };
        let along: u64 = turns.iter().cycle().take(60).map(read).sum();
        println!("{plane}: {pages} bytes, {} and {along} read", whole.requested_bytes);
        assert_eq!(whole.requested_bytes, pages, "{plane}");
        assert!(along <= pages && along > pages / 2, "{plane}: {along} of {pages}");
    }
}

/// The same request at so many pixels of error.
trait With {
    fn with(self, poe: f64) -> Self;
}

impl With for FrameRequest {
    fn with(self, poe: f64) -> Self {
        FrameRequest { accuracy: chpm_viewer::Accuracy::PoE(poe), ..self }
    }
}

/// Frames that do not wait come to the same, with smooth edges, too, and a plane that moves is followed.
#[test]
fn the_window_clips_as_well() {
    let model = models::isosurface();
    let mut viewer = open(&model, PLENTY);
    let camera = viewer.framing();
    for samples in [1, 4] {
        let (low, high) = (viewer.bounds().min[0], viewer.bounds().max[0]);
        let covered = [0.8, 0.5, 0.2].map(|share| {
            let plane = &format!("x:{}", low + share * (high - low));
            let hasty = FrameRequest { wait: false, samples, ..clipped(camera, plane) };
            let last = (0..40).map(|_| headless::image(&mut viewer, &hasty).expect("a picture").0).last();
            let image = last.expect("a picture");
            image.pixels.chunks_exact(4).filter(|pixel| *pixel != &image.pixels[..4]).count()
        });
        assert!(covered[0] > covered[1] && covered[1] > covered[2] && covered[2] > 0, "{covered:?}");
    }
}

#[test]
fn a_light_lights_its_side() {
    let model = Model::synth(Shape::Sphere, 4000, 128);
    let mut viewer = open(&model, PLENTY);
    let camera = viewer.framing();
    let mut halves = |light: [f64; 2]| {
        let look = Look { light, shading: Shading::Smooth, colors: Coloring::Plain, ..Look::default() };
        let request = FrameRequest { look, ..exact(camera, VIEWPORT, 1.0) };
        let (image, _) = headless::image(&mut viewer, &request).expect("a picture");
        let sum = |of: &dyn Fn(u32, u32) -> bool| {
            let inside = (0..VIEWPORT[0]).flat_map(|x| (0..VIEWPORT[1]).map(move |y| (x, y)));
            inside.filter(|(x, y)| of(*x, *y)).map(|(x, y)| u64::from(image.pixel(x, y)[1])).sum::<u64>()
        };
        [sum(&|x, _| x < 80), sum(&|x, _| x >= 80), sum(&|_, y| y < 60), sum(&|_, y| y >= 60)]
    };
    let [left, right, ..] = halves([-60.0, 0.0]);
    assert!(left * 4 > right * 5, "{left} {right}");
    let [left, right, ..] = halves([60.0, 0.0]);
    assert!(right * 4 > left * 5, "{left} {right}");
    let [.., top, bottom] = halves([0.0, 60.0]);
    assert!(top * 4 > bottom * 5, "{top} {bottom}");
}

/// A quarter of a turn is the same picture, turned.
#[test]
fn roll_turns_the_picture() {
    let model = models::isosurface();
    let mut viewer = open(&model, PLENTY);
    let camera = viewer.framing();
    let square = [96, 96];
    let (upright, _) = ids(&mut viewer, &exact(camera, square, 1.0));
    for (degrees, place) in [
        (90.0, (|x, y| (95 - y, x)) as fn(usize, usize) -> (usize, usize)),
        (-90.0, |x, y| (y, 95 - x)),
        (180.0, |x, y| (95 - x, 95 - y)),
    ] {
        let (rolled, _) = ids(&mut viewer, &exact(camera.rolled(degrees), square, 1.0));
        let same = (0..96 * 96).filter(|at| {
            let (x, y) = place(at % 96, at / 96);
            rolled.pixels[*at] == upright.pixels[y * 96 + x]
        });
        let same = same.count();
        assert!(same > 96 * 96 * 97 / 100, "{degrees}: {same} of {} pixels", 96 * 96);
    }
    assert_eq!(camera.rolled(0.0), camera);
}
