//! Plots as SVG, drawn by `plotters`. Ink and grid have colours of their own, which a page can give others.
//!
//! ```
//! use chpm_report::chart::{Axis, Chart, Mark, Series};
//!
//! let axis = |name| Axis { name, log: true, label: |value| format!("{value}") };
//! let points = vec![[100.0, 0.5], [1000.0, 0.1], [10_000.0, 0.02]];
//! let marks = vec![Mark::Disc; 3];
//! let series = Series { name: String::new(), color: 0, points, marks, dashed: false };
//! let chart = Chart { title: "Error", x: axis("triangles"), y: axis("units"), series: vec![series] };
//! assert!(chart.svg([400, 300])?.starts_with("<svg"));
//! # Ok::<(), chpm_report::ReportError>(())
//! ```

use crate::error::ReportError;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, SegmentValue, ValueFormatter};
use plotters::element::{Cross, DashedPathElement};
use plotters::prelude::*;
use std::ops::Range;

const INK: RGBColor = RGBColor(0x44, 0x44, 0x44);
const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);
/// Told apart on white and on black.
const COLORS: [RGBColor; 9] = [
    RGBColor(0x1b, 0x9e, 0x77),
    RGBColor(0xd9, 0x5f, 0x02),
    RGBColor(0x75, 0x70, 0xb3),
    RGBColor(0xe7, 0x29, 0x8a),
    RGBColor(0x66, 0xa6, 0x1e),
    RGBColor(0xe6, 0xab, 0x02),
    RGBColor(0x3a, 0x86, 0xc8),
    RGBColor(0xa6, 0x76, 0x1d),
    RGBColor(0x80, 0x80, 0x80),
];
const FONT: &str = "sans-serif";
/// Pixels of the title of a page, and of a column of names.
const HEAD: i32 = 52;
const NAMES: i32 = 170;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// An axis: what it shows, how, and how its values are written.
#[derive(Clone, Copy)]
pub struct Axis<'a> {
    /// Quantity and unit.
    pub name: &'a str,
    /// Whether its steps are powers.
    pub log: bool,
    /// How a value is written.
    pub label: fn(f64) -> String,
}

/// A shape for a point.
#[derive(Clone, Copy, PartialEq)]
pub enum Mark {
    /// A filled circle.
    Disc,
    /// Two strokes.
    Cross,
    /// A filled triangle.
    Triangle,
    /// A circle.
    Ring,
}

/// Points of one colour.
pub struct Series {
    /// Its name at the right; none where it is empty.
    pub name: String,
    /// Number of its colour.
    pub color: usize,
    /// Places of the points.
    pub points: Vec<[f64; 2]>,
    /// One for each point, or none at all.
    pub marks: Vec<Mark>,
    /// Whether its line is dashed and has the colour of the ink.
    pub dashed: bool,
}

/// A plot of lines and points.
pub struct Chart<'a> {
    /// Above it.
    pub title: &'a str,
    /// From left to right.
    pub x: Axis<'a>,
    /// From below.
    pub y: Axis<'a>,
    /// Lines and points.
    pub series: Vec<Series>,
}

/// A title, and charts side by side or one below the other, with the names of their series at the right.
pub struct Sheet<'a> {
    /// Above all charts.
    pub title: &'a str,
    /// Below the title.
    pub note: &'a str,
    /// Charts beside each other; else below.
    pub beside: bool,
    /// Pixels of each chart.
    pub size: [u32; 2],
    /// Legend: names with a colour each, and a mark if they are about marks.
    pub names: Vec<(String, usize, Option<Mark>)>,
}

impl Sheet<'_> {
    /// The file.
    ///
    /// # Errors
    /// [`ReportError::Plot`].
    pub fn svg(&self, charts: &[Chart<'_>]) -> Result<String, ReportError> {
        let count = charts.len().max(1) as u32;
        let [width, height] = self.size;
        let (width, height) = if self.beside { (width * count, height) } else { (width, height * count) };
        let size = (width + NAMES as u32, height + HEAD as u32);
        drawn(size, &format!("{}; {}", self.title, self.note), |root| {
            root.fill(&WHITE).map_err(drawing_error)?;
            headed(root, self.title, self.note)?;
            let (_, below) = root.split_vertically(HEAD);
            let (plots, names) = below.split_horizontally(width as i32);
            let parts =
                plots.split_evenly(if self.beside { (1, count as usize) } else { (count as usize, 1) });
            for (part, chart) in parts.iter().zip(charts) {
                chart.draw(part)?;
            }
            legend(&names, &self.names)
        })
    }
}

