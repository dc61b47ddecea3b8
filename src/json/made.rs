//! Documents about what was written.

use serde::Serialize;

/// A mesh file.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Mesh {
    /// The mesh file
    pub(crate) output: String,
    /// `PLY`, `STL`, `OBJ`, `GLB` or `glTF`
    pub(crate) format: &'static str,
    /// Triangles of the mesh
    pub(crate) triangles: u64,
    /// How many of them have the same three vertices as another one of the same cluster before them: the two sides of what was pressed flat
    pub(crate) coincident: u64,
    /// Its vertices; of an STL, those that the triangles would share
    pub(crate) vertices: u32,
    /// No point of the mesh is farther from the source
    pub(crate) error: f32,
    /// And no point of the source from the mesh, what has vanished included: both ways, proven
    pub(crate) distance: f32,
    /// Origin of the mesh file's coordinates: x, y, z in its axes; `null` where they are the model's
    pub(crate) origin: Option<[f64; 3]>,
    /// The file beside it that tells that; `null` without `--local-origin`
    pub(crate) origin_file: Option<String>,
    /// With `--up`, and in glTF: the axis of the mesh file that points up, `y` or `z`
    pub(crate) up: Option<&'static str>,
}

/// `chpm extract --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Extract {
    /// `chpm-extract/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// Clusters that the mesh is of
    pub(crate) clusters: usize,
    /// Whether the file has what was asked for
    pub(crate) satisfied: bool,
    /// Remarks on what was done otherwise or is less than was asked for
    pub(crate) warnings: Vec<String>,
    #[serde(flatten)]
    pub(crate) mesh: Mesh,
}

/// `chpm extract --lods --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ExtractLods {
    /// `chpm-extract-lods/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// Whether the file has what was asked for
    pub(crate) satisfied: bool,
    /// Remarks on what was done otherwise or is less than was asked for
    pub(crate) warnings: Vec<String>,
    /// The levels, the finest first; in one output or each in its own
    pub(crate) levels: Vec<Lod>,
}

/// A level of detail.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Lod {
    /// How many triangles it might have at most
    pub(crate) asked: u64,
    /// Clusters that the mesh is of
    pub(crate) clusters: usize,
    /// The share of an image's height, taken by the sphere around the model, down to which it is to be drawn: below it, `error` of the next level is a pixel of 1080 at most. 0 for the last
    pub(crate) coverage: f64,
    #[serde(flatten)]
    pub(crate) mesh: Mesh,
}

/// `chpm simplify --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Simplify {
    /// `chpm-simplify/1`
    pub(crate) schema: &'static str,
    /// The source as it was named
    pub(crate) source: String,
    /// Its triangles
    pub(crate) source_triangles: u64,
    /// Diagonal of the box around it
    pub(crate) diagonal: f64,
    /// Unit of `--unit`; `null` without
    pub(crate) unit: Option<&'static str>,
    /// As in `chpm-build/1`, and what was done otherwise
    pub(crate) warnings: Vec<String>,
    #[serde(flatten)]
    pub(crate) mesh: Mesh,
}

/// `FILE.origin.json`, which `--local-origin` writes beside a mesh
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Origin {
    /// `chpm-origin/1`
    pub(crate) schema: &'static str,
    /// Name of the mesh file
    pub(crate) file: String,
    /// To be added to its coordinates: x, y, z in its axes
    pub(crate) origin: Option<[f64; 3]>,
}

/// `chpm export --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Export {
    /// `chpm-export/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// The folder, or the archive
    pub(crate) output: String,
    /// Files of the tileset
    pub(crate) tilesets: u64,
    /// Tiles
    pub(crate) tiles: u64,
    /// Triangles of all tiles
    pub(crate) triangles: u64,
    /// Bytes of all tiles
    pub(crate) tile_bytes: u64,
    /// Bytes of the archive; null for a folder
    pub(crate) archive_bytes: Option<u64>,
    /// Remarks on what was left out, or lies elsewhere than one would think
    pub(crate) warnings: Vec<String>,
}

/// `chpm export --meshlets --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ExportMeshlets {
    /// `chpm-export-meshlets/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// The output
    pub(crate) output: String,
    /// Meshes of the hierarchy
    pub(crate) meshes: u64,
    /// Meshlets of all meshes
    pub(crate) meshlets: u64,
    /// Triangles of all meshes
    pub(crate) triangles: u64,
    /// Vertices of all meshes
    pub(crate) vertices: u64,
    /// Length of the output
    pub(crate) bytes: u64,
    /// Remarks on what was left out
    pub(crate) warnings: Vec<String>,
}

/// `chpm share --json`
#[cfg(feature = "web")]
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Share {
    /// `chpm-share/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// The folder
    pub(crate) output: String,
    /// The model in it, for `chpm serve`; `null` where it is in pieces
    pub(crate) model: Option<String>,
    /// Its length
    pub(crate) model_bytes: u64,
    /// Files that it is in
    pub(crate) pieces: u64,
}

/// `chpm report --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Report {
    /// `chpm-report/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// The file of `--compare`; `null` without
    pub(crate) compared_with: Option<String>,
    /// The page
    pub(crate) output: String,
    /// Its length
    pub(crate) bytes: usize,
}

/// `chpm bench --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Bench {
    /// `chpm-bench/1`
    pub(crate) schema: &'static str,
    /// The source as it was named
    pub(crate) source: String,
    /// Its triangles
    pub(crate) triangles: u64,
    /// Diagonal of the box around it
    pub(crate) diagonal: f64,
    /// Processors and their model, in words
    pub(crate) machine: String,
    /// Timed runs of each contender
    pub(crate) runs: u32,
    /// Samples of each triangle when measured
    pub(crate) samples_per_triangle: u32,
    /// The contender that the others are compared with at equal deviation; `null` where none competes that can be
    pub(crate) reference: Option<&'static str>,
    pub(crate) contenders: Vec<Contender>,
    /// Who does not compete and why
    pub(crate) declined: Vec<String>,
}

