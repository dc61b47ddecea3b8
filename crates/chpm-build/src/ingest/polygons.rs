//! Faces of more than three corners: kept until all vertices are known, and then cut into triangles.

use crate::context::Context;
use crate::error::BuildError;
use bytemuck::Pod;
use chpm_extmem::{BufferWriter, Cached, Column, Store};
use chpm_import::{Triangulator, polygon};

/// Numbers of polygons that are read at once; a larger polygon is read by itself.
const WINDOW: usize = 1 << 16;

/// The polygons of a source, as [`chpm_import::Polygons`] has them.
pub(super) struct Faces(BufferWriter<u32>);

impl Faces {
    pub(super) fn new(store: &Store) -> Result<Self, BuildError> {
        Ok(Faces(BufferWriter::new(store, "polygons", 0)?))
    }

    pub(super) fn add(&mut self, polygons: &chpm_import::Polygons) -> Result<(), BuildError> {
        Ok(self.0.extend_from_slice(polygons.as_words())?)
    }

    /// Hands the triangles of all polygons to `take`, some at a time. Returns how many triangles have two corners in one vertex
    /// and are left out.
    pub(super) fn cut<T: Pod + Into<f64>>(
        self,
        positions: &Column<[T; 3]>,
        context: &Context<'_>,
        mut take: impl FnMut(&[[u32; 3]]) -> Result<(), BuildError>,
    ) -> Result<u64, BuildError> {
        let words = self.0.finish_column()?;
        let mut positions = Cached::new(positions);
        let (mut triangulator, mut triangles, mut degenerate) = (Triangulator::default(), Vec::new(), 0);
        let (mut at, mut scratch, mut corner_positions) = (0, Vec::new(), Vec::new());

        while at < words.len() {
            context.check()?;
            let mut window = words.read(at..words.len().min(at + WINDOW), &mut scratch)?;
            let first = 1 + window[0] as usize;
            if first > window.len() {
                window = words.read(at..at + first, &mut scratch)?;
            }

            for corners in polygon::each(window) {
                at += 1 + corners.len();
                corner_positions.clear();
                if corners.len() <= Triangulator::EARS {
                    for corner in corners {
                        // Zero if there is none, as it is for all that comes after.
                        let position = positions.get(*corner as usize)?;
                        corner_positions.push(position.map_or([0.0; 3], |p| p.map(Into::into)));
                    }
                }
                degenerate += triangulator.cut(corners, &corner_positions, &mut triangles);
            }

            take(&triangles)?;
            triangles.clear();
        }
        Ok(degenerate)
    }
}
