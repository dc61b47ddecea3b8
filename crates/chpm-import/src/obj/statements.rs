//! Statements of an OBJ: lines, each with those that it goes on in.

use crate::error::ImportError;
use crate::lines::{Lines, WINDOW, meaning};
use crate::location::SourceLocation;
use std::io::Read;

/// An OBJ, and the statement that it stands at.
pub(super) struct Joined<R> {
    lines: Lines<R>,
    /// A statement of several lines.
    joined: Vec<u8>,
}

impl<R: Read> Joined<R> {
    pub(super) fn new(reader: R) -> Self {
        Joined { lines: Lines::new(reader), joined: Vec::new() }
    }

    /// Goes to the next statement; false at the end.
    pub(super) fn advance(&mut self) -> Result<bool, ImportError> {
        self.joined.clear();
        if !self.lines.advance()? {
            return Ok(false);
        }
        if !goes_on(self.lines.current()) {
            return Ok(true);
        }
        loop {
            let line = self.lines.current();
            if self.joined.len() + line.len() > WINDOW {
                let line = self.lines.place("statement", 0).line.unwrap_or(0);
                return Err(ImportError::LineTooLong { line, limit: WINDOW });
            }
            let body = line.strip_suffix(b"\\").filter(|_| goes_on(line));
            self.joined.extend_from_slice(body.unwrap_or(line));
            self.joined.push(b' ');
            if body.is_none() || !self.lines.advance()? {
                return Ok(true);
            }
        }
    }

    /// The statement, with the comment behind it: a name may look like one.
    pub(super) fn current(&self) -> &[u8] {
        if self.joined.is_empty() { self.lines.current() } else { &self.joined }
    }

    /// Where the statement ends: in the `index`th `element`.
    pub(super) fn place(&self, element: &str, index: u64) -> SourceLocation {
        self.lines.place(element, index)
    }
}

/// Whether a line ends in the next one: comments end where they are.
pub(super) fn goes_on(line: &[u8]) -> bool {
    meaning(line).last() == Some(&b'\\')
}
