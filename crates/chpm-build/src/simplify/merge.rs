//! Joins children: which vertex of a child's page is which vertex of the parent.

use chpm_format::Page;

/// "The parent does not have this vertex."
const NONE: u16 = u16::MAX;

/// Scratch of a merge.
#[derive(Debug, Default)]
pub(super) struct Merger {
    /// The parent's triangles.
    pub(super) triangles: Vec<[u16; 3]>,
    /// Per child, the base vertices that the parent takes over, in the order of the parent's numbers.
    pub(super) fresh: Vec<Vec<u16>>,
    /// The parent's shared vertices: local index and shared id, by local index.
    pub(super) shared: Vec<(u16, u32)>,
    used: Vec<bool>,
    /// The parent's vertex for each of a child's base vertices.
    local: Vec<u16>,
    known: Vec<(u32, u16)>,
}

impl Merger {
    /// Numbers the parent's vertices: the first child's base vertices in their order, then those of each other that none before it
    /// has. A vertex that several have is known by its shared id; one that no base triangle uses has vanished.
    pub(super) fn join<'a>(&mut self, pages: &[Page<'_>], triangles: impl Iterator<Item = &'a [u8]>) {
        self.triangles.clear();
        self.shared.clear();
        self.known.clear();
        self.fresh.resize_with(pages.len(), Vec::new);
        let mut next = 0;
        for (side, (page, triangles)) in pages.iter().zip(triangles).enumerate() {
            let first_triangle = self.triangles.len();
            self.take(triangles, page.base_vertex_count);
            self.number(side, page, &mut next);
            for triangle in &mut self.triangles[first_triangle..] {
                *triangle = triangle.map(|v| self.local[usize::from(v)]);
            }
        }
        // Where all has vanished, one vertex stays for the page to have: no triangle uses it.
        if next == 0 {
            self.fresh[0].push(0);
        }
    }

    /// Appends a base mesh's triangles, over the child's own vertices, and notes which of these they use.
    fn take(&mut self, triangles: &[u8], vertex_count: usize) {
        let first = self.triangles.len();
        let each = triangles.chunks_exact(size_of::<[u16; 3]>());
        self.triangles.extend(each.map(bytemuck::pod_read_unaligned::<[u16; 3]>));
        self.used.clear();
        self.used.resize(vertex_count, false);
        self.triangles[first..].as_flattened().iter().for_each(|v| self.used[usize::from(*v)] = true);
    }

    fn number(&mut self, side: usize, page: &Page<'_>, next: &mut u16) {
        let before = self.known.len();
        self.fresh[side].clear();
        self.local.clear();
        let mut shared = page.shared().peekable();

        for vertex in 0..page.base_vertex_count as u16 {
            let id = shared.next_if(|(v, _)| *v == vertex).map(|(_, id)| id);
            if !self.used[usize::from(vertex)] {
                self.local.push(NONE);
                continue;
            }

            let found = id.and_then(|id| self.known[..before].binary_search_by_key(&id, |k| k.0).ok());
            if let Some(known) = found {
                self.local.push(self.known[known].1);
                continue;
            }

            self.shared.extend(id.map(|id| (*next, id)));
            self.known.extend(id.map(|id| (id, *next)));
            self.fresh[side].push(vertex);
            self.local.push(*next);
            *next += 1;
        }

        self.known.sort_unstable();
    }
}
