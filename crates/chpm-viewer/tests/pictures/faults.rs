//! Refusals and the loss of a device are errors that name the adapter and a remedy.

use crate::models;
use crate::screen::{PLENTY, exact, open};
use chpm_format::Chpm;
use chpm_viewer::{AdapterChoice, FrameRequest, Gpu, Viewer, ViewerError, headless};
use std::sync::Arc;

/// A device of its own: what it complains of stays.
fn viewer() -> (Arc<Gpu>, Viewer) {
    let gpu = Arc::new(Gpu::headless(&AdapterChoice::Software).expect("a device"));
    let viewer = Viewer::open(Arc::clone(&gpu), &models::triangle().path(), PLENTY).expect("a viewer");
    (gpu, viewer)
}

fn tells(error: &ViewerError, gpu: &Gpu, what: &str) {
    assert!(matches!(error, ViewerError::Device { .. }), "{error:?}");
    let told = error.to_string();
    for part in [gpu.describe().as_str(), what, "WGPU_BACKEND", "another adapter"] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert!(!told.contains('\n'), "{told}");
}

/// More bytes than any buffer may have.
fn too_large(gpu: &Gpu) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("too large"),
        size: 1 << 60,
        usage: wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

#[test]
fn what_is_refused_at_once_names_what_was_asked() {
    let (gpu, mut viewer) = viewer();
    let error = gpu.attempt("making a shader", || gpu.shader(&["no shader"])).expect_err("no shader");
    tells(&error, &gpu, "making a shader");
    let error = gpu.attempt("taking memory", || too_large(&gpu)).expect_err("no memory");
    tells(&error, &gpu, "taking memory");
    // It was told once, and all is well.
    let request = exact(viewer.framing(), [32, 32], 1.0);
    headless::image(&mut viewer, &request).expect("a picture");
}

#[test]
fn what_is_refused_meanwhile_is_the_error_of_the_frame() {
    let (gpu, mut viewer) = viewer();
    let request = exact(viewer.framing(), [32, 32], 1.0);
    headless::image(&mut viewer, &request).expect("a picture");
    too_large(&gpu);
    for wait in [true, false] {
        let error = headless::image(&mut viewer, &FrameRequest { wait, ..request }).expect_err("refused");
        tells(&error, &gpu, "too large");
    }
}

/// A page that is damaged costs the detail below its group, and nothing else; who waits for all of it is told.
#[test]
fn a_damaged_page_keeps_the_rest_on_screen() {
    let model = models::Model::synth(chpm_synth::Shape::Terrain, 8000, 256);
    let file = Chpm::open(std::fs::read(model.path()).expect("a file")).expect("a file");
    let leaf = file.clusters().iter().find(|cluster| cluster.level == 0 && !cluster.is_root());
    let at = leaf.expect("a leaf").page_offset as usize + 64;
    drop(file);
    let mut bytes = std::fs::read(model.path()).expect("a file");
    bytes[at] ^= 0xff;
    std::fs::write(model.path(), bytes).expect("written");

    let mut viewer = open(&model, PLENTY);
    let all = exact(viewer.framing(), [64, 64], 0.01);
    let request = FrameRequest { wait: false, ..all };
    let mut triangles = 0;
    for _ in 0..100 {
        let (_, stats) = headless::image(&mut viewer, &request).expect("a picture");
        triangles = stats.triangles;
        if viewer.damage().is_some() && stats.withheld > 0 && stats.splits == 0 && triangles > 4000 {
            break;
        }
    }
    assert!((4001..8000).contains(&triangles), "{triangles} are drawn");
    let damage = viewer.damage().expect("it is told").to_string();
    assert!(damage.contains("cluster") || damage.contains("page"), "{damage}");
    assert!(headless::image(&mut viewer, &all).is_err());
}

#[test]
fn a_device_that_goes_is_an_error() {
    for wait in [true, false] {
        let (gpu, mut viewer) = viewer();
        let request = FrameRequest { wait, ..exact(viewer.framing(), [32, 32], 1.0) };
        headless::image(&mut viewer, &request).expect("a picture");
        gpu.device.destroy();
        let error = headless::image(&mut viewer, &request).expect_err("no device");
        tells(&error, &gpu, "lost");
        assert!(viewer.pick([16, 16]).is_err());
    }
}
