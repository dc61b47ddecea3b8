//! Materials of an OBJ: from the libraries that it names, with their images.

use super::mtl::{self, Map, Mtl, statement, uncommented};
use super::statements::goes_on;
use crate::error::{ImportError, SourceError};
use crate::supply::Supply;
use crate::texture::{Images, Table, beside};
use chpm_extmem::{Cancel, Store, same_file};
use chpm_texture::{Alpha, Wrap};
use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes of all libraries that are read, however often they are named.
const LONGEST: u64 = 64 << 20;

/// Materials by their names, in the libraries that were named so far.
pub(super) struct Libraries {
    pub(super) path: PathBuf,
    pub(super) table: Table,
    pub(super) surfaces: Vec<Surface>,
    named: Names,
    pub(super) cancel: Cancel,
    /// Bytes of libraries that may still be read.
    left: u64,
}

/// Surfaces by the names of their materials: as they are written, and without what may be a comment.
#[derive(Default)]
struct Names([BTreeMap<Vec<u8>, u32>; 2]);

impl Names {
    fn add(&mut self, name: Vec<u8>, surface: u32) {
        self.0[1].entry(uncommented(&name).to_vec()).or_insert(surface);
        self.0[0].entry(name).or_insert(surface);
    }

    fn find(&self, name: &[u8]) -> Option<u32> {
        let names = [name, uncommented(name)];
        names.iter().find_map(|name| self.0.iter().find_map(|named| named.get(*name))).copied()
    }
}

/// A material on a face.
pub(super) struct Surface {
    /// For faces without texture coordinates.
    pub(super) plain: u32,
    pub(super) paint: Paint,
    pub(super) scale: [f32; 2],
    pub(super) offset: [f32; 2],
}

/// Images of a surface.
pub(super) enum Paint {
    None,
    One(u32),
    /// By the number of a tile (UDIM); the last is for those that are not there.
    Tiles(BTreeMap<u16, u32>, u32),
}

impl Libraries {
    /// Those of the OBJ at `path`, none yet.
    pub(super) fn new(
        path: &Path,
        images: Images,
        store: Option<&Store>,
        cancel: &Cancel,
    ) -> Result<Libraries, ImportError> {
        let table = Table::new(images, store)?;
        let (path, cancel) = (path.to_owned(), cancel.clone());
        Ok(Libraries { path, table, surfaces: Vec::new(), named: Names::default(), cancel, left: LONGEST })
    }

    /// Reads the libraries that an `mtllib` statement names. Of several, the first that has a material counts.
    pub(super) fn add(&mut self, names: &[u8]) -> Result<(), ImportError> {
        let mut new = Names::default();
        for name in self.split(&String::from_utf8_lossy(uncommented(names))) {
            self.cancel.check().map_err(|_| SourceError::Cancelled)?;
            match beside::find(&name, &self.path) {
                Err(why) => self.table.lose("material library", &name, &why)?,
                // What is no library has no materials.
                Ok(library) if same_file(&library, &self.path) => {}
                Ok(library) => self.read(&library, &mut new)?,
            }
        }
        self.named.0.iter_mut().zip(new.0).for_each(|(named, new)| named.extend(new));
        Ok(())
    }

    /// Names of libraries, which may have blanks: all of it, if there is such a file; else each ends as they do.
    fn split(&self, names: &str) -> Vec<String> {
        if beside::find(names, &self.path).is_ok() {
            return vec![names.to_owned()];
        }
        let (mut split, mut name) = (Vec::new(), String::new());
        for word in names.split_ascii_whitespace() {
            name += if name.is_empty() { "" } else { " " };
            name += word;
            if word.to_ascii_lowercase().ends_with(".mtl") {
                split.push(std::mem::take(&mut name));
            }
        }
        split.extend((!name.is_empty()).then_some(name));
        split
    }

    fn read(&mut self, library: &Path, new: &mut Names) -> Result<(), ImportError> {
        let unread = |source| SourceError::Read { path: library.to_owned(), source };
        let supply = Supply::file(library)?;
        let bytes = supply.open().map_err(unread)?.take(self.left);
        self.table.add_file(library.to_owned());
        if supply.len() > self.left {
            let name = library.display().to_string();
            self.table.lose("material library", &name, "is longer, with the others, than 64 MiB")?;
        }
        self.left = self.left.saturating_sub(supply.len());
        let cancel = self.cancel.clone();
        mtl::read(bytes, &mut |mtl| {
            cancel.check().map_err(|_| SourceError::Cancelled)?;
            let surface = self.surface(&mtl, library)?;
            self.table.count(2 * mtl.name.len())?;
            new.add(mtl.name, self.surfaces.len() as u32);
            self.surfaces.push(surface);
            Ok(())
        })
        .map_err(|error| SourceError::of(library, error).into())
    }

    fn surface(&mut self, mtl: &Mtl, library: &Path) -> Result<Surface, ImportError> {
        let factor = mtl.factor();
        let Some(map) = &mtl.map else {
            let plain = self.table.color(factor)?;
            return Ok(Surface { plain, paint: Paint::None, scale: [1.0; 2], offset: [0.0; 2] });
        };
        let plain = self.table.plain(factor)?;
        let alpha = mtl.alpha();
        let paint = match map.file.split_once("<UDIM>") {
            Some((before, behind)) => self.tiles(library, map, [before, behind], factor, alpha)?,
            None => {
                let found = self.find(&map.file, library);
                let image = self.table.file(&map.file, found, alpha)?;
                let wrap = if map.is_clamped { Wrap::Clamp } else { Wrap::Repeat };
                Paint::One(self.table.material(image, factor, [wrap; 2])?)
            }
        };
        Ok(Surface { plain, paint, scale: map.scale, offset: map.offset })
    }

