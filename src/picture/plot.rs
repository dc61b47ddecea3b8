//! A plot over the frames of a path, as SVG: time, triangles and clusters, with culling and without.

use super::walk::{Frame, Run};
use std::fmt::Write;

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
    let mut out = String::new();
    let _ = writeln!(
        out,
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" font-family="sans-serif" font-size="12" fill="#222">
<rect width="100%" height="100%" fill="white"/>
<text x="{LEFT}" y="24" font-size="16" font-weight="bold">{}</text>
<text x="{LEFT}" y="42" fill="#666">{}</text>"##,
        escape(title),
        escape(machine),
    );
    for (row, (run, color)) in runs.iter().zip(COLORS).enumerate() {
        let x = RIGHT - 240.0 + 120.0 * row as f64;
        let _ = writeln!(
            out,
            r##"<path d="M{x} 38h18" stroke="{color}" stroke-width="2"/><text x="{}" y="42">{}</text>"##,
            x + 24.0,
            run.name()
        );
    }
    for (row, panel) in PANELS.into_iter().enumerate() {
        draw(&mut out, runs, panel, TOP + row as f64 * (HEIGHT + GAP));
    }
    out.push_str("</svg>\n");
    out
}

fn draw(out: &mut String, runs: &[Run], (name, value): Panel, top: f64) {
    let bottom = top + HEIGHT;
    let values = || runs.iter().flat_map(|run| &run.frames).map(value);
    let (step, most) = scale(values().fold(0.0, f64::max));
    let frames = runs.iter().map(|run| run.frames.len()).max().unwrap_or(0);
    let y = |v: f64| bottom - HEIGHT * v / most;
    let x = |frame: usize| LEFT + (RIGHT - LEFT) * frame as f64 / (frames.max(2) - 1) as f64;
    let mut tick = 0.0;
    while tick <= most * (1.0 + 1e-9) {
        let digits = (-step.log10().floor()).max(0.0) as usize;
        let _ = writeln!(
            out,
            r##"<path d="M{LEFT} {:.1}H{RIGHT}" stroke="#e4e4e4"/><text x="{}" y="{:.1}" text-anchor="end">{tick:.digits$}</text>"##,
            y(tick),
            LEFT - 8.0,
            y(tick) + 4.0
        );
        tick += step;
    }
    let (every, _) = scale(frames as f64);
    for frame in (0..frames).step_by((every as usize).max(1)) {
        let _ = writeln!(
            out,
            r##"<text x="{:.1}" y="{}" text-anchor="middle">{frame}</text>"##,
            x(frame),
            bottom + 16.0
        );
    }
    let _ = writeln!(out, r##"<text x="{LEFT}" y="{}" font-weight="bold">{name}</text>"##, top - 8.0);
    for (run, color) in runs.iter().zip(COLORS) {
        let points: Vec<String> = run
            .frames
            .iter()
            .enumerate()
            .map(|(index, frame)| format!("{:.1} {:.1}", x(index), y(value(frame))))
            .collect();
        if !points.is_empty() {
            let _ = writeln!(
                out,
                r##"<path d="M{}" fill="none" stroke="{color}" stroke-width="1.5" stroke-linejoin="round"/>"##,
                points.join("L")
            );
        }
    }
    let _ = writeln!(
        out,
        r##"<rect x="{LEFT}" y="{top}" width="{}" height="{HEIGHT}" fill="none" stroke="#888"/>"##,
        RIGHT - LEFT
    );
}

/// A round step, 1, 2 or 5 of a power of ten, and its least multiple that is not below the largest value.
fn scale(largest: f64) -> (f64, f64) {
    if !(largest > 0.0 && largest.is_finite()) {
        return (1.0, 1.0);
    }
    let rough = largest / 5.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power).into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(10.0 * power);
    (step, step * (largest / step).ceil())
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn scales_are_round_and_hold_everything() {
        assert_eq!(scale(9.0), (2.0, 10.0));
        assert_eq!(scale(100.0), (20.0, 100.0));
        assert_eq!(scale(0.0), (1.0, 1.0));
        for largest in [1e-6, 0.3, 1.0, 7.7, 1234.5, 1e9] {
            let (step, most) = scale(largest);
            assert!(most >= largest && most - largest < step && (2.0..=5.0).contains(&(most / step).ceil()));
        }
    }

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
