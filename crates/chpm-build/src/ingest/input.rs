//! A source of any format, as one stream of batches.

use super::normals::CornerNormals;
use super::scans::ScanSet;
use super::steps::Steps;
use super::stream::{self, Packing, Stream, Tap};
use super::supply::Supply;
use super::weld::{WeldError, Welder};
use crate::error::BuildError;
use chpm_extmem::{Cancel, FailPoints, Reservation, Store};
use chpm_format::Source as Provenance;
use chpm_import::PlyReader;
use chpm_import::ply::{Batch, BatchKind, Options, Tally, VertexFormat};
use chpm_import::{Foreign, Format, ImportError, ObjReader, RangeScans, StlReader};
use std::io;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// A mesh that is being read: PLY, STL, OBJ, each of them also compressed by gzip or zstd, or a Stanford list of range scans.
///
/// Content decides what a file is, not its name. Nothing is unpacked to disk as it is; a batch, a window of the text and the
/// decompressor's window are in memory. Joining an STL's corners sorts them in the store.
pub struct Input {
    path: PathBuf,
    body: Body,
    tap: Tap,
    packing: Packing,
    format: Format,
    /// Of a range grid.
    steps: Option<Steps>,
    /// Of a format that gives them to corners, if they are asked for.
    normals: Option<CornerNormals>,
    cancel: Cancel,
    _window: Reservation,
}

enum Body {
    Ply(Box<PlyReader<Stream>>),
    Obj(Box<ObjReader<Stream>>),
    Stl(Box<Welder<u128>>),
    StlText(Box<Welder<[u128; 2]>>),
    Scans(Box<ScanSet>),
}

/// What is known of a source when all of it was read.
pub struct Read {
    /// Name, length, hash, encoding and counts. The hash of a list of scans is that of the list's bytes and, in its order, of
    /// each scan's own hash; its length is that of all files.
    pub provenance: Provenance,
    /// What was not delivered.
    pub tally: Tally,
    /// What was left out or changed, in words.
    pub warnings: Vec<String>,
    /// The scans of a list: each with the number of its first vertex.
    pub(super) scans: Vec<(u64, PathBuf)>,
    /// Normals of corners, if the format has such and they were asked for.
    pub(super) normals: Option<CornerNormals>,
}

impl Input {
    /// Opens the file `path` and reads as much as it takes to know the vertices' format. Whenever `cancel` is set, now or
    /// later, reading ends soon with [`BuildError::Cancelled`].
    ///
    /// # Errors
    /// [`BuildError::Source`], [`BuildError::NotAFile`], [`BuildError::Ply`] or [`BuildError::Import`], naming the file.
    pub fn open(path: &Path, options: Options, store: &Store, cancel: &Cancel) -> Result<Input, BuildError> {
        Self::of(&Supply::file(path)?, options, store, cancel)
    }

    /// Like [`Input::open`].
    pub(crate) fn of(
        supply: &Supply,
        options: Options,
        store: &Store,
        cancel: &Cancel,
    ) -> Result<Input, BuildError> {
        Self::open_as(supply, options, store, true, cancel)
    }

    /// Like [`Input::open`]; a list of scans is only understood where `lists` allows it, and not within another.
    pub(super) fn open_as(
        supply: &Supply,
        options: Options,
        store: &Store,
        lists: bool,
        cancel: &Cancel,
    ) -> Result<Input, BuildError> {
        let opened = Tap::open(supply, store.workdir.fail_points(), cancel);
        let opened = opened.map_err(|source| BuildError::Source { path: supply.path.clone(), source });
        let input = opened.and_then(|tap| Self::from_tap(supply, tap, options, store, lists, cancel));
        input.map_err(|error| heeded(error, cancel))
    }

