//! The panel: what the last frames did, and what can be set.

use crate::request::Coloring;
use crate::stats::Stats;
use crate::window::figures::{Figures, count, digits, ms, percent, six_digits};
use crate::window::keys::Command;
use crate::window::section::Known;
use crate::window::settings::{FRAME, POE, Settings, Smooth, TRIANGLES};
use crate::window::style::{self, ACCENT, CLEAR, LIVE, QUIET, WARNING};
use chpm_mesh::{Bytes, Scalar, viridis};
use chpm_refine::Up;
use egui::{Align2, Color32, Id, Rect, RichText, Sense, Ui, vec2};

/// Width of what is in the panel, points.
const WIDTH: f32 = 256.0;
/// Width of the panel, points.
pub(super) const TAKES: f32 = WIDTH + 34.0;

/// Facts in the panel beside the figures.
pub(super) struct About<'a> {
    pub(super) model: &'a str,
    /// Triangles of the source.
    pub(super) triangles: u64,
    pub(super) adapter: &'a str,
    pub(super) memory: Bytes,
    pub(super) gpu_memory: Bytes,
    /// When edges are smooth; none where the adapter cannot do it.
    pub(super) smooth: Option<Smooth>,
    /// Whether there are shadows.
    pub(super) shadows: bool,
    pub(super) up: Up,
    pub(super) frozen: bool,
    /// Seconds of a recording that goes on.
    pub(super) recording: Option<f64>,
    /// The share of a replay that is done.
    pub(super) replaying: Option<f32>,
    pub(super) can_replay: bool,
    /// The scalar that the model's own colours show.
    pub(super) scalar: Option<&'a Scalar>,
    /// Of the clipping plane's outline, where it is shown.
    pub(super) section: Option<Known<'a>>,
}

/// Windows in which the panel would lie over the model: it is a button there until somebody wants it. Points.
const SMALL: egui::Vec2 = vec2(640.0, 360.0);

/// Whether the panel is folded into a button at first.
pub(super) fn is_folded(window: egui::Vec2) -> bool {
    window.x < SMALL.x || window.y < SMALL.y
}

/// Shows the panel; answers what its buttons ask for.
pub(super) fn show(
    context: &egui::Context,
    settings: &mut Settings,
    figures: &Figures,
    about: &About<'_>,
) -> Vec<Command> {
    let mut commands = Vec::new();
    // A low window scrolls it.
    let room = (context.content_rect().height() - 46.0).max(100.0);
    let area = egui::Area::new(Id::unique("panel")).anchor(Align2::LEFT_TOP, vec2(10.0, 10.0));
    let unfolded = Id::unique("panel unfolded");
    let is_folded = is_folded(context.content_rect().size());
    let mut is_open = !is_folded || context.data(|data| data.get_temp(unfolded)).unwrap_or(false);
    if !is_open {
        let folded =
            area.show(context, |ui| ui.button("panel").on_hover_text("settings and counters").clicked());
        context.data_mut(|data| data.insert_temp(unfolded, folded.inner));
        return commands;
    }
    area.default_size(vec2(WIDTH, room)).show(context, |ui| {
        style::frame().show(ui, |ui| {
            ui.set_width(WIDTH);
            egui::ScrollArea::vertical().max_height(room).min_scrolled_height(room).show(ui, |ui| {
                ui.set_width(WIDTH);
                // What a visitor needs, then what a developer looks at.
                if is_folded {
                    is_open = !ui.button("fold the panel").clicked();
                }
                header(ui, about);
                detail(ui, settings, &figures.last);
                look(ui, settings, about, &figures.last, &mut commands);
                camera(ui, settings, about, &mut commands);
                counters(ui, settings, figures, about);
            });
        });
    });
    if !is_open {
        context.data_mut(|data| data.insert_temp(unfolded, false));
    }
    commands
}

