//! Documents about what was checked or measured.

use serde::Serialize;

/// `chpm verify --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Verify {
    /// `chpm-verify/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// Whether no fault was found
    pub(crate) sound: bool,
    /// Faults that were found
    pub(crate) fault_count: u64,
    /// The first of them, in words
    pub(crate) faults: Vec<String>,
    /// Clusters whose pages are sound; `null` if the file does not open
    pub(crate) clusters: Option<u64>,
    /// Triangles that were looked at; likewise
    pub(crate) triangles: Option<u64>,
    /// Whether detail of the source was left out when the file was built
    pub(crate) trimmed: bool,
    /// The file of `--same-as` as it was named; `null` without
    pub(crate) same_as: Option<String>,
    /// `null` without `--against`
    pub(crate) against: Option<Against>,
    /// `null` without `--errors`, and where the leaves are not the source's triangles
    pub(crate) errors: Option<Errors>,
    /// `null` without `--cuts`
    pub(crate) cuts: Option<Cuts>,
}

/// The leaves beside the source.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Against {
    /// The source as it was named
    pub(crate) source: Option<String>,
    /// Whether the leaves are its triangles
    pub(crate) equal: bool,
    /// Triangles of the leaves
    pub(crate) leaf_triangles: u64,
    /// Triangles of the source, without those of small components
    pub(crate) source_triangles: u64,
    /// Copies of triangles that the build left out
    pub(crate) copies_left_out: u64,
    /// Components that it left out, smaller than `--min-component`
    pub(crate) small_components_left_out: u64,
    /// Their triangles
    pub(crate) small_component_triangles_left_out: u64,
}

/// Proofs of stored errors.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Errors {
    /// By how much what holds may be beyond what is stored, at most: rounding of the proof
    pub(crate) slack: f64,
    /// How far the source may be from its triangles as singles hold them; the intervals allow for it
    pub(crate) rounding: f64,
    /// Triangles with a point that is farther than what is stored, in all rows and both ways
    pub(crate) violations: u64,
    /// Triangles that are neither proven nor refuted
    pub(crate) undecided: u64,
    pub(crate) levels: Vec<OfLevel<Proven>>,
    pub(crate) cuts: Vec<OfCut<Proven>>,
    /// Of a file with remnants, for each level the cut within its largest error, with the remnants that it takes
    pub(crate) within: Vec<OfDistance<Proven>>,
}

/// A mesh of one level.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct OfLevel<T> {
    /// Level of the clusters
    pub(crate) level: u32,
    /// Share of their collapses that is done, 0 to 1
    pub(crate) collapsed: f64,
    #[serde(flatten)]
    pub(crate) found: T,
}

/// A mesh of one random cut.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct OfCut<T> {
    /// Seed of the cut; the rest as in `levels`
    pub(crate) seed: u64,
    #[serde(flatten)]
    pub(crate) found: T,
}

/// The mesh of the cut within a distance.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct OfDistance<T> {
    /// That distance; the rest as in `levels`
    pub(crate) within: f32,
    #[serde(flatten)]
    pub(crate) found: T,
}

/// Proofs about a mesh.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Proven {
    /// Clusters of the mesh
    pub(crate) clusters: u64,
    /// Its triangles
    pub(crate) triangles: u64,
    /// Largest stored error of them
    pub(crate) stored_error: f32,
    /// Largest stored distance of them
    pub(crate) stored_distance: f32,
    /// From the mesh to the source, which the errors bound
    pub(crate) of_mesh: ProvenSide,
    /// From the source to the mesh, which the distances bound
    pub(crate) of_source: ProvenSide,
}

/// Proofs in one direction.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ProvenSide {
    /// The largest true distance is at least this
    pub(crate) least: f64,
    /// A point that is so far: x, y, z
    pub(crate) at: Option<[f64; 3]>,
    /// And at most this; `null` where nothing is drawn
    pub(crate) most: f64,
    /// Triangles with a point that is farther than what is stored
    pub(crate) violations: u64,
    /// How far the worst of them is at least; `null` if there is none
    pub(crate) worst: Option<f64>,
    /// Stored value there
    pub(crate) worst_stored: Option<f64>,
    /// Where: x, y, z
    pub(crate) worst_at: Option<[f64; 3]>,
    /// Triangles that are neither proven nor refuted
    pub(crate) undecided: u64,
    /// Pieces that triangles were cut into
    pub(crate) pieces: u64,
}

/// Random cuts.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Cuts {
    /// Cuts that were looked at
    pub(crate) count: u32,
    /// Seed of the first
    pub(crate) seed: u64,
    /// Triangles of all of them
    pub(crate) triangles: u64,
    /// Cracks that were found
    pub(crate) fault_count: u64,
}

