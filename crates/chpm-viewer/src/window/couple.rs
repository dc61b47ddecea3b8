//! Two models in the window: which step of their motion is shown, what is known of it, and how that is shown.

use crate::transform::Transform;
use crate::window::desk::Desk;
use crate::window::figures::{between, count};
use crate::window::frustum::project;
use crate::window::relation::{Region, Regions, Relate, Relation, Second};
use crate::window::style::{self, ACCENT, CLEAR, LIVE, QUIET, WARNING};
use chpm_refine::Camera;
use egui::{Align2, Color32, FontId, Id, LayerId, Order, RichText, Stroke, pos2, vec2};
use nalgebra::Point3;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

/// Steps of a motion that are shown in a second.
const PACE: f64 = 30.0;
/// Regions that are listed, and that are marked.
const LISTED: usize = 5;
const MARKED: usize = 200;
/// Colour of marked regions.
const MARK: Color32 = Color32::from_rgb(255, 214, 90);

/// Two models in motion.
pub(super) struct Couple {
    steps: Vec<Transform>,
    step: usize,
    /// Steps that have gone by since the motion was started, where it plays.
    playing: Option<f64>,
    /// Last answer, and its step.
    known: Option<(usize, Result<Relation, String>)>,
    desk: Arc<Desk<usize, Relation>>,
    thread: Option<JoinHandle<()>>,
}

impl Couple {
    /// Has the first step asked about; `hear` is told the answers from another thread.
    pub(super) fn new(
        second: &Second,
        hear: impl Fn(usize, Result<Relation, String>) + Send + Sync + 'static,
    ) -> Result<Self, String> {
        let desk = Arc::new(Desk::new(hear));
        let (relate, at): (Arc<dyn Relate>, _) = (Arc::clone(&second.relate), Arc::clone(&desk));
        let thread = thread::Builder::new().name("relate".to_owned()).spawn(move || relate.relate(&at));
        let thread = Some(thread.map_err(|error| format!("cannot start a thread: {error}"))?);
        desk.ask(0);
        Ok(Couple { steps: second.steps.clone(), step: 0, playing: None, known: None, desk, thread })
    }

    /// Where the second model is now, so many seconds after it was asked before.
    pub(super) fn place(&mut self, seconds: f64) -> Option<Transform> {
        if let Some(gone) = &mut self.playing {
            *gone += PACE * seconds.max(0.0);
            let whole = gone.floor();
            *gone -= whole;
            self.go((self.step + whole as usize) % self.steps.len().max(1));
        }
        self.steps.get(self.step).copied()
    }

    fn go(&mut self, step: usize) {
        if step != self.step {
            self.step = step;
            self.desk.ask(step);
        }
    }

    pub(super) fn is_playing(&self) -> bool {
        self.playing.is_some()
    }

    /// An answer has come.
    pub(super) fn hear(&mut self, step: usize, answer: Result<Relation, String>) {
        self.known = Some((step, answer));
    }

    /// Answer at the step that is shown.
    fn now(&self) -> Option<&Result<Relation, String>> {
        self.known.as_ref().filter(|(step, _)| *step == self.step).map(|(_, answer)| answer)
    }

    /// The numbers, and what moves the second model. Answers whether something else is to be shown now.
    pub(super) fn show(&mut self, context: &egui::Context) -> bool {
        let (mut step, mut plays) = (self.step, self.is_playing());
        let area = egui::Area::new(Id::unique("relation")).anchor(Align2::RIGHT_CENTER, vec2(-10.0, 0.0));

        area.show(context, |ui| {
            style::frame().show(ui, |ui| {
                ui.set_max_width(300.0);
                ui.label(RichText::new("BOTH MODELS").small().strong().color(ACCENT));
                for (text, color) in lines(self.now()) {
                    ui.label(RichText::new(text).color(color));
                }
                if self.steps.len() > 1 {
                    ui.horizontal(|ui| {
                        if ui.button(if plays { "stop" } else { "play" }).clicked() {
                            plays = !plays;
                        }
                        let slider = egui::Slider::new(&mut step, 0..=self.steps.len() - 1);
                        ui.add(slider.text(RichText::new("step").color(QUIET)));
                    });
                }
            });
        });

        let changes = step != self.step || plays != self.is_playing();
        self.go(step);
        if plays != self.is_playing() {
            self.playing = plays.then_some(0.0);
        }
        changes
    }

    /// The shortest segment that is known, and where the models come near.
    pub(super) fn mark(&self, context: &egui::Context, camera: &Camera, size: [u32; 2], scale: f32) {
        let Some(Ok(relation)) = self.now() else { return };
        let painter = context.layer_painter(LayerId::new(Order::Background, Id::unique("relation marks")));

        let point = |[x, y]: [f64; 2]| pos2(x as f32 / scale, y as f32 / scale);
        let seen =
            |ends: [[f64; 3]; 2]| project(ends.map(Point3::from), camera, size).map(|line| line.map(point));

        for region in relation.regions.iter().flat_map(|regions| &regions.all).take(MARKED) {
            for edge in edges(region) {
                if let Some(line) = seen(edge) {
                    painter.line_segment(line, Stroke::new(1.0, MARK));
                }
            }
            if let Some([at, _]) = seen(region.ends) {
                painter.circle_filled(at, 2.5, MARK);
            }
        }

        let Some([a, b]) = relation.ends.and_then(seen) else { return };
        painter.line_segment([a, b], Stroke::new(2.0, LIVE));
        for end in [a, b] {
            painter.circle_stroke(end, 4.0, Stroke::new(1.5, LIVE));
        }

        let text = format!("{} units", between(relation.distance));
        let galley = painter.layout_no_wrap(text, FontId::monospace(12.0), CLEAR);
        let place = Align2::CENTER_BOTTOM.anchor_size(a + 0.5 * (b - a) - vec2(0.0, 8.0), galley.size());
        painter.rect_filled(place.expand(4.0), 4.0, style::BACK);
        painter.galley(place.min, galley, CLEAR);
    }
}

