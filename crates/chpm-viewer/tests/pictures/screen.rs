//! A device to draw with; there must be one.

use crate::models::Model;
use chpm_mesh::Bytes;
use chpm_refine::Camera;
use chpm_viewer::{
    Accuracy, AdapterChoice, Budgets, FrameRequest, Gpu, IdImage, Stats, Transform, Viewer, ViewerError,
    headless,
};
use std::sync::{Arc, LazyLock};

/// One device for all tests: opening one takes a third of a second.
static GPU: LazyLock<Arc<Gpu>> = LazyLock::new(|| {
    let gpu = Gpu::headless(&AdapterChoice::Software).unwrap_or_else(|error| {
        panic!("{error}; on Debian: apt-get install mesa-vulkan-drivers libvulkan1, and set XDG_RUNTIME_DIR")
    });
    Arc::new(gpu)
});

/// More than any model here needs.
pub(crate) const PLENTY: Budgets = Budgets { memory: Bytes::mib(512), gpu_memory: Bytes::mib(256) };

pub(crate) fn open(model: &Model, budgets: Budgets) -> Viewer {
    Viewer::open(Arc::clone(&GPU), &model.path(), budgets).expect("a viewer")
}

/// Several models, each put somewhere.
pub(crate) fn open_all(models: &[(&Model, Transform)], budgets: Budgets) -> Result<Viewer, ViewerError> {
    let paths: Vec<_> = models.iter().map(|(model, place)| (model.path(), *place)).collect();
    let paths: Vec<_> = paths.iter().map(|(path, place)| (path.as_path(), *place)).collect();
    Viewer::open_all(Arc::clone(&GPU), &paths, budgets)
}

/// An exact picture: all that is wanted is there.
pub(crate) fn exact(camera: Camera, viewport: [u32; 2], poe: f64) -> FrameRequest {
    FrameRequest { accuracy: Accuracy::PoE(poe), wait: true, ..FrameRequest::new(camera, viewport) }
}

pub(crate) fn ids(viewer: &mut Viewer, request: &FrameRequest) -> (IdImage, Stats) {
    headless::ids(viewer, request).expect("an item buffer")
}