impl Chart<'_> {
    /// One plot without a background, for a page.
    ///
    /// # Errors
    /// [`ReportError::Plot`].
    pub fn svg(&self, size: [u32; 2]) -> Result<String, ReportError> {
        let label = format!("{}: {} by {}", self.title, self.y.name, self.x.name);
        drawn((size[0], size[1]), &label, |root| {
            let mut names: Vec<(String, usize, Option<Mark>)> = Vec::new();
            for series in &self.series {
                if !series.name.is_empty() {
                    names.push((series.name.clone(), series.color, None));
                }
            }
            if names.len() < 2 {
                return self.draw(root);
            }
            let (plot, right) = root.split_horizontally(size[0] as i32 - NAMES);
            self.draw(&plot)?;
            legend(&right, &names)
        })
    }

    fn draw(&self, area: &Area<'_>) -> Result<(), ReportError> {
        let points = self.series.iter().flat_map(|series| &series.points);
        let x = range(points.clone().map(|point| point[0]), self.x.log);
        let y = range(points.map(|point| point[1]), self.y.log);
        match (self.x.log, self.y.log) {
            (false, false) => self.plot(area, x, y),
            (false, true) => self.plot(area, x, y.log_scale()),
            (true, false) => self.plot(area, x.log_scale(), y),
            (true, true) => self.plot(area, x.log_scale(), y.log_scale()),
        }
    }

    fn plot<X, Y>(&self, area: &Area<'_>, x: X, y: Y) -> Result<(), ReportError>
    where
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let mut chart = builder(area, self.title).build_cartesian_2d(x, y).map_err(drawing_error)?;
        draw_mesh(&mut chart, [&self.x, &self.y], [6, 6])?;
        for series in &self.series {
            let color = COLORS[series.color % COLORS.len()];
            // A logarithm has no place for zero.
            fn is_shown(point: &[f64; 2], x_log: bool, y_log: bool) -> bool {
                !(x_log && point[0] <= 0.0 || y_log && point[1] <= 0.0)
            }
            let shown = series.points.iter().filter(|point| is_shown(point, self.x.log, self.y.log));
            let points: Vec<(f64, f64)> = shown.map(|[x, y]| (*x, *y)).collect();
            if series.dashed {
                let line = DashedPathElement::new(points, 4, 3, INK.stroke_width(1));
                chart.draw_series([line]).map_err(drawing_error)?;
            } else {
                chart.draw_series(LineSeries::new(points, color.stroke_width(2))).map_err(drawing_error)?;
            }
            let marked = series
                .points
                .iter()
                .zip(&series.marks)
                .filter(|(point, _)| is_shown(point, self.x.log, self.y.log));
            for ([x, y], mark) in marked {
                let at = (*x, *y);
                match mark {
                    Mark::Disc => chart.draw_series([Circle::new(at, 4, color.filled())]).map(drop),
                    Mark::Ring => chart.draw_series([Circle::new(at, 4, color.stroke_width(2))]).map(drop),
                    Mark::Triangle => {
                        chart.draw_series([TriangleMarker::new(at, 5, color.filled())]).map(drop)
                    }
                    Mark::Cross => chart.draw_series([Cross::new(at, 4, color.stroke_width(2))]).map(drop),
                }
                .map_err(drawing_error)?;
            }
        }
        Ok(())
    }
}

/// Unit of the bars, and the steps of its axis.
#[derive(Clone, Copy)]
pub enum Measure {
    /// By powers of ten.
    Seconds,
    /// By powers of 1024.
    Bytes,
}

