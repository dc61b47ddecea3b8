//! Figures of the last frames in the panel: smoothed times, and numbers as people read them.

use crate::stats::Stats;
use std::collections::VecDeque;
use std::time::Duration;

/// Seconds after which a change of a time shows but for 1/e of it.
const CALM: f64 = 0.3;
/// Frames in the curve.
pub const CURVE: usize = 120;

/// A part of a frame, as the panel names it, and its time.
pub type Part = (&'static str, fn(&Stats) -> Duration);

/// The parts of a frame.
pub const PARTS: [Part; 6] = [
    ("refine", |s| s.times.refine),
    ("meshes", |s| s.times.pm),
    ("upload", |s| s.times.upload),
    ("occlusion", |s| s.times.occlusion),
    ("draw", |s| s.times.draw),
    ("stall", |s| s.times.stall),
];

/// Follows the statistics of the frames.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// The last frame.
    pub last: Stats,
    frames: u64,
    parts: [f64; PARTS.len()],
    total: f64,
    moving: bool,
    curve: VecDeque<f32>,
    stalls: u64,
}

impl Figures {
    /// A frame was drawn, so many seconds after the last one; `whole` is what it took until it was handed to the display, panel
    /// included; `moving` if it came as soon as it could: then it took as long as there was from one to the next.
    pub fn take(&mut self, stats: &Stats, whole: Duration, seconds: f64, moving: bool) {
        let share = if self.frames == 0 { 1.0 } else { 1.0 - (-seconds.clamp(0.0, 1.0) / CALM).exp() };
        fn calm(old: &mut f64, new: f64, share: f64) {
            *old += (new - *old) * share
        }
        for (old, (_, part)) in self.parts.iter_mut().zip(PARTS) {
            calm(old, milliseconds(part(stats)), share);
        }
        let took = if moving { milliseconds(whole).max(1e3 * seconds) } else { milliseconds(whole) };
        calm(&mut self.total, took, share);
        self.moving = moving;
        self.curve.push_back(took as f32);
        if self.curve.len() > CURVE {
            self.curve.pop_front();
        }
        self.stalls += stats.stalls;
        self.frames += 1;
        self.last = *stats;
    }

    /// A frame found the picture as it was.
    pub fn keep(&mut self, stats: &Stats) {
        self.stalls += stats.stalls;
        self.moving = false;
        self.last = *stats;
    }

    /// Names and smoothed milliseconds of the parts, and of what is none of them: the panel, and the wait for the display and for what it
    /// has not drawn yet.
    pub fn parts(&self) -> Vec<(&'static str, f64)> {
        let known: f64 = self.parts.iter().sum();
        let parts = PARTS.iter().zip(self.parts).map(|((name, _), ms)| (*name, ms));
        parts.chain([("show", (self.total - known).max(0.0))]).collect()
    }

    /// Smoothed milliseconds of a frame.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Frames a second, while they come as fast as they can.
    pub fn rate(&self) -> Option<f64> {
        (self.moving && self.total > 0.0).then(|| 1e3 / self.total)
    }

    /// Milliseconds of the last frames, oldest first.
    pub fn curve(&self) -> impl ExactSizeIterator<Item = f32> + '_ {
        self.curve.iter().copied()
    }

    /// Frames so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Times that any frame had to wait for pages.
    pub fn stalls(&self) -> u64 {
        self.stalls
    }

    /// The share of the cut that a number of its clusters is.
    pub fn share(&self, clusters: u64) -> f64 {
        clusters as f64 / self.last.clusters_active.max(1) as f64
    }
}

fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// Three digits and a unit: `987`, `12.3 k`, `1.23 M`.
pub fn count(n: u64) -> String {
    let mut unit = 0;
    let mut value = n as f64;
    // What would round up to four digits belongs to the next unit.
    while value >= 999.5 && unit < UNITS.len() - 1 {
        value /= 1e3;
        unit += 1;
    }
    match unit {
        0 => n.to_string(),
        _ => format!("{}{}", digits(value), UNITS[unit]),
    }
}

