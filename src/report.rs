//! Results as tables for people and as JSON for programs. Both show the same numbers.

use crate::escape::in_line;
use crate::json::file::{Build, BuildSource, Stage};
use crate::number::{Digits, Short, Units};
use chpm_build::BuildReport;
use chpm_build::report::LevelReport;
use chpm_format::records::REFUSALS;
use chpm_mesh::{Bytes, Thousands};
pub(crate) use chpm_report::{LevelRow, levels_of, per_triangle};
use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};
use serde_json::{Map, Value};

/// A level as a build tells it.
pub(crate) fn level_row(level: &LevelReport) -> LevelRow {
    LevelRow {
        level: level.level,
        clusters: level.clusters,
        vertices: level.vertices,
        base_vertices: level.base_vertices,
        triangles: level.triangles,
        base_triangles: level.base_triangles,
        shared_vertices: level.shared_vertices,
        min_error: level.min_error,
        max_error: level.max_error,
        max_gap: level.max_gap,
        normal_deviation: level.normal_deviation,
        color_deviation: level.color_deviation,
        stalled_clusters: level.stalled,
        forced_collapses: level.forced,
        refusals: level.refusals.0,
    }
}

/// The stages of a build: time, throughput in triangles of the source, memory.
pub(crate) fn stages_table(report: &BuildReport) -> String {
    fn memory(bytes: Option<u64>) -> String {
        bytes.map_or("?".to_owned(), |n| Bytes(n).to_string())
    }
    let mut rows: Vec<Vec<String>> = Vec::new();
    for row in &report.stages {
        rows.push(vec![
            row.stage.to_string(),
            format!("{:.2}", row.seconds),
            rate(report.triangles, row.seconds),
            memory(row.peak_resident),
            Bytes(row.budget_used).to_string(),
        ]);
    }
    rows.push(vec![
        "all".to_owned(),
        format!("{:.2}", report.seconds()),
        rate(report.triangles, report.seconds()),
        memory(report.peak_resident),
        Bytes(report.budget_peak).to_string(),
    ]);
    table(&["stage", "seconds", "triangles/s", "peak memory", "arrays"], rows)
}

/// So many a second.
pub(crate) fn rate(n: u64, seconds: f64) -> String {
    match n as f64 / seconds {
        rate if rate.is_finite() => Short(rate as u64).to_string(),
        _ => "-".to_owned(),
    }
}

/// The levels, leaves first. "Ratio" is to the triangles of the level below; "shared" is the share of vertices that
/// other clusters have too, which collapse only within dependency groups; "forced" counts collapses that changed the topology
/// or turned a face over. The "max gap" of what has vanished is shown where something has, and what normals (in degrees) and colours (of 255)
/// deviate by where they do.
pub(crate) fn levels_table(levels: &[LevelRow]) -> String {
    let gaps = levels.iter().any(|level| level.max_gap > 0.0);
    let normals = levels.iter().any(|level| level.normal_deviation > 0.0);
    let colors = levels.iter().any(|level| level.color_deviation > 0.0);

    let mut below = None;
    let rows = levels.iter().map(|level| {
        let ratio = below.map_or("-".to_owned(), |below| share(level.triangles, below));
        below = Some(level.triangles);
        let mut row = vec![
            level.level.to_string(),
            Short(level.clusters.into()).to_string(),
            Short(level.triangles).to_string(),
            ratio,
            share(level.base_triangles, level.triangles),
            share(level.shared_vertices, level.vertices),
            Units(level.min_error.into()).to_string(),
            Units(level.max_error.into()).to_string(),
        ];
        row.extend(gaps.then(|| Units(level.max_gap.into()).to_string()));
        row.extend(normals.then(|| format!("{:.1}", level.normal_deviation)));
        row.extend(colors.then(|| format!("{:.1}", level.color_deviation)));
        row.extend(
            [Short(level.stalled_clusters.into()), Short(level.forced_collapses)].map(|n| n.to_string()),
        );
        row
    });

    let mut names =
        vec!["level", "clusters", "triangles", "ratio", "kept", "shared", "min error", "max error"];
    names.extend(gaps.then_some("max gap"));
    names.extend(normals.then_some("normals"));
    names.extend(colors.then_some("colours"));
    names.extend(["stalled", "forced"]);
    table(&names, rows)
}

/// Refused collapses by level and reason; reasons that never occurred are left out, and the table if none did.
pub(crate) fn refusals_table(levels: &[LevelRow]) -> Option<String> {
    let occurring = (0..REFUSALS.len())
        .filter(|reason| levels.iter().any(|level| level.refusals.get(*reason).is_some_and(|n| *n > 0)));
    let reasons: Vec<usize> = occurring.collect();
    if reasons.is_empty() {
        return None;
    }
    let names: Vec<String> = reasons.iter().map(|r| REFUSALS[*r].replace('_', "-")).collect();
    let mut header = vec!["refused at"];
    header.extend(names.iter().map(String::as_str));
    let rows = levels.iter().map(|level| {
        let mut row = vec![format!("level {}", level.level)];
        row.extend(reasons.iter().map(|r| Short(level.refusals[*r]).to_string()));
        row
    });
    Some(table(&header, rows))
}

