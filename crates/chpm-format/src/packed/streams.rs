//! Streams of symbols: zstd makes each short by statistics of its own.

use super::Damage;
use std::io;
use zstd::stream::raw::{CParameter, Encoder, InBuffer, Operation, OutBuffer};

/// Higher ones find next to nothing more in symbols.
const LEVEL: i32 = 1;

/// The end of a stream.
#[derive(Clone, Copy, Default)]
pub(super) struct Part {
    symbols: usize,
    pub(super) bits: u64,
    pub(super) written: usize,
}

/// Symbols that are written, kept from page to page.
pub(super) struct Written {
    pub(super) symbols: Vec<u8>,
    /// Where zstd begins anew; the open bits up to there; the bytes that zstd had written.
    pub(super) parts: Vec<Part>,
    zstd: Encoder<'static>,
}

/// Short repetitions in symbols are chance, and take longer to decode than they save.
fn encoder() -> io::Result<Encoder<'static>> {
    let mut encoder = Encoder::new(LEVEL)?;
    encoder.set_parameter(CParameter::MinMatch(7))?;
    Ok(encoder)
}

impl Written {
    pub(super) fn new() -> io::Result<Self> {
        Ok(Written { symbols: Vec::new(), parts: Vec::new(), zstd: encoder()? })
    }

    pub(super) fn clear(&mut self) {
        self.symbols.clear();
        self.parts.clear();
    }

    /// Ends a stream, up to which so many open bits were written.
    pub(super) fn end(&mut self, bits: u64) {
        self.parts.push(Part { symbols: self.symbols.len(), bits, written: 0 });
    }

    /// Appends all streams as one frame.
    pub(super) fn compress(&mut self, out: &mut Vec<u8>) -> io::Result<()> {
        let (start, total) = (out.len(), self.symbols.len());
        out.resize(start + zstd::zstd_safe::compress_bound(total) + 64 * self.parts.len(), 0);
        self.zstd.reinit()?;
        self.zstd.set_pledged_src_size(Some(total as u64))?;
        let mut buffer = OutBuffer::around(&mut out[start..]);

        let mut from = 0;
        let last = self.parts.len() - 1;
        for (index, part) in self.parts.iter_mut().enumerate() {
            let mut input = InBuffer::around(&self.symbols[from..part.symbols]);
            while input.pos() < part.symbols - from {
                self.zstd.run(&mut input, &mut buffer)?;
            }
            from = part.symbols;
            if index < last {
                while self.zstd.flush(&mut buffer)? > 0 {}
            } else {
                while self.zstd.finish(&mut buffer, true)? > 0 {}
            }
            part.written = buffer.pos();
        }

        let len = buffer.pos();
        out.truncate(start + len);
        Ok(())
    }
}

/// Streams of symbols that follow one another, to be read.
pub(super) struct Streams<'a>(pub(super) &'a [u8]);

impl<'a> Streams<'a> {
    pub(super) fn next(&mut self, len: usize) -> Result<&'a [u8], Damage> {
        self.0.split_off(..len).ok_or(Damage("as many symbols as the page has numbers"))
    }

    /// The next symbol of a stream whose length shows as it is read.
    #[inline]
    pub(super) fn one(&mut self) -> Result<u8, Damage> {
        self.0.split_off_first().copied().ok_or(Damage("as many symbols as the page has numbers"))
    }

    /// All was read.
    pub(super) fn finish(&self) -> Result<(), Damage> {
        if self.0.is_empty() { Ok(()) } else { Err(Damage("no more symbols than the page has")) }
    }
}
