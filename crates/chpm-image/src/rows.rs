//! Rows of an image in any format that is read.

use crate::jpeg::JpegRows;
use crate::png::PngRows;
use crate::{Alpha, ImageError};
use std::io::{BufRead, Cursor, Read};

/// The longest side of an image.
const LONGEST: u32 = 65_535;

/// Rows of one image, from the top.
///
/// ```no_run
/// use chpm_image::ImageRows;
/// use std::{fs::File, io::BufReader};
///
/// let mut rows = ImageRows::open(BufReader::new(File::open("atlas.jpg")?), 64 << 20)?;
/// let mut pixels = Vec::new();
/// while rows.read_rows(64, &mut pixels)? > 0 {
///     assert_eq!(pixels.len() % rows.size()[0] as usize, 0);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ImageRows {
    codec: Box<dyn Codec>,
    size: [u32; 2],
    /// Rows that were handed out.
    done: u32,
    alpha: Alpha,
}

/// A reader of one format.
pub(crate) trait Codec: Send {
    /// Width and height.
    fn size(&self) -> [u32; 2];
    /// Bytes that it holds, with what decoding may add.
    fn memory(&self) -> u64;
    /// Appends the next row, which is there.
    fn read_row(&mut self, out: &mut Vec<[u8; 4]>) -> Result<(), ImageError>;
}

impl ImageRows {
    /// Opens an image, whose decoder may hold `memory` bytes; it takes them with the first row.
    ///
    /// # Errors
    /// [`ImageError`]: what is no image, is damaged, or needs more memory.
    pub fn open(mut bytes: impl BufRead + Send + 'static, memory: u64) -> Result<Self, ImageError> {
        let mut first = Vec::new();
        bytes.by_ref().take(8).read_to_end(&mut first)?;
        let is = |magic: &[u8]| first.starts_with(magic);
        let (is_png, is_jpeg) = (is(b"\x89PNG\r\n\x1a\n"), is(&[0xff, 0xd8, 0xff]));
        let bytes = Cursor::new(first).chain(bytes);
        let codec: Box<dyn Codec> = match (is_png, is_jpeg) {
            (true, _) => Box::new(PngRows::open(bytes, memory)?),
            (_, true) => Box::new(JpegRows::open(bytes, memory)?),
            _ => return Err(ImageError::Foreign),
        };
        let size = codec.size();
        if size.iter().any(|side| !(1..=LONGEST).contains(side)) {
            return Err(ImageError::Size { size });
        }
        Ok(ImageRows { codec, size, done: 0, alpha: Alpha::Kept })
    }

    /// The same, with the alpha that is meant instead of what the image holds.
    #[must_use]
    pub fn with_alpha(self, alpha: Alpha) -> Self {
        ImageRows { alpha, ..self }
    }

    /// Width and height.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Bytes that the decoder holds at most, without those of the rows that it hands out.
    pub fn memory(&self) -> u64 {
        self.codec.memory()
    }

    /// Replaces `out` by the next rows, at most `rows` of them, and answers how many there are: none after the last.
    ///
    /// # Errors
    /// [`ImageError`]: what is damaged, or cannot be read.
    pub fn read_rows(&mut self, rows: usize, out: &mut Vec<[u8; 4]>) -> Result<usize, ImageError> {
        out.clear();
        let count = rows.min((self.size[1] - self.done) as usize);
        for _ in 0..count {
            self.codec.read_row(out)?;
            self.done += 1;
        }
        self.alpha.apply(out);
        Ok(count)
    }
}
