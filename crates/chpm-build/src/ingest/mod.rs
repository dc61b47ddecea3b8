//! Ingest: a source becomes arrays of positions, attributes and triangles in which every number is finite and every index is
//! in range, with bounds and counts. One pass over the file; memory is the arrays and three batches.

pub mod input;
mod scans;
mod sorter;
mod steps;
mod stream;
mod weld;

use crate::allowance;
use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::foreign::AabbFields;
use chpm_extmem::{BufferWriter, Column, SavedFile, Store};
use chpm_format::Source as Provenance;
use chpm_mesh::ply::{Batch, BatchKind, Invalid, Options, Tally};
use chpm_mesh::{Aabb, Attributes};
use input::Input;
use serde::{Deserialize, Serialize};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::mpsc;

/// The validated source.
pub(crate) struct Source {
    /// Positions relative to `origin`.
    pub(crate) positions: Column<[f32; 3]>,
    pub(crate) normals: Option<Column<[f32; 3]>>,
    pub(crate) colors: Option<Column<[u8; 4]>>,
    pub(crate) triangles: Column<[u32; 3]>,
    /// Zero for f32 sources, which keep their bits.
    pub(crate) origin: [f64; 3],
    pub(crate) bounds: Aabb,
    /// By how much a coordinate was changed at most: what errors start from. Zero for f32 sources.
    pub(crate) rounding: f64,
    pub(crate) tally: Tally,
    pub(crate) warnings: Vec<String>,
    pub(crate) provenance: Provenance,
}

impl Source {
    pub(crate) fn attributes(&self) -> Attributes {
        Attributes { normals: self.normals.is_some(), colors: self.colors.is_some() }
    }

    /// Copies the arrays, which the next stage changes.
    pub(crate) fn save(&self, store: &Store) -> Result<SavedSource, BuildError> {
        Ok(SavedSource {
            positions: self.positions.save(store, POSITIONS)?,
            normals: self.normals.as_ref().map(|column| column.save(store, NORMALS)).transpose()?,
            colors: self.colors.as_ref().map(|column| column.save(store, COLORS)).transpose()?,
            triangles: self.triangles.save(store, TRIANGLES)?,
            origin: self.origin,
            rounding: self.rounding,
            bounds: self.bounds,
        })
    }
}

const POSITIONS: &str = "positions";
const NORMALS: &str = "normals";
const COLORS: &str = "colors";
const TRIANGLES: &str = "triangles";

/// [`Source`] in a checkpoint, without what is only told about it.
#[derive(Serialize, Deserialize)]
pub(crate) struct SavedSource {
    positions: SavedFile,
    normals: Option<SavedFile>,
    colors: Option<SavedFile>,
    triangles: SavedFile,
    origin: [f64; 3],
    rounding: f64,
    #[serde(with = "AabbFields")]
    bounds: Aabb,
}

impl SavedSource {
    pub(crate) fn files(&self) -> impl Iterator<Item = &SavedFile> {
        [&self.positions, &self.triangles].into_iter().chain(&self.normals).chain(&self.colors)
    }

    pub(crate) fn load(self, store: &Store) -> Result<Source, BuildError> {
        Ok(Source {
            positions: Column::load(store, POSITIONS, &self.positions)?,
            normals: self.normals.map(|saved| Column::load(store, NORMALS, &saved)).transpose()?,
            colors: self.colors.map(|saved| Column::load(store, COLORS, &saved)).transpose()?,
            triangles: Column::load(store, TRIANGLES, &self.triangles)?,
            origin: self.origin,
            rounding: self.rounding,
            bounds: self.bounds,
            tally: Tally::default(),
            warnings: Vec::new(),
            provenance: Provenance::default(),
        })
    }
}

