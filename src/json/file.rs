//! Builds, and what a file is.

use chpm_report::LevelRow;
use serde::Serialize;
use serde_json::{Map, Value};

/// `chpm build --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Build {
    /// `chpm-build/1`
    pub(crate) schema: &'static str,
    pub(crate) source: BuildSource,
    /// The file that was built
    pub(crate) output: String,
    /// Triangles of the finest meshes
    pub(crate) triangles: u64,
    /// Clusters of all levels
    pub(crate) clusters: u32,
    /// Clusters at the top
    pub(crate) roots: u32,
    /// Length of the file
    pub(crate) bytes: u64,
    /// Length by `triangles`
    pub(crate) bytes_per_triangle: f64,
    /// Wall-clock time
    pub(crate) seconds: f64,
    pub(crate) stages: Vec<Stage>,
    #[cfg_attr(test, schemars(with = "Vec<LevelKeys>"))]
    pub(crate) levels: Vec<LevelRow>,
    /// Findings in the source and changes to it, and how often; `small_components` and `small_component_triangles` with `--min-component` only
    pub(crate) repairs: Map<String, Value>,
    /// Remarks on what was left out or changed
    pub(crate) warnings: Vec<String>,
    /// Work of an earlier run, in words
    pub(crate) resumed_after: Option<String>,
    /// Step that all coordinates are multiples of; `null` where positions are exact
    pub(crate) lattice_step: Option<f64>,
    /// Remarks on the build, in words
    pub(crate) notes: Vec<String>,
    /// The most of the memory budget that was in use
    pub(crate) budget_peak_bytes: u64,
    /// The most memory of the process; `null` where the system does not tell
    pub(crate) peak_resident_bytes: Option<u64>,
}

/// The source of a build.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct BuildSource {
    /// The source as it was named
    pub(crate) path: String,
    /// Vertices in the source
    pub(crate) vertices: u64,
    /// Length of its files
    pub(crate) bytes: u64,
}

/// A stage of a build.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Stage {
    /// Name of a stage, in the order that they ran
    pub(crate) stage: String,
    /// Wall-clock time of it
    pub(crate) seconds: f64,
    /// Processor time of all its threads; `null` where the system does not tell
    pub(crate) processor_seconds: Option<f64>,
    /// The most memory of the process up to its end; `null` where the system does not tell
    pub(crate) peak_resident_bytes: Option<u64>,
    /// Bytes of the budget in use at its end
    pub(crate) budget_used_bytes: u64,
}

/// `chpm info --json`. `generator`, `source`, `settings`, `repairs` and `warnings` are `null` where a file's record of them cannot be read.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Info {
    /// `chpm-info/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// Version of the format, as in `1.0`
    pub(crate) version: String,
    /// The program that wrote the file
    pub(crate) generator: Option<String>,
    /// Triangles of the finest meshes
    pub(crate) triangles: u64,
    /// Vertices that they use
    pub(crate) vertices: u64,
    /// Whether vertices have normals
    pub(crate) normals: bool,
    /// `source`, or `computed` by the build; `null` without normals
    pub(crate) normals_from: Option<&'static str>,
    /// Whether vertices have colours
    pub(crate) colors: bool,
    pub(crate) scalars: Vec<InfoScalar>,
    /// Origin of stored positions: x, y, z
    pub(crate) origin: [f64; 3],
    pub(crate) r#box: Corners,
    /// Error of the coarsest mesh
    pub(crate) max_error: f32,
    /// The largest error or gap of any mesh; `null` for files of version 1.0, which do not tell what has vanished
    pub(crate) max_distance: Option<f32>,
    /// Components that vanish and can be drawn where they were
    pub(crate) remnants: usize,
    /// `certified bound` or `quadric estimate`
    pub(crate) error_kind: String,
    /// `dependencies` or `lock`
    pub(crate) boundary: String,
    pub(crate) counts: Counts,
    #[cfg_attr(test, schemars(with = "Vec<LevelKeys>"))]
    pub(crate) levels: Vec<LevelRow>,
    pub(crate) bytes: FileBytes,
    /// Files of pages beside the file, in their order; none where pages are in it
    pub(crate) volumes: Vec<InfoVolume>,
    /// Misses of a cache of vertices; with `--cache` only
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) vertex_cache: Option<VertexCache>,
    /// Facts of the source
    pub(crate) source: Option<InfoSource>,
    /// Settings of the build, as text
    pub(crate) settings: Option<Map<String, Value>>,
    /// As in `chpm-build/1`
    pub(crate) repairs: Option<Map<String, Value>>,
    /// As in `chpm-build/1`
    pub(crate) warnings: Option<Vec<String>>,
}