/// A build's report for programs, with the names of its source and output.
pub(crate) fn build_json(report: &BuildReport, source: String, output: String) -> Build {
    let stages = report.stages.iter().map(|row| Stage {
        stage: row.stage.to_string(),
        seconds: row.seconds,
        processor_seconds: row.processor_seconds,
        peak_resident_bytes: row.peak_resident,
        budget_used_bytes: row.budget_used,
    });
    Build {
        schema: "chpm-build/1",
        source: BuildSource { path: source, vertices: report.source_vertices, bytes: report.source_len },
        output,
        triangles: report.triangles,
        clusters: report.clusters,
        roots: report.roots,
        bytes: report.output_len,
        bytes_per_triangle: per_triangle(report.output_len, report.triangles),
        seconds: report.seconds(),
        stages: stages.collect(),
        levels: report.levels.iter().map(level_row).collect(),
        repairs: object(report.repairs.describe()),
        warnings: report.warnings.clone(),
        resumed_after: report.resumed.map(|reached| reached.to_string()),
        lattice_step: report.lattice_step,
        notes: report.notes.clone(),
        budget_peak_bytes: report.budget_peak,
        peak_resident_bytes: report.peak_resident,
    }
}

/// Names and values as a JSON object; its keys are written like all others.
pub(crate) fn object<V: Into<Value>>(entries: impl IntoIterator<Item = (String, V)>) -> Map<String, Value> {
    entries.into_iter().map(|(name, value)| (name.replace('-', "_"), value.into())).collect()
}

/// Lines of the repair report: only what occurred.
pub(crate) fn repair_lines(repairs: &[(String, u64)]) -> Vec<String> {
    let width = repairs.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let occurred = repairs.iter().filter(|(_, n)| *n > 0);
    occurred
        .map(|(name, n)| format!("  {:<width$}  {}", in_line(name).replace('-', " "), count(*n)))
        .collect()
}

/// A coordinate for people in a model of this diagonal: as a length, or, far from zero, with the digits by which places of the model differ.
pub(crate) fn coordinate(x: f64, diagonal: f64) -> String {
    let told = Units(x).to_string();
    match told.parse::<f64>().is_ok_and(|told| (told - x).abs() <= 1e-2 * diagonal) {
        true => told,
        false => Digits::within((1e-3 * diagonal).max(f64::MIN_POSITIVE), x.abs()).of(x),
    }
}

/// A point for people in a model of this diagonal.
pub(crate) fn point(at: [f64; 3], diagonal: f64) -> String {
    let [x, y, z] = at.map(|x| coordinate(x, diagonal));
    format!("({x}, {y}, {z})")
}

/// Columns of the terminal that results go to; none where they go elsewhere, so that pipes get the same text everywhere.
fn width() -> Option<u16> {
    terminal_size::terminal_size_of(std::io::stdout()).map(|(width, _)| width.0)
}

/// A table whose columns but the first are aligned to the right. What is too wide for the terminal becomes several tables, each with the first
/// column.
pub(crate) fn table(header: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    table_within(width(), header, &rows.into_iter().collect::<Vec<_>>())
}

fn table_within(width: Option<u16>, header: &[&str], rows: &[Vec<String>]) -> String {
    // With a blank on either side.
    let needed = header.iter().enumerate().map(|(column, name)| {
        let cells = rows.iter().filter_map(|row| row.get(column)).map(String::as_str);
        2 + cells.chain([*name]).map(|text| text.chars().count()).max().unwrap_or(0)
    });
    let needed: Vec<usize> = needed.collect();
    let mut tables: Vec<Vec<usize>> = vec![vec![0]];
    let mut used = needed[0];
    for column in 1..header.len() {
        if used + needed[column] > width.map_or(usize::MAX, usize::from) && used > needed[0] {
            tables.push(vec![0]);
            used = needed[0];
        }
        used += needed[column];
        tables.last_mut().into_iter().for_each(|columns| columns.push(column));
    }
    let tables = tables.iter().map(|columns| one_table(width, header, rows, columns));
    tables.collect::<Vec<_>>().join("\n\n")
}

