//! Report of a build: stages, levels, repairs, sizes.

use crate::progress::Stage;
use chpm_qem::Refusals;
use serde::{Deserialize, Serialize};
use std::fmt;

/// One row of the stage table.
#[derive(Clone, Debug)]
pub struct StageReport {
    /// The stage.
    pub stage: Stage,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Seconds of the process's processors meanwhile, where the system tells; builds side by side in one process count one another's.
    pub processor_seconds: Option<f64>,
    /// Peak resident memory of the process up to the stage's end, bytes, where the system tells.
    pub peak_resident: Option<u64>,
    /// Bytes of the memory budget that were in use at the stage's end.
    pub budget_used: u64,
}

/// One level of the hierarchy.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct LevelReport {
    /// Height above the leaves.
    pub level: u32,
    /// Clusters of the level.
    pub clusters: u32,
    /// Vertices of the finest meshes, shared ones counted in each cluster.
    pub vertices: u64,
    /// Vertices of the base meshes.
    pub base_vertices: u64,
    /// Triangles of the finest meshes.
    pub triangles: u64,
    /// Triangles of the base meshes.
    pub base_triangles: u64,
    /// Vertices that are locked since another cluster shares them.
    pub shared_vertices: u64,
    /// Clusters that ended above their target.
    pub stalled: u32,
    /// Collapses that changed the topology or turned a face over.
    pub forced: u64,
    /// Least error of a finest mesh.
    pub min_error: f32,
    /// Largest error of a base mesh.
    pub max_error: f32,
    /// Largest gap of a group: how far what has vanished may be from the nearest vertex that is drawn.
    pub max_gap: f32,
    /// Largest deviation of the normals, degrees; 0 without normals.
    pub normal_deviation: f32,
    /// Largest deviation of a colour's channel, of 255; 0 without colours.
    pub color_deviation: f32,
    /// Collapses refused, by reason.
    pub refusals: Refusals,
}

/// Defects of the source that were built anyway, or left out.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct Repairs {
    /// Triangles left out since two corners are one vertex, and faces of fewer than three corners.
    pub degenerate_faces: u64,
    /// Triangles kept although they have no area.
    pub zero_area_faces: u64,
    /// Triangles left out since another has the same three vertices in the same turn.
    pub merged_copies: u64,
    /// Triangles kept although another has the same three vertices, since their turn is the other way: two sides of a sheet.
    pub two_sided_faces: u64,
    /// Faces of more than three corners, split into triangles.
    pub polygons_triangulated: u64,
    /// Faces left out for an invalid index or vertex (`--drop-invalid`).
    pub dropped_faces: u64,
    /// Vertices left out for a coordinate that is no number (`--drop-invalid`).
    pub dropped_vertices: u64,
    /// Faces that the header announces and the body lacks (`--drop-invalid`).
    pub missing_faces: u64,
    /// Components left out since they are smaller than `--min-component`; none if that was not given.
    pub small_components: Option<SmallComponents>,
    /// Vertices that no triangle uses; left out.
    pub unreferenced_vertices: u64,
    /// Edges with one face: open boundary.
    pub boundary_edges: u64,
    /// Edges with more than two faces.
    pub non_manifold_edges: u64,
    /// Edges whose two faces run through them in the same direction.
    pub mixed_winding_edges: u64,
    /// Vertices whose faces form more than one fan.
    pub non_manifold_vertices: u64,
    /// Boundary curves that hang together.
    pub boundary_loops: u64,
    /// Connected components.
    pub components: u64,
}

/// Components that were left out, and their triangles.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct SmallComponents {
    /// How many.
    pub components: u64,
    /// Triangles of all of them.
    pub triangles: u64,
}

impl Repairs {
    /// Names and counts as they are stored in the file; those of small components where they were left out.
    pub fn describe(&self) -> Vec<(String, u64)> {
        let small = self.small_components.map(|small| {
            [("small-components", small.components), ("small-component-triangles", small.triangles)]
        });

        [
            ("degenerate-faces", self.degenerate_faces),
            ("zero-area-faces", self.zero_area_faces),
            ("merged-copies", self.merged_copies),
            ("two-sided-faces", self.two_sided_faces),
            ("polygons-triangulated", self.polygons_triangulated),
            ("dropped-faces", self.dropped_faces),
            ("dropped-vertices", self.dropped_vertices),
            ("missing-faces", self.missing_faces),
            ("unreferenced-vertices", self.unreferenced_vertices),
            ("boundary-edges", self.boundary_edges),
            ("non-manifold-edges", self.non_manifold_edges),
            ("mixed-winding-edges", self.mixed_winding_edges),
            ("non-manifold-vertices", self.non_manifold_vertices),
            ("boundary-loops", self.boundary_loops),
            ("components", self.components),
        ]
        .into_iter()
        .chain(small.into_iter().flatten())
        .map(|(name, count)| (name.to_owned(), count))
        .collect()
    }
}

/// How far a build has come, as the last checkpoint has it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Reached {
    /// A stage is done.
    Stage(Stage),
    /// Groups of a level are simplified, and all levels below.
    Groups {
        /// The level.
        level: u32,
        /// Groups that are done.
        done: u64,
        /// Groups of the level.
        of: u64,
    },
}

impl fmt::Display for Reached {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reached::Stage(stage) => write!(f, "{stage}"),
            Reached::Groups { level, done, of } => write!(f, "{done} of {of} groups of level {level}"),
        }
    }
}

/// Results that a build took over from an earlier one, each kind by how many there are.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct TakenOver {
    /// Regions, and of how many.
    pub regions: [u64; 2],
    /// Groups of clusters, and of how many.
    pub groups: [u64; 2],
}

impl fmt::Display for TakenOver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [[regions, all_regions], [groups, all_groups]] = [self.regions, self.groups];
        write!(
            f,
            "as before: {regions} of {all_regions} regions, {groups} of {all_groups} groups of clusters"
        )
    }
}

/// Report of a build.
#[derive(Clone, Debug)]
pub struct BuildReport {
    /// Vertices that the source declares.
    pub source_vertices: u64,
    /// Triangles of the source that were built.
    pub triangles: u64,
    /// Bytes of the source.
    pub source_len: u64,
    /// Bytes of the output.
    pub output_len: u64,
    /// Clusters of all levels.
    pub clusters: u32,
    /// Clusters without a parent: one, unless a merge would not fit 16-bit indices or exceed the target error.
    pub roots: u32,
    /// The stage table.
    pub stages: Vec<StageReport>,
    /// The levels, leaves first.
    pub levels: Vec<LevelReport>,
    /// Defects and repairs.
    pub repairs: Repairs,
    /// Losses, in words.
    pub warnings: Vec<String>,
    /// Where the build went on, if it did not start from the beginning.
    pub resumed: Option<Reached>,
    /// Results taken over from an earlier build, if there was one to take from.
    pub taken_over: Option<TakenOver>,
    /// Step that all coordinates are multiples of, if positions were put on a lattice.
    pub lattice_step: Option<f64>,
    /// Notes about earlier work, in words.
    pub notes: Vec<String>,
    /// Largest amount of the memory budget that was in use, bytes.
    pub budget_peak: u64,
    /// Peak resident memory of the process, bytes, where the system tells.
    pub peak_resident: Option<u64>,
}

impl BuildReport {
    /// Wall-clock seconds of all stages.
    pub fn seconds(&self) -> f64 {
        self.stages.iter().map(|s| s.seconds).sum()
    }
}
