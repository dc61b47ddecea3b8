//! A file in one screen: what it is, how big, how good, and what to do next. All of it from the tables.

use crate::escape::in_line;
use crate::number::{Short, Units};
use crate::report::{self, LevelRow, per_triangle};
use chpm_build::config::Normals;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Metadata, SectionKind};
use chpm_mesh::{Bytes, ClusterId, Counted, GroupId, Level, Scalar, ScalarRange};
use chpm_refine::{Cut, Member};
use std::io::{self, Write};
use std::path::Path;

/// Rows of the table of what can be drawn, at most.
const ROWS: usize = 6;
/// Largest share of the triangles of the level below that still counts as halved.
const HALVED: f64 = 0.6;
/// Shared vertices among those of a level, from which on seams are a burden.
const SHARED: f64 = 0.4;
/// Components, from which on many of them may be dust.
const DUST: u64 = 100;
/// Triangles of a coarsest mesh that anything can draw.
const TOP: u64 = 1000;

/// Where the bytes of a file are.
pub(crate) struct Sizes {
    pub(crate) file: u64,
    pub(crate) tables: u64,
    /// Of the tables: what tells chunks of them.
    pub(crate) chunks: u64,
    pub(crate) pages: u64,
    pub(crate) padding: u64,
}

impl Sizes {
    pub(crate) fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let pages: u64 = file.clusters().iter().map(|cluster| u64::from(cluster.page_len)).sum();
        let len =
            |wanted| file.sections().find(|(kind, _)| *kind == wanted).map(|(_, range)| range.len() as u64);
        let padded = len(SectionKind::Pages).unwrap_or(pages);
        let chunks = len(SectionKind::Chunks).unwrap_or(0);
        let whole = file.header().file_len;
        Sizes { file: whole, tables: whole - padded, chunks, pages, padding: padded - pages }
    }
}

/// A mesh that a file can draw as it is: all clusters of a level at their finest, or the roots at their coarsest.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Drawable {
    /// None for the coarsest.
    pub(crate) level: Option<u32>,
    pub(crate) clusters: u64,
    pub(crate) triangles: u64,
    /// The largest distance from the source.
    pub(crate) distance: f64,
}

/// The meshes of a file from the finest to the coarsest, as `extract --level` has them.
pub(crate) fn drawables<D: AsRef<[u8]>>(file: &Chpm<D>) -> Vec<Drawable> {
    let of = |level: Option<u32>, cut: &Cut| {
        let mut mesh = Drawable { level, clusters: cut.members().len() as u64, triangles: 0, distance: 0.0 };
        for member in cut.members() {
            let record = &file.clusters()[member.cluster.index()];
            let is_base = member.vertices == record.base_vertex_count;
            let error = if is_base { record.max_error } else { record.min_error };
            mesh.triangles +=
                u64::from(if is_base { record.base_triangle_count } else { record.triangle_count });
            mesh.distance = mesh.distance.max(file.gaps(record.group()).distance(error).into());
        }
        mesh
    };
    let levels = 0..file.header().level_count;
    let mut meshes: Vec<Drawable> =
        levels.map(|level| of(Some(level), &Cut::at_level(file, Level(level)))).collect();
    let base = |cluster| Member { cluster, vertices: file.clusters()[cluster.index()].base_vertex_count };
    meshes.push(of(None, &Cut::new(file.roots().map(base).collect())));
    meshes
}

/// At most [`ROWS`] of them, first and last among these.
fn some<T: Copy>(rows: &[T]) -> Vec<T> {
    let shown = rows.len().min(ROWS);
    let last = rows.len().saturating_sub(1);
    let place = |row: usize| if shown < 2 { 0 } else { row * last / (shown - 1) };
    (0..shown).filter_map(|row| rows.get(place(row)).copied()).collect()
}

