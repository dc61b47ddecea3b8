//! Lists of tiles (`.tiles`): meshes that share a frame and meet at their borders, as one mesh. The first line is `tiles`, or
//! `tiles weld DISTANCE`; each further one is the name of a file.

use crate::batch::{Batch, BatchKind};
use crate::error::{ImportError, SourceError};
use crate::file_set::{self, FileSet};
use crate::format::{Format, Likeness, first_line, is_text, without_mark};
use crate::lines::{Lines, number, words};
use crate::location::excerpt;
use crate::options::Options;
use crate::reader::{MeshReader, Opening, SourceInfo, Start};
use crate::seams::{NewNumbers, Seams};
use crate::stream::Stream;
use crate::texture::Images;
use crate::vertex_format::VertexFormat;
use chpm_extmem::{Cancel, Store};
use chpm_mesh::{Counted, Scalar, Vertices};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Lists of tiles.
pub(crate) const FORMAT: Format =
    Format { name: ".tiles list", extensions: &["tiles"], is_list: true, sniff, open, names: Some(files) };

/// The word that a list begins with.
const WORD: &[u8] = b"tiles";

fn sniff(start: &Start<'_>) -> Likeness {
    let mut line = words(first_line(start.head));
    let is_list = line.next() == Some(WORD) && line.next().is_none_or(|word| word == b"weld");
    if is_list && is_text(start.head) { Likeness::Likely } else { Likeness::None }
}

fn open(opening: Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError> {
    let Opening { stream, options, store, cancel, supply, .. } = opening;
    if supply.is_spooled() {
        let (path, what) = (supply.path.clone(), "a list of tiles");
        return Err(SourceError::NamesFiles { path, what }.into());
    }
    let Tiles { files, weld } = Tiles::read(stream)?;
    let members = files.iter().map(|file| (supply.path.with_file_name(file), None)).collect();
    // Where tiles meet, a triangle may have vertices of several.
    let options = Options { wide: false, ..options };
    let set = FileSet::open(&supply.path, members, "tiles", options, store, cancel)?;
    Ok(Box::new(TileSet::new(set, weld, store, cancel)))
}

/// The files of the list at `path`.
fn files(stream: Stream, path: &Path, images: Images, cancel: &Cancel) -> Result<Vec<PathBuf>, ImportError> {
    let tiles = Tiles::read(stream)?;
    file_set::files(tiles.files.iter().map(|file| path.with_file_name(file)), images, cancel)
}

/// The tiles of one model.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Tiles {
    /// Names of their files, relative to the list's folder, in the order of the list.
    pub files: Vec<String>,
    /// How far apart two vertices of different tiles are at most to become one, in object units; 0 for those at the same place.
    pub weld: f64,
}

impl Tiles {
    /// Reads a list. Lines that are empty or begin with `#` are skipped.
    ///
    /// # Errors
    /// [`ImportError::Text`] for a first line of another kind, a distance that is none, a name that is not UTF-8 or that was there
    /// before; [`ImportError::NoTiles`] if no file is named.
    pub fn read(reader: impl Read) -> Result<Tiles, ImportError> {
        let mut lines = Lines::new(reader);
        let mut tiles = Tiles::default();
        let (mut begun, mut known) = (false, BTreeSet::new());
        while lines.advance()? {
            let line = without_mark(lines.current()).trim_ascii();
            let wrong = |expected, got| ImportError::Text {
                place: lines.place("tile", tiles.files.len() as u64),
                expected,
                got,
            };
            if line.is_empty() || line.starts_with(b"#") {
                continue;
            }
            if !begun {
                let line: Vec<&[u8]> = words(line).collect();
                tiles.weld = match line[..] {
                    [WORD] => 0.0,
                    [WORD, b"weld", distance] => number::<f64>(Some(distance))
                        .ok()
                        .filter(|distance| distance.is_finite() && *distance >= 0.0)
                        .ok_or_else(|| wrong("'tiles weld' and a distance", excerpt(lines.current())))?,
                    _ => return Err(wrong("'tiles', or 'tiles weld DISTANCE'", excerpt(lines.current()))),
                };
                begun = true;
                continue;
            }
            let file = std::str::from_utf8(line)
                .map_err(|_| wrong("a file name in UTF-8", excerpt(lines.current())))?
                .to_owned();
            if !known.insert(file.clone()) {
                return Err(wrong("each file once", file));
            }
            tiles.files.push(file);
        }
        if tiles.files.is_empty() { Err(ImportError::NoTiles) } else { Ok(tiles) }
    }
}

