//! A cluster's page, read in place.

use crate::MAX_CLUSTER_VERTICES;
use crate::error::{FilePart, FormatError, invalid, require, require_eq};
use crate::error_code::{self, MAX_CODE};
use crate::header::{ATTRIBUTE_BITS, attributes_of};
use bytemuck::{Pod, Zeroable};
use chpm_mesh::{Attributes, ClusterId, Octahedral, ProgressiveMesh, VertexSlices};
use std::mem;
use std::ops::Deref;

/// Names of a page's parts, whether it is packed ([`crate::packed::sizes`]) or not ([`Page::sizes`]).
pub const PARTS: [&str; 8] = [
    "positions",
    "connectivity",
    "order of vertices",
    "collapses",
    "error codes",
    "shared vertices",
    "attributes",
    "heads",
];

/// First four bytes of a page, "CPGE".
pub const PAGE_MAGIC: u32 = u32::from_le_bytes(*b"CPGE");
/// Version of the page layout.
pub const PAGE_VERSION: u16 = 1;
/// Length of the page header, bytes.
pub const PAGE_HEADER_LEN: usize = 64;

/// The page header as it lies in the file; see FORMAT.md, "Cluster page".
#[derive(Clone, Copy, PartialEq, Pod, Zeroable, Debug)]
#[repr(C)]
pub struct PageHeader {
    /// [`PAGE_MAGIC`].
    pub magic: u32,
    /// [`PAGE_VERSION`].
    pub version: u16,
    /// As in the file's header.
    pub attributes: u16,
    /// Vertices of the finest mesh, V.
    pub vertex_count: u32,
    /// Vertices of the base mesh, B.
    pub base_vertex_count: u32,
    /// Triangles of the finest mesh, T.
    pub triangle_count: u32,
    /// Triangles of the base mesh.
    pub base_triangle_count: u32,
    /// Shared vertices, S.
    pub shared_count: u32,
    /// Error of the finest mesh.
    pub min_error: f32,
    /// Unit of error codes: a power of two, or 0.
    pub error_scale: f32,
    /// Zero.
    pub reserved: [u8; 28],
}

const _: () = assert!(mem::size_of::<PageHeader>() == PAGE_HEADER_LEN);

impl PageHeader {
    /// Bytes of the page, without padding; the counts must be legal (B <= V, S <= V).
    pub(crate) fn payload_len(&self) -> u64 {
        let (v, t) = (u64::from(self.vertex_count), u64::from(self.triangle_count));
        let collapses = v - u64::from(self.base_vertex_count);
        let attributes = attributes_of(u32::from(self.attributes)).unwrap_or_default();
        PAGE_HEADER_LEN as u64
            + v * attributes.vertex_len() as u64
            + 4 * u64::from(self.shared_count)
            + 6 * t
            + (2 + 2) * collapses
            + v.div_ceil(8)
    }

    pub(crate) fn check(&self) -> Result<Attributes, FormatError> {
        let place = FilePart::Page(ClusterId::NONE);
        require(self.magic == PAGE_MAGIC, place, "magic", "\"CPGE\"", format_args!("{:08x}", self.magic))?;
        if self.version != PAGE_VERSION {
            return Err(FormatError::Version { place, expected: "page 1", got: self.version.to_string() });
        }
        let (v, b, s) = (self.vertex_count, self.base_vertex_count, self.shared_count);
        require(v <= MAX_CLUSTER_VERTICES, place, "vertex_count", "at most 65535", v)?;
        require(1 <= b && b <= v, place, "base_vertex_count", format_args!("1 to {v}"), b)?;
        require(s <= v, place, "shared_count", format_args!("at most {v}"), s)?;
        let (t, base) = (self.triangle_count, self.base_triangle_count);
        require(base <= t, place, "base_triangle_count", format_args!("at most {t}"), base)?;
        let scale = self.error_scale;
        require(error_code::is_scale(scale), place, "error_scale", "0 or a power of two", scale)?;
        let min = self.min_error;
        require((0.0..=scale).contains(&min), place, "min_error", format_args!("0 to {scale}"), min)?;
        let bits = u32::from(self.attributes);
        attributes_of(bits).ok_or_else(|| invalid(place, "attributes", ATTRIBUTE_BITS, bits))
    }
}

/// A page: the finest mesh of a cluster and its collapse order (V vertices, B of them in the base mesh). The arrays of the vertices are
/// reached as the page's own: `page.positions`.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    /// Vertices, V; positions are relative to the file's origin.
    pub vertices: VertexSlices<'a>,
    /// Ids of the shared vertices, in increasing local index.
    pub shared_ids: &'a [u32],
    /// Corners of the finest mesh.
    pub triangles: &'a [[u16; 3]],
    /// Where vertex `B + j` collapses to.
    pub targets: &'a [u16],
    /// Code of the error of the mesh of `B + j` vertices.
    pub error_codes: &'a [u16],
    /// Bit `i % 8` of byte `i / 8`: vertex `i` is shared.
    pub shared_bits: &'a [u8],
    /// B.
    pub base_vertex_count: usize,
    /// Triangles of the base mesh.
    pub base_triangle_count: usize,
    /// Error of the finest mesh, object units.
    pub min_error: f32,
    /// Unit of the codes.
    pub error_scale: f32,
}

