//! Seams of a leaf's paint: edges on whose two sides there are different parts of images.
//!
//! Texels are as large as pixels of the image. Where pixels are larger than triangles and each triangle shows another, as in a palette, such texels would have several
//! triangles each, and mix their colours: there they are as small as the triangles ask for.

use chpm_format::Page;
use chpm_texture::sheet::Paint;

/// Texels across a triangle beside a seam: the root of twice its area by the side of a texel, at least.
const ACROSS: f64 = 6.0;
/// Pixels between two places of an image that are still one.
const NEAR: f64 = 0.5;

/// Paint of a triangle at the two ends of an edge, the lower vertex first.
#[derive(Clone, Copy, PartialEq)]
enum Shown {
    Image(u32, [[f64; 2]; 2]),
    Colors([[u8; 4]; 2]),
}

/// Scratch for one leaf after the other.
#[derive(Default)]
pub(super) struct Seams {
    /// Ends of edges and their triangles, with the corner that an edge begins with.
    edges: Vec<([u16; 2], u32, u8)>,
    is_beside: Vec<bool>,
}

impl Seams {
    /// Makes the texels of triangles beside seams small enough.
    pub(super) fn limit(&mut self, page: &Page<'_>, paints: &[Paint], texels: &mut [f64]) {
        self.edges.clear();
        for (triangle, [a, b, c]) in (0..).zip(page.triangles) {
            for (corner, [from, to]) in (0..).zip([[a, b], [b, c], [c, a]]) {
                self.edges.push(([*from.min(to), *from.max(to)], triangle, corner));
            }
        }
        self.edges.sort_unstable();
        self.is_beside.clear();
        self.is_beside.resize(page.triangles.len(), false);
        for edge in self.edges.chunk_by(|a, b| a.0 == b.0) {
            let [(ends, first, corner), others @ ..] = edge else { continue };
            let shown = |triangle: u32, corner: u8| {
                let begins_lower = page.triangles[triangle as usize][usize::from(corner)] == ends[0];
                shown(&paints[triangle as usize], usize::from(corner), begins_lower)
            };
            let first_shown = shown(*first, *corner);
            for (_, other, corner) in others {
                if !is_one(&first_shown, &shown(*other, *corner)) {
                    self.is_beside[*first as usize] = true;
                    self.is_beside[*other as usize] = true;
                }
            }
        }
        for ((corners, is_beside), texel) in page.triangles.iter().zip(&self.is_beside).zip(texels) {
            if *is_beside {
                let [a, b, c] = corners.map(|corner| page.positions[usize::from(corner)]);
                let across = chpm_mesh::geom::area_vector(a, b, c).norm().sqrt() / ACROSS;
                // No number is no wish.
                *texel = if texel.is_nan() { across } else { texel.min(across) };
            }
        }
    }
}

fn shown(paint: &Paint, corner: usize, begins_lower: bool) -> Shown {
    let next = (corner + 1) % 3;
    let [lower, upper] = if begins_lower { [corner, next] } else { [next, corner] };
    match paint {
        Paint::Image { image, corners, .. } => Shown::Image(*image, [corners[lower], corners[upper]]),
        Paint::Colors(colors) => Shown::Colors([colors[lower], colors[upper]]),
    }
}

fn is_one(a: &Shown, b: &Shown) -> bool {
    match (a, b) {
        (Shown::Image(a, from), Shown::Image(b, to)) => {
            let pairs = from.as_flattened().iter().zip(to.as_flattened());
            a == b && pairs.into_iter().all(|(x, y)| (x - y).abs() <= NEAR)
        }
        _ => a == b,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_one_image_that_are_near_are_one() {
        let image = |number, x: f64| Shown::Image(number, [[x, 2.0], [x, 9.0]]);
        assert!(is_one(&image(1, 3.0), &image(1, 3.5)));
        assert!(!is_one(&image(1, 3.0), &image(1, 4.0)));
        assert!(!is_one(&image(1, 3.0), &image(2, 3.0)));
        let [red, blue] = [[200, 0, 0, 255], [0, 0, 200, 255]].map(|color| Shown::Colors([color; 2]));
        assert!(is_one(&red, &red) && !is_one(&red, &blue) && !is_one(&red, &image(1, 3.0)));
    }

    #[test]
    fn ends_are_told_from_the_lower_vertex_on() {
        let paint = Paint::Image { image: 7, corners: [[0.0; 2], [1.0; 2], [2.0; 2]], factor: [255; 4] };
        assert!(shown(&paint, 2, true) == Shown::Image(7, [[2.0; 2], [0.0; 2]]));
        assert!(shown(&paint, 2, false) == Shown::Image(7, [[0.0; 2], [2.0; 2]]));
    }
}
