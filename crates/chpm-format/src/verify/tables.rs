//! Checks of the tables alone: statistics, balance, errors and spheres over the groups.

use super::{Invariant, Report};
use crate::chunks::{self, CHUNKED};
use crate::error::FilePart;
use crate::gaps::Gaps;
use crate::header::VERSION_MINOR;
use crate::reader::Chpm;
use crate::records::ClusterRecord;
use crate::section::{self, SectionKind};
use crate::tables::{bounds, leaf_triangles, max_error, statistics};
use crate::{TABLE_ALIGN, align_up, checksum, volume};
use chpm_mesh::{ClusterId, GroupId};
use std::fmt::Debug;

pub(super) fn check<D: AsRef<[u8]>>(file: &Chpm<D>, report: &mut Report) {
    check_header(file, report);
    check_levels(file, report);
    check_zeros(file, report);
    check_chunks(file, report);
    check_volumes(file, report);
    for id in (0..file.groups().len() as u32).map(GroupId) {
        check_group(file, id, report);
    }
    if let Err(error) = file.metadata().and_then(|metadata| metadata.lattice_step()) {
        report.expect(false, Invariant::Bytes, FilePart::File, error);
    }
}

fn check_header<D: AsRef<[u8]>>(file: &Chpm<D>, report: &mut Report) {
    let (header, clusters) = (file.header(), file.clusters());
    let bounds = bounds(clusters);
    equal(
        report,
        Invariant::Coverage,
        FilePart::Header,
        "source_triangle_count",
        leaf_triangles(clusters),
        header.source_triangle_count,
    );
    equal(report, Invariant::Nesting, FilePart::Header, "max_error", max_error(clusters), header.max_error);
    equal(report, Invariant::Nesting, FilePart::Header, "aabb_min", bounds.min, header.aabb_min);
    equal(report, Invariant::Nesting, FilePart::Header, "aabb_max", bounds.max, header.aabb_max);
    let height = file.levels().len() as u32 - 1;
    let allowed = header.leaf_count.max(1).next_power_of_two().ilog2() + 1;
    let message = format_args!("height at most {allowed} over {} leaves, got {height}", header.leaf_count);
    // Where detail was left out, it is the tree below that was balanced.
    report.expect(file.is_trimmed() || height <= allowed, Invariant::Balance, FilePart::Header, message);
}

fn check_levels<D: AsRef<[u8]>>(file: &Chpm<D>, report: &mut Report) {
    for (computed, stored) in statistics(file.clusters(), file.levels()).iter().zip(file.levels()) {
        let place = FilePart::Level(stored.level);
        equal(report, Invariant::Bytes, place, "statistics", *computed, *stored);
        report.expect(stored.cluster_count > 0, Invariant::Balance, place, "a cluster expected, got none");
        let stalled = stored.stalled_cluster_count <= stored.cluster_count;
        report.expect(stalled, Invariant::Bytes, place, "more clusters stalled than there are");
    }
}

/// Reserved fields are zero in the versions that are known; a later minor version may use them.
fn check_zeros<D: AsRef<[u8]>>(file: &Chpm<D>, report: &mut Report) {
    let header = file.header();
    if header.version_minor > VERSION_MINOR {
        return;
    }
    let mut zero = |ok, place| report.expect(ok, Invariant::Bytes, place, "zero expected in reserved fields");
    zero(header.reserved == [0; 92] && header.optional_flags == 0, FilePart::Header);
    for (id, c) in (0..).map(ClusterId).zip(file.clusters()) {
        let absent = [
            (header.attributes().has_normals() || c.normal_deviation.to_bits() == 0),
            (header.attributes().colors || c.color_deviation.to_bits() == 0),
        ];
        let known = if header.is_packed() { ClusterRecord::PACKED } else { 0 } | ClusterRecord::TRIMMED;
        let flags = c.flags & !known;
        zero(flags == 0 && absent == [true; 2] && c.reserved == [0; 16], FilePart::Cluster(id));
    }
    let remnants = FilePart::Section(SectionKind::Remnants);
    file.remnants().iter().for_each(|remnant| zero(remnant.reserved == [0; 2], remnants));
    for (id, g) in (0..).map(GroupId).zip(file.groups()) {
        let told = file.has_gaps() || bytemuck::bytes_of(&g.gaps) == [0; size_of::<Gaps>()];
        let told = told && (file.has_remnants() || g.rest.to_bits() == 0);
        zero(g.flags == 0 && told, FilePart::Group(id));
    }
}

/// Checksums of chunks, and the order that lets a reader do with the first of them.
fn check_chunks<D: AsRef<[u8]>>(file: &Chpm<D>, report: &mut Report) {
    if !file.is_chunked() {
        return;
    }

    let place = FilePart::Section(SectionKind::Chunks);
    let first = section::table_end(file.header()).next_multiple_of(TABLE_ALIGN as usize);
    let list = file.sections().find(|(kind, _)| *kind == SectionKind::Chunks);
    let is_first = list.is_some_and(|(_, range)| range.start == first);
    report.expect(is_first, Invariant::Bytes, place, "the first section expected");

    let tables = CHUNKED.map(|kind| file.section(kind));
    match chunks::decode(file.section(SectionKind::Chunks), tables.map(|table| table.len() as u64)) {
        Err(error) => report.expect(false, Invariant::Bytes, place, error),
        Ok((chunk_len, sums)) => {
            for ((kind, table), sums) in CHUNKED.into_iter().zip(tables).zip(sums) {
                for ((number, chunk), sum) in table.chunks(chunk_len as usize).enumerate().zip(sums) {
                    let got = checksum(chunk);
                    let message = format_args!(
                        "checksum {sum:016x} of chunk {number} of {kind} expected, got {got:016x}"
                    );
                    report.expect(sum == got, Invariant::Bytes, place, message);
                }
            }
        }
    }

    if let Err(error) = chunks::check_order(file.clusters(), file.groups(), file.members()) {
        report.expect(false, Invariant::Bytes, place, error);
    }
}

