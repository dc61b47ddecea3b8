//! Reads for a view, and prefetch for the next one.
//!
//! A front follows the view, whether the pages are there or not; what it has split is wanted from a [`Residency`], the largest screen-space error first. A second front follows
//! the view that is expected next. Who draws keeps the cut to the groups that are ready ([`Pager::is_ready`]).

use crate::front::Front;
use crate::hierarchy::Hierarchy;
use crate::residency::{Residency, Traffic, Wanted};
use crate::view::View;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId, GroupId};

/// Pages for a camera that moves, within a number of bytes.
#[derive(Clone, Debug)]
pub struct Pager {
    wanted: Front,
    foreseen: Front,
    residency: Residency,
}

impl Wanted {
    /// A group that a view wants split, by the pixels of error that it would show otherwise.
    pub fn by(view: &View, hierarchy: &Hierarchy, group: GroupId) -> Self {
        let error = hierarchy.split_error(group).unwrap_or(0.0);
        Wanted { group, priority: view.pixels_of(error, hierarchy.region(group)) }
    }
}

impl Pager {
    /// Nothing is there. The pages of the roots count, and stay even if they are more than `budget`.
    pub fn new<D: AsRef<[u8]>>(file: &Chpm<D>, budget: Bytes) -> Self {
        Pager::of(file, Residency::new(file, budget))
    }

    /// The same for pages with what belongs to them, by the bytes that each cluster takes.
    pub fn of_sizes<D: AsRef<[u8]>>(file: &Chpm<D>, budget: Bytes, sizes: Vec<u64>) -> Self {
        Pager::of(file, Residency::of_sizes(file, budget, sizes))
    }

    fn of<D: AsRef<[u8]>>(file: &Chpm<D>, residency: Residency) -> Self {
        Pager { wanted: Front::new(file), foreseen: Front::new(file), residency }
    }

    /// Goes on to a view: what to read for it, the most urgent first, and what to let go.
    pub fn want<D: AsRef<[u8]>>(&mut self, file: &Chpm<D>, hierarchy: &Hierarchy, view: &View) -> Traffic {
        self.follow(file, hierarchy, |group| hierarchy.bound(group, view), |_| true);
        let groups = self.wanted.split_groups().iter();
        let wanted = groups.map(|group| Wanted::by(view, hierarchy, *group)).collect();
        self.request(file, hierarchy, wanted)
    }

    /// The first half of [`Pager::want`], by bounds that somebody else keeps, and splitting only what is `allowed`.
    pub fn follow<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        bound_of: impl FnMut(GroupId) -> f32,
        allowed: impl Fn(GroupId) -> bool,
    ) {
        self.wanted.update_by(file, hierarchy, bound_of, allowed);
    }

    /// The second half, with priorities of the caller's own.
    pub fn request<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        wanted: Vec<Wanted>,
    ) -> Traffic {
        self.residency.update(file, hierarchy, wanted)
    }

    /// Prefetches for a view to come, after [`Pager::want`], up to `limit` bytes: all that it splits where that is `allowed`, and
    /// what it would split `next`.
    pub fn foresee<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        ahead: &View,
        limit: Bytes,
        allowed: impl Fn(GroupId) -> bool,
        next: impl Fn(GroupId) -> bool,
    ) -> Traffic {
        let Pager { wanted, foreseen, residency } = self;
        foreseen.update(file, hierarchy, ahead, |group| wanted.is_split(group) || allowed(group));
        let open = foreseen.open_groups().iter();
        let open = open.filter(|group| !file.fine(**group).is_empty() && next(**group));
        let groups = foreseen.split_groups().iter().chain(open);
        let ahead = groups.map(|group| Wanted::by(ahead, hierarchy, *group)).collect();
        residency.prefetch(file, hierarchy, ahead, limit)
    }

    /// Notes that a page has come; answers whether it was on its way.
    pub fn arrive<D: AsRef<[u8]>>(&mut self, file: &Chpm<D>, cluster: ClusterId) -> bool {
        self.residency.arrive(file, cluster)
    }

    /// Front of the last view, whether its pages are there or not.
    pub fn wanted(&self) -> &Front {
        &self.wanted
    }

    /// Whether the roots are there; nothing can be drawn before.
    pub fn has_roots(&self) -> bool {
        self.residency.has_roots()
    }

    /// Whether all that the split of a group brings is there.
    pub fn is_ready(&self, group: GroupId) -> bool {
        self.residency.is_ready(group)
    }

    /// Bytes of pages that are there or on their way.
    pub fn reserved(&self) -> Bytes {
        self.residency.reserved()
    }
}