impl<'a> Page<'a> {
    /// Views a page without looking at its indices: for pages that were parsed before, or written by this process.
    /// Using a page with wrong indices may panic; it cannot do worse.
    ///
    /// # Errors
    /// A header that contradicts itself, a length that differs from what the header tells, bytes not aligned to 4.
    pub fn view(bytes: &'a [u8]) -> Result<Self, FormatError> {
        let place = FilePart::Page(ClusterId::NONE);
        let got = bytes.len() as u64;
        let (head, mut rest) = bytes.split_at_checked(PAGE_HEADER_LEN).ok_or(FormatError::Truncated {
            place,
            expected: PAGE_HEADER_LEN as u64,
            got,
        })?;
        let unaligned = FormatError::Alignment { place, expected: mem::align_of::<PageHeader>() };
        let Ok(header) = bytemuck::try_from_bytes::<PageHeader>(head) else { return Err(unaligned) };
        let attributes = header.check()?;

        // The counts are legal and the length is theirs: from here on nothing can lie outside.
        let expected = header.payload_len();
        require_eq(place, "length", expected, got)?;

        let v = header.vertex_count as usize;
        let collapses = v - header.base_vertex_count as usize;
        fn carried(is_carried: bool, v: usize) -> usize {
            if is_carried { v } else { 0 }
        }
        let positions = take(&mut rest, v);
        let normals = take(&mut rest, carried(attributes.normals, v));
        let colors = take(&mut rest, carried(attributes.colors, v));
        let scalars = take(&mut rest, v * usize::from(attributes.scalar_words));
        Ok(Page {
            shared_ids: take(&mut rest, header.shared_count as usize),
            triangles: take(&mut rest, header.triangle_count as usize),
            targets: take(&mut rest, collapses),
            error_codes: take(&mut rest, collapses),
            shared_bits: take(&mut rest, v.div_ceil(8)),
            // Single bytes come last.
            vertices: VertexSlices {
                positions,
                normals,
                octahedral: take(&mut rest, carried(attributes.octahedral, v)),
                colors,
                scalars,
            },
            base_vertex_count: header.base_vertex_count as usize,
            base_triangle_count: header.base_triangle_count as usize,
            min_error: header.min_error,
            error_scale: header.error_scale,
        })
    }

