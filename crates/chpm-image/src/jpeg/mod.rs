//! JPEG: rows as they come, or all coefficients of a progressive image.

mod ended;
mod header;

use crate::ImageError;
use crate::rows::Codec;
use ended::Ended;
use header::Header;
use otf_pixels_codec_jpeg::JpegDecoder;
use otf_pixels_core::{Decoder, Limits, PixelFormat, PixelsError};
use std::io::{BufRead, Chain, Cursor, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Bytes that the codec holds beside rows: its tables, and what it reads at once.
const CODEC: u64 = 1 << 20;
/// Bytes that a column of pixels takes: a row of blocks, before and after they are made colours, and where columns of chroma are.
const COLUMN: u64 = 256;

pub(crate) struct JpegRows<R: BufRead + Send> {
    decoder: JpegDecoder<Ended<Chain<Cursor<Vec<u8>>, R>>>,
    size: [u32; 2],
    is_grey: bool,
    memory: u64,
    row: Vec<u8>,
    has_ended: Arc<AtomicBool>,
}

impl<R: BufRead + Send> JpegRows<R> {
    pub(crate) fn open(mut bytes: R, memory: u64) -> Result<Self, ImageError> {
        let header = Header::read(&mut bytes)?;
        let size = header.size;
        let needed = CODEC + COLUMN * u64::from(size[0]) + header.coefficients();
        if needed > memory {
            let (what, instead) = match header.is_progressive {
                true => ("progressive JPEG", "a baseline one"),
                false => ("JPEG", "a narrower one"),
            };
            return Err(ImageError::Memory { what, instead, size, needed, limit: memory });
        }

        let (bytes, has_ended) = Ended::new(Cursor::new(header.bytes).chain(bytes));
        let decoder = JpegDecoder::new(bytes, Limits::unlimited()).map_err(error)?;
        let shape = decoder.descriptor();
        let is_grey = shape.pixel == PixelFormat::Gray8;
        Ok(JpegRows { size, is_grey, memory: needed, row: vec![0; shape.row_bytes()], decoder, has_ended })
    }
}

impl<R: BufRead + Send> Codec for JpegRows<R> {
    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn memory(&self) -> u64 {
        self.memory
    }

    fn read_row(&mut self, out: &mut Vec<[u8; 4]>) -> Result<(), ImageError> {
        self.decoder.read_row(&mut self.row).map_err(error)?;
        if self.has_ended.load(Relaxed) {
            return Err(damaged("it ends early"));
        }
        if self.is_grey {
            out.extend(self.row.iter().map(|&grey| [grey, grey, grey, 255]));
        } else {
            out.extend(self.row.as_chunks().0.iter().map(|&[r, g, b]| [r, g, b, 255]));
        }
        Ok(())
    }
}

fn error(error: PixelsError) -> ImageError {
    match error {
        PixelsError::Io { source, .. } => source.into(),
        PixelsError::Malformed { detail, .. } => damaged(detail),
        PixelsError::Unsupported { .. } => ImageError::Unsupported { what: "a JPEG of this kind" },
        other => damaged(other.to_string()),
    }
}

fn damaged(what: impl Into<String>) -> ImageError {
    ImageError::Damaged { format: "JPEG", what: what.into() }
}
