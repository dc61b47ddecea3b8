//! Shared vertices: those that two or more leaves use, with their users.
//!
//! Most of them lie along the seam of the same two leaves, so users are kept once for each set of leaves, an *interface*. Ids
//! count border vertices first, which two regions have, and then the others, region by region and interface by interface.

use super::leaf::{INNER, Leaf};
use super::region::{Done, Interfaces};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// All shared vertices. Memory: 4 bytes for each border vertex, and some dozens for each interface.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct SharedVertices {
    /// By border vertex that is shared: its interface.
    border: Vec<u32>,
    /// Border numbers, ascending, that only one leaf uses after all.
    holes: Vec<u32>,
    /// First id of each interface of inner vertices, ascending.
    firsts: Vec<u32>,
    /// Leaves of interface i, ascending: `users[starts[i]..starts[i + 1]]`. Those of inner vertices come first.
    users: Vec<u32>,
    starts: Vec<u32>,
    counts: Vec<u32>,
    len: u32,
    /// Vertices that any leaf uses, each counted once.
    pub(crate) used_vertices: u64,
}

impl SharedVertices {
    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.len as usize
    }

    /// The leaves of each interface, ascending, and how many vertices they share.
    pub(crate) fn interfaces(&self) -> impl Iterator<Item = (&[u32], u32)> {
        let users = self.starts.windows(2).map(|s| &self.users[s[0] as usize..s[1] as usize]);
        users.zip(self.counts.iter().copied())
    }

    /// The interface of a shared vertex.
    pub(crate) fn interface_of(&self, id: u32) -> u32 {
        match self.border.get(id as usize) {
            Some(interface) => *interface,
            None => self.firsts.partition_point(|first| *first <= id) as u32 - 1,
        }
    }

    /// The leaves that use a shared vertex, ascending.
    pub(crate) fn users(&self, id: u32) -> &[u32] {
        let interface = self.interface_of(id) as usize;
        &self.users[self.starts[interface] as usize..self.starts[interface + 1] as usize]
    }

    /// The shared id of what a leaf stored; none if the vertex is not shared after all.
    pub(super) fn id(&self, code: u32, leaf: &Leaf) -> Option<u32> {
        if code & INNER != 0 {
            return Some(leaf.first_inner + (code & !INNER));
        }
        match self.holes.binary_search(&code) {
            Ok(_) => None,
            Err(holes_before) => Some(code - holes_before as u32),
        }
    }
}

/// Takes in regions, in their order.
#[derive(Debug)]
pub(crate) struct Collector {
    leaves: Vec<Leaf>,
    inner: Interfaces,
    inner_count: u32,
    used_vertices: u64,
    /// By border number: the set of leaves so far.
    sets: Vec<u32>,
    known: LeafSets,
}

impl Collector {
    pub(crate) fn new(border_count: usize) -> Self {
        Collector {
            leaves: Vec::new(),
            inner: Interfaces { starts: vec![0], ..Interfaces::default() },
            inner_count: 0,
            used_vertices: 0,
            sets: vec![LeafSets::EMPTY; border_count],
            known: LeafSets::default(),
        }
    }

    /// Inner shared vertices so far.
    pub(crate) fn inner_count(&self) -> u32 {
        self.inner_count
    }

    /// Takes in the next region.
    pub(crate) fn add(&mut self, done: &Done) {
        let first = self.leaves.len() as u32;
        self.leaves.extend_from_slice(&done.leaves);
        self.leaves[first as usize..].iter_mut().for_each(|leaf| leaf.first_inner = self.inner_count);
        let users_before = self.inner.users.len() as u32;
        self.inner.users.extend(done.interfaces.users.iter().map(|leaf| first + leaf));
        self.inner.starts.extend(done.interfaces.starts.iter().skip(1).map(|start| users_before + start));
        self.inner.counts.extend_from_slice(&done.interfaces.counts);
        self.inner_count += done.interfaces.counts.iter().sum::<u32>();
        for (border, leaf) in &done.border_uses {
            let set = &mut self.sets[*border as usize];
            *set = self.known.with(*set, first + leaf);
        }
        self.used_vertices += done.referenced;
    }

