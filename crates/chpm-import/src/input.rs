//! A source of any format, as one stream of batches.

use crate::batch::{Batch, BatchKind};
use crate::error::{ImportError, SourceError};
use crate::foreign::Foreign;
use crate::format::{Format, extension};
use crate::options::Options;
use crate::reader::{MeshReader, Opening, SourceInfo, Start};
use crate::stream::{self, Packing, Tap};
use crate::supply::Supply;
use crate::texture::Images;
use crate::vertex_format::VertexFormat;
use chpm_extmem::{Cancel, FailPoints, Reservation, Store};
use chpm_mesh::Scalar;
use std::io;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// A mesh that is being read, of any of the [`FORMATS`](crate::FORMATS), as it is or compressed by gzip or zstd.
///
/// Content decides what a file is, not its name. A batch, a window of the text and the decompressor's window are in memory; what a
/// format needs besides is asked of the store.
pub struct Input {
    path: PathBuf,
    reader: Box<dyn MeshReader>,
    tap: Tap,
    packing: Packing,
    cancel: Cancel,
    _window: Reservation,
}

impl Input {
    /// Opens the file `path` and reads as much as it takes to know the vertices' format. Whenever `cancel` is set, now or
    /// later, reading ends soon with [`SourceError::Cancelled`].
    ///
    /// # Errors
    /// [`SourceError::Read`], [`SourceError::NotAFile`] or [`SourceError::Import`], naming the file.
    pub fn open(path: &Path, options: Options, store: &Store, cancel: &Cancel) -> Result<Input, SourceError> {
        Self::of(&Supply::file(path)?, options, store, cancel)
    }

    /// Like [`Input::open`].
    ///
    /// # Errors
    /// As [`Input::open`].
    pub fn of(
        supply: &Supply,
        options: Options,
        store: &Store,
        cancel: &Cancel,
    ) -> Result<Input, SourceError> {
        Self::open_as(supply, options, store, true, cancel)
    }

    /// Like [`Input::open`]; a list of scans is only understood where `lists` allows it, and not within another.
    pub(crate) fn open_as(
        supply: &Supply,
        options: Options,
        store: &Store,
        lists: bool,
        cancel: &Cancel,
    ) -> Result<Input, SourceError> {
        let opened = Tap::open(supply, store.workdir.fail_points(), cancel);
        let opened = opened.map_err(|source| SourceError::Read { path: supply.path.clone(), source });
        let input = opened.and_then(|tap| Self::from_tap(supply, tap, options, store, lists, cancel));
        input.map_err(|error| heeded(error, cancel))
    }

    pub(crate) fn from_tap(
        supply: &Supply,
        tap: Tap,
        options: Options,
        store: &Store,
        lists: bool,
        cancel: &Cancel,
    ) -> Result<Input, SourceError> {
        let path = &supply.path;
        let unread = |source| SourceError::Read { path: path.to_owned(), source };
        let opened = stream::open(&tap, Format::HEAD, store.budget.available_for_work()).map_err(unread)?;
        let window = store.budget.reserve_work("the window of a zstd stream", opened.window)?;

        let extension = extension(path);
        let start = Start { head: &opened.head, len: opened.len, extension: extension.as_deref() };
        let format = Format::detect(&start);
        let foreign = Foreign::detect(&start);
        let foreign = foreign.or_else(|| (format.is_list && !lists).then(Foreign::list_in_list));
        if let Some(foreign) = foreign {
            return Err(SourceError::of(path, ImportError::Foreign(foreign)));
        }

        let opening = Opening { stream: opened.stream, start, options, store, cancel, supply };
        let reader = (format.open)(opening).map_err(|error| SourceError::of(path, error))?;
        let (path, packing, cancel) = (path.to_owned(), opened.packing, cancel.clone());
        Ok(Input { path, reader, tap, packing, cancel, _window: window })
    }

    /// Format of the delivered vertices.
    pub fn vertex_format(&self) -> VertexFormat {
        self.reader.format()
    }

    /// The named scalars of the delivered vertices, without their ranges.
    pub fn scalars(&self) -> &[Scalar] {
        self.reader.scalars()
    }

    /// Vertices and faces that a header declares, true or not.
    pub fn declared(&self) -> Option<(u64, u64)> {
        self.reader.declared()
    }

    /// Bytes of the files that are behind us, as they are on disk.
    pub fn bytes_read(&self) -> u64 {
        self.tap.len() + self.reader.bytes_beside()
    }

