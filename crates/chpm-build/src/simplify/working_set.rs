//! The mesh of one cluster while it is worked on.

use super::merge::Merger;
use crate::decompose::LeafPage;
use chpm_format::{FormatError, Page};
use chpm_mesh::Vertices;
use chpm_qem::{AttributeErrors, Displacement, FaceAttributeError, Record};

/// Part of a child that a parent reads.
#[derive(Debug, Default)]
pub(super) struct Child {
    pub(super) page: Vec<u8>,
    /// The base mesh's.
    pub(super) triangles: Vec<u8>,
    /// Of these triangles.
    pub(super) displacements: Vec<u8>,
    /// Likewise; empty without normals and colours.
    pub(super) attribute_errors: Vec<u8>,
    pub(super) dropped: Vec<u8>,
}

/// One cluster's mesh in flat arrays that are reused from cluster to cluster.
#[derive(Debug, Default)]
pub(super) struct WorkingSet {
    pub(super) vertices: Vertices,
    pub(super) triangles: Vec<[u16; 3]>,
    /// Per triangle, how far it is from the source; empty for a leaf that is the source.
    pub(super) displacements: Vec<Displacement>,
    /// Per triangle, how it looks beside the source; empty without normals and colours.
    pub(super) face_attribute_errors: Vec<FaceAttributeError>,
    /// Local index and shared id of the vertices that other clusters use too, by local index.
    pub(super) shared: Vec<(u16, u32)>,
    /// Whether it is part of the source, of which nothing has been collapsed.
    pub(super) is_source: bool,
    merger: Merger,
}

impl WorkingSet {
    fn clear(&mut self) {
        self.vertices.clear_vertices();
        self.triangles.clear();
        self.displacements.clear();
        self.face_attribute_errors.clear();
        self.shared.clear();
        self.is_source = false;
    }

    /// The mesh of a leaf.
    pub(super) fn fill_from_leaf(&mut self, leaf: &LeafPage<'_>, rounding: Displacement) {
        self.clear();
        self.is_source = true;
        self.vertices.extend_from_slices(leaf.page.vertices);
        self.triangles.extend_from_slice(leaf.page.triangles);
        self.shared.extend(leaf.shared());
        if rounding != Displacement::default() {
            self.displacements.resize(self.triangles.len(), rounding);
        }
        AttributeErrors::new(self.vertices.view(), &[])
            .of_source(&self.triangles, &mut self.face_attribute_errors);
    }

    /// The union of the children's base meshes, joined at the vertices that they share.
    pub(super) fn fill_from_children(&mut self, children: &[Child]) -> Result<(), FormatError> {
        self.clear();
        let pages = children.iter().map(|child| Page::view(&child.page)).collect::<Result<Vec<_>, _>>()?;
        let merger = &mut self.merger;
        merger.join(&pages, children.iter().map(|child| &child.triangles[..]));
        for (page, fresh) in pages.iter().zip(&merger.fresh) {
            self.vertices.gather(page.vertices, fresh.iter().map(|v| usize::from(*v)));
        }
        self.triangles.extend_from_slice(&merger.triangles);
        for child in children {
            let each = child.displacements.chunks_exact(size_of::<Displacement>());
            self.displacements.extend(each.map(bytemuck::pod_read_unaligned::<Displacement>));
            let each = child.attribute_errors.chunks_exact(size_of::<FaceAttributeError>());
            self.face_attribute_errors.extend(each.map(bytemuck::pod_read_unaligned::<FaceAttributeError>));
        }
        self.shared.extend_from_slice(&merger.shared);
        Ok(())
    }

    /// Normals and colours for the kernel.
    pub(super) fn attribute_errors(&self) -> AttributeErrors<'_> {
        AttributeErrors::new(self.vertices.view(), &self.face_attribute_errors)
    }

    /// The same mesh with vertices numbered as the record has it.
    pub(super) fn fill_renumbered(&mut self, from: &WorkingSet, record: &Record) {
        self.clear();
        let order = &record.new_to_old;
        self.vertices.gather(from.vertices.view(), order.iter().map(|v| usize::from(*v)));
        let new = |v: u16| record.old_to_new[usize::from(v)];
        self.triangles.extend(from.triangles.iter().map(|t| t.map(new)));
        self.shared.extend(from.shared.iter().map(|(v, id)| (new(*v), *id)));
        self.shared.sort_unstable();
    }
}
