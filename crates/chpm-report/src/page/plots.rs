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
        let each = |of: &dyn Fn(&LevelStats) -> Option<f64>| -> Vec<[f64; 2]> {
            let at = stats.levels.iter().filter_map(|own| Some([f64::from(own.level), of(own)?]));
            at.collect()
        };
        let all = |own: &LevelStats| Some(own.total_triangles as f64);
        triangles.push(line(named(name, ""), place, each(&all)));
        errors.push(line(named(name, "median cluster"), 2 * place, each(&|own| Some(own.max_error?.median))));
        errors.push(line(named(name, "worst cluster"), 2 * place + 1, each(&|own| Some(own.max_error?.max))));
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
    let part = |name: &String| {
        let of =
            |stats: &Stats| stats.bytes.all().find(|(own, _)| own == name).map_or(0.0, |(_, bytes)| bytes);
        (name.clone(), files.iter().map(|(_, stats, _)| of(stats)).collect::<Vec<f64>>())
    };
    let parts: Vec<(String, Vec<f64>)> =
        names.iter().map(part).filter(|(_, values)| values.iter().any(|v| *v > 0.0)).collect();
    plots.push(bars("Bytes by part", Measure::Bytes, &parts, WIDE)?);
    if let Some(stages) = built.and_then(|built| built["stages"].as_array()) {
        let of = |key: &str| -> Vec<(String, Vec<f64>)> {
            let row = |stage: &Value| Some((stage["stage"].as_str()?.to_owned(), vec![stage[key].as_f64()?]));
            stages.iter().filter_map(row).collect()
        };
        plots.push(bars("Time by stage", Measure::Seconds, &of("seconds"), SIZE)?);
        plots.push(bars("Memory by stage", Measure::Bytes, &of("peak_resident_bytes"), SIZE)?);
    }
    Ok(plots)
}
