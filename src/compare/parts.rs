//! The leaves of a file as one mesh with a number at each vertex.

use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Page};
use chpm_mesh::{ClusterId, VertexSlices};

/// The leaves, in the order of the file.
pub(crate) fn leaves(file: &Chpm<MappedFile>) -> Vec<ClusterId> {
    (0..)
        .map(ClusterId)
        .zip(file.clusters())
        .filter(|(_, record)| record.is_leaf())
        .map(|(id, _)| id)
        .collect()
}

/// The leaves as one mesh: a vertex that several have is that of the first.
pub(crate) struct Parts {
    /// Distances by vertex.
    pub(crate) values: Vec<f64>,
    /// The first new vertex of each leaf.
    starts: Vec<u32>,
    /// Vertices by shared id.
    shared: Vec<u32>,
}

impl Parts {
    pub(crate) fn new(file: &Chpm<MappedFile>, measured: Vec<Vec<f64>>) -> Result<Self> {
        let shared = vec![u32::MAX; file.header().shared_vertex_count as usize];
        // Room for all at once: a list that grows is there twice for a while. Each leaf's own go as soon as they are taken.
        let room = measured.iter().map(Vec::len).sum();
        let mut parts = Parts { values: Vec::with_capacity(room), starts: Vec::new(), shared };
        for (leaf, distances) in leaves(file).into_iter().zip(measured) {
            let page = file.page(leaf)?;
            let start = parts.values.len() as u32;
            parts.starts.push(start);
            let mut ids = page.view().shared().peekable();
            for (vertex, distance) in (0..=u16::MAX).zip(distances) {
                let next = parts.values.len() as u32;
                if let Some((_, id)) = ids.next_if(|(at, _)| *at == vertex) {
                    let known = &mut parts.shared[id as usize];
                    if *known != u32::MAX {
                        continue;
                    }
                    *known = next;
                }
                parts.values.push(distance);
            }
        }
        Ok(parts)
    }

    /// The vertices of a leaf in the whole mesh; those from its start on are new.
    fn numbers(&self, page: &Page<'_>, start: u32, out: &mut Vec<u32>) {
        out.clear();
        let mut next = start;
        let mut ids = page.shared().peekable();
        for vertex in (0..=u16::MAX).take(page.vertex_count()) {
            let known = ids.next_if(|(at, _)| *at == vertex).map(|(_, id)| self.shared[id as usize]);
            match known.filter(|known| *known < start) {
                Some(known) => out.push(known),
                None => {
                    out.push(next);
                    next += 1;
                }
            }
        }
    }

    /// Hands out one leaf after the other: its page, its start, and the numbers of its vertices.
    fn each_leaf(
        &self,
        file: &Chpm<MappedFile>,
        mut each: impl FnMut(&Page<'_>, u32, &[u32]) -> Result<()>,
    ) -> Result<()> {
        let mut numbers = Vec::new();
        for (leaf, start) in leaves(file).into_iter().zip(&self.starts) {
            let page = file.page(leaf)?;
            let page = page.view();
            self.numbers(&page, *start, &mut numbers);
            each(&page, *start, &numbers)?;
        }
        Ok(())
    }

    /// Tells the pages of one leaf after the other, and the distances of all their vertices.
    pub(crate) fn pages(
        &self,
        file: &Chpm<MappedFile>,
        mut each: impl FnMut(&Page<'_>, &[f64]) -> Result<()>,
    ) -> Result<()> {
        let mut values = Vec::new();
        self.each_leaf(file, |page, _, numbers| {
            values.clear();
            values.extend(numbers.iter().map(|number| self.values[*number as usize]));
            each(page, &values)
        })
    }

    /// Tells the vertices of one leaf after the other, each once, with its number; positions are relative to the file's origin.
    pub(crate) fn vertices(
        &self,
        file: &Chpm<MappedFile>,
        mut each: impl FnMut(VertexSlices<'_>, &[f64]) -> Result<()>,
    ) -> Result<()> {
        self.each_leaf(file, |page, start, numbers| {
            let new = numbers.iter().zip(page.positions).filter(|(number, _)| **number >= start);
            let positions: Vec<[f32; 3]> = new.map(|(_, position)| *position).collect();
            let values = &self.values[start as usize..][..positions.len()];
            each(VertexSlices { positions: &positions, ..VertexSlices::default() }, values)
        })
    }

    /// Tells the triangles of one leaf after the other.
    pub(crate) fn triangles(
        &self,
        file: &Chpm<MappedFile>,
        mut each: impl FnMut(&[[u32; 3]]) -> Result<()>,
    ) -> Result<()> {
        self.each_leaf(file, |page, _, numbers| {
            each(&page.triangles.iter().map(|t| t.map(|v| numbers[usize::from(v)])).collect::<Vec<_>>())
        })
    }
}
