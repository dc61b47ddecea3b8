//! Shared vertices: those that two or more leaves use, with their users.
//!
//! Most of them lie along the border of the same two leaves, so users are kept once for each set of leaves, an *interface*. Ids
//! count border vertices first, which two regions have, and then the others, region by region and interface by interface.

use super::leaf::{INNER, Leaf};
use super::normals::{self, BorderSum};
use super::region::{Done, Interfaces};
use chpm_extmem::{Buckets, ExtmemError, Reservation, Store};
use chpm_mesh::Octahedral;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// All shared vertices. Memory: 4 bytes for each border vertex, 7 where normals are computed, and some dozens for each interface.
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
    /// By border number, if normals are computed.
    normals: Vec<Octahedral>,
    /// Vertices that any leaf uses, each counted once.
    pub(crate) used_vertices: u64,
}

impl SharedVertices {
    /// Bytes that it takes in memory, with what is counted for each interface while levels are built.
    pub(crate) fn bytes(&self) -> u64 {
        let numbers = self.border.len() + self.holes.len() + self.firsts.len() + self.users.len();
        let (interfaces, normals) = (self.counts.len(), size_of_val(&self.normals[..]));
        (4 * numbers + (8 + PER_INTERFACE) * interfaces + normals) as u64
    }

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