const UNITS: [&str; 5] = ["", " k", " M", " G", " T"];

/// Three digits.
pub fn digits(value: f64) -> String {
    match value {
        v if v < 9.995 => format!("{v:.2}"),
        v if v < 99.95 => format!("{v:.1}"),
        v => format!("{v:.0}"),
    }
}

/// A number of which nothing is known but that it is exact: six digits, without zeros at its end.
pub fn six_digits(value: f64) -> String {
    let text = format!("{value:.5e}");
    let Some((_, exponent)) = text.split_once('e') else { return text };
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if !(-5..9).contains(&exponent) {
        return text;
    }
    let places = (5 - exponent).max(0) as usize;
    let text = format!("{value:.places$}");
    if places == 0 { text } else { text.trim_end_matches('0').trim_end_matches('.').to_owned() }
}

/// A length and by how much it may differ, as in `46.123 +- 0.032`: two digits of what is uncertain, and no more than six of all. What is
/// told of the uncertainty is rounded up, and counts what the length was rounded by.
pub fn measured(length: f64, differs: f64) -> String {
    let size = length.abs().max(differs.abs());
    if !(size > 0.0 && size.is_finite()) {
        return format!("{length} \u{b1} {differs}");
    }
    let exponent = power(size);
    let [length, differs] = [length, differs].map(|x| x / 10_f64.powi(exponent));
    let most = 5.0 - (size / 10_f64.powi(exponent)).log10().floor();
    let certain = if differs > 0.0 { 1.0 - differs.log10().floor() } else { most };
    let places = certain.min(most).max(0.0) as usize;
    let unit = 10_f64.powi(places as i32);
    let rounded = (length * unit).round() / unit;
    let differs = ((differs + (length - rounded).abs()) * unit * (1.0 - 1e-12)).ceil() / unit;
    match exponent {
        0 => format!("{rounded:.places$} \u{b1} {differs:.places$}"),
        _ => format!("({rounded:.places$} \u{b1} {differs:.places$})e{exponent}"),
    }
}

/// An interval in words: as many digits as tell both ends apart, and two, but no more than seven. Rounded outward: what is told is proven, too.
pub fn between([least, most]: [f64; 2]) -> String {
    let size = if most.is_finite() { most } else { least }.abs();
    if !(size > 0.0 && size.is_finite()) {
        return "0".to_owned();
    }
    let exponent = power(size);
    let scale = 10_f64.powi(exponent);
    let apart = if most.is_finite() { (most - least) / scale } else { 0.0 };
    let seven = 6.0 - (size / scale).log10().floor();
    let wanted = if apart > 0.0 { 2.0 - apart.log10().floor() } else { seven };
    let places = wanted.min(seven).max(0.0) as usize;
    let digits = Digits { exponent, places, is_bare: apart == 0.0 };
    match (least == most, most.is_finite()) {
        (true, _) => digits.of(most, f64::round, most),
        (false, true) => format!("{} to {}", digits.below(least), digits.above(most)),
        (false, false) => format!("at least {}", digits.below(least)),
    }
}

/// How the ends of an interval are written.
struct Digits {
    exponent: i32,
    /// After the point.
    places: usize,
    /// Without zeros at the end: where both ends are one, they tell nothing.
    is_bare: bool,
}

impl Digits {
    fn below(&self, x: f64) -> String {
        self.of(x, f64::floor, x * (1.0 - NUDGE))
    }

    fn above(&self, x: f64) -> String {
        self.of(x, f64::ceil, x * (1.0 + NUDGE))
    }

