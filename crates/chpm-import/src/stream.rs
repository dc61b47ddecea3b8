//! The bytes of a source: hashed as they are in the file, then decompressed if they are compressed.
//!
//! Before and behind decompression every read looks at whether to stop first, so that no reader has to: what it does between
//! two reads is bounded by its window.

use crate::stl;
use crate::supply::Supply;
use chpm_extmem::{Cancel, FailPoints};
use std::fmt;
use std::io::{self, BufReader, Cursor, Read};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use xxhash_rust::xxh3::Xxh3;

/// Bytes of a compressed file that are read at once.
const BLOCK: usize = 1 << 18;
/// Largest window of a zstd frame, by zstd's own limit: what is granted below that can be raised by more memory.
const ZSTD_WINDOW: u64 = 1 << 31;
/// Least window that is always granted; what the usual levels take.
const ZSTD_LEAST: u64 = 1 << 23;

/// Bytes of a file that tell whether it is compressed: the header of a binary STL, which may begin like such a file.
const PACKED_HEAD: usize = 84;

/// Decompressed bytes.
pub type Stream = Box<dyn Read + Send>;

/// How a file is compressed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Packing {
    None,
    Gzip,
    Zstd,
}

impl Packing {
    /// By the beginning of a file of `len` bytes.
    fn detect(head: &[u8], len: u64) -> Packing {
        match head {
            // Whatever its header begins with.
            _ if stl::is_binary(head, Some(len)) => Packing::None,
            [0x1f, 0x8b, 8, ..] => Packing::Gzip,
            [0x28, 0xb5, 0x2f, 0xfd, ..] => Packing::Zstd,
            // A skippable frame may come first.
            [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..] => Packing::Zstd,
            _ => Packing::None,
        }
    }
}

impl fmt::Display for Packing {
    /// Suffix of an encoding's name.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Packing::None => "",
            Packing::Gzip => ", gzip",
            Packing::Zstd => ", zstd",
        })
    }
}

/// A file that hashes what is read from it. Clones read on where the others stopped.
#[derive(Clone)]
pub(crate) struct Tap(Arc<Mutex<Inner>>);

struct Inner {
    bytes: Stream,
    /// The length of the file.
    file_len: u64,
    hash: Xxh3,
    len: u64,
    fail_points: FailPoints,
    cancel: Cancel,
}

impl Tap {
    pub(crate) fn open(supply: &Supply, fail_points: &FailPoints, cancel: &Cancel) -> io::Result<Tap> {
        fail_points.access()?;
        Ok(Tap::of(Box::new(supply.open()?), supply.len(), fail_points, cancel))
    }

    pub(crate) fn of(bytes: Stream, file_len: u64, fail_points: &FailPoints, cancel: &Cancel) -> Tap {
        let (fail_points, cancel) = (fail_points.clone(), cancel.clone());
        Tap(Arc::new(Mutex::new(Inner { bytes, file_len, hash: Xxh3::new(), len: 0, fail_points, cancel })))
    }

    /// Bytes read up to now.
    pub(crate) fn len(&self) -> u64 {
        self.inner().len
    }

    /// Nobody waits here: clones are of one thread, whichever it is.
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads what is left, and answers the length and the hash of the whole.
    pub(crate) fn finish(mut self) -> io::Result<(u64, u64)> {
        io::copy(&mut self, &mut io::sink())?;
        let inner = self.inner();
        Ok((inner.len, inner.hash.digest()))
    }
}

impl Read for Tap {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let inner = &mut *self.inner();
        heed(&inner.cancel)?;
        inner.fail_points.access()?;
        let count = inner.bytes.read(buffer)?;
        inner.hash.update(&buffer[..count]);
        inner.len += count as u64;
        Ok(count)
    }
}

/// Watched output of a decompressor. A few bytes of a file may become gigabytes there.
struct Watched<R> {
    stream: R,
    cancel: Cancel,
}

