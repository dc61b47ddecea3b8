//! Work of a frame, and the time of each part of it.

use std::ops::AddAssign;
use std::time::Duration;

/// Counts and times of one frame; where a frame waits, times and work are sums over all of its rounds.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Stats {
    /// Pixels of error that the frame was refined to.
    pub poe: f64,
    /// Triangles drawn, those of clusters that came into sight on the GPU as far as known.
    pub triangles: u64,
    /// Clusters of the cut.
    pub clusters_active: u64,
    /// Clusters drawn.
    pub clusters_drawn: u64,
    /// Clusters of the cut that lie outside the image.
    pub frustum_culled: u64,
    /// Clusters of the cut that are hidden.
    pub occluded: u64,
    /// Clusters that came into sight. Without waiting, those of the last frame whose answer has come.
    pub newly_visible: u64,
    /// Boxes that were tested for occlusion, of clusters and of groups.
    pub tested: u64,
    /// Groups that were split.
    pub splits: u64,
    /// Groups that were collapsed.
    pub collapses: u64,
    /// Vertex splits and collapses.
    pub pm_steps: u64,
    /// Groups that the view wants split and that are not, for want of pages or room.
    pub withheld: u64,
    /// Clusters drawn in the colours of their vertices although they have sheets: for want of room on the GPU, or since those are damaged.
    pub unpainted: u64,
    /// Pages in main memory or on their way, bytes.
    pub resident_bytes: u64,
    /// Clusters' data on the GPU, bytes.
    pub gpu_bytes: u64,
    /// Clusters' data sent to the GPU, bytes.
    pub uploaded_bytes: u64,
    /// Pages asked for, bytes.
    pub requested_bytes: u64,
    /// Times that a frame had to wait for pages.
    pub stalls: u64,
    /// Refine-draw-test rounds: one, unless the frame waits.
    pub rounds: u64,
    /// Maps of shadows that were drawn: none where the last one is still right.
    pub shadow_maps: u64,
    /// Clusters that throw shadows on what is seen.
    pub shadow_casters: u64,
    /// Triangles of the map, those of clusters in several of its parts several times.
    pub shadow_triangles: u64,
    /// Clusters that throw shadows are still being brought.
    pub shadows_withheld: bool,
    /// Where colours show levels or errors: the least (blue) and the most (red) of what is shown.
    pub scale: Option<[f32; 2]>,
    /// The last picture is still the right one, and was not drawn again.
    pub kept: bool,
    /// Tests of frames before whose answers have not come.
    pub unanswered: u64,
    /// How long the parts took.
    pub times: Times,
}

impl Stats {
    /// Goes on to a later step of the same frame: its counts, and the work of both.
    pub(crate) fn add_work(&mut self, step: &Stats) {
        let before = *self;
        *self = *step;
        self.newly_visible += before.newly_visible;
        self.shadow_maps += before.shadow_maps;
        self.tested += before.tested;
        self.splits += before.splits;
        self.collapses += before.collapses;
        self.pm_steps += before.pm_steps;
        self.uploaded_bytes += before.uploaded_bytes;
        self.requested_bytes += before.requested_bytes;
        self.stalls += before.stalls;
        self.rounds += before.rounds;
        self.times += before.times;
    }
}

/// Wall time of the parts of a frame. What the GPU does is counted where the frame waits for it.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Times {
    /// Selection: groups and positions, residency.
    pub refine: Duration,
    /// Positions of the progressive meshes, for the draws.
    pub pm: Duration,
    /// Sending clusters to the GPU.
    pub upload: Duration,
    /// Testing boxes, and taking in the answers.
    pub occlusion: Duration,
    /// Recording and submitting draws; with waiting, drawing them.
    pub draw: Duration,
    /// Waiting for pages.
    pub stall: Duration,
    /// All of the frame.
    pub total: Duration,
}

impl AddAssign for Times {
    fn add_assign(&mut self, other: Times) {
        self.refine += other.refine;
        self.pm += other.pm;
        self.upload += other.upload;
        self.occlusion += other.occlusion;
        self.draw += other.draw;
        self.stall += other.stall;
        self.total += other.total;
    }
}
