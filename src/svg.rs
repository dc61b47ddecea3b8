//! What plots have in common: a page, axes and lines, as SVG.

use std::fmt::{Display, Write};

/// A text that is written to; that cannot fail.
pub(crate) struct Page(String);

/// A page's title, and how and where its figures were taken.
pub(crate) struct Head<'a> {
    pub(crate) title: &'a str,
    pub(crate) note: &'a str,
    /// Where both begin, and the line of the title.
    pub(crate) at: [f64; 2],
}

impl Page {
    /// A white page of this size.
    pub(crate) fn new([width, height]: [f64; 2], head: &Head<'_>) -> Self {
        let [left, line] = head.at;
        let mut page = Page(String::new());
        page.add(format_args!(
            r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" font-family="sans-serif" font-size="12" fill="#222">
<rect width="100%" height="100%" fill="white"/>
<text x="{left}" y="{line}" font-size="16" font-weight="bold">{}</text>
<text x="{left}" y="{}" fill="#666">{}</text>"##,
            escape(head.title),
            line + 18.0,
            escape(head.note),
        ));
        page
    }

    /// Adds a line of text to the file.
    pub(crate) fn add(&mut self, line: impl Display) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "{line}");
    }

    /// A line through points, in this style; nothing where there is none.
    pub(crate) fn line(&mut self, points: impl IntoIterator<Item = [f64; 2]>, style: &str) {
        let points: Vec<String> = points.into_iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
        if !points.is_empty() {
            self.add(format_args!(r##"<path d="M{}" fill="none" {style}/>"##, points.join("L")));
        }
    }

    /// The file.
    pub(crate) fn finish(mut self) -> String {
        self.0.push_str("</svg>\n");
        self.0
    }
}

/// From values to pixels.
pub(crate) struct Axis {
    /// The first and the last value, or their logarithms.
    low: f64,
    high: f64,
    /// Their pixels.
    start: f64,
    end: f64,
    scale: Scale,
}

#[derive(Clone, Copy, PartialEq)]
enum Scale {
    /// With a line at every multiple of a step.
    Linear {
        step: f64,
    },
    Logarithmic,
}

impl Axis {
    /// Logarithmic, around the values, with some room.
    pub(crate) fn around(values: impl Iterator<Item = f64>, start: f64, end: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for log in values.filter(|v| *v > 0.0 && v.is_finite()).map(f64::log10) {
            (low, high) = (low.min(log), high.max(log));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let room = 0.08 * (high - low).max(0.5);
        Axis { low: low - room, high: high + room, start, end, scale: Scale::Logarithmic }
    }

    /// Linear, from zero to the first round number that is not below the values.
    pub(crate) fn up_to(values: impl Iterator<Item = f64>, start: f64, end: f64) -> Self {
        let (step, high) = round(values.fold(0.0, f64::max));
        Axis { low: 0.0, high, start, end, scale: Scale::Linear { step } }
    }

    /// Linear, from number 0 to the last of so many.
    pub(crate) fn counting(count: usize, start: f64, end: f64) -> Self {
        // Whole numbers only.
        let step = round(count as f64).0.max(1.0);
        let high = (count.max(2) - 1) as f64;
        Axis { low: 0.0, high, start, end, scale: Scale::Linear { step } }
    }

    /// The pixel of a value.
    pub(crate) fn at(&self, value: f64) -> f64 {
        let value = if self.scale == Scale::Logarithmic { value.log10() } else { value };
        self.start + (self.end - self.start) * (value - self.low) / (self.high - self.low)
    }

    /// Where lines are: multiples of the step; or 1, 2 and 5 of every decade, and powers of ten alone where there are many.
    pub(crate) fn ticks(&self) -> Vec<f64> {
        match self.scale {
            Scale::Linear { step } => {
                let last = (self.high / step * (1.0 + 1e-9)) as u32;
                (0..=last).map(|n| step * f64::from(n)).collect()
            }
            Scale::Logarithmic => {
                let many = self.high - self.low > 3.0;
                let digits: &[f64] = if many { &[1.0] } else { &[1.0, 2.0, 5.0] };
                let decades = self.low.floor() as i32..=self.high.ceil() as i32;
                let all = decades.flat_map(|d| digits.iter().map(move |digit| digit * 10f64.powi(d)));
                all.filter(|v| (self.low..=self.high).contains(&v.log10())).collect()
            }
        }
    }

    /// A line's value with the digits that it needs.
    pub(crate) fn label(&self, tick: f64) -> String {
        let least = if let Scale::Linear { step } = self.scale { step } else { tick };
        let digits = (-least.log10().floor()).max(0.0) as usize;
        format!("{tick:.digits$}")
    }
}

/// A round step, 1, 2 or 5 of a power of ten, and its least multiple that is not below the largest value.
fn round(largest: f64) -> (f64, f64) {
    if !(largest > 0.0 && largest.is_finite()) {
        return (1.0, 1.0);
    }
    let rough = largest / 5.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power).into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(10.0 * power);
    (step, step * (largest / step).ceil())
}

/// Text as XML has it.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decade_is_as_long_as_any_other() {
        let axis = |high, end| Axis { low: 0.0, high, start: 0.0, end, scale: Scale::Logarithmic };
        let long = axis(4.0, 400.0);
        assert_eq!([1.0, 10.0, 1000.0].map(|v| long.at(v)), [0.0, 100.0, 300.0]);
        assert_eq!(long.ticks(), [1.0, 10.0, 100.0, 1000.0, 10000.0]);
        assert_eq!(axis(1.0, 1.0).ticks(), [1.0, 2.0, 5.0, 10.0]);
        assert_eq!([0.02, 3.0, 200.0].map(|v| long.label(v)), ["0.02", "3", "200"]);
    }

    #[test]
    fn a_linear_axis_holds_everything_between_round_numbers() {
        let axis = |largest| Axis::up_to([0.5 * largest, largest].into_iter(), 100.0, 0.0);
        assert_eq!(axis(9.0).ticks(), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!([0.0, 5.0, 10.0].map(|v| axis(9.0).at(v)), [100.0, 50.0, 0.0]);
        assert_eq!(axis(0.3).label(0.1), "0.1");
        assert_eq!(axis(0.0).ticks(), [0.0, 1.0]);
        for largest in [1e-6, 0.3, 1.0, 7.7, 1234.5, 1e9] {
            let ticks = axis(largest).ticks();
            let last = ticks.last().copied().expect("a tick");
            assert!(last >= largest * (1.0 - 1e-9) && (3..=6).contains(&ticks.len()), "{largest}: {ticks:?}");
            assert!((-1e-6..=100.0).contains(&axis(largest).at(largest)));
        }
        assert_eq!(Axis::counting(6, 0.0, 10.0).ticks(), [0.0, 2.0, 4.0]);
        assert_eq!(Axis::counting(1, 0.0, 10.0).at(0.0), 0.0);
    }

    #[test]
    fn a_page_is_whole() {
        let mut page = Page::new([10.0, 20.0], &Head { title: "a < b", note: "c & d", at: [1.0, 2.0] });
        page.line([[0.0, 1.0], [2.0, 3.0]], r##"stroke="red""##);
        page.line([], "");
        let text = page.finish();
        assert!(text.starts_with("<svg") && text.ends_with("</svg>\n"));
        assert!(text.contains("a &lt; b") && text.contains("c &amp; d"));
        assert!(text.contains(r##"<path d="M0.0 1.0L2.0 3.0" fill="none" stroke="red"/>"##));
        assert_eq!(text.matches("<path").count(), 1);
    }
}
