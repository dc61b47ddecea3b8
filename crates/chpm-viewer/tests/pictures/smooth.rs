//! Edges without stairs in frames that do not wait, as those of the window.

use crate::models::{self, Model};
use crate::screen::{PLENTY, exact, ids, open};
use chpm_refine::Camera;
use chpm_viewer::{Coloring, FrameRequest, Image, Look, Shading, headless};
use std::collections::BTreeMap;

const VIEWPORT: [u32; 2] = [160, 120];

fn hasty(camera: Camera, look: Look, samples: u32) -> FrameRequest {
    FrameRequest { wait: false, look, samples, ..exact(camera, VIEWPORT, 1.0) }
}

/// A frame in which nothing changes any more.
fn last(viewer: &mut chpm_viewer::Viewer, request: &FrameRequest) -> Image {
    let mut frames = (0..200).map(|_| headless::image(viewer, request).expect("a picture"));
    let at_rest = |stats: &chpm_viewer::Stats| stats.splits + stats.collapses + stats.newly_visible == 0;
    let (image, stats) = frames.by_ref().skip(40).find(|(_, stats)| at_rest(stats)).expect("a last frame");
    assert!(stats.triangles > 0);
    image
}

/// Pixels by colour.
fn colors(image: &Image) -> BTreeMap<[u8; 4], usize> {
    let mut counts = BTreeMap::new();
    image.pixels.chunks_exact(4).for_each(|p| *counts.entry([p[0], p[1], p[2], p[3]]).or_insert(0) += 1);
    counts
}

/// A triangle of one colour before another: along its edges there are the colours between.
#[test]
fn edges_have_what_is_between() {
    let model = models::triangle();
    let camera = Camera::looking([0.3, 0.4, 1.5], [0.4, 0.3, 0.0]);
    for wireframe in [false, true] {
        let look =
            Look { wireframe, background: [1.0, 1.0, 1.0], colors: Coloring::Plain, ..Look::default() };
        let mut viewer = open(&model, PLENTY);
        let hard = last(&mut viewer, &hasty(camera, look, 1));
        let smooth = last(&mut viewer, &hasty(camera, look, 4));
        let is_bare = |image: &Image| colors(image).get(&[255; 4]).copied().unwrap_or(0);
        // Between the triangle and what is behind it; of wires, some are anyway.
        let between = |image: &Image| colors(image).len();
        println!(
            "{wireframe}: {} and {} colours, {} and {} bare",
            between(&hard),
            between(&smooth),
            is_bare(&hard),
            is_bare(&smooth)
        );
        assert!(is_bare(&hard) > 1000 && is_bare(&smooth) < is_bare(&hard), "edges reach further");
        assert!(between(&smooth) >= between(&hard) + 3, "{:?}", colors(&smooth));
        // Away from edges nothing changes.
        let differ =
            hard.pixels.chunks_exact(4).zip(smooth.pixels.chunks_exact(4)).filter(|(a, b)| a != b).count();
        assert!((20..1200).contains(&differ), "{differ} pixels differ");
    }
}

/// Two-sided, lit smoothly or not: a frame of several samples is near the mean of many.
#[test]
fn a_smooth_frame_is_near_the_mean_of_many() {
    let model = models::isosurface();
    let mut viewer = open(&model, PLENTY);
    let camera = viewer.framing();
    for shading in [Shading::Flat, Shading::Smooth] {
        let look = Look { shading, colors: Coloring::Plain, ..Look::default() };
        let (mean, _) = headless::image(&mut viewer, &FrameRequest { wait: true, ..hasty(camera, look, 32) })
            .expect("a picture");
        let far = |image: &Image| {
            let off = image.pixels.iter().zip(&mean.pixels).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
            (off.sum::<f64>() / image.pixels.len() as f64).sqrt()
        };
        let (hard, smooth) = (
            far(&last(&mut viewer, &hasty(camera, look, 1))),
            far(&last(&mut viewer, &hasty(camera, look, 4))),
        );
        println!("{shading:?}: {hard} and {smooth}");
        // In OpenGL, Mesa's software adapter has one depth for all samples of a pixel.
        assert!(smooth < 0.85 * hard, "{shading:?}: {smooth} is not much nearer than {hard}");
    }
}

/// Picking, culling and the item buffer are those of hard edges.
#[test]
fn nothing_but_the_picture_differs() {
    let model: Model = models::wall();
    let (mut hard, mut smooth) = (open(&model, PLENTY), open(&model, PLENTY));
    let mut seen = 0;
    for camera in models::cameras(&model.open(), 3) {
        let requests = [1, 4].map(|samples| hasty(camera, Look::default(), samples));
        let (a, b) = (last(&mut hard, &requests[0]), last(&mut smooth, &requests[1]));
        for pixel in [[80, 60], [20, 30], [140, 100], [81, 7]] {
            let [one, other] = [&hard, &smooth].map(|viewer| viewer.pick(pixel).expect("a depth"));
            assert_eq!(one, other, "{pixel:?} of {camera:?}");
            seen += usize::from(one.is_some());
        }
        assert_eq!(a.size, b.size);
        let item = |viewer, request: &FrameRequest| ids(viewer, request);
        let ((one, one_stats), (other, other_stats)) =
            (item(&mut hard, &requests[0]), item(&mut smooth, &requests[1]));
        assert!(one == other, "{camera:?}");
        assert_eq!(one_stats.occluded, other_stats.occluded);
    }
    assert!(seen > 10, "{seen}");
}
