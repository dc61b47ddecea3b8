//! Several pictures in one, and the names of those that are apart.

use chpm_viewer::Image;
use std::path::{Path, PathBuf};

/// Pictures of one size side by side and below each other, row by row, in as square a grid as they fill.
pub(crate) fn sheet(images: &[Image], behind: [u8; 4]) -> Image {
    let Some([width, height]) = images.first().map(|image| image.size) else {
        return Image { size: [0; 2], pixels: Vec::new() };
    };
    let columns = columns(images.len());
    let rows = images.len().div_ceil(columns);
    let (row, line) = (4 * width as usize, 4 * width as usize * columns);
    let mut pixels = behind.repeat(line / 4 * height as usize * rows);
    for (place, image) in images.iter().enumerate() {
        let first = place / columns * height as usize * line + place % columns * row;
        for (y, source) in image.pixels.chunks_exact(row).enumerate() {
            pixels[first + y * line..][..row].copy_from_slice(source);
        }
    }
    Image { size: [width * columns as u32, height * rows as u32], pixels }
}

fn columns(count: usize) -> usize {
    (1..=count.max(1)).find(|side| side * side >= count).unwrap_or(1)
}

/// The name of a picture that is one of several: `NAME-07.png`, numbered from 1, all numbers of one length.
pub(crate) fn numbered(path: &Path, place: usize, count: usize) -> PathBuf {
    let digits = count.to_string().len();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let end =
        path.extension().map(|extension| format!(".{}", extension.to_string_lossy())).unwrap_or_default();
    path.with_file_name(format!("{stem}-{:0digits$}{end}", place + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_lie_in_rows() {
        let image = |n: u8| Image { size: [2, 1], pixels: vec![n; 8] };
        let all = sheet(&[image(1), image(2), image(3)], [9, 9, 9, 255]);
        assert_eq!(all.size, [4, 2]);
        assert_eq!((all.pixel(0, 0), all.pixel(3, 0)), ([1; 4], [2; 4]));
        assert_eq!((all.pixel(1, 1), all.pixel(2, 1)), ([3; 4], [9, 9, 9, 255]));
        assert_eq!([1, 2, 4, 5, 6, 9, 10].map(columns), [1, 2, 2, 3, 3, 3, 4]);
        assert_eq!(sheet(&[], [0; 4]).size, [0, 0]);
    }

    #[test]
    fn names_sort_as_they_were_made() {
        assert_eq!(numbered(Path::new("a/b.png"), 0, 12), Path::new("a/b-01.png"));
        assert_eq!(numbered(Path::new("b"), 11, 12), Path::new("b-12"));
    }
}