impl<R: Read> Read for Watched<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        heed(&self.cancel)?;
        self.stream.read(buffer)
    }
}

/// Ends the reading if that was asked for; whoever sees the error looks at `cancel` for why.
fn heed(cancel: &Cancel) -> io::Result<()> {
    if cancel.is_cancelled() { Err(io::Error::other("stopped on request")) } else { Ok(()) }
}

/// A stream and what is known of it before anything is read.
pub(crate) struct Opened {
    pub(crate) stream: Stream,
    pub(crate) packing: Packing,
    /// The first bytes of the stream, which still come.
    pub(crate) head: Vec<u8>,
    /// Its length, unless it is compressed.
    pub(crate) len: Option<u64>,
    /// Bytes that decompression may have in memory.
    pub(crate) window: u64,
}

/// A gzip stream, of one member or several.
struct Gzip<R> {
    decoder: R,
    has_begun: bool,
}

impl<R: Read> Read for Gzip<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.decoder.read(buffer).map_err(|error| match error.kind() {
            // The library has one code for all of it, and says both of what is none and of what follows that a header is invalid.
            io::ErrorKind::InvalidInput if error.to_string().contains("checksum") => io::Error::other(
                "the checksum of the gzip data does not match, so that it is damaged: copy the file again",
            ),
            io::ErrorKind::InvalidInput if self.has_begun => io::Error::other(
                "the gzip data ends, and what follows it is none: unpack it with gzip, which passes over that, or copy the file again",
            ),
            _ => error,
        })?;
        self.has_begun |= read > 0;
        Ok(read)
    }
}

/// A zstd stream whose window is limited.
struct Zstd<R> {
    decoder: R,
    window: u64,
}

impl<R: Read> Read for Zstd<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.decoder.read(buffer).map_err(|error| {
            // The library has a code for this, and its Rust face only the text.
            if !error.to_string().contains("too much memory") {
                return error;
            }
            let window = self.window >> 20;
            io::Error::other(format!(
                "a zstd window of more than {window} MiB, a quarter of the memory for work; raise --memory, or compress with a lower level"
            ))
        })
    }
}

/// Decompresses what `tap` reads, if its first bytes say so, and looks at the `head` first bytes of the result. Decompression may
/// have a quarter of `memory`, and 8 MiB in any case.
pub(crate) fn open(tap: &Tap, head: usize, memory: u64) -> io::Result<Opened> {
    let mut tap = tap.clone();
    let (len, cancel) = {
        let inner = tap.inner();
        (inner.file_len, inner.cancel.clone())
    };
    let start = begin(&mut tap, PACKED_HEAD)?;
    let packing = Packing::detect(&start, len);
    let bytes = Cursor::new(start).chain(tap);

    let mut window = 0;
    let mut stream: Stream = match packing {
        Packing::None => Box::new(bytes),
        Packing::Gzip => {
            let decoder = flate2::bufread::MultiGzDecoder::new(BufReader::with_capacity(BLOCK, bytes));
            Box::new(Gzip { decoder, has_begun: false })
        }
        Packing::Zstd => {
            let mut decoder =
                zstd::stream::read::Decoder::with_buffer(BufReader::with_capacity(BLOCK, bytes))?;
            let log = (memory / 4).clamp(ZSTD_LEAST, ZSTD_WINDOW).ilog2();
            decoder.window_log_max(log)?;
            window = 1 << log;
            Box::new(Zstd { decoder, window })
        }
    };

    let head = begin(&mut stream, head)?;
    let stream = Box::new(Watched { stream: Cursor::new(head.clone()).chain(stream), cancel });
    Ok(Opened { stream, packing, head, len: Some(len).filter(|_| packing == Packing::None), window })
}

/// The first `len` bytes, or fewer at the end.
fn begin(reader: &mut impl Read, len: usize) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(len);
    reader.take(len as u64).read_to_end(&mut bytes)?;
    Ok(bytes)
}
