//! A file in one screen: what it is, how big, how good, and what to do next.

use crate::escape::in_line;
use crate::number::{Short, Units};
use crate::report::{self, LevelRow, per_triangle};
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Metadata, SheetRecord};
use chpm_mesh::{Bytes, Counted, Scalar, ScalarRange};
pub(crate) use chpm_report::digest::{Sizes, boundary, error_kind, max_distance, normals_from};
use chpm_report::digest::{drawables, praise, remarks};
use std::io::{self, Write};
use std::path::Path;

/// Rows of the table of what can be drawn, at most.
const ROWS: usize = 6;

/// At most [`ROWS`] of them, first and last among these.
fn some<T: Copy>(rows: &[T]) -> Vec<T> {
    if rows.len() <= ROWS {
        return rows.to_vec();
    }
    (0..ROWS).map(|row| rows[row * (rows.len() - 1) / (ROWS - 1)]).collect()
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
        match (h.is_chained(), h.is_packed()) {
            (true, _) => " chained",
            (false, true) => " packed",
            (false, false) => "",
        },
        Bytes(sizes.padding),
        Bytes(sizes.tables),
    )?;
    if let (Some(first), Some(last)) = (file.volumes().first(), file.volumes().last()) {
        let largest = file.volumes().iter().map(|volume| volume.len() as u64).max().unwrap_or(0);
        writeln!(
            out,
            "volumes    {} of up to {}, {} to {}; they go where the model goes, and are named as it is",
            Counted(file.volumes().len() as u64, "file"),
            Bytes(largest),
            name(first),
            name(last),
        )?;
    }
    if sizes.sheets > 0 {
        let texels = |sheet: &SheetRecord| u64::from(sheet.size[0]) * u64::from(sheet.size[1]);
        let largest = file.sheets().iter().flat_map(|sheet| sheet.size).max().unwrap_or(0);
        writeln!(
            out,
            "sheets     {} in images of up to {largest}, {}; view, render, pages, 3D Tiles and extract --texture-size have them, all else colours of vertices",
            Short(file.sheets().iter().map(texels).sum()).of("texel"),
            Bytes(sizes.sheets),
        )?;
    }
    let specks = file.remnants().len() as u64;
    writeln!(
        out,
        "error      up to {} units ({}); distance {}; boundary {}{}",
        Units(h.max_error.into()),
        error_kind(file),
        max_distance(file)
            .map_or("unknown".to_owned(), |distance| format!("up to {} units", Units(distance.into()))),
        boundary(file),
        if specks > 0 { format!("; {} vanish", Short(specks).of("piece")) } else { String::new() }
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

/// A file's own name, for people.
fn name(file: &MappedFile) -> String {
    in_line(&file.path().file_name().unwrap_or_default().to_string_lossy()).into_owned()
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
        format!(", relative to {}", report::point(h.origin, bounds.diagonal()))
    };
    writeln!(
        out,
        "box        {x} x {y} x {z} units, from {} to {}{origin}",
        report::point(bounds.min.map(f64::from), bounds.diagonal()),
        report::point(bounds.max.map(f64::from), bounds.diagonal())
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
