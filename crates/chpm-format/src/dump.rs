//! The canonical text of a file: equal files give equal texts, and the other way round but for padding.

use crate::error::FormatError;
use crate::gaps::Gaps;
use crate::page::Page;
use crate::reader::Chpm;
use crate::records::{ClusterRecord, GroupRecord, LevelRecord, REFUSALS};
use crate::remnant::Remnant;
use crate::sheet::{SheetLayout, SheetRecord};
use crate::volume::VolumeRecord;
use chpm_mesh::{Chart, ClusterId, GroupId, Scalar, ScalarKind, ScalarRange, scalar_places};
use std::io::Write;

/// Writes the header, the tables and the metadata as text, one record a line, and with `pages` the content of every
/// page. Numbers are written so that they read back to equal bits.
///
/// # Errors
/// [`FormatError::Write`]; and when all is written, what is wrong with the first damaged page. That, and what is wrong with metadata or with other pages, is part of the
/// text, too.
pub fn dump<D: AsRef<[u8]>>(file: &Chpm<D>, out: &mut impl Write, pages: bool) -> Result<(), FormatError> {
    header(file, out)?;
    for level in file.levels() {
        dump_level(level, out)?;
    }
    for (id, group) in (0..).map(GroupId).zip(file.groups()) {
        dump_group(id, group, file.coarse(id), file.fine(id), out)?;
    }
    file.remnants().iter().try_for_each(|remnant| dump_remnant(remnant, out))?;
    let mut damage = Ok(());
    for (id, record) in (0..).map(ClusterId).zip(file.clusters()) {
        if pages {
            match cluster(file, id, out) {
                error @ Err(FormatError::Write(_)) => return error,
                found => damage = damage.and(found),
            }
        } else {
            dump_cluster(id, record, out)?;
            file.sheets().get(id.index()).map_or(Ok(()), |sheet| dump_sheet(sheet, out))?;
        }
    }
    damage
}

/// Writes one cluster and its page as [`dump`] does.
///
/// # Errors
/// As [`dump`].
///
/// # Panics
/// For a cluster that the file does not have.
pub fn cluster<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    id: ClusterId,
    out: &mut impl Write,
) -> Result<(), FormatError> {
    dump_cluster(id, &file.clusters()[id.index()], out)?;
    let page = match file.page(id) {
        Ok(page) => dump_page(&page.view(), file.scalars(), out),
        Err(error) => {
            writeln!(out, "  unreadable {error}")?;
            Err(error)
        }
    };
    let Some(record) = file.sheets().get(id.index()) else { return page };
    dump_sheet(record, out)?;
    match file.sheet(id) {
        Ok(sheet) => sheet.map_or(Ok(()), |sheet| dump_layout(&sheet.layout, out))?,
        Err(error) => {
            writeln!(out, "  unreadable {error}")?;
            return page.and(Err(error));
        }
    }
    page
}

fn dump_sheet(record: &SheetRecord, out: &mut impl Write) -> Result<(), FormatError> {
    let SheetRecord { cluster, chart_count, offset, layout_len, image_len, size, .. } = record;
    let codec = record.codec().map_or_else(|| record.codec.to_string(), |codec| codec.to_string());
    write!(out, "sheet of {} {} x {} {codec} charts {chart_count}", ClusterId(*cluster), size[0], size[1])?;
    write!(out, " texel {:?} at {offset} layout {layout_len} image {image_len}", record.texel)?;
    writeln!(out, " checksum {:016x}", record.checksum)?;
    Ok(())
}

fn dump_layout(layout: &SheetLayout, out: &mut impl Write) -> Result<(), FormatError> {
    writeln!(out, "  charts from {:?}", layout.origin)?;
    for (at, Chart { axes, offset, rect }) in layout.charts.iter().enumerate() {
        writeln!(out, "  chart {at} axes {axes:?} offset {offset:?} rect {rect:?}")?;
    }
    writeln!(out, "  charts of triangles {:?}", layout.chart_of)?;
    Ok(())
}

fn header<D: AsRef<[u8]>>(file: &Chpm<D>, out: &mut impl Write) -> Result<(), FormatError> {
    let h = file.header();
    let has = h.attributes();
    writeln!(out, "chpm {}.{} file_len {}", h.version_major, h.version_minor, h.file_len)?;
    writeln!(out, "attributes normals {} colors {}", has.has_normals(), has.colors)?;
    for Scalar { name, kind, range } in file.scalars() {
        let ScalarRange { low, high, count } = range;
        writeln!(out, "scalar {name:?} {kind} low {low:?} high {high:?} count {count}")?;
    }
    writeln!(out, "source vertices {} triangles {}", h.source_vertex_count, h.source_triangle_count)?;

    let (c, g, l, r, leaves) = (h.cluster_count, h.group_count, h.level_count, h.root_count, h.leaf_count);
    writeln!(out, "counts clusters {c} groups {g} levels {l} roots {r} leaves {leaves}")?;
    writeln!(out, "shared_vertices {}", h.shared_vertex_count)?;
    if let (Some(boundary), Some(error)) = (h.boundary_mode(), h.error_kind()) {
        writeln!(out, "boundary {boundary}, error {error}")?;
    }

    writeln!(
        out,
        "origin {:?} min {:?} max {:?} max_error {:?}",
        h.origin, h.aabb_min, h.aabb_max, h.max_error
    )?;

    for (kind, range) in file.sections() {
        writeln!(out, "section {kind} {range:?}")?;
    }
    for (number, volume) in (1..).zip(file.volume_records()) {
        let VolumeRecord { offset, len, identity } = volume;
        writeln!(out, "volume {number} offset {offset} len {len} identity {identity:016x}")?;
    }
    match file.metadata() {
        Ok(metadata) => writeln!(out, "{metadata:#?}")?,
        Err(error) => writeln!(out, "unreadable {error}")?,
    }
    Ok(())
}

