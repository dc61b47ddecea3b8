//! Which triangles and vertices of the page above are a page's base mesh: found by their bits, for the writer.

use crate::packed::connect::NONE;
use crate::page::Page;
use chpm_mesh::VertexSlices;
use std::cmp::Ordering;

/// Not in the page.
pub(super) const NOWHERE: u32 = u32::MAX;
/// Looks at triangles above for each of a page, in the mean: where vertices of the same bits take more, nothing is found.
const MOST_LOOKS: usize = 256;

/// A page's base mesh in the page above.
#[derive(Default)]
pub(super) struct Base {
    /// By triangle above: the page's own and by how many corners that is turned, or [`NOWHERE`].
    pub(super) own: Vec<(u32, u8)>,
    /// By vertex of the page's base mesh: the one above, or [`NONE`].
    pub(super) above: Vec<u16>,
    /// By vertex above, the page's own, or [`NONE`].
    taken: Vec<u16>,
    /// Vertices above, sorted by their bits.
    sorted: Vec<u16>,
    /// By vertex above, where its corners begin in `corners`, which has the triangles at each and the corner's place there.
    starts: Vec<u32>,
    corners: Vec<(u32, u8)>,
    /// How many more triangles above may be looked at.
    looks: usize,
    /// The page's triangles that are not found yet.
    left: Vec<(u32, [u16; 3])>,
}

/// Compares two vertices by all of their bits.
fn compare(one: &VertexSlices<'_>, i: u16, two: &VertexSlices<'_>, j: u16, words: usize) -> Ordering {
    let (i, j) = (usize::from(i), usize::from(j));
    fn bits(of: &[[f32; 3]], i: usize) -> Option<[u32; 3]> {
        of.get(i).map(|v| v.map(f32::to_bits))
    }
    bits(one.positions, i)
        .cmp(&bits(two.positions, j))
        .then_with(|| bits(one.normals, i).cmp(&bits(two.normals, j)))
        .then_with(|| {
            let steps = |of: &VertexSlices<'_>, i: usize| of.octahedral.get(i).map(|n| n.steps());
            steps(one, i).cmp(&steps(two, j))
        })
        .then_with(|| one.colors.get(i).cmp(&two.colors.get(j)))
        .then_with(|| one.scalars[i * words..][..words].cmp(&two.scalars[j * words..][..words]))
}

impl Base {
    /// Finds the triangles of a page's base mesh, each with its corners there. Answers whether all are there.
    pub(super) fn find(
        &mut self,
        page: &Page<'_>,
        triangles: impl Iterator<Item = (u32, [u16; 3])>,
        parent: &Page<'_>,
    ) -> bool {
        let words = usize::from(page.attributes().scalar_words);
        if page.attributes() != parent.attributes() {
            return false;
        }
        self.left.clear();
        self.left.extend(triangles);
        if self.left.len() != page.base_triangle_count {
            return false;
        }
        // Of those that a group replaces, most are told by one vertex that they do not have.
        let some = self.left.iter().step_by(self.left.len() / 4 + 1).map(|(_, corners)| corners[0]);
        let is_above = |own: u16| {
            (0..parent.vertex_count() as u16)
                .any(|above| compare(&parent.vertices, above, &page.vertices, own, words).is_eq())
        };
        if !some.into_iter().all(is_above) {
            return false;
        }
        self.looks = MOST_LOOKS * (self.left.len() + parent.triangles.len());
        self.index(parent, words);
        self.above.clear();
        self.above.resize(page.base_vertex_count, NONE);
        self.taken.clear();
        self.taken.resize(parent.vertex_count(), NONE);
        self.own.clear();
        self.own.resize(parent.triangles.len(), (NOWHERE, 0));

        // Where bits alone say which vertex it is.
        let mut used: Vec<u16> = self.left.iter().flat_map(|(_, corners)| *corners).collect();
        used.sort_unstable();
        used.dedup();
        for vertex in &used {
            match self.alike(page, *vertex, parent, words) {
                [] => return false,
                &[one] => {
                    let taken = std::mem::replace(&mut self.taken[usize::from(one)], *vertex);
                    if taken != NONE {
                        // Several of the page's own have these bits, and the page above has fewer.
                        return false;
                    }
                    self.above[usize::from(*vertex)] = one;
                }
                _ => {}
            }
        }

        // Vertices of the same bits are told apart by the triangles that they are in, from those on that are known.
        let mut may_begin = false;
        while !self.left.is_empty() {
            let mut left = std::mem::take(&mut self.left);
            let before = left.len();
            left.retain(|(own, corners)| {
                self.looks = self.looks.saturating_sub(1);
                let is_known = corners.iter().any(|c| self.above[usize::from(*c)] != NONE);
                let found = (is_known || may_begin) && self.place(page, (*own, *corners), parent, words);
                may_begin &= !found;
                !found
            });
            let is_stuck = left.len() == before;
            self.left = left;
            if self.looks == 0 || is_stuck && std::mem::replace(&mut may_begin, true) {
                return false;
            }
        }
        true
    }

