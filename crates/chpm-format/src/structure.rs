//! The rules that the tables alone must keep. The reader checks them before it trusts a file, the writer before it
//! writes one.

use crate::error::{FilePart, FormatError, invalid, require, require_eq};
use crate::header::Header;
use crate::packed::MOST_TIMES;
use crate::records::{ClusterRecord, GroupRecord, LevelRecord};
use crate::{MAX_CLUSTER_VERTICES, align_up};
use chpm_mesh::{ClusterId, GroupId};
use std::ops::Range;

/// The tables of a file and its header.
#[derive(Clone, Copy)]
pub(crate) struct Structure<'a> {
    pub(crate) header: &'a Header,
    pub(crate) clusters: &'a [ClusterRecord],
    pub(crate) groups: &'a [GroupRecord],
    pub(crate) members: &'a [u32],
    pub(crate) levels: &'a [LevelRecord],
}

impl Structure<'_> {
    /// Checks counts, ids, ranges and levels: everything that following the hierarchy relies on. O(clusters).
    pub(crate) fn check(&self) -> Result<(), FormatError> {
        self.check_counts()?;
        for (id, cluster) in (0..).map(ClusterId).zip(self.clusters) {
            check_cluster(self.header, FilePart::Cluster(id), cluster)?;
        }
        let mut used = vec![false; self.members.len()];
        let (mut coarse, mut fine) = (0, 0);
        for (id, group) in (0..).map(GroupId).zip(self.groups) {
            self.check_group(id, group, &mut used)?;
            coarse += u64::from(group.coarse_count);
            fine += u64::from(group.fine_count);
        }
        // With no member twice in a range and every member naming its group, equal sums mean "each exactly once".
        let fine_clusters = u64::from(self.header.cluster_count - self.header.root_count);
        require_eq(
            FilePart::File,
            "coarse clusters of all groups",
            u64::from(self.header.cluster_count),
            coarse,
        )?;
        require_eq(FilePart::File, "fine clusters of all groups", fine_clusters, fine)?;
        let unused = used.iter().filter(|used| !**used).count();
        require_eq(FilePart::File, "members that no group names", 0, unused)
    }

    fn check_counts(&self) -> Result<(), FormatError> {
        let (header, place) = (self.header, FilePart::Header);
        let roots = self.clusters.iter().filter(|c| c.is_root()).count() as u64;
        let leaves = self.clusters.iter().filter(|c| c.is_leaf()).count() as u64;
        for (field, expected, got) in [
            ("cluster_count", self.clusters.len() as u64, header.cluster_count),
            ("group_count", self.groups.len() as u64, header.group_count),
            ("level_count", self.levels.len() as u64, header.level_count),
            ("root_count", roots, header.root_count),
            ("leaf_count", leaves, header.leaf_count),
        ] {
            require_eq(place, field, expected, u64::from(got))?;
        }
        require(header.cluster_count >= 1, place, "cluster_count", "at least 1", header.cluster_count)?;
        // A bound for whoever allocates by this count: ids are listed, so there are no more ids than list entries.
        let listed: u64 = self.clusters.iter().map(|c| u64::from(c.shared_count)).sum();
        let ids = u64::from(header.shared_vertex_count);
        require(ids <= listed, place, "shared_vertex_count", format_args!("at most {listed}"), ids)?;
        for (level, record) in (0..).zip(self.levels) {
            require_eq(FilePart::Level(level), "level", level, record.level)?;
        }
        Ok(())
    }

    fn check_group(&self, id: GroupId, group: &GroupRecord, used: &mut [bool]) -> Result<(), FormatError> {
        let place = FilePart::Group(id);
        check_group(self.header, place, group)?;

        // Both sides know of each other: the group names its members, and each of them the group.
        let coarse = self.members_of(place, group.coarse_first, group.coarse_count, used)?;
        for (member, cluster) in coarse.iter().zip(self.named(place, coarse)?) {
            let member = FilePart::Cluster(ClusterId(*member));
            require_eq(member, "group of a coarse member", id, cluster.group())?;
            require_eq(member, "level of a coarse member", group.level, cluster.level)?;
        }

        let fine = self.members_of(place, group.fine_first, group.fine_count, used)?;
        for (member, cluster) in fine.iter().zip(self.named(place, fine)?) {
            let member = FilePart::Cluster(ClusterId(*member));
            require_eq(member, "parent group of a fine member", id, cluster.parent_group())?;
            let below = format_args!("less than {}", group.level);
            require(cluster.level < group.level, member, "level of a fine member", below, cluster.level)?;
        }
        Ok(())
    }

    /// The ids of a range of MEMBERS, which must be ascending and used by no other range.
    fn members_of(
        &self,
        place: FilePart,
        first: u32,
        count: u32,
        used: &mut [bool],
    ) -> Result<&[u32], FormatError> {
        let range = member_range(first, count);
        let len = self.members.len();
        let fits = range.end <= len;
        require(fits, place, "range of members", format_args!("within {len}"), format_args!("{range:?}"))?;
        let fresh = used[range.clone()].iter().all(|used| !used);
        require(fresh, place, "range of members", "to itself", "one that overlaps another")?;
        used[range.clone()].fill(true);
        let ids = &self.members[range];
        require(ids.is_sorted_by(|a, b| a < b), place, "members", "ascending", format_args!("{ids:?}"))?;
        Ok(ids)
    }

    fn named(
        &self,
        place: FilePart,
        ids: &[u32],
    ) -> Result<impl Iterator<Item = &ClusterRecord>, FormatError> {
        let clusters = self.clusters;
        // Ids ascend, so the last is the largest.
        let last = ids.last().copied().unwrap_or(0);
        let below = format_args!("less than {}", clusters.len());
        require((last as usize) < clusters.len(), place, "member", below, last)?;
        Ok(ids.iter().map(|id| &clusters[*id as usize]))
    }
}

