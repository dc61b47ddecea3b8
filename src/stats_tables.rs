//! Statistics as tables for people, and clusters as CSV.

use crate::number::{Short, Units};
use crate::report::table;
use chpm_mesh::Bytes;
use chpm_report::stats::{CACHES, LevelStats, Row, Spread, Stats, worst};
use serde_json::Value;
use std::io::{self, Write};

/// All tables.
pub(crate) fn print(stats: &Stats, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "{}\n\n{}\n\n{}", clusters(&stats.levels), errors(&stats.levels), layout(&stats.levels))?;
    if stats.levels.iter().any(|level| level.sheets.is_some()) {
        writeln!(out, "\n{}", sheets(&stats.levels))?;
    }
    print_whole(stats, out)?;
    writeln!(out, "\n{}", worst_table(stats))?;
    writeln!(out, "\nchpm dump FILE --cluster ID shows one of them")
}

fn count(value: f64) -> String {
    Short(value as u64).to_string()
}

fn percent(value: f64) -> String {
    format!("{:.1} %", 100.0 * value)
}

fn two(value: f64) -> String {
    format!("{value:.2}")
}

fn units(value: f64) -> String {
    Units(value).to_string()
}

/// A value of a spread; a dash where there is none.
fn cell(spread: Option<Spread>, of: fn(&Spread) -> f64, text: fn(f64) -> String) -> String {
    spread.as_ref().map_or("-".to_owned(), |spread| text(of(spread)))
}

fn clusters(levels: &[LevelStats]) -> String {
    let rows = levels.iter().map(|level| {
        vec![
            level.level.to_string(),
            Short(level.clusters.into()).to_string(),
            cell(level.triangles, |s| s.min, count),
            cell(level.triangles, |s| s.median, count),
            cell(level.triangles, |s| s.max, count),
            cell(level.collapses, |s| s.median, count),
            percent(level.shared),
            cell(
                level.border_levels,
                |s| s.median,
                |life| format!("{life} levels").replace("1 levels", "1 level"),
            ),
            Short(level.groups.into()).to_string(),
            cell(level.group_size, |s| s.max, count),
        ]
    });

    let header = [
        "level",
        "clusters",
        "triangles: least",
        "median",
        "most",
        "collapses",
        "shared",
        "for",
        "groups",
        "largest",
    ];
    table(&header, rows)
}

fn errors(levels: &[LevelStats]) -> String {
    let measured = levels.iter().any(|level| level.tightness.is_some());
    let rows = levels.iter().map(|level| {
        let columns: [fn(&Spread) -> f64; 6] =
            [|s| s.min, |s| s.p25, |s| s.median, |s| s.p75, |s| s.p95, |s| s.max];
        let mut row = vec![level.level.to_string()];
        row.extend(columns.map(|of| cell(level.max_error, of, units)));
        if measured {
            fn tightness(name: &str, level_tightness: &Option<Value>) -> Option<f64> {
                level_tightness.as_ref().and_then(|t| t[name].as_f64())
            }
            row.extend(
                ["median", "max"].map(|name| tightness(name, &level.tightness).map_or("-".to_owned(), two)),
            );
        }
        row
    });
    let mut header = vec!["level", "error: least", "25 %", "median", "75 %", "95 %", "most"];
    header.extend(measured.then_some(["stored by measured: median", "most"]).into_iter().flatten());
    table(&header, rows)
}

fn layout(levels: &[LevelStats]) -> String {
    let rows = levels.iter().map(|level| {
        vec![
            level.level.to_string(),
            cell(level.aspect, |s| s.median, two),
            cell(level.aspect, |s| s.max, two),
            cell(level.overlap, |s| s.median, percent),
            cell(level.overlap, |s| s.max, percent),
            Bytes(level.page_bytes).to_string(),
            format!("{:.3}", level.acmr24),
            format!("{:.1}", level.edge_span),
        ]
    });
    let header =
        ["level", "box aspect: median", "most", "overlap: median", "most", "pages", "ACMR 24", "edge span"];
    table(&header, rows)
}