impl Drop for Couple {
    fn drop(&mut self) {
        self.desk.close();
        // One that panicked has told so.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// The edges of a region's box.
fn edges(region: &Region) -> impl Iterator<Item = [[f64; 3]; 2]> {
    let Region { low, high, .. } = *region;
    fn corner(bits: usize, low: [f64; 3], high: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| if bits >> axis & 1 == 0 { low[axis] } else { high[axis] })
    }
    (0..8_usize).flat_map(move |from| {
        let others = (0..3).map(move |axis| from | 1 << axis).filter(move |to| *to != from);
        others.map(move |to| [corner(from, low, high), corner(to, low, high)])
    })
}

/// A number without a second end.
fn length(x: f64) -> String {
    between([x, x])
}

/// Lines about an answer, and their colours.
fn lines(answer: Option<&Result<Relation, String>>) -> Vec<(String, Color32)> {
    let relation = match answer {
        None => return vec![("looking ...".to_owned(), QUIET)],
        Some(Err(told)) => return vec![(told.clone(), WARNING)],
        Some(Ok(relation)) => relation,
    };

    let mut lines = vec![
        (format!("distance {} units", between(relation.distance)), CLEAR),
        (relation.state.clone(), QUIET),
    ];
    let Some(Regions { within, all, complete }) = &relation.regions else { return lines };
    let few = if all.len() == 1 { "region" } else { "regions" };
    lines.push((format!("{} {few} within {} units", count(all.len() as u64), length(*within)), MARK));

    for Region { distance: [_, most], area: [a, b], levels: [l, m], .. } in all.iter().take(LISTED) {
        let [most, a, b] = [*most, *a, *b].map(length);
        lines.push((format!("{most} apart, area {a} and {b}, level {l} and {m}"), CLEAR));
    }
    if let Some(more @ 1..) = all.len().checked_sub(LISTED) {
        lines.push((format!("and {more} more"), QUIET));
    }

    if !complete {
        lines.push(("undecided: there may be more".to_owned(), WARNING));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_has_twelve_edges() {
        let region = Region {
            low: [0.0; 3],
            high: [1.0, 2.0, 3.0],
            ends: [[0.0; 3]; 2],
            distance: [0.0; 2],
            area: [0.0; 2],
            levels: [0; 2],
        };
        let all: Vec<_> = edges(&region).collect();
        assert_eq!(all.len(), 12);
        let length = |[a, b]: &[[f64; 3]; 2]| (0..3).map(|axis| (b[axis] - a[axis]).abs()).sum::<f64>();
        assert_eq!(all.iter().map(length).sum::<f64>(), 24.0);
    }

    #[test]
    fn what_is_undecided_is_told_as_such() {
        let told = |answer: Option<&_>| {
            lines(answer).into_iter().map(|(text, _)| text).collect::<Vec<_>>().join("; ")
        };
        assert_eq!(told(None), "looking ...");
        let no = Err("no".to_owned());
        assert_eq!(told(Some(&no)), "no");
        let regions = Regions { within: 0.5, all: Vec::new(), complete: false };
        let relation = Relation {
            distance: [1.0, 2.0],
            ends: None,
            state: "undecided".to_owned(),
            regions: Some(regions),
        };
        let answer = Ok(relation);
        let told = told(Some(&answer));
        assert_eq!(
            told,
            "distance 1.00 to 2.00 units; undecided; 0 regions within 0.5 units; undecided: there may be more"
        );
    }

    /// Tells which steps it is asked about, and nothing else.
    struct Silent;

    impl Relate for Silent {
        fn relate(&self, desk: &Desk<usize, Relation>) {
            while let Some(step) = desk.take() {
                desk.tell(step, Err(step.to_string()));
            }
        }
    }

    #[test]
    fn a_motion_plays_and_old_answers_are_not_shown() {
        let steps: Vec<Transform> = [0.0, 1.0, 2.0]
            .map(|x| Transform::new([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [x, 0.0, 0.0]))
            .to_vec();
        let second = Second {
            model: "b.chpm".into(),
            first: Transform::STILL,
            steps: steps.clone(),
            relate: Arc::new(Silent),
        };
        let (sender, heard) = std::sync::mpsc::channel();
        let mut couple = Couple::new(&second, move |step, answer| drop(sender.send((step, answer)))).unwrap();
        let (step, answer) = heard.recv().unwrap();
        couple.hear(step, answer);
        assert_eq!((couple.place(9.0), couple.now().is_some()), (Some(steps[0]), true), "it rests");
        couple.playing = Some(0.0);
        let seen: Vec<_> = (0..4).map(|_| couple.place(1.0 / PACE)).collect();
        assert_eq!(seen, [1, 2, 0, 1].map(|step| Some(steps[step])));
        couple.playing = None;
        couple.go(2);
        assert_eq!(couple.now(), None, "what is known is of another step");
        let (step, answer) = heard.iter().find(|(step, _)| *step == 2).unwrap();
        couple.hear(step, answer);
        assert_eq!(couple.now(), Some(&Err("2".to_owned())));
    }
}
