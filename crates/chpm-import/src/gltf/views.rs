//! Buffers and views of a glTF as stretches of files, which are read where they are needed.

use super::document::{Compressed, Document, entry, refused};
use super::meshopt;
use super::text::Payload;
use crate::error::{ImportError, SourceError};
use crate::texture::Image;
use chpm_extmem::platform::read_exact_at;
use chpm_extmem::{Cancel, ExtmemError, FailPoints, Store};
use chpm_texture::Alpha;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// A stretch of a file.
#[derive(Clone)]
pub(super) struct Region {
    file: Arc<Opened>,
    start: u64,
    len: u64,
}

struct Opened {
    file: Arc<File>,
    path: PathBuf,
    /// Whether it can be opened again by its path.
    is_named: bool,
    fail_points: FailPoints,
}

impl Region {
    /// All of a file, which is named by `path` in errors.
    pub(super) fn of(
        file: File,
        (path, is_named): (PathBuf, bool),
        start: u64,
        len: u64,
        fail_points: &FailPoints,
    ) -> Region {
        let (file, fail_points) = (Arc::new(file), fail_points.clone());
        Region { file: Arc::new(Opened { file, path, is_named, fail_points }), start, len }
    }

    pub(super) fn len(&self) -> u64 {
        self.len
    }

    /// A stretch of this one; `whose` it is, if it is longer than that.
    pub(super) fn part(&self, start: u64, len: u64, whose: &str) -> Result<Region, ImportError> {
        let end = start.checked_add(len).filter(|end| *end <= self.len);
        end.ok_or_else(|| {
            refused(format!(
                "{whose} has {len} bytes from byte {start} on, and what it lies in has {}",
                self.len
            ))
        })?;
        Ok(Region { file: Arc::clone(&self.file), start: self.start + start, len })
    }

    /// An image whose bytes these are.
    pub(super) fn image(&self, name: String, alpha: Alpha) -> Image {
        let (Opened { file, path, is_named, .. }, place) = (&*self.file, (self.start, self.len));
        match is_named {
            true => Image::part(name, path.clone(), place, alpha),
            false => Image::stretch(name, Arc::clone(file), place, alpha),
        }
    }

    /// Fills `out` with the bytes from `offset` on, which must be there.
    pub(super) fn read(&self, offset: u64, out: &mut [u8]) -> Result<(), ImportError> {
        let Opened { file, path, fail_points, .. } = &*self.file;
        let read = fail_points.access().and_then(|()| read_exact_at(file, out, self.start + offset));
        read.map_err(|source| SourceError::Read { path: path.clone(), source }.into())
    }
}

/// A file without a name that grows.
pub(super) struct Scratch<'a> {
    store: &'a Store,
    file: Option<File>,
    len: u64,
}

impl<'a> Scratch<'a> {
    pub(super) fn new(store: &'a Store) -> Self {
        Scratch { store, file: None, len: 0 }
    }

    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<(), ImportError> {
        if bytes.is_empty() {
            return Ok(());
        }
        let workdir = &self.store.workdir;
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(workdir.unnamed_file()?),
        };
        let written = workdir.fail_points().access().and_then(|()| file.write_all(bytes));
        let told =
            |source| ExtmemError::io("write to a file in", workdir.place(), bytes.len() as u64, source);
        written.map_err(told)?;
        self.len += bytes.len() as u64;
        Ok(())
    }

    /// All that was written.
    pub(super) fn finish(self) -> Result<Region, ImportError> {
        let Scratch { store, file, len } = self;
        let file = file.map_or_else(|| store.workdir.unnamed_file(), Ok)?;
        Ok(Region::of(file, (store.workdir.place().to_owned(), false), 0, len, store.workdir.fail_points()))
    }
}

/// Where the bytes of buffers and views are.
pub(super) struct Views<'a> {
    buffers: Vec<Option<Region>>,
    /// Views that were compressed.
    unpacked: BTreeMap<u32, Region>,
    document: &'a Document,
    store: &'a Store,
    cancel: &'a Cancel,
}

impl<'a> Views<'a> {
    /// Finds the buffers. That of the GLB itself is `binary`; bytes of data URIs lie in `data`; files lie relative to `path`.
    pub(super) fn open(
        document: &'a Document,
        binary: Option<&Region>,
        (data, payloads): (&Region, &[Payload]),
        path: &Path,
        (store, cancel): (&'a Store, &'a Cancel),
    ) -> Result<Self, ImportError> {
        let mut buffers = Vec::new();
        for (index, buffer) in document.buffers.iter().enumerate() {
            let region = match &buffer.uri {
                None if index == 0 => binary.cloned(),
                // What a reader would have that unpacks nothing; it is not there.
                None => None,
                Some(uri) => Some(match uri.strip_prefix("data:") {
                    Some(number) => payload(number, payloads, data, index)?,
                    None => outside(uri, path, store)?,
                }),
            };
            if let Some(region) = &region
                && region.len() < buffer.byte_length
            {
                let (has, says) = (region.len(), buffer.byte_length);
                return Err(refused(format!(
                    "buffer {index} has {has} bytes, not {says}; copy the file again"
                )));
            }
            buffers.push(region);
        }
        Ok(Views { buffers, unpacked: BTreeMap::new(), document, store, cancel })
    }