    /// Views a page and checks its structure: every index and target in range, triangles with three different
    /// corners, codes legal and monotone, shared bits as many as shared ids.
    ///
    /// # Errors
    /// As [`Page::view`], and where one of these does not hold.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, FormatError> {
        let page = Page::view(bytes)?;
        page.check()?;
        Ok(page)
    }

    pub(crate) fn check(&self) -> Result<(), FormatError> {
        let place = FilePart::Page(ClusterId::NONE);
        let (v, b) = (self.vertex_count(), self.base_vertex_count);
        let largest = self.triangles.as_flattened().iter().copied().max().unwrap_or(0);
        let in_range = usize::from(largest) < v || self.triangles.is_empty();
        require(in_range, place, "corner of a triangle", format_args!("less than {v}"), largest)?;
        let same = self.triangles.iter().filter(|[a, b, c]| (a == b) | (b == c) | (c == a)).count();
        require_eq(place, "triangles with equal corners", 0, same)?;

        let later = self.targets.iter().enumerate().find(|(j, t)| usize::from(**t) >= b + j);
        if let Some((j, target)) = later {
            return Err(invalid(place, "target of a collapse", format_args!("less than {}", b + j), target));
        }
        self.check_errors()?;

        let ones: usize = self.shared_bits.iter().map(|byte| byte.count_ones() as usize).sum();
        require_eq(place, "shared bits that are set", self.shared_ids.len(), ones)?;
        let slack =
            if v.is_multiple_of(8) { 0 } else { self.shared_bits.last().map_or(0, |byte| byte >> (v % 8)) };
        require_eq(place, "shared bits behind the last vertex", 0, slack)
    }

    /// Checks the errors of all positions.
    pub(crate) fn check_errors(&self) -> Result<(), FormatError> {
        let place = FilePart::Page(ClusterId::NONE);
        let largest = self.error_codes.first().copied().unwrap_or(0);
        require(largest <= MAX_CODE, place, "error code", format_args!("at most {MAX_CODE}"), largest)?;
        let monotone = self.error_codes.is_sorted_by(|a, b| a >= b);
        require(monotone, place, "error codes", "never to increase", "an increase")?;
        if let Some(last) = self.error_codes.last() {
            let least = error_code::decode(*last, self.error_scale);
            let min = self.min_error;
            require(least >= min, place, "least coded error", format_args!("at least {min}"), least)?;
        }
        Ok(())
    }

    /// Gives the shared vertices of a page other ids, in place.
    ///
    /// # Errors
    /// As [`Page::view`].
    pub fn renumber(bytes: &mut [u8], new: impl Fn(u32) -> u32) -> Result<(), FormatError> {
        let page = Page::view(bytes)?;
        let in_front = Attributes { octahedral: false, ..page.attributes() };
        let start = PAGE_HEADER_LEN + page.vertex_count() * in_front.vertex_len();
        let end = start + mem::size_of_val(page.shared_ids);
        for id in bytes[start..end].as_chunks_mut().0 {
            *id = new(u32::from_le_bytes(*id)).to_le_bytes();
        }
        Ok(())
    }

    /// Gives vertices of a page other octahedral normals, in place: those that `new` names, by local index. A page without such normals
    /// stays as it is.
    ///
    /// # Errors
    /// As [`Page::view`].
    pub fn set_octahedral(
        bytes: &mut [u8],
        new: impl IntoIterator<Item = (u16, Octahedral)>,
    ) -> Result<(), FormatError> {
        let start = bytes.len() - mem::size_of_val(Page::view(bytes)?.octahedral);
        let normals: &mut [Octahedral] = bytemuck::cast_slice_mut(&mut bytes[start..]);
        for (vertex, normal) in new {
            if let Some(place) = normals.get_mut(usize::from(vertex)) {
                *place = normal;
            }
        }
        Ok(())
    }

    /// V, the vertices of the finest mesh.
    pub fn vertex_count(&self) -> usize {
        self.vertices.positions.len()
    }

    /// Bits of the page by what they are for, in the order of [`PARTS`].
    pub fn sizes(&self) -> [u64; PARTS.len()] {
        let (v, collapses) = (self.vertex_count() as u64, self.targets.len() as u64);
        let own = self.attributes().vertex_len() as u64 - 12;
        let shared = 32 * self.shared_ids.len() as u64 + 8 * self.shared_bits.len() as u64;
        [
            96 * v,
            48 * self.triangles.len() as u64,
            0,
            16 * collapses,
            16 * collapses,
            shared,
            8 * own * v,
            512,
        ]
    }

    /// The mesh and its collapse order, to play.
    pub fn progressive_mesh(&self) -> ProgressiveMesh<'a> {
        ProgressiveMesh {
            vertex_count: self.vertex_count(),
            base_vertex_count: self.base_vertex_count,
            triangles: self.triangles,
            targets: self.targets,
        }
    }

    /// Error of the mesh of `n` vertices, object units; `n` in `B..=V`.
    pub fn error_at(&self, n: usize) -> f32 {
        if n >= self.vertex_count() {
            return self.min_error;
        }
        error_code::decode(self.error_codes[n - self.base_vertex_count], self.error_scale)
    }

    /// Error of the base mesh.
    pub fn max_error(&self) -> f32 {
        self.error_at(self.base_vertex_count)
    }

    /// The fewest vertices `n` whose mesh has an error of at most `error`; V if there is none.
    pub fn vertices_for(&self, error: f32) -> usize {
        self.base_vertex_count
            + self.error_codes.partition_point(|code| {
                let coded = error_code::decode(*code, self.error_scale);
                // A bound that is no number is met by nothing.
                error.is_nan() || coded > error
            })
    }

    /// Whether another cluster has vertex `local` too.
    pub fn is_shared(&self, local: u16) -> bool {
        let byte = self.shared_bits.get(usize::from(local) / 8).copied().unwrap_or(0);
        byte >> (local % 8) & 1 == 1
    }

    /// The shared vertices: local index, ascending, and id.
    pub fn shared(&self) -> impl Iterator<Item = (u16, u32)> + use<'a> {
        self.shared_bits
            .iter()
            .copied()
            .enumerate()
            .flat_map(|(i, byte)| {
                (0..8).filter(move |bit| byte >> bit & 1 == 1).map(move |bit| (8 * i + bit) as u16)
            })
            .zip(self.shared_ids.iter().copied())
    }
}

impl<'a> Deref for Page<'a> {
    type Target = VertexSlices<'a>;

    #[inline]
    fn deref(&self) -> &VertexSlices<'a> {
        &self.vertices
    }
}

/// Splits `count` items off; the caller has checked the length, and that the arrays come by falling alignment.
fn take<'a, T: Pod>(bytes: &mut &'a [u8], count: usize) -> &'a [T] {
    let (head, tail) = bytes.split_at(count * mem::size_of::<T>());
    *bytes = tail;
    bytemuck::cast_slice(head)
}
