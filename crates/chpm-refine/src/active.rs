//! The active cluster list: the clusters of the cut and their PM positions, from frame to frame.

use crate::cut::{Cut, Member};
use crate::error::RefineError;
use crate::front::{Changes, Front};
use crate::hierarchy::Hierarchy;
use crate::view::View;
use chpm_format::{Chpm, Page, PageBuf};
use chpm_mesh::{ClusterId, GroupId};

/// The incremental selection (Quick-VDR 5.1, 5.3): the same cut and the same positions as [`crate::select()`], for the price of what
/// changes. A cluster's page is checked when it enters the list and looked at again only where its position moves.
#[derive(Clone, Debug)]
pub struct ActiveList {
    front: Front,
    members: Vec<Active>,
    left: Vec<ClusterId>,
    /// Pages were checked before.
    trusting: bool,
}

#[derive(Clone, Copy, Debug)]
struct Active {
    member: Member,
    group: GroupId,
    /// The position is right for bounds from here ...
    low: f32,
    /// ... to below here; for any larger one if this is no number.
    high: f32,
}

impl ActiveList {
    /// The coarsest clusters of a file, before any view: the list is empty until the first update.
    pub fn new<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        ActiveList { front: Front::new(file), members: Vec::new(), left: Vec::new(), trusting: false }
    }

    /// The same for a caller who checks every page ([`Chpm::page`]) before the list may need it, when it is read for example: nothing is
    /// checked when a cluster enters. A page that was not checked may then cause a panic if it is damaged.
    pub fn of_checked_pages<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        ActiveList { trusting: true, ..ActiveList::new(file) }
    }

    /// Goes on to a view; `allowed` as [`Front::update`] has it. The first update takes the roots from their base meshes.
    ///
    /// # Errors
    /// [`RefineError::Format`] for a damaged page; the list then starts anew with the next update.
    pub fn update<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        view: &View,
        allowed: impl Fn(GroupId) -> bool,
    ) -> Result<Changes, RefineError> {
        let trusting = self.trusting;
        self.update_with(
            file,
            hierarchy,
            |group| hierarchy.bound(group, view),
            allowed,
            |cluster, enters| {
                let checks = enters && !trusting;
                Ok(if checks { file.page(cluster)? } else { file.page_known(cluster)? })
            },
        )
    }

    /// The same for bounds that somebody else keeps ([`Front::update_by`]), and pages that are somewhere else than in the file: `page` is
    /// asked for those of clusters that enter (then with `true`) and of those whose positions move.
    ///
    /// # Errors
    /// What `page` answers; the list then starts anew with the next update.
    pub fn update_with<'p, D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        bound_of: impl FnMut(GroupId) -> f32,
        allowed: impl Fn(GroupId) -> bool,
        page: impl Fn(ClusterId, bool) -> Result<PageBuf<'p>, RefineError>,
    ) -> Result<Changes, RefineError> {
        // No change brings them.
        let roots: Vec<_> = if self.members.is_empty() { file.roots().collect() } else { Vec::new() };
        let mut changes = self.front.update_by(file, hierarchy, bound_of, allowed);
        let moved = self.position(file, &roots, changes.splits + changes.collapses > 0, page);
        if moved.is_err() {
            *self = ActiveList { trusting: self.trusting, ..ActiveList::new(file) };
        }
        changes.pm_steps = moved?;
        Ok(changes)
    }

    /// Brings the list to the front's cut and every member to its position; answers the steps.
    fn position<'p, D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        roots: &[ClusterId],
        changed: bool,
        page: impl Fn(ClusterId, bool) -> Result<PageBuf<'p>, RefineError>,
    ) -> Result<u64, RefineError> {
        let (front, left) = (&self.front, &mut self.left);
        let clusters = file.clusters();
        left.clear();

        if changed {
            self.members.retain(|active| {
                let cluster = active.member.cluster;
                let stays = front.is_active(&clusters[cluster.index()]);
                if !stays {
                    left.push(cluster);
                }
                stays
            });
        }

        let mut steps = 0;
        for active in &mut self.members {
            let bound = front.bound(active.group);
            if !active.is_right_for(bound) {
                let before = active.member.vertices;
                let cluster = active.member.cluster;
                *active = Active::new(cluster, active.group, &page(cluster, false)?.view(), bound);
                steps += u64::from(before.abs_diff(active.member.vertices));
            }
        }

        let entered = front.entered().iter().map(|entered| (entered.cluster, entered.finest));
        for (cluster, finest) in roots.iter().map(|root| (*root, false)).chain(entered) {
            let record = &clusters[cluster.index()];
            if front.is_active(record) {
                let group = record.group();
                let active = Active::new(cluster, group, &page(cluster, true)?.view(), front.bound(group));
                let before = if finest { record.vertex_count } else { record.base_vertex_count };
                steps += u64::from(before.abs_diff(active.member.vertices));
                self.members.push(active);
            }
        }
        Ok(steps)
    }

    /// The groups.
    pub fn front(&self) -> &Front {
        &self.front
    }

    /// Number of clusters of the cut.
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// Whether no view has been asked for yet.
    pub fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// The clusters of the cut at their positions, in an order that depends on the path.
    pub fn members(&self) -> impl Iterator<Item = Member> + '_ {
        self.members.iter().map(|active| active.member)
    }

    /// The clusters that left with the last update.
    pub fn left(&self) -> &[ClusterId] {
        &self.left
    }

    /// The cut; O(n log n).
    pub fn cut(&self) -> Cut {
        Cut::new(self.members().collect())
    }
}

impl Active {
    fn new(cluster: ClusterId, group: GroupId, page: &Page<'_>, bound: f32) -> Self {
        let n = page.vertices_for(bound);
        let finest = n == page.vertex_count();
        Active {
            member: Member { cluster, vertices: n as u32 },
            group,
            // The finest mesh serves bounds that nothing keeps to as well.
            low: if finest { 0.0 } else { page.error_at(n) },
            high: if n == page.base_vertex_count { f32::NAN } else { page.error_at(n - 1) },
        }
    }

    /// Whether the position is the one for this bound.
    fn is_right_for(&self, bound: f32) -> bool {
        let too_coarse = bound < self.low;
        let too_fine = bound >= self.high;
        !too_coarse && !too_fine
    }
}
