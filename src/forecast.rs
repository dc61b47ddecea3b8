//! How far a whole build is, how fast it goes and how long it will take.

use crate::number::Short;
use chpm_build::Stage;
use std::time::Duration;

/// The share of the time that each stage took of builds of 0.1 to 372 million triangles, about.
const SHARES: [(Stage, f64); 7] = [
    (Stage::Ingest, 0.06),
    (Stage::Decompose, 0.17),
    (Stage::Hierarchy, 0.01),
    (Stage::Simplify, 0.70),
    (Stage::Sheets, 0.0),
    (Stage::Layout, 0.05),
    (Stage::Emit, 0.01),
];
/// Nothing is foretold before so much is done.
const LEAST: f64 = 0.02;

/// A build, from the stage on that it began with: one that goes on where another one ended has passed over some.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Forecast {
    /// Share of the whole at which it began.
    from: Option<f64>,
    /// Shares of the stages before the one that runs, and of that.
    before: f64,
    own: f64,
    /// Triangles of the source, once they are known.
    triangles: Option<u64>,
}

impl Forecast {
    /// A stage begins.
    pub(crate) fn begin(&mut self, stage: Stage) {
        self.before = SHARES.iter().take_while(|(other, _)| *other != stage).map(|(_, share)| share).sum();
        self.own = SHARES.iter().find(|(other, _)| *other == stage).map_or(0.0, |(_, share)| *share);
        self.from.get_or_insert(self.before);
    }

    /// The source has so many triangles.
    pub(crate) fn counted(&mut self, triangles: u64) {
        self.triangles = Some(triangles);
    }

    /// The share of the whole build that is done, when this share of the running stage is.
    pub(crate) fn share(&self, of_stage: f64) -> f64 {
        self.before + self.own * of_stage.clamp(0.0, 1.0)
    }

    /// `758 k triangles/s, 12 s left`: what is known of it after this time.
    pub(crate) fn message(&self, of_stage: f64, elapsed: Duration) -> String {
        let share = self.share(of_stage);
        let (done, seconds) = (share - self.from.unwrap_or(0.0), elapsed.as_secs_f64());
        if done < LEAST || seconds <= 0.0 {
            return String::new();
        }
        let rate = done / seconds;
        let left = Duration::from_secs_f64(((1.0 - share) / rate).max(0.0));
        let triangles = self.triangles.map_or(String::new(), |triangles| {
            format!("{} triangles/s, ", Short((triangles as f64 * rate) as u64))
        });
        format!("{triangles}{} left", time(left))
    }
}

/// A time for people: `12 s`, `3 min 20 s`, `1 h 5 min`.
fn time(time: Duration) -> String {
    match time.as_secs() + u64::from(time.subsec_millis() >= 500) {
        seconds @ 0..60 => format!("{seconds} s"),
        seconds @ 60..3600 => format!("{} min {} s", seconds / 60, seconds % 60),
        seconds => format!("{} h {} min", seconds / 3600, seconds % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_of_one_whole_in_the_order_of_the_stages() {
        assert!((SHARES.iter().map(|(_, share)| share).sum::<f64>() - 1.0).abs() < 1e-9);
        assert_eq!(SHARES.map(|(stage, _)| stage), Stage::ALL);
    }

    #[test]
    fn what_is_left_follows_from_what_is_done() {
        let mut forecast = Forecast::default();
        forecast.begin(Stage::Ingest);
        assert_eq!(forecast.message(0.1, Duration::from_secs(1)), "");
        assert_eq!(forecast.message(1.0, Duration::from_secs(6)), "94 s left".replace("94 s", "1 min 34 s"));
        forecast.counted(1_000_000);
        forecast.begin(Stage::Decompose);
        forecast.begin(Stage::Hierarchy);
        forecast.begin(Stage::Simplify);
        // 0.24 and half of 0.7 are done.
        assert!((forecast.share(0.5) - 0.59).abs() < 1e-9);
        assert_eq!(forecast.message(0.5, Duration::from_secs(59)), "10.0 k triangles/s, 41 s left");
        forecast.begin(Stage::Emit);
        assert!((forecast.share(7.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_an_earlier_run_has_done_took_no_time() {
        let mut forecast = Forecast::default();
        forecast.begin(Stage::Simplify);
        assert_eq!(forecast.message(0.5, Duration::from_secs(35)), "41 s left");
    }

    #[test]
    fn times_are_for_people() {
        let told = [0, 59, 60, 200, 3600, 3900].map(|seconds| time(Duration::from_secs(seconds)));
        assert_eq!(told, ["0 s", "59 s", "1 min 0 s", "3 min 20 s", "1 h 0 min", "1 h 5 min"]);
    }
}
