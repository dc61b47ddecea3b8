//! Vertices that need not fit memory: what [`Vertices`] are, in columns. Whoever adds an attribute to those adds its column here.

use crate::error::BuildError;
use crate::trace::Phase;
use bytemuck::Pod;
use chpm_extmem::{BufferWriter, Column, ExtmemError, PartReader, PartWriter, Store};
use chpm_mesh::{Attributes, VertexSlices, Vertices};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Names of the columns, here and on disk.
pub(crate) const POSITIONS: &str = "positions";
pub(crate) const NORMALS: &str = "normals";
const COLORS: &str = "colors";
const SCALARS: &str = "scalars";

/// Vertices, a column for each attribute that they carry.
#[derive(Serialize, Deserialize)]
pub(crate) struct VertexColumns {
    pub(crate) positions: Column<[f32; 3]>,
    pub(crate) normals: Option<Column<[f32; 3]>>,
    pub(crate) colors: Option<Column<[u8; 4]>>,
    /// A column for each word of the named scalars.
    pub(crate) scalars: Vec<Column<u32>>,
}

/// An operation on every column of vertices, whatever its items are.
pub(crate) trait ColumnMap {
    /// Makes another column of one; `what` is what it is called.
    fn map<T: Pod + Send + Sync>(
        &self,
        column: Column<T>,
        what: &'static str,
    ) -> Result<Column<T>, BuildError>;
}

impl VertexColumns {
    /// Attributes of the vertices.
    pub(crate) fn attributes(&self) -> Attributes {
        Attributes {
            normals: self.normals.is_some(),
            octahedral: false,
            colors: self.colors.is_some(),
            scalar_words: self.scalars.len() as u8,
        }
    }

    /// Does the same to all columns, one after the other.
    pub(crate) fn map(self, by: &impl ColumnMap) -> Result<VertexColumns, BuildError> {
        Ok(VertexColumns {
            positions: by.map(self.positions, POSITIONS)?,
            normals: self.normals.map(|column| by.map(column, NORMALS)).transpose()?,
            colors: self.colors.map(|column| by.map(column, COLORS)).transpose()?,
            scalars: self
                .scalars
                .into_iter()
                .map(|column| by.map(column, SCALARS))
                .collect::<Result<_, _>>()?,
        })
    }

    /// Writes the columns to a part, one after another: of each what lies in some ranges.
    pub(crate) fn append_to<R: Iterator<Item = Range<usize>>>(
        &self,
        out: &mut PartWriter,
        ranges: &impl Fn() -> R,
    ) -> Result<(), BuildError> {
        fn append<T: Pod>(
            column: &Column<T>,
            mut ranges: impl Iterator<Item = Range<usize>>,
            out: &mut PartWriter,
        ) -> Result<(), ExtmemError> {
            ranges.try_for_each(|range| column.append_to(range, out))
        }
        append(&self.positions, ranges(), out)?;
        self.normals.iter().try_for_each(|column| append(column, ranges(), out))?;
        self.colors.iter().try_for_each(|column| append(column, ranges(), out))?;
        Ok(self.scalars.iter().try_for_each(|column| append(column, ranges(), out))?)
    }

    /// The columns of `count` vertices that were written so, from where a reader is.
    pub(crate) fn in_part(
        from: &mut PartReader,
        count: usize,
        carried: Attributes,
    ) -> Result<VertexColumns, BuildError> {
        Ok(VertexColumns {
            positions: from.column(POSITIONS, count)?,
            normals: carried.normals.then(|| from.column(NORMALS, count)).transpose()?,
            colors: carried.colors.then(|| from.column(COLORS, count)).transpose()?,
            scalars: (0..carried.scalar_words)
                .map(|_| from.column(SCALARS, count))
                .collect::<Result<_, _>>()?,
        })
    }

