//! Layers over the model beside the panel: keys, notes, the open dialog, progress, the frozen camera's borders.

use crate::window::browse::Browser;
use crate::window::figures::measured;
use crate::window::frustum::{Line, project};
use crate::window::keys::{KEYS, MOTIONS};
use crate::window::rulers::{Mark, distance, scale_bar, triad};
use crate::window::style::{self, ACCENT, CLEAR, LIVE, QUIET, WARNING};
use chpm_refine::Camera;
use egui::{Align2, Color32, FontId, Id, LayerId, Order, RichText, Stroke, pos2, vec2};
use nalgebra::Point3;
use std::path::PathBuf;

/// The model's axes, and their colours.
const AXES: [(&str, Color32); 3] = [
    ("x", Color32::from_rgb(255, 105, 97)),
    ("y", Color32::from_rgb(119, 221, 119)),
    ("z", Color32::from_rgb(120, 170, 255)),
];

/// Something to tell the user.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Note {
    pub(super) text: String,
    pub(super) is_fault: bool,
}

/// The table of keys; answers whether it is to be closed.
pub(super) fn keys(context: &egui::Context) -> bool {
    let mut open = true;
    let window = egui::Window::new("Keys").id(Id::unique("keys")).open(&mut open).collapsible(false);
    let window = window.resizable(false).anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0)).frame(style::frame());
    window.show(context, |ui| {
        let motions = MOTIONS.iter().copied();
        let rows: Vec<(&str, &str)> = motions.chain(KEYS.iter().map(|key| (key.key, key.does))).collect();
        egui::Grid::new("keys").num_columns(2).spacing(vec2(18.0, 4.0)).show(ui, |ui| {
            for (key, does) in rows {
                ui.label(RichText::new(key).monospace().color(ACCENT));
                ui.label(RichText::new(does).color(CLEAR));
                ui.end_row();
            }
        });
    });
    !open
}

/// A note at the lower edge.
pub(super) fn note(context: &egui::Context, note: &Note) {
    let area = egui::Area::new(Id::unique("note")).anchor(Align2::CENTER_BOTTOM, vec2(0.0, -14.0));
    area.interactable(false).order(Order::Foreground).show(context, |ui| {
        style::frame().show(ui, |ui| {
            ui.set_max_width(720.0);
            let color = if note.is_fault { WARNING } else { CLEAR };
            ui.label(RichText::new(&note.text).color(color));
        });
    });
}

/// Invitation while no model is open.
pub(super) fn nothing(context: &egui::Context) {
    let area = egui::Area::new(Id::unique("nothing")).anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0));
    area.interactable(false).show(context, |ui| {
        ui.label(RichText::new("drop a .chpm file or a mesh here, or press Ctrl+O").heading().color(QUIET));
    });
}

/// How far a build is; below the model, if there is a preview of it. Answers whether it is to end.
pub(super) fn progress(context: &egui::Context, what: &str, share: f32, has_preview: bool) -> bool {
    let area = egui::Area::new(Id::unique("progress")).order(Order::Foreground);
    let area = match has_preview {
        true => area.anchor(Align2::CENTER_BOTTOM, vec2(0.0, -14.0)),
        false => area.anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0)),
    };
    let shown = area.show(context, |ui| {
        let inner = style::frame().show(ui, |ui| {
            let what = if has_preview { format!("preview; building: {what}") } else { what.to_owned() };
            ui.label(RichText::new(what).color(CLEAR));
            ui.horizontal(|ui| {
                ui.add(egui::ProgressBar::new(share).desired_width(320.0).show_percentage());
                ui.button("cancel").clicked()
            })
        });
        inner.inner.inner
    });
    shown.inner
}

/// Note on the part of a model that cannot be shown as it should be; it stays.
pub(super) fn damage(context: &egui::Context, text: &str) {
    let area = egui::Area::new(Id::unique("damage")).anchor(Align2::RIGHT_TOP, vec2(-10.0, 10.0));
    area.interactable(false).order(Order::Foreground).show(context, |ui| {
        style::frame().show(ui, |ui| {
            ui.set_max_width(420.0);
            ui.label(RichText::new("part of the model stays coarse:").color(WARNING));
            ui.label(RichText::new(text).small().color(CLEAR));
        });
    });
}

/// Choice of a user in the open dialog.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Choice {
    /// Nothing yet.
    Open,
    /// To see another folder.
    Folder(PathBuf),
    /// This file.
    File(PathBuf),
    /// No file.
    Closed,
}

/// Choice that a typed path stands for, taken from the folder that is shown.
pub(super) fn entered(browser: &Browser, typed: &str) -> Choice {
    let path = browser.folder().join(typed.trim());
    match typed.trim().is_empty() {
        true => Choice::Open,
        false if path.is_dir() => Choice::Folder(path),
        false => Choice::File(path),
    }
}

