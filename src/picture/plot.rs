//! A plot over the frames of a path, as SVG: time, triangles and clusters, with culling and without.

use super::walk::{Frame, Run};
use crate::svg::{Axis, Head, Page};

const WIDTH: f64 = 960.0;
const LEFT: f64 = 80.0;
const RIGHT: f64 = 930.0;
const TOP: f64 = 70.0;
const HEIGHT: f64 = 170.0;
const GAP: f64 = 50.0;
const COLORS: [&str; 2] = ["#0b6e4f", "#d1495b"];

/// What a panel shows of a frame.
type Panel = (&'static str, fn(&Frame) -> f64);

const PANELS: [Panel; 3] = [
    ("milliseconds a frame", Frame::milliseconds),
    ("thousand triangles drawn", |f| 1e-3 * f.stats.triangles as f64),
    ("clusters drawn", |f| f.stats.clusters_drawn as f64),
];

/// A panel for each measure, one below the other; a line in it for each run.
pub(super) fn svg(runs: &[Run], title: &str, machine: &str) -> String {
    let height = TOP + PANELS.len() as f64 * (HEIGHT + GAP);
    let mut page = Page::new([WIDTH, height], &Head { title, note: machine, at: [LEFT, 24.0] });

    // The runs by their colours, beside the title.
    for (row, (run, color)) in runs.iter().zip(COLORS).enumerate() {
        let x = RIGHT - 240.0 + 120.0 * row as f64;
        page.add(format_args!(
            r##"<path d="M{x} 38h18" stroke="{color}" stroke-width="2"/><text x="{}" y="42">{}</text>"##,
            x + 24.0,
            run.name()
        ));
    }

    for (row, panel) in PANELS.into_iter().enumerate() {
        draw(&mut page, runs, panel, TOP + row as f64 * (HEIGHT + GAP));
    }
    page.finish()
}

fn draw(page: &mut Page, runs: &[Run], (name, value): Panel, top: f64) {
    let bottom = top + HEIGHT;
    let y = Axis::up_to(runs.iter().flat_map(|run| &run.frames).map(value), bottom, top);
    let frames = runs.iter().map(|run| run.frames.len()).max().unwrap_or(0);
    let x = Axis::counting(frames, LEFT, RIGHT);

    for tick in y.ticks() {
        let at = y.at(tick);
        page.add(format_args!(
            r##"<path d="M{LEFT} {at:.1}H{RIGHT}" stroke="#e4e4e4"/><text x="{}" y="{:.1}" text-anchor="end">{}</text>"##,
            LEFT - 8.0,
            at + 4.0,
            y.label(tick)
        ));
    }
    for tick in x.ticks().into_iter().filter(|frame| *frame < frames as f64) {
        page.add(format_args!(
            r##"<text x="{:.1}" y="{}" text-anchor="middle">{tick}</text>"##,
            x.at(tick),
            bottom + 16.0
        ));
    }
    page.add(format_args!(r##"<text x="{LEFT}" y="{}" font-weight="bold">{name}</text>"##, top - 8.0));

    for (run, color) in runs.iter().zip(COLORS) {
        let points = (0..).zip(&run.frames).map(|(n, frame)| [x.at(f64::from(n)), y.at(value(frame))]);
        page.line(points, &format!(r##"stroke="{color}" stroke-width="1.5" stroke-linejoin="round""##));
    }

    // Over the lines, so that none of them covers it.
    page.add(format_args!(
        r##"<rect x="{LEFT}" y="{top}" width="{}" height="{HEIGHT}" fill="none" stroke="#888"/>"##,
        RIGHT - LEFT
    ));
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn every_run_is_a_line_in_every_panel() {
        let frame = |ms| Frame { time: Duration::from_millis(ms), ..Frame::default() };
        let run = |culling| Run { culling, frames: (1..20).map(frame).collect() };
        let text = svg(&[run(true), run(false)], "a < b", "a machine");
        assert!(text.starts_with("<svg") && text.ends_with("</svg>\n") && text.contains("a &lt; b"));
        assert_eq!(text.matches(r##"fill="none" stroke="#0b6e4f""##).count(), PANELS.len());
        assert!(text.contains("culling on") && text.contains("culling off") && !text.contains("NaN"));
        assert!(!svg(&[], "", "").contains("NaN"));
    }
}
