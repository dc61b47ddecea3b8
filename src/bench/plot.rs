//! A plot of speed against error, both logarithmic, as SVG.

use super::{DIVISORS, Figure, Point};
use crate::svg::{Axis, Head, Page};

const WIDTH: f64 = 1080.0;
const HEIGHT: f64 = 560.0;
const PANEL: f64 = 350.0;
const LEFT: [f64; 2] = [80.0, 520.0];
const TOP: f64 = 80.0;
const PLOT_HEIGHT: f64 = 400.0;
const COLORS: [&str; 9] =
    ["#0b6e4f", "#21a179", "#73c2a5", "#3a86a8", "#7fb7d4", "#d1495b", "#edae49", "#6a4c93", "#8d6b4f"];

/// What a panel shows of a mesh.
type Measure = fn(&Point) -> f64;

/// Triangles per second to the right, deviation in per cent of the diagonal upward; a line of marks for each contender, and for each fraction of
/// the triangles a dashed line through those that nobody beats in both.
pub(crate) fn svg(figures: &[Figure], diagonal: f64, title: &str, machine: &str) -> String {
    let mut page = Page::new([WIDTH, HEIGHT], &Head { title, note: machine, at: [LEFT[0], 26.0] });
    let panels: [(&str, Measure); 2] =
        [("root mean square deviation", |p| p.rms), ("largest deviation", |p| p.max)];
    for (left, (name, value)) in LEFT.into_iter().zip(panels) {
        panel(&mut page, figures, left, name, &|p| 100.0 * value(p) / diagonal);
    }
    legend(&mut page, figures);
    page.finish()
}

