//! What a device refuses, and a device that goes, are errors that name the adapter and a remedy.

use crate::models;
use crate::screen::{PLENTY, exact};
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