    pub(super) fn from_tap(
        supply: &Supply,
        tap: Tap,
        options: Options,
        store: &Store,
        lists: bool,
        cancel: &Cancel,
    ) -> Result<Input, BuildError> {
        let path = &supply.path;
        let unread = |source| BuildError::Source { path: path.to_owned(), source };
        let opened = stream::open(&tap, Format::HEAD, store.budget.available_for_work()).map_err(unread)?;
        let window = store.budget.reserve_work("the window of a zstd stream", opened.window)?;

        let import = |source| BuildError::Import { path: path.to_owned(), source: Box::new(source) };
        let extension = extension(path);
        if let Some(foreign) = Foreign::detect(&opened.head, opened.len, extension.as_deref()) {
            return Err(import(ImportError::Foreign(foreign)));
        }
        let format = Format::detect(&opened.head, opened.len, extension.as_deref());
        if format == Format::RangeScans && !lists {
            return Err(import(ImportError::Foreign(Foreign::list_in_list())));
        }
        let body = match format {
            Format::Ply => {
                let reader = PlyReader::new(opened.stream, options);
                Body::Ply(Box::new(
                    reader.map_err(|source| BuildError::Ply { path: path.to_owned(), source })?,
                ))
            }
            Format::Obj => Body::Obj(Box::new(ObjReader::new(opened.stream, options).map_err(import)?)),
            Format::StlBinary | Format::StlAscii => {
                let reader = StlReader::new(opened.stream, format, options.invalid).map_err(import)?;
                match format {
                    Format::StlBinary => Body::Stl(Box::new(Welder::new(reader, store))),
                    _ => Body::StlText(Box::new(Welder::new(reader, store))),
                }
            }
            Format::RangeScans if supply.is_spooled() => {
                return Err(BuildError::ListThroughPipe { path: path.to_owned() });
            }
            Format::RangeScans => {
                let list = RangeScans::read(opened.stream).map_err(import)?;
                Body::Scans(Box::new(ScanSet::open(path, list, options, store, cancel)?))
            }
        };

        let has_grid = matches!(&body, Body::Ply(reader) if reader.has_grid());
        let steps = has_grid.then(|| Steps::new(store)).transpose()?;
        let has_corners = options.normals && format == Format::Obj;
        let normals = has_corners.then(|| CornerNormals::new(store)).transpose()?;
        let (path, packing, cancel) = (path.to_owned(), opened.packing, cancel.clone());
        Ok(Input { path, body, tap, packing, format, steps, normals, cancel, _window: window })
    }

    /// What the delivered vertices are made of.
    pub fn vertex_format(&self) -> VertexFormat {
        match &self.body {
            Body::Ply(reader) => reader.vertex_format(),
            Body::Obj(reader) => reader.vertex_format(),
            Body::Stl(welder) => welder.vertex_format(),
            Body::StlText(welder) => welder.vertex_format(),
            Body::Scans(scans) => scans.vertex_format(),
        }
    }

    /// Vertices and faces that a header declares, true or not.
    pub fn declared(&self) -> Option<(u64, u64)> {
        match &self.body {
            Body::Ply(reader) => Some((reader.header().vertex_count, reader.header().face_count)),
            _ => None,
        }
    }

    /// Bytes of the files that are behind us, as they are on disk.
    pub fn bytes_read(&self) -> u64 {
        match &self.body {
            Body::Scans(scans) => self.tap.len() + scans.bytes_read(),
            _ => self.tap.len(),
        }
    }

    /// Refills `batch` with what comes next. Vertices and triangles come in any order, and a batch of vertices may be empty: then
    /// some work was done that has no result yet. So may one of triangles, all of which lay across steps of a range grid.
    ///
    /// # Errors
    /// What is wrong with the source, and where; or the store's memory and disk.
    pub fn next_batch(&mut self, batch: &mut Batch) -> Result<BatchKind, BuildError> {
        self.refill(batch).map_err(|error| heeded(error, &self.cancel))
    }

    fn refill(&mut self, batch: &mut Batch) -> Result<BatchKind, BuildError> {
        let ply = |source| BuildError::Ply { path: self.path.clone(), source };
        let import = |source| BuildError::Import { path: self.path.clone(), source: Box::new(source) };
        let weld = |error| match error {
            WeldError::Import(source) => import(source),
            WeldError::Build(error) => *error,
        };
        let kind = match &mut self.body {
            Body::Ply(reader) => reader.next_batch(batch).map_err(ply)?,
            Body::Obj(reader) => reader.next_batch(batch).map_err(import)?,
            Body::Stl(welder) => welder.next_batch(batch).map_err(weld)?,
            Body::StlText(welder) => welder.next_batch(batch).map_err(weld)?,
            Body::Scans(scans) => scans.next_batch(batch)?,
        };
        if let Some(normals) = &mut self.normals {
            normals.take(batch)?;
        }
        if let Some(mut steps) = self.steps.take() {
            steps.vertices(batch)?;
            self.steps = Some(if kind == BatchKind::Triangles { steps.triangles(batch)? } else { steps });
        }
        Ok(kind)
    }

