//! One cut after the other, member by member: whether what clusters share is one.

use super::borders::Borders;
use super::glance::Glance;
use super::ledger::{Ledger, Record};
use super::local::{Local, keep_odd, key};
use crate::error::VerifyError;
use chpm_format::{Chpm, Page, PageBuf, checksum};
use chpm_refine::{Cut, Member};

type Position = [f32; 3];

/// An edge of a border as one cluster has it: shared ids, ascending, and what follows from the places of both ends.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    ids: [u32; 2],
    place: u64,
}

impl Side {
    fn new(ends: [(u32, Position); 2]) -> Self {
        let [mut a, mut b] = ends.map(|(id, position)| (id, position.map(f32::to_bits)));
        if b < a {
            (a, b) = (b, a);
        }
        Side { ids: [a.0, b.0], place: place([a.1, b.1]) }
    }
}

impl Record for Side {
    fn id(&self) -> u32 {
        self.ids[0]
    }

    fn settle(records: &mut Vec<Self>) {
        keep_odd(records, |side| (key(&side.ids), side.place));
    }
}

/// Where one cluster has a shared vertex: the id of the vertex that it went to, if it has one, and what follows from both places.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Whereabouts {
    id: u32,
    target: u32,
    place: u64,
}

impl Record for Whereabouts {
    fn id(&self) -> u32 {
        self.id
    }

    fn settle(records: &mut Vec<Self>) {
        records.sort_unstable();
        records.dedup();
    }
}

fn place(ends: [[u32; 3]; 2]) -> u64 {
    let mut bytes = [0; 24];
    for (into, word) in bytes.chunks_exact_mut(4).zip(ends.as_flattened()) {
        into.copy_from_slice(&word.to_le_bytes());
    }
    checksum(&bytes)
}

/// Findings about a cut.
#[derive(Default)]
pub(super) struct Found {
    pub(super) triangles: u64,
    /// Edges without a partner, and shared vertices that are in two places.
    pub(super) places: u64,
    /// One of them, in words.
    pub(super) first: Option<String>,
}

/// Walks through cuts in the same memory.
pub(super) struct Walker {
    /// For files in which every shared vertex is in one place.
    glance: Option<Glance>,
    local: Local,
    sides: Ledger<Side>,
    vertices: Ledger<Whereabouts>,
    scratch: Vec<[u16; 2]>,
}

impl Walker {
    /// A walker that takes about `memory` bytes, and what one cluster does. In a file that `is_even` every shared vertex is in one
    /// place wherever it is listed.
    pub(super) fn new(memory: u64, is_even: bool) -> Self {
        let glance = is_even.then(|| Glance::new(memory / 2));
        let (sides, vertices) = (Ledger::new(memory / 4), Ledger::new(memory / 4));
        Walker { glance, local: Local::default(), sides, vertices, scratch: Vec::new() }
    }

