//! Sections as a drawing to scale, in millimetres of paper, with a scale bar.

use super::{Sheet, trimmed};
use anyhow::Result;
use chpm_report::chart::in_xml;
use chpm_section::{Line, Section};
use std::fmt::Write as _;
use std::io::Write;

/// Margin about the lines, and what the scale bar has below them, in millimetres.
const MARGIN: f64 = 8.0;
const FOOT: f64 = 14.0;
/// Width of a sheet at least: so much has the scale bar and what is written beside it.
const WIDTH: f64 = 80.0;
/// Height of a label, and how long a line is at least that has one.
const LABEL: f64 = 2.2;
const LABELLED: f64 = 24.0;

#[derive(Debug)]
pub(crate) struct Svg {
    width: f64,
    height: f64,
    /// Labels of contours: they come last, above all lines.
    labels: String,
}

/// Text in an element.
fn escaped(text: &str) -> String {
    in_xml(text).replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

impl Svg {
    pub(super) fn begin(sheet: &Sheet, out: &mut impl Write) -> Result<Self> {
        let [low, high] = sheet.bounds;
        let [width, height] = [0, 1].map(|i| (high[i] - low[i]) * sheet.scale.paper + 2.0 * MARGIN);
        let (width, height) = (width.max(WIDTH), height + FOOT);
        let [w, h] = [width, height].map(|x| trimmed(x, 3));
        writeln!(
            out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}mm\" height=\"{h}mm\" viewBox=\"0 0 {w} {h}\" font-family=\"sans-serif\">"
        )?;
        writeln!(out, "<title>{}</title>", escaped(&sheet.title))?;
        writeln!(out, "<rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>")?;
        writeln!(
            out,
            "<g fill=\"none\" stroke=\"#000\" stroke-width=\"0.25\" stroke-linejoin=\"round\" stroke-linecap=\"round\">"
        )?;
        Ok(Svg { width, height, labels: String::new() })
    }

    /// A point on the paper.
    fn paper(&self, sheet: &Sheet, point: &[f64; 3]) -> [f64; 2] {
        let [low, _] = sheet.bounds;
        let [x, y] = [0, 1].map(|i| {
            let along: f64 = (0..3).map(|axis| sheet.axes[i][axis] * point[axis]).sum();
            (along - low[i]) * sheet.scale.paper + MARGIN
        });
        [x, self.height - FOOT - y]
    }

    pub(super) fn add(&mut self, sheet: &Sheet, section: &Section, out: &mut impl Write) -> Result<()> {
        let (mut closed, mut open) = (String::new(), String::new());
        let name = sheet.height(section.offset);
        let is_major = is_major(sheet, section.offset);
        for line in &section.lines {
            let points: Vec<[f64; 2]> = line.points.iter().map(|point| self.paper(sheet, point)).collect();
            path(&points, line, if line.is_closed { &mut closed } else { &mut open });
            if is_major {
                self.label(&points, &name);
            }
        }

        let style = match sheet.contours {
            None => "",
            Some(_) if is_major => " stroke=\"#7a4a1e\" stroke-width=\"0.3\"",
            Some(_) => " stroke=\"#a9794c\" stroke-width=\"0.13\"",
        };
        writeln!(out, "<g id=\"at{name}\"{style}>")?;
        if !closed.is_empty() {
            // Only a section has an inside that is of the model's matter.
            let fill = if sheet.contours.is_none() { " fill=\"#d9d9d9\" fill-rule=\"evenodd\"" } else { "" };
            writeln!(out, "<path{fill} d=\"{closed}\"/>")?;
        }
        if !open.is_empty() {
            writeln!(out, "<path d=\"{open}\"/>")?;
        }
        Ok(writeln!(out, "</g>")?)
    }

    /// Names a long line in its middle, along it and upright.
    fn label(&mut self, points: &[[f64; 2]], name: &str) {
        let mut lengths = vec![0.0];
        for pair in points.windows(2) {
            let length =
                lengths[lengths.len() - 1] + (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
            lengths.push(length);
        }
        let all = lengths[lengths.len() - 1];
        if all < LABELLED {
            return;
        }
        let half = 0.3 * LABEL * name.len() as f64;
        let [before, middle, after] = [-half, 0.0, half].map(|by| {
            points[lengths.partition_point(|length| *length < 0.5 * all + by).min(points.len() - 1)]
        });
        let mut angle = (after[1] - before[1]).atan2(after[0] - before[0]).to_degrees();
        if angle.abs() > 90.0 {
            angle -= 180.0_f64.copysign(angle);
        }
        let [x, y] = middle.map(|x| trimmed(x, 3));
        // A string takes all.
        let _ = writeln!(
            self.labels,
            "<text transform=\"translate({x} {y}) rotate({})\" dy=\"0.35em\">{}</text>",
            trimmed(angle, 1),
            escaped(name)
        );
    }

    pub(super) fn end(self, sheet: &Sheet, out: &mut impl Write) -> Result<()> {
        let Svg { width, height, labels } = &self;
        writeln!(out, "</g>")?;
        writeln!(
            out,
            "<g font-size=\"{LABEL}\" text-anchor=\"middle\" fill=\"#7a4a1e\" stroke=\"#fff\" stroke-width=\"0.6\" paint-order=\"stroke\">\n{labels}</g>"
        )?;
        let (length, label) = sheet.scale.bar((width - 2.0 * MARGIN).min(200.0) / 4.0);
        let bar = length * sheet.scale.paper;
        let (half, top) = (bar / 2.0, height - 11.0);
        let [bar, half, top] = [bar, half, top].map(|x| trimmed(x, 3));
        writeln!(out, "<g transform=\"translate({MARGIN} {top})\" font-size=\"2.5\">")?;
        writeln!(
            out,
            "<rect width=\"{bar}\" height=\"1.2\" fill=\"#fff\" stroke=\"#000\" stroke-width=\"0.2\"/><rect width=\"{half}\" height=\"1.2\"/>"
        )?;
        writeln!(
            out,
            "<text y=\"4.4\">0</text><text x=\"{bar}\" y=\"4.4\" text-anchor=\"middle\">{label}</text>"
        )?;
        let words = format!("{}; {}", sheet.title, sheet.scale.describe());
        writeln!(out, "<text y=\"9\">{}</text>", escaped(&words))?;
        Ok(writeln!(out, "</g>\n</svg>")?)
    }
}

/// Whether a contour is drawn thick and named: of many every fifth.
fn is_major(sheet: &Sheet, offset: f64) -> bool {
    sheet.contours.is_some_and(|(_, step)| sheet.offsets.len() <= 10 || (offset / step).round() % 5.0 == 0.0)
}

/// A line in the language of paths; points that are one on the paper are told once.
fn path(points: &[[f64; 2]], line: &Line, text: &mut String) {
    let mut last = None;
    for point in points {
        let told = point.map(|x| trimmed(x, 3));
        if last.as_ref() != Some(&told) {
            let verb = if last.is_none() { "M" } else { "L" };
            // A string takes all.
            let _ = write!(text, "{verb}{} {}", told[0], told[1]);
            last = Some(told);
        }
    }
    text.push_str(if line.is_closed { "Z" } else { "" });
}