    /// Reads what lies behind the mesh, which belongs to the file, too; to be called after the last batch.
    ///
    /// # Errors
    /// [`BuildError::Source`].
    pub fn finish(self) -> Result<Read, BuildError> {
        let Input { path, body, tap, packing, format, steps, normals, cancel, .. } = self;
        let encoding = match &body {
            Body::Ply(reader) => reader.header().format.to_string(),
            _ => format.to_string(),
        };
        let mut provenance = Provenance {
            name: path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            encoding: format!("{encoding}{packing}"),
            ..Provenance::default()
        };

        let (tally, mut warnings, scans): (_, Vec<String>, _) = match body {
            Body::Ply(reader) => {
                let header = reader.header();
                (provenance.vertex_count, provenance.face_count) = (header.vertex_count, header.face_count);
                provenance.comments = header.comments.clone();
                (reader.tally(), reader.warnings().iter().map(ToString::to_string).collect(), None)
            }
            Body::Obj(reader) => {
                (provenance.vertex_count, provenance.face_count) = (reader.vertices(), reader.faces());
                (reader.tally(), reader.warnings(), None)
            }
            Body::Stl(welder) => welder.finish(&mut provenance),
            Body::StlText(welder) => welder.finish(&mut provenance),
            Body::Scans(scans) => {
                let read = scans.finish();
                (provenance.vertex_count, provenance.face_count) = (read.vertices, read.faces);
                (read.tally, read.warnings, Some((read.len, read.hashes, read.firsts)))
            }
        };
        warnings.extend(steps.and_then(|steps| steps.warning()));

        // The hash is that of the whole file, so that what lies behind the mesh is read, too.
        let unread = |source| heeded(BuildError::Source { path, source }, &cancel);
        let (len, hash) = tap.finish().map_err(unread)?;
        (provenance.byte_len, provenance.hash) = (len, hash);
        let mut firsts = Vec::new();
        if let Some((scans_len, hashes, scans)) = scans {
            (provenance.byte_len, provenance.hash) = (len + scans_len, combine(hash, &hashes));
            firsts = scans;
        }
        Ok(Read { provenance, tally, warnings, scans: firsts, normals })
    }
}

/// Reading that was ended on request fails in one way or another; this is why.
fn heeded(error: BuildError, cancel: &Cancel) -> BuildError {
    if cancel.is_cancelled() { BuildError::Cancelled } else { error }
}

/// The files that a source is made of: itself and, if it is a list of range scans, those.
///
/// # Errors
/// [`BuildError::Source`] or [`BuildError::NotAFile`] if it cannot be read, [`BuildError::Import`] if it is no valid list.
pub fn files(path: &Path, cancel: &Cancel) -> Result<Vec<PathBuf>, BuildError> {
    let unread = |source| heeded(BuildError::Source { path: path.to_owned(), source }, cancel);
    let opened = Tap::open(&Supply::file(path)?, &FailPoints::default(), cancel)
        // Only the first bytes are unpacked, and a window is not filled.
        .and_then(|tap| stream::open(&tap, Format::HEAD, u64::MAX))
        .map_err(unread)?;
    let mut files = vec![path.to_owned()];
    if Format::detect(&opened.head, opened.len, extension(path).as_deref()) == Format::RangeScans {
        let import = |source: ImportError| {
            heeded(BuildError::Import { path: path.to_owned(), source: Box::new(source) }, cancel)
        };
        let list = RangeScans::read(opened.stream).map_err(import)?;
        files.extend(list.scans.iter().map(|scan| path.with_file_name(&scan.file)));
    }
    Ok(files)
}

/// Length and hash of a source as [`Read::provenance`] has them, of its [`files`].
///
/// # Errors
/// [`BuildError::Source`] naming the file that cannot be read.
pub fn fingerprint(files: &[PathBuf], cancel: &Cancel) -> Result<(u64, u64), BuildError> {
    let one = |path: &PathBuf| {
        let supply = Supply::file(path)?;
        let read =
            || -> io::Result<(u64, u64)> { Tap::open(&supply, &FailPoints::default(), cancel)?.finish() };
        read().map_err(|source| heeded(BuildError::Source { path: path.clone(), source }, cancel))
    };
    let all = files.iter().map(one).collect::<Result<Vec<_>, _>>()?;
    let hashes: Vec<u64> = all.iter().skip(1).map(|(_, hash)| *hash).collect();
    let first = all.first().map_or(0, |(_, hash)| *hash);
    let hash = if hashes.is_empty() { first } else { combine(first, &hashes) };
    Ok((all.iter().map(|(len, _)| len).sum(), hash))
}

/// The hash of a list of scans.
fn combine(list: u64, scans: &[u64]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(&list.to_le_bytes());
    scans.iter().for_each(|scan| hash.update(&scan.to_le_bytes()));
    hash.digest()
}

/// The extension below the one that names a compression.
fn extension(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let name = name.strip_suffix(".gz").or_else(|| name.strip_suffix(".zst")).unwrap_or(&name);
    name.rsplit_once('.').map(|(_, extension)| extension.to_owned())
}
