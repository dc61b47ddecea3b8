//! A plot of speed against error, both logarithmic, as SVG.

use super::{DIVISORS, Figure, Point};
use std::fmt::Write;

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

/// A logarithmic axis from pixels to pixels.
struct Axis {
    low: f64,
    high: f64,
    start: f64,
    end: f64,
}

impl Axis {
    /// Around the values, with some room.
    fn around(values: impl Iterator<Item = f64>, start: f64, end: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for log in values.filter(|v| *v > 0.0 && v.is_finite()).map(f64::log10) {
            (low, high) = (low.min(log), high.max(log));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let room = 0.08 * (high - low).max(0.5);
        Axis { low: low - room, high: high + room, start, end }
    }

    fn at(&self, value: f64) -> f64 {
        self.start + (self.end - self.start) * (value.log10() - self.low) / (self.high - self.low)
    }

    /// 1, 2 and 5 of every decade; powers of ten alone where there are many.
    fn ticks(&self) -> Vec<f64> {
        let many = self.high - self.low > 3.0;
        let digits: &[f64] = if many { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let decades = self.low.floor() as i32..=self.high.ceil() as i32;
        let all = decades.flat_map(|d| digits.iter().map(move |digit| digit * 10f64.powi(d)));
        all.filter(|v| (self.low..=self.high).contains(&v.log10())).collect()
    }
}

/// Triangles per second to the right, deviation in per cent of the diagonal upward; a line of marks for each contender, and for each fraction of
/// the triangles a dashed line through those that nobody beats in both.
pub(crate) fn svg(figures: &[Figure], diagonal: f64, title: &str, machine: &str) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" font-family="sans-serif" font-size="12" fill="#222">
<rect width="100%" height="100%" fill="white"/>
<text x="{}" y="26" font-size="16" font-weight="bold">{}</text>
<text x="{}" y="44" fill="#666">{}</text>"##,
        LEFT[0],
        escape(title),
        LEFT[0],
        escape(machine),
    );
    let panels: [(&str, Measure); 2] =
        [("root mean square deviation", |p| p.rms), ("largest deviation", |p| p.max)];
    for (left, (name, value)) in LEFT.into_iter().zip(panels) {
        panel(&mut out, figures, left, name, &|p| 100.0 * value(p) / diagonal);
    }
    legend(&mut out, figures);
    out.push_str("</svg>\n");
    out
}