    /// The normal of what a leaf stored, if it was not known then.
    pub(super) fn normal(&self, code: u32) -> Option<Octahedral> {
        // The mark of inner vertices makes numbers that no border vertex has.
        self.normals.get(code as usize).copied()
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

/// Bytes for each interface beside what is here: which level it is free at, and how many of its vertices are left.
const PER_INTERFACE: usize = 5;
/// log2 of the border vertices whose uses are looked at together, and the bytes that are gathered of those.
const SHARE_LOG: u32 = 15;
const BLOCK: usize = 1 << 13;

/// Takes in regions, in their order.
#[derive(Debug)]
pub(crate) struct Collector {
    leaves: Vec<Leaf>,
    inner: Interfaces,
    inner_count: u32,
    used_vertices: u64,
    /// Border number and leaf of every use, by share of the border numbers; leaves ascend.
    uses: Buckets<[u32; 2]>,
    border_count: u32,
    /// Likewise what faces come to there, if normals are computed; regions ascend.
    sums: Option<Buckets<BorderSum>>,
    /// For what is known of interfaces.
    share: Reservation,
}

impl Collector {
    pub(crate) fn new(border_count: usize, is_computed: bool, store: &Store) -> Result<Self, ExtmemError> {
        let shares = (border_count >> SHARE_LOG) + 1;
        let sums = || Buckets::new(store, "sums of normals", shares, BLOCK);
        Ok(Collector {
            share: store.budget.reserve_work("sets of clusters that share vertices", 0)?,
            sums: is_computed.then(sums),
            leaves: Vec::new(),
            inner: Interfaces { starts: vec![0], ..Interfaces::default() },
            inner_count: 0,
            used_vertices: 0,
            uses: Buckets::new(store, "uses of border vertices", shares, BLOCK),
            border_count: border_count as u32,
        })
    }

    /// Inner shared vertices so far.
    pub(crate) fn inner_count(&self) -> u32 {
        self.inner_count
    }

    /// Takes in the next region.
    pub(crate) fn add(&mut self, done: &Done) -> Result<(), ExtmemError> {
        let first = self.leaves.len() as u32;
        self.leaves.extend_from_slice(&done.leaves);
        self.leaves[first as usize..].iter_mut().for_each(|leaf| leaf.first_inner = self.inner_count);
        let users_before = self.inner.users.len() as u32;
        self.inner.users.extend(done.interfaces.users.iter().map(|leaf| first + leaf));
        self.inner.starts.extend(done.interfaces.starts.iter().skip(1).map(|start| users_before + start));
        self.inner.counts.extend_from_slice(&done.interfaces.counts);
        self.inner_count += done.interfaces.counts.iter().sum::<u32>();
        for (border, leaf) in &done.border_uses {
            self.uses.push((border >> SHARE_LOG) as usize, [*border, first + leaf])?;
        }
        if let Some(sums) = &mut self.sums {
            for part in &done.normals {
                sums.push((part.border >> SHARE_LOG) as usize, *part)?;
            }
        }
        self.used_vertices += done.referenced;
        self.share.resize(self.inner.bytes())
    }

    /// The leaves in order, and what they share.
    pub(crate) fn finish(self) -> Result<(Vec<Leaf>, SharedVertices), ExtmemError> {
        let (mut interfaces, mut reservation) = (self.inner, self.share);
        let inner_interfaces = interfaces.counts.len();
        let mut holes = Vec::new();
        let mut border = Vec::with_capacity(self.border_count as usize);

        // Sets that are used by two leaves and more become interfaces, in the order of their first vertex.
        let mut known = Known::default();
        let (mut uses, mut leaves) = (Vec::new(), Vec::new());
        let mut number = 0;
        for share in 0..self.uses.count() {
            uses.clear();
            self.uses.read(share, &mut uses)?;
            // Uses of a vertex keep their order.
            uses.sort_by_key(|[border, _]| *border);
            for about_one in uses.chunk_by(|a, b| a[0] == b[0]) {
                holes.extend(number..about_one[0][0]);
                number = about_one[0][0] + 1;
                leaves.clear();
                leaves.extend(about_one.iter().map(|[_, leaf]| *leaf));
                // Only one leaf uses it after all.
                if leaves.len() < 2 {
                    holes.push(number - 1);
                    continue;
                }
                let interface = known.interface(&leaves, &mut interfaces);
                interfaces.counts[interface as usize] += 1;
                border.push(interface);
            }
            reservation.resize(interfaces.bytes() + known.bytes())?;
        }
        drop(known);
        let Interfaces { mut users, mut starts, mut counts } = interfaces;
        users.shrink_to_fit();
        starts.shrink_to_fit();
        counts.shrink_to_fit();
        holes.extend(number..self.border_count);

        // Ids of inner vertices come after those of border vertices, interface by interface.
        border.shrink_to_fit();
        let kept = border.len();
        let mut len = kept as u32;
        let mut firsts = Vec::with_capacity(inner_interfaces);
        for (leaf_count, count) in counts[..inner_interfaces].iter().enumerate() {
            debug_assert_eq!(firsts.len(), leaf_count);
            firsts.push(len);
            len += count;
        }

        let mut normals = Vec::new();
        if let Some(sums) = self.sums {
            normals.reserve_exact(self.border_count as usize);
            let mut parts = Vec::new();
            for share in 0..sums.count() {
                parts.clear();
                sums.read(share, &mut parts)?;
                let left = self.border_count as usize - normals.len();
                normals.extend(normals::of_border(normals.len() as u64, left.min(1 << SHARE_LOG), &parts));
            }
        }

        let mut leaves = self.leaves;
        leaves.iter_mut().for_each(|leaf| leaf.first_inner += kept as u32);
        let used_vertices = self.used_vertices;
        let shared =
            SharedVertices { border, holes, firsts, users, starts, counts, len, normals, used_vertices };
        Ok((leaves, shared))
    }
}

/// The interfaces of border vertices by a hash of their leaves.
#[derive(Default)]
struct Known(HashMap<u64, u32>);

impl Known {
    /// Bytes that it has, and had at once when it grew last.
    fn bytes(&self) -> u64 {
        let each = size_of::<(u64, u32)>() + 1;
        // Of eight places seven are used, and the half of them were there before.
        (self.0.capacity() * each / 7 * 12) as u64
    }

    /// The interface of these leaves; appended, with no vertices, if there is none.
    fn interface(&mut self, leaves: &[u32], all: &mut Interfaces) -> u32 {
        let Interfaces { users, starts, counts } = all;
        let fresh = counts.len() as u32;
        let mut hash = leaves.iter().fold(0u64, |hash, leaf| {
            (hash.rotate_left(23) ^ u64::from(*leaf)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        });
        loop {
            let interface = *self.0.entry(hash).or_insert(fresh);
            if interface == fresh {
                users.extend_from_slice(leaves);
                starts.push(users.len() as u32);
                counts.push(0);
                return fresh;
            }
            let range = starts[interface as usize] as usize..starts[interface as usize + 1] as usize;
            if users[range] == *leaves {
                return interface;
            }
            // Others have the same hash.
            hash = hash.wrapping_add(1);
        }
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
        let done = Done {
            leaves: vec![leaf; leaves as usize],
            interfaces,
            border_uses: border_uses.to_vec(),
            topology: Default::default(),
            referenced: 5,
            copies: 0,
            normals: Vec::new(),
        };
        // As it would come from another machine.
        let config = bincode::config::standard();
        let record = bincode::serde::encode_to_vec(&done, config).unwrap();
        bincode::serde::decode_from_slice(&record, config).unwrap().0
    }

    #[test]
    fn ids_count_border_vertices_without_holes_and_then_interfaces() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::create(folder.path(), 1 << 20).unwrap();
        let mut collector = Collector::new(4, false, &store).unwrap();
        collector.add(&region(3, &[&[0, 1], &[0, 1, 2]], &[(0, 1), (1, 2), (3, 0), (3, 1)])).unwrap();
        assert_eq!(collector.inner_count(), 20);
        collector.add(&region(2, &[&[0, 1]], &[(0, 1), (2, 0)])).unwrap();
        let (leaves, shared) = collector.finish().unwrap();
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
