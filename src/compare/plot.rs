//! The histogram of distances.

use super::Summary;
use crate::chart::{Axis, Chart, Series, Sheet};
use crate::number::Units;
use anyhow::Result;

const SIZE: [u32; 2] = [720, 360];

/// How many vertices are how far away.
pub(crate) fn plot(summary: &Summary, title: &str, note: &str) -> Result<String> {
    let [low, high] = summary.range;
    let width = (high - low) / summary.bins.len() as f64;
    let mut points = vec![[low, 0.0]];
    for (bin, count) in summary.bins.iter().enumerate() {
        let (from, count) = (low + width * bin as f64, *count as f64);
        points.extend([[from, count], [from + width, count]]);
    }
    points.push([high, 0.0]);
    let signed = |value: f64| format!("{}{}", if value < 0.0 { "-" } else { "" }, Units(value.abs()));
    let series = Series { name: String::new(), color: 6, points, marks: Vec::new(), dashed: false };
    let chart = Chart {
        title: "",
        x: Axis { name: "distance, units; what is beyond the ends counts there", log: false, label: signed },
        y: Axis { name: "vertices", log: false, label: |count| format!("{count}") },
        series: vec![series],
    };
    Sheet { title, note, beside: false, size: SIZE, names: Vec::new() }.svg(&[chart])
}
