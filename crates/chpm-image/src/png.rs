//! PNG: rows as they come, or all of an interlaced image.

use crate::ImageError;
use crate::forward::Forward;
use crate::rows::Codec;
use png::{BitDepth, ColorType, Decoder, DecodingError, Limits, Reader, Transformations};
use std::io::BufRead;

/// Bytes that the codec holds beside rows: its window, tables and chunks.
const CODEC: u64 = 1 << 20;
/// Bytes that the codec may take for chunks that say nothing about pixels.
const LIMIT: u64 = 16 << 20;

pub(crate) struct PngRows<R: BufRead + Send> {
    reader: Reader<Forward<R>>,
    size: [u32; 2],
    channels: usize,
    memory: u64,
    row: Vec<u8>,
    /// All pixels of an interlaced image, and how many were handed out.
    is_interlaced: bool,
    whole: Option<(Vec<u8>, usize)>,
}

impl<R: BufRead + Send> PngRows<R> {
    pub(crate) fn open(bytes: R, memory: u64) -> Result<Self, ImageError> {
        let limits = Limits { bytes: memory.min(LIMIT) as usize };
        let mut decoder = Decoder::new_with_limits(Forward(bytes), limits);
        decoder.set_transformations(Transformations::normalize_to_color8());
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        let reader = decoder.read_info().map_err(error)?;

        let size = [reader.info().width, reader.info().height];
        let (color, depth) = reader.output_color_type();
        if depth != BitDepth::Eight || color == ColorType::Indexed {
            return Err(ImageError::Unsupported { what: "this kind of PNG" });
        }
        // The decoder takes for granted that entries are whole, and 256 at most.
        let palette =
            reader.info().palette.as_deref().filter(|_| reader.info().color_type == ColorType::Indexed);
        if let Some(palette) = palette
            && !(palette.len().is_multiple_of(3) && (1..=256).contains(&(palette.len() / 3)))
        {
            return Err(damaged(&format!("a palette of {} bytes", palette.len())));
        }
        let channels = color.samples();
        let line = u64::from(size[0]) * 8;
        let all = u64::from(size[0]) * u64::from(size[1]) * channels as u64;
        let is_interlaced = reader.info().interlaced;
        let needed = CODEC + 4 * line + if is_interlaced { all } else { 0 };
        if needed > memory {
            let what = if is_interlaced { "interlaced PNG" } else { "PNG" };
            let instead = if is_interlaced { "one without interlacing" } else { "a narrower one" };
            return Err(ImageError::Memory { what, instead, size, needed, limit: memory });
        }

        let row = vec![0; size[0] as usize * channels];
        Ok(PngRows { reader, size, channels, memory: needed, row, is_interlaced, whole: None })
    }
}

impl<R: BufRead + Send> Codec for PngRows<R> {
    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn memory(&self) -> u64 {
        self.memory
    }

    fn read_row(&mut self, out: &mut Vec<[u8; 4]>) -> Result<(), ImageError> {
        if self.is_interlaced && self.whole.is_none() {
            let mut pixels = vec![0; self.row.len() * self.size[1] as usize];
            self.reader.next_frame(&mut pixels).map_err(error)?;
            self.whole = Some((pixels, 0));
        }
        let row = match &mut self.whole {
            Some((pixels, at)) => {
                *at += self.row.len();
                &pixels[*at - self.row.len()..*at]
            }
            None => {
                if self.reader.read_row(&mut self.row).map_err(error)?.is_none() {
                    return Err(damaged("it has fewer rows than it says"));
                }
                &self.row
            }
        };
        match self.channels {
            1 => out.extend(row.iter().map(|&grey| [grey, grey, grey, 255])),
            2 => out.extend(row.as_chunks().0.iter().map(|&[grey, alpha]| [grey, grey, grey, alpha])),
            3 => out.extend(row.as_chunks().0.iter().map(|&[r, g, b]| [r, g, b, 255])),
            _ => out.extend(row.as_chunks::<4>().0),
        }
        Ok(())
    }
}

fn error(error: DecodingError) -> ImageError {
    match error {
        DecodingError::IoError(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => error.into(),
        other => damaged(&other.to_string()),
    }
}

fn damaged(what: &str) -> ImageError {
    ImageError::Damaged { format: "PNG", what: what.to_owned() }
}