    /// The leaves in order, and what they share.
    pub(crate) fn finish(self) -> (Vec<Leaf>, SharedVertices) {
        let Interfaces { mut users, mut starts, mut counts } = self.inner;
        let inner_interfaces = counts.len();
        let mut holes = Vec::new();
        let mut border = self.sets;
        // Sets that are used by two leaves and more become interfaces, in the order of their first vertex.
        let mut interface_of = vec![u32::MAX; self.known.nodes.len() + 1];
        let mut kept = 0;
        for number in 0..border.len() {
            let set = border[number];
            if self.known.len(set) < 2 {
                holes.push(number as u32);
                continue;
            }
            let interface = &mut interface_of[set as usize];
            if *interface == u32::MAX {
                *interface = counts.len() as u32;
                counts.push(0);
                self.known.leaves(set, &mut users);
                starts.push(users.len() as u32);
            }
            counts[*interface as usize] += 1;
            border[kept] = *interface;
            kept += 1;
        }
        border.truncate(kept);
        border.shrink_to_fit();
        let mut len = kept as u32;
        let mut firsts = Vec::with_capacity(inner_interfaces);
        for (leaf_count, count) in counts[..inner_interfaces].iter().enumerate() {
            debug_assert_eq!(firsts.len(), leaf_count);
            firsts.push(len);
            len += count;
        }
        let mut leaves = self.leaves;
        leaves.iter_mut().for_each(|leaf| leaf.first_inner += kept as u32);
        let used_vertices = self.used_vertices;
        (leaves, SharedVertices { border, holes, firsts, users, starts, counts, len, used_vertices })
    }
}

/// Sets of leaves that grow one leaf at a time, leaves ascending; equal sets have equal numbers.
#[derive(Debug, Default)]
struct LeafSets {
    /// By set and leaf: the set of both.
    grown: BTreeMap<(u32, u32), u32>,
    /// By set, less one for the empty one: what it grew from, and by which leaf.
    nodes: Vec<(u32, u32)>,
}

impl LeafSets {
    const EMPTY: u32 = 0;

    fn with(&mut self, set: u32, leaf: u32) -> u32 {
        let LeafSets { grown, nodes } = self;
        *grown.entry((set, leaf)).or_insert_with(|| {
            nodes.push((set, leaf));
            nodes.len() as u32
        })
    }

    fn parent(&self, set: u32) -> Option<(u32, u32)> {
        self.nodes.get(set.checked_sub(1)? as usize).copied()
    }

    fn len(&self, mut set: u32) -> usize {
        let mut len = 0;
        while let Some((parent, _)) = self.parent(set) {
            set = parent;
            len += 1;
        }
        len
    }

    /// Appends the leaves of a set, ascending.
    fn leaves(&self, mut set: u32, out: &mut Vec<u32>) {
        let first = out.len();
        while let Some((parent, leaf)) = self.parent(set) {
            out.push(leaf);
            set = parent;
        }
        out[first..].reverse();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(leaves: u32, users: &[&[u32]], border_uses: &[(u32, u32)]) -> Done {
        let mut interfaces = Interfaces { starts: vec![0], ..Interfaces::default() };
        for set in users {
            interfaces.users.extend_from_slice(set);
            interfaces.starts.push(interfaces.users.len() as u32);
            interfaces.counts.push(10);
        }
        let leaf = Leaf::empty();
        Done {
            leaves: vec![leaf; leaves as usize],
            interfaces,
            border_uses: border_uses.to_vec(),
            census: Default::default(),
            referenced: 5,
        }
    }

    #[test]
    fn ids_count_border_vertices_without_holes_and_then_interfaces() {
        let mut collector = Collector::new(4);
        collector.add(&region(3, &[&[0, 1], &[0, 1, 2]], &[(0, 1), (1, 2), (3, 0), (3, 1)]));
        assert_eq!(collector.inner_count(), 20);
        collector.add(&region(2, &[&[0, 1]], &[(0, 1), (2, 0)]));
        let (leaves, shared) = collector.finish();
        // 1 and 2 have one user each.
        assert_eq!((shared.holes.as_slice(), shared.len(), shared.used_vertices), (&[1, 2][..], 32, 10));
        assert_eq!([0, 1, 2, 3].map(|code| shared.id(code, &leaves[0])), [Some(0), None, None, Some(1)]);
        let inner = |leaf: usize, number| shared.id(number | INNER, &leaves[leaf]).unwrap();
        assert_eq!((inner(0, 0), inner(2, 19), inner(3, 0)), (2, 21, 22));
        for (id, users) in
            [(0, &[1, 4][..]), (1, &[0, 1]), (2, &[0, 1]), (11, &[0, 1]), (12, &[0, 1, 2]), (31, &[3, 4])]
        {
            assert_eq!(shared.users(id), users, "{id}");
        }
        let counts: Vec<u32> = shared.interfaces().map(|(_, count)| count).collect();
        assert_eq!(counts, [10, 10, 10, 1, 1]);
    }
}
