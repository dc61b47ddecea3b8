//! A plot over the frames of a path, as SVG: time, triangles and clusters, with culling and without.

use super::walk::{Frame, Run};
use crate::number::{Short, Units};
use anyhow::Result;
use chpm_report::chart::{Axis, Chart, Series, Sheet};

const PANEL: [u32; 2] = [900, 230];

/// A panel: title, value of a frame, label.
type Panel = (&'static str, fn(&Frame) -> f64, fn(f64) -> String);

const PANELS: [Panel; 3] = [
    ("milliseconds a frame", Frame::milliseconds, |ms| Units(ms).to_string()),
    ("triangles drawn", |f| f.stats.triangles as f64, |n| Short(n as u64).to_string()),
    ("clusters drawn", |f| f.stats.clusters_drawn as f64, |n| Short(n as u64).to_string()),
];

/// A panel for each measure, one below the other; a line in it for each run.
pub(super) fn svg(runs: &[Run], title: &str, machine: &str) -> Result<String> {
    let charts = PANELS.map(|(title, value, label)| {
        let series = (0..).zip(runs).map(|(color, run)| Series {
            name: run.name().to_owned(),
            color,
            points: (0..).zip(&run.frames).map(|(n, frame)| [f64::from(n), value(frame)]).collect(),
            marks: Vec::new(),
            dashed: false,
        });
        Chart {
            title,
            x: Axis { name: "frame", log: false, label: |n| n.to_string() },
            y: Axis { name: "", log: false, label },
            series: series.collect(),
        }
    });
    let names = (0..).zip(runs).map(|(color, run)| (run.name().to_owned(), color, None)).collect();
    Ok(Sheet { title, note: machine, beside: false, size: PANEL, names }.svg(&charts)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn every_run_is_a_line_in_every_panel() {
        let frame = |ms| Frame { time: Duration::from_millis(ms), ..Frame::default() };
        let run = |culling| Run { culling, frames: (1..20).map(frame).collect() };
        let text = svg(&[run(true), run(false)], "a < b", "a machine").unwrap();
        assert!(text.starts_with("<svg") && text.contains("</svg>") && text.contains("a &lt; b"));
        // A line of its colour in each panel, and its name once.
        for color in ["#1B9E77", "#D95F02"] {
            let lines = text.lines().filter(|line| line.starts_with("<polyline") && line.contains(color));
            assert_eq!(lines.count(), PANELS.len(), "{text}");
        }
        assert!(text.contains("culling on") && text.contains("culling off") && !text.contains("NaN"));
        assert!(!svg(&[], "", "").unwrap().contains("NaN"));
    }
}
