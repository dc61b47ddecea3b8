//! An image of a source: a file beside it, or a stretch of its own bytes.

use crate::supply::Supply;
use chpm_extmem::platform::read_exact_at;
use chpm_texture::{Alpha, OpenedImage};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes that are read at once.
const BLOCK: usize = 1 << 16;

/// Where the bytes of an image are.
#[derive(Clone, Debug)]
pub struct Image {
    /// Name for messages.
    pub name: String,
    place: Place,
    alpha: Alpha,
}

#[derive(Clone, Debug)]
enum Place {
    File(PathBuf),
    /// Of a file that is opened when it is looked at: many tiles have one each.
    Part {
        path: PathBuf,
        start: u64,
        len: u64,
    },
    /// Of one without a name.
    Stretch {
        file: Arc<File>,
        start: u64,
        len: u64,
    },
}

impl Image {
    pub(crate) fn file(path: PathBuf, alpha: Alpha) -> Image {
        Image { name: path.display().to_string(), place: Place::File(path), alpha }
    }

    pub(crate) fn part(name: String, path: PathBuf, (start, len): (u64, u64), alpha: Alpha) -> Image {
        Image { name, place: Place::Part { path, start, len }, alpha }
    }

    pub(crate) fn stretch(name: String, file: Arc<File>, (start, len): (u64, u64), alpha: Alpha) -> Image {
        Image { name, place: Place::Stretch { file, start, len }, alpha }
    }

    /// The file, if it is one of its own.
    pub(crate) fn path(&self) -> Option<&Path> {
        match &self.place {
            Place::File(path) => Some(path),
            Place::Part { .. } | Place::Stretch { .. } => None,
        }
    }

    /// Opens the image at its first byte.
    ///
    /// # Errors
    /// Those of opening a file, which may have become something else.
    pub fn open(&self) -> io::Result<OpenedImage> {
        let bytes: Box<dyn Read + Send> = match &self.place {
            Place::File(path) => Box::new(Supply::file(path).map_err(io::Error::other)?.open()?),
            Place::Part { path, start, len } => {
                let file = Supply::file(path).map_err(io::Error::other)?.open()?;
                Box::new(Stretch { file: Arc::new(file), next: *start, end: start + len })
            }
            Place::Stretch { file, start, len } => {
                Box::new(Stretch { file: Arc::clone(file), next: *start, end: start + len })
            }
        };
        let bytes = Box::new(BufReader::with_capacity(BLOCK, bytes));
        Ok(OpenedImage { bytes, alpha: self.alpha })
    }

    /// Whether it begins as those do that are read.
    pub(crate) fn is_of_known_kind(&self) -> io::Result<bool> {
        let mut head = Vec::new();
        self.open()?.bytes.take(8).read_to_end(&mut head)?;
        Ok(MAGICS.iter().any(|magic| head.starts_with(magic)))
    }
}

/// First bytes of PNG and JPEG.
const MAGICS: [&[u8]; 2] = [b"\x89PNG", b"\xff\xd8\xff"];

/// Bytes of a file that others read elsewhere.
struct Stretch {
    file: Arc<File>,
    next: u64,
    end: u64,
}

impl Read for Stretch {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = (self.end - self.next).min(out.len() as u64) as usize;
        read_exact_at(&self.file, &mut out[..count], self.next)?;
        self.next += count as u64;
        Ok(count)
    }
}