fn sheets(levels: &[LevelStats]) -> String {
    let rows = levels.iter().filter_map(|level| {
        let sheets = level.sheets?;
        Some(vec![
            level.level.to_string(),
            Short(sheets.texels).to_string(),
            cell(sheets.charts, |s| s.median, count),
            cell(sheets.charts, |s| s.max, count),
            cell(sheets.texel, |s| s.min, units),
            cell(sheets.texel, |s| s.median, units),
            cell(sheets.texel, |s| s.max, units),
            Bytes(sheets.bytes).to_string(),
            two(sheets.bits_per_texel),
        ])
    });
    let header = [
        "level",
        "texels",
        "charts: median",
        "most",
        "texel: least",
        "median",
        "most",
        "sheets",
        "bits a texel",
    ];
    table(&header, rows)
}

fn print_whole(stats: &Stats, out: &mut impl Write) -> io::Result<()> {
    fn measure(name: &str, stats_measures: &serde_json::Map<String, Value>) -> f64 {
        stats_measures.get(name).and_then(Value::as_f64).unwrap_or(0.0)
    }
    let (height, least) = (measure("height", &stats.measures), measure("least_height", &stats.measures));
    let longest = stats.groups.longest_path;
    writeln!(
        out,
        "\nheight {height}, {least} is the least for so many leaves; at most {longest} groups one below the other"
    )?;
    if let lying @ 1.. = stats.levels.iter().map(|level| level.coincident).sum() {
        let base = stats.levels.first().map_or(0, |level| level.coincident);
        writeln!(
            out,
            "coincident faces within clusters: {}, {} of them at level 0",
            Short(lying),
            Short(base)
        )?;
    }
    let [a, b, c] =
        CACHES.map(|size| format!("{:.3} with {size}", measure(&format!("acmr{size}"), &stats.measures)));
    writeln!(
        out,
        "cache misses a triangle: {a}, {b}, {c} vertices; edge span {:.1}",
        measure("edge_span", &stats.measures)
    )?;
    let bytes = &stats.bytes;
    let told = bytes.all().filter(|(_, bytes)| *bytes > 0.0);
    let told: Vec<String> = told.map(|(part, bytes)| format!("{part} {}", Bytes(bytes as u64))).collect();
    writeln!(out, "bytes: {}", told.join(", "))
}

/// A row for each measure: the worst clusters, with their levels and values.
fn worst_table(stats: &Stats) -> String {
    let rows = stats.worst.iter().map(|worst| {
        let mut row = vec![worst::words(worst.measure).to_owned()];
        fn cell(named: &worst::Named) -> String {
            format!("{} ({})", named.cluster, Units(named.value))
        }
        row.extend(worst.clusters.iter().map(cell));
        row.resize(1 + 5, String::new());
        row
    });
    table(&["the worst clusters by", "first", "second", "third", "fourth", "fifth"], rows)
}

/// A row for each cluster.
pub(crate) fn csv(rows: &[Row<'_>], out: &mut impl Write) -> io::Result<()> {
    writeln!(
        out,
        "cluster,level,group,parent_group,vertices,base_vertices,triangles,base_triangles,shared_vertices,collapses,min_error,max_error,\
         normal_deviation,color_deviation,aspect,overlap,page_bytes,acmr16,acmr24,acmr32,edge_span"
    )?;
    fn known(value: Option<f64>) -> String {
        value.map_or(String::new(), |value| value.to_string())
    }

    for row in rows {
        let r = row.record;
        let parent = if r.is_root() { String::new() } else { r.parent_group.to_string() };
        write!(
            out,
            "{},{},{},{parent},{},{},",
            row.id, r.level, r.group, r.vertex_count, r.base_vertex_count
        )?;
        write!(
            out,
            "{},{},{},{},",
            r.triangle_count,
            r.base_triangle_count,
            r.shared_count,
            row.collapses()
        )?;
        write!(out, "{},{},{},{},", r.min_error, r.max_error, r.normal_deviation, r.color_deviation)?;
        let [a, b, c] = row.acmr();
        let (aspect, overlap, bytes) = (known(row.aspect), known(row.overlap), r.page_len);
        writeln!(out, "{aspect},{overlap},{bytes},{a},{b},{c},{}", row.edge_span())?;
    }
    Ok(())
}
