//! Where a source's bytes come from: a file, or a pipe that was read to its end.

use crate::error::SourceError;
use chpm_extmem::platform::{self, Kind};
use chpm_extmem::{Cancel, FailPoints};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// A source under its name.
pub struct Supply {
    /// Where it is, or the pipe.
    pub path: PathBuf,
    /// Copy of a pipe's bytes; none if the path is a file.
    spooled: Option<File>,
}

impl Supply {
    /// The file at `path`.
    ///
    /// # Errors
    /// [`SourceError::NotAFile`] for what is none, [`SourceError::Read`] if it is not there.
    pub fn file(path: &Path) -> Result<Supply, SourceError> {
        let kind = kind(path)?;
        if kind != Kind::File {
            let (path, what) = (path.to_owned(), name(kind));
            return Err(SourceError::NotAFile { path, what });
        }
        Ok(Supply { path: path.to_owned(), spooled: None })
    }

    /// Like [`Supply::file`]; what comes through a pipe is copied to a file without a name in `folder` first.
    ///
    /// # Errors
    /// As [`Supply::file`]; also [`SourceError::Cancelled`], and those of the disk.
    pub fn take(
        path: &Path,
        folder: &Path,
        fail_points: &FailPoints,
        cancel: &Cancel,
    ) -> Result<Supply, SourceError> {
        if kind(path)? != Kind::Pipe {
            return Supply::file(path);
        }
        let received = chpm_extmem::receive(path, folder, fail_points, || cancel.is_cancelled())?;
        Ok(Supply { path: path.to_owned(), spooled: Some(received.ok_or(SourceError::Cancelled)?) })
    }

    /// Content of an open file, under a name.
    pub fn opened(name: &Path, file: File) -> Supply {
        Supply { path: name.to_owned(), spooled: Some(file) }
    }

    /// Whether the bytes came through a pipe, so that another run cannot have them.
    pub fn is_spooled(&self) -> bool {
        self.spooled.is_some()
    }

    /// The bytes from their beginning. What was spooled is handed out to one reader after the other.
    pub fn open(&self) -> io::Result<File> {
        match &self.spooled {
            None => File::open(&self.path),
            Some(file) => {
                let mut file = file.try_clone()?;
                io::Seek::rewind(&mut file)?;
                Ok(file)
            }
        }
    }

    /// Whether there are no bytes, as far as the system tells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of the file, where the system tells.
    pub fn len(&self) -> u64 {
        let found = self.spooled.as_ref().map_or_else(|| fs::metadata(&self.path), File::metadata);
        found.map_or(0, |metadata| metadata.len())
    }
}

fn kind(path: &Path) -> Result<Kind, SourceError> {
    platform::kind_at(path).map_err(|source| SourceError::Read { path: path.to_owned(), source })
}

fn name(kind: Kind) -> &'static str {
    match kind {
        Kind::Folder => "a folder",
        Kind::Pipe => "a pipe",
        Kind::Terminal => "a terminal or device",
        Kind::Blocks => "a device",
        Kind::File | Kind::Socket | Kind::Other => "a socket",
    }
}
