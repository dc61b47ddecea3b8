//! Plots as SVG, drawn by `plotters`. Ink and grid have colours of their own, which a page can give others.

use anyhow::{Result, anyhow};
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
pub(crate) struct Axis<'a> {
    pub(crate) name: &'a str,
    pub(crate) log: bool,
    pub(crate) label: fn(f64) -> String,
}

/// A shape for a point.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Mark {
    Disc,
    Cross,
    Triangle,
    Ring,
}

/// Points of one colour.
pub(crate) struct Series {
    pub(crate) name: String,
    pub(crate) color: usize,
    pub(crate) points: Vec<[f64; 2]>,
    /// One for each point, or none at all.
    pub(crate) marks: Vec<Mark>,
    pub(crate) dashed: bool,
}

/// A plot of lines and points.
pub(crate) struct Chart<'a> {
    pub(crate) title: &'a str,
    pub(crate) x: Axis<'a>,
    pub(crate) y: Axis<'a>,
    pub(crate) series: Vec<Series>,
}

/// A title, and charts side by side or one below the other, with the names of their series at the right.
pub(crate) struct Sheet<'a> {
    pub(crate) title: &'a str,
    pub(crate) note: &'a str,
    /// Charts beside each other; else below.
    pub(crate) beside: bool,
    /// Pixels of each chart.
    pub(crate) size: [u32; 2],
    /// What is named: a colour, and a mark if it is about marks.
    pub(crate) names: Vec<(String, usize, Option<Mark>)>,
}

impl Sheet<'_> {
    /// The file.
    pub(crate) fn svg(&self, charts: &[Chart<'_>]) -> Result<String> {
        let count = charts.len().max(1) as u32;
        let [width, height] = self.size;
        let (width, height) = if self.beside { (width * count, height) } else { (width, height * count) };
        let size = (width + NAMES as u32, height + HEAD as u32);
        drawn(size, |root| {
            root.fill(&WHITE)?;
            root.draw(&Text::new(self.title.to_owned(), (16, 12), (FONT, 17).into_font().color(&INK)))?;
            root.draw(&Text::new(self.note.to_owned(), (16, 34), (FONT, 12).into_font().color(&INK)))?;
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
    pub(crate) fn svg(&self, size: [u32; 2]) -> Result<String> {
        drawn((size[0], size[1]), |root| {
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

    fn draw(&self, area: &Area<'_>) -> Result<()> {
        let values = |axis: usize| self.series.iter().flat_map(|s| &s.points).map(move |point| point[axis]);
        let (x, y) = (range(values(0), self.x.log), range(values(1), self.y.log));
        match (self.x.log, self.y.log) {
            (false, false) => self.plot(area, x, y),
            (false, true) => self.plot(area, x, y.log_scale()),
            (true, false) => self.plot(area, x.log_scale(), y),
            (true, true) => self.plot(area, x.log_scale(), y.log_scale()),
        }
    }

    fn plot<X, Y>(&self, area: &Area<'_>, x: X, y: Y) -> Result<()>
    where
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let mut chart = builder(area, self.title).build_cartesian_2d(x, y).map_err(told)?;
        chart
            .configure_mesh()
            .axis_style(INK)
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .label_style((FONT, 12).into_font().color(&INK))
            .axis_desc_style((FONT, 12).into_font().color(&INK))
            .x_desc(self.x.name)
            .y_desc(self.y.name)
            .x_labels(6)
            .y_labels(6)
            .x_label_formatter(&|value| (self.x.label)(*value))
            .y_label_formatter(&|value| (self.y.label)(*value))
            .draw()
            .map_err(told)?;
        for series in &self.series {
            let color = COLORS[series.color % COLORS.len()];
            // A logarithm has no place for zero.
            let is_shown =
                |point: &[f64; 2]| !(self.x.log && point[0] <= 0.0 || self.y.log && point[1] <= 0.0);
            let points = || series.points.iter().filter(|point| is_shown(point)).map(|[x, y]| (*x, *y));
            if series.dashed {
                let line = DashedPathElement::new(points(), 4, 3, INK.stroke_width(1));
                chart.draw_series([line]).map_err(told)?;
            } else {
                chart.draw_series(LineSeries::new(points(), color.stroke_width(2))).map_err(told)?;
            }
            let marked = series.points.iter().zip(&series.marks).filter(|(point, _)| is_shown(point));
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
                .map_err(told)?;
            }
        }
        Ok(())
    }
}

/// A bar for each name, without a background, for a page.
pub(crate) fn bars(
    title: &str,
    unit: &str,
    label: fn(f64) -> String,
    values: &[(String, Vec<f64>)],
    size: [u32; 2],
) -> Result<String> {
    let most = values.iter().flat_map(|(_, values)| values).copied().fold(0.0, f64::max);
    drawn((size[0], size[1]), |root| {
        let x = (0..values.len().max(1) as u32 - 1).into_segmented();
        let y = 0.0..if most > 0.0 { 1.05 * most } else { 1.0 };
        let mut chart = builder(root, title).build_cartesian_2d(x, y).map_err(told)?;
        let name = |value: &SegmentValue<u32>| match value {
            SegmentValue::CenterOf(place) => {
                values.get(*place as usize).map_or("", |(name, _)| name).to_owned()
            }
            _ => String::new(),
        };
        chart
            .configure_mesh()
            .disable_x_mesh()
            .axis_style(INK)
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .label_style((FONT, 12).into_font().color(&INK))
            .axis_desc_style((FONT, 12).into_font().color(&INK))
            .y_desc(unit)
            .x_labels(values.len())
            .y_labels(6)
            .x_label_formatter(&name)
            .y_label_formatter(&|value| label(*value))
            .draw()
            .map_err(told)?;
        for (place, (_, values)) in (0_u32..).zip(values) {
            // Those of a comparison are in front of each other, the first behind and wider.
            for (series, value) in values.iter().enumerate() {
                let edges = [SegmentValue::Exact(place), SegmentValue::Exact(place + 1)];
                let [left, right] = edges;
                let mut bar = Rectangle::new([(left, 0.0), (right, *value)], COLORS[series].filled());
                let margin = 4 + 12 * series as u32;
                bar.set_margin(0, 0, margin, margin);
                chart.draw_series([bar]).map_err(told)?;
            }
        }
        Ok(())
    })
}

fn builder<'a, 'b>(area: &'a Area<'b>, title: &str) -> ChartBuilder<'a, 'b, SVGBackend<'b>> {
    let mut builder = ChartBuilder::on(area);
    builder.caption(title, (FONT, 14).into_font().color(&INK)).margin(10);
    builder.x_label_area_size(44).y_label_area_size(70);
    builder
}

fn legend(area: &Area<'_>, names: &[(String, usize, Option<Mark>)]) -> Result<()> {
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
        .map_err(told)?;
        area.draw(&Text::new(name.clone(), (27, y - 6), (FONT, 12).into_font().color(&INK))).map_err(told)?;
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

fn drawn(size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Result<()>) -> Result<String> {
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        draw(&root)?;
        root.present().map_err(told)?;
    }
    Ok(text)
}

fn told(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("a plot cannot be drawn: {error}")
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
            assert!(bars("t", "u", |v| v.to_string(), &values, [300, 200]).unwrap().contains("</svg>"));
        }
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
