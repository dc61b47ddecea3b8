//! Checks of a group's pages together: coarse clusters are what the fine ones leave (I4, I8), and boundaries
//! inside the group move alike (I7).

use super::cluster::{self, Scratch};
use super::shared::SharedIds;
use super::{Invariant, Report, sheets};
use crate::error::FilePart;
use crate::page::Page;
use crate::page_buf::PageBuf;
use crate::reader::Chpm;
use chpm_mesh::{Attributes, ClusterId, GroupId};

/// Normal and colour of a vertex, as bits.
type Look = ([u32; 3], [u8; 4]);

/// Checks groups one after the other; holds only buffers.
#[derive(Default)]
pub(super) struct GroupCheck {
    scratch: Scratch,
    /// Position bits above, index of the vertex below: sorts equal positions together.
    keys: Vec<u128>,
    /// Per vertex, a number that is the same for equal positions.
    rank: Vec<u32>,
    looks: Vec<Look>,
    /// By vertex, the words of its scalars.
    scalars: Vec<u32>,
    /// Vertices of the fine clusters in one place, by what they carry.
    fine_alike: Vec<usize>,
    coarse_triangles: Vec<u128>,
    fine_triangles: Vec<u128>,
    boundary: Vec<BoundaryVertex>,
}

/// A shared vertex as a member has it: id, whether it collapses, at which error and where to.
type BoundaryVertex = (u32, bool, u32, [u32; 3]);