    /// Looks at all borders of a cut whose members are at positions that they have.
    pub(super) fn look<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        borders: &Borders,
        cut: &Cut,
    ) -> Result<Found, VerifyError> {
        let told = self.glance.as_mut().map(|glance| glance.look(file, borders, cut)).transpose()?;
        match told.filter(|told| told.is_whole) {
            Some(told) => Ok(Found { triangles: told.triangles, ..Found::default() }),
            None => self.list(file, borders, cut),
        }
    }

    /// The same by lists of all that clusters share.
    fn list<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        borders: &Borders,
        cut: &Cut,
    ) -> Result<Found, VerifyError> {
        let mut found = Found::default();
        self.sides.restart();
        self.vertices.restart();
        let (mut open, mut apart) = (None, None);
        for pass in 0.. {
            for member in cut.members() {
                let page = self.enter(file, *member)?;
                let page = page.view();
                if pass == 0 {
                    found.triangles += self.local.triangle_count(&page);
                }
                for (vertex, id) in page.shared() {
                    self.vertices.add(self.whereabouts(&page, vertex, id));
                }
                for edge in borders.of_cluster(member.cluster, &mut self.scratch)? {
                    if let Some(side) = side(&self.local, &page, *edge) {
                        self.sides.add(side);
                    }
                }
            }
            let single =
                self.sides.settled().iter().filter(|side| !side.ids.iter().all(|id| borders.is_loose(*id)));
            for side in single {
                found.places += 1;
                open = open.or(Some(*side));
            }
            for same in self.vertices.settled().chunk_by(|a, b| a.id == b.id).filter(|same| same.len() > 1) {
                found.places += 1;
                apart = apart.or(Some(same[0].id));
            }
            let more = [self.sides.next_pass(), self.vertices.next_pass()];
            if more == [false; 2] {
                break;
            }
        }
        found.first = match (open, apart) {
            (Some(side), _) => self.tell_open(file, borders, cut, side)?,
            (None, Some(id)) => self.tell_apart(file, cut, id)?,
            (None, None) => None,
        };
        Ok(found)
    }

    fn enter<'a, D: AsRef<[u8]>>(
        &mut self,
        file: &'a Chpm<D>,
        member: Member,
    ) -> Result<PageBuf<'a>, VerifyError> {
        let page = file.page_known(member.cluster)?;
        self.local.enter(&page.view(), member.vertices as usize);
        Ok(page)
    }

    fn whereabouts(&self, page: &Page<'_>, vertex: u16, id: u32) -> Whereabouts {
        let target = self.local.at(vertex);
        let bits = [vertex, target].map(|v| page.positions[usize::from(v)].map(f32::to_bits));
        Whereabouts { id, target: self.local.id(target), place: place(bits) }
    }

    fn tell_open<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        borders: &Borders,
        cut: &Cut,
        open: Side,
    ) -> Result<Option<String>, VerifyError> {
        for member in cut.members() {
            let page = self.enter(file, *member)?;
            let page = page.view();
            let edges = borders.of_cluster(member.cluster, &mut self.scratch)?;
            let same = edges.iter().find(|edge| side(&self.local, &page, **edge) == Some(open));
            if let Some(edge) = same {
                let [a, b] =
                    edge.map(|v| object_position(file, page.positions[usize::from(self.local.at(v))]));
                let cluster = member.cluster;
                return Ok(Some(format!(
                    "the edge from {a:?} to {b:?} of {cluster} has no partner in the cluster beside it"
                )));
            }
        }
        Ok(None)
    }

    fn tell_apart<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        cut: &Cut,
        id: u32,
    ) -> Result<Option<String>, VerifyError> {
        let mut first = None;
        for member in cut.members() {
            let page = self.enter(file, *member)?;
            let page = page.view();
            let Some((vertex, _)) = page.shared().find(|(_, other)| *other == id) else { continue };
            let here = self.whereabouts(&page, vertex, id);
            let at = object_position(file, page.positions[usize::from(self.local.at(vertex))]);
            match first {
                None => first = Some((here, member.cluster, at)),
                Some((there, cluster, before)) if there != here => {
                    return Ok(Some(format!(
                        "shared vertex {id} is at {before:?} in {cluster} and at {at:?} in {}",
                        member.cluster
                    )));
                }
                Some(_) => {}
            }
        }
        Ok(None)
    }
}

/// An edge of a border at the position that was entered; none where it has become a point.
fn side(local: &Local, page: &Page<'_>, edge: [u16; 2]) -> Option<Side> {
    let ends = edge.map(|v| local.at(v));
    (ends[0] != ends[1]).then(|| Side::new(ends.map(|v| (local.id(v), page.positions[usize::from(v)]))))
}

fn object_position<D: AsRef<[u8]>>(file: &Chpm<D>, position: Position) -> [f64; 3] {
    let origin = file.header().origin;
    std::array::from_fn(|axis| origin[axis] + f64::from(position[axis]))
}
