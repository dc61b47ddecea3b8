//! Words in the corner of a picture that has no window.

use crate::headless::Image;
use egui::epaint::text::{FontDefinitions, FontId, Fonts, TextOptions};
use egui::epaint::{Color32, ColorImage};

/// Of the smaller side of a picture, how high letters are; in pixels, at least and at most.
const SHARE: f32 = 1.0 / 22.0;
const HEIGHTS: [f32; 2] = [11.0, 40.0];
/// Plate behind words, and its opacity: they are read on any picture.
const PLATE: f32 = 255.0;
const COVER: f32 = 0.8;
const INK: f32 = 30.0;

impl Image {
    /// Draws a bar of colours, from that of 0 to that of 1, along the lower edge at the right.
    pub fn color_bar(&mut self, color: impl Fn(f64) -> [u8; 3]) {
        let [width, height] = self.size.map(|side| side as usize);
        let letters = (SHARE * width.min(height) as f32).clamp(HEIGHTS[0], HEIGHTS[1]).round() as usize;
        let (margin, long) = (letters / 2, width / 3);
        let [left, top] = [width.saturating_sub(long + margin), height.saturating_sub(letters + margin)];
        for (row, column) in (0..letters).flat_map(|row| (0..long).map(move |column| (row, column))) {
            let [x, y] = [left + column, top + row];
            if x < width && y < height {
                let [r, g, b] = color((column as f64 + 0.5) / long as f64);
                self.pixels[4 * (y * width + x)..][..4].copy_from_slice(&[r, g, b, 255]);
            }
        }
    }

    /// Writes words into the lower left corner, on a plate.
    pub fn caption(&mut self, words: &str) {
        let [width, height] = self.size.map(|side| side as usize);
        let letters = (SHARE * width.min(height) as f32).clamp(HEIGHTS[0], HEIGHTS[1]).round();
        // As wide as the picture, at most: more words than that go to a line below.
        let margin = (0.5 * letters) as usize;
        let room = width.saturating_sub(4 * margin).max(1) as f32;
        let mut fonts = Fonts::new(TextOptions::default(), FontDefinitions::default());
        let mut view = fonts.with_pixels_per_point(1.0);
        let galley = view.layout(words.to_owned(), FontId::proportional(letters), Color32::WHITE, room);
        let atlas = view.image();
        let size = [galley.rect.width(), galley.rect.height()].map(|side| side.ceil() as usize + margin);
        let low = [margin, height.saturating_sub(size[1] + margin)];
        for (y, x) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (y, x))) {
            self.mix([low[0] + x, low[1] + y], PLATE, COVER);
        }
        let inset = (margin / 2) as f32;
        for row in &galley.rows {
            for glyph in row.glyphs.iter().filter(|glyph| !glyph.uv_rect.is_nothing()) {
                let at = row.pos + glyph.pos.to_vec2() + glyph.uv_rect.offset;
                let from = [at.x + inset + low[0] as f32, at.y + inset + low[1] as f32];
                self.stamp(&atlas, glyph.uv_rect.min, glyph.uv_rect.max, from);
            }
        }
    }

    /// A letter.
    fn stamp(&mut self, atlas: &ColorImage, low: [u16; 2], high: [u16; 2], to: [f32; 2]) {
        let [left, top] = to.map(|at| at.round().max(0.0) as usize);
        let [(u, right), (v, bottom)] = [0, 1].map(|axis| (usize::from(low[axis]), usize::from(high[axis])));
        for (row, column) in (v..bottom).flat_map(|row| (u..right).map(move |column| (row, column))) {
            let cover = atlas.pixels.get(row * atlas.size[0] + column).map_or(0, Color32::a);
            self.mix([left + column - u, top + row - v], INK, f32::from(cover) / 255.0);
        }
    }

    /// A grey over a pixel, where there is one.
    fn mix(&mut self, [x, y]: [usize; 2], grey: f32, cover: f32) {
        let [width, height] = self.size.map(|side| side as usize);
        if x >= width || y >= height {
            return;
        }
        for (channel, value) in self.pixels[4 * (y * width + x)..][..4].iter_mut().enumerate() {
            let over = if channel == 3 { 255.0 } else { grey };
            *value = (f32::from(*value) * (1.0 - cover) + over * cover).round() as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dark(image: &Image) -> usize {
        // The picture was clear; what the plate alone covers is light.
        image.pixels.chunks_exact(4).filter(|pixel| pixel[0] < 100 && pixel[3] > 0).count()
    }

    #[test]
    fn words_are_in_the_corner_and_each_is_another() {
        let blank = |size: [u32; 2]| Image { size, pixels: vec![0; 4 * (size[0] * size[1]) as usize] };
        let written = |words: &str, size: [u32; 2]| {
            let mut image = blank(size);
            image.caption(words);
            image
        };
        let [front, back] = ["front", "back"].map(|words| written(words, [320, 240]));
        assert!(front != back && dark(&front) > 20 && dark(&back) > 20, "{} {}", dark(&front), dark(&back));
        // Nothing but the corner is touched.
        let touched = |image: &Image| {
            (0..240 * 320_u32)
                .filter(|n| image.pixel(n % 320, n / 320)[3] > 0)
                .map(|n| [n % 320, n / 320])
                .collect::<Vec<_>>()
        };
        assert!(touched(&front).iter().all(|[x, y]| *x < 120 && *y > 200));
        let mut image = blank([300, 200]);
        image.color_bar(chpm_mesh::viridis);
        assert_eq!([image.pixel(196, 190), image.pixel(294, 190)].map(|p| p[3]), [255; 2]);
        assert!(image.pixel(196, 190)[2] > image.pixel(294, 190)[2], "from blue to yellow");
        assert_eq!(image.pixel(100, 190)[3], 0);
        // Long words go on below, and small pictures keep what fits.
        let long = "heights divided by 111320: places look like degrees, heights like metres";
        assert!(touched(&written(long, [320, 240])).iter().all(|[x, y]| *x < 320 && *y > 120));
        for size in [[1, 1], [30, 9], [9, 30]] {
            assert_eq!(written(long, size).size, size);
        }
    }
}
