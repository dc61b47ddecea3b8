//! The fixed-size records of the tables, as they lie in the file.

use crate::checksum;
use crate::error::{FilePart, FormatError, invalid};
use crate::gaps::Gaps;
use crate::header::attribute_bits;
use crate::page::{Page, PageHeader};
use bytemuck::{Pod, Zeroable};
use chpm_mesh::{Aabb, Attributes, ClusterId, GroupId, Level, Sphere};
use std::mem;

/// A cluster: where its page is and what a selection needs to know without reading it. Table order is file order.
#[derive(Clone, Copy, PartialEq, Pod, Zeroable, Debug, Default)]
#[repr(C)]
pub struct ClusterRecord {
    /// First byte of the page in the file; a multiple of the header's `page_align`. The writer fills it in.
    pub page_offset: u64,
    /// Bytes of the page as it is stored, without padding.
    pub page_len: u32,
    /// Height above the leaves.
    pub level: u32,
    /// Vertices of the finest mesh, at most 65535.
    pub vertex_count: u32,
    /// Vertices of the base mesh, at least 1.
    pub base_vertex_count: u32,
    /// Triangles of the finest mesh.
    pub triangle_count: u32,
    /// Triangles of the base mesh.
    pub base_triangle_count: u32,
    /// Vertices that other clusters have too.
    pub shared_count: u32,
    /// The group in which this cluster is coarse: its members split together.
    pub group: u32,
    /// The group in which this cluster is fine: whose split brings it; `u32::MAX` for a root.
    pub parent_group: u32,
    /// [`ClusterRecord::TRIMMED`], [`ClusterRecord::PACKED`].
    pub flags: u32,
    /// Error of the finest mesh, object units.
    pub min_error: f32,
    /// Error of the base mesh, object units.
    pub max_error: f32,
    /// Smallest corner of a box that holds the vertices.
    pub aabb_min: [f32; 3],
    /// Largest corner of it.
    pub aabb_max: [f32; 3],
    /// Centre of a sphere that holds the vertices.
    pub center: [f32; 3],
    /// Its radius.
    pub radius: f32,
    /// Checksum of the page's `page_len` bytes.
    pub page_checksum: u64,
    /// Bound on how far normals are from the source's, degrees; 0 without normals.
    pub normal_deviation: f32,
    /// Bound on how far a colour's channel is from the source's, of 255; 0 without colours.
    pub color_deviation: f32,
    /// Zero.
    pub reserved: [u8; 16],
}

const _: () = assert!(mem::size_of::<ClusterRecord>() == 128);
const _: () = assert!(mem::offset_of!(ClusterRecord, page_checksum) == 96);

impl ClusterRecord {
    /// Flag of a leaf whose triangles are not the source's own: finer ones were left out.
    pub const TRIMMED: u32 = 1;
    /// Flag of a cluster whose page is packed; means nothing where [`crate::Header::is_packed`] is false.
    pub const PACKED: u32 = 2;

    /// The record of a page: counts, errors, a box and a sphere around its vertices, and the checksum.
    /// `page_offset` stays 0 until the writer knows it; the deviations, which no page tells, stay 0.
    ///
    /// # Errors
    /// What [`Page::parse`] refuses.
    pub fn of_page(
        payload: &[u8],
        level: Level,
        group: GroupId,
        parent: GroupId,
    ) -> Result<Self, FormatError> {
        let page = Page::parse(payload)?;
        let bounds = Aabb::of_points(page.positions);
        let sphere = Sphere::of_points(page.positions);
        let page_len = u32::try_from(payload.len()).map_err(|_| {
            invalid(FilePart::Page(ClusterId::NONE), "length", "less than 4 GiB", payload.len())
        })?;

        Ok(ClusterRecord {
            page_offset: 0,
            page_len,
            level: level.0,
            vertex_count: page.vertex_count() as u32,
            base_vertex_count: page.base_vertex_count as u32,
            triangle_count: page.triangles.len() as u32,
            base_triangle_count: page.base_triangle_count as u32,
            shared_count: page.shared_ids.len() as u32,
            group: group.0,
            parent_group: parent.0,
            flags: 0,
            min_error: page.min_error,
            max_error: page.max_error(),
            aabb_min: bounds.min,
            aabb_max: bounds.max,
            center: sphere.center,
            radius: sphere.radius,
            page_checksum: checksum(payload),
            normal_deviation: 0.0,
            color_deviation: 0.0,
            reserved: [0; 16],
        })
    }

    /// Whether no group's split brings this cluster.
    pub fn is_root(&self) -> bool {
        self.parent_group == GroupId::NONE.0
    }

    /// Whether this is a cluster of the input.
    pub fn is_leaf(&self) -> bool {
        self.level == 0
    }

    /// Whether this is a leaf whose triangles are not the source's own.
    pub fn is_trimmed(&self) -> bool {
        self.flags & Self::TRIMMED != 0
    }

    /// Bytes of the page when it is not packed, for clusters that carry these attributes.
    pub fn unpacked_len(&self, attributes: Attributes) -> u64 {
        let counts = PageHeader {
            attributes: attribute_bits(attributes) as u16,
            vertex_count: self.vertex_count,
            base_vertex_count: self.base_vertex_count,
            triangle_count: self.triangle_count,
            shared_count: self.shared_count,
            ..PageHeader::zeroed()
        };
        counts.payload_len()
    }