/// Tiles whose vertices at borders are one. All of them are read twice: where vertices are is looked at before the first is delivered.
struct TileSet {
    format: VertexFormat,
    scalars: Vec<Scalar>,
    cancel: Cancel,
    phase: Phase,
    /// A batch as the files have it, and which of its vertices stay.
    read: Batch,
    stays: Vec<usize>,
    /// Vertices that were delivered.
    delivered: u64,
}

enum Phase {
    Looking {
        set: FileSet,
        seams: Seams,
    },
    Delivering {
        set: FileSet,
        numbers: NewNumbers,
        /// Bytes of all tiles.
        looked: u64,
    },
    Ended {
        set: FileSet,
        numbers: NewNumbers,
    },
    /// After an error.
    Failed,
}

impl TileSet {
    fn new(set: FileSet, weld: f64, store: &Store, cancel: &Cancel) -> TileSet {
        TileSet {
            format: set.format(),
            scalars: set.scalars().to_vec(),
            cancel: cancel.clone(),
            phase: Phase::Looking { set, seams: Seams::new(weld, store) },
            read: Batch::default(),
            stays: Vec::new(),
            delivered: 0,
        }
    }

    /// Hands over what was read of a tile, with its new numbers; none if a tile has become larger since it was looked at.
    fn deliver(&mut self, numbers: &NewNumbers, tile: usize, batch: &mut Batch) -> Option<()> {
        let read = &mut self.read;
        batch.clear();
        batch.first = if read.vertex_count() > 0 { self.delivered } else { read.first };

        // A vertex stays if its number is the one that comes next.
        self.stays.clear();
        for at in 0..read.vertex_count() {
            let number = numbers.get((read.first + at as u64) as u32)?;
            if u64::from(number) == self.delivered {
                self.delivered += 1;
                self.stays.push(at);
            }
        }
        batch.positions_f64.extend(self.stays.iter().filter_map(|at| read.positions_f64.get(*at)));
        gather(&mut batch.vertices, &mut read.vertices, &self.stays);
        for vertex in &read.invalid_vertices {
            batch.invalid_vertices.push(numbers.get(*vertex as u32)?.into());
        }
        let own = batch.first..self.delivered;
        for mut place in read.far.drain(..) {
            place.index = numbers.get(place.index as u32)?.into();
            // Another one that it became one with is as far.
            if own.contains(&place.index) {
                batch.far.push(place);
            }
        }

        let faces = read.triangles.as_flattened_mut().iter_mut().chain(read.polygons.corners_mut());
        let textured = read.textured.iter_mut().flat_map(|triangle| &mut triangle.vertices);
        for corner in faces.chain(textured) {
            *corner = numbers.get(*corner)?;
        }
        std::mem::swap(&mut batch.triangles, &mut read.triangles);
        std::mem::swap(&mut batch.polygons, &mut read.polygons);
        std::mem::swap(&mut batch.textured, &mut read.textured);

        // A vertex that is left out brings no normal of its own.
        std::mem::swap(&mut batch.listed_normals, &mut read.listed_normals);
        let own = numbers.of_tile(tile);
        for [vertex, normal] in &read.corner_normals {
            let vertex = numbers.get(*vertex)?;
            if own.contains(&vertex) || *normal == u32::MAX {
                batch.corner_normals.push([vertex, *normal]);
            }
        }
        Some(())
    }
}