/// Counters for developers, if they are unfolded.
fn counters(ui: &mut Ui, settings: &mut Settings, figures: &Figures, about: &About<'_>) {
    ui.add_space(5.0);
    let name = RichText::new("COUNTERS").small().strong().color(ACCENT);
    let fold = egui::CollapsingHeader::new(name).id_salt("counters").open(Some(settings.counters));
    let shown = fold.show_unindented(ui, |ui| {
        frame_time(ui, figures);
        drawn(ui, figures);
        memory(ui, figures, about);
    });
    if shown.header_response.clicked() {
        settings.counters = !settings.counters;
    }
}

fn header(ui: &mut Ui, about: &About<'_>) {
    ui.add(egui::Label::new(RichText::new(about.model).heading().color(CLEAR)).truncate());
    let line = format!("{} triangles   {}", count(about.triangles), about.adapter);
    ui.add(egui::Label::new(RichText::new(line).small().color(QUIET)).truncate());
}

fn title(ui: &mut Ui, text: &str) {
    ui.add_space(5.0);
    ui.label(RichText::new(text.to_uppercase()).small().strong().color(ACCENT));
}

/// A name to the left, a value to the right.
fn row(ui: &mut Ui, name: &str, value: &str) {
    ui.horizontal(|ui| {
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(RichText::new(value).monospace().color(CLEAR));
            // The name has what is left.
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                ui.add(egui::Label::new(RichText::new(name).color(QUIET)).truncate());
            });
        });
    });
}

/// The time of a frame, by part, and the last frames as a curve.
fn frame_time(ui: &mut Ui, figures: &Figures) {
    title(ui, "Frame");
    ui.horizontal(|ui| {
        let total = RichText::new(format!("{} ms", ms(figures.total())));
        ui.label(total.monospace().size(20.0).color(CLEAR));
        let rate = figures.rate().map_or("at rest".to_owned(), |rate| format!("{rate:.0} frames/s"));
        ui.label(RichText::new(rate).color(QUIET));
    });

    // The parts beside each other, by their share.
    let parts = figures.parts();
    let sum: f64 = parts.iter().map(|(_, ms)| ms).sum();
    let (bar, _) = ui.allocate_exact_size(vec2(WIDTH, 7.0), Sense::hover());
    let mut left = bar.left();
    for ((_, ms), color) in parts.iter().zip(style::PARTS) {
        let width = bar.width() * (ms / sum.max(1e-9)) as f32;
        let piece = Rect::from_min_size(egui::pos2(left, bar.top()), vec2(width, bar.height()));
        ui.painter().rect_filled(piece, 0.0, color);
        left += width;
    }

    curve(ui, figures);
    egui::Grid::new("parts").num_columns(4).min_col_width(46.0).spacing(vec2(10.0, 2.0)).show(ui, |ui| {
        for (place, ((name, time), color)) in parts.iter().zip(style::PARTS).enumerate() {
            ui.label(RichText::new(*name).color(color));
            ui.label(RichText::new(format!("{:>5}", ms(*time))).monospace().color(CLEAR));
            if place % 2 == 1 {
                ui.end_row();
            }
        }
    });
}

fn curve(ui: &mut Ui, figures: &Figures) {
    let (area, _) = ui.allocate_exact_size(vec2(WIDTH, 26.0), Sense::hover());
    let most = figures.curve().fold(1e-3, f32::max);
    let frames = figures.curve().len().max(2);
    let step = area.width() / (crate::window::figures::CURVE - 1) as f32;
    let first = area.right() - step * (frames - 1) as f32;
    let points: Vec<egui::Pos2> = figures
        .curve()
        .enumerate()
        .map(|(place, ms)| egui::pos2(first + step * place as f32, area.bottom() - area.height() * ms / most))
        .collect();
    let painter = ui.painter();
    painter.hline(area.x_range(), area.bottom(), egui::Stroke::new(1.0, Color32::from_white_alpha(24)));
    painter.line(points, egui::Stroke::new(1.2, ACCENT));
    let text = format!("{} ms", ms(f64::from(most)));
    painter.text(area.left_top(), Align2::LEFT_TOP, text, egui::FontId::monospace(9.5), QUIET);
}

