//! The item-buffer test: with every triangle in a colour of its own, culling changes no pixel.

use crate::models::{self, Model};
use crate::screen::{PLENTY, exact, ids, open};
use chpm_refine::Camera;
use chpm_viewer::{FrameRequest, IdImage, Look, headless};

const VIEWPORT: [u32; 2] = [160, 120];

/// How many clusters were left out over a path.
#[derive(Default, Debug)]
struct LeftOut {
    hidden: u64,
    outside: u64,
}

/// Follows a path with culling, from frame to frame, and draws each frame anew without it.
fn nothing_is_missing(model: &Model, each: usize, poe: f64) -> LeftOut {
    let cameras = models::cameras(&model.open(), each);
    let (mut culled, mut all) = (open(model, PLENTY), open(model, PLENTY));
    let mut left_out = LeftOut::default();
    let mut seen = 0;
    for (frame, camera) in cameras.into_iter().enumerate() {
        let request = exact(camera, VIEWPORT, poe);
        let (got, stats) = ids(&mut culled, &request);
        let (expected, complete) = ids(&mut all, &request.without_culling());
        assert_eq!(complete.occluded + complete.frustum_culled, 0);
        same(&got, &expected, frame, &request);
        left_out.hidden += stats.occluded;
        left_out.outside += stats.frustum_culled;
        seen += got.pixels.iter().flatten().count();
    }
    assert!(seen > 0, "something was seen");
    left_out
}

fn same(got: &IdImage, expected: &IdImage, frame: usize, request: &FrameRequest) {
    let differ: Vec<usize> =
        (0..got.pixels.len()).filter(|place| got.pixels[*place] != expected.pixels[*place]).collect();
    if let Some(first) = differ.first() {
        let [width, _] = got.size;
        panic!(
            "frame {frame}: {} pixels differ; first at {}, {}: {:?} with culling, {:?} without; {:?}",
            differ.len(),
            first % width as usize,
            first / width as usize,
            got.pixels[*first],
            expected.pixels[*first],
            request.camera
        );
    }
}

#[test]
fn shells_hide_shells() {
    let left_out = nothing_is_missing(&models::shells(), 8, 1.0);
    assert!(left_out.hidden > 100 && left_out.outside > 100, "{left_out:?}");
}

#[test]
fn a_wall_hides_what_is_behind_it() {
    let left_out = nothing_is_missing(&models::wall(), 8, 1.0);
    assert!(left_out.hidden > 100 && left_out.outside > 100, "{left_out:?}");
}

#[test]
fn hills_hide_valleys() {
    let left_out = nothing_is_missing(&models::terrain(), 8, 1.0);
    assert!(left_out.outside > 100, "{left_out:?}");
}

#[test]
fn a_surface_hides_itself() {
    let left_out = nothing_is_missing(&models::isosurface(), 8, 0.5);
    assert!(left_out.hidden > 100 && left_out.outside > 100, "{left_out:?}");
}

#[test]
fn far_from_the_zero_point_too() {
    let left_out = nothing_is_missing(&models::far_away(), 6, 1.0);
    assert!(left_out.hidden > 50 && left_out.outside > 50, "{left_out:?}");
}

#[test]
fn a_single_triangle_is_seen() {
    nothing_is_missing(&models::triangle(), 4, 1.0);
}

/// The same for a mesh that is as coarse as it gets, and for one that is the source.
#[test]
fn whatever_the_accuracy() {
    let model = models::wall();
    for poe in [0.0, 50.0] {
        nothing_is_missing(&model, 3, poe);
    }
}

/// Back sides that are left out hide nothing, wherever the camera is.
#[test]
fn back_sides_hide_nothing_where_they_are_left_out() {
    let model = models::shells();
    let (mut culled, mut all) = (open(&model, PLENTY), open(&model, PLENTY));
    let look = Look { one_sided: true, ..Look::default() };
    // Outside, between the first two shells and looking inward and along them, and within all.
    let from = [[0.0, 0.0, 3.0], [0.0, 0.0, 0.9], [0.9, 0.0, 0.0], [0.0, 0.0, 0.1]];
    let shown = from.map(|position| {
        let camera = Camera::looking(position, [0.05, 0.02, 0.0]);
        let request = FrameRequest { look, ..exact(camera, VIEWPORT, 1.0) };
        let (got, _) = headless::image(&mut culled, &request).expect("a picture");
        let (expected, _) = headless::image(&mut all, &request.without_culling()).expect("a picture");
        assert!(got == expected, "from {position:?}");
        got.pixels.chunks_exact(4).filter(|pixel| *pixel != &got.pixels[..4]).count()
    });
    assert!(shown[..3].iter().all(|pixels| *pixels > 0) && shown[3] == 0, "{shown:?}");
}

/// Frames that do not wait leave much open, and a camera may jump at any moment: what is known of visibility then is old or none.
#[test]
fn whatever_was_drawn_before() {
    let model = models::wall();
    let cameras = models::cameras(&model.open(), 5);
    let (mut culled, mut all) = (open(&model, PLENTY), open(&model, PLENTY));
    // From everywhere to everywhere, each place once: 7 and the number of cameras have no divisor in common.
    assert_eq!(cameras.len(), 15);
    for frame in 0..cameras.len() {
        let camera = cameras[(7 * frame + 3) % cameras.len()];
        for before in 0..frame % 4 {
            let camera = cameras[(11 * frame + before) % cameras.len()];
            let hasty = FrameRequest { wait: false, ..exact(camera, VIEWPORT, 0.5) };
            headless::image(&mut culled, &hasty).expect("a picture");
        }
        let poe = [1.0, 0.3, 4.0][frame % 3];
        let request = exact(camera, VIEWPORT, poe);
        let expected = ids(&mut all, &request.without_culling()).0;
        same(&ids(&mut culled, &request).0, &expected, frame, &request);
    }
}