    /// The vertices of a range: those in memory as they are, those on disk read into `scratch`.
    pub(crate) fn read<'a>(
        &'a self,
        range: Range<usize>,
        scratch: &'a mut Vertices,
    ) -> Result<VertexSlices<'a>, BuildError> {
        let mut slices = VertexSlices::new(self.positions.read(range.clone(), &mut scratch.positions)?);
        if let Some(normals) = &self.normals {
            slices.normals = normals.read(range.clone(), &mut scratch.normals)?;
        }
        if let Some(colors) = &self.colors {
            slices.colors = colors.read(range.clone(), &mut scratch.colors)?;
        }
        slices.scalars = self.read_scalars(range, &mut scratch.scalars)?;
        Ok(slices)
    }

    /// The words of a range of vertices, vertex by vertex.
    pub(crate) fn read_scalars<'a>(
        &self,
        range: Range<usize>,
        rows: &'a mut Vec<u32>,
    ) -> Result<&'a [u32], BuildError> {
        let (words, mut scratch) = (self.scalars.len(), Vec::new());
        rows.clear();
        rows.resize(words * range.len(), 0);
        for (word, column) in self.scalars.iter().enumerate() {
            let items = column.read(range.clone(), &mut scratch)?;
            rows.iter_mut().skip(word).step_by(words).zip(items).for_each(|(place, item)| *place = *item);
        }
        Ok(rows)
    }
}

/// [`VertexColumns`] while vertices come.
pub(crate) struct VertexWriter {
    positions: BufferWriter<[f32; 3]>,
    normals: BufferWriter<[f32; 3]>,
    colors: BufferWriter<[u8; 4]>,
    scalars: Vec<BufferWriter<u32>>,
    carried: Attributes,
}

impl VertexWriter {
    /// Expects `count` vertices, and as many single positions as `singles`; more or fewer may come.
    pub(crate) fn new(
        store: &Store,
        carried: Attributes,
        count: usize,
        singles: usize,
    ) -> Result<Self, BuildError> {
        fn expected(is_carried: bool, count: usize) -> usize {
            if is_carried { count } else { 0 }
        }
        Ok(VertexWriter {
            positions: BufferWriter::new(store, POSITIONS, singles)?,
            normals: BufferWriter::new(store, NORMALS, expected(carried.normals, count))?,
            colors: BufferWriter::new(store, COLORS, expected(carried.colors, count))?,
            scalars: (0..carried.scalar_words)
                .map(|_| BufferWriter::new(store, SCALARS, count))
                .collect::<Result<_, _>>()?,
            carried,
        })
    }

    /// Positions so far.
    pub(crate) fn len(&self) -> usize {
        self.positions.len()
    }

    /// Appends batches of vertices, copied side by side.
    pub(crate) fn extend_from_slices(
        &mut self,
        batches: &[VertexSlices<'_>],
        phase: Phase<'_>,
    ) -> Result<(), BuildError> {
        let copied = || phase.task("store");
        fn each<'a, T>(
            batches: &[VertexSlices<'a>],
            of: impl Fn(&VertexSlices<'a>) -> &'a [T],
        ) -> Vec<&'a [T]> {
            batches.iter().map(of).collect()
        }
        self.positions.extend_from_slices(&each(batches, |batch| batch.positions), copied)?;
        self.normals.extend_from_slices(&each(batches, |batch| batch.normals), copied)?;
        self.colors.extend_from_slices(&each(batches, |batch| batch.colors), copied)?;
        let words = self.scalars.len();
        for (word, writer) in self.scalars.iter_mut().enumerate() {
            let column = |batch: &VertexSlices<'_>| -> Vec<u32> {
                batch.scalars.iter().skip(word).step_by(words).copied().collect()
            };
            let columns: Vec<Vec<u32>> = batches.par_iter().map(column).collect();
            let columns: Vec<&[u32]> = columns.iter().map(Vec::as_slice).collect();
            writer.extend_from_slices(&columns, copied)?;
        }
        Ok(())
    }

    pub(crate) fn finish(self) -> Result<VertexColumns, BuildError> {
        let VertexWriter { positions, normals, colors, scalars, carried } = self;
        Ok(VertexColumns {
            positions: positions.finish_column()?,
            normals: carried.normals.then(|| normals.finish_column()).transpose()?,
            colors: carried.colors.then(|| colors.finish_column()).transpose()?,
            scalars: scalars.into_iter().map(BufferWriter::finish_column).collect::<Result<_, _>>()?,
        })
    }
}

#[cfg(test)]
impl VertexColumns {
    /// The columns of vertices in memory.
    pub(crate) fn of(vertices: VertexSlices<'_>, store: &Store) -> VertexColumns {
        use crate::trace::Trace;
        let count = vertices.positions.len();
        let mut writer = VertexWriter::new(store, vertices.attributes(), count, count).unwrap();
        writer.extend_from_slices(&[vertices], Trace::default().phase()).unwrap();
        writer.finish().unwrap()
    }
}