fn drawn(ui: &mut Ui, figures: &Figures) {
    let last = &figures.last;
    title(ui, "Drawn");
    row(ui, "triangles", &count(last.triangles));
    row(
        ui,
        "clusters drawn / active",
        &format!("{} / {}", count(last.clusters_drawn), count(last.clusters_active)),
    );
    fn share(clusters: u64, figures: &Figures) -> String {
        format!("{}  {:>5}", count(clusters), percent(figures.share(clusters)))
    }
    row(ui, "outside the image", &share(last.frustum_culled, figures));
    row(ui, "occluded", &share(last.occluded, figures));
    row(ui, "newly visible", &count(last.newly_visible));
    row(ui, "splits / collapses", &format!("{} / {}", count(last.splits), count(last.collapses)));
    row(ui, "vertex steps", &count(last.pm_steps));
    let shadows = format!("{} / {}", count(last.shadow_casters), count(last.shadow_triangles));
    row(ui, "shadows: clusters / triangles", &shadows);
    row(ui, "withheld / stalls", &format!("{} / {}", count(last.withheld), count(figures.stalls())));
}

fn memory(ui: &mut Ui, figures: &Figures, about: &About<'_>) {
    let last = &figures.last;
    title(ui, "Memory");
    meter(ui, "main", last.resident_bytes, about.memory);
    meter(ui, "GPU", last.gpu_bytes, about.gpu_memory);
    row(ui, "requested", &Bytes(last.requested_bytes).to_string());
    row(ui, "uploaded", &Bytes(last.uploaded_bytes).to_string());
    let counts = "pages, and clusters on the GPU; tables, image and panel come on top";
    ui.label(RichText::new(counts).small().color(QUIET));
}

/// How much of a budget is used.
fn meter(ui: &mut Ui, name: &str, used: u64, budget: Bytes) {
    row(ui, name, &format!("{} of {budget}", Bytes(used)));
    let (bar, _) = ui.allocate_exact_size(vec2(WIDTH, 3.0), Sense::hover());
    let share = (used as f64 / budget.0.max(1) as f64).clamp(0.0, 1.0) as f32;
    ui.painter().rect_filled(bar, 1.5, Color32::from_white_alpha(20));
    let full = Rect::from_min_size(bar.min, vec2(bar.width() * share, bar.height()));
    ui.painter().rect_filled(full, 1.5, ACCENT);
}

fn detail(ui: &mut Ui, settings: &mut Settings, last: &Stats) {
    title(ui, "Detail");
    ui.horizontal(|ui| {
        ui.selectable_value(&mut settings.budgeted, false, "pixels of error");
        ui.selectable_value(&mut settings.budgeted, true, "triangles");
    });

    if settings.budgeted {
        ui.add(
            egui::Slider::new(&mut settings.triangles, TRIANGLES)
                .logarithmic(true)
                .custom_formatter(|n, _| count(n as u64)),
        );
    } else {
        ui.add(egui::Slider::new(&mut settings.poe, POE).logarithmic(true).max_decimals(2).suffix(" px"));
    }

    ui.horizontal(|ui| {
        let does = "coarser while something moves, so that a frame takes no longer than this; and never more triangles than pixels";
        ui.toggle_value(&mut settings.adaptive, "fluid").on_hover_text(does);
        let slider = egui::Slider::new(&mut settings.frame, FRAME).logarithmic(true).max_decimals(0);
        ui.spacing_mut().slider_width = 110.0;
        ui.add_enabled(settings.adaptive, slider.suffix(" ms"));
    });

    row(ui, "shown", &format!("{} triangles, {} px", count(last.triangles), digits(last.poe)));
}

