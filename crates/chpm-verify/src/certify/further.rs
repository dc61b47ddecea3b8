//! A cut that somebody takes further than the file goes, and the proof of what comes of it.

use super::{Certifier, EFFORT};
use crate::error::VerifyError;
use chpm_extmem::{Cancel, MappedFile, Progress};
use chpm_format::Chpm;
use chpm_measure::Tiles;
use chpm_mesh::geom::round_up;
use chpm_mesh::{Aabb, Level, TriMesh, Vertices};
use chpm_refine::{Cut, extract};

/// Bytes that a triangle of the source takes meanwhile, about: itself, its vertices, and the faces that it is near to.
const SOURCE_BYTES: u64 = 96;
/// Bytes that a triangle of the cut takes, about: its vertices, quadrics, faces about each, and places in the queue.
const CUT_BYTES: u64 = 256;

/// Triangles in a tile.
const TILE: usize = 4096;

/// Bytes of `free` that are left beside a source and a cut of so many triangles.
///
/// # Errors
/// How many are missing.
pub fn room(free: u64, source: u64, cut: u64) -> Result<u64, u64> {
    let takes = SOURCE_BYTES.saturating_mul(source).saturating_add(CUT_BYTES.saturating_mul(cut));
    free.checked_sub(takes).ok_or_else(|| takes - free)
}

/// Surfaces and distance that whoever takes a cut further has to keep to.
pub struct Goal<'a> {
    /// Mesh of the cut.
    pub mesh: &'a TriMesh,
    /// The source.
    pub source: &'a Tiles<'a>,
    /// The same as one mesh.
    pub whole: &'a TriMesh,
    /// Distance that is allowed, both ways; the cut keeps to it.
    pub distance: f64,
}

/// A mesh, and how far it is from the source, and the source from it, at most.
#[derive(Clone, Debug)]
pub struct Further {
    /// Vertices that triangles use, and triangles.
    pub mesh: TriMesh,
    /// That distance, object units; nothing is exempt.
    pub distance: f32,
}

/// The mesh that `collapse` makes of a cut, of vertices of the cut and, after those, of the source; if all of it is proven to be within a distance of the source, both ways. Whatever
/// `collapse` does, nothing is believed. The source is held in memory, and tiles may take `budget` bytes.
///
/// # Errors
/// As [`coarsest`](super::coarsest).
pub fn further(
    file: &Chpm<MappedFile>,
    (cut, distance): (&Cut, f32),
    budget: u64,
    progress: &dyn Progress,
    cancel: &Cancel,
    collapse: impl FnOnce(&Goal<'_>) -> (Vec<u32>, Vec<[u32; 3]>) + Send,
) -> Result<Option<Further>, VerifyError> {
    let work = |certifier: &Certifier<'_>| further_by(certifier, (cut, distance), collapse);
    Certifier::on_few((file, TILE as u64), EFFORT, budget, (progress, cancel), work)
}

/// As [`further`], as far as a certifier proves it.
fn further_by(
    certifier: &Certifier<'_>,
    (cut, distance): (&Cut, f32),
    collapse: impl FnOnce(&Goal<'_>) -> (Vec<u32>, Vec<[u32; 3]>),
) -> Result<Option<Further>, VerifyError> {
    let Certifier { file, progress, cancel, .. } = *certifier;
    let beside = certifier.beside();
    let limit = certifier.to_prove(distance);
    if !file.has_gaps() || limit <= 0.0 {
        return Ok(None);
    }
    let coarse = extract(file, cut)?;
    let whole = extract(file, &Cut::at_level(file, Level(0)))?;
    cancel.check()?;

    progress.begin("collapsing", 1);
    let goal = Goal { mesh: &coarse, source: &certifier.source, whole: &whole, distance: limit };
    let mesh = taken([&coarse, &whole], collapse(&goal));
    progress.end();
    cancel.check()?;
    let reached = certifier.reach_mesh(&mesh, limit)?;
    Ok(reached.map(|reached| Further { mesh, distance: round_up(reached + beside) }))
}

/// The mesh of triangles that have their corners in a list of vertices, which are those of one mesh, and after them those of another.
fn taken([first, second]: [&TriMesh; 2], (vertices, triangles): (Vec<u32>, Vec<[u32; 3]>)) -> TriMesh {
    let count = first.positions.len() as u32;
    let mut all = TriMesh { vertices: Vertices::default(), triangles };
    for v in vertices {
        let (mesh, v) = if v < count { (first, v) } else { (second, v - count) };
        all.vertices.gather(mesh.view(), std::iter::once(v as usize));
    }
    let triangles = std::mem::take(&mut all.triangles);
    used(&all, triangles)
}

/// The mesh of some triangles, without vertices that none of them uses.
fn used(mesh: &TriMesh, mut triangles: Vec<[u32; 3]>) -> TriMesh {
    let mut order: Vec<u32> = triangles.as_flattened().to_vec();
    order.sort_unstable();
    order.dedup();
    let mut place = vec![0; mesh.positions.len()];
    (0..).zip(&order).for_each(|(new, old)| place[*old as usize] = new);
    triangles.as_flattened_mut().iter_mut().for_each(|v| *v = place[*v as usize]);
    let mut vertices = Vertices::default();
    vertices.gather(mesh.view(), order.iter().map(|v| *v as usize));
    TriMesh { vertices, triangles }
}

impl Certifier<'_> {
    /// How far a mesh and the leaves are from each other at most, if that is proven to be within a limit.
    fn reach_mesh(&self, mesh: &TriMesh, limit: f64) -> Result<Option<f64>, VerifyError> {
        let parts: Vec<&[[u32; 3]]> = mesh.triangles.chunks(TILE).collect();
        let part = |index: usize| used(mesh, parts[index].to_vec());
        let boxes = (0..parts.len()).map(|index| Aabb::of_points(&part(index).positions)).collect();
        let drawn = Tiles::new(boxes, self.budget, part);
        self.reach_both(parts.len(), part, &drawn, limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_not_begun() {
        let (source, cut) = (1_000_000, 1_000);
        let takes = SOURCE_BYTES * source + CUT_BYTES * cut;
        assert_eq!(room(takes + 5, source, cut), Ok(5));
        assert_eq!(room(takes - 5, source, cut), Err(5));
        assert!(room(u64::MAX - 1, u64::MAX, cut).is_err());
    }
}