impl Measure {
    /// The unit in which a largest value is told, as a number and by name.
    fn unit(self, most: f64) -> (f64, &'static str) {
        const BINARY: [(f64, &str); 5] = [
            (1.0, "bytes"),
            (1024.0, "KiB"),
            (1_048_576.0, "MiB"),
            (1_073_741_824.0, "GiB"),
            (1_099_511_627_776.0, "TiB"),
        ];
        match self {
            Measure::Seconds => (1.0, "seconds"),
            Measure::Bytes => BINARY.into_iter().rev().find(|(unit, _)| most >= *unit).unwrap_or(BINARY[0]),
        }
    }
}

/// A bar for each name, without a background, for a page.
///
/// # Errors
/// [`ReportError::Plot`].
pub fn bars(
    title: &str,
    measure: Measure,
    values: &[(String, Vec<f64>)],
    size: [u32; 2],
) -> Result<String, ReportError> {
    let most = values.iter().flat_map(|(_, values)| values).copied().fold(0.0, f64::max);
    let most = if most > 0.0 { most } else { 1.0 };
    let (unit, name) = measure.unit(most);
    drawn((size[0], size[1]), &format!("{title}, {name}"), |root| {
        let x = (0..values.len().max(1) as u32 - 1).into_segmented();
        // In the unit that is told: its steps are round.
        let y = 0.0..1.05 * most / unit;
        let unit_name = name;
        let mut chart = builder(root, title).build_cartesian_2d(x, y).map_err(drawing_error)?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .axis_style(INK)
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .label_style((FONT, 12).into_font().color(&INK))
            .axis_desc_style((FONT, 12).into_font().color(&INK))
            .y_desc(unit_name)
            .x_labels(values.len())
            .y_labels(6)
            .x_label_formatter(&|value| match value {
                SegmentValue::CenterOf(place) => {
                    values.get(*place as usize).map_or("", |(name, _)| name).to_owned()
                }
                _ => String::new(),
            })
            .y_label_formatter(&|value| plain(*value))
            .draw()
            .map_err(drawing_error)?;
        for (place, (_, values)) in (0_u32..).zip(values) {
            // Those of a comparison are in front of each other, the first behind and wider.
            for (series, value) in values.iter().enumerate() {
                let edges = [SegmentValue::Exact(place), SegmentValue::Exact(place + 1)];
                let [left, right] = edges;
                let mut bar = Rectangle::new([(left, 0.0), (right, *value / unit)], COLORS[series].filled());
                let margin = 4 + 12 * series as u32;
                bar.set_margin(0, 0, margin, margin);
                chart.draw_series([bar]).map_err(drawing_error)?;
            }
        }
        Ok(())
    })
}

/// Numbers of things along an axis, in bins of one width.
pub struct Bins<'a> {
    /// Of the first and the last edge.
    pub range: [f64; 2],
    /// How many are in each bin.
    pub counts: &'a [u64],
    /// The colour of a value.
    pub color: &'a dyn Fn(f64) -> [u8; 4],
    /// Values with a line of their own.
    pub marks: &'a [f64],
    /// Name of the axis from left to right.
    pub x: &'a str,
    /// Name of the axis from below.
    pub y: &'a str,
    /// How a value is written.
    pub label: fn(f64) -> String,
}

/// A bar for each bin, in its colour, with a title and a note.
///
/// # Errors
/// [`ReportError::Plot`].
pub fn histogram(title: &str, note: &str, bins: &Bins<'_>, size: [u32; 2]) -> Result<String, ReportError> {
    let [low, high] = bins.range;
    let high = if high > low { high } else { low + 1.0 };
    let most = bins.counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    drawn((size[0], size[1]), &format!("{title}: {} by {}; {note}", bins.y, bins.x), |root| {
        headed(root, title, note)?;
        let (_, below) = root.split_vertically(HEAD);
        let mut chart =
            builder(&below, "").build_cartesian_2d(low..high, 0.0..1.05 * most).map_err(drawing_error)?;
        let y = Axis { name: bins.y, log: false, label: plain };
        draw_mesh(&mut chart, [&Axis { name: bins.x, log: false, label: bins.label }, &y], [8, 6])?;
        let width = (high - low) / bins.counts.len().max(1) as f64;
        for (place, count) in bins.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let from = low + width * place as f64;
            let [r, g, b, _] = (bins.color)(from + 0.5 * width);
            let corners = [(from, 0.0), (from + width, *count as f64)];
            chart
                .draw_series([Rectangle::new(corners, RGBColor(r, g, b).filled())])
                .map_err(drawing_error)?;
        }
        for mark in bins.marks.iter().filter(|mark| (low..=high).contains(*mark)) {
            let line =
                DashedPathElement::new([(*mark, 0.0), (*mark, 1.05 * most)], 4, 3, INK.stroke_width(1));
            chart.draw_series([line]).map_err(drawing_error)?;
        }
        Ok(())
    })
}

