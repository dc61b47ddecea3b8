//! Normals that a source gives to corners of faces: vertices get them if each has just one.

use crate::batch::Batch;
use crate::error::SourceError;
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{BufferWriter, Cancel, Column, Sorted, Sorter, Store};
use chpm_mesh::Counted;

/// Pairs that are remembered, so that corners of one vertex that lie together count once.
const RECENT: usize = 1 << 12;
/// Normals that are read at once.
const WINDOW: usize = 1 << 14;
/// Vertices and normals after which a wish to stop is looked for.
const HEED: u64 = 1 << 14;

/// Normals by vertex, or in words why there are none.
pub type Joined = (Option<Column<[f32; 3]>>, Option<String>);

/// Normals of corners, in the order of the source.
pub struct CornerNormals {
    values: BufferWriter<[f32; 3]>,
    /// The number of a normal, and below it that of a vertex.
    pairs: Sorter<u64>,
    recent: Vec<u64>,
}

impl CornerNormals {
    /// None yet.
    ///
    /// # Errors
    /// Those of the store, as of all that it does.
    pub fn new(store: &Store) -> Result<Self, SourceError> {
        let values = BufferWriter::new(store, "normals of corners", 0)?;
        let pairs = Sorter::new(store, "normals of corners");
        Ok(CornerNormals { values, pairs, recent: vec![u64::MAX; RECENT] })
    }

    /// Takes those of a batch.
    ///
    /// # Errors
    /// Those of the store.
    pub fn take(&mut self, batch: &Batch) -> Result<(), SourceError> {
        self.values.extend_from_slice(&batch.listed_normals)?;
        for [vertex, normal] in &batch.corner_normals {
            let pair = u64::from(*normal) << 32 | u64::from(*vertex);
            let recent = &mut self.recent[*vertex as usize % RECENT];
            if *recent != pair {
                *recent = pair;
                self.pairs.push(pair)?;
            }
        }
        Ok(())
    }

    /// The normals of all vertices, zero for those that no face uses; or none, and in words why they cannot be had.
    ///
    /// # Errors
    /// Those of the store, and [`SourceError::Cancelled`].
    pub fn join(self, vertices: usize, store: &Store, cancel: &Cancel) -> Result<Joined, SourceError> {
        let count = self.values.len() as u64;
        if count == 0 {
            return Ok((None, None));
        }
        let dropped = |why: String| Ok((None, Some(format!("dropped {}, {why}", Counted(count, "normal")))));
        let Some(mut looks) = self.looks(store, cancel)? else {
            return dropped("since some corners of faces name none".to_owned());
        };

        // Looks are sorted by vertex, as vertices are: both are gone through side by side.
        let mut normals = BufferWriter::new(store, "normals", vertices)?;
        let (mut block, mut next, mut conflicts) = (Vec::with_capacity(WINDOW), looks.next()?, 0);
        for start in (0..vertices).step_by(WINDOW) {
            cancel.check().map_err(|_| SourceError::Cancelled)?;
            block.clear();
            for vertex in start..vertices.min(start + WINDOW) {
                let mut normal = None;
                let mut several = false;
                while let Some(look) = next.filter(|look| look.vertex() == vertex) {
                    several |= normal.is_some_and(|normal| normal != look.bits());
                    normal = Some(look.bits());
                    next = looks.next()?;
                }
                conflicts += u64::from(several);
                block.push(normal.unwrap_or_default().map(f32::from_bits));
            }
            normals.extend_from_slice(&block)?;
        }

        if conflicts > 0 {
            return dropped(format!("since there is more than one at {}", Counted(conflicts, "vertex")));
        }
        Ok((Some(normals.finish_column()?), None))
    }

    /// Normals of vertices, by vertex; none if a corner has none.
    fn looks(self, store: &Store, cancel: &Cancel) -> Result<Option<Sorted<Look>>, SourceError> {
        // By normal first, so that these are read front to back.
        let values = self.values.finish_column()?;
        let (mut pairs, mut looks) = (self.pairs.finish()?, Sorter::new(store, "normals by vertex"));
        let (mut first, mut window, mut scratch) = (0, &[][..], Vec::new());
        let mut taken = 0u64;
        while let Some(pair) = pairs.next()? {
            taken += 1;
            if taken.is_multiple_of(HEED) {
                cancel.check().map_err(|_| SourceError::Cancelled)?;
            }

            // That of a corner without any, too, is beyond them all.
            let normal = (pair >> 32) as usize;
            if normal >= values.len() {
                return Ok(None);
            }
            if normal >= first + window.len() {
                first = normal;
                window = values.read(first..values.len().min(first + WINDOW), &mut scratch)?;
            }
            looks.push(Look::new(pair as u32, window[normal - first]))?;
        }
        Ok(Some(looks.finish()?))
    }
}

/// A vertex, and the bits of a normal that one of its corners has.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(transparent)]
struct Look(u128);

impl Look {
    fn new(vertex: u32, normal: [f32; 3]) -> Self {
        // Adding zero takes the sign from a zero, and changes nothing else.
        let words = normal.map(|x| u128::from((x + 0.0).to_bits()));
        Look(words.into_iter().fold(u128::from(vertex), |look, word| look << 32 | word))
    }

    fn vertex(self) -> usize {
        (self.0 >> 96) as usize
    }

    fn bits(self) -> [u32; 3] {
        [(self.0 >> 64) as u32, (self.0 >> 32) as u32, self.0 as u32]
    }
}