    /// The group that splits it.
    pub fn group(&self) -> GroupId {
        GroupId(self.group)
    }

    /// The group that brings it; [`GroupId::NONE`] for a root.
    pub fn parent_group(&self) -> GroupId {
        GroupId(self.parent_group)
    }

    /// The box around its vertices.
    pub fn aabb(&self) -> Aabb {
        Aabb { min: self.aabb_min, max: self.aabb_max }
    }

    /// The sphere around its vertices.
    pub fn sphere(&self) -> Sphere {
        Sphere { center: self.center, radius: self.radius }
    }
}

/// A dependency group: its coarse clusters are replaced by its fine ones, all together.
#[derive(Clone, Copy, PartialEq, Pod, Zeroable, Debug, Default)]
#[repr(C)]
pub struct GroupRecord {
    /// First of the coarse clusters in MEMBERS.
    pub coarse_first: u32,
    /// Number of coarse clusters, at least 1.
    pub coarse_count: u32,
    /// First of the fine clusters in MEMBERS.
    pub fine_first: u32,
    /// Number of fine clusters; 0 for a group of leaves.
    pub fine_count: u32,
    /// Level of the coarse clusters.
    pub level: u32,
    /// Zero.
    pub flags: u32,
    /// Below this bound the group must be split: largest `min_error` of the coarse clusters.
    pub min_error: f32,
    /// Largest `max_error` of the coarse clusters.
    pub max_error: f32,
    /// Centre of a sphere that holds the coarse clusters and everything below.
    pub center: [f32; 3],
    /// Its radius.
    pub radius: f32,
    /// Gaps, from version 1.1 on; see [`crate::Chpm::gaps`].
    pub gaps: Gaps,
    /// Gap of components without a [`crate::Remnant`] alone; 0 in a file without remnants.
    pub rest: f32,
}

const _: () = assert!(mem::size_of::<GroupRecord>() == 64 && mem::offset_of!(GroupRecord, gaps) == 48);

impl GroupRecord {
    /// The sphere around the group and everything below.
    pub fn sphere(&self) -> Sphere {
        Sphere { center: self.center, radius: self.radius }
    }

    /// Whether it is made of leaves, so that nothing can split it.
    pub fn is_leaf(&self) -> bool {
        self.fine_count == 0
    }
}

/// Statistics of one level; the writer fills in all but `stalled_cluster_count`, `forced_collapse_count` and `refusals`.
#[derive(Clone, Copy, PartialEq, Pod, Zeroable, Debug, Default)]
#[repr(C)]
pub struct LevelRecord {
    /// Its own index.
    pub level: u32,
    /// Clusters of the level.
    pub cluster_count: u32,
    /// Sum of the clusters' `vertex_count`.
    pub vertex_count: u64,
    /// Sum of the clusters' `base_vertex_count`.
    pub base_vertex_count: u64,
    /// Sum of the clusters' `triangle_count`.
    pub triangle_count: u64,
    /// Sum of the clusters' `base_triangle_count`.
    pub base_triangle_count: u64,
    /// Sum of the clusters' `shared_count`.
    pub shared_vertex_count: u64,
    /// Smallest `min_error` of the clusters.
    pub min_error: f32,
    /// Largest `max_error` of the clusters.
    pub max_error: f32,
    /// Clusters that could not be simplified as far as asked.
    pub stalled_cluster_count: u32,
    /// Collapses that changed the topology or turned a face over.
    pub forced_collapse_count: u32,
    /// Collapses refused, by [`REFUSALS`].
    pub refusals: [u64; 8],
}

const _: () = assert!(mem::size_of::<LevelRecord>() == 128);

/// Names of the reasons that `LevelRecord::refusals` counts, in order.
pub const REFUSALS: [&str; 8] =
    ["locked", "link", "flip", "non_manifold", "valence", "boundary", "component", "degenerate"];

impl LevelRecord {
    /// Counts a cluster of this level in.
    pub(crate) fn add(&mut self, cluster: &ClusterRecord) {
        let first = self.cluster_count == 0;
        self.cluster_count += 1;
        self.vertex_count += u64::from(cluster.vertex_count);
        self.base_vertex_count += u64::from(cluster.base_vertex_count);
        self.triangle_count += u64::from(cluster.triangle_count);
        self.base_triangle_count += u64::from(cluster.base_triangle_count);
        self.shared_vertex_count += u64::from(cluster.shared_count);
        self.min_error = if first { cluster.min_error } else { self.min_error.min(cluster.min_error) };
        self.max_error = self.max_error.max(cluster.max_error);
    }

    /// The record with its statistics cleared: what a builder supplies.
    pub(crate) fn without_statistics(&self) -> LevelRecord {
        LevelRecord {
            level: self.level,
            stalled_cluster_count: self.stalled_cluster_count,
            forced_collapse_count: self.forced_collapse_count,
            refusals: self.refusals,
            ..LevelRecord::default()
        }
    }
}
