//! The container of a glTF: JSON, by itself or as a chunk of a GLB, and the data that is in it or behind it.

use super::document::refused;
use crate::error::ImportError;
use crate::location::SourceLocation;
use std::io::{self, BufReader, Read};

/// Bytes that the JSON may have besides the data in it.
const LIMIT: usize = 64 << 20;

/// The JSON of a glTF, with `data:N` in place of its data URI number N.
pub(super) struct Text {
    pub(super) json: Vec<u8>,
    pub(super) payloads: Vec<Payload>,
    /// Where the data of a GLB begins, and its length.
    pub(super) binary: Option<(u64, u64)>,
}

/// A data URI: where its bytes are among those of all, and whether they are valid.
pub(super) struct Payload {
    pub(super) start: u64,
    pub(super) len: u64,
    pub(super) is_valid: bool,
}

/// Reads the container from the front of `stream` up to the data of a GLB; bytes of data URIs go to `sink`.
pub(super) fn read(
    stream: &mut dyn Read,
    is_glb: bool,
    sink: &mut dyn FnMut(&[u8]) -> Result<(), ImportError>,
) -> Result<Text, ImportError> {
    if !is_glb {
        let text = Scanner::scan(stream, 0, sink)?;
        return Ok(Text { json: text.json, payloads: text.payloads, binary: None });
    }
    let mut header = [0; 20];
    exact(stream, &mut header, 0)?;
    let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    if word(4) != 2 {
        return Err(refused(format!("GLB version {} is not read: save it as glTF 2.0", word(4))));
    }
    if header[16..] != *b"JSON" {
        return Err(refused("the first chunk of this GLB is no JSON"));
    }

    let len = u64::from(word(12));
    let text = Scanner::scan(&mut stream.take(len), 20, sink)?;
    if text.read < len {
        let place =
            SourceLocation { element: "chunk".to_owned(), index: 0, offset: 20 + text.read, line: None };
        return Err(ImportError::Truncated { place, expected: format!("{} bytes more", len - text.read) });
    }
    // Another chunk may come, which is data if it says so.
    let mut chunk = [0; 8];
    let mut binary = None;
    if exact(stream, &mut chunk, 20 + len).is_ok() && chunk[4..] == *b"BIN\0" {
        let binary_len = u32::from_le_bytes([chunk[0], chunk[1], chunk[2], chunk[3]]);
        binary = Some((28 + len, u64::from(binary_len)));
    }
    Ok(Text { json: text.json, payloads: text.payloads, binary })
}

fn exact(stream: &mut dyn Read, bytes: &mut [u8], offset: u64) -> Result<(), ImportError> {
    stream.read_exact(bytes).map_err(|source| match source.kind() {
        io::ErrorKind::UnexpectedEof => {
            let place = SourceLocation { element: "header".to_owned(), index: 0, offset, line: None };
            ImportError::Truncated { place, expected: format!("{} bytes", bytes.len()) }
        }
        _ => ImportError::Read { offset, source },
    })
}

/// Goes through JSON and takes out the bytes of data URIs.
struct Scanner<'a> {
    json: Vec<u8>,
    payloads: Vec<Payload>,
    state: State,
    base64: Base64,
    /// Bytes of all data URIs up to now.
    written: u64,
    read: u64,
    sink: &'a mut dyn FnMut(&[u8]) -> Result<(), ImportError>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Outside,
    /// In a string that begins at this byte of the text.
    Inside(usize),
    /// Behind a backslash in a string.
    Escaped(usize),
    /// In the bytes of a data URI, and behind a backslash there.
    Data,
    DataEscaped,
}

