//! How well the order of the triangles in a file's pages serves a vertex cache.

use crate::json::file::Misses;
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, ClusterRecord, FormatError};
use chpm_measure::cache::{VertexCache, vertex_cache};
use chpm_mesh::ClusterId;
use rayon::prelude::*;

/// Vertices that the cache holds, first in, first out.
pub(crate) const SIZE: usize = 16;

/// Misses of the cache when clusters were drawn, one after the other, at their finest, middle and base positions.
#[derive(Clone, Copy, Default)]
pub(crate) struct Drawn([VertexCache; 3]);

impl Drawn {
    /// Misses for each triangle.
    pub(crate) fn acmr(&self) -> [f64; 3] {
        self.0.map(|cache| cache.acmr())
    }

    /// The same for programs.
    pub(crate) fn misses(&self) -> Misses {
        let [finest, middle, base] = self.acmr();
        Misses { finest, middle, base }
    }

    fn add(&mut self, other: &Drawn) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, more)| *sum += more);
    }
}

/// Draws all clusters, and the roots among them.
pub(crate) fn draw(file: &Chpm<MappedFile>) -> Result<[Drawn; 2]> {
    let drawn = file.clusters().par_iter().enumerate().map_init(Vec::new, |triangles, (index, _)| {
        let page = file.page(ClusterId(index as u32))?;
        let mesh = page.view().progressive_mesh();
        let (base, finest) = (mesh.base_vertex_count, mesh.vertex_count);
        Ok(Drawn([finest, base.midpoint(finest), base].map(|n| {
            triangles.clear();
            mesh.triangles_at(n, triangles);
            vertex_cache(triangles.iter().map(|corners| corners.map(u32::from)), SIZE)
        })))
    });
    let drawn = drawn.collect::<Result<Vec<Drawn>, FormatError>>()?;
    Ok([sum(|_| true, &drawn, file), sum(ClusterRecord::is_root, &drawn, file)])
}

fn sum(of: fn(&ClusterRecord) -> bool, drawn: &[Drawn], file: &Chpm<MappedFile>) -> Drawn {
    let mut sum = Drawn::default();
    let each = file.clusters().iter().zip(drawn).filter(|(cluster, _)| of(cluster));
    each.for_each(|(_, drawn)| sum.add(drawn));
    sum
}