/// Notes where the vertices of a batch are.
fn look(batch: &Batch, tile: usize, seams: &mut Seams) -> Result<(), SourceError> {
    let mut invalid = batch.invalid_vertices.iter().copied().peekable();
    let singles = batch.vertices.positions.iter().map(|p| p.map(f64::from));
    for (vertex, position) in (batch.first..).zip(singles.chain(batch.positions_f64.iter().copied())) {
        let is_somewhere = invalid.next_if_eq(&vertex).is_none();
        seams.push(is_somewhere.then_some(position), tile)?;
    }
    Ok(())
}

/// Appends the vertices at these places, with or without positions among them.
fn gather(to: &mut Vertices, from: &mut Vertices, places: &[usize]) {
    let has_positions = !from.positions.is_empty();
    if !has_positions {
        from.positions.resize(places.last().map_or(0, |last| last + 1), [0.0; 3]);
    }
    to.gather(from.view(), places.iter().copied());
    if !has_positions {
        from.positions.clear();
        to.positions.clear();
    }
}

impl MeshReader for TileSet {
    fn format(&self) -> VertexFormat {
        self.format
    }

    fn scalars(&self) -> &[Scalar] {
        &self.scalars
    }

    fn bytes_beside(&self) -> u64 {
        match &self.phase {
            // All of them come twice.
            Phase::Looking { set, .. } => set.bytes_beside() / 2,
            Phase::Delivering { set, looked, .. } => (looked + set.bytes_beside()) / 2,
            Phase::Ended { set, .. } => set.bytes_beside(),
            Phase::Failed => 0,
        }
    }

    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        match std::mem::replace(&mut self.phase, Phase::Failed) {
            Phase::Looking { mut set, mut seams } => {
                let tile = set.at();
                match set.next(&mut self.read)? {
                    BatchKind::End => {
                        let looked = set.bytes_beside();
                        let (set, numbers) = (set.again(), seams.finish(&self.cancel)?);
                        self.phase = Phase::Delivering { set, numbers, looked };
                    }
                    kind => {
                        if kind == BatchKind::Vertices {
                            look(&self.read, tile, &mut seams)?;
                        }
                        self.phase = Phase::Looking { set, seams };
                    }
                }
                batch.clear();
                Ok(BatchKind::Vertices)
            }
            Phase::Delivering { mut set, numbers, looked } => {
                let tile = set.at();
                match set.next(&mut self.read)? {
                    BatchKind::End => {
                        *batch = Batch::default();
                        self.phase = Phase::Ended { set, numbers };
                        Ok(BatchKind::End)
                    }
                    kind => {
                        if self.deliver(&numbers, tile, batch).is_none() {
                            return Err(set.changed(tile).into());
                        }
                        self.phase = Phase::Delivering { set, numbers, looked };
                        Ok(kind)
                    }
                }
            }
            ended @ (Phase::Ended { .. } | Phase::Failed) => {
                *batch = Batch::default();
                self.phase = ended;
                Ok(BatchKind::End)
            }
        }
    }

    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError> {
        let Phase::Ended { set, numbers } = self.phase else { return Err(ImportError::Ended) };
        let mut read = Box::new(set).finish()?;
        let tiles = read.beside.iter_mut().filter_map(|beside| beside.first.as_mut());
        let mut count = 0;
        for first in tiles {
            *first = numbers.of_tile(count).start.into();
            count += 1;
        }
        let joined = Counted(numbers.joined, "vertex");
        read.encoding = format!("tiles, {joined} joined at their borders");
        if numbers.joined == 0 && count > 1 {
            let remedy = "'tiles weld DISTANCE' in the list's first line joins those that are near";
            read.warnings
                .push(format!("no two tiles have a vertex in one place, so each has a border: {remedy}"));
        }
        Ok(read)
    }
}
