//! What a build is told: settings decide the bytes of the output, resources only how it gets there.

use chpm_format::BoundaryMode;
use chpm_mesh::Bytes;
use chpm_partition::Partitioner;
pub use chpm_qem::Topology;
use std::path::PathBuf;

/// Everything a build is told.
#[derive(Clone, Debug, Default)]
pub struct BuildConfig {
    /// What decides the output.
    pub settings: Settings,
    /// What it may use.
    pub resources: Resources,
    /// Whether an existing output may be replaced.
    pub overwrite: bool,
}

/// What decides the output, byte for byte; stored in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Triangles of a leaf cluster that the decomposition aims for (Quick-VDR 4.1: about 2K vertices, so 4K triangles).
    pub cluster_triangles: u32,
    /// Vertices above which a grid cell is subdivided. Smaller cells follow boundaries more closely and cost time.
    pub cell_vertices: u32,
    /// Neighbours of a cell in the cell graph (Quick-VDR 4.1: k = 6).
    pub cell_neighbors: u32,
    /// Who partitions the cell graph and the cluster graph.
    pub partitioner: Partitioner,
    /// Seed of the partitioner.
    pub seed: u64,
    /// Share of a cluster's triangles that its base mesh keeps (Quick-VDR 4.3: half).
    pub keep: f64,
    /// Whether shared vertices stay until their clusters merge, or clusters form dependency groups that simplify the seams
    /// between them.
    pub boundary: BoundaryMode,
    /// Least number of vertices that dependent clusters share (Quick-VDR 4.4: 5).
    pub dependency_shared: u32,
    /// Clusters that merge within so many levels do not depend on each other (Quick-VDR 4.4: 2).
    pub dependency_levels: u32,
    /// Most members of a dependency group. A group splits and collapses as a whole: small ones follow a view more closely,
    /// large ones leave fewer vertices locked.
    pub dependency_members: u32,
    /// Most that the finest errors of dependent clusters may differ by, as a factor ("similar error-range").
    pub dependency_error_ratio: f32,
    /// Whether the simplifier may change the topology where nothing else helps.
    pub topology: Topology,
    /// Whether vertex normals of the source are carried along.
    pub normals: bool,
    /// Whether vertex colours of the source are carried along.
    pub colors: bool,
    /// Whether invalid vertices and faces are dropped and counted rather than refused.
    pub drop_invalid: bool,
    /// Whether clusters, vertices and triangles are put into cache-oblivious order.
    pub layout: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            cluster_triangles: 4096,
            cell_vertices: 48,
            cell_neighbors: 6,
            partitioner: Partitioner::Metis,
            seed: 17,
            keep: 0.5,
            boundary: BoundaryMode::Dependencies,
            dependency_shared: 5,
            dependency_levels: 2,
            dependency_members: 4,
            dependency_error_ratio: 4.0,
            topology: Topology::Change,
            normals: true,
            colors: true,
            drop_invalid: false,
            layout: true,
        }
    }
}

impl Settings {
    /// Names and values as they are stored in the file and printed by `chpm info`.
    pub fn describe(&self) -> Vec<(String, String)> {
        let entry = |name: &str, value: &dyn ToString| (name.to_owned(), value.to_string());
        vec![
            entry("cluster-triangles", &self.cluster_triangles),
            entry("cell-vertices", &self.cell_vertices),
            entry("cell-neighbors", &self.cell_neighbors),
            entry("partitioner", &self.partitioner),
            entry("seed", &self.seed),
            entry("keep", &self.keep),
            entry("boundary", &self.boundary),
            entry("dependency-shared", &self.dependency_shared),
            entry("dependency-levels", &self.dependency_levels),
            entry("dependency-members", &self.dependency_members),
            entry("dependency-error-ratio", &self.dependency_error_ratio),
            entry("topology", &if self.topology == Topology::Keep { "keep" } else { "change" }),
            entry("error", &"certified"),
            entry("normals", &self.normals),
            entry("colors", &self.colors),
            entry("drop-invalid", &self.drop_invalid),
            entry("layout", &if self.layout { "cache-oblivious" } else { "simplification" }),
        ]
    }
}

/// What a build may use; none of it shows in the output.
#[derive(Clone, Debug, PartialEq)]
pub struct Resources {
    /// Worker threads; 0 takes one per processor.
    pub threads: usize,
    /// Memory for the arrays of a build. What does not fit is kept in files of the work directory.
    pub memory: Bytes,
    /// Where the work directory is made; the output's directory if not given.
    pub work_dir: Option<PathBuf>,
}

impl Default for Resources {
    fn default() -> Self {
        Resources { threads: 0, memory: Bytes::mib(1024), work_dir: None }
    }
}
