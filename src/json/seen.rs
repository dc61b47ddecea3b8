//! Pictures, and what selection does along a path.

use serde::Serialize;
#[cfg(feature = "viewer")]
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// `chpm walk --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Walk {
    /// `chpm-walk/1`
    pub(crate) schema: &'static str,
    /// Frames of the path
    pub(crate) frames: usize,
    /// Pixels of error that were allowed
    pub(crate) poe: f64,
    /// For each quantity of a frame: `triangles` that are drawn, `clusters` of the cut, `visible` ones inside the image, `splits` and `collapses` of groups,
    /// `pm_steps` (vertex splits and collapses), `refine_ms`, `pm_ms`, `check_ms` and `prefetch_ms` (milliseconds of selecting, playing meshes, checking
    /// pages, reading ahead), `requested_bytes`, `prefetched_bytes` and `resident_bytes` of pages, groups `withheld` from a split, `requested_runs` of
    /// pages side by side
    pub(crate) summary: BTreeMap<&'static str, Spread>,
}

/// A quantity over all frames.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Spread {
    /// Value that half of the frames do not exceed
    pub(crate) median: f64,
    /// Value that 95 % do not exceed
    pub(crate) p95: f64,
    /// The largest
    pub(crate) most: f64,
    /// The sum
    pub(crate) total: f64,
}

/// `chpm walk --render --json`. A run is the path with culling of what is hidden, or without.
#[cfg(feature = "viewer")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct WalkRender {
    /// `chpm-walk-render/1`
    pub(crate) schema: &'static str,
    /// Frames of the path
    pub(crate) frames: usize,
    /// Width and height, pixels
    pub(crate) viewport: [u32; 2],
    /// Pixels of error that were allowed
    pub(crate) poe: f64,
    /// Adapter that drew
    pub(crate) adapter: String,
    pub(crate) runs: Vec<Run>,
}

/// A path that was drawn.
#[cfg(feature = "viewer")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Run {
    /// Whether what is hidden was left out
    pub(crate) culling: bool,
    /// Frames a second of the whole run
    pub(crate) fps: f64,
    /// Means over the frames, of the columns of `--csv`
    pub(crate) mean: Map<String, Value>,
}

/// `chpm walk --render --prove --json`
#[cfg(feature = "viewer")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct WalkProve {
    /// `chpm-walk-prove/1`
    pub(crate) schema: &'static str,
    /// Frames of the path
    pub(crate) frames: u64,
    /// Pixels that were compared
    pub(crate) pixels: u64,
    /// Those that show another triangle with culling
    pub(crate) different: u64,
    /// The first frame with one
    pub(crate) first_different_frame: Option<usize>,
    /// Clusters that were hidden, over all frames
    pub(crate) occluded: u64,
    /// Clusters outside the image, likewise
    pub(crate) frustum_culled: u64,
    /// Adapter that drew
    pub(crate) adapter: String,
}

/// `chpm render --json`
#[cfg(feature = "viewer")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Render {
    /// `chpm-render/1`
    pub(crate) schema: &'static str,
    pub(crate) image: Size,
    /// Pictures that were drawn; what follows is of the first
    pub(crate) views: usize,
    /// Adapter that drew
    pub(crate) adapter: String,
    /// The camera of the first picture
    pub(crate) camera: Option<Camera>,
    /// Which direction is up, which side is shown, and why, in words, and what is not framed or not shown as high as it is; empty if `--up` and `--view` told so, `null` with `--camera`
    pub(crate) stance: Option<String>,
    pub(crate) frame: Frame,
}

/// `chpm render --rays --json`
#[cfg(feature = "viewer")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Still {
    /// `chpm-still/1`
    pub(crate) schema: &'static str,
    pub(crate) image: Size,
    /// Pictures that were taken; counts are of all of them
    pub(crate) views: usize,
    /// The camera of the first picture
    pub(crate) camera: Option<Camera>,
    /// As in `chpm-render/1`
    pub(crate) stance: Option<String>,
    /// Pixels of error that were allowed
    pub(crate) poe: f64,
    /// Rays from the eye
    pub(crate) camera_rays: u64,
    /// Those of them that met the model
    pub(crate) seen: u64,
    /// Rays to lights
    pub(crate) shadow_rays: u64,
    /// Rays for the light from all around
    pub(crate) occlusion_rays: u64,
    /// Triangles of the meshes that rays came to, each counted once
    pub(crate) triangles: u64,
    /// Pages that were read for them, as often as they were read
    pub(crate) pages: u64,
    /// Their bytes in the file
    pub(crate) page_bytes: u64,
    /// Different ones of them
    pub(crate) pages_different: u64,
    /// Time of all pictures
    pub(crate) milliseconds: f64,
}

/// A size in pixels.
#[cfg(feature = "viewer")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Size {
    /// Pixels; of all of a contact sheet
    pub(crate) width: u32,
    /// Pixels
    pub(crate) height: u32,
}

/// A camera.
#[cfg(feature = "viewer")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Camera {
    /// Where the picture was taken from, in the model's coordinates
    pub(crate) position: [f64; 3],
    /// Point in its middle
    pub(crate) target: [f64; 3],
    /// Direction that is upward in it
    pub(crate) up: [f64; 3],
    /// Angle between its lower and its upper edge, degrees
    pub(crate) fov: f64,
}

/// A frame.
#[cfg(feature = "viewer")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Frame {
    /// Pixels of error of the picture; of two models, what follows is of both together
    pub(crate) poe: f64,
    /// Triangles that were drawn
    pub(crate) triangles: u64,
    /// Clusters of the cut
    pub(crate) clusters_active: u64,
    /// Those that were drawn
    pub(crate) clusters_drawn: u64,
    /// Those outside the image
    pub(crate) frustum_culled: u64,
    /// Those that are hidden
    pub(crate) occluded: u64,
    /// Those that came into sight
    pub(crate) newly_visible: u64,
    /// Boxes that were tested for being hidden
    pub(crate) tested: u64,
    /// Groups that were split
    pub(crate) splits: u64,
    /// Groups that were collapsed
    pub(crate) collapses: u64,
    /// Vertex splits and collapses
    pub(crate) pm_steps: u64,
    /// Groups that should be split and are not
    pub(crate) withheld: u64,
    /// Clusters without their sheets, for want of room or since those are damaged
    pub(crate) unpainted: u64,
    /// Pages in memory
    pub(crate) resident_bytes: u64,
    /// Data on the GPU
    pub(crate) gpu_bytes: u64,
    /// Data sent there
    pub(crate) uploaded_bytes: u64,
    /// Pages that were asked for
    pub(crate) requested_bytes: u64,
    /// Times that the frame waited for pages
    pub(crate) stalls: u64,
    /// Rounds of selecting, drawing and testing
    pub(crate) rounds: u64,
    /// Time of each part, milliseconds
    pub(crate) milliseconds: Map<String, Value>,
}
