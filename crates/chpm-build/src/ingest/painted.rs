//! Textured triangles, found again by where their corners are.
//!
//! Positions keep their bits through the whole build, so that the triangles of leaves are met again without a number that travels with each.

use super::places_of;
use crate::context::Context;
use crate::error::BuildError;
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{Column, Spool};
use chpm_texture::{Material, TexturedTriangle, Tiles};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_128;

/// Wedges that are written and read at once.
const AT_ONCE: usize = 1 << 13;
/// Times that an image repeats in full. Of one that repeats more often, there are fewer texels the more it does: they are means of much of it anyway.
const MOST_REPEATS: f64 = 64.0;

/// A textured triangle. In order they come by places, and for one place as in the source.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable, Debug)]
#[repr(C)]
pub(crate) struct Wedge {
    /// Hash of its corners' positions.
    pub(crate) place: [u64; 2],
    /// Its number among the textured ones.
    number: u32,
    pub(crate) material: u32,
    /// Bits of the corners' coordinates, from the corner on that [`place_of`] begins with.
    uv: [[u32; 2]; 3],
}

impl Wedge {
    /// Coordinates of the corners of a triangle of the same place that begins with the corner `first`.
    pub(crate) fn uv(&self, first: usize) -> [[f32; 2]; 3] {
        std::array::from_fn(|corner| self.uv[(corner + 3 - first) % 3].map(f32::from_bits))
    }
}

/// The hash of a triangle's corners, whichever it begins with, and which of them it is begun with.
pub(crate) fn place_of(corners: [[f32; 3]; 3]) -> ([u64; 2], usize) {
    let bits = corners.map(|corner| corner.map(f32::to_bits));
    let turned = |first: usize| [bits[first], bits[(first + 1) % 3], bits[(first + 2) % 3]];
    let first = (1..3).fold(0, |least, first| if turned(first) < turned(least) { first } else { least });
    let hash = xxh3_128(bytemuck::cast_slice(&turned(first)));
    ([(hash >> 64) as u64, hash as u64], first)
}

/// Textured triangles of a source, and their images.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Painted {
    wedges: Spool,
    pub(crate) materials: Vec<Material>,
    pub(crate) tiles: Tiles,
    /// Texels that the triangles have together.
    pub(crate) texels: f64,
    /// By image, how much larger a texel is than one of its pixels.
    coarser: Vec<f64>,
}

/// The image of a triangle and how many of its pixels it has, however often these repeat; none where coordinates are no numbers.
fn pixels_of(triangle: &TexturedTriangle, materials: &[Material], tiles: &Tiles) -> Option<(u32, f64)> {
    let image = materials.get(triangle.material as usize)?.image?;
    let [a, b, c] = triangle.uv.map(|uv| uv.map(f64::from));
    let area = ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs() / 2.0;
    let [width, height] = tiles.size(image).map(f64::from);
    area.is_finite().then_some((image, area * width * height))
}

/// How much larger texels are of an image that has so many times more than it may: the power of three quarters.
fn fewer(times: f64) -> f64 {
    (times.sqrt() * times.sqrt().sqrt()).max(1.0)
}

impl Painted {
    /// Takes triangles with the numbers of their vertices, which are at `positions`.
    pub(super) fn new(
        triangles: &Column<TexturedTriangle>,
        positions: &Column<[f32; 3]>,
        materials: Vec<Material>,
        tiles: Tiles,
        context: &Context<'_>,
    ) -> Result<Self, BuildError> {
        let wedges = Spool::named(&context.store, "textured triangles", "textured-triangles");
        let mut at = places_of(positions);
        let (mut scratch, mut some, mut pixels) = (Vec::new(), Vec::new(), vec![0.0; tiles.count()]);
        for start in (0..triangles.len()).step_by(AT_ONCE) {
            context.check()?;
            let range = start..triangles.len().min(start + AT_ONCE);
            some.clear();
            for (number, triangle) in (start as u32..).zip(triangles.read(range, &mut scratch)?) {
                if let Some((image, count)) = pixels_of(triangle, &materials, &tiles) {
                    pixels[image as usize] += count;
                }
                let TexturedTriangle { vertices: [a, b, c], uv, material } = *triangle;
                let (place, first) = place_of([at(a)?, at(b)?, at(c)?]);
                let uv = std::array::from_fn(|corner| uv[(corner + first) % 3].map(f32::to_bits));
                some.push(Wedge { place, number, material, uv });
            }
            wedges.append(bytemuck::cast_slice(&some))?;
        }
        let most = |image: u32| MOST_REPEATS * tiles.size(image).map(f64::from).iter().product::<f64>();
        let coarser: Vec<f64> = (0..).zip(&pixels).map(|(image, count)| fewer(count / most(image))).collect();
        let texels = pixels.iter().zip(&coarser).map(|(count, coarser)| count / (coarser * coarser)).sum();
        Ok(Painted { wedges, materials, tiles, texels, coarser })
    }

    /// How much larger texels of an image are than its pixels, since it repeats.
    pub(crate) fn coarser(&self, image: u32) -> f64 {
        self.coarser[image as usize]
    }

    /// A warning if some are.
    pub(super) fn warning(&self) -> Option<String> {
        let most = self.coarser.iter().copied().fold(1.0, f64::max);
        (most > 1.0).then(|| {
            format!("an image repeats so often that sheets show it {most:.1} times coarser than it is")
        })
    }

    /// Textured triangles.
    pub(crate) fn count(&self) -> u64 {
        self.wedges.len() / size_of::<Wedge>() as u64
    }

    /// Hands all wedges to `take`.
    pub(crate) fn each(
        &self,
        context: &Context<'_>,
        mut take: impl FnMut(Wedge) -> Result<(), BuildError>,
    ) -> Result<(), BuildError> {
        let (step, mut bytes) = ((AT_ONCE * size_of::<Wedge>()) as u64, Vec::new());
        let len = self.wedges.len();
        for start in (0..len).step_by(step as usize) {
            context.check()?;
            self.wedges.read(start, step.min(len - start) as usize, &mut bytes)?;
            bytes
                .chunks_exact(size_of::<Wedge>())
                .map(bytemuck::pod_read_unaligned)
                .try_for_each(&mut take)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_the_same_from_any_corner_on() {
        let corners = [[0.5, -0.0, 2.0], [0.5, 0.0, 2.0], [-1.0, 7.0, 3.0]];
        let turned = |first: usize| [corners[first], corners[(first + 1) % 3], corners[(first + 2) % 3]];
        let (place, at) = place_of(corners);
        let uv = [[0.0f32, 0.5], [1.0, 0.25], [2.0, 4.0]];
        let stored = std::array::from_fn(|corner| uv[(corner + at) % 3].map(f32::to_bits));
        let wedge = Wedge { place, number: 0, material: 0, uv: stored };
        for first in 0..3 {
            let (other, at) = place_of(turned(first));
            assert_eq!(other, place);
            assert_eq!(wedge.uv(at), [uv[first], uv[(first + 1) % 3], uv[(first + 2) % 3]]);
        }
        let [a, b, c] = corners;
        assert_ne!(place_of([a, c, b]).0, place, "the other side");
        assert_ne!(place_of([a, a, c]).0, place, "zeros of two signs");
    }
}