/// Checks a cluster's record by itself, in a file with this header.
pub(crate) fn check_cluster(header: &Header, place: FilePart, c: &ClusterRecord) -> Result<(), FormatError> {
    let (v, t, levels, groups) = (c.vertex_count, c.triangle_count, header.level_count, header.group_count);
    require(c.level < levels, place, "level", format_args!("less than {levels}"), c.level)?;
    require(v <= MAX_CLUSTER_VERTICES, place, "vertex_count", "at most 65535", v)?;

    let base = c.base_vertex_count;
    require(1 <= base && base <= v, place, "base_vertex_count", format_args!("1 to {v}"), base)?;
    let base = c.base_triangle_count;
    require(base <= t, place, "base_triangle_count", format_args!("at most {t}"), base)?;
    require(c.shared_count <= v, place, "shared_count", format_args!("at most {v}"), c.shared_count)?;

    let (unpacked, len) = (c.unpacked_len(header.attributes()), u64::from(c.page_len));
    if header.is_packed() && c.flags & ClusterRecord::PACKED != 0 {
        let least = unpacked.div_ceil(MOST_TIMES as u64);
        let told = format_args!("{least} to {unpacked} less 1");
        require(least <= len && len < unpacked, place, "page_len of a packed page", told, len)?;
    } else {
        require_eq(place, "page_len", unpacked, len)?;
    }

    let less = format_args!("less than {groups}");
    require(c.group < groups, place, "group", less, c.group)?;
    let parent = c.parent_group < groups || c.is_root();
    require(parent, place, "parent_group", format_args!("less than {groups}, or none"), c.parent_group)?;

    require_errors(place, c.min_error, c.max_error)?;
    let (normal, color) = (c.normal_deviation, c.color_deviation);
    require((0.0..=180.0).contains(&normal), place, "normal_deviation", "0 to 180", normal)?;
    require((0.0..=255.0).contains(&color), place, "color_deviation", "0 to 255", color)?;

    let boxed = (0..3)
        .all(|a| c.aabb_min[a].is_finite() && c.aabb_max[a].is_finite() && c.aabb_min[a] <= c.aabb_max[a]);
    require(boxed, place, "box", "finite, min <= max", format_args!("{:?} {:?}", c.aabb_min, c.aabb_max))?;
    require_sphere(place, c.center, c.radius)
}

/// Checks a group's record by itself, in a file with this header.
pub(crate) fn check_group(header: &Header, place: FilePart, group: &GroupRecord) -> Result<(), FormatError> {
    let levels = header.level_count;
    require(group.level < levels, place, "level", format_args!("less than {levels}"), group.level)?;
    require(group.coarse_count >= 1, place, "coarse_count", "at least 1", group.coarse_count)?;
    let leaf = group.level == 0;
    require(leaf == group.is_leaf(), place, "fine_count", "0 at level 0 and only there", group.fine_count)?;
    require_errors(place, group.min_error, group.max_error)?;
    if header.has_gaps() {
        require(
            group.gaps.are_legal(),
            place,
            "gaps",
            "finite, 0 <= fine <= base",
            format_args!("{:?}", group.gaps),
        )?;
    }
    require_sphere(place, group.center, group.radius)
}

/// A range of MEMBERS as indices; no overflow, since `usize` has 64 bits or the file would not fit in memory.
pub(crate) fn member_range(first: u32, count: u32) -> Range<usize> {
    first as usize..(first as usize).saturating_add(count as usize)
}

/// Gives every page its place, in table order from `start`, and answers where the last one's padding ends.
pub(crate) fn place_pages(
    start: u64,
    align: u64,
    page_lens: impl IntoIterator<Item = u32>,
    mut place: impl FnMut(usize, u64) -> Result<(), FormatError>,
) -> Result<u64, FormatError> {
    let mut offset = start;
    for (index, len) in page_lens.into_iter().enumerate() {
        place(index, offset)?;
        let end = offset.checked_add(u64::from(len)).and_then(|end| align_up(end, align));
        offset = end.ok_or_else(|| invalid(FilePart::File, "length", "less than 2^64", "more"))?;
    }
    Ok(offset)
}

fn require_errors(place: FilePart, min: f32, max: f32) -> Result<(), FormatError> {
    let legal = min >= 0.0 && min <= max && max.is_finite();
    require(legal, place, "errors", "finite, 0 <= min <= max", format_args!("{min} and {max}"))
}

fn require_sphere(place: FilePart, center: [f32; 3], radius: f32) -> Result<(), FormatError> {
    let legal = center.iter().all(|x| x.is_finite()) && radius.is_finite() && radius >= 0.0;
    require(legal, place, "sphere", "finite, radius >= 0", format_args!("{center:?} radius {radius}"))
}
