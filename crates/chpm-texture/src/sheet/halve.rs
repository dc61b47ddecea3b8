//! Images of half the size.

use crate::srgb::encode;
use crate::texels::texel;

/// An image of half the width and height, rounded up: means of four texels, in linear light.
pub fn halved(pixels: &[[u8; 4]], [width, height]: [u32; 2]) -> (Vec<[u8; 4]>, [u32; 2]) {
    let size = [width.div_ceil(2), height.div_ceil(2)];
    let mut out = Vec::with_capacity(size[0] as usize * size[1] as usize);
    for (row, column) in (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| (row, column))) {
        let mut sums = [0u32; 4];
        for (y, x) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let at = (2 * row + y).min(height - 1) * width + (2 * column + x).min(width - 1);
            let parts = texel(&pixels[at as usize]);
            (0..4).for_each(|part| sums[part] += u32::from(parts[part]));
        }
        let [r, g, b, shown] = sums.map(f64::from);
        let [r, g, b] = [r, g, b].map(|part| encode(part * (255.0 * 256.0) / shown));
        out.push([r, g, b, (shown / (4.0 * 255.0) - 0.5) as u8]);
    }
    (out, size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_of_light() {
        let pixels = [[0, 0, 0, 255], [255, 255, 255, 255], [200, 9, 9, 127]];
        let (half, size) = halved(&pixels, [3, 1]);
        assert_eq!((half, size), (vec![[188, 188, 188, 255], [200, 9, 9, 127]], [2, 1]));
    }
}