/// A step of an axis without the rounding of its sum.
fn plain(step: f64) -> String {
    let text = format!("{step:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if step.abs() >= 1e-5 || step == 0.0 { text.to_owned() } else { format!("{step:e}") }
}

/// Axes with their names and so many labels, and a grid.
fn draw_mesh<'a, X, Y>(
    chart: &mut ChartContext<'a, SVGBackend<'_>, Cartesian2d<X, Y>>,
    [x, y]: [&Axis<'_>; 2],
    labels: [usize; 2],
) -> Result<(), ReportError>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    chart
        .configure_mesh()
        .axis_style(INK)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .label_style((FONT, 12).into_font().color(&INK))
        .axis_desc_style((FONT, 12).into_font().color(&INK))
        .x_desc(x.name)
        .y_desc(y.name)
        .x_labels(labels[0])
        .y_labels(labels[1])
        .x_label_formatter(&|value| (x.label)(*value))
        .y_label_formatter(&|value| (y.label)(*value))
        .draw()
        .map_err(drawing_error)
}

/// A title and a note above a plot.
fn headed(area: &Area<'_>, title: &str, note: &str) -> Result<(), ReportError> {
    for (text, y, size) in [(title, 12, 17), (note, 34, 12)] {
        let style = (FONT, size).into_font().color(&INK);
        area.draw(&Text::new(text.to_owned(), (16, y), style)).map_err(drawing_error)?;
    }
    Ok(())
}

fn builder<'a, 'b>(area: &'a Area<'b>, title: &str) -> ChartBuilder<'a, 'b, SVGBackend<'b>> {
    let mut builder = ChartBuilder::on(area);
    builder.caption(title, (FONT, 14).into_font().color(&INK)).margin(10);
    builder.x_label_area_size(44).y_label_area_size(70);
    builder
}

fn legend(area: &Area<'_>, names: &[(String, usize, Option<Mark>)]) -> Result<(), ReportError> {
    for (row, (name, color, mark)) in (0_i32..).zip(names) {
        let (y, color) = (40 + 20 * row, COLORS[color % COLORS.len()]);
        let at = (13, y);
        match mark {
            None => area.draw(&Rectangle::new([(6, y - 5), (20, y + 5)], color.filled())),
            Some(Mark::Disc) => area.draw(&Circle::new(at, 4, INK.filled())),
            Some(Mark::Ring) => area.draw(&Circle::new(at, 4, INK.stroke_width(2))),
            Some(Mark::Triangle) => area.draw(&TriangleMarker::new(at, 5, INK.filled())),
            Some(Mark::Cross) => area.draw(&Cross::new(at, 4, INK.stroke_width(2))),
        }
        .map_err(drawing_error)?;
        area.draw(&Text::new(name.clone(), (27, y - 6), (FONT, 12).into_font().color(&INK)))
            .map_err(drawing_error)?;
    }
    Ok(())
}

/// From nothing to the largest value, or around all of them that have a logarithm.
fn range(values: impl Iterator<Item = f64>, log: bool) -> Range<f64> {
    let shown = values.filter(|value| value.is_finite() && (!log || *value > 0.0));
    let (low, high) = shown.fold((f64::INFINITY, 0.0), |(low, high), v| (v.min(low), v.max(high)));
    match log {
        _ if low > high => 1.0..10.0,
        true => low / 1.3..high * 1.3,
        false if low < 0.0 || high > 0.0 => 1.05 * low.min(0.0)..1.05 * high,
        false => 0.0..1.0,
    }
}

