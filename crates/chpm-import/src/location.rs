//! Where in a source something is, as errors tell it.

use std::fmt;

/// Where in the body of a file a value is.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SourceLocation {
    /// Name of the element, such as `face`.
    pub element: String,
    /// Which one of these elements, from 0.
    pub index: u64,
    /// Offset in bytes of the value from the start of the file.
    pub offset: u64,
    /// Line of the value from 1, in ASCII files.
    pub line: Option<u64>,
}

impl fmt::Display for SourceLocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}, byte {}", self.element, self.index, self.offset)?;
        self.line.map_or(Ok(()), |line| write!(f, ", line {line}"))
    }
}

/// Hostile bytes as a short text that is safe to print.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    const SHOWN: usize = 60;
    let shown = bytes[..bytes.len().min(SHOWN)].escape_ascii();
    if bytes.len() > SHOWN { format!("{shown}...") } else { shown.to_string() }
}
