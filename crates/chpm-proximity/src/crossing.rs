//! Where a source meets itself.

use crate::cross;
use crate::error::ProximityError;
use crate::model::Model;
use crate::pose::{Between, Pose};
use chpm_mesh::{Aabb, ClusterId};

/// Two triangles of the source that have a point in common and no vertex: their clusters, their places there and their corners.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Crossing {
    /// Leaf clusters.
    pub clusters: [ClusterId; 2],
    /// Which of their triangles.
    pub triangles: [u32; 2],
    /// Their corners, relative to the file's origin.
    pub corners: [[[f32; 3]; 3]; 2],
}

/// Tells every pair of triangles of the leaves that meet and have no vertex in common. Exact; in the memory of the pages that a model may keep.
/// Answers whether it came to the end; `go_on` is asked before every cluster.
///
/// # Errors
/// A damaged page; what `found` answers.
pub fn crossings<D: AsRef<[u8]>, X: From<ProximityError>>(
    model: &mut Model<'_, D>,
    found: &mut dyn FnMut(&Crossing) -> Result<(), X>,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<bool, X> {
    let clusters = model.file().clusters();
    let mut leaves: Vec<(Aabb, ClusterId)> = (0..)
        .map(ClusterId)
        .zip(clusters)
        .filter(|(_, record)| record.is_leaf())
        .map(|(id, record)| (record.aabb(), id))
        .collect();
    leaves.sort_by(|a, b| a.0.min[0].total_cmp(&b.0.min[0]).then(a.1.cmp(&b.1)));
    let frame = model.frame(&Pose::IDENTITY);
    let still = Between::new(&frame, &frame);
    // Leaves in the order in which they begin along an axis; those that a leaf may meet begin before it ends.
    for (at, (bounds, x)) in leaves.iter().enumerate() {
        if !go_on() {
            return Ok(false);
        }
        for (other, y) in &leaves[at..] {
            if other.min[0] > bounds.max[0] {
                break;
            }
            let apart =
                (1..3).any(|axis| other.min[axis] > bounds.max[axis] || bounds.min[axis] > other.max[axis]);
            if apart {
                continue;
            }
            let (p, q) = (model.patch(*x)?, model.patch(*y)?);
            let mut pairs = Vec::new();
            p.pairs_within(&q, &still, still.margin, &mut |i, j| {
                let is_one = x == y;
                if (!is_one || i < j)
                    && !p.has_common_vertex(i, &q, j, is_one)
                    && cross::meet(p.corners_of(i), q.corners_of(j))
                {
                    pairs.push((i, j));
                }
            });
            for (i, j) in pairs {
                found(&Crossing {
                    clusters: [*x, *y],
                    triangles: [p.place(i), q.place(j)],
                    corners: [*p.corners_of(i), *q.corners_of(j)],
                })?;
            }
        }
    }
    Ok(true)
}