impl Scanner<'_> {
    fn scan<'a>(
        stream: &mut dyn Read,
        offset: u64,
        sink: &'a mut dyn FnMut(&[u8]) -> Result<(), ImportError>,
    ) -> Result<Scanner<'a>, ImportError> {
        let mut scanner = Scanner {
            json: Vec::new(),
            payloads: Vec::new(),
            state: State::Outside,
            base64: Base64::default(),
            written: 0,
            read: 0,
            sink,
        };

        let mut block = vec![0; 1 << 16];
        let mut stream = BufReader::with_capacity(0, stream);
        loop {
            let count = match stream.read(&mut block) {
                Ok(0) => break,
                Ok(count) => count.min(block.len()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(source) => return Err(ImportError::Read { offset: offset + scanner.read, source }),
            };
            scanner.read += count as u64;
            for byte in &block[..count] {
                scanner.take(*byte)?;
            }
            if scanner.json.len() > LIMIT {
                let limit = LIMIT >> 20;
                return Err(refused(format!("its JSON is longer than {limit} MiB, without the data in it")));
            }
        }

        if let Some(mark) = scanner.json.strip_prefix(b"\xef\xbb\xbf") {
            scanner.json = mark.to_vec();
        }
        Ok(scanner)
    }

    fn take(&mut self, byte: u8) -> Result<(), ImportError> {
        match self.state {
            State::Data if byte == b'"' => {
                self.end_data()?;
                self.json.push(byte);
                self.state = State::Outside;
                return Ok(());
            }
            State::Data if byte == b'\\' => {
                self.state = State::DataEscaped;
                return Ok(());
            }
            State::Data | State::DataEscaped => {
                // Of what may be written so, only a slash is part of data.
                self.base64.is_valid &= self.state == State::Data || byte == b'/';
                self.state = State::Data;
                return self.data(byte);
            }
            State::Outside if byte == b'"' => self.state = State::Inside(self.json.len() + 1),
            State::Outside => {}
            State::Inside(_) if byte == b'"' => self.state = State::Outside,
            State::Inside(start) if byte == b'\\' => self.state = State::Escaped(start),
            State::Inside(start) if byte == b',' && self.json[start..].starts_with(b"data:") => {
                let is_base64 = self.json.ends_with(b";base64");
                self.json.truncate(start);
                self.json.extend(format!("data:{}", self.payloads.len()).bytes());
                self.payloads.push(Payload { start: self.written, len: 0, is_valid: false });
                self.base64 = Base64 { is_valid: is_base64, ..Base64::default() };
                self.state = State::Data;
                return Ok(());
            }
            State::Inside(_) => {}
            State::Escaped(start) => self.state = State::Inside(start),
        }
        self.json.push(byte);
        Ok(())
    }

    fn data(&mut self, byte: u8) -> Result<(), ImportError> {
        self.base64.take(byte);
        if self.base64.out.len() >= 1 << 16 { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), ImportError> {
        self.written += self.base64.out.len() as u64;
        (self.sink)(&self.base64.out)?;
        self.base64.out.clear();
        Ok(())
    }

    fn end_data(&mut self) -> Result<(), ImportError> {
        self.base64.end();
        self.flush()?;
        if let Some(payload) = self.payloads.last_mut() {
            payload.len = self.written - payload.start;
            payload.is_valid = self.base64.is_valid;
        }
        Ok(())
    }
}

/// Base64 that comes letter by letter.
#[derive(Default)]
struct Base64 {
    bits: u32,
    letters: u32,
    padding: u32,
    is_valid: bool,
    out: Vec<u8>,
}

impl Base64 {
    fn take(&mut self, byte: u8) {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => {
                self.padding += 1;
                return;
            }
            _ => {
                self.is_valid = false;
                return;
            }
        };
        self.is_valid &= self.padding == 0;
        self.bits = self.bits << 6 | u32::from(value);
        self.letters += 1;
        if self.letters == 4 {
            self.out.extend(&self.bits.to_be_bytes()[1..]);
            (self.bits, self.letters) = (0, 0);
        }
    }

    /// Puts out what is left of a group of four letters.
    fn end(&mut self) {
        self.is_valid &= self.padding <= 2 && self.letters != 1;
        let bytes = (self.bits << (6 * (4 - self.letters.min(4)))).to_be_bytes();
        match self.letters {
            2 => self.out.push(bytes[1]),
            3 => self.out.extend(&bytes[1..3]),
            _ => {}
        }
    }
}
