//! How two models lie to each other: what is asked beside the pictures, and answered by whoever knows.

use crate::transform::Transform;
use crate::window::desk::Desk;
use std::path::PathBuf;
use std::sync::Arc;

/// A second model in the window.
pub struct Second {
    /// A CHPM.
    pub model: PathBuf,
    /// Where the first one is.
    pub first: Transform,
    /// Where this one is, step by step; one at least.
    pub steps: Vec<Transform>,
    /// Who knows about both.
    pub relate: Arc<dyn Relate>,
}

/// Answers questions about two models.
pub trait Relate: Send + Sync {
    /// Answers what is asked at a desk until it is closed, on a thread of its own. Of one step there may be many answers, each better than
    /// the one before.
    fn relate(&self, desk: &Desk<usize, Relation>);
}

/// Relation of two models at one step. Points are where their places put them.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Relation {
    /// The distance is proven to be between these; the second may be infinite.
    pub distance: [f64; 2],
    /// Two points that are as near as the second one tells, if any are known.
    pub ends: Option<[[f64; 3]; 2]>,
    /// Why it is not known better, or that it is as good as was asked for.
    pub state: String,
    /// Where the models come near, if that was asked for and is known.
    pub regions: Option<Regions>,
}

/// All places where two models come near.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Regions {
    /// How near.
    pub within: f64,
    /// The nearest first.
    pub all: Vec<Region>,
    /// Whether there may be more.
    pub complete: bool,
}

/// One of those.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Region {
    /// A box about it.
    pub low: [f64; 3],
    /// Its largest corner.
    pub high: [f64; 3],
    /// The two nearest points.
    pub ends: [[f64; 3]; 2],
    /// The models' distance in it is proven to be between these.
    pub distance: [f64; 2],
    /// Area of each model.
    pub area: [f64; 2],
    /// Levels of the meshes that were looked at, of each model the coarsest.
    pub levels: [u32; 2],
}
