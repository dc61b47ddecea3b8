//! The histogram of distances, in their colours.

use super::Summary;
use crate::number::{Short, Units};
use anyhow::Result;
use chpm_report::chart::{Bins, histogram};
use chpm_report::colors::Colors;

const SIZE: [u32; 2] = [720, 380];

/// How many vertices have which number; where there is a tolerance, its ends are marked.
pub(crate) fn plot(
    summary: &Summary,
    colors: &Colors,
    tolerance: Option<f64>,
    along: &str,
    [title, note]: [&str; 2],
) -> Result<String> {
    let outside = match summary.outside {
        [0, 0] => String::new(),
        [below, 0] => format!("; {} below are not shown", Short(below)),
        [0, above] => format!("; {} above are not shown", Short(above)),
        [below, above] => format!("; {} below and {} above are not shown", Short(below), Short(above)),
    };
    let ends = tolerance.map_or_else(Vec::new, |tolerance| vec![-tolerance, tolerance]);
    let bins = Bins {
        range: summary.range,
        counts: &summary.bins,
        color: &|value| colors.of(value),
        marks: &ends,
        x: &format!("{along}{outside}"),
        y: "vertices",
        label: signed,
    };
    Ok(histogram(title, note, &bins, SIZE)?)
}

/// A distance with its sign.
pub(crate) fn signed(value: f64) -> String {
    format!("{}{}", if value < 0.0 { "-" } else { "" }, Units(value.abs()))
}
