//! A source from its first byte to its last: unpacked, taken number by number or word by word, with the place for errors.

use anyhow::{Context, Error, Result, anyhow, bail};
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that are looked at to tell formats apart.
const HEAD: usize = 4096;
/// Bytes of a binary STL before its facets, the last four of which count them.
const STL_HEADER: usize = 84;
/// First bytes of gzip and zstd.
const PACKED: [&[u8]; 2] = [&[0x1f, 0x8b, 8], &[0x28, 0xb5, 0x2f, 0xfd]];
/// A line, or a word, that is longer is damage.
const LONGEST: usize = 1 << 20;
/// The window that zstd may have in any case, bytes.
const LEAST_WINDOW: u64 = 8 << 20;

/// Stream of a source's bytes.
pub(super) struct Stream {
    path: PathBuf,
    reader: BufReader<Box<dyn Read>>,
    /// Bytes behind us, unpacked.
    offset: u64,
    /// Line ends behind us, where lines or words are read.
    lines: u64,
    /// Whether the last byte was a carriage return: a line feed after it ends no other line.
    after_return: bool,
    word: Vec<u8>,
}

/// A stream and what it begins with.
pub(super) struct Opened {
    pub(super) stream: Stream,
    pub(super) head: Vec<u8>,
    /// Its length, if the file is not packed.
    pub(super) len: Option<u64>,
    /// Bytes that unpacking may have in memory.
    pub(super) window: u64,
}

impl Stream {
    /// Opens a file; unpacking may have a quarter of `memory`. Its bytes are added to those that were `read`.
    pub(super) fn open(path: &Path, memory: u64, read: Arc<AtomicU64>) -> Result<Opened> {
        let told = || format!("cannot read '{}'", path.display());
        let file = File::open(path).with_context(told)?;
        let len = file.metadata().ok().filter(std::fs::Metadata::is_file).map(|metadata| metadata.len());
        let mut file = Counted { file, read };
        let start = first(&mut file, STL_HEADER).with_context(told)?;
        // The header of an STL may begin with anything: its length tells.
        let is_stl = start.len() == STL_HEADER && len.is_some_and(|len| len == stl_len(&start));
        // A zstd file may begin with a frame that is to be skipped.
        let skips = matches!(start[..], [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..]);
        let is_packed = !is_stl && (skips || PACKED.iter().any(|magic| start.starts_with(magic)));
        let packed = BufReader::with_capacity(1 << 16, Cursor::new(start.clone()).chain(file));
        let mut window = 0;
        let mut plain: Box<dyn Read> = match start[..] {
            _ if !is_packed => Box::new(packed),
            [0x1f, ..] => Box::new(flate2::bufread::MultiGzDecoder::new(packed)),
            _ => {
                let mut decoder = zstd::stream::read::Decoder::with_buffer(packed).with_context(told)?;
                let log = (memory / 4).max(LEAST_WINDOW).ilog2().min(31);
                decoder.window_log_max(log).with_context(told)?;
                window = 1 << log;
                Box::new(decoder)
            }
        };
        let head = first(&mut plain, HEAD).with_context(told)?;
        let all: Box<dyn Read> = Box::new(Cursor::new(head.clone()).chain(plain));
        let stream = Stream {
            path: path.to_owned(),
            reader: BufReader::with_capacity(1 << 16, all),
            offset: 0,
            lines: 0,
            after_return: false,
            word: Vec::new(),
        };
        Ok(Opened { stream, head, len: len.filter(|_| !is_packed), window })
    }

    /// An error here.
    pub(super) fn wrong(&self, what: impl std::fmt::Display) -> Error {
        let path = self.path.display();
        match self.lines {
            0 => anyhow!("'{path}', before byte {}: {what}", self.offset),
            lines => anyhow!("'{path}', line {}: {what}", lines + 1),
        }
    }

    fn buffered(&mut self) -> Result<&[u8]> {
        let path = &self.path;
        self.reader.fill_buf().with_context(|| format!("cannot read '{}'", path.display()))
    }

    fn consume(&mut self, count: usize) {
        self.reader.consume(count);
        self.offset += count as u64;
    }

    /// The next `N` bytes; none where fewer are left.
    pub(super) fn take<const N: usize>(&mut self) -> Result<Option<[u8; N]>> {
        let mut bytes = [0; N];
        if let Some(here) = self.reader.buffer().get(..N) {
            bytes.copy_from_slice(here);
            self.consume(N);
            return Ok(Some(bytes));
        }
        let mut len = 0;
        while len < N {
            let here = self.buffered()?;
            let count = here.len().min(N - len);
            if count == 0 {
                return Ok(None);
            }
            bytes[len..len + count].copy_from_slice(&here[..count]);
            len += count;
            self.consume(count);
        }
        Ok(Some(bytes))
    }

