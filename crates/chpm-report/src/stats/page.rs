//! Statistics that take a page: the bytes of its parts, how its triangles serve a vertex cache, how far apart the ends of edges lie, and for
//! how many levels its shared vertices are shared.

use crate::error::ReportError;
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::packed::PARTS;
use chpm_format::{Chpm, Page};
use chpm_measure::cache::vertex_cache;
use chpm_mesh::ClusterId;
use chpm_refine::coincident;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU8, Ordering};

/// Vertices of the caches, first in, first out.
pub const CACHES: [usize; 3] = [16, 24, 32];

/// Of one page.
#[derive(Clone, Copy, Default, Debug)]
pub struct PageStats {
    /// Bits by [`PARTS`], as stored.
    pub parts: [u64; PARTS.len()],
    /// Misses of each of [`CACHES`] when the finest mesh is drawn.
    pub misses: [u64; CACHES.len()],
    /// Sum over the three edges of each triangle of the finest mesh: how far apart its ends are in the list of vertices.
    pub span: u64,
    /// Triangles of the finest mesh that have the vertices of another one before them.
    pub coincident: u64,
}

/// The levels at which shared vertices are shared.
#[derive(Debug)]
pub struct Borders {
    first: Vec<AtomicU8>,
    last: Vec<AtomicU8>,
}

/// Bytes that reading all pages takes for each shared vertex and each cluster.
pub const MEMORY: [u64; 2] = [2, 256];

impl Borders {
    fn new(count: u32) -> Self {
        fn all(count: u32, value: u8) -> Vec<AtomicU8> {
            (0..count).map(|_| AtomicU8::new(value)).collect()
        }
        Borders { first: all(count, u8::MAX), last: all(count, 0) }
    }

    fn note(&self, page: &Page<'_>, level: u32) {
        let level = u8::try_from(level).unwrap_or(u8::MAX);
        for id in page.shared_ids {
            self.first[*id as usize].fetch_min(level, Ordering::Relaxed);
            self.last[*id as usize].fetch_max(level, Ordering::Relaxed);
        }
    }

    /// For each of so many levels: how many of the vertices that are shared there are so for 0, 1, 2 ... levels, from the first to the last;
    /// and the same of all of them.
    pub(super) fn lives(&self, levels: usize) -> (Vec<Vec<u64>>, Vec<u64>) {
        let mut by_level = vec![vec![0; levels + 1]; levels];
        let mut all = vec![0; levels + 1];
        for (first, last) in self.first.iter().zip(&self.last) {
            let (first, last) =
                (usize::from(first.load(Ordering::Relaxed)), usize::from(last.load(Ordering::Relaxed)));
            if first <= last {
                let life = (last - first + 1).min(levels);
                all[life] += 1;
                by_level.iter_mut().take(last + 1).skip(first).for_each(|counts| counts[life] += 1);
            }
        }
        (by_level, all)
    }
}

/// Reads all pages, on all processors.
pub(super) fn read(
    file: &Chpm<MappedFile>,
    cancel: &Cancel,
) -> Result<(Vec<PageStats>, Borders), ReportError> {
    let borders = Borders::new(file.header().shared_vertex_count);
    let clusters = file.clusters().par_iter().enumerate().map(|(index, record)| {
        cancel.check()?;
        let id = ClusterId(index as u32);
        let page = file.page(id)?;
        let parts = file.page_sizes(id, &page)?;
        let page = page.view();
        borders.note(&page, record.level);
        let corners = page.triangles.iter().map(|corners| corners.map(u32::from));
        let misses = CACHES.map(|size| vertex_cache(corners.clone(), size).misses);
        let spans = corners.map(|[a, b, c]| {
            [a.abs_diff(b), b.abs_diff(c), c.abs_diff(a)].map(u64::from).iter().sum::<u64>()
        });
        let (span, coincident) = (spans.sum(), coincident(page.triangles, &mut Vec::new()));
        Ok::<_, ReportError>(PageStats { parts, misses, span, coincident })
    });
    Ok((clusters.collect::<Result<_, ReportError>>()?, borders))
}