fn panel(page: &mut Page, figures: &[Figure], left: f64, name: &str, value: &dyn Fn(&Point) -> f64) {
    let x = Axis::around(figures.iter().map(|f| f.rate), left, left + PANEL);
    let values = figures.iter().flat_map(|f| &f.points).map(value);
    let y = Axis::around(values, TOP + PLOT_HEIGHT, TOP);
    frame(page, left, name, &x, &y);

    // What nobody beats, behind the marks.
    for divisor in DIVISORS {
        let line: Vec<[f64; 2]> =
            front(figures, divisor, value).into_iter().map(|(rate, v)| [x.at(rate), y.at(v)]).collect();
        if line.len() > 1 {
            page.line(line, r##"stroke="#999" stroke-dasharray="4 3""##);
        }
    }

    for (figure, color) in figures.iter().zip(COLORS.iter().cycle()) {
        // A logarithm has no place for zero.
        let is_shown = |p: &&Point| DIVISORS.contains(&p.divisor) && value(p) > 0.0;
        let shown: Vec<&Point> = figure.points.iter().filter(is_shown).collect();
        let at = |p: &Point| [x.at(figure.rate), y.at(value(p))];
        page.line(shown.iter().map(|p| at(p)), &format!(r##"stroke="{color}" stroke-opacity="0.5""##));
        for point in shown {
            let [px, py] = at(point);
            page.add(mark(point.divisor, px, py, color));
        }
    }
}

/// What a panel has whoever is in it: its name, axes and lines.
fn frame(page: &mut Page, left: f64, name: &str, x: &Axis, y: &Axis) {
    let (right, bottom, middle) = (left + PANEL, TOP + PLOT_HEIGHT, left + PANEL / 2.0);
    page.add(format_args!(
        r##"<text x="{middle}" y="{}" text-anchor="middle" font-weight="bold">{name}</text>"##,
        TOP - 10.0
    ));
    for tick in x.ticks() {
        let at = x.at(tick);
        let label = match tick {
            1e6.. => format!("{}M", tick / 1e6),
            1e3.. => format!("{}K", tick / 1e3),
            _ => tick.to_string(),
        };
        page.add(format_args!(
            r##"<path d="M{at:.1} {TOP}V{bottom}" stroke="#e4e4e4"/><text x="{at:.1}" y="{}" text-anchor="middle">{label}</text>"##,
            bottom + 18.0
        ));
    }
    for tick in y.ticks() {
        let at = y.at(tick);
        page.add(format_args!(
            r##"<path d="M{left} {at:.1}H{right}" stroke="#e4e4e4"/><text x="{}" y="{:.1}" text-anchor="end">{}</text>"##,
            left - 6.0,
            at + 4.0,
            y.label(tick)
        ));
    }
    page.add(format_args!(
        r##"<rect x="{left}" y="{TOP}" width="{PANEL}" height="{PLOT_HEIGHT}" fill="none" stroke="#888"/>
<text x="{middle}" y="{}" text-anchor="middle">source triangles per second, whole process (right is faster)</text>
<text transform="translate({} {}) rotate(-90)" text-anchor="middle">% of the bounding box's diagonal (down is nearer)</text>"##,
        bottom + 38.0,
        left - 54.0,
        TOP + PLOT_HEIGHT / 2.0,
    ));
}

/// Who is beaten by nobody in both, by rate.
fn front(figures: &[Figure], divisor: u64, value: &dyn Fn(&Point) -> f64) -> Vec<(f64, f64)> {
    let point = |f: &Figure| f.points.iter().find(|p| p.divisor == divisor).map(|p| (f.rate, value(p)));
    let mut all: Vec<(f64, f64)> = figures.iter().filter_map(point).filter(|(_, v)| *v > 0.0).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.total_cmp(&b.1)));
    let mut least = f64::INFINITY;
    all.retain(|(_, v)| {
        let better = *v < least;
        least = least.min(*v);
        better
    });
    all
}

/// A shape for each fraction.
fn mark(divisor: u64, x: f64, y: f64, color: &str) -> String {
    let place = DIVISORS.iter().position(|d| *d == divisor).unwrap_or(0);
    match place {
        0 => format!(r##"<circle cx="{x:.1}" cy="{y:.1}" r="5" fill="{color}"/>"##),
        1 => {
            format!(r##"<rect x="{:.1}" y="{:.1}" width="9" height="9" fill="{color}"/>"##, x - 4.5, y - 4.5)
        }
        2 => format!(r##"<path d="M{:.1} {:.1}l6 10h-12z" fill="{color}"/>"##, x, y - 6.0),
        _ => format!(r##"<path d="M{:.1} {:.1}l6 6l-6 6l-6 -6z" fill="{color}"/>"##, x, y - 6.0),
    }
}

fn legend(page: &mut Page, figures: &[Figure]) {
    let left = LEFT[1] + PANEL + 26.0;
    let text = left + 22.0;

    // Contenders, then fractions, then what the dashes are.
    for (row, (figure, color)) in figures.iter().zip(COLORS.iter().cycle()).enumerate() {
        let y = TOP + 10.0 + 20.0 * row as f64;
        page.add(format_args!(
            r##"<rect x="{left}" y="{:.1}" width="14" height="10" fill="{color}"/><text x="{text}" y="{y:.1}">{}</text>"##,
            y - 9.0,
            figure.contender.name()
        ));
    }
    let below = |row: usize| TOP + 30.0 + 20.0 * (figures.len() + row) as f64;
    for (row, divisor) in DIVISORS.into_iter().enumerate() {
        let y = below(row);
        page.add(format_args!(
            r##"{}<text x="{text}" y="{y:.1}">1/{divisor} of the triangles</text>"##,
            mark(divisor, left + 7.0, y - 4.0, "#444")
        ));
    }
    let y = below(DIVISORS.len());
    page.add(format_args!(
        r##"<path d="M{left} {:.1}h16" stroke="#999" stroke-dasharray="4 3"/><text x="{text}" y="{y:.1}">not beaten in both</text>"##,
        y - 4.0
    ));
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
        let text = svg(&figures, 1.0, "a < b", "a machine");
        assert!(text.starts_with("<svg") && text.ends_with("</svg>\n"));
        assert!(text.contains("a &lt; b") && text.contains(">plain<") && !text.contains("NaN"));
        // Two contenders in two panels, and once in the legend.
        assert_eq!(text.matches("<circle").count(), 5);
    }
}
