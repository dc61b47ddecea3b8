//! The source while it is held against a file: its vertices and triangles, in memory or on disk.

use crate::error::VerifyError;
use bytemuck::Pod;
use chpm_extmem::{BufferWriter, Cancel, Column, Paged, Progress, Store};
use chpm_format::{Chpm, Metadata};
use chpm_import::ply::{Batch, BatchKind, Coordinates, Invalid, Keep, Options, Tally};
use chpm_import::{Input, KeptPolygons};
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// The corners of a triangle, as the source has them.
pub(super) type Corners = [[f64; 3]; 3];
/// For each corner, the hash of its named scalars; 0 without any.
pub(super) type Marks = [u64; 3];

/// Items that are read at once.
const WINDOW: usize = 1 << 14;

/// A source that was read to its end.
pub(super) struct Source {
    positions: Positions,
    /// By vertex, the hash of its named scalars.
    marks: Option<Paged<u64>>,
    triangles: Column<[u32; 3]>,
    pub(super) tally: Tally,
    /// Whether coordinates are text that is declared to be of single precision.
    pub(super) is_told_single: bool,
}

/// Vertices, in the precision that the source has.
enum Positions {
    Single(Paged<[f32; 3]>),
    Double(Paged<[f64; 3]>),
}

impl Source {
    /// Reads the source of `file`, with the settings that the file was built with.
    pub(super) fn of<D: AsRef<[u8]>>(
        file: &Chpm<D>,
        path: &Path,
        store: &Store,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Self, VerifyError> {
        let settings = file.metadata().map(|metadata: Metadata| metadata.settings).unwrap_or_default();
        let drops = settings.iter().any(|(name, value)| name == "drop-invalid" && value == "true");
        progress.begin("read", path.metadata().map_or(0, |metadata| metadata.len()));
        let mut before = 0;
        let names = file.scalars().iter().map(|scalar| scalar.name.clone()).collect();
        let source = Self::read(path, drops, names, store, cancel, |read| {
            progress.advance(read - before);
            before = read;
        });
        progress.end();
        source
    }

    /// Reads a source, with the scalars of these names; `tell` hears how many bytes of it are behind us.
    pub(super) fn read(
        path: &Path,
        drops: bool,
        scalars: Vec<String>,
        store: &Store,
        cancel: &Cancel,
        mut tell: impl FnMut(u64),
    ) -> Result<Self, VerifyError> {
        let invalid = if drops { Invalid::Drop } else { Invalid::Refuse };
        let keep = Keep { all: false, names: scalars };
        let options = Options { invalid, normals: false, colors: false, keep, ..Options::default() };
        let mut input = Input::open(path, options, store, cancel)?;
        let coordinates = input.vertex_format().coordinates;
        let words = usize::from(input.vertex_format().attributes.scalar_words);

        let mut singles = BufferWriter::<[f32; 3]>::new(store, POSITIONS, 0)?;
        let mut doubles = BufferWriter::<[f64; 3]>::new(store, POSITIONS, 0)?;
        let mut marks = BufferWriter::<u64>::new(store, MARKS, 0)?;
        let mut marked = Vec::new();
        let mut triangles = BufferWriter::new(store, "source triangles", 0)?;
        let mut polygons = KeptPolygons::new(store)?;
        let mut batch = Batch::default();
        while input.next_batch(&mut batch)? != BatchKind::End {
            cancel.check()?;
            singles.extend_from_slice(&batch.vertices.positions)?;
            doubles.extend_from_slice(&batch.positions_f64)?;
            marked.clear();
            marked.extend(batch.vertices.scalars.chunks(words.max(1)).map(mark));
            marks.extend_from_slice(&marked)?;
            triangles.extend_from_slice(&batch.triangles)?;
            polygons.add(&batch.polygons)?;
            tell(input.bytes_read());
        }
        let mut tally = input.finish()?.tally;

        let mut positions = match coordinates.are_double() {
            true => Positions::Double(Paged::new(store, POSITIONS, doubles.finish_column()?)?),
            false => Positions::Single(Paged::new(store, POSITIONS, singles.finish_column()?)?),
        };
        // There are many right ways to cut them; this is the builder's.
        tally.degenerate_faces += polygons.cut(
            cancel,
            |corner| positions.get(corner),
            |cut| Ok::<(), VerifyError>(triangles.extend_from_slice(cut)?),
        )?;
        let marks = marks.finish_column()?;
        Ok(Source {
            positions,
            marks: (words > 0).then(|| Paged::new(store, MARKS, marks)).transpose()?,
            triangles: triangles.finish_column()?,
            tally,
            is_told_single: coordinates == Coordinates::TextOfSingles,
        })
    }

    /// Number of vertices.
    pub(super) fn vertex_count(&self) -> usize {
        match &self.positions {
            Positions::Single(all) => all.len(),
            Positions::Double(all) => all.len(),
        }
    }

    /// Number of triangles.
    pub(super) fn triangle_count(&self) -> u64 {
        self.triangles.len() as u64
    }

    /// Shows the vertices of all triangles, in their order.
    pub(super) fn each_triangle(
        &self,
        cancel: &Cancel,
        look: impl FnMut([u32; 3]) -> Result<(), VerifyError>,
    ) -> Result<(), VerifyError> {
        each(&self.triangles, cancel, look)
    }

    /// Shows the corners of all triangles, in their order.
    pub(super) fn each_corners(
        &mut self,
        cancel: &Cancel,
        mut look: impl FnMut(Corners) -> Result<(), VerifyError>,
    ) -> Result<(), VerifyError> {
        self.each_marked(cancel, |corners, _| look(corners))
    }

    /// The same, with what the corners have besides.
    pub(super) fn each_marked(
        &mut self,
        cancel: &Cancel,
        mut look: impl FnMut(Corners, Marks) -> Result<(), VerifyError>,
    ) -> Result<(), VerifyError> {
        let Source { positions, triangles, marks, .. } = self;
        each(triangles, cancel, |[a, b, c]| {
            let mut own = [0; 3];
            if let Some(marks) = marks {
                own = [marks.get(a as usize)?, marks.get(b as usize)?, marks.get(c as usize)?];
            }
            look([positions.get(a)?, positions.get(b)?, positions.get(c)?], own)
        })
    }
}

const POSITIONS: &str = "source positions";
const MARKS: &str = "hashes of source scalars";

/// The hash of a vertex's named scalars, by their words; 0 without any.
pub(super) fn mark(words: &[u32]) -> u64 {
    if words.is_empty() { 0 } else { xxh3_64(bytemuck::cast_slice(words)) }
}

impl Positions {
    fn get(&mut self, vertex: u32) -> Result<[f64; 3], VerifyError> {
        Ok(match self {
            Positions::Single(all) => all.get(vertex as usize)?.map(f64::from),
            Positions::Double(all) => all.get(vertex as usize)?,
        })
    }
}

/// Shows all items in their order.
pub(super) fn each<T: Pod>(
    column: &Column<T>,
    cancel: &Cancel,
    mut look: impl FnMut(T) -> Result<(), VerifyError>,
) -> Result<(), VerifyError> {
    let mut scratch = Vec::new();
    for start in (0..column.len()).step_by(WINDOW) {
        cancel.check()?;
        let items = column.read(start..column.len().min(start + WINDOW), &mut scratch)?;
        items.iter().try_for_each(|item| look(*item))?;
    }
    Ok(())
}