/// Prints the facts that people look at first.
pub(crate) fn print(
    path: &Path,
    file: &Chpm<MappedFile>,
    metadata: Option<&Metadata>,
    levels: &[LevelRow],
    out: &mut impl Write,
) -> io::Result<()> {
    let h = file.header();
    let (by, from) = metadata.map_or(("unknown".into(), String::new()), |metadata| {
        (in_line(&metadata.generator), format!(", from {}", in_line(&metadata.source.name)))
    });
    writeln!(out, "{}: CHPM {}.{}, by {by}{from}", path.display(), h.version_major, h.version_minor)?;
    print_model(file, metadata, out)?;
    let sizes = Sizes::of(file);
    writeln!(
        out,
        "size       {}, {:.1} bytes a source triangle; pages {}{}, padding {}, tables {}",
        Bytes(sizes.file),
        per_triangle(sizes.file, h.source_triangle_count),
        Bytes(sizes.pages),
        if h.is_packed() { " packed" } else { "" },
        Bytes(sizes.padding),
        Bytes(sizes.tables),
    )?;
    writeln!(
        out,
        "error      up to {} units ({}); distance {}; boundary {}",
        Units(h.max_error.into()),
        error_kind(file),
        max_distance(file)
            .map_or("unknown".to_owned(), |distance| format!("up to {} units", Units(distance.into()))),
        boundary(file)
    )?;
    let remarks = remarks(file, metadata, levels);
    if remarks.is_empty() {
        writeln!(out, "good       {}", praise(file, levels))?;
    }
    for remark in remarks {
        writeln!(out, "look at    {remark}")?;
    }
    print_drawables(file, out)
}

/// Where the normals are from, if there are any: the source or the build.
pub(crate) fn normals_from<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    metadata: Option<&Metadata>,
) -> Option<&'static str> {
    let computed = ("normals".to_owned(), Normals::Computed.to_string());
    let is_computed = metadata.is_some_and(|metadata| metadata.settings.contains(&computed));
    file.header().attributes().has_normals().then_some(if is_computed { "computed" } else { "source" })
}

fn print_model(file: &Chpm<MappedFile>, metadata: Option<&Metadata>, out: &mut impl Write) -> io::Result<()> {
    let h = file.header();
    let attributes = match (normals_from(file, metadata), h.attributes().colors) {
        (None, false) => "positions only",
        (None, true) => "with colours",
        (Some("computed"), false) => "with computed normals",
        (Some("computed"), true) => "with computed normals and colours",
        (Some(_), false) => "with normals",
        (Some(_), true) => "with normals and colours",
    };
    let (triangles, vertices) = (h.source_triangle_count, h.source_vertex_count);
    let (triangles, vertices) = (Short(triangles).of("triangle"), Short(vertices).of("vertex"));
    writeln!(out, "model      {triangles}, {vertices}, {attributes}")?;
    for Scalar { name, kind, range: ScalarRange { low, high, count } } in file.scalars() {
        let name = in_line(name);
        let none = Short(h.source_vertex_count.saturating_sub(*count)).of("vertex");
        let without =
            if *count < h.source_vertex_count { format!(", none for {none}") } else { String::new() };
        writeln!(out, "scalar     {name}: {kind}, {low} to {high}{without}")?;
    }
    let bounds = h.aabb();
    let [x, y, z] = [0, 1, 2].map(|axis| Units(f64::from(bounds.max[axis]) - f64::from(bounds.min[axis])));
    let origin = if h.origin == [0.0; 3] {
        String::new()
    } else {
        format!(", relative to {}", report::point(h.origin))
    };
    writeln!(
        out,
        "box        {x} x {y} x {z} units, from {} to {}{origin}",
        report::point(bounds.min.map(f64::from)),
        report::point(bounds.max.map(f64::from))
    )?;
    writeln!(
        out,
        "hierarchy  {} ({}, {} at the top) in {}",
        Short(h.cluster_count.into()).of("cluster"),
        Short(h.leaf_count.into()).of("leaf"),
        Short(h.root_count.into()),
        Counted(h.level_count.into(), "level"),
    )
}

fn print_drawables<D: AsRef<[u8]>>(file: &Chpm<D>, out: &mut impl Write) -> io::Result<()> {
    let diagonal = file.header().aabb().diagonal();
    let rows = some(&drawables(file)).into_iter().map(|row| {
        let share = if diagonal > 0.0 { 100.0 * row.distance / diagonal } else { 0.0 };
        vec![
            row.level.map_or_else(|| "the coarsest".to_owned(), |level| format!("--level {level}")),
            Short(row.clusters).to_string(),
            Short(row.triangles).to_string(),
            Units(row.distance).to_string(),
            format!("{} %", Units(share)),
        ]
    });
    let head = ["what it draws", "clusters", "triangles", "at most so far away", "of the diagonal"];
    writeln!(out, "\n{}", report::table(&head, rows))
}