fn one_table(width: Option<u16>, header: &[&str], rows: &[Vec<String>], columns: &[usize]) -> String {
    fn cells(columns: &[usize], text: impl Fn(usize) -> String) -> Vec<Cell> {
        let aligned = columns.iter().map(|column| {
            let side = if *column == 0 { CellAlignment::Left } else { CellAlignment::Right };
            Cell::new(text(*column)).set_alignment(side)
        });
        aligned.collect()
    }
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    if let Some(width) = width {
        table.set_content_arrangement(ContentArrangement::Dynamic).set_width(width);
    }
    table.set_header(cells(columns, |column| header[column].to_owned()));
    let rows = rows.iter();
    table.add_rows(rows.map(|row| cells(columns, |column| row.get(column).cloned().unwrap_or_default())));
    table.to_string()
}

/// A count with its thousands set apart: `3,664,152`.
pub(crate) fn count(n: u64) -> String {
    Thousands(n).to_string()
}

fn share(part: u64, whole: u64) -> String {
    if whole == 0 { "-".to_owned() } else { format!("{:.1} %", 100.0 * part as f64 / whole as f64) }
}

/// An error and its causes, the last of them last, without those that the one before tells already.
pub(crate) fn causes(error: &anyhow::Error) -> Vec<String> {
    let mut told: Vec<String> = Vec::new();
    for cause in error.chain().map(ToString::to_string).filter(|text| !text.is_empty()) {
        if !told.last().is_some_and(|last| last.ends_with(&cause)) {
            told.push(cause);
        }
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_format::LevelRecord;

    fn level(level: u32, triangles: u64, refusals: [u64; 8]) -> LevelRow {
        let record = LevelRecord {
            level,
            cluster_count: 2,
            vertex_count: 100,
            triangle_count: triangles,
            base_triangle_count: triangles / 2,
            shared_vertex_count: 25,
            forced_collapse_count: 1234,
            refusals,
            ..LevelRecord::default()
        };
        LevelRow::from(&record)
    }

    #[test]
    fn what_is_too_wide_becomes_several_tables() {
        let rows = [vec!["a".to_owned(), "1,000,000".to_owned(), "2".to_owned(), "30".to_owned()]];
        let of = |width| table_within(width, &["name", "first", "second", "third"], &rows);
        assert_eq!(of(None).lines().count(), 2);
        assert_eq!(of(Some(80)), of(None));
        let narrow = of(Some(26));
        assert!(narrow.lines().all(|line| line.chars().count() <= 26), "{narrow}");
        assert_eq!(
            (narrow.matches(" name ").count(), narrow.matches("1,000,000").count()),
            (2, 1),
            "{narrow}"
        );
        // Nothing can be done about this but to wrap it.
        assert!(of(Some(12)).lines().all(|line| line.chars().count() <= 12), "{}", of(Some(12)));
    }

    #[test]
    fn thousands_are_set_apart() {
        for (n, text) in [(0, "0"), (999, "999"), (1000, "1,000"), (3664152, "3,664,152")] {
            assert_eq!(count(n), text);
        }
    }

    #[test]
    fn levels_show_ratio_shared_share_and_forced_collapses() {
        let text = levels_table(&[level(0, 4000, [0; 8]), level(1, 2200, [0; 8])]).to_string();
        let last: Vec<&str> = text.lines().last().unwrap().split_whitespace().collect();
        assert_eq!(last[..5], ["1", "2", "2,200", "55.0", "%"]);
        assert_eq!(last[5..9], ["50.0", "%", "25.0", "%"]);
        assert_eq!(last.last(), Some(&"1,234"));
    }

    #[test]
    fn deviations_are_columns_where_there_are_any() {
        let rows = [level(0, 10, [0; 8]), LevelRow { color_deviation: 12.25, ..level(1, 5, [0; 8]) }];
        let text = levels_table(&rows).to_string();
        assert!(text.contains("colours") && !text.contains("normals") && text.contains("12.2"), "{text}");
        assert!(!levels_table(&rows[..1]).to_string().contains("colours"));
    }

    #[test]
    fn only_reasons_that_occurred_are_columns() {
        assert!(refusals_table(&[level(0, 1, [0; 8])]).is_none());
        let text = refusals_table(&[level(0, 1, [0, 3, 0, 0, 0, 0, 0, 7])]).unwrap().to_string();
        let words: Vec<&str> = text.split_whitespace().collect();
        assert_eq!(words, ["refused", "at", "link", "degenerate", "level", "0", "3", "7"]);
    }

    #[test]
    fn repairs_that_did_not_occur_are_silent() {
        let repairs = [("boundary-edges".to_owned(), 1200), ("dropped-faces".to_owned(), 0)];
        assert_eq!(repair_lines(&repairs), ["  boundary edges  1,200"]);
    }

    #[test]
    fn refusals_have_names_in_json() {
        let value = serde_json::to_value(level(0, 1, [5, 0, 0, 0, 0, 0, 0, 0])).unwrap();
        assert_eq!(value["refusals"]["locked"], 5);
    }
}
