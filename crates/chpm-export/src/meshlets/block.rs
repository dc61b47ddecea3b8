//! The bytes of one mesh: its meshlets, its vertices, and what leads from the one to the other.

use super::Rule;
use super::cone::bounds;
use super::cut::{Meshlet, cut};
use crate::error::ExportError;
use crate::tiles::{Mesh, SharedNormals, mesh_of};
use crate::vertex::unit;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, ClusterId, TriMesh};

/// Tables begin at multiples of this.
const ALIGN: usize = 16;

/// A mesh of the hierarchy, as it is written.
pub struct Block {
    /// Its record, but for the place of its bytes.
    pub(super) record: Record,
    pub(super) bytes: Vec<u8>,
}

/// Record of a mesh.
pub(super) struct Record {
    pub(super) cluster: ClusterId,
    pub(super) level: u32,
    pub(super) bounds: Aabb,
    /// Error and group from which on it is drawn, and below which.
    pub(super) range: [(f32, u32); 2],
    pub(super) vertices: u32,
    pub(super) triangles: u32,
    pub(super) meshlets: u32,
    /// Where tables begin in the bytes: positions, normals, colours, vertices of meshlets, triangles; those of meshlets are at 0.
    pub(super) tables: [u32; 5],
}

/// A mesh of a cluster, cut into meshlets of up to `limit` triangles and as many vertices. With `normals`, the file has none.
///
/// # Errors
/// [`ExportError::Format`] for a damaged page, [`ExportError::Meshlets`].
pub fn block<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    rule: &Rule,
    cluster: ClusterId,
    mesh: Mesh,
    limit: u32,
    normals: Option<&SharedNormals>,
) -> Result<Block, ExportError> {
    let range = rule.range(file, cluster, mesh).map(|(error, group)| (error, group.0));
    // At its finest, a leaf is the source.
    let level = if range[0].0 > 0.0 { file.clusters()[cluster.index()].level + 1 } else { 0 };
    let mesh = mesh_of(file, cluster, mesh, normals)?;
    let meshlets = cut(&mesh.positions, &mesh.triangles, limit)?;

    let mut bytes = Vec::new();
    let (mut vertices, mut triangles) = (0_u32, 0_u32);
    for meshlet in &meshlets {
        bytes.extend(meshlet_record(meshlet, &mesh, [vertices, triangles], range));
        vertices += meshlet.vertices.len() as u32;
        triangles += meshlet.triangles.len() as u32;
    }
    let local = meshlets.iter().flat_map(|meshlet| &meshlet.vertices);
    let corners = meshlets.iter().flat_map(|meshlet| &meshlet.triangles);
    let corners: Vec<[u8; 4]> = corners.map(|[a, b, c]| [*a, *b, *c, 0]).collect();
    let normals: Vec<[f32; 3]> = mesh.normals.iter().map(|normal| unit(*normal)).collect();
    let tables = [
        table(&mut bytes, mesh.positions.as_flattened().iter().map(|x| x.to_le_bytes())),
        table(&mut bytes, normals.as_flattened().iter().map(|x| x.to_le_bytes())),
        table(&mut bytes, mesh.colors.iter().copied()),
        table(&mut bytes, local.map(|vertex| vertex.to_le_bytes())),
        table(&mut bytes, corners.iter().copied()),
    ];
    table(&mut bytes, std::iter::empty());

    let bounds = if mesh.positions.is_empty() {
        Aabb { min: [0.0; 3], max: [0.0; 3] }
    } else {
        Aabb::of_points(&mesh.positions)
    };
    let record = Record {
        cluster,
        level,
        bounds,
        range,
        vertices: mesh.positions.len() as u32,
        triangles,
        meshlets: meshlets.len() as u32,
        tables,
    };
    Ok(Block { record, bytes })
}

/// Adds a table of words where tables may begin; answers where. A cluster has 65,535 vertices at most, so that 32 bits are enough.
fn table(bytes: &mut Vec<u8>, words: impl Iterator<Item = [u8; 4]>) -> u32 {
    bytes.resize(bytes.len().next_multiple_of(ALIGN), 0);
    let begin = bytes.len() as u32;
    bytes.extend(words.flatten());
    begin
}

/// The 64 bytes of a meshlet, given what lies before it in the tables of vertices and of triangles.
fn meshlet_record(meshlet: &Meshlet, mesh: &TriMesh, before: [u32; 2], range: [(f32, u32); 2]) -> Vec<u8> {
    let place = |local: u8| mesh.positions[meshlet.vertices[usize::from(local)] as usize];
    let (sphere, cone) = bounds(meshlet.triangles.iter().map(|corners| corners.map(place)));
    let [[x, y, z], [i, j, k]] = [sphere.center, cone.axis];
    let [(own, own_group), (above, above_group)] = range;
    let counts = [meshlet.vertices.len() as u32, meshlet.triangles.len() as u32];
    let mut record = Vec::with_capacity(64);
    record.extend([x, y, z, sphere.radius, i, j, k, cone.sine].map(f32::to_le_bytes).as_flattened());
    record.extend([before[0], before[1], counts[0], counts[1]].map(u32::to_le_bytes).as_flattened());
    record.extend([own, above].map(f32::to_le_bytes).as_flattened());
    record.extend([own_group, above_group].map(u32::to_le_bytes).as_flattened());
    record
}
