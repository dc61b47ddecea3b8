//! Numbers as text, separated by any white space.
//!
//! An element may go on over several lines, as some writers break long lists, but it must begin on a new one: that
//! is what tells a header that promises wrong numbers from a body that happens to make sense.

use super::{error::Fault, header::ScalarType, source::Source};
use crate::location::excerpt;
use std::{io::Read, str::FromStr};

/// Longer than any double in full decimal notation.
const MAX_TOKEN: usize = 512;

fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

impl<R: Read> Source<R> {
    /// Goes to the next byte that is no white space; false if there is none.
    pub(super) fn skip_space(&mut self) -> std::io::Result<bool> {
        loop {
            let (mut skipped, mut line, mut after_return) = (0, self.line, self.after_return);
            for &byte in self.bytes() {
                if !is_space(byte) {
                    break;
                }
                line += u64::from(byte == b'\r' || byte == b'\n' && !after_return);
                after_return = byte == b'\r';
                skipped += 1;
            }
            (self.line, self.after_return) = (line, after_return);
            self.consume(skipped);
            if !self.bytes().is_empty() {
                return Ok(true);
            }
            if !self.more()? {
                return Ok(false);
            }
        }
    }

    /// Goes to the next element, which must be on another line than the last word.
    pub(super) fn begin_line(&mut self) -> Result<(), Fault> {
        if !self.skip_space()? || self.line > self.word_line {
            return Ok(());
        }
        Err(Fault::LineGoesOn(excerpt(self.token()?)))
    }

    /// The next word.
    pub(super) fn token(&mut self) -> Result<&[u8], Fault> {
        if !self.skip_space()? {
            return Err(Fault::End);
        }
        self.mark = self.offset();
        self.word_line = self.line;
        self.after_return = false;

        let mut length = 0;
        loop {
            let rest = &self.bytes()[length..];
            match rest.iter().position(|&byte| is_space(byte)) {
                Some(more) => {
                    length += more;
                    break;
                }
                None => length += rest.len(),
            }
            if length > MAX_TOKEN || !self.more()? {
                break;
            }
        }

        if length > MAX_TOKEN {
            return Err(Fault::Number { expected: "a number", got: excerpt(self.bytes()) });
        }
        self.consume(length);
        Ok(self.consumed(length))
    }

    pub(super) fn text_scalar(&mut self, ty: ScalarType) -> Result<f64, Fault> {
        let Some((low, high)) = ty.range() else {
            let single = ty == ScalarType::Float;
            let token = self.token()?;
            // Text is rounded once, to the type of the property.
            let value = if single { parse::<f32>(token).map(f64::from) } else { parse::<f64>(token) };
            return value
                .or_else(|| odd_nan(token))
                .ok_or_else(|| Fault::Number { expected: "a number", got: excerpt(token) });
        };
        let token = self.token()?;
        match integer(token) {
            Some(value) if (low..=high).contains(&value) => Ok(value as f64),
            _ => Err(Fault::Number { expected: ty.expectation(), got: excerpt(token) }),
        }
    }

    pub(super) fn text_integer(&mut self) -> Result<i64, Fault> {
        let token = self.token()?;
        integer(token).ok_or_else(|| Fault::Number { expected: "a whole number", got: excerpt(token) })
    }
}

fn parse<T: FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// Digits with an optional sign, of which at most 18: more would not fit, and no index is that long.
fn integer(token: &[u8]) -> Option<i64> {
    let (negative, digits) = match token {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    if digits.is_empty() || digits.len() > 18 {
        return None;
    }
    let mut value = 0;
    for &byte in digits {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            return None;
        }
        value = value * 10 + i64::from(digit);
    }
    Some(if negative { -value } else { value })
}

/// Value of a non-finite number as C runtimes print it: `-nan(ind)`, `1.#QNAN`.
fn odd_nan(token: &[u8]) -> Option<f64> {
    let unsigned = token.strip_prefix(b"-").unwrap_or(token);
    let odd =
        unsigned.starts_with(b"1.#") || unsigned.get(..4).is_some_and(|t| t.eq_ignore_ascii_case(b"nan("));
    odd.then_some(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_strict() {
        for (text, value) in [("0", 0), ("-1", -1), ("+7", 7), ("007", 7), ("4294967296", 1 << 32)] {
            assert_eq!(integer(text.as_bytes()), Some(value), "{text}");
        }
        for text in ["", "-", "+", "1.0", "1e3", "0x10", "--1", "1234567890123456789", "9/"] {
            assert_eq!(integer(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn lines_are_counted_for_every_line_end() {
        let mut source = Source::new(&b"a\nb\r\nc\rd\n\re\r\r\nf"[..]);
        let mut lines = Vec::new();
        while let Ok(token) = source.token() {
            let token = token.to_vec();
            lines.push((String::from_utf8(token).unwrap(), source.line, source.mark));
        }
        let expected = [("a", 1, 0), ("b", 2, 2), ("c", 3, 5), ("d", 4, 7), ("e", 6, 10), ("f", 8, 14)];
        assert_eq!(lines, expected.map(|(text, line, mark)| (text.to_owned(), line, mark)));
    }

    #[test]
    fn what_is_not_finite_is_a_number_all_the_same() {
        for text in
            ["nan", "-nan", "NaN", "inf", "-Infinity", "1.#QNAN", "-1.#IND", "nan(ind)", "-NaN(snan)", "1e99"]
        {
            let value = Source::new(text.as_bytes()).text_scalar(ScalarType::Float).unwrap();
            assert!(!value.is_finite(), "{text}");
        }
        for text in ["1,5", "0x1p3", "na", "#", "1..2", "\u{e9}"] {
            assert!(Source::new(text.as_bytes()).text_scalar(ScalarType::Double).is_err(), "{text}");
        }
    }

    #[test]
    fn a_word_may_lie_across_blocks() {
        let mut text = vec![b' '; super::super::source::BLOCK - 3];
        text.extend(b"123456 7");
        let mut source = Source::new(&text[..]);
        assert_eq!(source.text_integer().unwrap(), 123456);
        assert_eq!(source.text_integer().unwrap(), 7);
        assert!(matches!(source.text_integer(), Err(Fault::End)));
        let endless = vec![b'1'; 10_000];
        assert!(matches!(Source::new(&endless[..]).token(), Err(Fault::Number { .. })));
    }
}
