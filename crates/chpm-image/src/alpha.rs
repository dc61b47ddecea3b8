//! Alpha of images.

/// The meaning of an image's alpha, which materials tell and files of images do not.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
pub enum Alpha {
    /// Nothing: all is opaque, whatever it holds.
    #[default]
    Ignored,
    /// Pixels of less are not seen, others are opaque.
    Cut(u8),
    /// The share of a pixel that is seen.
    Kept,
}

impl Alpha {
    /// Gives pixels the alpha that is meant.
    pub(crate) fn apply(self, pixels: &mut [[u8; 4]]) {
        match self {
            Alpha::Ignored => pixels.iter_mut().for_each(|[.., alpha]| *alpha = 255),
            Alpha::Cut(least) => {
                pixels.iter_mut().for_each(|[.., alpha]| *alpha = if *alpha < least { 0 } else { 255 });
            }
            Alpha::Kept => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_is_what_is_meant() {
        let alphas = |alpha: Alpha| {
            let mut pixels = [0, 127, 128, 255].map(|alpha| [1, 2, 3, alpha]);
            alpha.apply(&mut pixels);
            assert!(pixels.iter().all(|pixel| pixel[..3] == [1, 2, 3]));
            pixels.map(|pixel| pixel[3])
        };
        assert_eq!(alphas(Alpha::Ignored), [255; 4]);
        assert_eq!(alphas(Alpha::Cut(128)), [0, 0, 255, 255]);
        assert_eq!(alphas(Alpha::Cut(0)), [255; 4]);
        assert_eq!(alphas(Alpha::Kept), [0, 127, 128, 255]);
    }
}