    /// Refills `batch` with what comes next, as [`MeshReader::next`] does.
    ///
    /// # Errors
    /// What is wrong with the source, and where; or the store's memory and disk.
    pub fn next_batch(&mut self, batch: &mut Batch) -> Result<BatchKind, SourceError> {
        let kind = self.reader.next(batch).map_err(|error| SourceError::of(&self.path, error));
        kind.map_err(|error| heeded(error, &self.cancel))
    }

    /// Reads what lies behind the mesh, which belongs to the file, too; to be called after the last batch.
    ///
    /// # Errors
    /// [`SourceError::Read`].
    pub fn finish(self) -> Result<SourceInfo, SourceError> {
        let (mut info, (len, hash)) = self.finish_apart()?;
        let beside: Vec<u64> = info.beside.iter().map(|file| file.hash).collect();
        info.byte_len = len + info.beside.iter().map(|file| file.len).sum::<u64>();
        info.hash = combine(hash, &beside);
        Ok(info)
    }

    /// Like [`Input::finish`]; length and hash of the file itself are beside those of what it names.
    pub(crate) fn finish_apart(self) -> Result<(SourceInfo, (u64, u64)), SourceError> {
        let Input { path, reader, tap, packing, cancel, .. } = self;
        let mut info = reader.finish().map_err(|error| heeded(SourceError::of(&path, error), &cancel))?;
        info.name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        info.encoding = format!("{}{packing}", info.encoding);

        // The hash is that of the whole file, so that what lies behind the mesh is read, too.
        let unread = |source| heeded(SourceError::Read { path, source }, &cancel);
        Ok((info, tap.finish().map_err(unread)?))
    }
}

/// Reading that was ended on request fails in one way or another; this is why.
fn heeded(error: SourceError, cancel: &Cancel) -> SourceError {
    if cancel.is_cancelled() { SourceError::Cancelled } else { error }
}

/// The files that a source is made of: itself and those that it names, with its images as far as these are asked for.
///
/// # Errors
/// [`SourceError::Read`] or [`SourceError::NotAFile`] if it cannot be read, [`SourceError::Import`] if what it names cannot be told.
pub fn files(path: &Path, images: Images, cancel: &Cancel) -> Result<Vec<PathBuf>, SourceError> {
    files_as(path, images, true, cancel)
}

/// Like [`files`]; what a list names is only looked for where `lists` allows it.
pub(crate) fn files_as(
    path: &Path,
    images: Images,
    lists: bool,
    cancel: &Cancel,
) -> Result<Vec<PathBuf>, SourceError> {
    let opened = Tap::open(&Supply::file(path)?, &FailPoints::default(), cancel)
        // Only the first bytes are unpacked, and a window is not filled.
        .and_then(|tap| stream::open(&tap, Format::HEAD, u64::MAX))
        .map_err(|source| heeded(SourceError::Read { path: path.to_owned(), source }, cancel))?;
    let extension = extension(path);
    let start = Start { head: &opened.head, len: opened.len, extension: extension.as_deref() };
    let mut files = vec![path.to_owned()];
    let format = Format::detect(&start);
    if let Some(names) = format.names.filter(|_| lists || !format.is_list) {
        let named = names(opened.stream, path, images, cancel).map_err(|error| SourceError::of(path, error));
        files.extend(named.map_err(|error| heeded(error, cancel))?);
    }
    Ok(files)
}

/// Length and hash of a source as [`SourceInfo`] has them, of its [`files`].
///
/// # Errors
/// [`SourceError::Read`] naming the file that cannot be read.
pub fn fingerprint(files: &[PathBuf], cancel: &Cancel) -> Result<(u64, u64), SourceError> {
    let all = files
        .iter()
        .map(|path| {
            let supply = Supply::file(path)?;
            let read =
                || -> io::Result<(u64, u64)> { Tap::open(&supply, &FailPoints::default(), cancel)?.finish() };
            read().map_err(|source| heeded(SourceError::Read { path: path.clone(), source }, cancel))
        })
        .collect::<Result<Vec<_>, _>>()?;
    let hashes: Vec<u64> = all.iter().skip(1).map(|(_, hash)| *hash).collect();
    let first = all.first().map_or(0, |(_, hash)| *hash);
    Ok((all.iter().map(|(len, _)| len).sum(), combine(first, &hashes)))
}

/// The hash of a file and of those that it names.
fn combine(first: u64, beside: &[u64]) -> u64 {
    if beside.is_empty() {
        return first;
    }
    let mut hash = Xxh3::new();
    hash.update(&first.to_le_bytes());
    beside.iter().for_each(|file| hash.update(&file.to_le_bytes()));
    hash.digest()
}