/// Reads the whole of `path`.
pub(crate) fn run(path: &Path, settings: &Settings, context: &Context<'_>) -> Result<Source, BuildError> {
    let options = Options {
        invalid: if settings.drop_invalid { Invalid::Drop } else { Invalid::Refuse },
        normals: settings.normals,
        colors: settings.colors,
    };
    let mut input = Input::open(path, options, &context.store)?;
    let format = input.vertex_format();
    let (vertices, faces) =
        input.declared().map_or((0, 0), |(vertices, faces)| (vertices as usize, faces as usize));

    let store = &context.store;
    // A header may promise more than the file holds: no array starts larger than the source could fill.
    let source_len = std::fs::metadata(path).map_or(0, |m| m.len()) as usize;
    let (vertices, faces) = (vertices.min(source_len), faces.min(source_len));
    let vertex_len =
        12 + if format.attributes.normals { 12 } else { 0 } + if format.attributes.colors { 4 } else { 0 };
    let disk = allowance::disk(vertices as u64, faces as u64, vertex_len);
    // Checkpoints have all arrays on disk, also those in memory.
    let in_memory = if store.workdir.is_resumable() { 0 } else { store.budget.limit() };
    store.workdir.require(disk.saturating_sub(in_memory))?;
    let mut arrays = Arrays {
        singles: BufferWriter::new(store, POSITIONS, if format.double { 0 } else { vertices })?,
        doubles: BufferWriter::new(store, POSITIONS, if format.double { vertices } else { 0 })?,
        normals: BufferWriter::new(store, NORMALS, if format.attributes.normals { vertices } else { 0 })?,
        colors: BufferWriter::new(store, COLORS, if format.attributes.colors { vertices } else { 0 })?,
        triangles: BufferWriter::new(store, TRIANGLES, faces)?,
        bounds: Bounds::default(),
        single_bounds: Aabb::EMPTY,
    };
    arrays.fill(&mut input, context)?;
    let Arrays { singles, doubles, normals, colors, triangles, bounds, single_bounds } = arrays;

    let input::Read { provenance, tally, mut warnings } = input.finish()?;
    if triangles.is_empty() {
        return Err(BuildError::Empty { path: path.to_owned(), faces: provenance.face_count });
    }

    let origin = if format.double { bounds.origin() } else { [0.0; 3] };
    let (positions, bounds, rounding) = if format.double {
        let doubles = doubles.finish_column()?;
        let (positions, bounds, rounding) = to_origin(context, &doubles, origin)?;
        if rounding > 0.0 {
            warnings.push(format!(
                "double coordinates were rounded to 24 bits about the origin {origin:?}: by at most {rounding:.3e}"
            ));
        }
        (positions, bounds, rounding)
    } else {
        (singles.finish_column()?, single_bounds, 0.0)
    };
    Ok(Source {
        positions,
        normals: format.attributes.normals.then(|| normals.finish_column()).transpose()?,
        colors: format.attributes.colors.then(|| colors.finish_column()).transpose()?,
        triangles: triangles.finish_column()?,
        origin,
        bounds,
        rounding,
        tally,
        warnings,
        provenance,
    })
}

/// The arrays while they grow.
struct Arrays {
    singles: BufferWriter<[f32; 3]>,
    doubles: BufferWriter<[f64; 3]>,
    normals: BufferWriter<[f32; 3]>,
    colors: BufferWriter<[u8; 4]>,
    triangles: BufferWriter<[u32; 3]>,
    bounds: Bounds,
    single_bounds: Aabb,
}

impl Arrays {
    /// Takes all that the input has. Reading is this thread's work and storing another's: arrays on disk cost as much time as
    /// the source does.
    fn fill(&mut self, input: &mut Input, context: &Context<'_>) -> Result<(), BuildError> {
        std::thread::scope(|scope| {
            let (full, filled) = mpsc::sync_channel::<Batch>(1);
            let (empty, emptied) = mpsc::channel();
            let storing = scope.spawn(move || {
                filled.into_iter().try_for_each(|batch| {
                    self.take(&batch)?;
                    // Whoever reads may have ended.
                    let _ = empty.send(batch);
                    Ok(())
                })
            });
            let mut read = || -> Result<(), BuildError> {
                loop {
                    context.check()?;
                    let before = input.bytes_read();
                    let mut batch = emptied.try_recv().unwrap_or_default();
                    if input.next_batch(&mut batch)? == BatchKind::End || full.send(batch).is_err() {
                        return Ok(());
                    }
                    context.progress.advance(input.bytes_read() - before);
                }
            };
            let read = read();
            drop(full);
            let stored = storing.join().unwrap_or_else(|panic| resume_unwind(panic));
            stored.and(read)
        })
    }

