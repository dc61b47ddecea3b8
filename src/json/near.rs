//! How near models are to each other.

use serde::Serialize;

/// A model of a question.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Model {
    /// The model as it was named
    pub(crate) path: String,
    /// Triangles of its source
    pub(crate) triangles: u64,
    /// Length of its file
    pub(crate) bytes: u64,
    /// Diagonal of its box
    pub(crate) diagonal: f64,
}

/// Answer to a question about a distance.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Answer {
    /// The sources are nowhere nearer
    pub(crate) least: f64,
    /// Somewhere they are as near; `null` where nothing was compared
    pub(crate) most: Option<f64>,
    /// Why the interval is not narrower: `decided` (as asked for), `exact` (at the sources' triangles), `stopped` (at a limit), `crowded` (memory)
    pub(crate) ended: &'static str,
    /// How much of the interval's width on either side arithmetic, poses and the single precision of the files take: no question makes that less
    pub(crate) rounding: f64,
    /// Two points that are as near as `most` tells, up to `point_errors`: x, y, z on each model, where the poses put it
    pub(crate) points: Option<[[f64; 3]; 2]>,
    /// How far the source is from each as it is told, at most
    pub(crate) point_errors: Option<[f64; 2]>,
    /// Levels of the meshes that they are on; 0 is the source
    pub(crate) levels: Option<[u32; 2]>,
    /// Clusters that they are in
    pub(crate) clusters: Option<[u32; 2]>,
    /// Triangles of these, by their place in the page
    pub(crate) triangles: Option<[u32; 2]>,
    /// Pages that were read, of each model
    pub(crate) pages: [u64; 2],
    /// Their bytes in the files
    pub(crate) page_bytes: [u64; 2],
    /// Pairs of groups that were looked at
    pub(crate) pairs: u64,
}

/// `chpm distance --json`. One answer for each pose.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Distance {
    /// `chpm-distance/1`
    pub(crate) schema: &'static str,
    pub(crate) first: Model,
    pub(crate) second: Model,
    /// How wide an interval may be
    pub(crate) error: f64,
    pub(crate) answers: Vec<Answer>,
}

/// `chpm clearance --json`. One answer for each pose.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Clearance {
    /// `chpm-clearance/1`
    pub(crate) schema: &'static str,
    pub(crate) first: Model,
    pub(crate) second: Model,
    /// The distance that was asked for
    pub(crate) above: f64,
    pub(crate) answers: Vec<Verdict>,
}

/// An answer, and what follows from it.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Verdict {
    /// Whether the sources are farther apart; `null` where that is not known
    pub(crate) clear: Option<bool>,
    #[serde(flatten)]
    pub(crate) answer: Answer,
}

/// `chpm contacts A B --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Contacts {
    /// `chpm-contacts/1`
    pub(crate) schema: &'static str,
    pub(crate) first: Model,
    pub(crate) second: Model,
    /// The distance within which nothing is missed
    pub(crate) within: f64,
    /// How much farther what is told may be
    pub(crate) error: f64,
    #[serde(flatten)]
    pub(crate) step: Step,
}

/// `chpm contacts A B --path FILE --json`. One step for each pose.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ContactsPath {
    /// `chpm-contacts-path/1`
    pub(crate) schema: &'static str,
    pub(crate) first: Model,
    pub(crate) second: Model,
    /// The distance within which nothing is missed
    pub(crate) within: f64,
    /// How much farther what is told may be
    pub(crate) error: f64,
    pub(crate) steps: Vec<Step>,
}

/// Contacts of one pose.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Step {
    /// Whether nothing is missed; not where it was stopped at a limit
    pub(crate) complete: bool,
    /// Rounding of arithmetic, poses and the single precision of the files: what is told may be twice that farther than `within`, where it is more than `error`
    pub(crate) rounding: f64,
    /// Pairs of triangles that are near
    pub(crate) pairs: u64,
    /// Pages that were read, of each model
    pub(crate) pages: [u64; 2],
    /// Their bytes in the files
    pub(crate) page_bytes: [u64; 2],
    pub(crate) regions: Vec<Region>,
}

/// A region of contacts.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Region {
    /// The sources are nowhere nearer in this region
    pub(crate) least: f64,
    /// Somewhere in it they are as near
    pub(crate) most: f64,
    /// Two points that are as near as `most` tells, up to `point_errors`: x, y, z on each model
    pub(crate) points: [[f64; 3]; 2],
    /// How far the source is from each as it is told, at most
    pub(crate) point_errors: [f64; 2],
    /// Clusters that they are in
    pub(crate) clusters: [u32; 2],
    /// Triangles of these, by their place in the page
    pub(crate) nearest_triangles: [u32; 2],
    /// Triangles of each model in the region
    pub(crate) triangles: [u64; 2],
    /// Their area
    pub(crate) area: [f64; 2],
    /// How far triangles that meet reach behind each other, an estimate; 0 where none meet
    pub(crate) depth: f64,
    /// The coarsest level of its triangles, of each model; 0 is the source
    pub(crate) levels: [u32; 2],
    /// Smallest corner of a box about it
    pub(crate) low: [f64; 3],
    /// Largest corner
    pub(crate) high: [f64; 3],
}

