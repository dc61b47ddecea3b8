//! Triangles of a source while they come: by ids of 32 bits as long as these suffice.

use super::TRIANGLES;
use super::local::each;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::{Id, Ids, Triangles, Wide};
use crate::trace::Phase;
use chpm_extmem::{BufferWriter, Store};
use chpm_import::ply::Batch;
use rayon::prelude::*;

/// [`Triangles`] while they come.
pub(super) enum TriangleWriter {
    Narrow(BufferWriter<[u32; 3]>),
    Wide(BufferWriter<[Wide; 3]>),
}

impl TriangleWriter {
    /// Expects so many, with ids of that kind at first.
    pub(super) fn new(kind: Ids, store: &Store, expected: usize) -> Result<Self, BuildError> {
        Ok(match kind {
            Ids::Narrow => TriangleWriter::Narrow(BufferWriter::new(store, TRIANGLES, expected)?),
            Ids::Wide => TriangleWriter::Wide(BufferWriter::new(store, TRIANGLES, expected)?),
        })
    }

    /// Takes wider ids where those of so many vertices do not fit.
    pub(super) fn fit(&mut self, vertices: usize, context: &Context<'_>) -> Result<(), BuildError> {
        match self {
            TriangleWriter::Narrow(narrow) if vertices > u32::MOST => {
                let wide = BufferWriter::new(&context.store, TRIANGLES, narrow.len())?;
                let narrow = std::mem::replace(self, TriangleWriter::Wide(wide)).finish()?;
                let Triangles::Narrow(narrow) = narrow else { return Ok(()) };
                each(&narrow, context, |_, triangles| self.push(triangles))
            }
            _ => Ok(()),
        }
    }

    /// Appends the triangles of batches, which [`fit`](Self::fit).
    pub(super) fn extend(&mut self, round: &[Batch], phase: Phase<'_>) -> Result<(), BuildError> {
        fn all<I: Id>(
            writer: &mut BufferWriter<[I; 3]>,
            round: &[Batch],
            phase: Phase<'_>,
        ) -> Result<(), BuildError> {
            let ids = round.par_iter().map(|batch| {
                let _traced = phase.task("store");
                let id = |vertex: u32| I::of(batch.base as usize + vertex as usize);
                batch.triangles.iter().map(|triangle| triangle.map(id)).collect()
            });
            let ids: Vec<Vec<[I; 3]>> = ids.collect();
            let ids: Vec<&[[I; 3]]> = ids.iter().map(Vec::as_slice).collect();
            Ok(writer.extend_from_slices(&ids, || phase.task("store"))?)
        }
        match self {
            TriangleWriter::Narrow(writer) => {
                let triangles: Vec<_> = round.iter().map(|batch| &batch.triangles[..]).collect();
                Ok(writer.extend_from_slices(&triangles, || phase.task("store"))?)
            }
            TriangleWriter::Wide(writer) => all(writer, round, phase),
        }
    }

    /// Appends triangles whose vertices count from the first.
    pub(super) fn push(&mut self, triangles: &[[u32; 3]]) -> Result<(), BuildError> {
        fn all<I: Id>(writer: &mut BufferWriter<[I; 3]>, triangles: &[[u32; 3]]) -> Result<(), BuildError> {
            let ids = triangles.iter().map(|triangle| triangle.map(|vertex| I::of(vertex as usize)));
            Ok(writer.extend_from_slice(&ids.collect::<Vec<_>>())?)
        }
        match self {
            TriangleWriter::Narrow(writer) => Ok(writer.extend_from_slice(triangles)?),
            TriangleWriter::Wide(writer) => all(writer, triangles),
        }
    }

    pub(super) fn finish(self) -> Result<Triangles, BuildError> {
        Ok(match self {
            TriangleWriter::Narrow(writer) => Triangles::Narrow(writer.finish_column()?),
            TriangleWriter::Wide(writer) => Triangles::Wide(writer.finish_column()?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Trace;
    use chpm_extmem::{Cancel, Silent};

    #[test]
    fn ids_become_wider_when_there_are_too_many_vertices() {
        let dir = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let context = Context::new(Store::create(dir.path(), 0).unwrap(), pool, &Silent, Cancel::default());
        let batch =
            |base, triangles: &[[u32; 3]]| Batch { base, triangles: triangles.to_vec(), ..Batch::default() };
        let mut writer = TriangleWriter::new(Ids::Narrow, &context.store, 3).unwrap();
        writer.extend(&[batch(0, &[[0, 1, 2], [7, 8, 9]])], Trace::default().phase()).unwrap();
        writer.fit(u32::MOST, &context).unwrap();
        assert!(matches!(writer, TriangleWriter::Narrow(_)), "they still fit");
        writer.fit(u32::MOST + 1, &context).unwrap();
        let round = [batch(1 << 32, &[[5, 6, 7]]), batch(0, &[[u32::MAX, 1, 0]])];
        writer.extend(&round, Trace::default().phase()).unwrap();
        writer.push(&[[3, 2, 1]]).unwrap();
        let Triangles::Wide(triangles) = writer.finish().unwrap() else { panic!("of 32 bits") };
        let beyond = [5, 6, 7].map(|vertex| (1 << 32) + vertex);
        let expected = [[0, 1, 2], [7, 8, 9], beyond, [u32::MAX as usize, 1, 0], [3, 2, 1]];
        let expected = expected.map(|triangle| triangle.map(Wide::of));
        assert_eq!(triangles.read(0..5, &mut Vec::new()).unwrap(), expected);
    }
}
