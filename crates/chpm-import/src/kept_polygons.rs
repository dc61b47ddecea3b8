//! Faces of more than three corners: kept until all vertices are known, and then cut into triangles.

use crate::polygon::{self, Polygons, Triangulator};
use chpm_extmem::{BufferWriter, Cancel, Cancelled, ExtmemError, Store};

/// Numbers of polygons that are read at once; a larger polygon is read by itself.
const WINDOW: usize = 1 << 16;

/// The polygons of a source, in memory or on disk.
pub struct KeptPolygons(BufferWriter<u32>);

impl KeptPolygons {
    /// None yet.
    ///
    /// # Errors
    /// Those of the store, as of all that it does.
    pub fn new(store: &Store) -> Result<Self, ExtmemError> {
        Ok(KeptPolygons(BufferWriter::new(store, "polygons", 0)?))
    }

    /// Takes those of a batch.
    ///
    /// # Errors
    /// Those of the store.
    pub fn add(&mut self, polygons: &Polygons) -> Result<(), ExtmemError> {
        self.0.extend_from_slice(polygons.as_words())
    }

    /// Hands the triangles of all polygons to `take`, some at a time; `place` tells where a vertex is. Returns how many triangles have two
    /// corners in one vertex and are left out.
    ///
    /// # Errors
    /// Those of the store, of `place` and `take`, and a wish to stop.
    pub fn cut<E: From<ExtmemError> + From<Cancelled>>(
        self,
        cancel: &Cancel,
        mut place: impl FnMut(u32) -> Result<[f64; 3], E>,
        mut take: impl FnMut(&[[u32; 3]]) -> Result<(), E>,
    ) -> Result<u64, E> {
        let words = self.0.finish_column()?;
        let (mut triangulator, mut triangles, mut degenerate) = (Triangulator::default(), Vec::new(), 0);
        let (mut at, mut scratch, mut places) = (0, Vec::new(), Vec::new());

        while at < words.len() {
            cancel.check()?;
            let mut window = words.read(at..words.len().min(at + WINDOW), &mut scratch)?;
            let first = 1 + window[0] as usize;
            if first > window.len() {
                window = words.read(at..at + first, &mut scratch)?;
            }

            for corners in polygon::each(window) {
                at += 1 + corners.len();
                places.clear();
                if corners.len() <= Triangulator::EARS {
                    for corner in corners {
                        places.push(place(*corner)?);
                    }
                }
                degenerate += triangulator.cut(corners, &places, &mut triangles);
            }

            take(&triangles)?;
            triangles.clear();
        }
        Ok(degenerate)
    }
}