    fn take(&mut self, batch: &Batch) -> Result<(), BuildError> {
        self.bounds.add(batch);
        self.single_bounds.merge(&Aabb::of_points(&batch.positions));
        self.singles.extend_from_slice(&batch.positions)?;
        self.doubles.extend_from_slice(&batch.positions_f64)?;
        self.normals.extend_from_slice(&batch.normals)?;
        self.colors.extend_from_slice(&batch.colors)?;
        Ok(self.triangles.extend_from_slice(&batch.triangles)?)
    }
}

/// Bytes of work that ingest will report.
pub(crate) fn work(path: &Path) -> u64 {
    let len = |path: &PathBuf| std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    input::files(path).map_or(0, |files| files.iter().map(len).sum())
}

/// Bounds of double coordinates, and whether all of them are f32 values anyway.
#[derive(Default)]
struct Bounds {
    range: Option<[(f64, f64); 3]>,
    rounds: bool,
}

impl Bounds {
    fn add(&mut self, batch: &Batch) {
        for p in &batch.positions_f64 {
            let range = self.range.get_or_insert(p.map(|x| (x, x)));
            for (range, x) in range.iter_mut().zip(p) {
                *range = (range.0.min(*x), range.1.max(*x));
                self.rounds |= f64::from(*x as f32) != *x;
            }
        }
    }

    /// The middle, or zero where nothing would be gained. The result is an f32 value, so that a reader may use it as one.
    fn origin(&self) -> [f64; 3] {
        match self.range {
            Some(range) if self.rounds => range.map(|(low, high)| f64::from((0.5 * low + 0.5 * high) as f32)),
            _ => [0.0; 3],
        }
    }
}

/// Positions relative to the origin, their bounds, and the largest rounding of a coordinate.
fn to_origin(
    context: &Context<'_>,
    doubles: &Column<[f64; 3]>,
    origin: [f64; 3],
) -> Result<(Column<[f32; 3]>, Aabb, f64), BuildError> {
    const STEP: usize = 1 << 14;
    let mut out = BufferWriter::new(&context.store, POSITIONS, doubles.len())?;
    let mut rounding = 0.0f64;
    let mut bounds = Aabb::EMPTY;
    let (mut local, mut scratch) = (Vec::new(), Vec::new());
    for start in (0..doubles.len()).step_by(STEP) {
        context.check()?;
        let chunk = doubles.read(start..doubles.len().min(start + STEP), &mut scratch)?;
        local.clear();
        local.extend(chunk.iter().map(|p| {
            std::array::from_fn::<f32, 3, _>(|axis| {
                let exact = p[axis] - origin[axis];
                let stored = exact as f32;
                rounding = rounding.max((f64::from(stored) - exact).abs());
                stored
            })
        }));
        bounds.merge(&Aabb::of_points(&local));
        out.extend_from_slice(&local)?;
    }
    Ok((out.finish_column()?, bounds, rounding))
}

/// Counts that ingest found, as the repair report wants them.
pub(crate) fn repairs(tally: &Tally) -> crate::report::Repairs {
    crate::report::Repairs {
        degenerate_faces: tally.degenerate_faces,
        polygons_triangulated: tally.polygons_triangulated,
        dropped_faces: tally.dropped_faces,
        dropped_vertices: tally.dropped_vertices,
        missing_faces: tally.missing_faces,
        ..Default::default()
    }
}
