//! Whether a cut holds together, told by sums of hashes: most cuts do, and lists are only made of those that do not seem to.
//!
//! Shared vertices that are at their own places in all clusters that have them are one, in a file in which every shared vertex is in one place. So only those
//! that have gone somewhere are noted, and the others held against the notes. And where every edge of a border is there an even number of
//! times, the exclusive or of all their hashes is zero.

use super::borders::Borders;
use super::local::UNSHARED;
use crate::error::VerifyError;
use chpm_format::{Chpm, FormatError, Page};
use chpm_mesh::pm::is_alive;
use chpm_refine::Cut;
use std::ops::Range;

/// Findings of a glance at a cut.
#[derive(Clone, Copy, Debug)]
pub(super) struct Told {
    pub(super) triangles: u64,
    /// Whether all that clusters share is one. If not, lists tell what is wrong, if it is.
    pub(super) is_whole: bool,
}

/// Looks at one cut after the other in the same memory.
pub(super) struct Glance {
    /// By shared id, of the ids that are looked at: what follows from where it has gone; 0 if it has not.
    gone: Vec<u64>,
    /// The same in a bit each, which is nearer at hand.
    has_gone: Vec<u64>,
    /// Ids that are looked at together.
    at_once: usize,
    /// By vertex that has gone at the position of a member: where it is.
    resolved: Vec<u16>,
    /// By byte of the shared bits: shared vertices before it.
    before: Vec<u16>,
}

impl Glance {
    /// One that takes about `memory` bytes.
    pub(super) fn new(memory: u64) -> Self {
        let at_once = (memory / size_of::<u64>() as u64).clamp(1 << 10, 1 << 32) as usize;
        Glance { gone: Vec::new(), has_gone: Vec::new(), at_once, resolved: Vec::new(), before: Vec::new() }
    }

    /// Looks at a cut, whose members are at positions that they have, of a file in which every shared vertex is in one place.
    pub(super) fn look<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        borders: &Borders,
        cut: &Cut,
    ) -> Result<Told, VerifyError> {
        let mut scratch = Vec::new();
        let (mut triangles, mut sides) = (0, 0);
        for member in cut.members() {
            let page = file.page_known(member.cluster)?;
            let page = page.view();
            let at = self.enter(&page, member.vertices as usize);
            triangles += at.triangle_count();
            for edge in borders.of_cluster(member.cluster, &mut scratch)? {
                sides ^= at.side(borders, *edge);
            }
        }
        let ids = file.header().shared_vertex_count;
        let mut is_whole = sides == 0;
        let mut next = 0;
        while is_whole && next < ids {
            let end = ids.min(next.saturating_add(u32::try_from(self.at_once).unwrap_or(u32::MAX)));
            is_whole = self.agree(file, cut, next..end)?;
            next = end;
        }
        Ok(Told { triangles, is_whole })
    }

    /// Whether all members have these shared vertices in one place.
    fn agree<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        cut: &Cut,
        ids: Range<u32>,
    ) -> Result<bool, FormatError> {
        let (mut gone, mut has_gone) = (std::mem::take(&mut self.gone), std::mem::take(&mut self.has_gone));
        gone.clear();
        gone.resize(ids.len(), 0);
        has_gone.clear();
        has_gone.resize(ids.len().div_ceil(64), 0);

        let (mut is_one, mut any) = (true, false);
        for member in cut.members() {
            let page = file.page_known(member.cluster)?;
            let page = page.view();
            if page.vertex_count() == member.vertices as usize {
                continue;
            }
            let at = self.enter(&page, member.vertices as usize);
            for (vertex, id) in at.gone().filter(|(_, id)| ids.contains(id)) {
                let id = (id - ids.start) as usize;
                let place = at.place(at.at(vertex)) | 1;
                is_one &= gone[id] == 0 || gone[id] == place;
                gone[id] = place;
                has_gone[id / 64] |= 1 << (id % 64);
                any = true;
            }
        }

        if any && is_one {
            for member in cut.members() {
                let page = file.page_known(member.cluster)?;
                let page = page.view();
                let staying = self.enter(&page, member.vertices as usize).staying();
                is_one &= !staying.iter().any(|id| {
                    let id = id.wrapping_sub(ids.start) as usize;
                    has_gone.get(id / 64).is_some_and(|bits| bits >> (id % 64) & 1 == 1)
                });
            }
        }

        (self.gone, self.has_gone) = (gone, has_gone);
        Ok(is_one)
    }

    /// Goes to the mesh of `n` vertices of a page that was checked before.
    fn enter<'a>(&'a mut self, page: &'a Page<'a>, n: usize) -> At<'a> {
        self.resolved.clear();
        for target in &page.targets[n - page.base_vertex_count..] {
            let target = match usize::from(*target).checked_sub(n) {
                Some(gone) => self.resolved[gone],
                None => *target,
            };
            self.resolved.push(target);
        }
        self.before.clear();
        let mut count = 0;
        for byte in page.shared_bits {
            self.before.push(count);
            count += byte.count_ones() as u16;
        }
        At { page, n, resolved: &self.resolved, before: &self.before }
    }
}

