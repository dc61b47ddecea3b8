//! The segments in front of the first scan: what is asked of memory is known before anything is taken, and what says nothing about
//! pixels is left out.

use super::damaged;
use crate::ImageError;
use std::io::{self, BufRead};

/// Bytes that segments in front of the first scan may have: tables are given anew a few times at most.
const LONGEST: usize = 1 << 20;

const SOI: u8 = 0xd8;
const EOI: u8 = 0xd9;
const SOS: u8 = 0xda;
const ADOBE: u8 = 0xee;

pub(super) struct Header {
    /// The segments with those that matter, the scan's header last.
    pub(super) bytes: Vec<u8>,
    pub(super) size: [u32; 2],
    pub(super) is_progressive: bool,
    /// Horizontal and vertical sampling of each component.
    sampling: Vec<[u32; 2]>,
}

impl Header {
    /// Reads up to the end of the first scan's header.
    pub(super) fn read(bytes: &mut impl BufRead) -> Result<Self, ImageError> {
        let mut header =
            Header { bytes: vec![0xff, SOI], size: [0; 2], is_progressive: false, sampling: Vec::new() };
        if [byte(bytes)?, byte(bytes)?] != [0xff, SOI] {
            return Err(damaged("it does not begin as one"));
        }
        loop {
            let marker = next_marker(bytes)?;
            if marker == EOI {
                return Err(damaged("it has no pixels"));
            }
            let mut segment = vec![0xff, marker, byte(bytes)?, byte(bytes)?];
            let len = usize::from(segment[2]) << 8 | usize::from(segment[3]);
            segment.resize(len.max(2) + 2, 0);
            bytes.read_exact(&mut segment[4..]).map_err(ended)?;

            let is_told = matches!(marker, 0xe0..=0xef | 0xfe) && marker != ADOBE;
            let is_frame = matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc);
            if is_frame {
                header.frame(marker, &mut segment)?;
            }
            if !is_told {
                header.bytes.extend_from_slice(&segment);
            }
            if header.bytes.len() > LONGEST {
                return Err(damaged("its tables do not end"));
            }
            if marker == SOS {
                return header.scan(&segment);
            }
        }
    }

    /// Takes the frame's size and components.
    fn frame(&mut self, marker: u8, segment: &mut [u8]) -> Result<(), ImageError> {
        let unsupported = |what| Err(ImageError::Unsupported { what });
        match marker {
            0xc0..=0xc2 => {}
            0xc3 => return unsupported("a lossless JPEG"),
            0xc9..=0xcf => return unsupported("a JPEG with arithmetic coding"),
            _ => return unsupported("a hierarchical JPEG"),
        }
        let Some((&mut [precision, h0, h1, w0, w1, count], components)) =
            segment[4..].split_first_chunk_mut()
        else {
            return Err(damaged("its frame is too short"));
        };
        if precision != 8 {
            return unsupported("a JPEG of more than 8 bits");
        }
        self.size = [[w0, w1], [h0, h1]].map(|side| u16::from_be_bytes(side).into());
        if self.size[1] == 0 {
            return unsupported("a JPEG that tells its height at its end");
        }
        self.is_progressive = marker == 0xc2;
        let components = components.as_chunks_mut::<3>().0;
        if components.len() != usize::from(count) {
            return Err(damaged("its frame has another length than it says"));
        }
        match components {
            // The blocks of a component alone lie in rows, whatever its sampling.
            [grey] => grey[1] = 0x11,
            [_, _, _] => {}
            [_, _, _, _] => return unsupported("a JPEG of four inks (CMYK)"),
            _ => return unsupported("a JPEG of two or many components"),
        }
        self.sampling = components.iter().map(|part| [part[1] >> 4, part[1] & 15].map(u32::from)).collect();
        Ok(())
    }

    /// Looks at the first scan.
    fn scan(self, segment: &[u8]) -> Result<Self, ImageError> {
        let Some(&count) = segment.get(4) else { return Err(damaged("its scan is too short")) };
        if !self.is_progressive && usize::from(count) < self.sampling.len() {
            return Err(ImageError::Unsupported { what: "a JPEG of one colour after another" });
        }
        Ok(self)
    }

    /// Bytes of all coefficients, if they are held.
    pub(super) fn coefficients(&self) -> u64 {
        if !self.is_progressive {
            return 0;
        }
        let most = |axis: usize| self.sampling.iter().map(|part| part[axis]).max().unwrap_or(1).max(1);
        let units = [0, 1].map(|axis| u64::from(self.size[axis].div_ceil(8 * most(axis))));
        let blocks: u64 = self.sampling.iter().map(|part| u64::from(part[0] * part[1])).sum();
        units[0] * units[1] * blocks * 128
    }
}

/// The code of the next marker; bytes before it are passed over, as others do.
fn next_marker(bytes: &mut impl BufRead) -> Result<u8, ImageError> {
    loop {
        while byte(bytes)? != 0xff {}
        let mut code = 0xff;
        while code == 0xff {
            code = byte(bytes)?;
        }
        // Markers without a segment: stuffing, restarts, and one of old.
        if !matches!(code, 0 | 1 | 0xd0..=SOI) {
            return Ok(code);
        }
    }
}

fn byte(bytes: &mut impl BufRead) -> Result<u8, ImageError> {
    let mut byte = [0];
    bytes.read_exact(&mut byte).map_err(ended)?;
    Ok(byte[0])
}

fn ended(error: io::Error) -> ImageError {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => damaged("it ends early"),
        _ => error.into(),
    }
}
