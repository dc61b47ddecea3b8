//! Colours of text, which does not say whether they go from 0 to 1 or from 0 to 255.

/// The scale, as far as the colours up to now tell it.
#[derive(Default)]
pub(crate) struct ColorScale {
    has_bytes: bool,
    /// Which of the colours that are not handed over yet may be either: those of zeros and ones.
    doubtful: Vec<usize>,
}

impl ColorScale {
    /// Adds a colour of three channels or, with alpha, four, in eight bits each, behind those that are not handed over yet; white where there are none.
    ///
    /// A number from 2 on makes the whole colour one of bytes, and then all others of whole numbers, too: the darkest would be the brightest otherwise. Before that,
    /// a number that is a little beyond 1 is rounded, and bright.
    pub(crate) fn push(&mut self, numbers: &[f64], colors: &mut Vec<[u8; 4]>) {
        let [r, g, b, rest @ ..] = numbers else { return colors.push([255; 4]) };
        if colors.is_empty() {
            self.doubtful.clear();
        }
        if !self.has_bytes && numbers.iter().any(|x| *x >= 2.0) {
            self.has_bytes = true;
            for at in self.doubtful.drain(..) {
                colors[at][..3].iter_mut().for_each(|channel| *channel /= 255);
            }
        }
        let is_whole = numbers.iter().all(|x| *x == 0.0 || *x == 1.0);
        if is_whole && !self.has_bytes {
            self.doubtful.push(colors.len());
        }

        let are_bytes = self.has_bytes && (is_whole || numbers.iter().any(|x| *x > 1.0));
        let scale = if are_bytes { 1.0 } else { 255.0 };
        let alpha = rest.first().map_or(255.0, |alpha| alpha * scale);
        // The cast clamps, and makes NaN zero.
        colors.push([r * scale, g * scale, b * scale, alpha].map(|x| x.round() as u8));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(of: &[&[f64]]) -> Vec<[u8; 4]> {
        let (mut scale, mut colors) = (ColorScale::default(), Vec::new());
        of.iter().for_each(|numbers| scale.push(numbers, &mut colors));
        colors
    }

    #[test]
    fn zeros_and_ones_are_what_the_others_are() {
        let dark = [1, 0, 1, 255];
        assert_eq!(
            all(&[&[1.0, 0.0, 1.0], &[9.0, 0.0, 0.0], &[1.0, 0.0, 1.0]]),
            [dark, [9, 0, 0, 255], dark]
        );
        let bright = [255, 0, 255, 255];
        for other in [[0.5, 0.0, 0.0], [1.001, 0.0, 0.0]] {
            let found = all(&[&[1.0, 0.0, 1.0], &other, &[1.0, 0.0, 1.0]]);
            assert_eq!([found[0], found[2]], [bright; 2], "{other:?}");
            assert!(found[1][0] >= 128, "{found:?}");
        }
        assert_eq!(all(&[&[], &[1.0; 3], &[0.0, 0.0, 1.0, 1.0]]), [[255; 4], [255; 4], [0, 0, 255, 255]]);
        assert_eq!(all(&[&[], &[2.0; 3], &[0.5; 3]]), [[255; 4], [2, 2, 2, 255], [128, 128, 128, 255]]);
    }

    #[test]
    fn what_is_handed_over_stays_as_it_is() {
        let (mut scale, mut colors) = (ColorScale::default(), Vec::new());
        scale.push(&[1.0; 3], &mut colors);
        colors.clear();
        scale.push(&[200.0; 3], &mut colors);
        scale.push(&[1.0; 3], &mut colors);
        assert_eq!(colors, [[200, 200, 200, 255], [1, 1, 1, 255]]);
    }
}