fn look(ui: &mut Ui, settings: &mut Settings, about: &About<'_>, last: &Stats, commands: &mut Vec<Command>) {
    title(ui, "Look");
    ui.horizontal(|ui| {
        ui.selectable_value(&mut settings.smooth, false, "flat");
        ui.selectable_value(&mut settings.smooth, true, "smooth");
        ui.separator();
        ui.toggle_value(&mut settings.wireframe, "edges");
        ui.separator();
        if ui.button(format!("{} up", about.up)).clicked() {
            commands.push(Command::Up);
        }
    });

    ui.horizontal(|ui| {
        ui.label(RichText::new("colours").color(QUIET));
        let chosen =
            egui::ComboBox::from_id_salt("colours").selected_text(settings.colors.name()).width(120.0);
        chosen.show_ui(ui, |ui| {
            for (colors, name, shows) in Coloring::ALL {
                ui.selectable_value(&mut settings.colors, colors, name).on_hover_text(shows);
            }
        });
        ui.toggle_value(&mut settings.rulers, "rulers");
    });
    if let Some(range) = last.scale {
        legend(ui, settings.colors, range);
    }
    if let Some(scalar) = about.scalar.filter(|_| settings.colors == Coloring::Vertex) {
        scalar_legend(ui, scalar);
    }

    ui.horizontal(|ui| {
        ui.label(RichText::new("light").color(QUIET));
        let mut shadows = about.shadows;
        if ui.toggle_value(&mut shadows, "shadows").on_hover_text("and darker corners").changed() {
            settings.shadows = Some(shadows);
        }
    });
    ui.horizontal(|ui| {
        ui.label(RichText::new("antialiasing").color(QUIET));
        match about.smooth {
            None => _ = ui.label(RichText::new("not by this adapter").small().color(QUIET)),
            Some(now) => {
                for (smooth, name, does) in Smooth::ALL {
                    if ui.selectable_label(now == smooth, name).on_hover_text(does).clicked() {
                        settings.antialias = Some(smooth);
                    }
                }
            }
        }
    });

    commands.extend(clip(ui, settings, about));
    ui.horizontal(|ui| {
        ui.label(RichText::new("culling").color(QUIET));
        ui.toggle_value(&mut settings.frustum_culling, "frustum");
        ui.toggle_value(&mut settings.occlusion_culling, "occlusion");
        ui.toggle_value(&mut settings.one_sided, "back sides");
    });
}

/// The clipping plane: which one, how much it leaves, and its outline.
fn clip(ui: &mut Ui, settings: &mut Settings, about: &About<'_>) -> Option<Command> {
    ui.horizontal(|ui| {
        ui.label(RichText::new("clip").color(QUIET));
        let chosen = egui::ComboBox::from_id_salt("clip").selected_text(name(settings.clip)).width(50.0);
        chosen.show_ui(ui, |ui| {
            for clip in 0..=Up::ALL.len() as u8 {
                ui.selectable_value(&mut settings.clip, clip, name(clip));
            }
        });
        ui.spacing_mut().slider_width = 80.0;
        let slider = egui::Slider::new(&mut settings.clip_share, 0.0..=1.0).max_decimals(3);
        ui.add_enabled(settings.clip > 0, slider).on_hover_text("the share of the model that is left");
    });
    if settings.clip == 0 {
        return None;
    }
    let asked = ui.horizontal(|ui| {
        ui.toggle_value(&mut settings.outline, "outline")
            .on_hover_text("cut out of the source's own triangles");
        ui.add_enabled_ui(about.section.is_some(), |ui| button(ui, "write SVG", false, Command::Outline))
            .inner
    });
    match about.section {
        Some(Known::Soon) => _ = ui.label(RichText::new("cutting ...").small().color(QUIET)),
        Some(Known::Fault(told)) => _ = ui.label(RichText::new(told).small().color(WARNING)),
        Some(Known::Face(face)) if face.lines.is_empty() => {
            ui.label(RichText::new("the plane cuts nothing").small().color(QUIET));
        }
        Some(Known::Face(face)) => {
            let length = six_digits(face.length);
            let area = face.area.map_or("not told: closed lines cross".to_owned(), six_digits);
            let open = match face.open_ends {
                0 => String::new(),
                ends => format!("; {} open ends", count(ends)),
            };
            ui.label(RichText::new(format!("{length} units, area {area}{open}")).small().color(CLEAR));
        }
        None => {}
    }
    asked.inner
}

fn name(clip: u8) -> String {
    match clip.checked_sub(1).and_then(|place| Up::ALL.get(usize::from(place))) {
        Some(side) => side.to_string(),
        None => "off".to_owned(),
    }
}