    /// An image beside the library, or else beside the source.
    fn find(&self, name: &str, library: &Path) -> Result<PathBuf, String> {
        beside::find(name, library).or_else(|why| beside::find(name, &self.path).map_err(|_| why))
    }

    /// All tiles that are there.
    fn tiles(
        &mut self,
        library: &Path,
        map: &Map,
        [before, behind]: [&str; 2],
        factor: [f32; 4],
        alpha: Alpha,
    ) -> Result<Paint, ImportError> {
        let mut tiles = BTreeMap::new();
        for (tile, name) in names_of_tiles(library, before, behind) {
            let found = self.find(&name, library);
            let image = self.table.file(&name, found, alpha)?;
            tiles.insert(tile, self.table.material(image, factor, [Wrap::Clamp; 2])?);
        }
        if tiles.is_empty() {
            self.table.file(&map.file, Err("is not there".to_owned()), alpha)?;
        }
        let missing = self.table.material(None, factor, [Wrap::Clamp; 2])?;
        Ok(Paint::Tiles(tiles, missing))
    }

    /// The surface that a `usemtl` statement names, if there is one.
    pub(super) fn surface_of(&self, name: &[u8]) -> Option<u32> {
        self.named.find(name)
    }
}

/// Tiles by their numbers and names, in order: a folder is listed, since any of 9,000 may be there.
fn names_of_tiles(library: &Path, before: &str, behind: &str) -> BTreeMap<u16, String> {
    let before = before.replace('\\', "/");
    let (folder, start) = before.rsplit_once('/').map_or(("", &*before), |(folder, start)| (folder, start));
    let listed = library.with_file_name("").join(folder);
    let listed = if listed.as_os_str().is_empty() { PathBuf::from(".") } else { listed };
    let mut tiles = BTreeMap::new();
    for entry in fs::read_dir(listed).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let tile = name.to_str().and_then(|name| {
            let tile = name.strip_prefix(start)?.strip_suffix(behind)?;
            let is_tile = tile.len() == 4 && tile.bytes().all(|digit| digit.is_ascii_digit());
            is_tile.then(|| tile.parse().ok()).flatten()
        });
        if let Some(tile) = tile {
            tiles.insert(tile, format!("{before}{tile}{behind}"));
        }
    }
    tiles
}

/// The files that an OBJ names, which it may do anywhere.
pub(super) fn files(
    stream: crate::Stream,
    path: &Path,
    images: Images,
    cancel: &Cancel,
) -> Result<Vec<PathBuf>, ImportError> {
    if images == Images::Ignored {
        return Ok(Vec::new());
    }
    let mut libraries = Libraries::new(path, images, None, cancel)?;
    each_library(stream, &mut |names| libraries.add(names))?;
    Ok(libraries.table.files().to_vec())
}

/// Looks for `mtllib` statements, in blocks: most of them have no such letter at all.
fn each_library(
    mut stream: crate::Stream,
    take: &mut dyn FnMut(&[u8]) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    let (mut buffer, mut len, mut offset) = (vec![0; crate::lines::WINDOW], 0, 0);
    loop {
        let count = match stream.read(&mut buffer[len..]) {
            Ok(count) => count.min(buffer.len() - len),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(source) => return Err(ImportError::Read { offset: offset + len as u64, source }),
        };
        len += count;

        let whole = if count == 0 { len } else { whole_lines(&buffer[..len]) };
        if buffer[..whole].contains(&b'm') {
            in_block(&buffer[..whole], take)?;
        }

        // No line is as long; whoever reads the file says so.
        if count == 0 || whole == 0 && len == buffer.len() {
            return Ok(());
        }
        buffer.copy_within(whole..len, 0);
        offset += whole as u64;
        len -= whole;
    }
}

/// Bytes of whole statements at the front: what ends in a backslash goes on in the next line.
fn whole_lines(bytes: &[u8]) -> usize {
    let mut end = bytes.len();
    while let Some(at) = bytes[..end].iter().rposition(|byte| matches!(byte, b'\n' | b'\r')) {
        if at == 0 || bytes[at - 1] != b'\\' && !bytes[..at].ends_with(b"\\\r") {
            return at + 1;
        }
        end = at;
    }
    0
}

fn in_block(
    mut block: &[u8],
    take: &mut dyn FnMut(&[u8]) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    let mut look = |line: &[u8]| match statement(line) {
        Some((b"mtllib", names)) => take(names),
        _ => Ok(()),
    };
    let mut joined = Vec::new();
    while !block.is_empty() {
        let end = block.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(block.len());
        let (line, rest) = block.split_at(end);
        block = rest.strip_prefix(b"\r\n").unwrap_or(rest.get(1..).unwrap_or_default());

        let body = line.strip_suffix(b"\\").filter(|_| goes_on(line));
        if joined.is_empty() && body.is_none() {
            look(line)?;
            continue;
        }
        joined.extend_from_slice(body.unwrap_or(line));
        joined.push(b' ');
        if body.is_none() {
            look(&joined)?;
            joined.clear();
        }
    }
    look(&joined)
}
