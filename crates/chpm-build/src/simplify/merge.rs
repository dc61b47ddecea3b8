//! Joins two children: which vertex of a child's page is which vertex of the parent.

use chpm_format::Page;

/// Scratch of a merge.
#[derive(Debug, Default)]
pub(super) struct Merger {
    /// Per child and vertex of its finest mesh: the parent's vertex that it is, or has collapsed to, in the child's base mesh.
    pub(super) local: [Vec<u16>; 2],
    /// The parent's shared vertices so far: local index and shared id, by local index.
    pub(super) shared: Vec<(u16, u32)>,
    /// Vertices of a child that the parent does not have yet.
    pub(super) fresh: Vec<usize>,
    known: Vec<(u32, u16)>,
}

impl Merger {
    /// Numbers the parent's vertices: the first child's base vertices in their order, then those of the second that the first
    /// does not have. A vertex that both have is known by its shared id.
    pub(super) fn join(&mut self, pages: &[Page<'_>; 2]) {
        let [first, second] = pages;
        self.shared.clear();
        self.known.clear();
        let count = first.base_vertex_count;
        self.local[0].clear();
        self.local[0].extend(0..count as u16);
        for (vertex, id) in first.shared().filter(|(v, _)| usize::from(*v) < count) {
            self.shared.push((vertex, id));
            self.known.push((id, vertex));
        }
        self.known.sort_unstable();

        let mut next = count as u16;
        let mut shared =
            second.shared().filter(|(v, _)| usize::from(*v) < second.base_vertex_count).peekable();
        self.local[1].clear();
        for vertex in 0..second.base_vertex_count as u16 {
            let id = shared.next_if(|(v, _)| *v == vertex).map(|(_, id)| id);
            let known = id.and_then(|id| self.known.binary_search_by_key(&id, |k| k.0).ok());
            if let Some(known) = known {
                self.local[1].push(self.known[known].1);
                continue;
            }
            self.shared.extend(id.map(|id| (next, id)));
            self.local[1].push(next);
            next += 1;
        }
        for (page, local) in pages.iter().zip(&mut self.local) {
            for target in page.targets {
                local.push(local[usize::from(*target)]);
            }
        }
    }
}
