//! Which pages are in memory: what a view wants is asked for, what is no longer used makes room, and what is on its way is replaced by
//! what is above it.
//!
//! The unit is what the split of one group brings; the roots always stay. With a unit, all units above it are kept, so that the view can
//! get coarser at any moment: whatever is missing, the cut of the groups that are ready is a legal one. So what is above the active
//! clusters is there already, and only what is below them, or will be, needs to be read ahead. A pure state machine: who
//! calls it does the reading, in any order and as late as may be.

use crate::hierarchy::Hierarchy;
use crate::splits::parents;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId, GroupId};
use std::cmp::Reverse;

/// A group that a view wants to be split.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Wanted {
    /// The group; all groups above it are wanted too, and listed before it.
    pub group: GroupId,
    /// Priority where not everything fits, the largest first; groups above have at least as much. Screen-space error, for example.
    pub priority: f64,
}

/// Reads and evictions of an update.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Traffic {
    /// Pages to read, most urgent first; [`Residency::arrive`] is to be told of each.
    pub requests: Vec<ClusterId>,
    /// Pages to let go: nothing that is ready after the update needs them.
    pub evictions: Vec<ClusterId>,
}

/// Pages in memory and on their way, within a number of bytes.
#[derive(Clone, Debug)]
pub struct Residency {
    budget: u64,
    /// Bytes that are there or on their way.
    reserved: u64,
    /// Number of the update; the first is 1.
    now: u64,
    /// By group: its fine clusters.
    units: Vec<Unit>,
    /// Groups whose units are there or on their way.
    kept: Vec<GroupId>,
    /// By cluster: asked for and not there yet.
    pending: Vec<bool>,
    /// Roots that are not there yet.
    missing_roots: u32,
    root_bytes: u64,
    /// By cluster.
    sizes: Vec<u64>,
}

#[derive(Clone, Copy, Debug)]
struct Unit {
    bytes: u64,
    /// The last update that it was wanted in and had its place.
    used: u64,
    /// The last update after which it was read ahead, or would have been.
    foreseen: u64,
    /// Clusters on their way.
    missing: u32,
    /// Units directly below that are there or on their way, once for each cluster between.
    below: u32,
    kept: bool,
}

impl Residency {
    /// Nothing is there. The pages of the roots count, and stay even if they are more than `budget`; nothing else exceeds it.
    pub fn new<D: AsRef<[u8]>>(file: &Chpm<D>, budget: Bytes) -> Self {
        let attributes = file.header().attributes();
        let sizes = file.clusters().iter().map(|cluster| cluster.unpacked_len(attributes)).collect();
        Residency::of_sizes(file, budget, sizes)
    }

    /// The same for something else than pages, by the bytes that each cluster takes of it: what is made of them, for example.
    pub fn of_sizes<D: AsRef<[u8]>>(file: &Chpm<D>, budget: Bytes, sizes: Vec<u64>) -> Self {
        Residency {
            budget: budget.0,
            reserved: 0,
            now: 0,
            units: (0..file.groups().len() as u32)
                .map(GroupId)
                .map(|id| {
                    let bytes = file.fine(id).iter().map(|fine| sizes[*fine as usize]).sum();
                    Unit { bytes, used: 0, foreseen: 0, missing: 0, below: 0, kept: false }
                })
                .collect(),
            kept: Vec::new(),
            pending: vec![false; file.clusters().len()],
            missing_roots: file.header().root_count,
            root_bytes: file.roots().map(|root| sizes[root.index()]).sum(),
            sizes,
        }
    }

