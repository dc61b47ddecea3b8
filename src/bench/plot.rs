//! A plot of speed against error, both logarithmic, as SVG.

use super::{DIVISORS, Figure, Point};
use crate::number::{Short, Units};
use anyhow::Result;
use chpm_report::chart::{Axis, Chart, Mark, Series, Sheet};

const PANEL: [u32; 2] = [440, 480];
/// A shape for each fraction.
const MARKS: [Mark; DIVISORS.len()] = [Mark::Disc, Mark::Cross, Mark::Triangle, Mark::Ring];

/// Value of a mesh in a panel.
type Measure = fn(&Point) -> f64;

/// Triangles per second to the right, deviation in per cent of the diagonal upward; a line of marks for each contender, and for each fraction of
/// the triangles a dashed line through those that nobody beats in both.
pub(crate) fn svg(figures: &[Figure], diagonal: f64, title: &str, machine: &str) -> Result<String> {
    let panels: [(&str, Measure); 2] =
        [("root mean square deviation", |p| p.rms), ("largest deviation", |p| p.max)];
    let charts = panels.map(|(name, value)| panel(figures, name, &|p| 100.0 * value(p) / diagonal));
    let contenders =
        (0..).zip(figures).map(|(color, figure)| (figure.contender.name().to_owned(), color, None));
    let fractions = DIVISORS.iter().zip(MARKS);
    let fractions = fractions.map(|(divisor, mark)| (format!("1/{divisor} of the triangles"), 0, Some(mark)));
    let names = contenders.chain(fractions).collect();
    Ok(Sheet { title, note: machine, beside: true, size: PANEL, names }.svg(&charts)?)
}

fn panel<'a>(figures: &[Figure], name: &'a str, value: &dyn Fn(&Point) -> f64) -> Chart<'a> {
    // What nobody beats is behind the marks.
    let unbeaten = DIVISORS.map(|divisor| Series {
        name: String::new(),
        color: 0,
        points: front(figures, divisor, value).into_iter().map(|(rate, value)| [rate, value]).collect(),
        marks: Vec::new(),
        dashed: true,
    });
    let contenders = (0..).zip(figures).map(|(color, figure)| {
        let marked = figure.points.iter().filter_map(|p| {
            let mark = MARKS[DIVISORS.iter().position(|divisor| *divisor == p.divisor)?];
            Some(([figure.rate, value(p)], mark))
        });
        let (points, marks) = marked.unzip();
        Series { name: figure.contender.name().to_owned(), color, points, marks, dashed: false }
    });
    Chart {
        title: name,
        x: Axis {
            name: "source triangles per second, whole process (right is faster)",
            log: true,
            label: |rate| Short(rate.round() as u64).to_string(),
        },
        y: Axis {
            name: "% of the bounding box's diagonal (down is nearer)",
            log: true,
            label: |value| Units(value).to_string(),
        },
        series: unbeaten.into_iter().chain(contenders).collect(),
    }
}

/// Who is beaten by nobody in both, by rate.
fn front(figures: &[Figure], divisor: u64, value: &dyn Fn(&Point) -> f64) -> Vec<(f64, f64)> {
    let points = figures.iter().filter_map(|figure| {
        let point = figure.points.iter().find(|point| point.divisor == divisor)?;
        Some((figure.rate, value(point)))
    });
    let mut all: Vec<(f64, f64)> = points.filter(|(_, v)| *v > 0.0).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.total_cmp(&b.1)));
    let mut least = f64::INFINITY;
    all.retain(|(_, v)| {
        let better = *v < least;
        least = least.min(*v);
        better
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Contender;

    fn figure(contender: Contender, rate: f64, rms: f64) -> Figure {
        let point =
            |divisor| Point { divisor, triangles: 1000 / divisor, rms: rms * divisor as f64, max: 3.0 * rms };
        let points = DIVISORS.map(point).to_vec();
        Figure { contender, seconds: 1.0, rate, peak: 0, output: 0, points }
    }

    #[test]
    fn only_the_unbeaten_are_in_front() {
        let figures = [
            figure(Contender::Chpm, 100.0, 2.0),
            figure(Contender::ChpmLock, 50.0, 3.0),
            figure(Contender::Plain, 1.0, 1.0),
        ];
        assert_eq!(front(&figures, 4, &|p| p.rms), [(100.0, 8.0), (1.0, 4.0)]);
        assert_eq!(front(&figures, 5, &|p| p.rms), []);
    }

    #[test]
    fn every_contender_and_mark_is_drawn() {
        let figures = [figure(Contender::Chpm, 1e6, 0.001), figure(Contender::Plain, 1e4, 0.002)];
        let text = svg(&figures, 1.0, "a < b", "a machine").unwrap();
        assert!(text.starts_with("<svg") && text.contains("</svg>"));
        assert!(text.contains("a &lt; b") && text.contains("\nplain\n") && !text.contains("NaN"), "{text}");
        // Discs and rings of two contenders in two panels, and once each in the legend.
        assert_eq!(text.matches("<circle").count(), 2 * (2 * 2 + 1));
    }
}
