//! Intake: what a source has becomes arrays while it is read. One thread reads, and those of the pool note facts and store, a round of batches at
//! a time: so what the system does for memory that is touched for the first time is shared, too.

use super::texels::Texels;
use super::triangles::TriangleWriter;
use super::used::Used;
use crate::allowance;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use crate::trace::Phase;
use crate::vertex_columns::{POSITIONS, VertexWriter};
use chpm_extmem::{BufferWriter, Store};
use chpm_import::ply::{Batch, BatchKind};
use chpm_import::{CornerNormals, Input, KeptPolygons};
use chpm_mesh::{Aabb, Attributes};
use rayon::prelude::*;
use std::panic::resume_unwind;
use std::sync::mpsc::{self, Receiver, SyncSender};

/// The arrays while they grow.
pub(super) struct Arrays {
    /// Positions are here or in `doubles`.
    pub(super) vertices: VertexWriter,
    pub(super) doubles: BufferWriter<[f64; 3]>,
    pub(super) triangles: TriangleWriter,
    pub(super) polygons: KeptPolygons,
    /// Of formats that give them to corners.
    pub(super) corner_normals: Option<CornerNormals>,
    /// Of sources with images.
    pub(super) texels: Option<Texels>,
    has_colors: bool,
    /// Whether textured triangles are kept.
    pub(super) keeps_wedges: bool,
    store: Store,
}

/// Facts that are noted of the vertices before they are stored.
pub(super) struct Marks {
    /// How many there were.
    count: usize,
    /// Of all singles.
    pub(super) bounds: Aabb,
    pub(super) used: Used,
    pub(super) far: BufferWriter<Far>,
}

/// A vertex that is far from zero: its number, byte offset, line (0 where there are none) and the bits of its coordinate.
pub(super) type Far = [u64; 4];

impl Arrays {
    /// Arrays for what the header declares, once it is sure that the disk has room for it.
    pub(super) fn expecting(
        input: &Input,
        source_len: u64,
        kept: Attributes,
        context: &Context<'_>,
    ) -> Result<Self, BuildError> {
        let store = &context.store;
        let format = input.vertex_format();
        // A header may promise more than the file holds: no array starts larger than the source could fill.
        let (vertices, faces) = input.declared().unwrap_or((0, 0));
        let (vertices, faces) = (vertices.min(source_len), faces.min(source_len));

        let disk = allowance::disk(vertices, faces, kept.vertex_len() as u64);
        // Checkpoints have all arrays on disk, also those in memory.
        let in_memory = if store.workdir.is_resumable() { 0 } else { store.budget.limit() };
        store.workdir.require(disk.saturating_sub(in_memory))?;

        let (vertices, faces) = (vertices as usize, faces as usize);
        let (singles, doubles) = match format.coordinates.are_double() {
            true => (0, vertices),
            false => (vertices, 0),
        };
        Ok(Arrays {
            vertices: VertexWriter::new(store, format.attributes, vertices, singles)?,
            doubles: BufferWriter::new(store, POSITIONS, doubles)?,
            triangles: TriangleWriter::new(context.ids, store, faces)?,
            polygons: KeptPolygons::new(store)?,
            corner_normals: None,
            texels: None,
            has_colors: format.attributes.colors,
            keeps_wedges: false,
            store: store.clone(),
        })
    }

    /// Takes all that the input has. Reading is a thread's work beside the pool, so that it goes on while what came before is stored.
    pub(super) fn fill(
        &mut self,
        marks: &mut Marks,
        input: &mut Input,
        context: &Context<'_>,
    ) -> Result<(), BuildError> {
        // A batch for each thread. Three rounds are there at a time: one is read, one waits, and one is stored.
        let len = rayon::current_num_threads();
        let phase = context.trace.phase();
        std::thread::scope(|scope| {
            let (full, rounds) = mpsc::sync_channel::<Vec<Batch>>(1);
            let (empty, emptied) = mpsc::channel();
            let reading = scope.spawn(move || {
                let _traced = phase.task("read");
                read(input, len, &full, &emptied, context)
            });

            let taken = rounds.iter().try_for_each(|round| {
                context.check()?;
                marks.take(&round, phase)?;
                self.take(&round, context, phase)?;
                // Whoever reads may have ended.
                round.into_iter().for_each(|batch| drop(empty.send(batch)));
                Ok(())
            });

            // Without a receiver reading ends. The error of what came first is told.
            drop(rounds);
            taken.and(reading.join().unwrap_or_else(|panic| resume_unwind(panic)))
        })
    }