/// `chpm contacts A --self --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ContactsSelf {
    /// `chpm-contacts-self/1`
    pub(crate) schema: &'static str,
    pub(crate) file: Model,
    /// Whether it came to the end
    pub(crate) complete: bool,
    /// Pairs of triangles that have a point in common and no vertex
    pub(crate) pairs: u64,
}

/// `chpm compare --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Compare {
    /// `chpm-compare/1`
    pub(crate) schema: &'static str,
    pub(crate) scan: Model,
    pub(crate) reference: Model,
    /// How far the size of each distance, of `mean`, `rms` and the percentiles may be from that of the sources, all rounding counted: what was asked for, or more where `rounding` leaves no room for it
    pub(crate) tolerance: f64,
    /// Which part of it arithmetic, poses and the single precision of both files take: no tolerance makes that less
    pub(crate) rounding: f64,
    /// Whether distances are negative behind the reference
    pub(crate) signed: bool,
    #[serde(flatten)]
    pub(crate) summary: CompareSummary,
    /// Shares within a tolerance; `null` without `--tolerance`
    pub(crate) pass: Option<Pass>,
}

/// `chpm thickness --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Thickness {
    /// `chpm-thickness/1`
    pub(crate) schema: &'static str,
    pub(crate) file: Model,
    /// Angle between the axis and the other rays, degrees
    pub(crate) cone: f64,
    /// Rays of each vertex
    pub(crate) rays: u64,
    /// Which components were taken the other way around: `auto`, `no` (none) or `yes` (all)
    pub(crate) inside_out: Option<String>,
    /// With `auto`: components of the source; 1 where there are too many to tell apart
    pub(crate) components: Option<u64>,
    /// Those of them that were found to be turned inside out
    pub(crate) components_turned: Option<u64>,
    /// Vertices behind which there is nothing, which are in no other number
    pub(crate) open: u64,
    /// Statistics of the others: here each distance is a thickness
    #[serde(flatten)]
    pub(crate) summary: CompareSummary,
    /// Reads of pages
    pub(crate) pages: u64,
}

/// `chpm visible --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Visible {
    /// `chpm-visible/1`
    pub(crate) schema: &'static str,
    pub(crate) file: Model,
    /// Vertices of the leaves
    pub(crate) vertices: u64,
    /// The points
    pub(crate) from: Vec<[f64; 3]>,
    /// Vertices by the number of points that they are seen from, from 0 on
    pub(crate) histogram: Vec<u64>,
    /// Reads of pages
    pub(crate) pages: u64,
}

/// Distances of all vertices of a scan.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct CompareSummary {
    /// Vertices that were measured: those of the scan's leaves
    pub(crate) vertices: u64,
    /// Least distance; `null` where there are no vertices
    pub(crate) min: Option<f64>,
    /// Largest distance; `null` where there are no vertices
    pub(crate) max: Option<f64>,
    /// Mean distance; `null` where there are no vertices
    pub(crate) mean: Option<f64>,
    /// Root mean square; `null` where there are no vertices
    pub(crate) rms: Option<f64>,
    pub(crate) percentiles: Option<Percentiles>,
    /// Distances of the first and the last colour
    pub(crate) range: [f64; 2],
    /// Vertices by distance, in bins of one width over the range
    pub(crate) histogram: Vec<u64>,
    /// Vertices below the range, which are in no bin
    pub(crate) below: u64,
    /// Vertices above it
    pub(crate) above: u64,
}

/// Sizes of distances that so many percent of the vertices do not exceed.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Percentiles {
    /// The size of distance that 50 % of the vertices do not exceed
    pub(crate) p50: f64,
    /// 90 %
    pub(crate) p90: f64,
    /// 95 %
    pub(crate) p95: f64,
    /// 99 %
    pub(crate) p99: f64,
    /// 99.9 %
    pub(crate) p99_9: f64,
}

/// Shares within a tolerance.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Pass {
    /// The tolerance
    pub(crate) tolerance: f64,
    /// The part of the vertices that is certainly within, from 0 to 1
    pub(crate) share: f64,
    /// These
    pub(crate) within: u64,
    /// Vertices that are certainly farther
    pub(crate) beyond: u64,
    /// Vertices so near to the tolerance that rounding decides
    pub(crate) undecided: u64,
}