/// A file of pages.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct InfoVolume {
    /// Its name
    pub(crate) file: String,
    /// Its length
    pub(crate) bytes: u64,
}

/// A named scalar of the vertices.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct InfoScalar {
    /// A named scalar of the vertices, as the source calls it
    pub(crate) name: String,
    /// Type in the source: `int8`, `uint8`, `int16`, `uint16`, `int32`, `uint32`, `float32` or `float64`
    pub(crate) r#type: String,
    /// Its lowest value; `null` where that is infinite
    pub(crate) low: f64,
    /// Its highest value, likewise
    pub(crate) high: f64,
    /// Vertices with a value that is a number
    pub(crate) count: u64,
}

/// A box.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Corners {
    /// Smallest corner of the box around the model, relative to the origin
    pub(crate) min: [f32; 3],
    /// Largest corner of it
    pub(crate) max: [f32; 3],
}

/// Numbers of things in a file.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Counts {
    /// Clusters of all levels
    pub(crate) clusters: u32,
    /// Clusters of level 0
    pub(crate) leaves: u32,
    /// Clusters at the top
    pub(crate) roots: u32,
    /// Dependency groups
    pub(crate) groups: u32,
    /// Levels
    pub(crate) levels: u32,
    /// Vertices that several clusters have
    pub(crate) shared_vertices: u32,
}

/// Bytes of a file by what they are for.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct FileBytes {
    /// Length of the file
    pub(crate) file: u64,
    /// All but pages and padding
    pub(crate) tables: u64,
    /// Of the tables, those that tell chunks of them; 0 in files that do not
    pub(crate) chunks: u64,
    /// The clusters' pages
    pub(crate) pages: u64,
    /// Bytes between them
    pub(crate) padding: u64,
    /// Length by triangles
    pub(crate) per_triangle: f64,
    /// With `--parts`: bytes of all pages, as they are stored, by what they are for
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) parts: Option<Map<String, Value>>,
}

/// Misses of a cache.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct VertexCache {
    /// Vertices of the cache, first in, first out, through which every page is drawn
    pub(crate) size: usize,
    pub(crate) clusters: Misses,
    pub(crate) roots: Misses,
}

/// Misses at three positions.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Misses {
    /// Misses for each triangle, all at their finest positions
    pub(crate) finest: f64,
    /// In the middle between finest and base position
    pub(crate) middle: f64,
    /// At their base positions
    pub(crate) base: f64,
}

/// Facts of a source.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct InfoSource {
    /// Name of the source, without its folder
    pub(crate) name: String,
    /// Its length
    pub(crate) bytes: u64,
    /// Its hash, 16 hexadecimal digits: a 64-bit number is more than a JSON number holds for many readers
    pub(crate) xxh3: String,
    /// Its format
    pub(crate) encoding: String,
    /// Vertices that it declares
    pub(crate) vertices: u64,
    /// Faces that it declares
    pub(crate) faces: u64,
    /// Its comments
    pub(crate) comments: Vec<String>,
}

/// `chpm config --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Config {
    /// `chpm-config/1`
    pub(crate) schema: &'static str,
    pub(crate) settings: Vec<Setting>,
}

/// A setting and its origin.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Setting {
    /// An option of `chpm build`
    pub(crate) name: String,
    /// Its value as text; `none` where there is none
    pub(crate) value: String,
    /// `default`, `preset NAME`, the path of a file, or `command line`
    pub(crate) from: String,
}

/// The keys of a [`LevelRow`], which a library has that knows no schemas.
#[cfg(test)]
#[derive(schemars::JsonSchema)]
#[expect(dead_code, reason = "only its schema is used")]
struct LevelKeys {
    /// 0 is the finest
    level: u32,
    /// Clusters of the level
    clusters: u32,
    /// Vertices of their finest meshes, together
    vertices: u64,
    /// Vertices of their base meshes
    base_vertices: u64,
    /// Triangles of their finest meshes
    triangles: u64,
    /// Triangles of their base meshes
    base_triangles: u64,
    /// Vertices that other clusters have, too
    shared_vertices: u64,
    /// Least error of the level, of a finest mesh
    min_error: f32,
    /// Largest error of it, of a base mesh
    max_error: f32,
    /// How far what has vanished may be from what is drawn
    max_gap: f32,
    /// Largest deviation of normals, degrees
    normal_deviation: f32,
    /// Largest deviation of colours, of 255
    color_deviation: f32,
    /// Clusters that keep more triangles than they should
    stalled_clusters: u32,
    /// Collapses that changed the topology or turned a face over
    forced_collapses: u64,
    /// Collapses that were refused, by reason
    refusals: Map<String, Value>,
}