    /// `nudged` is taken where powers of ten may have been rounded.
    fn of(&self, x: f64, round: fn(f64) -> f64, nudged: f64) -> String {
        let Digits { exponent, places, is_bare } = *self;
        let (scale, unit) = (10_f64.powi(exponent), 10_f64.powi(places as i32));
        let x = round(if exponent == 0 { x } else { nudged } / scale * unit) / unit;
        let mut text = format!("{x:.places$}");
        if is_bare && text.contains('.') {
            text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
        }
        match exponent {
            0 => text,
            _ if x == 0.0 => "0".to_owned(),
            _ => format!("{text}e{exponent}"),
        }
    }
}

/// More than powers of ten and divisions by them are rounded by.
const NUDGE: f64 = 1e-13;

/// The power of ten that people write a length with; 0 for those that they write out.
fn power(size: f64) -> i32 {
    if (1e-3..1e7).contains(&size) { 0 } else { size.log10().floor() as i32 }
}

/// Milliseconds: `0.12`, `1.23`, `12.3`, `123`.
pub fn ms(value: f64) -> String {
    digits(value.max(0.0))
}

/// A share: `0 %`, `12 %`, `<1 %`.
pub fn percent(share: f64) -> String {
    match 100.0 * share {
        p if p > 0.0 && p < 0.5 => "<1 %".to_owned(),
        p => format!("{p:.0} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::Times;
    use proptest::prelude::*;

    fn take(figures: &mut Figures, whole: u64, seconds: f64, moving: bool) {
        let times = Times { draw: Duration::from_millis(whole / 2), ..Times::default() };
        figures.take(&Stats { times, ..Stats::default() }, Duration::from_millis(whole), seconds, moving);
    }

    #[test]
    fn numbers_have_six_digits() {
        for (value, told) in [
            (0.0, "0"),
            (4.0, "4"),
            (12.34567, "12.3457"),
            (123_456.7, "123457"),
            (0.001_234_567_8, "0.00123457"),
            (1e-9, "1.00000e-9"),
            (2.5e12, "2.50000e12"),
        ] {
            assert_eq!(six_digits(value), told, "{value}");
        }
    }

    #[test]
    fn numbers_have_three_digits() {
        for (n, text) in [
            (0, "0"),
            (999, "999"),
            (1000, "1.00 k"),
            (12_345, "12.3 k"),
            (99_960, "100 k"),
            (999_499, "999 k"),
            (999_500, "1.00 M"),
            (1_234_567, "1.23 M"),
            (u64::MAX, "18446744 T"),
        ] {
            assert_eq!(count(n), text);
        }
        assert_eq!([0.0, 0.123, 1.0, 9.999, 123.4].map(ms), ["0.00", "0.12", "1.00", "10.0", "123"]);
        assert_eq!([0.0, 0.001, 0.125, 1.0].map(percent), ["0 %", "<1 %", "12 %", "100 %"]);
    }

    #[test]
    fn lengths_are_told_as_people_read_them() {
        for (length, differs, told) in [
            (46.0, 53.0, "46 \u{b1} 53"),
            (46.123456, 0.0312, "46.123 \u{b1} 0.032"),
            (46.123456, 3e-9, "46.1235 \u{b1} 0.0001"),
            (3.0, 0.0, "3.00000 \u{b1} 0.00000"),
            (123_456.7, 0.4, "123457 \u{b1} 1"),
            (3.21e-9, 1.2e-10, "(3.21 \u{b1} 0.12)e-9"),
            (4.5e12, 1e9, "(4.5000 \u{b1} 0.0010)e12"),
            (0.0, 0.0, "0 \u{b1} 0"),
        ] {
            assert_eq!(measured(length, differs), told);
        }
    }

    #[test]
    fn an_interval_has_the_digits_that_are_certain() {
        for (interval, told) in [
            ([1.25, 1.25], "1.25"),
            ([1.2345678, 1.2346789], "1.234567 to 1.234679"),
            ([0.0, 0.0], "0"),
            ([2.0, f64::INFINITY], "at least 2"),
            ([0.0, 12.0], "0.0 to 12.0"),
            ([123_456.0, 125_456.0], "123456 to 125456"),
            // What was told as 0.000000000000 to 0.000000000013.
            ([0.0, 1.3e-11], "0 to 1.31e-11"),
            ([46.123_456_789, 46.123_456_790], "46.12345 to 46.12346"),
            ([1e-30, 2.5e-30], "0.99e-30 to 2.51e-30"),
        ] {
            assert_eq!(between(interval), told);
        }
    }

    #[test]
    fn the_parts_are_all_of_a_frame() {
        let mut figures = Figures::default();
        take(&mut figures, 10, 0.01, false);
        assert!((figures.total() - 10.0).abs() < 1e-9, "the first frame counts in full");
        let parts = figures.parts();
        let sum: f64 = parts.iter().map(|(_, ms)| ms).sum();
        assert!((sum - 10.0).abs() < 1e-9 && parts.last().map(|(name, _)| *name) == Some("show"));
    }

    #[test]
    fn only_motion_has_a_rate() {
        let mut figures = Figures::default();
        take(&mut figures, 10, 0.02, true);
        assert!((figures.rate().unwrap() - 50.0).abs() < 1e-9);
        // Whichever is longer: a rate never says more than the time beside it.
        (0..300).for_each(|_| take(&mut figures, 40, 0.02, true));
        assert!((figures.rate().unwrap() - 25.0).abs() < 1e-3 && (figures.total() - 40.0).abs() < 1e-3);
        take(&mut figures, 10, 5.0, false);
        assert_eq!(figures.rate(), None);
    }

    #[test]
    fn the_curve_keeps_the_last_frames() {
        let mut figures = Figures::default();
        (0..CURVE as u64 + 5).for_each(|n| take(&mut figures, n, 0.01, false));
        let curve: Vec<f32> = figures.curve().collect();
        assert_eq!((curve.len(), curve[0], curve[CURVE - 1]), (CURVE, 5.0, (CURVE + 4) as f32));
        assert_eq!(figures.frames(), CURVE as u64 + 5);
    }

    proptest! {
        /// A displayed interval holds the proven one, whatever was rounded.
        #[test]
        fn what_is_told_is_proven(least in 0.0..1e9f64, width in 0.0..1e9f64, scale in -12..12i32) {
            let [least, most] = [least, least + width].map(|x| x * 10_f64.powi(scale));
            let told = between([least, most]);
            let ends: Vec<f64> = told.split(" to ").map(|end| end.parse().unwrap()).collect();
            if let [low, high] = ends[..] {
                prop_assert!(low <= least && most <= high, "{} of {:?}", told, [least, most]);
            }
            let told = measured(most, least);
            let bare = told.replace(['(', ')'], "");
            let (value, rest) = bare.split_once(" \u{b1} ").unwrap();
            let (differs, power) = rest.split_once('e').unwrap_or((rest, "0"));
            let scale = 10_f64.powi(power.parse().unwrap());
            let [value, differs] = [value, differs].map(|x| x.parse::<f64>().unwrap() * scale);
            prop_assert!((value - most).abs() + least <= differs * (1.0 + 1e-9), "{} of {:?}", told, [most, least]);
        }

        /// A smoothed time lies between the smallest and the largest of what it smooths, and comes to what stays.
        #[test]
        fn smoothing_stays_between(times in prop::collection::vec((0u64..500, 0.0..0.2f64), 1..50), last in 0u64..500) {
            let mut figures = Figures::default();
            for (total, seconds) in &times {
                take(&mut figures, *total, *seconds, false);
            }
            let (least, most) = (times.iter().map(|t| t.0).min().unwrap(), times.iter().map(|t| t.0).max().unwrap());
            prop_assert!(figures.total() >= least as f64 - 1e-9 && figures.total() <= most as f64 + 1e-9);
            (0..300).for_each(|_| take(&mut figures, last, 0.02, false));
            prop_assert!((figures.total() - last as f64).abs() < 1e-5);
        }
    }
}
