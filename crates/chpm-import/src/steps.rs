//! Where a range grid jumps in depth, its neighbours are no neighbours on the surface: such triangles are left out.

use crate::batch::Batch;
use chpm_extmem::{Buffer, BufferWriter, ExtmemError, Store};
use chpm_mesh::Counted;

/// A triangle whose longest edge is more than so many times its shortest hangs across a step. Samples of a surface that is seen at
/// 80 degrees from its normal are 5.8 times as far from each other along the slope as across it.
const RATIO: f64 = 6.0;

/// The positions of a grid, to measure its triangles with.
pub(crate) enum Steps {
    Coming(BufferWriter<[f32; 3]>),
    Known { positions: Buffer<[f32; 3]>, left_out: u64 },
}

impl Steps {
    pub(crate) fn new(store: &Store) -> Result<Self, ExtmemError> {
        Ok(Steps::Coming(BufferWriter::new(store, "samples of a range grid", 0)?))
    }

    /// Takes vertices.
    pub(crate) fn vertices(&mut self, batch: &Batch) -> Result<(), ExtmemError> {
        if let Steps::Coming(writer) = self {
            writer.extend_from_slice(&batch.vertices.positions)?;
            let singles: Vec<[f32; 3]> = batch.positions_f64.iter().map(|p| p.map(|x| x as f32)).collect();
            writer.extend_from_slice(&singles)?;
        }
        Ok(())
    }

    /// Removes triangles across steps; those of vertices that come later are kept, since nothing is known of them.
    pub(crate) fn triangles(self, batch: &mut Batch) -> Result<Self, ExtmemError> {
        let (positions, mut left_out) = match self {
            Steps::Coming(writer) => (writer.finish()?, 0),
            Steps::Known { positions, left_out } => (positions, left_out),
        };
        let before = batch.triangles.len();
        batch.triangles.retain(|corners| {
            let corners = corners.map(|v| positions.get(v as usize));
            let [Some(a), Some(b), Some(c)] = corners else { return true };
            !is_step(*a, *b, *c)
        });
        left_out += (before - batch.triangles.len()) as u64;
        Ok(Steps::Known { positions, left_out })
    }

    /// Count of the cells that were left out, in words.
    pub(crate) fn warning(&self) -> Option<String> {
        match self {
            Steps::Known { left_out, .. } if *left_out > 0 => Some(format!(
                "left out {} across steps in depth",
                Counted(*left_out, "triangle of the range grid")
            )),
            _ => None,
        }
    }
}

fn is_step(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> bool {
    // In double precision, so that no unit is too large or small to be squared.
    fn square(a: [f32; 3], b: [f32; 3]) -> f64 {
        a.iter().zip(b).map(|(x, y)| (f64::from(*x) - f64::from(y)).powi(2)).sum::<f64>()
    }
    let edges = [square(a, b), square(b, c), square(c, a)];
    let (short, long) = edges.iter().fold((f64::INFINITY, 0.0f64), |(s, l), e| (s.min(*e), l.max(*e)));
    long > RATIO * RATIO * short
}