    /// The next byte, which stays.
    pub(super) fn peek(&mut self) -> Result<Option<u8>> {
        Ok(self.buffered()?.first().copied())
    }

    /// Whether the last line ended in a carriage return.
    pub(super) fn ends_in_return(&self) -> bool {
        self.after_return
    }

    /// Skips bytes; false where fewer are left.
    pub(super) fn skip(&mut self, mut count: u64) -> Result<bool> {
        while count > 0 {
            let here = (self.buffered()?.len() as u64).min(count);
            if here == 0 {
                return Ok(false);
            }
            self.consume(here as usize);
            count -= here;
        }
        Ok(true)
    }

    /// Replaces `line` by the next line, up to a byte that ends one; false at the end of the source.
    pub(super) fn line_to(&mut self, is_end: impl Fn(u8) -> bool, line: &mut Vec<u8>) -> Result<bool> {
        line.clear();
        loop {
            let here = self.buffered()?;
            if here.is_empty() {
                return Ok(!line.is_empty());
            }
            let found = here.iter().position(|byte| is_end(*byte));
            line.extend_from_slice(&here[..found.unwrap_or(here.len())]);
            let count = found.map_or(here.len(), |at| at + 1);
            self.after_return = found.is_some_and(|at| here[at] == b'\r');
            self.consume(count);
            if line.len() > LONGEST {
                bail!(self.wrong("a line of more than a megabyte"));
            }
            if found.is_some() {
                self.lines += 1;
                return Ok(true);
            }
        }
    }

    /// Like [`Self::line_to`], for lines that end in LF, CRLF or CR.
    pub(super) fn line(&mut self, line: &mut Vec<u8>) -> Result<bool> {
        if self.after_return && self.buffered()?.first() == Some(&b'\n') {
            self.consume(1);
        }
        self.line_to(|byte| matches!(byte, b'\n' | b'\r'), line)
    }

    /// The next word of a text; none at the end.
    pub(super) fn word(&mut self) -> Result<Option<&str>> {
        if !self.pass_word()? {
            return Ok(None);
        }
        match std::str::from_utf8(&self.word) {
            Ok(word) => Ok(Some(word)),
            Err(_) => Err(self.wrong("a word that is no text")),
        }
    }

    /// Goes past the next word, whatever it is; false at the end.
    pub(super) fn pass_word(&mut self) -> Result<bool> {
        self.word.clear();
        loop {
            let here =
                self.reader.fill_buf().with_context(|| format!("cannot read '{}'", self.path.display()))?;
            let blank =
                if self.word.is_empty() { here.iter().take_while(|b| is_blank(**b)).count() } else { 0 };
            let rest = &here[blank..];
            let len = rest.iter().position(|byte| is_blank(*byte)).unwrap_or(rest.len());
            let ends = here[..blank].iter().filter(|byte| **byte == b'\n').count() as u64;
            // What the buffer ends in may go on in the next one.
            let is_whole = here.is_empty() || len < rest.len();
            self.word.extend_from_slice(&rest[..len]);
            self.lines += ends;
            self.consume(blank + len);
            if self.word.len() > LONGEST {
                bail!(self.wrong("a word of more than a megabyte"));
            }
            if is_whole {
                break;
            }
        }
        Ok(!self.word.is_empty())
    }
}

/// A file whose bytes are counted as they come.
struct Counted {
    file: File,
    read: Arc<AtomicU64>,
}

impl Read for Counted {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        let count = self.file.read(bytes)?;
        self.read.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}

fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// How long an STL of this header is.
fn stl_len(header: &[u8]) -> u64 {
    let count = header[STL_HEADER - 4..].iter().rev().fold(0, |count, byte| count << 8 | u64::from(*byte));
    84 + 50 * count
}

fn first(reader: &mut impl Read, len: usize) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader.take(len as u64).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The words of a line, which need not be text.
pub(super) fn raw_words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|byte| is_blank(*byte)).filter(|word| !word.is_empty())
}

/// The words of a line.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &str> {
    raw_words(line).map(text)
}

/// Text of a word; one that is no text is no number and no keyword either.
pub(super) fn text(word: &[u8]) -> &str {
    std::str::from_utf8(word).unwrap_or("\u{fffd}")
}

/// A number, also as C libraries print those that are none.
pub(super) fn real<T: FromStr>(word: &str, none: T) -> Option<T> {
    let plain = word.strip_prefix('-').unwrap_or(word);
    let is_odd = plain.starts_with("1.#") || plain.get(..4).is_some_and(|w| w.eq_ignore_ascii_case("nan("));
    if is_odd { Some(none) } else { word.parse().ok() }
}
