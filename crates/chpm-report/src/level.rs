//! Levels of a hierarchy, each a row of a table.

use chpm_format::Chpm;
use chpm_format::records::{LevelRecord, REFUSALS};
use chpm_mesh::GroupId;
use serde::Serialize;

/// One level of the hierarchy, from a build or from a file.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LevelRow {
    /// Its number; 0 is the finest.
    pub level: u32,
    /// Its clusters.
    pub clusters: u32,
    /// Vertices of their finest meshes.
    pub vertices: u64,
    /// Vertices of their base meshes.
    pub base_vertices: u64,
    /// Triangles of their finest meshes.
    pub triangles: u64,
    /// Triangles of their base meshes.
    pub base_triangles: u64,
    /// Vertices that other clusters have, too.
    pub shared_vertices: u64,
    /// The least error of a finest mesh.
    pub min_error: f32,
    /// The largest error of a base mesh.
    pub max_error: f32,
    /// The largest distance of components that were dropped.
    pub max_gap: f32,
    /// The largest deviation of normals, degrees.
    pub normal_deviation: f32,
    /// The largest deviation of colours, of 255.
    pub color_deviation: f32,
    /// Clusters that could not be halved.
    pub stalled_clusters: u32,
    /// Collapses that changed the topology or turned a face over.
    pub forced_collapses: u64,
    /// Refused collapses, by reason.
    #[serde(serialize_with = "by_reason")]
    pub refusals: [u64; REFUSALS.len()],
}

fn by_reason<S: serde::Serializer>(counts: &[u64; REFUSALS.len()], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(REFUSALS.iter().zip(counts))
}

impl From<&LevelRecord> for LevelRow {
    fn from(level: &LevelRecord) -> Self {
        LevelRow {
            level: level.level,
            clusters: level.cluster_count,
            vertices: level.vertex_count,
            base_vertices: level.base_vertex_count,
            triangles: level.triangle_count,
            base_triangles: level.base_triangle_count,
            shared_vertices: level.shared_vertex_count,
            min_error: level.min_error,
            max_error: level.max_error,
            // Those of the groups and clusters; see `levels_of`.
            max_gap: 0.0,
            normal_deviation: 0.0,
            color_deviation: 0.0,
            stalled_clusters: level.stalled_cluster_count,
            forced_collapses: level.forced_collapse_count.into(),
            refusals: level.refusals,
        }
    }
}

/// The levels of a file, with the largest gaps of their groups and deviations of their clusters.
pub fn levels_of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Vec<LevelRow> {
    let mut levels: Vec<LevelRow> = file.levels().iter().map(LevelRow::from).collect();
    for cluster in file.clusters() {
        if let Some(level) = levels.get_mut(cluster.level as usize) {
            level.normal_deviation = level.normal_deviation.max(cluster.normal_deviation);
            level.color_deviation = level.color_deviation.max(cluster.color_deviation);
        }
    }
    for (id, group) in (0..).map(GroupId).zip(file.groups()) {
        if let Some(level) = levels.get_mut(group.level as usize) {
            level.max_gap = level.max_gap.max(file.gaps(id).base);
        }
    }
    levels
}

/// Bytes of the file for each triangle of the source.
pub fn per_triangle(bytes: u64, triangles: u64) -> f64 {
    bytes as f64 / triangles.max(1) as f64
}
