//! A window over the input that moves in blocks.

use super::{
    error::Fault,
    header::{Encoding, PropertyType, ScalarType},
};
use std::io::{self, Read};

/// Bytes of the window. A header must fit, and so must every record of fixed length.
pub(super) const BLOCK: usize = 1 << 20;

/// The bytes `start..end` of the buffer are read and not yet consumed.
pub(super) struct Source<R> {
    reader: R,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    /// Offset in the file of `buffer[0]`.
    base: u64,
    ended: bool,
    /// How the body is to be understood; set once the header is known.
    pub(super) encoding: Encoding,
    /// Offset in the file of the last value, and its line if it is text: errors point here.
    pub(super) mark: u64,
    /// Line of the next byte of text, from 1.
    pub(super) line: u64,
    /// Line of the last word.
    pub(super) word_line: u64,
    /// Whether the last byte was a carriage return, whose line feed is no line of its own.
    pub(super) after_return: bool,
}

impl<R: Read> Source<R> {
    pub(super) fn new(reader: R) -> Self {
        Source {
            reader,
            buffer: vec![0; BLOCK],
            start: 0,
            end: 0,
            base: 0,
            ended: false,
            encoding: Encoding::Ascii,
            mark: 0,
            line: 1,
            word_line: 0,
            after_return: false,
        }
    }

    /// Bytes that are read and not yet consumed.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.buffer[self.start..self.end]
    }

    /// Offset in the file of the next byte.
    pub(super) fn offset(&self) -> u64 {
        self.base + self.start as u64
    }

    /// Offset in the file of the first byte that is not read yet: its length, at the end.
    pub(super) fn read_offset(&self) -> u64 {
        self.base + self.end as u64
    }

    /// The `count` bytes that were consumed last.
    pub(super) fn consumed(&self, count: usize) -> &[u8] {
        &self.buffer[self.start - count..self.start]
    }

    pub(super) fn consume(&mut self, count: usize) {
        debug_assert!(count <= self.end - self.start);
        self.start += count;
    }

    /// Reads at least one byte more; false at the end of the input, or if a whole block waits to be consumed.
    pub(super) fn more(&mut self) -> io::Result<bool> {
        if self.start == self.end || self.end == self.buffer.len() {
            self.buffer.copy_within(self.start..self.end, 0);
            self.base += self.start as u64;
            self.end -= self.start;
            self.start = 0;
        }
        while !self.ended && self.end < self.buffer.len() {
            match self.reader.read(&mut self.buffer[self.end..]) {
                Ok(0) => self.ended = true,
                Ok(count) => {
                    // A reader that claims more than it was given room for is wrong, and must not make us panic.
                    self.end = self.buffer.len().min(self.end + count);
                    return Ok(true);
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(false)
    }

    /// Sees to it that `count` bytes can be taken; false if the input ends before.
    pub(super) fn need(&mut self, count: usize) -> io::Result<bool> {
        while self.end - self.start < count {
            if !self.more()? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Skips bytes without looking at them, and says how many there were.
    pub(super) fn skip(&mut self, count: u64) -> io::Result<u64> {
        let mut left = count;
        loop {
            let here = usize::try_from(left).unwrap_or(usize::MAX).min(self.end - self.start);
            self.consume(here);
            left -= here as u64;
            if left == 0 || !self.more()? {
                return Ok(count - left);
            }
        }
    }

    /// To be called before the first value of an element.
    pub(super) fn begin_element(&mut self) -> Result<(), Fault> {
        if self.encoding == Encoding::Ascii { self.begin_line() } else { Ok(()) }
    }

    /// The next number of the body. All types fit an `f64` exactly.
    pub(super) fn scalar(&mut self, ty: ScalarType) -> Result<f64, Fault> {
        match self.encoding {
            Encoding::Ascii => self.text_scalar(ty),
            Encoding::BinaryLittleEndian => self.binary_scalar::<false>(ty),
            Encoding::BinaryBigEndian => self.binary_scalar::<true>(ty),
        }
    }

    /// The bits of the last number, if it was a `float` of a binary body: those that are no number have many.
    pub(super) fn last_float(&self, ty: ScalarType) -> Option<u32> {
        let bytes = || self.consumed(4).try_into().unwrap_or_default();
        match (ty, self.encoding) {
            (ScalarType::Float, Encoding::BinaryLittleEndian) => Some(u32::from_le_bytes(bytes())),
            (ScalarType::Float, Encoding::BinaryBigEndian) => Some(u32::from_be_bytes(bytes())),
            _ => None,
        }
    }

    /// The next vertex index of the body; text may exceed the declared type, the range check comes later.
    pub(super) fn index(&mut self, ty: ScalarType) -> Result<i64, Fault> {
        match self.encoding {
            Encoding::Ascii => self.text_integer(),
            _ => Ok(self.scalar(ty)? as i64),
        }
    }

    /// The length of the list that follows.
    pub(super) fn count(&mut self, ty: ScalarType) -> Result<u64, Fault> {
        let count = self.scalar(ty)?;
        if count < 0.0 { Err(Fault::NegativeCount(count as i64)) } else { Ok(count as u64) }
    }

    /// Skips the values of `properties`.
    pub(super) fn skip_values<'a>(
        &mut self,
        properties: impl IntoIterator<Item = &'a PropertyType>,
    ) -> Result<(), Fault> {
        for property in properties {
            let (count, item) = match *property {
                PropertyType::Scalar(ty) => (1, ty),
                PropertyType::List { count, item } => (self.count(count)?, item),
            };
            if self.encoding == Encoding::Ascii {
                for _ in 0..count {
                    self.token()?;
                }
            } else {
                let length = count * item.size() as u64;
                if self.skip(length)? < length {
                    return Err(Fault::End);
                }
            }
        }
        Ok(())
    }
}