/// Remarks on things that are not as they should be, and where to look further.
pub(crate) fn remarks<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    metadata: Option<&Metadata>,
    levels: &[LevelRow],
) -> Vec<String> {
    let mut remarks = Vec::new();
    for [below, level] in levels.array_windows() {
        let ratio = level.triangles as f64 / below.triangles.max(1) as f64;
        // Where nearly nothing is left there is nothing to halve.
        if ratio > HALVED && level.triangles > TOP {
            let share = 100.0 * ratio;
            remarks.push(format!(
                "level {} keeps {share:.0} % of the triangles below it: --refusals tells why",
                level.level
            ));
        }
    }
    remarks.truncate(3);
    let shared = |level: &&LevelRow| level.shared_vertices as f64 > SHARED * level.vertices as f64;
    if let Some(level) = levels.iter().find(shared) {
        let share = 100.0 * level.shared_vertices as f64 / level.vertices as f64;
        remarks.push(format!(
            "{share:.0} % of the vertices of level {} are shared: larger --cluster-triangles have fewer",
            level.level
        ));
    }
    let top: u64 = file
        .roots()
        .map(|root: ClusterId| u64::from(file.clusters()[root.index()].base_triangle_count))
        .sum();
    if top > TOP {
        remarks.push(format!(
            "the coarsest mesh has {}, of {}",
            Short(top).of("triangle"),
            Counted(file.header().root_count.into(), "root")
        ));
    }
    let stalled: u64 = levels.iter().map(|level| u64::from(level.stalled_clusters)).sum();
    if 50 * stalled > u64::from(file.header().cluster_count) {
        remarks.push(format!("{} kept more triangles than half: --levels", Short(stalled).of("cluster")));
    }
    let mut repairs = metadata.iter().flat_map(|metadata| &metadata.repairs);
    if let Some((_, pieces)) = repairs.find(|(name, pieces)| name == "components" && *pieces > DUST) {
        let pieces = Short(*pieces).of("piece");
        remarks.push(format!("{pieces} that lie apart: if it is dust, --min-component leaves it out"));
    }
    if file.is_trimmed() {
        remarks.push("detail of the source was left out when it was built: --settings".to_owned());
    }
    remarks
}

/// Remark on a file where all is as it should be.
pub(crate) fn praise<D: AsRef<[u8]>>(file: &Chpm<D>, levels: &[LevelRow]) -> String {
    let ratios = levels
        .array_windows()
        .map(|[below, level]| 100.0 * level.triangles as f64 / below.triangles.max(1) as f64);
    let (least, most) =
        ratios.fold((f64::INFINITY, 0.0_f64), |(least, most), ratio| (least.min(ratio), most.max(ratio)));
    let shared =
        levels.iter().map(|level| 100.0 * level.shared_vertices as f64 / level.vertices.max(1) as f64);
    let shared = shared.fold(0.0, f64::max);
    let top: u64 =
        file.roots().map(|root| u64::from(file.clusters()[root.index()].base_triangle_count)).sum();
    let top = Short(top).of("triangle");
    if levels.len() < 2 {
        return format!("one level down to {top}");
    }
    let ratio = match (format!("{least:.0}"), format!("{most:.0}")) {
        (least, most) if least == most => least,
        (least, most) => format!("{least} to {most}"),
    };
    format!(
        "each level has {ratio} % of the triangles below it, down to {top}; at most {shared:.0} % of the vertices are shared"
    )
}

/// The largest distance of any mesh of the file to the source; unknown where it does not tell what has vanished.
pub(crate) fn max_distance<D: AsRef<[u8]>>(file: &Chpm<D>) -> Option<f32> {
    let gaps = (0..file.groups().len() as u32).map(|id| file.gaps(GroupId(id)).base);
    // The largest number is written where a file of before has told nothing.
    let distance = gaps.fold(file.header().max_error, f32::max);
    (file.has_gaps() && distance < f32::MAX).then_some(distance)
}

pub(crate) fn error_kind<D: AsRef<[u8]>>(file: &Chpm<D>) -> String {
    file.header().error_kind().map_or_else(|| "unknown".to_owned(), |kind| kind.to_string())
}

pub(crate) fn boundary<D: AsRef<[u8]>>(file: &Chpm<D>) -> String {
    file.header().boundary_mode().map_or_else(|| "unknown".to_owned(), |mode| mode.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_screen_has_the_first_and_the_last_row() {
        let all: Vec<u32> = (0..23).collect();
        assert_eq!(some(&all), [0, 4, 8, 13, 17, 22]);
        assert_eq!((some(&all[..3]), some(&all[..1]), some(&all[..0])), (vec![0, 1, 2], vec![0], vec![]));
    }
}