/// `chpm bench --threads --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Scaling {
    /// `chpm-bench-threads/1`
    pub(crate) schema: &'static str,
    /// The source as it was named
    pub(crate) source: String,
    /// Its triangles
    pub(crate) triangles: u64,
    /// Processors and their model, in words
    pub(crate) machine: String,
    /// Timed runs of each number of threads
    pub(crate) runs: u32,
    pub(crate) builds: Vec<ScalingBuild>,
}

/// Builds on one number of threads, medians.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ScalingBuild {
    /// Threads of the build
    pub(crate) threads: u32,
    /// Wall-clock time
    pub(crate) seconds: f64,
    /// Triangles of the source, by `seconds`
    pub(crate) triangles_per_second: f64,
    /// Times as fast as the first number of threads
    pub(crate) speedup: f64,
    /// Processor time of all threads; `null` where the system does not tell
    pub(crate) processor_seconds: Option<f64>,
    /// The most memory of the process; `null` where the system does not tell
    pub(crate) peak_resident_bytes: Option<u64>,
    pub(crate) stages: Vec<ScalingStage>,
}

/// A stage of builds on one number of threads.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ScalingStage {
    /// Name of the stage
    pub(crate) stage: String,
    /// Wall-clock time of it, median
    pub(crate) seconds: f64,
}

/// A contender of a bench.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Contender {
    /// Its name
    pub(crate) name: &'static str,
    /// In words
    pub(crate) settings: &'static str,
    /// Median of the runs
    pub(crate) seconds: f64,
    /// Triangles of the source, by `seconds`
    pub(crate) triangles_per_second: f64,
    /// Median of the most memory of its processes
    pub(crate) peak_resident_bytes: u64,
    /// Bytes that it leaves
    pub(crate) output_bytes: u64,
    pub(crate) meshes: Vec<BenchMesh>,
}

/// A mesh of a contender.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct BenchMesh {
    /// Of the source's triangles, the mesh may have at most one for so many
    pub(crate) divisor: u64,
    /// Its triangles
    pub(crate) triangles: u64,
    /// Measured deviation, root mean square
    pub(crate) rms: f64,
    /// The largest
    pub(crate) max: f64,
    /// Triangles by those of the reference at the same `rms`; `null` where that has none
    pub(crate) triangles_by_reference: Option<f64>,
}

/// `chpm rays --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Rays {
    /// `chpm-rays/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// The file of rays as it was named
    pub(crate) rays: String,
    /// The file that was written; `null` without `-o`
    pub(crate) output: Option<String>,
    /// `CSV` or `NumPy`; `null` without `-o`
    pub(crate) format: Option<&'static str>,
    /// Error that the mesh was allowed; 0 is the source's own triangles
    pub(crate) error: f64,
    /// How far mesh and source are apart at most; `null` where the file does not know
    pub(crate) distance: Option<f64>,
    /// Whether any hit was enough
    pub(crate) any: bool,
    /// Rays
    pub(crate) count: u64,
    /// Those that meet the mesh
    pub(crate) hits: u64,
    /// Those that do not
    pub(crate) misses: u64,
    /// Those that are proven to miss the source
    pub(crate) proven_misses: u64,
    /// The least distance of a hit; `null` where there is none, and with `--any`
    pub(crate) nearest: Option<f64>,
    /// The largest
    pub(crate) farthest: Option<f64>,
    /// Reads of pages
    pub(crate) pages: u64,
    /// Their bytes in the file
    pub(crate) page_bytes: u64,
    /// Pages that were read once or more
    pub(crate) pages_different: u64,
}

/// `chpm section --json`
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Section {
    /// `chpm-section/1`
    pub(crate) schema: &'static str,
    /// The file as it was named
    pub(crate) file: String,
    /// The file that was written; `null` without `-o`
    pub(crate) output: Option<String>,
    /// `SVG`, `DXF`, `GeoJSON` or `CSV`; `null` without `-o`
    pub(crate) format: Option<&'static str>,
    /// Normal of the planes, of length 1
    pub(crate) normal: [f64; 3],
    /// With `--preview`: how far the mesh that was cut and the source are from each other at most. The source's own lines may be farther from these by any amount
    pub(crate) preview: Option<f64>,
    /// The scale of an SVG, as `1:200`
    pub(crate) scale: Option<String>,
    /// Pages whose boxes a plane crosses: they were read
    pub(crate) pages: u64,
    /// Their bytes in the file
    pub(crate) page_bytes: u64,
    /// Those of them that have a triangle on both sides of a plane
    pub(crate) pages_crossed: u64,
    /// Ends of lines that are not closed, of all planes
    pub(crate) open_ends: u64,
    /// The planes, by ascending offset
    pub(crate) sections: Vec<PlaneSection>,
    /// Remarks on what is less than was asked for
    pub(crate) warnings: Vec<String>,
}

/// Lines of a plane.
#[derive(Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct PlaneSection {
    /// The plane's distance from the zero point along the normal
    pub(crate) offset: f64,
    /// Lines
    pub(crate) lines: u64,
    /// Those of them that are closed
    pub(crate) closed: u64,
    /// Ends of the others
    pub(crate) open_ends: u64,
    /// Points of all lines
    pub(crate) points: u64,
    /// Their length
    pub(crate) length: f64,
    /// Area inside of closed lines, less that of closed lines in these, and so on; `null` where closed lines cross each other
    pub(crate) area: Option<f64>,
    /// Closed lines that cross others, as those of solids do that overlap
    pub(crate) crossing: u64,
}