    fn take(&mut self, round: &[Batch], context: &Context<'_>, phase: Phase<'_>) -> Result<(), BuildError> {
        let mut count = self.vertices.len() + self.doubles.len();
        let vertices: Vec<_> = round.iter().map(|batch| batch.vertices.view()).collect();
        self.vertices.extend_from_slices(&vertices, phase)?;
        let doubles: Vec<_> = round.iter().map(|batch| &batch.positions_f64[..]).collect();
        self.doubles.extend_from_slices(&doubles, || phase.task("store"))?;
        // A face may come before its vertices.
        let based = round.iter().map(|batch| batch.base as usize).max().filter(|base| *base > 0);
        let most = based.map_or(0, |base| base + u32::MOST).max(self.vertices.len() + self.doubles.len());
        self.triangles.fit(most, context)?;
        self.triangles.extend(round, phase)?;

        for batch in round {
            count += batch.vertices.positions.len() + batch.positions_f64.len();
            self.take_rest(batch, count)?;
        }
        Ok(())
    }

    /// Takes what few sources have, of a batch up to whose end there are so many vertices.
    fn take_rest(&mut self, batch: &Batch, vertices: usize) -> Result<(), BuildError> {
        self.polygons.add(&batch.polygons)?;
        if !batch.listed_normals.is_empty() || !batch.corner_normals.is_empty() {
            let normals = match self.corner_normals.take() {
                Some(normals) => normals,
                None => CornerNormals::new(&self.store)?,
            };
            self.corner_normals.insert(normals).take(batch)?;
        }
        if !batch.textured.is_empty() {
            let texels = match self.texels.take() {
                Some(texels) => texels,
                None => Texels::new(&self.store, self.has_colors, self.keeps_wedges)?,
            };
            self.texels.insert(texels).take(&batch.textured, vertices)?;
        }
        Ok(())
    }
}

/// Sends rounds of `len` batches until the input ends or nobody takes them. Batches that come back are filled again.
fn read(
    input: &mut Input,
    len: usize,
    full: &SyncSender<Vec<Batch>>,
    emptied: &Receiver<Batch>,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    let mut round = Vec::with_capacity(len);
    loop {
        context.check()?;
        let before = input.bytes_read();
        let mut batch = emptied.try_recv().unwrap_or_default();
        let has_ended = input.next_batch(&mut batch)? == BatchKind::End;
        context.progress.advance(input.bytes_read() - before);
        if !has_ended {
            round.push(batch);
        }
        if has_ended || round.len() == len {
            let is_taken = full.send(std::mem::take(&mut round)).is_ok();
            if has_ended || !is_taken {
                return Ok(());
            }
        }
    }
}

impl Marks {
    pub(super) fn new(store: &Store) -> Result<Self, BuildError> {
        Ok(Marks {
            count: 0,
            bounds: Aabb::EMPTY,
            used: Used::new(store)?,
            far: BufferWriter::new(store, "vertices far from zero", 0)?,
        })
    }

    fn take(&mut self, round: &[Batch], phase: Phase<'_>) -> Result<(), BuildError> {
        let came: usize =
            round.iter().map(|batch| batch.vertices.positions.len() + batch.positions_f64.len()).sum();
        self.count += came;
        if round.iter().any(|batch| !batch.triangles.is_empty()) {
            self.used.expect(self.count)?;
        }
        let used = &self.used;
        let boxes = round.par_iter().map(|batch| {
            let _traced = phase.task("mark");
            used.mark(&batch.triangles, batch.base as usize);
            Aabb::of_points(&batch.vertices.positions)
        });
        // One after another, as a box about all would grow.
        boxes.collect::<Vec<_>>().iter().for_each(|aabb| self.bounds.merge(aabb));
        round.iter().try_for_each(|batch| self.note_far(batch))
    }

    fn note_far(&mut self, batch: &Batch) -> Result<(), BuildError> {
        for place in &batch.far {
            let at = (place.index - batch.first) as usize;
            let single = || batch.vertices.positions.get(at).map(|p| p.map(f64::from));
            let position = batch.positions_f64.get(at).copied().or_else(single).unwrap_or_default();
            let value =
                position.into_iter().fold(0.0, |far: f64, x| if x.abs() > far.abs() { x } else { far });
            self.far.extend_from_slice(&[[
                place.index,
                place.offset,
                place.line.unwrap_or(0),
                value.to_bits(),
            ]])?;
        }
        Ok(())
    }
}
