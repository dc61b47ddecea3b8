//! The checksums of the tables' chunks: what lets a reader that is far away begin before it has the tables.

use crate::checksum;
use crate::error::{FilePart, FormatError, require, require_eq};
use crate::records::{ClusterRecord, GroupRecord};
use crate::section_kind::SectionKind;
use chpm_mesh::GroupId;
use std::cmp::Reverse;

/// The tables that have chunks, in the order of their checksums.
pub(crate) const CHUNKED: [SectionKind; 3] =
    [SectionKind::Clusters, SectionKind::Groups, SectionKind::Members];
/// Bytes of a number in the list.
pub(crate) const WORD: usize = size_of::<u64>();
/// Legal lengths of a chunk.
const LENGTHS: std::ops::RangeInclusive<u64> = 1 << 12..=1 << 20;
/// Length of a chunk, unless the list becomes long.
const USUAL: u64 = 1 << 14;
/// Numbers in a list that is not long.
const SHORT: u64 = 1024;

/// Numbers in the list, for tables of these lengths.
fn count(chunk_len: u64, tables: [u64; 3]) -> u64 {
    1 + tables.into_iter().map(|len| len.div_ceil(chunk_len)).sum::<u64>()
}

/// Length of the chunks that a writer takes.
fn choose(tables: [u64; 3]) -> u64 {
    let mut chunk_len = USUAL;
    while chunk_len < *LENGTHS.end() && count(chunk_len, tables) > SHORT {
        chunk_len *= 2;
    }
    chunk_len
}

/// Bytes of the section that a writer makes of tables of these lengths.
pub(crate) fn section_len(tables: [u64; 3]) -> u64 {
    count(choose(tables), tables) * WORD as u64
}

/// The section for these tables.
pub(crate) fn encode(tables: [&[u8]; 3]) -> Vec<u64> {
    let chunk_len = choose(tables.map(|table| table.len() as u64));
    let sums = tables.into_iter().flat_map(|table| table.chunks(chunk_len as usize)).map(checksum);
    [chunk_len].into_iter().chain(sums).collect()
}

/// Decodes a section for tables of these lengths: how long a chunk is, and the checksums of each table's.
pub(crate) fn decode(section: &[u8], tables: [u64; 3]) -> Result<(u64, [Vec<u64>; 3]), FormatError> {
    let place = FilePart::Section(SectionKind::Chunks);
    let mut words = section.chunks_exact(WORD).map(bytemuck::pod_read_unaligned::<u64>);
    let chunk_len = words.next().unwrap_or(0);
    let legal = chunk_len.is_power_of_two() && LENGTHS.contains(&chunk_len);
    require(legal, place, "chunk_len", "a power of two, 4096 to 2^20", chunk_len)?;
    require_eq(place, "count", count(chunk_len, tables), (section.len() / WORD) as u64)?;
    let sums = tables.map(|len| words.by_ref().take(len.div_ceil(chunk_len) as usize).collect());
    Ok((chunk_len, sums))
}

/// Checks the order of the tables: the top of the hierarchy comes first.
pub(crate) fn check_order(
    clusters: &[ClusterRecord],
    groups: &[GroupRecord],
    members: &[u32],
) -> Result<(), FormatError> {
    fn place(kind: SectionKind) -> FilePart {
        FilePart::Section(kind)
    }
    let roots_first = clusters.is_sorted_by_key(|cluster| Reverse(cluster.is_root()));
    require(roots_first, place(SectionKind::Clusters), "order", "the roots first", "others before them")?;
    let mut end = 0_u32;
    for group in groups {
        let fine = group.fine_count == 0 || group.fine_first == end.saturating_add(group.coarse_count);
        let here = group.coarse_first == end && fine;
        require(
            here,
            place(SectionKind::Members),
            "order",
            "that of the groups, coarse before fine",
            "another",
        )?;
        end = end.saturating_add(group.coarse_count).saturating_add(group.fine_count);
    }
    // Within a range ids ascend.
    let by_least =
        groups.is_sorted_by_key(|group: &GroupRecord| members.get(group.coarse_first as usize).copied());
    require(by_least, place(SectionKind::Groups), "order", "by the least coarse cluster", "another")
}

/// Puts groups and members in their order. Ranges that lie outside are left to who checks the tables.
pub(crate) fn sort(clusters: &mut [ClusterRecord], groups: &mut Vec<GroupRecord>, members: &mut Vec<u32>) {
    fn ids(first: u32, count: u32, members: &[u32]) -> &[u32] {
        members.get(first as usize..first as usize + count as usize).unwrap_or(&[])
    }
    fn least(group: &GroupRecord, members: &[u32]) -> Option<u32> {
        ids(group.coarse_first, group.coarse_count, members).iter().min().copied()
    }
    let mut order: Vec<u32> = (0..groups.len() as u32).collect();
    order.sort_by_key(|group| least(&groups[*group as usize], members));

    let mut place = vec![0; groups.len()];
    let mut sorted = Vec::with_capacity(members.len());
    let moved = (0..).zip(&order).map(|(new, old)| {
        place[*old as usize] = new;
        let group = groups[*old as usize];
        let coarse_first = sorted.len() as u32;
        sorted.extend_from_slice(ids(group.coarse_first, group.coarse_count, members));
        let fine_first = sorted.len() as u32;
        sorted.extend_from_slice(ids(group.fine_first, group.fine_count, members));
        GroupRecord { coarse_first, fine_first, ..group }
    });
    *groups = moved.collect();
    *members = sorted;
    for cluster in clusters {
        renumber(&mut cluster.group, &place);
        renumber(&mut cluster.parent_group, &place);
    }
}

fn renumber(group: &mut u32, place: &[u32]) {
    if let Some(place) = place.get(GroupId(*group).index()) {
        *group = *place;
    }
}