/// `chpm measure FILE --against SOURCE --json`. A row of `levels` or of `cuts` is one measured mesh.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Measure {
    /// `chpm-measure/2`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// The source as it was named
    pub(crate) source: String,
    /// Diagonal of the model's box
    pub(crate) diagonal: f64,
    /// Of the finer mesh
    pub(crate) samples_per_triangle: u32,
    /// Excess of a distance over a stored one that counts as rounding
    pub(crate) slack: f64,
    /// Components of the source that are smaller than the file's `--min-component`, and are not measured
    pub(crate) small_components_left_out: u64,
    /// Their triangles
    pub(crate) small_component_triangles_left_out: u64,
    pub(crate) levels: Vec<OfLevel<Measured>>,
    pub(crate) cuts: Vec<OfCut<Measured>>,
    /// Samples beyond what is stored, in all rows: of the source beyond the distance, of the mesh beyond the error
    pub(crate) violations: u64,
}

/// Samples of a mesh.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Measured {
    /// Clusters of the mesh
    pub(crate) clusters: u64,
    /// Its triangles
    pub(crate) triangles: u64,
    /// Largest stored error of them
    pub(crate) stored_error: f32,
    /// Largest stored distance of them: the error, or the gap of what has vanished
    pub(crate) stored_distance: f32,
    /// Largest distance, both ways
    pub(crate) max: f64,
    /// The larger mean of both ways
    pub(crate) mean: f64,
    /// The larger root mean square of both ways
    pub(crate) rms: f64,
    /// From the source to the mesh
    pub(crate) of_source: Side,
    /// From the mesh to the source
    pub(crate) of_mesh: Side,
    /// Stored by measured distance, over clusters; `null` if nothing was measured
    pub(crate) stored_by_measured: Option<Ratios>,
    pub(crate) vanished: Vanished,
    pub(crate) violations: Violations,
}

/// Distances in one direction.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Side {
    /// Largest distance
    pub(crate) max: f64,
    /// Where: x, y, z
    pub(crate) at: Option<[f64; 3]>,
    /// Mean distance
    pub(crate) mean: f64,
    /// Root mean square
    pub(crate) rms: f64,
    /// Samples
    pub(crate) samples: u64,
}

/// A spread over clusters.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Ratios {
    /// Clusters with a distance
    pub(crate) clusters: usize,
    /// The least
    pub(crate) min: f64,
    /// Value that half of the clusters do not exceed
    pub(crate) median: f64,
    /// Value that 95 % of the clusters do not exceed
    pub(crate) p95: f64,
    /// The largest
    pub(crate) max: f64,
}

/// Dropped components.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Vanished {
    /// Samples of the source that are farther than the error, and within the distance
    pub(crate) samples: u64,
    /// The farthest of them
    pub(crate) max: f64,
}

/// Samples beyond a promise.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Violations {
    /// Clusters with samples beyond what is stored
    pub(crate) clusters: u64,
    /// Such samples
    pub(crate) samples: u64,
    /// By how much the worst is beyond
    pub(crate) worst: Option<f64>,
    /// Where: x, y, z
    pub(crate) at: Option<[f64; 3]>,
}

/// `chpm measure A B --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct MeasureMeshes {
    /// `chpm-measure-meshes/1`
    pub(crate) schema: &'static str,
    pub(crate) first: Mesh,
    pub(crate) second: Mesh,
    /// Diagonal of the box around both
    pub(crate) diagonal: f64,
    /// Samples on each triangle at least
    pub(crate) samples_per_triangle: u32,
    /// From the first to the second
    pub(crate) forward: Side,
    /// From the second to the first
    pub(crate) backward: Side,
    /// The larger of both
    pub(crate) max: f64,
    /// The larger of both
    pub(crate) mean: f64,
    /// The larger of both
    pub(crate) rms: f64,
    /// Where the largest distance is: x, y, z
    pub(crate) at: Option<[f64; 3]>,
}

/// `chpm measure --texture --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct MeasureTexture {
    /// `chpm-measure-texture/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// The source as it was named
    pub(crate) source: String,
    /// Samples for each triangle
    pub(crate) samples_per_triangle: u32,
    /// From the finest mesh on
    pub(crate) levels: Vec<TextureOfLevel>,
}

/// Colours of a level.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct TextureOfLevel {
    pub(crate) level: u32,
    /// The part of the level's collapses that is applied
    pub(crate) collapsed: f64,
    pub(crate) triangles: u64,
    /// Samples where the source has a colour
    pub(crate) samples: u64,
    /// Half of them differ by no more, of 255
    pub(crate) median: f64,
    /// 95 of 100 differ by no more
    pub(crate) p95: f64,
    /// 99 of 100 differ by no more
    pub(crate) p99: f64,
    /// Peak signal-to-noise ratio, decibels; `null` where nothing differs
    pub(crate) psnr: Option<f64>,
    pub(crate) slide: Slide,
}

/// How far colours are from where the source has them.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Slide {
    /// Samples for which that is known
    pub(crate) samples: u64,
    /// Samples that show filled texels
    pub(crate) outside: u64,
    /// The largest, object units
    pub(crate) max: f64,
    /// The largest part of what stored errors allow
    pub(crate) of_bound: f64,
    /// Samples that are farther away than that
    pub(crate) beyond: u64,
}

/// A mesh of a comparison.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Mesh {
    /// The mesh as it was named
    pub(crate) path: String,
    /// Its triangles
    pub(crate) triangles: usize,
}
