//! Leaves: what a cluster's triangles use, numbered locally, and how it is stored until it is simplified.

use super::region::Mesh;
use super::shared::SharedVertices;
use crate::error::BuildError;
use chpm_extmem::{ExtmemError, Spool};
use chpm_format::{Page, PageParts};
use chpm_mesh::{Aabb, Vertices};
use serde::{Deserialize, Serialize};

/// Marks a stored id that counts from the leaf's region's first inner one.
pub(crate) const INNER: u32 = 1 << 31;
/// A vertex that a leaf does not have.
pub(crate) const ABSENT: u16 = u16::MAX;

/// One leaf cluster, whose data lie in a spool.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Leaf {
    offset: u64,
    len: u32,
    pub(crate) vertex_count: u32,
    pub(crate) triangle_count: u32,
    /// Id of the first inner shared vertex of its region.
    pub(crate) first_inner: u32,
    /// Middle of its box.
    pub(crate) center: [f32; 3],
}

/// A leaf's page, read back. A leaf is spooled as the page of a mesh that nothing has collapsed in; ids are codes.
pub(crate) struct LeafPage<'a> {
    pub(crate) page: Page<'a>,
    leaf: &'a Leaf,
    ids: &'a SharedVertices,
}

impl LeafPage<'_> {
    /// Local index and shared id, by local index.
    pub(crate) fn shared(&self) -> impl Iterator<Item = (u16, u32)> {
        self.page.shared().filter_map(|(local, code)| Some((local, self.ids.id(code, self.leaf)?)))
    }

    /// Shared ids of what the page has as shared vertices; none where one is not shared after all.
    pub(crate) fn ids(&self) -> impl Iterator<Item = Option<u32>> {
        self.page.shared().map(|(_, code)| self.ids.id(code, self.leaf))
    }
}

impl Leaf {
    /// Moves the leaf's page to where `append` puts it.
    pub(super) fn move_to(
        &mut self,
        spool: &Spool,
        page: &mut Vec<u8>,
        append: impl FnOnce(&[u8]) -> Result<u64, ExtmemError>,
    ) -> Result<(), ExtmemError> {
        spool.read(self.offset, self.len as usize, page)?;
        self.offset = append(page)?;
        Ok(())
    }

    /// Spools the page anew, which `blob` has the bytes of, with other numbers of border vertices.
    pub(super) fn spool_anew<'a>(
        &mut self,
        blob: impl FnOnce(u64, usize) -> Result<&'a [u8], BuildError>,
        page: &mut Vec<u8>,
        border: impl Fn(u32) -> u32,
        spool: &Spool,
    ) -> Result<(), BuildError> {
        page.clear();
        page.extend_from_slice(blob(self.offset, self.len as usize)?);
        Page::renumber(page, |code| if code & INNER == 0 { border(code) } else { code })?;
        self.offset = spool.append(page)?;
        Ok(())
    }

    /// The page has come to lie behind so many bytes.
    pub(super) fn shift(&mut self, before: u64) {
        self.offset += before;
    }

    /// Reads the leaf's page into `bytes`.
    pub(super) fn read<'a>(
        &'a self,
        spool: &Spool,
        ids: &'a SharedVertices,
        bytes: &'a mut Vec<u8>,
    ) -> Result<LeafPage<'a>, BuildError> {
        spool.read(self.offset, self.len as usize, bytes)?;
        // When the leaf was written, the faces of other regions were not known.
        let late = Page::view(bytes)?.shared().filter_map(|(local, code)| Some((local, ids.normal(code)?)));
        let late: Vec<_> = late.collect();
        Page::set_octahedral(bytes, late)?;
        Ok(LeafPage { page: Page::view(bytes)?, leaf: self, ids })
    }
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

/// Buffers of a thread that writes leaves.
#[derive(Default)]
pub(super) struct LeafWriter {
    vertices: Vertices,
    page: Vec<u8>,
}

impl LeafWriter {
    /// Spools a leaf. `shared` are its shared vertices, by local index, with their codes: a border number, or [`INNER`] and a number
    /// in the region.
    pub(super) fn write(
        &mut self,
        mesh: &Mesh,
        leaf: &LeafMesh,
        shared: &[(u16, u32)],
        spool: &Spool,
    ) -> Result<Leaf, BuildError> {
        self.vertices.clear_vertices();
        self.vertices.gather(mesh.vertices.view(), leaf.vertices.iter().map(|v| *v as usize));
        self.page.clear();
        PageParts {
            vertices: self.vertices.view(),
            triangles: &leaf.triangles,
            shared,
            ..PageParts::default()
        }
        .encode(&mut self.page)?;
        let bounds = Aabb::of_points(&self.vertices.positions);
        Ok(Leaf {
            offset: spool.append(&self.page)?,
            len: self.page.len() as u32,
            vertex_count: leaf.vertices.len() as u32,
            triangle_count: leaf.triangles.len() as u32,
            first_inner: 0,
            center: bounds.center().coords.map(|x| x as f32).into(),
        })
    }
}

#[cfg(test)]
impl Leaf {
    /// A leaf without anything.
    pub(crate) fn empty() -> Self {
        Leaf { offset: 0, len: 0, vertex_count: 0, triangle_count: 0, first_inner: 0, center: [0.0; 3] }
    }
}