/// A bar of colours, from that of 0 to that of 1.
fn color_bar(ui: &mut Ui, color: impl Fn(f64) -> [u8; 3]) {
    let (bar, _) = ui.allocate_exact_size(vec2(WIDTH, 7.0), Sense::hover());
    let steps = 32;
    for step in 0..steps {
        let [from, to] = [step, step + 1].map(|x| bar.left() + bar.width() * x as f32 / steps as f32);
        let [r, g, b] = color(f64::from(step) / f64::from(steps - 1));
        let piece = Rect::from_min_max(egui::pos2(from, bar.top()), egui::pos2(to, bar.bottom()));
        ui.painter().rect_filled(piece, 0.0, Color32::from_rgb(r, g, b));
    }
}

/// Legend of the colours of a scalar: its name and range.
fn scalar_legend(ui: &mut Ui, Scalar { name, range, .. }: &Scalar) {
    color_bar(ui, viridis);
    ui.label(RichText::new(format!("{name}: {} to {}", range.low, range.high)).small().color(QUIET));
}

/// Legend of a scale of colours.
fn legend(ui: &mut Ui, colors: Coloring, [least, most]: [f32; 2]) {
    color_bar(ui, viridis);
    let (name, number): (&str, fn(f32) -> String) = match colors {
        Coloring::Level => ("level", |level| format!("{level:.0}")),
        _ => ("error, units", |error| format!("{error:.3e}")),
    };
    ui.horizontal(|ui| {
        ui.label(RichText::new(number(least)).monospace().color(CLEAR));
        ui.label(RichText::new(name).small().color(QUIET));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(RichText::new(number(most)).monospace().color(CLEAR));
        });
    });
}

fn camera(ui: &mut Ui, settings: &mut Settings, about: &About<'_>, commands: &mut Vec<Command>) {
    title(ui, "Camera");
    ui.horizontal(|ui| {
        ui.selectable_value(&mut settings.fly, false, "orbit");
        ui.selectable_value(&mut settings.fly, true, "fly");
        ui.separator();
        commands.extend(button(ui, "home", false, Command::Home));
        commands.extend(button(ui, "fit", false, Command::Fit));
        let freeze = if about.frozen { "unfreeze" } else { "freeze" };
        commands.extend(button(ui, freeze, about.frozen, Command::Freeze));
    });

    // What goes on is ended by the button that began it.
    ui.horizontal(|ui| {
        let recording = about.recording.map(|seconds| format!("stop {seconds:.1} s"));
        let record = recording.as_deref().unwrap_or("record");
        commands.extend(button(ui, record, recording.is_some(), Command::Record));
        let replaying = about.replaying.map(|share| format!("stop {:.0} %", 100.0 * share));
        ui.add_enabled_ui(about.can_replay || replaying.is_some(), |ui| {
            let replay = replaying.as_deref().unwrap_or("replay");
            commands.extend(button(ui, replay, replaying.is_some(), Command::Replay));
        });
        commands.extend(button(ui, "screenshot", false, Command::Screenshot));
    });

    ui.horizontal(|ui| {
        commands.extend(button(ui, "open ...", false, Command::Open));
        commands.extend(button(ui, "keys", false, Command::Help));
        ui.label(RichText::new("P hides the panel").small().color(QUIET));
    });
}

