//! Parts of a page, and their encoding.

use crate::MAX_CLUSTER_VERTICES;
use crate::error::{FilePart, FormatError, invalid, require, require_eq};
use crate::error_code::{self, MAX_ERROR};
use crate::header::attribute_bits;
use crate::page::{PAGE_HEADER_LEN, PAGE_MAGIC, PAGE_VERSION, PageHeader};
use chpm_mesh::{Attributes, ClusterId, Places, ProgressiveMesh, VertexSlices};

/// The parts of a page, as a builder has them: V vertices, of which the first B are the base mesh.
#[derive(Clone, Copy, Debug, Default)]
pub struct PageParts<'a> {
    /// Vertices, V; positions are relative to the file's origin.
    pub vertices: VertexSlices<'a>,
    /// Corners of the finest mesh; never two equal ones.
    pub triangles: &'a [[u16; 3]],
    /// Where vertex `B + j` collapses to, V - B; less than `B + j`.
    pub targets: &'a [u16],
    /// Error of the mesh of `B + j` vertices, V - B; never increasing, never below `min_error`.
    pub errors: &'a [f32],
    /// Shared vertices, local index and id, by increasing index.
    pub shared: &'a [(u16, u32)],
    /// Error of the finest mesh.
    pub min_error: f32,
    /// Some error that the scale must cover besides this page's own; 0 for none. The members of a group need one
    /// scale, or errors below 2^-31 of it are decoded differently: give all of them the group's largest error.
    pub scale_error: f32,
}

impl PageParts<'_> {
    /// Appends the page's payload, without padding, and answers the decoded error of the base mesh, which is what the
    /// cluster's record must say. Triangles of the base mesh are counted here.
    ///
    /// # Errors
    /// [`FormatError::Value`] for parts that no page can be made of; `out` is then as before.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<f32, FormatError> {
        self.check()?;
        let largest = self.errors.first().copied().unwrap_or(self.min_error).max(self.scale_error);
        let error_scale = error_code::scale_for(largest);
        let header = PageHeader {
            magic: PAGE_MAGIC,
            version: PAGE_VERSION,
            attributes: attribute_bits(self.vertices.attributes()) as u16,
            vertex_count: self.vertices.positions.len() as u32,
            base_vertex_count: (self.vertices.positions.len() - self.targets.len()) as u32,
            triangle_count: self.triangles.len() as u32,
            base_triangle_count: self.base_triangle_count() as u32,
            shared_count: self.shared.len() as u32,
            min_error: self.min_error,
            error_scale,
            reserved: [0; 28],
        };

        // Arrays come by falling alignment, so that a reader may view them where they lie.
        let start = out.len();
        out.reserve(header.payload_len() as usize);
        out.extend_from_slice(bytemuck::bytes_of(&header));
        debug_assert_eq!(out.len() - start, PAGE_HEADER_LEN);
        out.extend_from_slice(bytemuck::cast_slice(self.vertices.positions));
        out.extend_from_slice(bytemuck::cast_slice(self.vertices.normals));
        out.extend_from_slice(bytemuck::cast_slice(self.vertices.colors));
        out.extend_from_slice(bytemuck::cast_slice(self.vertices.scalars));
        out.extend(self.shared.iter().flat_map(|(_, id)| id.to_le_bytes()));
        out.extend_from_slice(bytemuck::cast_slice(self.triangles));
        out.extend_from_slice(bytemuck::cast_slice(self.targets));
        fn code(error: &f32, error_scale: f32) -> u16 {
            error_code::encode(*error, error_scale)
        }
        out.extend(self.errors.iter().flat_map(|error| code(error, error_scale).to_le_bytes()));
        let bits = out.len();
        out.resize(bits + self.vertices.positions.len().div_ceil(8), 0);
        for (local, _) in self.shared {
            out[bits + usize::from(local / 8)] |= 1 << (local % 8);
        }
        out.extend_from_slice(bytemuck::cast_slice(self.vertices.octahedral));
        debug_assert_eq!((out.len() - start) as u64, header.payload_len());
        Ok(self
            .errors
            .first()
            .map_or(self.min_error, |error| error_code::decode(code(error, error_scale), error_scale)))
    }

    fn base_triangle_count(&self) -> usize {
        let mesh = ProgressiveMesh {
            vertex_count: self.vertices.positions.len(),
            base_vertex_count: self.vertices.positions.len() - self.targets.len(),
            triangles: self.triangles,
            targets: self.targets,
        };
        count_base_triangles(&mesh, &mut Places::default())
    }

    fn check(&self) -> Result<(), FormatError> {
        let place = FilePart::Page(ClusterId::NONE);
        let v = self.vertices.positions.len();
        require(v <= MAX_CLUSTER_VERTICES as usize, place, "vertices", "at most 65535", v)?;
        if let Some((field, len)) = self.vertices.uneven() {
            return Err(invalid(place, field, format_args!("none or {v}"), len));
        }
        let Attributes { normals, octahedral, .. } = self.vertices.attributes();
        require(!(normals && octahedral), place, "normals", "of one kind", "both kinds")?;

        let t = self.triangles.len();
        require(t <= u32::MAX as usize / 8, place, "triangles", "at most 2^29", t)?;
        require(self.targets.len() < v, place, "collapses", "fewer than vertices", self.targets.len())?;
        require_eq(place, "errors", self.targets.len(), self.errors.len())?;
        let base = v - self.targets.len();

        // A vertex may only collapse to one that is still there.
        let bad_target =
            self.targets.iter().enumerate().find(|(j, target)| usize::from(**target) >= base + j);
        if let Some((j, target)) = bad_target {
            return Err(invalid(
                place,
                "target of a collapse",
                format_args!("less than {}", base + j),
                target,
            ));
        }

        fn legal([a, b, c]: &[u16; 3], v: usize) -> bool {
            a != b && b != c && c != a && usize::from(*a.max(b).max(c)) < v
        }
        let bad = self.triangles.iter().find(|t| !legal(t, v));
        require(
            bad.is_none(),
            place,
            "triangle",
            format_args!("three different vertices of {v}"),
            format_args!("{:?}", bad.copied().unwrap_or_default()),
        )?;

        let errors = [self.min_error, self.scale_error, self.errors.first().copied().unwrap_or(0.0)];
        let storable = errors.iter().all(|e| (0.0..=MAX_ERROR).contains(e));
        require(storable, place, "errors", "numbers from 0 to 2^127", format_args!("{errors:?}"))?;
        let monotone = self.errors.is_sorted_by(|a, b| a >= b);
        require(monotone, place, "errors", "never to increase with the vertex count", "an increase")?;
        let least = self.errors.last().copied().unwrap_or(self.min_error);
        require(
            least >= self.min_error,
            place,
            "least error",
            format_args!("at least {}", self.min_error),
            least,
        )?;

        let ascending = self.shared.is_sorted_by(|a, b| a.0 < b.0);
        let last = self.shared.last().map_or(0, |(local, _)| usize::from(*local));
        require(
            ascending && last < v,
            place,
            "shared vertices",
            "ascending local indices",
            format_args!("{last} as the last"),
        )
    }
}

/// Counts the triangles of the base mesh.
pub(crate) fn count_base_triangles(mesh: &ProgressiveMesh<'_>, places: &mut Places) -> usize {
    places.go_to(mesh, mesh.base_vertex_count);
    places.triangles(mesh.triangles).count()
}
