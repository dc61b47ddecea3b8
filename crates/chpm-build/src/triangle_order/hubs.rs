//! Triangles about hubs, which are vertices of very many: the best of them is found without looking at each.
//!
//! Triangles with the same hubs are a group. Their scores differ by those of their other corners only, and change where one of these does,
//! which has few triangles. So each group has a heap by that part of the score: what rises is pushed again, and what has fallen is
//! noticed when it comes up.

use super::cache_walk::{Around, NONE};
use std::collections::{BinaryHeap, HashMap};

/// Triangles from which a vertex is a hub: far more than one of a surface has.
const MANY: u32 = 256;
const NO_GROUP: u32 = u32::MAX;

/// Triangles that have the same hubs.
#[derive(Debug)]
struct Group {
    /// Ascending; then [`NONE`].
    hubs: [u16; 3],
    /// Score of the other corners of a triangle, and its index. Of each that is left there is one that is no less than its score.
    heap: BinaryHeap<(i32, u32)>,
    left: usize,
}

/// The hubs of a mesh. Nothing is kept where there are none.
#[derive(Debug, Default)]
pub(super) struct Hubs {
    /// By hub: its groups.
    groups_of: HashMap<u16, Vec<u32>>,
    groups: Vec<Group>,
    /// By triangle: its group, if it has a hub, and where it is in the list of each of its corners that is one.
    group_of: Vec<u32>,
    places: Vec<[u32; 3]>,
    is_taken: Vec<bool>,
}

impl Hubs {
    /// Looks for hubs among vertices with so many triangles.
    pub(super) fn find(&mut self, counts: impl Iterator<Item = u32>) {
        self.groups_of.clear();
        self.groups.clear();
        self.groups_of
            .extend((0..).zip(counts).filter(|(_, count)| *count > MANY).map(|(hub, _)| (hub, Vec::new())));
    }

    pub(super) fn is_empty(&self) -> bool {
        self.groups_of.is_empty()
    }

    pub(super) fn has(&self, vertex: u16) -> bool {
        !self.is_empty() && self.groups_of.contains_key(&vertex)
    }

    /// Puts the triangles into groups.
    pub(super) fn gather(&mut self, triangles: &[[u16; 3]], scores: &[i32]) {
        if self.is_empty() {
            return;
        }
        self.group_of.clear();
        self.places.clear();
        self.places.resize(triangles.len(), [0; 3]);
        self.is_taken.clear();
        self.is_taken.resize(triangles.len(), false);

        let mut known: HashMap<[u16; 3], u32> = HashMap::new();
        let mut entries: Vec<Vec<(i32, u32)>> = Vec::new();

        for (index, corners) in (0..).zip(triangles) {
            let hubs = self.hubs(*corners);
            if hubs == [NONE; 3] {
                self.group_of.push(NO_GROUP);
                continue;
            }

            let fresh = entries.len() as u32;
            let group = *known.entry(hubs).or_insert(fresh);
            if group == fresh {
                entries.push(Vec::new());
                self.groups.push(Group { hubs, heap: BinaryHeap::new(), left: 0 });
                for hub in hubs.into_iter().filter(|hub| *hub != NONE) {
                    self.groups_of.entry(hub).or_default().push(group);
                }
            }

            self.group_of.push(group);
            entries[group as usize].push((others(*corners, &hubs, scores), index));
        }

        for (group, entries) in self.groups.iter_mut().zip(entries) {
            group.left = entries.len();
            group.heap = entries.into();
        }
    }

    /// Those among a triangle's corners.
    fn hubs(&self, corners: [u16; 3]) -> [u16; 3] {
        let mut hubs = corners.map(|corner| if self.has(corner) { corner } else { NONE });
        hubs.sort_unstable();
        hubs
    }

    /// Notes where a triangle is in the list of a corner that is a hub.
    pub(super) fn put(&mut self, triangle: u32, corners: [u16; 3], hub: u16, place: u32) {
        let corner = corners.iter().position(|corner| *corner == hub).unwrap_or(0);
        self.places[triangle as usize][corner] = place;
    }

    /// Where it is.
    pub(super) fn place(&self, triangle: u32, corners: [u16; 3], hub: u16) -> u32 {
        let corner = corners.iter().position(|corner| *corner == hub).unwrap_or(0);
        self.places[triangle as usize][corner]
    }

    /// A triangle comes next, and is none of those that are left.
    pub(super) fn take(&mut self, triangle: u32) {
        if self.is_empty() {
            return;
        }
        self.is_taken[triangle as usize] = true;
        if let Some(group) = self.groups.get_mut(self.group_of[triangle as usize] as usize) {
            group.left -= 1;
        }
    }

    /// The score of a vertex has risen, which has these triangles left. That of a hub counts for all of its groups alike.
    pub(super) fn rise(&mut self, vertex: u16, left: &[Around], triangles: &[[u16; 3]], scores: &[i32]) {
        if self.is_empty() || self.has(vertex) {
            return;
        }
        for around in left {
            let index = around.index;
            let Some(group) = self.groups.get_mut(self.group_of[index as usize] as usize) else { continue };
            group.heap.push((others(triangles[index as usize], &group.hubs, scores), index));
            if group.heap.len() > 2 * group.left + MANY as usize {
                group.tidy(&self.is_taken, triangles, scores);
            }
        }
    }

    /// The triangle with the highest score at a hub, and that score.
    pub(super) fn best(&mut self, hub: u16, triangles: &[[u16; 3]], scores: &[i32]) -> Option<(i32, u32)> {
        let groups = self.groups_of.get(&hub)?;
        let mut best = None;
        for group in groups {
            let group = &mut self.groups[*group as usize];
            let hubs = group.hubs.iter().filter(|hub| **hub != NONE);
            let own: i32 = hubs.map(|hub| scores[usize::from(*hub)]).sum();
            let top = group.top(&self.is_taken, triangles, scores).map(|(score, index)| (own + score, index));
            best = best.max(top);
        }
        best
    }
}

impl Group {
    /// The triangle that is left with the highest score.
    fn top(&mut self, is_taken: &[bool], triangles: &[[u16; 3]], scores: &[i32]) -> Option<(i32, u32)> {
        while let Some((score, index)) = self.heap.pop() {
            if is_taken[index as usize] {
                continue;
            }
            let now = others(triangles[index as usize], &self.hubs, scores);
            self.heap.push((now, index));
            if now == score {
                return Some((score, index));
            }
        }
        None
    }

    /// Keeps one entry of each triangle that is left.
    fn tidy(&mut self, is_taken: &[bool], triangles: &[[u16; 3]], scores: &[i32]) {
        let mut left: Vec<u32> = self.heap.drain().map(|(_, index)| index).collect();
        left.retain(|index| !is_taken[*index as usize]);
        left.sort_unstable();
        left.dedup();
        self.heap.extend(
            left.iter().map(|index| (others(triangles[*index as usize], &self.hubs, scores), *index)),
        );
    }
}

/// Score of the corners that are no hubs.
fn others(corners: [u16; 3], hubs: &[u16; 3], scores: &[i32]) -> i32 {
    corners.iter().filter(|corner| !hubs.contains(corner)).map(|corner| scores[usize::from(*corner)]).sum()
}
