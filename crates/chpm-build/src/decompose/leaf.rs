//! Leaves: what a cluster's triangles use, numbered locally, and how it is stored until it is simplified.

use super::region::Mesh;
use crate::error::BuildError;
use bytemuck::Pod;
use chpm_extmem::Spool;
use chpm_mesh::{Aabb, Attributes};
use serde::{Deserialize, Serialize};

/// Marks a stored id that counts from the leaf's region's first inner one.
pub(crate) const INNER: u32 = 1 << 31;
/// A vertex that a leaf does not have.
pub(crate) const ABSENT: u16 = u16::MAX;

/// One leaf cluster, whose data lie in a spool.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Leaf {
    offset: u64,
    pub(crate) vertex_count: u32,
    pub(crate) triangle_count: u32,
    shared_count: u32,
    /// Id of the first inner shared vertex of its region.
    pub(crate) first_inner: u32,
    /// Middle of its box.
    pub(crate) center: [f32; 3],
}

/// The data of a leaf, read back.
#[derive(Debug, Default)]
pub(crate) struct LeafData {
    bytes: Vec<u8>,
    pub(crate) positions: Vec<[f32; 3]>,
    /// As many as positions, or none.
    pub(crate) normals: Vec<[f32; 3]>,
    /// As many as positions, or none.
    pub(crate) colors: Vec<[u8; 4]>,
    /// Triangles over local vertices.
    pub(crate) triangles: Vec<[u16; 3]>,
    /// Local index and shared id, by local index.
    pub(crate) shared: Vec<(u16, u32)>,
    codes: Vec<u32>,
    marked: Vec<u16>,
}

impl LeafData {
    /// Refills from the spool; `id` is the shared id of a code, if it has one.
    pub(super) fn read(
        &mut self,
        leaf: &Leaf,
        attributes: Attributes,
        spool: &Spool,
        id: impl Fn(u32) -> Option<u32>,
    ) -> Result<(), BuildError> {
        let vertices = leaf.vertex_count as usize;
        let (shared, triangles) = (leaf.shared_count as usize, leaf.triangle_count as usize);
        let vertex_len = 12 + if attributes.normals { 12 } else { 0 } + if attributes.colors { 4 } else { 0 };
        spool.read(leaf.offset, vertices * vertex_len + 6 * shared + 6 * triangles, &mut self.bytes)?;
        let mut rest = &self.bytes[..];
        take(&mut rest, vertices, &mut self.positions);
        take(&mut rest, if attributes.normals { vertices } else { 0 }, &mut self.normals);
        take(&mut rest, if attributes.colors { vertices } else { 0 }, &mut self.colors);
        take(&mut rest, shared, &mut self.codes);
        take(&mut rest, shared, &mut self.marked);
        take(&mut rest, triangles, &mut self.triangles);
        let ids = self.marked.iter().zip(&self.codes).filter_map(|(local, code)| Some((*local, id(*code)?)));
        self.shared.clear();
        self.shared.extend(ids);
        Ok(())
    }
}

/// Makes `out` the next `len` records.
fn take<T: Pod>(bytes: &mut &[u8], len: usize, out: &mut Vec<T>) {
    let (records, rest) = bytes.split_at(len * size_of::<T>());
    *bytes = rest;
    out.resize(len, T::zeroed());
    bytemuck::cast_slice_mut(out).copy_from_slice(records);
}

/// The triangles of a leaf over the vertices that they use.
pub(crate) struct LeafMesh {
    /// The region's numbers of the local vertices.
    pub(crate) vertices: Vec<u32>,
    /// Triangles over local vertices.
    pub(crate) triangles: Vec<[u16; 3]>,
}

impl LeafMesh {
    /// Numbers vertices in their order in the region, so that equal surfaces are numbered alike. `locals` holds [`ABSENT`] for
    /// every vertex of the region, before and after.
    pub(super) fn gather(triangles: &[[u32; 3]], locals: &mut [u16]) -> Self {
        let mut vertices = Vec::with_capacity(triangles.len());
        for v in triangles.as_flattened() {
            let local = &mut locals[*v as usize];
            if *local == ABSENT {
                *local = 0;
                vertices.push(*v);
            }
        }
        vertices.sort_unstable();
        vertices.shrink_to_fit();
        for (local, v) in (0..).zip(&vertices) {
            locals[*v as usize] = local;
        }
        let triangles = triangles.iter().map(|t| t.map(|v| locals[v as usize])).collect();
        vertices.iter().for_each(|v| locals[*v as usize] = ABSENT);
        LeafMesh { vertices, triangles }
    }
}

/// Stores a leaf. `ids` are its shared vertices, by local index, with their codes: a border number, or [`INNER`] and a number
/// in the region.
pub(super) fn write(
    mesh: &Mesh,
    leaf: &LeafMesh,
    ids: impl Iterator<Item = (u16, u32)> + Clone,
    blob: &mut Vec<u8>,
    spool: &Spool,
) -> Result<Leaf, BuildError> {
    blob.clear();
    put(blob, leaf.vertices.iter().map(|v| mesh.positions[*v as usize]));
    if !mesh.normals.is_empty() {
        put(blob, leaf.vertices.iter().map(|v| mesh.normals[*v as usize]));
    }
    if !mesh.colors.is_empty() {
        put(blob, leaf.vertices.iter().map(|v| mesh.colors[*v as usize]));
    }
    put(blob, ids.clone().map(|(_, code)| code));
    put(blob, ids.clone().map(|(local, _)| local));
    blob.extend_from_slice(bytemuck::cast_slice(&leaf.triangles));
    let bounds = Aabb::of_points(leaf.vertices.iter().map(|v| &mesh.positions[*v as usize]));
    Ok(Leaf {
        offset: spool.append(blob)?,
        vertex_count: leaf.vertices.len() as u32,
        triangle_count: leaf.triangles.len() as u32,
        shared_count: ids.count() as u32,
        first_inner: 0,
        center: bounds.center().coords.map(|x| x as f32).into(),
    })
}

fn put<T: Pod>(blob: &mut Vec<u8>, records: impl Iterator<Item = T>) {
    records.for_each(|record| blob.extend_from_slice(bytemuck::bytes_of(&record)));
}

#[cfg(test)]
impl Leaf {
    /// A leaf without anything.
    pub(crate) fn empty() -> Self {
        Leaf {
            offset: 0,
            vertex_count: 0,
            triangle_count: 0,
            shared_count: 0,
            first_inner: 0,
            center: [0.0; 3],
        }
    }
}