/// Draws a picture with a name of its own, for those who do not see it.
fn drawn(
    size: (u32, u32),
    label: &str,
    draw: impl FnOnce(&Area<'_>) -> Result<(), ReportError>,
) -> Result<String, ReportError> {
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        draw(&root)?;
        root.present().map_err(drawing_error)?;
    }
    let mut escaped = String::new();
    for c in label.trim().trim_end_matches(';').chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '"' => escaped.push_str("&quot;"),
            c => escaped.push(c),
        }
    }
    Ok(in_xml(&text.replacen("<svg ", &format!("<svg role=\"img\" aria-label=\"{escaped}\" "), 1)))
}

/// A text with U+FFFD in place of what XML and HTML have no room for, as the control characters that names of files may have.
pub fn in_xml(text: &str) -> String {
    let is_foreign = |c: char| match c {
        '\t' | '\n' | '\r' => false,
        c => c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}'),
    };
    text.replace(is_foreign, "\u{fffd}")
}

fn drawing_error(error: impl std::fmt::Display) -> ReportError {
    ReportError::Plot(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<[f64; 2]>, log: bool) -> Chart<'static> {
        let axis = Axis { name: "an axis", log, label: |value| format!("{value}") };
        let marks = vec![Mark::Disc; points.len()];
        let series = Series { name: "one".to_owned(), color: 0, points, marks, dashed: false };
        Chart { title: "a < b", x: axis, y: axis, series: vec![series] }
    }

    #[test]
    fn every_point_is_marked() {
        for log in [false, true] {
            let text = chart(vec![[1.0, 2.0], [10.0, 20.0], [100.0, 5.0]], log).svg([400, 300]).unwrap();
            assert!(
                text.starts_with("<svg") && text.contains("a &lt; b") && text.contains("an axis"),
                "{text}"
            );
            assert_eq!(text.matches("<circle").count(), 3);
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
        }
    }

    #[test]
    fn nothing_and_odd_values_are_drawn_too() {
        for points in [vec![], vec![[0.0, 0.0]], vec![[1.0, 1.0]], vec![[1e-30, 1e30], [f64::INFINITY, 1.0]]]
        {
            for log in [false, true] {
                let text = chart(points.clone(), log).svg([400, 300]).unwrap();
                assert!(text.ends_with("</svg>\n") || text.ends_with("</svg>"), "{text}");
            }
        }
        for values in [vec![], vec![("a".to_owned(), vec![0.0])], vec![("a".to_owned(), vec![1.0, 2.0])]] {
            assert!(bars("t", Measure::Bytes, &values, [300, 200]).unwrap().contains("</svg>"));
        }
    }

    #[test]
    fn steps_are_round_in_the_unit_that_is_told() {
        assert_eq!([0.0, 0.2, 40.0, 3.0 * 0.1].map(plain), ["0", "0.2", "40", "0.3"]);
        // 4.9 MB of one part: whole MiB, and not 976.6 KiB.
        let text = bars("t", Measure::Bytes, &[("a".to_owned(), vec![4.9e6])], [400, 300]).unwrap();
        assert!(text.contains("MiB") && text.contains(">\n4\n<") && !text.contains("976.6"), "{text}");
        assert!(text.contains("role=\"img\" aria-label=\"t, MiB\""), "{text}");
    }

    #[test]
    fn a_sheet_has_all_its_charts() {
        let sheet = Sheet {
            title: "x & y",
            note: "a machine",
            beside: true,
            size: [300, 200],
            names: vec![("one".to_owned(), 0, None), ("disc".to_owned(), 0, Some(Mark::Disc))],
        };
        let text = sheet.svg(&[chart(vec![[1.0, 1.0]], true), chart(vec![[1.0, 2.0]], true)]).unwrap();
        assert!(text.contains("x &amp; y") && text.contains("a machine"));
        assert_eq!(text.matches("<circle").count(), 3);
    }
}