/// A cluster's mesh at a position.
struct At<'a> {
    page: &'a Page<'a>,
    /// Its vertices; those that follow have gone.
    n: usize,
    resolved: &'a [u16],
    before: &'a [u16],
}

impl<'a> At<'a> {
    /// Where a vertex of the finest mesh is.
    fn at(&self, vertex: u16) -> u16 {
        usize::from(vertex).checked_sub(self.n).map_or(vertex, |gone| self.resolved[gone])
    }

    /// Shared vertices before one, which may be the end.
    fn shared_before(&self, vertex: usize) -> usize {
        let Some(before) = self.before.get(vertex / 8) else { return self.page.shared_ids.len() };
        let bits = self.page.shared_bits[vertex / 8] & ((1 << (vertex % 8)) - 1);
        usize::from(*before) + bits.count_ones() as usize
    }

    /// The shared id of a vertex.
    fn id(&self, vertex: u16) -> u32 {
        match self.page.is_shared(vertex) {
            true => self.page.shared_ids[self.shared_before(vertex.into())],
            false => UNSHARED,
        }
    }

    /// The ids of shared vertices that are where they were.
    fn staying(&self) -> &'a [u32] {
        &self.page.shared_ids[..self.shared_before(self.n)]
    }

    /// Shared vertices that have gone.
    fn gone(&self) -> impl Iterator<Item = (u16, u32)> {
        let first = self.n / 8;
        let bits = self.page.shared_bits[first.min(self.page.shared_bits.len())..].iter();
        let vertices = (first..)
            .zip(bits)
            .flat_map(|(i, byte)| (0..8).filter(move |bit| byte >> bit & 1 == 1).map(move |bit| 8 * i + bit));
        let ids = &self.page.shared_ids[self.shared_before(self.n)..];
        vertices.filter(|vertex| *vertex >= self.n).map(|vertex| vertex as u16).zip(ids.iter().copied())
    }

    /// Follows from which vertex one is, as clusters know it, or from where it is, if no other has it.
    fn place(&self, vertex: u16) -> u64 {
        let id = self.id(vertex);
        if id != UNSHARED {
            return mix(u64::from(id));
        }
        let [x, y, z] = self.page.positions[usize::from(vertex)].map(|x| u64::from(x.to_bits()));
        mix(mix(UNSHARED as u64 ^ x << 32) ^ y << 32 ^ z)
    }

    /// Follows from an edge of a border; 0 where it has become a point, or need not have a partner.
    fn side(&self, borders: &Borders, edge: [u16; 2]) -> u64 {
        let [a, b] = edge.map(|v| self.at(v));
        if a == b || [a, b].iter().all(|v| borders.is_loose(self.id(*v))) {
            return 0;
        }
        mix(self.place(a).wrapping_add(self.place(b)))
    }

    fn triangle_count(&self) -> u64 {
        self.page
            .triangles
            .iter()
            .filter(|corners| {
                let [a, b, c] = **corners;
                if usize::from(a.max(b).max(c)) < self.n {
                    return true;
                }
                is_alive(&corners.map(|v| self.at(v)))
            })
            .count() as u64
    }
}

/// Every bit of the answer depends on every bit given, and no two numbers get the same one.
fn mix(x: u64) -> u64 {
    let x = (x ^ x >> 32).wrapping_add(0x9e37_79b9_7f4a_7c15).wrapping_mul(0xd6e8_feb8_6659_fd93);
    let x = (x ^ x >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
    x ^ x >> 32
}