fn dump_level(level: &LevelRecord, out: &mut impl Write) -> Result<(), FormatError> {
    let l = level;
    write!(out, "level {} clusters {} stalled {}", l.level, l.cluster_count, l.stalled_cluster_count)?;
    write!(out, " forced {}", l.forced_collapse_count)?;
    write!(out, " vertices {} base {}", l.vertex_count, l.base_vertex_count)?;
    write!(out, " triangles {} base {}", l.triangle_count, l.base_triangle_count)?;
    write!(out, " shared {} errors {:?} {:?} refused", l.shared_vertex_count, l.min_error, l.max_error)?;
    for (reason, count) in REFUSALS.iter().zip(l.refusals) {
        write!(out, " {reason} {count}")?;
    }
    writeln!(out)?;
    Ok(())
}

fn dump_group(
    id: GroupId,
    group: &GroupRecord,
    coarse: &[u32],
    fine: &[u32],
    out: &mut impl Write,
) -> Result<(), FormatError> {
    write!(out, "{id} level {} coarse {coarse:?} fine {fine:?}", group.level)?;
    write!(out, " errors {:?} {:?}", group.min_error, group.max_error)?;
    let Gaps { fine: below, base, from } = group.gaps;
    write!(out, " gaps {below:?} {base:?} from {from:?}")?;
    if group.rest > 0.0 {
        write!(out, " rest {:?}", group.rest)?;
    }
    writeln!(out, " center {:?} radius {:?}", group.center, group.radius)?;
    Ok(())
}

fn dump_remnant(remnant: &Remnant, out: &mut impl Write) -> Result<(), FormatError> {
    let Remnant { center, radius, corners, bound, .. } = remnant;
    write!(out, "remnant of {} corners {corners:?} within {bound:?}", remnant.cluster())?;
    writeln!(out, " center {center:?} radius {radius:?}")?;
    Ok(())
}

fn dump_cluster(id: ClusterId, record: &ClusterRecord, out: &mut impl Write) -> Result<(), FormatError> {
    let c = record;
    write!(out, "{id} level {} {} parent {}", c.level, c.group(), c.parent_group())?;
    write!(out, " page {} len {} checksum {:016x}", c.page_offset, c.page_len, c.page_checksum)?;
    write!(out, " vertices {} base {}", c.vertex_count, c.base_vertex_count)?;
    write!(out, " triangles {} base {}", c.triangle_count, c.base_triangle_count)?;
    write!(out, " shared {} errors {:?} {:?}", c.shared_count, c.min_error, c.max_error)?;
    write!(out, " min {:?} max {:?}", c.aabb_min, c.aabb_max)?;
    write!(out, " center {:?} radius {:?}", c.center, c.radius)?;
    // Of positions alone there is nothing to tell.
    if c.normal_deviation.to_bits() | c.color_deviation.to_bits() != 0 {
        write!(out, " deviations normal {:?} color {:?}", c.normal_deviation, c.color_deviation)?;
    }
    writeln!(out)?;
    Ok(())
}

fn dump_page(page: &Page<'_>, scalars: &[Scalar], out: &mut impl Write) -> Result<(), FormatError> {
    writeln!(out, "  page min_error {:?} error_scale {:?}", page.min_error, page.error_scale)?;

    let mut shared = page.shared().peekable();
    for (vertex, position) in page.positions.iter().enumerate() {
        write!(out, "  vertex {vertex} {position:?}")?;
        if let Some(normal) = page.normal(vertex) {
            write!(out, " normal {normal:?}")?;
        }
        if let Some(color) = page.colors.get(vertex) {
            write!(out, " color {color:?}")?;
        }
        for (place, Scalar { name, kind, .. }) in scalar_places(scalars) {
            dump_scalar(name, *kind, &page.scalars_of(vertex)[place], out)?;
        }
        if let Some((_, id)) = shared.next_if(|(local, _)| usize::from(*local) == vertex) {
            write!(out, " shared {id}")?;
        }
        if let Some(j) = vertex.checked_sub(page.base_vertex_count) {
            write!(
                out,
                " to {} code {} error {:?}",
                page.targets[j],
                page.error_codes[j],
                page.error_at(vertex)
            )?;
        }
        writeln!(out)?;
    }

    for corners in page.triangles {
        writeln!(out, "  triangle {corners:?}")?;
    }
    Ok(())
}

/// Writes a scalar; one that is no number by its words, since there are many.
fn dump_scalar(name: &str, kind: ScalarKind, words: &[u32], out: &mut impl Write) -> Result<(), FormatError> {
    let value = kind.value(words);
    match value.is_nan() {
        true => write!(out, " {name:?} words {words:x?}")?,
        false => write!(out, " {name:?} {value:?}")?,
    }
    Ok(())
}