    fn buffer(&self, number: u32) -> Result<&Region, ImportError> {
        let region = entry(&self.buffers, number, "buffer")?.as_ref();
        region.ok_or_else(|| refused(format!("buffer {number} is not in this file, and names none")))
    }

    /// The bytes of a view, and the distance of its elements if it says one.
    pub(super) fn view(&mut self, number: u32) -> Result<(Region, Option<u64>), ImportError> {
        let view = entry(&self.document.buffer_views, number, "buffer view")?;
        if let Some(stride) = view.byte_stride.filter(|stride| !(1..=252).contains(stride)) {
            return Err(refused(format!(
                "buffer view {number} has a byteStride of {stride}; expected 4 to 252"
            )));
        }
        let Some(compressed) = &view.extensions.meshopt else {
            let region = self.buffer(view.buffer)?;
            let region = region.part(view.byte_offset, view.byte_length, &format!("buffer view {number}"))?;
            return Ok((region, view.byte_stride));
        };
        let stride = Some(compressed.byte_stride).filter(|_| view.byte_stride.is_some());
        if let Some(region) = self.unpacked.get(&number) {
            return Ok((region.clone(), stride));
        }
        let region = self.unpack(number, compressed)?;
        self.unpacked.insert(number, region.clone());
        Ok((region, stride))
    }

    /// Decompresses a view into a file of its own.
    fn unpack(&self, number: u32, view: &Compressed) -> Result<Region, ImportError> {
        self.cancel.check().map_err(|_| SourceError::Cancelled)?;
        let region = self.buffer(view.buffer)?;
        let region = region.part(view.byte_offset, view.byte_length, &format!("buffer view {number}"))?;
        let len = view.count.checked_mul(view.byte_stride);
        let bytes = len.and_then(|len| len.checked_mul(2)?.checked_add(view.byte_length));
        let bytes = bytes
            .ok_or_else(|| refused(format!("buffer view {number} cannot have {} elements", view.count)))?;
        let _share = self.store.budget.reserve_work("a compressed view of a glTF", bytes)?;

        let mut packed = vec![0; view.byte_length as usize];
        region.read(0, &mut packed)?;
        let mut scratch = Scratch::new(self.store);
        scratch.write(&meshopt::decode(&packed, view)?)?;
        scratch.finish()
    }
}

fn payload(number: &str, payloads: &[Payload], data: &Region, index: usize) -> Result<Region, ImportError> {
    let payload = number.parse::<usize>().ok().and_then(|number| payloads.get(number));
    let valid = payload.filter(|payload| payload.is_valid);
    let valid = valid.ok_or_else(|| refused(format!("the data URI of buffer {index} is no valid base64")))?;
    data.part(valid.start, valid.len, "a data URI")
}

fn outside(uri: &str, path: &Path, store: &Store) -> Result<Region, ImportError> {
    let path = beside(uri, path)?;
    let fail_points = store.workdir.fail_points();
    // What is no file has no length, or no end.
    let supply = crate::Supply::file(&path)?;
    let opened = fail_points.access().and_then(|()| supply.open());
    let file = opened.map_err(|source| SourceError::Read { path: path.clone(), source })?;
    Ok(Region::of(file, (path, true), 0, supply.len(), fail_points))
}

/// The file that a URI names, in the folder of the glTF at `path` or below.
pub(super) fn beside(uri: &str, path: &Path) -> Result<PathBuf, ImportError> {
    let told = crate::location::excerpt(uri.as_bytes());
    let name = unescaped(uri).ok_or_else(|| refused(format!("'{told}' is no valid URI")))?;
    let has_scheme = uri.split(['/', '?', '#']).next().is_some_and(|first| first.contains(':'));
    let mut depth = 0;
    for component in Path::new(&name).components() {
        depth += match component {
            Component::Normal(_) => 1,
            Component::CurDir => 0,
            Component::ParentDir => -1,
            Component::RootDir | Component::Prefix(_) => i64::MIN / 2,
        };
        if depth < 0 {
            break;
        }
    }
    if has_scheme || depth < 1 {
        return Err(refused(format!(
            "'{told}' does not lie beside it: only files in its folder and below are read; copy that there"
        )));
    }
    Ok(path.with_file_name("").join(name))
}

/// A URI with its `%20`s as what they stand for.
pub(super) fn unescaped(uri: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = uri.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let digits = [rest.next()?, rest.next()?];
        let digits = std::str::from_utf8(&digits).ok().filter(|text| !text.starts_with('+'))?;
        bytes.push(u8::from_str_radix(digits, 16).ok()?);
    }
    String::from_utf8(bytes).ok().filter(|name| !name.is_empty() && !name.contains('\0'))
}
