//! Text that people read, as it goes to standard output and standard error: what a terminal would take for a command is spelled out.
//!
//! Names of files, comments and metadata are foreign. An escape sequence in them could move the cursor, change the title or the clipboard, and marks of
//! direction could show a name as another one. Here is where all text comes by, so nobody who writes it has to think of that.

use std::borrow::Cow;
use std::io::{self, Write};

/// Whether a terminal does something else than showing it: control characters of both blocks, separators of lines, marks of direction. Ends of
/// lines and tabs are what text is made of.
fn is_command(c: char) -> bool {
    match c {
        '\n' | '\t' => false,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => true,
        c => c.is_control(),
    }
}

fn spelled(text: &str, is_command: impl Fn(char) -> bool) -> Cow<'_, str> {
    // Nearly all text is made of such bytes.
    fn is_plain(byte: &u8) -> bool {
        matches!(byte, b' '..=b'~' | b'\n')
    }
    if text.as_bytes().iter().all(is_plain) && !(is_command('\n') && text.contains('\n'))
        || !text.contains(&is_command)
    {
        return Cow::Borrowed(text);
    }
    let mut told = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match is_command(c) {
            // As JSON spells it, in which the same text can be.
            true => told.push_str(&format!("\\u{:04x}", u32::from(c))),
            false => told.push(c),
        }
    }
    Cow::Owned(told)
}

/// The text without commands.
pub(crate) fn escaped(text: &str) -> Cow<'_, str> {
    spelled(text, is_command)
}

/// The same for foreign text that is part of a line: it cannot begin one of its own.
pub(crate) fn in_line(text: &str) -> Cow<'_, str> {
    spelled(text, |c| is_command(c) || matches!(c, '\n' | '\t'))
}

/// Writes text without commands. JSON that goes through it means what it did, since a string of JSON may spell out any character in this way.
pub(crate) struct Escaped<W>(pub(crate) W);

impl<W: Write> Write for Escaped<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for chunk in bytes.utf8_chunks() {
            self.0.write_all(escaped(chunk.valid()).as_bytes())?;
            if !chunk.invalid().is_empty() {
                self.0.write_all("\u{fffd}".as_bytes())?;
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_command_gets_through_and_all_else_does() {
        let bad = "\u{1b}]0;title\u{7} \u{9b}31m \r\0\u{8}\u{7f} \u{202e}ylp.\u{2066}\u{2028}\u{200f}\u{61c}";
        let told = escaped(bad);
        assert!(told.starts_with("\\u001b]0;title\\u0007 \\u009b31m \\u000d\\u0000"), "{told}");
        assert!(!told.contains(is_command) && told.is_ascii(), "{told}");
        for good in ["a plain line\n", "tabs\tin\tit", "naïve Büste, 模型 🐇 – ¿x?", ""] {
            assert!(matches!(escaped(good), Cow::Borrowed(told) if told == good), "{good}");
        }
        assert_eq!(in_line("a\nerror: b\tc"), "a\\u000aerror: b\\u0009c");
    }

    #[test]
    fn json_means_the_same_afterwards() {
        let value = serde_json::json!({ "name": "\u{1b}[2J \\u001b \u{9d}\u{202e} \u{7f}\n\"ü\"" });
        let mut out = Escaped(Vec::new());
        write!(out, "{value:#}").unwrap();
        assert!(!String::from_utf8_lossy(&out.0).contains(is_command));
        assert_eq!(serde_json::from_slice::<serde_json::Value>(&out.0).unwrap(), value);
    }
}
