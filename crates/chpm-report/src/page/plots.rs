//! The plots of a page.

use crate::Short;
use crate::chart::{Axis, Chart, Mark, Measure, Series, bars};
use crate::error::ReportError;
use crate::stats::{LevelStats, Stats};
use chpm_mesh::Units;
use serde_json::Value;

const SIZE: [u32; 2] = [520, 300];
const WIDE: [u32; 2] = [690, 300];

fn count(value: f64) -> String {
    Short(value.round() as u64).to_string()
}

fn level(value: f64) -> String {
    if value.fract() == 0.0 { value.to_string() } else { String::new() }
}

fn units(value: f64) -> String {
    Units(value).to_string()
}

fn line(name: String, color: usize, points: Vec<[f64; 2]>) -> Series {
    let marks = vec![Mark::Disc; points.len()];
    Series { name, color, points, marks, dashed: false }
}

/// Of one file, or of two side by side: names, and what is drawn of each.
pub(super) fn all(
    files: &[(String, &Stats, Vec<[f64; 2]>)],
    built: Option<&Value>,
) -> Result<Vec<String>, ReportError> {
    let several = files.len() > 1;
    let named = |name: &str, own: &str| match (several, own) {
        (true, "") => name.to_owned(),
        (true, own) => format!("{name}: {own}"),
        (false, own) => own.to_owned(),
    };
    let mut triangles = Vec::new();
    let mut errors = Vec::new();
    let mut cuts = Vec::new();
    for (place, (name, stats, drawable)) in files.iter().enumerate() {
        let all = by_level(stats, |own| Some(own.total_triangles as f64));
        triangles.push(line(named(name, ""), place, all));
        let median = by_level(stats, |own| Some(own.max_error?.median));
        errors.push(line(named(name, "median cluster"), 2 * place, median));
        let worst = by_level(stats, |own| Some(own.max_error?.max));
        errors.push(line(named(name, "worst cluster"), 2 * place + 1, worst));
        cuts.push(line(named(name, ""), place, drawable.clone()));
    }

    let x = Axis { name: "level", log: false, label: level };
    let mut plots = vec![
        Chart {
            title: "Triangles by level",
            x,
            y: Axis { name: "triangles of the finest meshes", log: true, label: count },
            series: triangles,
        }
        .svg(SIZE)?,
        Chart {
            title: "Error by level",
            x,
            y: Axis { name: "error of base meshes, units", log: true, label: units },
            series: errors,
        }
        .svg(WIDE)?,
        Chart {
            title: "Distance against triangles",
            x: Axis { name: "triangles drawn", log: true, label: count },
            y: Axis { name: "farthest from the source, units", log: true, label: units },
            series: cuts,
        }
        .svg(SIZE)?,
    ];

    let names: Vec<String> = files
        .first()
        .map(|(_, stats, _)| stats.bytes.all().map(|(name, _)| name).collect())
        .unwrap_or_default();
    let parts = names.into_iter().map(|name| {
        let bytes = files.iter().map(|(_, stats, _)| bytes_of(stats, &name)).collect::<Vec<f64>>();
        (name, bytes)
    });
    let parts: Vec<(String, Vec<f64>)> =
        parts.filter(|(_, values)| values.iter().any(|v| *v > 0.0)).collect();
    plots.push(bars("Bytes by part", Measure::Bytes, &parts, WIDE)?);

    if let Some(stages) = built.and_then(|built| built["stages"].as_array()) {
        let (seconds, memory) = (by_stage(stages, "seconds"), by_stage(stages, "peak_resident_bytes"));
        plots.push(bars("Time by stage", Measure::Seconds, &seconds, SIZE)?);
        plots.push(bars("Memory by stage", Measure::Bytes, &memory, SIZE)?);
    }
    Ok(plots)
}

/// Points of a line: levels, and a number of each that has it.
fn by_level(stats: &Stats, of: impl Fn(&LevelStats) -> Option<f64>) -> Vec<[f64; 2]> {
    stats.levels.iter().filter_map(|own| Some([f64::from(own.level), of(own)?])).collect()
}

/// Bytes of a part of a file.
fn bytes_of(stats: &Stats, part: &str) -> f64 {
    stats.bytes.all().find(|(name, _)| name == part).map_or(0.0, |(_, bytes)| bytes)
}

/// Stages of a build, and a number of each that has it.
fn by_stage(stages: &[Value], key: &str) -> Vec<(String, Vec<f64>)> {
    let rows =
        stages.iter().map(|stage| Some((stage["stage"].as_str()?.to_owned(), vec![stage[key].as_f64()?])));
    rows.flatten().collect()
}