/// A button, lit while what it ends goes on; its command if it is pressed.
fn button(ui: &mut Ui, text: &str, live: bool, command: Command) -> Option<Command> {
    let text = RichText::new(text).color(if live { LIVE } else { CLEAR });
    ui.button(text).clicked().then_some(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where texts of the panel are painted, in a window of this size.
    fn texts(size: egui::Vec2, settings: &mut Settings, last: Stats) -> Vec<(String, Rect)> {
        let context = egui::Context::default();
        style::apply(&context);
        let mut figures = Figures::default();
        figures.take(&last, std::time::Duration::from_millis(364), 0.016, true);
        let about = About {
            model: "a model with a name that is longer than any panel is wide.chpm",
            triangles: 372_000_000,
            adapter: "an adapter",
            memory: Bytes::mib(1024),
            gpu_memory: Bytes::mib(512),
            smooth: Some(Smooth::Rest),
            shadows: true,
            up: Up::ALL[0],
            frozen: true,
            recording: Some(1234.5),
            replaying: Some(0.5),
            can_replay: true,
            scalar: None,
            section: Some(Known::Fault("a word about why there is no outline that is longer than any panel")),
        };
        let raw = egui::RawInput {
            screen_rect: Some(Rect::from_min_size(egui::Pos2::ZERO, size)),
            ..Default::default()
        };
        let mut shapes = Vec::new();
        // Places settle in the second pass.
        for _ in 0..3 {
            let mut output = context.run_pass(raw.clone(), |context| {
                show(context, settings, &figures, &about);
            });
            output.textures_delta.clear();
            shapes = output.shapes;
        }
        let text = |shape: &egui::epaint::ClippedShape| match &shape.shape {
            egui::Shape::Text(text) => {
                let rect = text.visual_bounding_rect().intersect(shape.clip_rect);
                rect.is_positive().then(|| (text.galley.text().to_owned(), rect))
            }
            _ => None,
        };
        shapes.iter().filter_map(text).collect()
    }

    fn full() -> Stats {
        let bytes = 987 << 20;
        Stats {
            poe: 12.34,
            triangles: 999_000_000,
            requested_bytes: bytes,
            uploaded_bytes: bytes,
            resident_bytes: bytes,
            scale: Some([1.234e-5, 5.678e-2]),
            ..Stats::default()
        }
    }

    #[test]
    fn no_text_lies_over_another() {
        let mut settings = Settings { colors: Coloring::Error, counters: true, ..Settings::default() };
        for size in [vec2(1280.0, 1400.0), vec2(800.0, 600.0), vec2(640.0, 360.0)] {
            let texts = texts(size, &mut settings, full());
            assert!(texts.len() > 5, "{texts:?}");
            for (place, (a, one)) in texts.iter().enumerate() {
                for (b, other) in &texts[place + 1..] {
                    let both = one.intersect(*other).shrink(1.0);
                    assert!(!both.is_positive(), "{a:?} {one} and {b:?} {other}");
                }
            }
        }
    }

    #[test]
    fn what_a_visitor_needs_comes_first_and_all_of_it_is_reached() {
        let mut settings = Settings { counters: true, ..Settings::default() };
        let low = texts(vec2(800.0, 600.0), &mut settings, full());
        let top = |texts: &[(String, Rect)], name: &str| {
            texts.iter().find(|(text, _)| text == name).map(|(_, rect)| rect.top())
        };
        let order = ["DETAIL", "LOOK", "CAMERA"].map(|name| top(&low, name));
        assert!(order.iter().all(Option::is_some) && order.is_sorted(), "{order:?}");
        assert!(low.iter().all(|(_, rect)| rect.bottom() <= 600.0), "{low:?}");
        let high = texts(vec2(800.0, 1400.0), &mut settings, full());
        assert!(top(&high, "CAMERA") < top(&high, "FRAME") && top(&high, "FRAME") < top(&high, "MEMORY"));
        assert!(high.iter().any(|(text, _)| text == "uploaded"));
    }

    #[test]
    fn counters_are_folded_away_until_somebody_wants_them() {
        let shown = texts(vec2(800.0, 1400.0), &mut Settings::default(), full());
        let has = |name: &str| shown.iter().any(|(text, _)| text == name);
        assert!(has("COUNTERS") && has("shown") && has("CAMERA"), "{shown:?}");
        assert!(!has("FRAME") && !has("uploaded") && !has("occluded"), "{shown:?}");
    }

    #[test]
    fn in_a_small_window_the_panel_is_a_button() {
        let size = vec2(320.0, 200.0);
        let shown = texts(size, &mut Settings::default(), full());
        let [(text, place)] = &shown[..] else { panic!("{shown:?}") };
        assert_eq!(text, "panel");
        assert!(place.area() < 0.02 * size.x * size.y && place.right() < 80.0, "{place}");
        assert!(is_folded(size) && !is_folded(vec2(800.0, 600.0)));
    }
}
