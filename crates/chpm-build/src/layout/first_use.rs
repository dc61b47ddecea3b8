//! Order of what is free in a page: the vertices of the base mesh as triangles use them first, and each triangle from its least corner on.
//! Nothing of that is content, and whoever packs the page has nothing to tell about it.

use chpm_format::page::PAGE_HEADER_LEN;
use chpm_format::{FormatError, Page};

const NONE: u16 = u16::MAX;

/// Scratch of the ordering.
#[derive(Debug, Default)]
pub(super) struct FirstUse {
    /// Of the base mesh: new number of each vertex, and vertex of each new number.
    new: Vec<u16>,
    old: Vec<u16>,
    triangles: Vec<[u16; 3]>,
    ids: Vec<u32>,
}

impl FirstUse {
    /// Appends the page in its new order to `out`; it is as long as before.
    pub(super) fn reorder(&mut self, bytes: &[u8], out: &mut Vec<u8>) -> Result<(), FormatError> {
        let page = Page::view(bytes)?;
        self.number(&page);
        out.extend_from_slice(&bytes[..PAGE_HEADER_LEN]);
        self.put(page.positions, out);
        self.put(page.normals, out);
        self.put(page.colors, out);
        self.put_rows(page.scalars, usize::from(page.attributes().scalar_words), out);

        // Ids come by increasing vertex, and so do those of the vertices that collapse, which stay where they are.
        let base = page.base_vertex_count;
        self.ids.clear();
        self.ids.resize(base, 0);
        let mut bits = vec![0u8; page.shared_bits.len()];
        let mut rest = page.shared_ids.len();
        for (index, (vertex, id)) in page.shared().enumerate() {
            let vertex = usize::from(vertex);
            let new = self.new.get(vertex).map_or(vertex, |new| usize::from(*new));
            bits[new / 8] |= 1 << (new % 8);
            match self.ids.get_mut(new) {
                Some(place) => *place = id,
                None => rest = rest.min(index),
            }
        }
        for vertex in (0..base).filter(|vertex| bits[vertex / 8] >> (vertex % 8) & 1 == 1) {
            out.extend_from_slice(&self.ids[vertex].to_le_bytes());
        }
        out.extend_from_slice(bytemuck::cast_slice(&page.shared_ids[rest..]));

        fn new(vertex: u16, new: &[u16]) -> u16 {
            new.get(usize::from(vertex)).copied().unwrap_or(vertex)
        }
        out.extend_from_slice(bytemuck::cast_slice(&self.triangles));
        for target in page.targets {
            out.extend_from_slice(&new(*target, &self.new).to_le_bytes());
        }
        out.extend_from_slice(bytemuck::cast_slice(page.error_codes));
        out.extend_from_slice(&bits);
        self.put(page.octahedral, out);
        Ok(())
    }

    /// Numbers the base mesh's vertices, each triangle from its least corner on. Those that no triangle uses come last, as they were.
    fn number(&mut self, page: &Page<'_>) {
        let base = page.base_vertex_count;
        self.new.clear();
        self.new.resize(base, NONE);
        self.old.clear();
        self.triangles.clear();
        for triangle in page.triangles {
            // A vertex without a number would get the next; of several the first does.
            let mut next = self.old.len() as u16;
            let [a, b, c] = triangle.map(|vertex| match self.new.get(usize::from(vertex)) {
                Some(&NONE) => std::mem::replace(&mut next, NONE),
                Some(new) => *new,
                None => vertex,
            });
            let [p, q, r] = *triangle;
            let turned = if a <= b && a <= c {
                [p, q, r]
            } else if b <= c {
                [q, r, p]
            } else {
                [r, p, q]
            };
            let turned = turned.map(|vertex| self.numbered(vertex));
            self.triangles.push(turned);
        }
        (0..base as u16).for_each(|vertex| {
            self.numbered(vertex);
        });
    }

    /// The new number of a vertex, the next one if it has none.
    fn numbered(&mut self, vertex: u16) -> u16 {
        let Some(new) = self.new.get_mut(usize::from(vertex)) else { return vertex };
        if *new == NONE {
            *new = self.old.len() as u16;
            self.old.push(vertex);
        }
        *new
    }

    /// Appends an array of `words` for each vertex.
    fn put_rows(&self, all: &[u32], words: usize, out: &mut Vec<u8>) {
        if all.is_empty() {
            return;
        }
        for vertex in self.old.iter().map(|vertex| usize::from(*vertex)) {
            out.extend_from_slice(bytemuck::cast_slice(&all[vertex * words..(vertex + 1) * words]));
        }
        out.extend_from_slice(bytemuck::cast_slice(&all[self.old.len() * words..]));
    }

    /// Appends an array by vertex.
    fn put<T: bytemuck::Pod>(&self, all: &[T], out: &mut Vec<u8>) {
        if all.is_empty() {
            return;
        }
        for vertex in &self.old {
            out.extend_from_slice(bytemuck::bytes_of(&all[usize::from(*vertex)]));
        }
        out.extend_from_slice(bytemuck::cast_slice(&all[self.old.len()..]));
    }
}
