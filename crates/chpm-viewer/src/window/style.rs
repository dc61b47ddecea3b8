//! How the panel looks: dark, translucent, quiet.

use egui::{Color32, CornerRadius, FontFamily, FontId, Margin, Shadow, Stroke, TextStyle};

/// Behind the panel.
pub(super) const BACK: Color32 = Color32::from_rgba_premultiplied(15, 17, 21, 225);
/// Colour of selections and of important numbers.
pub(super) const ACCENT: Color32 = Color32::from_rgb(94, 180, 255);
/// Names.
pub(super) const QUIET: Color32 = Color32::from_rgb(140, 148, 160);
/// Values.
pub(super) const CLEAR: Color32 = Color32::from_rgb(222, 227, 234);
/// Colour of failures.
pub(super) const WARNING: Color32 = Color32::from_rgb(255, 138, 108);
/// A recording, and a frozen selection.
pub(super) const LIVE: Color32 = Color32::from_rgb(255, 92, 92);
/// The parts of a frame, in their order.
pub(super) const PARTS: [Color32; 7] = [
    Color32::from_rgb(94, 180, 255),
    Color32::from_rgb(120, 220, 190),
    Color32::from_rgb(250, 200, 90),
    Color32::from_rgb(190, 140, 255),
    Color32::from_rgb(255, 130, 170),
    Color32::from_rgb(255, 100, 80),
    Color32::from_rgb(92, 100, 112),
];

/// Sets fonts, distances and colours.
pub(super) fn apply(context: &egui::Context) {
    context.set_theme(egui::Theme::Dark);
    context.all_styles_mut(|style| {
        fn font(size: f32, family: FontFamily) -> FontId {
            FontId::new(size, family)
        }
        style.text_styles = [
            (TextStyle::Heading, font(16.0, FontFamily::Proportional)),
            (TextStyle::Body, font(12.5, FontFamily::Proportional)),
            (TextStyle::Button, font(12.5, FontFamily::Proportional)),
            (TextStyle::Monospace, font(12.0, FontFamily::Monospace)),
            (TextStyle::Small, font(10.5, FontFamily::Proportional)),
        ]
        .into();

        // Close together: all of the panel is to be seen at once.
        style.spacing.item_spacing = egui::vec2(6.0, 3.0);
        style.spacing.interact_size.y = 17.0;
        style.spacing.button_padding = egui::vec2(7.0, 2.0);
        style.spacing.slider_width = 150.0;

        let visuals = &mut style.visuals;
        visuals.panel_fill = BACK;
        visuals.window_fill = BACK;
        visuals.window_stroke = Stroke::new(1.0, Color32::from_white_alpha(18));
        visuals.window_shadow = Shadow::NONE;
        visuals.window_corner_radius = CornerRadius::same(8);

        visuals.selection.bg_fill = Color32::from_rgb(38, 92, 148);
        visuals.selection.stroke = Stroke::new(1.0, CLEAR);
        visuals.slider_trailing_fill = true;
        visuals.widgets.noninteractive.fg_stroke.color = CLEAR;
        visuals.widgets.open.weak_bg_fill = Color32::from_rgb(24, 27, 33);
        visuals.widgets.inactive.fg_stroke.color = CLEAR;
        visuals.widgets.inactive.weak_bg_fill = Color32::from_rgb(38, 42, 50);
        visuals.widgets.inactive.bg_fill = Color32::from_rgb(44, 49, 58);
    });
}

/// How much larger than usual all that lies over the model is, in a window of so many points: a system that does not say that its screen is
/// large and dense leaves nothing of a panel there.
pub(super) fn zoom([width, height]: [f64; 2]) -> f32 {
    let screens = (width / 1920.0).min(height / 1080.0);
    let quarters = (4.0 * screens).floor() / 4.0;
    if quarters >= 1.5 { quarters.min(4.0) as f32 } else { 1.0 }
}

/// The frame of the panel and of what lies over the model.
pub(super) fn frame() -> egui::Frame {
    egui::Frame::new()
        .fill(BACK)
        .stroke(Stroke::new(1.0, Color32::from_white_alpha(18)))
        .corner_radius(CornerRadius::same(8))
        .inner_margin(Margin::same(12))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_over_the_model_is_larger_where_a_window_has_more_points() {
        let zooms = [
            [320.0, 200.0],
            [1280.0, 800.0],
            [2560.0, 1440.0],
            [3840.0, 2160.0],
            [3840.0, 1080.0],
            [7680.0, 4320.0],
        ];
        assert_eq!(zooms.map(zoom), [1.0, 1.0, 1.0, 2.0, 1.0, 4.0]);
    }
}