/// Zeros in heads of volumes behind what tells whose they are, and between sheets and pages.
fn check_volumes<D: AsRef<[u8]>>(file: &Chpm<D>, report: &mut Report) {
    let zero = |bytes: &[u8]| bytes.iter().all(|byte| *byte == 0);
    let known = file.header().version_minor <= VERSION_MINOR;
    for (number, volume) in (1..).zip(file.volumes()) {
        let reserved = &volume.as_ref()[volume::TOLD..volume::HEAD_LEN as usize];
        let place = FilePart::Volume(number);
        report.expect(!known || zero(reserved), Invariant::Bytes, place, "zeros in its head expected");
    }
    let range = |kind| file.sections().find(|(found, _)| *found == kind).map(|(_, range)| range);
    if let (Some(texels), Some(pages)) = (range(SectionKind::Texels), range(SectionKind::Pages)) {
        let padding = file.at(texels.end as u64, (pages.start - texels.end) as u64);
        let place = FilePart::Section(SectionKind::Texels);
        report.expect(padding.is_some_and(zero), Invariant::Bytes, place, "zeros behind sheets expected");
    }
}

/// A group bounds its members, and everything that its split brings (I2, I6).
fn check_group<D: AsRef<[u8]>>(file: &Chpm<D>, id: GroupId, report: &mut Report) {
    let (group, place) = (&file.groups()[id.index()], FilePart::Group(id));
    let coarse = || file.coarse(id).iter().map(|c| &file.clusters()[*c as usize]);
    let min_error = coarse().map(|c| c.min_error).fold(0.0, f32::max);
    let max_error = coarse().map(|c| c.max_error).fold(0.0, f32::max);
    equal(
        report,
        Invariant::Nesting,
        place,
        "min_error, the largest of the members,",
        min_error,
        group.min_error,
    );
    equal(
        report,
        Invariant::Nesting,
        place,
        "max_error, the largest of the members,",
        max_error,
        group.max_error,
    );

    let largest = |of: fn(&ClusterRecord) -> f32| coarse().map(of).fold(0.0, f32::max);
    let deviations = [largest(|c| c.normal_deviation), largest(|c| c.color_deviation)];
    let mut below = None;
    for fine in file.fine(id) {
        let cluster = &file.clusters()[*fine as usize];
        let least = [cluster.normal_deviation, cluster.color_deviation];
        for ((name, got), least) in ["normal", "color"].into_iter().zip(deviations).zip(least) {
            let message =
                format_args!("a {name}_deviation of at least {least} (cluster {fine} below), got {got}");
            report.expect(got >= least, Invariant::Nesting, place, message);
        }

        let fine_group = &file.groups()[cluster.group as usize];
        below = below.max(Some(cluster.level));
        let error = cluster.max_error.max(fine_group.max_error);
        let saturated = group.min_error >= error;
        let message =
            format_args!("min_error at least {error} (cluster {fine} below), got {}", group.min_error);
        report.expect(saturated, Invariant::Nesting, place, message);
        let (gap, gap_below) = (file.gaps(id).fine, file.gaps(cluster.group()).base);
        let message = format_args!("a fine gap of at least {gap_below} (cluster {fine} below), got {gap}");
        report.expect(gap >= gap_below, Invariant::Nesting, place, message);
        let (rest, least) = (group.rest, fine_group.rest);
        let message = format_args!("a rest gap of at least {least} (cluster {fine} below), got {rest}");
        report.expect(!file.has_remnants() || rest >= least, Invariant::Nesting, place, message);
        let nested = group.sphere().contains(&fine_group.sphere());
        let message = format_args!(
            "sphere around that of group {} expected, got {:?} with radius {}",
            cluster.group, group.center, group.radius
        );
        report.expect(nested, Invariant::Nesting, place, message);
    }

    let level = below.map_or(0, |level| level + 1);
    equal(
        report,
        Invariant::Balance,
        place,
        "level, one above the highest fine cluster,",
        level,
        group.level,
    );
}

/// Vertices of the leaves, where a shared one counts once (I1).
pub(super) fn check_source_vertices<D: AsRef<[u8]>>(file: &Chpm<D>, leaf_ids: u64, report: &mut Report) {
    let leaves = file.clusters().iter().filter(|c| c.is_leaf());
    let own: u64 = leaves.map(|c| u64::from(c.vertex_count - c.shared_count)).sum();
    let stored = file.header().source_vertex_count;
    equal(report, Invariant::Coverage, FilePart::Header, "source_vertex_count", own + leaf_ids, stored);
}

/// Whether the padding behind a page is zero.
pub(super) fn page_padding_is_zero<D: AsRef<[u8]>>(file: &Chpm<D>, id: ClusterId) -> bool {
    let record = &file.clusters()[id.index()];
    let end = record.page_offset + u64::from(record.page_len);
    let padded = align_up(end, file.header().page_align.into()).unwrap_or(end);
    file.at(end, padded - end).is_some_and(|padding| padding.iter().all(|b| *b == 0))
}

fn equal<T: PartialEq + Debug>(
    report: &mut Report,
    invariant: Invariant,
    place: FilePart,
    field: &str,
    expected: T,
    got: T,
) {
    let message = format_args!("{field} {expected:?} expected, got {got:?}");
    report.expect(expected == got, invariant, place, message);
}
