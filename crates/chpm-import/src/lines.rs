//! Text line by line, from a window of fixed size.

use super::error::ImportError;
use super::format::MARK;
use crate::location::{SourceLocation, excerpt};
use std::io::{self, Read};

/// Bytes of the window; a line must fit.
pub(super) const WINDOW: usize = 1 << 20;

/// The input, and the line that it stands at. Lines end in LF, CRLF or CR.
pub(super) struct Lines<R> {
    reader: R,
    buffer: Vec<u8>,
    /// The current line.
    from: usize,
    to: usize,
    /// Bytes `next..end` are read and belong to lines to come.
    next: usize,
    end: usize,
    /// Offset in the input of `buffer[0]`.
    base: u64,
    /// Number of the current line, from 1.
    line: u64,
    /// Whether the current line ends in CR: an LF that follows is no line of its own.
    after_return: bool,
    ended: bool,
}

impl<R: Read> Lines<R> {
    pub(super) fn new(reader: R) -> Self {
        let buffer = vec![0; WINDOW];
        Lines {
            reader,
            buffer,
            from: 0,
            to: 0,
            next: 0,
            end: 0,
            base: 0,
            line: 0,
            after_return: false,
            ended: false,
        }
    }

    /// Goes to the next line; false at the end of the input, where an empty line is none.
    pub(super) fn advance(&mut self) -> Result<bool, ImportError> {
        self.line += 1;
        if self.after_return && (self.next < self.end || self.more()?) && self.buffer[self.next] == b'\n' {
            self.next += 1;
        }
        self.after_return = false;
        let mut len = 0;
        loop {
            let rest = &self.buffer[self.next + len..self.end];
            if let Some(at) = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')) {
                self.after_return = rest[at] == b'\r';
                self.take(len + at, 1);
                return Ok(true);
            }
            len += rest.len();
            if !self.more()? {
                self.take(len, 0);
                return Ok(len > 0);
            }
        }
    }

    /// The line without its end.
    pub(super) fn current(&self) -> &[u8] {
        &self.buffer[self.from..self.to]
    }

    /// Where the current line is: in the `index`th `element`.
    pub(super) fn place(&self, element: &str, index: u64) -> SourceLocation {
        let offset = self.base + self.from as u64;
        SourceLocation { element: element.to_owned(), index, offset, line: Some(self.line) }
    }

    fn take(&mut self, len: usize, end_len: usize) {
        (self.from, self.to) = (self.next, self.next + len);
        self.next += len + end_len;
        if self.line == 1 && self.current().starts_with(MARK) {
            self.from += MARK.len();
        }
    }

    /// Reads at least one byte more; false at the end of the input.
    fn more(&mut self) -> Result<bool, ImportError> {
        if self.end == self.buffer.len() {
            if self.next == 0 {
                return Err(ImportError::LineTooLong { line: self.line, limit: WINDOW });
            }
            self.buffer.copy_within(self.next..self.end, 0);
            self.base += self.next as u64;
            self.end -= self.next;
            self.next = 0;
        }
        while !self.ended {
            match self.reader.read(&mut self.buffer[self.end..]) {
                Ok(0) => self.ended = true,
                Ok(count) => {
                    // A reader that claims more than it was given room for is wrong, and must not make us panic.
                    self.end = self.buffer.len().min(self.end + count);
                    return Ok(true);
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(source) => return Err(ImportError::Read { offset: self.base + self.end as u64, source }),
            }
        }
        Ok(false)
    }
}

/// A line without its comment.
pub(super) fn meaning(line: &[u8]) -> &[u8] {
    line.split(|byte| *byte == b'#').next().unwrap_or_default()
}

/// The words of a line.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|byte| matches!(byte, b' ' | b'\t'..=b'\r')).filter(|word| !word.is_empty())
}

/// A number, or what is there instead.
pub(super) fn number<T: std::str::FromStr>(word: Option<&[u8]>) -> Result<T, String> {
    let word = word.ok_or_else(|| "the end of the line".to_owned())?;
    std::str::from_utf8(word).ok().and_then(|text| text.parse().ok()).ok_or_else(|| excerpt(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hands out a few bytes at a time.
    struct Drip<'a>(&'a [u8], usize);

    impl Read for Drip<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let count = self.1.min(self.0.len()).min(buffer.len());
            buffer[..count].copy_from_slice(&self.0[..count]);
            self.0 = &self.0[count..];
            Ok(count)
        }
    }

    #[test]
    fn every_line_end_is_one() {
        let text = b"a\nb\r\nc\rd\n\n\r\ne\r";
        for drip in [1, 2, 3, 100] {
            let mut lines = Lines::new(Drip(text, drip));
            let mut seen = Vec::new();
            while lines.advance().unwrap() {
                let place = lines.place("line", 0);
                seen.push((
                    String::from_utf8_lossy(lines.current()).into_owned(),
                    place.line.unwrap(),
                    place.offset,
                ));
            }
            let expected =
                [("a", 1, 0), ("b", 2, 2), ("c", 3, 5), ("d", 4, 7), ("", 5, 9), ("", 6, 10), ("e", 7, 12)];
            assert_eq!(seen, expected.map(|(text, line, offset)| (text.to_owned(), line, offset)), "{drip}");
        }
    }

    #[test]
    fn lines_cross_windows_and_must_fit_one() {
        let long = [&vec![b'x'; WINDOW - 1][..], b"\n", &vec![b'y'; WINDOW - 5], b"\nz"].concat();
        let mut lines = Lines::new(&long[..]);
        let mut lengths = Vec::new();
        while lines.advance().unwrap() {
            lengths.push(lines.current().len());
        }
        assert_eq!(lengths, [WINDOW - 1, WINDOW - 5, 1]);
        let endless = [b"ok\n", &vec![b'x'; WINDOW + 1][..]].concat();
        let mut lines = Lines::new(&endless[..]);
        assert!(lines.advance().unwrap());
        assert!(matches!(lines.advance(), Err(ImportError::LineTooLong { line: 2, .. })));
    }
}
