//! Models much larger than what may be used.

use crate::models::{self, Model};
use crate::screen::{PLENTY, exact, open};
use chpm_mesh::Bytes;
use chpm_synth::Shape;
use chpm_viewer::{Accuracy, Budgets, FrameRequest, headless};

const VIEWPORT: [u32; 2] = [160, 120];

/// Ten times as large as both budgets, asked for more than fits, over orbit, dive and teleports, waiting or not.
#[test]
fn budgets_hold_on_every_frame() {
    let model = Model::synth(Shape::Isosurface, 60_000, 128);
    let file = model.open();
    let pages: u64 = file.clusters().iter().map(|cluster| u64::from(cluster.page_len)).sum();
    let budget = Bytes(pages / 10);
    let mut viewer = open(&model, Budgets { memory: budget, gpu_memory: budget });
    let (mut withheld, mut most) = (0, 0);
    for (frame, camera) in models::cameras(&file, 10).into_iter().enumerate() {
        for wait in [false, true] {
            let request = FrameRequest { wait, ..exact(camera, VIEWPORT, 0.3) };
            let (image, stats) = headless::image(&mut viewer, &request).expect("a picture");
            assert_eq!(image.size, VIEWPORT);
            assert!(stats.resident_bytes <= budget.0, "frame {frame}: {stats:?}");
            assert!(stats.gpu_bytes <= budget.0, "frame {frame}: {stats:?}");
            assert!(stats.triangles > 0 || stats.clusters_drawn == 0, "frame {frame}: {stats:?}");
            withheld += stats.withheld;
            most = most.max(stats.resident_bytes);
        }
    }
    assert!(withheld > 0, "not everything fits");
    // A page is larger than its block, so pages are what fills its budget.
    assert!(most > budget.0 / 4 * 3, "what may be used is used: {most} of {budget}");
}

/// Pages that have not come yet are replaced by what is coarser, and in the end the picture is what it would have been.
#[test]
fn a_view_that_rests_becomes_exact() {
    let model = models::wall();
    let budgets = Budgets { memory: Bytes::mib(64), gpu_memory: Bytes::mib(64) };
    let (mut moving, mut waiting) = (open(&model, budgets), open(&model, budgets));
    for camera in models::cameras(&model.open(), 3) {
        let request = exact(camera, VIEWPORT, 1.0);
        let (expected, _) = headless::image(&mut waiting, &request).expect("a picture");
        let patient = FrameRequest { wait: false, ..request };
        // Each frame brings pages or shows them. A thousand are many more than there are levels and pages.
        let exact =
            (0..1000).any(|_| headless::image(&mut moving, &patient).expect("a picture").0 == expected);
        assert!(exact, "{camera:?}");
    }
}

/// Where all pages are in memory, a camera that jumps has its picture at once, however many levels are between: one frame asks what is
/// seen of all of them, the next one has them; what the coarse mesh of the first hid wrongly takes one more.
#[test]
fn a_jump_takes_few_frames() {
    let model = models::isosurface();
    let levels = model.open().levels().len();
    let (mut jumping, mut waiting) = (open(&model, PLENTY), open(&model, PLENTY));
    let cameras = models::cameras(&model.open(), 4);
    for camera in &cameras {
        headless::image(&mut jumping, &exact(*camera, VIEWPORT, 0.5).without_culling()).expect("a picture");
    }
    let frames = cameras.iter().map(|camera| {
        let request = exact(*camera, VIEWPORT, 0.5);
        let (expected, _) = headless::image(&mut waiting, &request).expect("a picture");
        let coarse = exact(cameras[0], VIEWPORT, 1000.0).without_culling();
        headless::image(&mut jumping, &coarse).expect("a picture");
        let hasty = FrameRequest { wait: false, ..request };
        let picture = |_: &usize| headless::image(&mut jumping, &hasty).expect("a picture").0 == expected;
        (1..=1000).find(picture).expect("the same picture")
    });
    let frames: Vec<usize> = frames.collect();
    println!("{frames:?}");
    assert!(levels > 5 && frames.iter().all(|frames| *frames <= 4), "{levels} levels: {frames:?}");
}

/// A number of triangles is kept to, and used.
#[test]
fn triangles_are_as_many_as_allowed() {
    let model = models::isosurface();
    let mut viewer = open(&model, Budgets::default());
    let camera = viewer.framing();
    for limit in [1000, 3000, 6000] {
        let request = FrameRequest {
            accuracy: Accuracy::Triangles(limit),
            ..exact(camera, VIEWPORT, 1.0).without_culling()
        };
        let (_, stats) = headless::image(&mut viewer, &request).expect("a picture");
        assert!(stats.triangles <= limit + limit / 20, "{} of {limit}", stats.triangles);
        assert!(stats.triangles >= limit / 2, "{} of {limit}", stats.triangles);
    }
}