fn panel(out: &mut String, figures: &[Figure], left: f64, name: &str, value: &dyn Fn(&Point) -> f64) {
    let (right, bottom) = (left + PANEL, TOP + PLOT_HEIGHT);
    let x = Axis::around(figures.iter().map(|f| f.rate), left, right);
    let values = figures.iter().flat_map(|f| &f.points).map(value);
    let y = Axis::around(values, bottom, TOP);
    let _ = writeln!(
        out,
        r##"<text x="{}" y="{}" text-anchor="middle" font-weight="bold">{name}</text>"##,
        left + PANEL / 2.0,
        TOP - 10.0
    );
    for tick in x.ticks() {
        let at = x.at(tick);
        let label = if tick >= 1e6 {
            format!("{}M", tick / 1e6)
        } else if tick >= 1e3 {
            format!("{}K", tick / 1e3)
        } else {
            tick.to_string()
        };
        let _ = writeln!(
            out,
            r##"<path d="M{at:.1} {TOP}V{bottom}" stroke="#e4e4e4"/><text x="{at:.1}" y="{}" text-anchor="middle">{label}</text>"##,
            bottom + 18.0
        );
    }
    for tick in y.ticks() {
        let at = y.at(tick);
        let digits = (-tick.log10().floor()).max(0.0) as usize;
        let _ = writeln!(
            out,
            r##"<path d="M{left} {at:.1}H{right}" stroke="#e4e4e4"/><text x="{}" y="{:.1}" text-anchor="end">{tick:.digits$}</text>"##,
            left - 6.0,
            at + 4.0
        );
    }
    let _ = writeln!(
        out,
        r##"<rect x="{left}" y="{TOP}" width="{PANEL}" height="{PLOT_HEIGHT}" fill="none" stroke="#888"/>
<text x="{}" y="{}" text-anchor="middle">source triangles per second, whole process (right is faster)</text>
<text transform="translate({} {}) rotate(-90)" text-anchor="middle">% of the bounding box's diagonal (down is nearer)</text>"##,
        left + PANEL / 2.0,
        bottom + 38.0,
        left - 54.0,
        TOP + PLOT_HEIGHT / 2.0,
    );
    for divisor in DIVISORS {
        let line: Vec<String> = front(figures, divisor, value)
            .into_iter()
            .map(|(rate, v)| format!("{:.1} {:.1}", x.at(rate), y.at(v)))
            .collect();
        if line.len() > 1 {
            let _ = writeln!(
                out,
                r##"<path d="M{}" fill="none" stroke="#999" stroke-dasharray="4 3"/>"##,
                line.join("L")
            );
        }
    }
    for (figure, color) in figures.iter().zip(COLORS.iter().cycle()) {
        let at = |p: &Point| (x.at(figure.rate), y.at(value(p)));
        let shown: Vec<&Point> =
            figure.points.iter().filter(|p| DIVISORS.contains(&p.divisor) && value(p) > 0.0).collect();
        let line: Vec<String> = shown.iter().map(|p| format!("{:.1} {:.1}", at(p).0, at(p).1)).collect();
        if !line.is_empty() {
            let _ = writeln!(
                out,
                r##"<path d="M{}" fill="none" stroke="{color}" stroke-opacity="0.5"/>"##,
                line.join("L")
            );
        }
        for point in shown {
            let (px, py) = at(point);
            let _ = writeln!(out, "{}", mark(point.divisor, px, py, color));
        }
    }
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

fn legend(out: &mut String, figures: &[Figure]) {
    let left = LEFT[1] + PANEL + 26.0;
    for (row, (figure, color)) in figures.iter().zip(COLORS.iter().cycle()).enumerate() {
        let y = TOP + 10.0 + 20.0 * row as f64;
        let _ = writeln!(
            out,
            r##"<rect x="{left}" y="{:.1}" width="14" height="10" fill="{color}"/><text x="{}" y="{:.1}">{}</text>"##,
            y - 9.0,
            left + 22.0,
            y,
            figure.contender.name()
        );
    }
    for (row, divisor) in DIVISORS.into_iter().enumerate() {
        let y = TOP + 30.0 + 20.0 * (figures.len() + row) as f64;
        let _ = writeln!(
            out,
            r##"{}<text x="{}" y="{y:.1}">1/{divisor} of the triangles</text>"##,
            mark(divisor, left + 7.0, y - 4.0, "#444"),
            left + 22.0
        );
    }
    let y = TOP + 30.0 + 20.0 * (figures.len() + DIVISORS.len()) as f64;
    let _ = writeln!(
        out,
        r##"<path d="M{left} {:.1}h16" stroke="#999" stroke-dasharray="4 3"/><text x="{}" y="{y:.1}">not beaten in both</text>"##,
        y - 4.0,
        left + 22.0
    );
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
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
    fn a_decade_is_as_long_as_any_other() {
        let axis = Axis { low: 0.0, high: 4.0, start: 0.0, end: 400.0 };
        assert_eq!([1.0, 10.0, 1000.0].map(|v| axis.at(v)), [0.0, 100.0, 300.0]);
        assert_eq!(axis.ticks(), [1.0, 10.0, 100.0, 1000.0, 10000.0]);
        let short = Axis { low: 0.0, high: 1.0, start: 0.0, end: 1.0 };
        assert_eq!(short.ticks(), [1.0, 2.0, 5.0, 10.0]);
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