    /// Goes on to what the next view wants. Where that is more than the budget, the last ones in priority do not get ready (even if they
    /// are there), nor what is below them.
    pub fn update<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        mut wanted: Vec<Wanted>,
    ) -> Traffic {
        let mut traffic = Traffic::default();
        self.now += 1;
        if self.now == 1 {
            for root in file.roots() {
                self.request(root, &mut traffic);
            }
        }

        let mut room = self.budget.saturating_sub(self.root_bytes);
        if wanted.iter().map(|wanted| self.units[wanted.group.index()].bytes).sum::<u64>() > room {
            wanted.sort_by(|a, b| by_priority(hierarchy, a, b));
        }

        // A group is of use only where those above it are there.
        wanted.retain(|wanted| {
            let bytes = self.units[wanted.group.index()].bytes;
            let fits = bytes <= room
                && parents(file, wanted.group).all(|above| self.units[above.index()].used == self.now);
            if fits {
                room -= bytes;
                self.units[wanted.group.index()].used = self.now;
            }
            fits && !self.units[wanted.group.index()].kept
        });

        wanted.sort_by(|a, b| by_priority(hierarchy, a, b));
        self.fetch_all(file, hierarchy, &wanted, &mut traffic);
        traffic
    }

    /// Reads ahead, after an update: what a view may want soon, whole units of up to `limit` bytes together. All groups above one must be
    /// listed too, or be there; it may list what is there already. What is read ahead has no claim to a place: only what
    /// no view wants and nobody foresees makes room for it, and the next update may let it go again. It is not
    /// ready before a view wants it.
    pub fn prefetch<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        mut ahead: Vec<Wanted>,
        limit: Bytes,
    ) -> Traffic {
        let mut traffic = Traffic::default();
        ahead.sort_by(|a, b| by_priority(hierarchy, a, b));
        let mut room = limit.0;
        ahead.retain(|ahead| {
            let above = parents(file, ahead.group).all(|above| {
                self.units[above.index()].kept || self.units[above.index()].foreseen == self.now
            });
            let unit = &mut self.units[ahead.group.index()];
            let is_chosen = !unit.kept && above && unit.bytes <= room;
            if is_chosen {
                room -= unit.bytes;
            }
            if is_chosen || unit.kept {
                unit.foreseen = self.now;
            }
            is_chosen
        });
        self.fetch_all(file, hierarchy, &ahead, &mut traffic);
        traffic
    }

    /// Makes room for units and asks for those that fit, in their order.
    fn fetch_all<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        wanted: &[Wanted],
        traffic: &mut Traffic,
    ) {
        self.make_room(file, hierarchy, wanted, traffic);
        for Wanted { group, .. } in wanted {
            let Unit { bytes, .. } = self.units[group.index()];
            let above = parents(file, *group).all(|above| self.units[above.index()].kept);
            // What nobody wants any more and is still on its way can be in the way.
            if above && self.reserved.saturating_add(bytes) <= self.budget {
                self.fetch(file, *group, traffic);
            }
        }
    }

    /// Evicts until all of `wanted` fits, or nothing more can go: longest unused first, and from below.
    fn make_room<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        wanted: &[Wanted],
        traffic: &mut Traffic,
    ) {
        let needed: u64 = wanted.iter().map(|wanted| self.units[wanted.group.index()].bytes).sum();
        if self.reserved.saturating_add(needed) <= self.budget {
            return;
        }
        let mut victims = self.kept.clone();
        fn last(group: &GroupId, units: &[Unit]) -> u64 {
            units[group.index()].last()
        }
        victims.retain(|group| last(group, &self.units) < self.now);
        // A unit was used or foreseen whenever one below it was: those below come first.
        victims.sort_by_key(|group| (last(group, &self.units), Reverse(hierarchy.rank(*group))));
        for group in victims {
            let Unit { bytes, missing, below, .. } = self.units[group.index()];
            if self.reserved.saturating_add(needed) <= self.budget {
                break;
            }
            if missing > 0 || below > 0 {
                continue;
            }
            self.reserved -= bytes;
            self.units[group.index()].kept = false;
            parents(file, group).for_each(|above| self.units[above.index()].below -= 1);
            traffic.evictions.extend(file.fine(group).iter().copied().map(ClusterId));
        }
        let units = &self.units;
        self.kept.retain(|group| units[group.index()].kept);
    }

    fn fetch<D: AsRef<[u8]>>(&mut self, file: &Chpm<D>, group: GroupId, traffic: &mut Traffic) {
        let unit = &mut self.units[group.index()];
        (unit.kept, unit.missing) = (true, file.fine(group).len() as u32);
        self.kept.push(group);
        parents(file, group).for_each(|above| self.units[above.index()].below += 1);
        for fine in file.fine(group) {
            self.request(ClusterId(*fine), traffic);
        }
    }

    fn request(&mut self, cluster: ClusterId, traffic: &mut Traffic) {
        self.reserved += self.sizes[cluster.index()];
        self.pending[cluster.index()] = true;
        traffic.requests.push(cluster);
    }

    /// Notes that a page has come; answers whether it was on its way.
    pub fn arrive<D: AsRef<[u8]>>(&mut self, file: &Chpm<D>, cluster: ClusterId) -> bool {
        let expected = self.pending.get_mut(cluster.index()).is_some_and(std::mem::take);
        if expected {
            let record = &file.clusters()[cluster.index()];
            let missing = match record.is_root() {
                true => &mut self.missing_roots,
                false => &mut self.units[record.parent_group().index()].missing,
            };
            *missing -= 1;
        }
        expected
    }

    /// Whether the roots are there; nothing can be drawn before.
    pub fn has_roots(&self) -> bool {
        self.missing_roots == 0
    }

    /// Whether a group may be split: the last view wants it, it has its place within the budget, and all that it brings is there.
    /// This is what [`crate::ActiveList::update`] is to be allowed.
    ///
    /// # Panics
    /// For a group that the file does not have.
    pub fn is_ready(&self, group: GroupId) -> bool {
        let unit = &self.units[group.index()];
        unit.kept && unit.missing == 0 && unit.used == self.now
    }

    /// Bytes of pages that are there or on their way.
    pub fn reserved(&self) -> Bytes {
        Bytes(self.reserved)
    }
}

impl Unit {
    /// The last update that had a use for it.
    fn last(&self) -> u64 {
        self.used.max(self.foreseen)
    }
}

/// Order by priority, groups above before those below.
fn by_priority(hierarchy: &Hierarchy, a: &Wanted, b: &Wanted) -> std::cmp::Ordering {
    fn rank(wanted: &Wanted, hierarchy: &Hierarchy) -> u32 {
        hierarchy.rank(wanted.group)
    }
    b.priority.total_cmp(&a.priority).then_with(|| rank(a, hierarchy).cmp(&rank(b, hierarchy)))
}