    /// The page's own of a vertex above.
    pub(super) fn own_of(&self, above: u16) -> u16 {
        self.taken[usize::from(above)]
    }

    /// Sorts the vertices above, and lists the triangles at each.
    fn index(&mut self, parent: &Page<'_>, words: usize) {
        let count = parent.vertex_count();
        self.sorted.clear();
        self.sorted.extend(0..count as u16);
        self.sorted.sort_unstable_by(|i, j| {
            compare(&parent.vertices, *i, &parent.vertices, *j, words).then(i.cmp(j))
        });
        self.starts.clear();
        self.starts.resize(count + 2, 0);
        for vertex in parent.triangles.as_flattened() {
            self.starts[usize::from(*vertex) + 2] += 1;
        }
        for i in 2..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        self.corners.clear();
        self.corners.resize(3 * parent.triangles.len(), (0, 0));
        for (triangle, corners) in (0..).zip(parent.triangles) {
            for (place, vertex) in (0..).zip(corners) {
                let start = &mut self.starts[usize::from(*vertex) + 1];
                self.corners[*start as usize] = (triangle, place);
                *start += 1;
            }
        }
    }

    /// The vertices above with the bits of one.
    fn alike(&self, page: &Page<'_>, vertex: u16, parent: &Page<'_>, words: usize) -> &[u16] {
        let order = |above: &u16| compare(&parent.vertices, *above, &page.vertices, vertex, words);
        let start = self.sorted.partition_point(|above| order(above).is_lt());
        let len = self.sorted[start..].partition_point(|above| order(above).is_eq());
        &self.sorted[start..start + len]
    }

    /// Finds a triangle above that nothing has, with the right corners as far as they are known.
    fn place(
        &mut self,
        page: &Page<'_>,
        (own, corners): (u32, [u16; 3]),
        parent: &Page<'_>,
        words: usize,
    ) -> bool {
        let known = (0..3).find(|i| self.above[usize::from(corners[*i])] != NONE);
        let first = known.unwrap_or(0);
        let at = match known {
            Some(i) => vec![self.above[usize::from(corners[i])]],
            None => self.alike(page, corners[0], parent, words).to_vec(),
        };
        for middle in at {
            let range =
                self.starts[usize::from(middle)] as usize..self.starts[usize::from(middle) + 1] as usize;
            self.looks = self.looks.saturating_sub(1 + range.len());
            if self.looks == 0 {
                return false;
            }
            for (triangle, place) in &self.corners[range] {
                let above = &parent.triangles[*triangle as usize];
                // Corner `first` of the page's own is corner `place` above.
                let turn = (first + 3 - usize::from(*place)) % 3;
                let fits = self.own[*triangle as usize].0 == NOWHERE
                    && (0..3).all(|i| {
                        let (own, above) = (corners[(i + turn) % 3], above[i]);
                        let (to, of) = (self.above[usize::from(own)], self.taken[usize::from(above)]);
                        match (to, of) {
                            (NONE, NONE) => {
                                compare(&page.vertices, own, &parent.vertices, above, words).is_eq()
                            }
                            _ => to == above && of == own,
                        }
                    });
                if fits {
                    self.own[*triangle as usize] = (own, turn as u8);
                    for i in 0..3 {
                        let (own, above) = (corners[(i + turn) % 3], above[i]);
                        self.above[usize::from(own)] = above;
                        self.taken[usize::from(above)] = own;
                    }
                    return true;
                }
            }
        }
        false
    }
}