impl GroupCheck {
    pub(super) fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        // Metadata that is wrong is told of by itself.
        let lattice_step = file.metadata().and_then(|metadata| metadata.lattice_step()).unwrap_or_default();
        GroupCheck { scratch: Scratch { lattice_step, ..Scratch::default() }, ..GroupCheck::default() }
    }

    pub(super) fn run<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        id: GroupId,
        shared: &mut SharedIds,
        report: &mut Report,
    ) {
        let mut coarse = Vec::with_capacity(file.coarse(id).len());
        for cluster in file.coarse(id).iter().copied().map(ClusterId) {
            match file.page_checked(cluster) {
                Ok(page) => {
                    cluster::check(file, cluster, &page.view(), &mut self.scratch, shared, report);
                    sheets::check(file, cluster, &page.view(), report);
                    report.good_pages += 1;
                    report.triangles += page.view().triangles.len() as u64;
                    coarse.push(page);
                }
                Err(error) => report.expect(false, Invariant::Bytes, FilePart::Page(cluster), error),
            }
        }
        if coarse.len() < file.coarse(id).len() {
            return;
        }
        let coarse: Vec<_> = coarse.iter().map(PageBuf::view).collect();
        if coarse.len() > 1 {
            self.check_boundary(id, &coarse, report);
        }
        // A fine page that is damaged is reported where it is coarse.
        let fine: Result<Vec<_>, _> =
            file.fine(id).iter().map(|fine| file.page_checked(ClusterId(*fine))).collect();
        let Ok(fine) = fine else { return };
        let fine: Vec<_> = fine.iter().map(PageBuf::view).collect();
        let vertices: usize = coarse.iter().chain(&fine).map(Page::vertex_count).sum();
        let countable = u32::try_from(vertices).is_ok();
        report.expect(countable, Invariant::Bytes, FilePart::Group(id), "fewer than 2^32 vertices expected");
        if countable && !fine.is_empty() {
            self.rank_vertices(id, &coarse, &fine, report);
            self.check_union(id, &coarse, &fine, report);
        }
    }

    /// A shared vertex that collapses does so in all members that have it: at one error, to one place.
    fn check_boundary(&mut self, id: GroupId, coarse: &[Page<'_>], report: &mut Report) {
        self.boundary.clear();
        for page in coarse {
            for (local, shared_id) in page.shared() {
                let vertex = usize::from(local);
                self.boundary.push(match vertex.checked_sub(page.base_vertex_count) {
                    None => (shared_id, false, 0, [0; 3]),
                    Some(j) => {
                        let target = page.positions[usize::from(page.targets[j])];
                        (shared_id, true, page.error_at(vertex).to_bits(), target.map(f32::to_bits))
                    }
                });
            }
        }

        self.boundary.sort_unstable_by_key(|member| member.0);
        for members in self.boundary.chunk_by_mut(|a, b| a.0 == b.0) {
            if members.iter().all(|member| *member == members[0]) {
                continue;
            }
            members.sort_unstable();

            let (first, last) = (members[0], members[members.len() - 1]);
            let told = |(_, gone, error, to): BoundaryVertex| match gone {
                false => "stays".to_owned(),
                true => format!("goes to {:?} at error {}", to.map(f32::from_bits), f32::from_bits(error)),
            };
            let message = format!("shared vertex {} {}, but elsewhere {}", first.0, told(first), told(last));
            report.expect(false, Invariant::Boundary, FilePart::Group(id), message);
        }
    }

    /// Numbers the positions of all coarse vertices and, behind them, of the fine clusters' base vertices; every
    /// coarse vertex must be a fine one, in position, normal, colour and scalars (I8).
    fn rank_vertices(&mut self, id: GroupId, coarse: &[Page<'_>], fine: &[Page<'_>], report: &mut Report) {
        self.keys.clear();
        self.looks.clear();
        self.scalars.clear();
        let attributes = coarse.iter().any(|p| p.attributes() != Attributes::NONE);
        let coarse_count: usize = coarse.iter().map(Page::vertex_count).sum();
        let all = coarse.iter().map(|p| (p, p.vertex_count()));
        for (page, count) in all.chain(fine.iter().map(|p| (p, p.base_vertex_count))) {
            for position in &page.positions[..count] {
                let [x, y, z] = position.map(|x| u128::from(x.to_bits()));
                self.keys.push(x << 96 | y << 64 | z << 32 | self.keys.len() as u128);
            }
            if attributes {
                self.looks.extend((0..count).map(|v| page.vertex(v).look()));
                self.scalars.extend_from_slice(page.first(count).scalars);
            }
        }

        // Equal positions are one run, and get one rank.
        self.keys.sort_unstable();
        self.rank.clear();
        self.rank.resize(self.keys.len(), 0);
        let mut moved = 0u64;
        let words = self.scalars.len() / self.keys.len().max(1);
        let (looks, scalars) = (&self.looks, &self.scalars);
        let carried = |vertex: usize| (looks[vertex], &scalars[vertex * words..(vertex + 1) * words]);
        for (rank, run) in self.keys.chunk_by(|a, b| a >> 32 == b >> 32).enumerate() {
            let vertices = || run.iter().map(|key| *key as u32 as usize);
            vertices().for_each(|vertex| self.rank[vertex] = rank as u32);
            // Sorted by index within the run: coarse vertices come first.
            let coarse_len = run.partition_point(|key| (*key as u32 as usize) < coarse_count);
            if coarse_len == run.len() {
                moved += coarse_len as u64;
            } else if attributes && coarse_len > 0 {
                let fine = &mut self.fine_alike;
                fine.clear();
                fine.extend(vertices().skip(coarse_len));
                fine.sort_unstable_by_key(|vertex| carried(*vertex));
                let known = |vertex: &usize| {
                    fine.binary_search_by_key(&carried(*vertex), |fine| carried(*fine)).is_ok()
                };
                moved += vertices().take(coarse_len).filter(|vertex| !known(vertex)).count() as u64;
            }
        }
        let message = format_args!("every vertex to be one of a fine base mesh, {moved} are not");
        report.expect(moved == 0, Invariant::Vertices, FilePart::Group(id), message);
    }

    /// Finest triangles of the coarse clusters and base triangles of the fine ones are equal as multisets (I4).
    fn check_union(&mut self, id: GroupId, coarse: &[Page<'_>], fine: &[Page<'_>], report: &mut Report) {
        self.coarse_triangles.clear();
        self.fine_triangles.clear();
        let mut first = 0;
        for page in coarse {
            let rank = &self.rank[first..];
            self.coarse_triangles.extend(page.triangles.iter().map(|corners| triangle_key(*corners, rank)));
            first += page.vertex_count();
        }

        for page in fine {
            let rank = &self.rank[first..];
            let places = &mut self.scratch.places;
            places.go_to(&page.progressive_mesh(), page.base_vertex_count);
            let corners = places.triangles(page.triangles);
            self.fine_triangles.extend(corners.map(|corners| triangle_key(corners, rank)));
            first += page.base_vertex_count;
        }

        self.coarse_triangles.sort_unstable();
        self.fine_triangles.sort_unstable();
        if self.coarse_triangles != self.fine_triangles {
            let message = format!(
                "the {} triangles of the fine base meshes expected, {} lack and {} are new",
                self.fine_triangles.len(),
                only_in(&self.fine_triangles, &self.coarse_triangles),
                only_in(&self.coarse_triangles, &self.fine_triangles),
            );
            report.expect(false, Invariant::Union, FilePart::Group(id), message);
        }
    }
}

/// A triangle by the ranks of its corners; the same for every rotation of them.
fn triangle_key(corners: [u16; 3], rank: &[u32]) -> u128 {
    let [a, b, c] = corners.map(|v| u128::from(rank[usize::from(v)]));
    fn key(a: u128, b: u128, c: u128) -> u128 {
        a << 64 | b << 32 | c
    }
    key(a, b, c).min(key(b, c, a)).min(key(c, a, b))
}

/// How many of the sorted `these` have no partner in the sorted `those`.
fn only_in(these: &[u128], those: &[u128]) -> usize {
    let mut rest = those.iter().peekable();
    let mut alone = 0;
    for key in these {
        while rest.next_if(|other| *other < key).is_some() {}
        if rest.next_if_eq(&key).is_none() {
            alone += 1;
        }
    }
    alone
}
