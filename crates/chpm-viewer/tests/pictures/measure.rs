//! Measured points are on the source, however coarse the picture is.

use crate::models::Model;
use crate::screen::{PLENTY, exact, open};
use chpm_mesh::TriMesh;
use chpm_refine::Camera;
use chpm_synth::hand;
use chpm_viewer::{FrameRequest, headless};

const VIEWPORT: [u32; 2] = [160, 120];

/// A sheet with noise, as a scan has it.
fn noisy() -> TriMesh {
    let mut sheet = hand::grid(60, 60);
    for (vertex, position) in sheet.positions.iter_mut().enumerate() {
        let noise = (vertex as u32).wrapping_mul(2_654_435_761) >> 16;
        position[2] = 1.5 * noise as f32 / 65_536.0;
    }
    sheet
}

/// How far above a point of the plane the mesh is.
fn height(mesh: &TriMesh, [x, y]: [f64; 2]) -> f64 {
    let heights = mesh.triangles.iter().filter_map(|corners| {
        let [a, b, c] = corners.map(|corner| mesh.positions[corner as usize].map(f64::from));
        let area = |p: [f64; 2], q: [f64; 3], r: [f64; 3]| {
            (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1])
        };
        let all = area([a[0], a[1]], b, c);
        let shares = [area([x, y], b, c), area([x, y], c, a), area([x, y], a, b)].map(|share| share / all);
        let inside = shares.iter().all(|share| *share > -1e-6);
        inside.then(|| shares[0] * a[2] + shares[1] * b[2] + shares[2] * c[2])
    });
    heights.fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn a_mark_is_on_the_source_of_a_noisy_scan() {
    let mesh = noisy();
    let model = Model::of(&mesh, 128);
    let mut viewer = open(&model, PLENTY);
    let camera = Camera::looking([30.0, 20.0, 70.0], [30.0, 30.0, 0.0]);
    // So coarse that what is drawn may be off by more than the noise is high.
    let coarse = FrameRequest { wait: false, ..exact(camera, VIEWPORT, 16.0) };
    let (before, stats) = headless::image(&mut viewer, &coarse).expect("a picture");
    assert!(stats.triangles < mesh.triangles.len() as u64 / 4, "{}", stats.triangles);
    let mut seen = 0;
    for pixel in [[80, 60], [40, 30], [120, 90], [70, 80]] {
        let Some(spot) = viewer.exact(&coarse, pixel).expect("a device") else { continue };
        let [x, y, z] = spot.point;
        let off = (height(&mesh, [x, y]) - z).abs();
        assert!(spot.error < 1e-4, "{spot:?}: a leaf has no error");
        assert!(off < 1e-5, "{pixel:?}: {spot:?} is {off} from the source");
        // In the middle of the pixel.
        let [right, up, forward] = camera.axes();
        let way = [0, 1, 2].map(|axis| spot.point[axis] - camera.position[axis]);
        let dot = |v: &[f64]| v.iter().zip(&way).map(|(a, b)| a * b).sum::<f64>();
        let depth = dot(forward.as_slice());
        let half = 60.0 / (0.5 * camera.fov.to_radians()).tan();
        let at = [80.0 + half * dot(right.as_slice()) / depth, 60.0 - half * dot(up.as_slice()) / depth];
        for axis in 0..2 {
            assert!((at[axis] - f64::from(pixel[axis]) - 0.5).abs() < 0.02, "{pixel:?} is met at {at:?}");
        }
        seen += 1;
    }
    assert!(seen >= 3, "{seen}");
    assert_eq!(viewer.exact(&coarse, [0, 0]).expect("a device"), None, "nothing is there");
    // The picture goes on as it was.
    let mut after = before.clone();
    for _ in 0..40 {
        after = headless::image(&mut viewer, &coarse).expect("a picture").0;
    }
    assert_eq!(after.size, before.size);
    let differ = after.pixels.iter().zip(&before.pixels).filter(|(a, b)| a != b).count();
    println!("{differ} of {} bytes differ afterwards", before.pixels.len());
}