/// The open dialog; `typed` is the text of its field.
pub(super) fn browse(context: &egui::Context, browser: &Browser, typed: &mut String) -> Choice {
    let (mut open, mut choice) = (true, Choice::Open);
    let window = egui::Window::new("Open").id(Id::unique("open")).open(&mut open).collapsible(false);
    let window = window.default_size(vec2(460.0, 360.0)).pivot(Align2::CENTER_CENTER);
    let middle = context.content_rect().center();
    window.default_pos(middle).frame(style::frame()).show(context, |ui| {
        ui.horizontal(|ui| {
            let field = egui::TextEdit::singleline(typed).hint_text("a path").desired_width(360.0);
            let field = ui.add(field);
            let done = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
            // Who opens the dialog can type.
            if ui.memory(|memory| memory.focused().is_none()) {
                field.request_focus();
            }
            if ui.button("open").clicked() || done {
                choice = entered(browser, typed);
            }
        });

        ui.label(RichText::new(browser.folder().display().to_string()).small().color(QUIET));
        if let Some(fault) = browser.fault() {
            ui.label(RichText::new(fault).color(WARNING));
        }

        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            for entry in browser.entries() {
                let color = if entry.is_folder { QUIET } else { CLEAR };
                if ui.selectable_label(false, RichText::new(&entry.name).color(color)).clicked() {
                    let path = entry.path.clone();
                    choice = if entry.is_folder { Choice::Folder(path) } else { Choice::File(path) };
                }
            }
        });
    });
    if open { choice } else { Choice::Closed }
}

/// A scale bar and the axes of the model, at the lower edge.
pub(super) fn rulers(context: &egui::Context, camera: &Camera, size: [u32; 2], scale: f32) {
    let painter = context.layer_painter(LayerId::new(Order::Background, Id::unique("rulers")));
    let corner = context.content_rect().right_bottom();
    if let Some((length, pixels)) = scale_bar(camera, size[1], 160.0 * f64::from(scale)) {
        let (right, y) = (corner.x - 84.0, corner.y - 22.0);
        let left = right - pixels as f32 / scale;
        fn line(from: egui::Pos2, to: egui::Pos2, painter: &egui::Painter) -> egui::layers::ShapeIdx {
            painter.line_segment([from, to], Stroke::new(1.5, CLEAR))
        }
        line(pos2(left, y), pos2(right, y), &painter);
        for x in [left, right] {
            line(pos2(x, y - 4.0), pos2(x, y + 4.0), &painter);
        }
        let text = format!("{} units", number(length));
        painter.text(
            pos2(0.5 * (left + right), y - 6.0),
            Align2::CENTER_BOTTOM,
            text,
            FontId::proportional(11.0),
            CLEAR,
        );
    }

    // What points away comes first, so that what points at the viewer lies over it.
    let middle = corner - vec2(42.0, 42.0);
    let mut axes: Vec<_> = triad(camera).into_iter().zip(AXES).collect();
    axes.sort_by(|([.., a], _), ([.., b], _)| b.total_cmp(a));
    for ([x, y, _], (name, color)) in axes {
        let way = vec2(x as f32, y as f32);
        painter.line_segment([middle, middle + 24.0 * way], Stroke::new(2.0, color));
        painter.text(middle + 33.0 * way, Align2::CENTER_CENTER, name, FontId::proportional(11.0), color);
    }
}

/// A length as people write it.
fn number(length: f64) -> String {
    if (1e-3..1e5).contains(&length) { format!("{length}") } else { format!("{length:e}") }
}

/// Measured points, the line between them, its length.
pub(super) fn marks(context: &egui::Context, marks: &[Mark], camera: &Camera, size: [u32; 2], scale: f32) {
    let painter = context.layer_painter(LayerId::new(Order::Background, Id::unique("marks")));
    let point = |[x, y]: [f64; 2]| pos2(x as f32 / scale, y as f32 / scale);
    let seen = |from: &Mark, to: &Mark| project([from.point, to.point].map(Point3::from), camera, size);
    for mark in marks {
        if let Some([at, _]) = seen(mark, mark) {
            painter.circle_stroke(point(at), 4.0, Stroke::new(1.5, LIVE));
        }
    }
    let [a, b] = marks else { return };
    let (length, differs) = distance(a, b);
    if let Some(line) = seen(a, b) {
        painter.line_segment(line.map(point), Stroke::new(1.5, LIVE));
        let middle = point([0, 1].map(|axis| 0.5 * (line[0][axis] + line[1][axis])));
        let text = format!("{} units", measured(length, differs));
        let galley = painter.layout_no_wrap(text, FontId::monospace(12.0), CLEAR);
        let place = Align2::CENTER_BOTTOM.anchor_size(middle - vec2(0.0, 8.0), galley.size());
        painter.rect_filled(place.expand(4.0), 4.0, style::BACK);
        painter.galley(place.min, galley, CLEAR);
    }
}

/// Facts about a cluster.
pub(super) fn record(context: &egui::Context, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    let area = egui::Area::new(Id::unique("record")).anchor(Align2::RIGHT_TOP, vec2(-10.0, 120.0));
    area.interactable(false).show(context, |ui| {
        style::frame().show(ui, |ui| {
            ui.set_max_width(420.0);
            for line in lines {
                ui.label(RichText::new(line).monospace().color(CLEAR));
            }
        });
    });
}

/// The borders of what a frozen camera sees; `scale` is pixels of the image for one of the panel's points.
pub(super) fn borders(context: &egui::Context, lines: &[Line], scale: f32) {
    let painter = context.layer_painter(LayerId::new(Order::Background, Id::unique("borders")));
    for line in lines {
        painter.line_segment(
            line.map(|[x, y]| egui::pos2(x as f32 / scale, y as f32 / scale)),
            Stroke::new(1.5, LIVE),
        );
    }
}
