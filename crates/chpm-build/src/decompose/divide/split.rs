//! Regions that came out too large are cut: those of a vertex that thousands of triangles have, or whose triangles have their corners all over.

use super::super::homes::{Homes, REGION_LEAVES};
use super::super::size::{TRIANGLE_COST, VERTEX_COST};
use super::route::Routed;
use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;

/// Ranges that triangles are counted in.
const BINS: usize = 1 << 16;

/// Bytes that a region may take by its triangles and the vertices that they have from other regions: three times what usual ones take
/// for triangles.
fn limit(settings: &Settings) -> u64 {
    3 * TRIANGLE_COST * u64::from(REGION_LEAVES * settings.cluster_triangles.max(16))
}

/// Whether a region of so many triangles, which have so many corners from others, is to be cut.
pub(crate) fn is_too_large(triangles: u64, uses: u64, settings: &Settings) -> bool {
    TRIANGLE_COST * triangles + VERTEX_COST * uses > limit(settings)
}

impl<I: Id> Routed<I> {
    /// Sends the triangles of regions that are too large to regions of their own, which have no vertices at home.
    pub(crate) fn split(
        &mut self,
        homes: &Homes,
        settings: &Settings,
        context: &Context<'_>,
    ) -> Result<(), BuildError> {
        let most = limit(settings) / (TRIANGLE_COST + 3 * VERTEX_COST);
        for home in 0..homes.count() {
            if is_too_large(self.triangles.len(home) as u64, self.uses[home], settings) {
                self.split_home(home, most.max(1), homes, context)?;
            }
        }
        Ok(())
    }

    /// Cuts by the sum of the vertices' numbers: numbers go by place, so that pieces hang together, and copies stay together.
    fn split_home(
        &mut self,
        home: usize,
        most: u64,
        homes: &Homes,
        context: &Context<'_>,
    ) -> Result<(), BuildError> {
        let end = 3 * homes.vertex_count().max(1) as u64;

        // How many triangles each bin has, from a first look at all of them.
        let blocks = self.triangles.block_count(home);
        let mut block = Vec::new();
        let mut counts = vec![0u64; BINS];
        for number in 0..blocks {
            context.check()?;
            self.triangles.read_block(home, number, &mut block)?;
            block.iter().for_each(|triangle| counts[bin(triangle, end)] += 1);
        }

        // Bins that follow one another make up a piece, as many as fit; a piece is a region.
        let (mut held, mut pieces) = (most, Vec::with_capacity(BINS));
        for count in counts {
            if count > 0 && held + count > most {
                self.triangles.add();
                held = 0;
            }
            held += count;
            pieces.push(self.triangles.count() - 1);
        }

        // Regions of this kind have no vertices of their own: every corner is a visit.
        for number in 0..blocks {
            context.check()?;
            self.triangles.read_block(home, number, &mut block)?;
            for triangle in &block {
                let region = pieces[bin(triangle, end)];
                self.triangles.push(region, *triangle)?;
                for vertex in triangle {
                    self.visit(homes.of(vertex.index()), *vertex, region)?;
                }
            }
        }

        self.triangles.clear(home);
        self.was_split[home] = true;
        Ok(())
    }
}

fn bin<I: Id>(triangle: &[I; 3], end: u64) -> usize {
    let sum: u64 = triangle.iter().map(|v| v.index() as u64).sum();
    (sum * BINS as u64 / end) as usize
}
