//! Draw list of one model: selection, pages in memory, and hidden parts.
//!
//! Two fronts: one that the view wants of the visible part, whether it is in memory or not; and the cut that is drawn, which follows as
//! far as pages have come and fit. Both stop at groups of which nothing is seen; a hidden group that is split stays so until memory
//! is short. Where something comes into the image, the boxes of all groups that it wants split are tested at once, level below level: a
//! camera that jumps has its cut one answer later, if the pages are there.

mod borders;
mod reach;
pub mod visibility;

use crate::error::ViewerError;
use crate::fetch::{Fetch, PageData, held_bytes};
use crate::gpu::TestBox;
use crate::gpu::block::Layout;
use crate::request::Budgets;
use crate::tint::Tint;
use borders::Borders;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, PageBuf};
use chpm_mesh::{Bytes, ClusterId, GroupId};
use chpm_refine::{
    ActiveList, Changes, Front, Hierarchy, Member, Pager, RefineError, Residency, Traffic, View, Wanted,
    is_visible,
};
use chpm_texture::sheet::Sizes;
pub use reach::{Reach, Span};
use std::cell::Cell;
use std::sync::Arc;
use std::time::Duration;
use visibility::{Sight, Subject, Visibility};

/// Kinds of culling.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Culling {
    /// Whether surface outside the image is culled.
    pub frustum: bool,
    /// Whether hidden surface is culled.
    pub occlusion: bool,
}

/// What a view sees of groups, as far as anything is culled.
struct Gaze<'a> {
    file: &'a Chpm<MappedFile>,
    hierarchy: &'a Hierarchy,
    visibility: &'a Visibility,
    view: &'a View,
    culling: Culling,
    /// Beams in which all is to be as fine as the camera wants it, for its shadow.
    reach: Option<&'a Reach>,
}

impl Gaze<'_> {
    fn sees(&self, group: GroupId) -> bool {
        let region = self.hierarchy.region(group);
        let is_outside = self.culling.frustum && self.view.misses(region);
        !is_outside && !self.is_hidden(group) || self.reach.is_some_and(|reach| reach.takes(region))
    }

    /// Whoever turns sees what is beside the image, but not what the clipping plane leaves out.
    fn may_turn_to(&self, group: GroupId) -> bool {
        let is_clipped = self.culling.frustum && self.view.clips(self.hierarchy.region(group));
        !is_clipped && !self.is_hidden(group)
    }

    fn is_hidden(&self, group: GroupId) -> bool {
        self.culling.occlusion && !self.visibility.sees(self.file, group)
    }
}

/// One model.
#[derive(Debug)]
pub struct Scene {
    file: Arc<Chpm<MappedFile>>,
    hierarchy: Hierarchy,
    list: ActiveList,
    /// By group: whether the cut has split it, or is about to.
    split: Vec<Cell<bool>>,
    /// By group: the bound of the last view that it was asked for.
    bounds: Bounds,
    pager: Pager,
    /// Which blocks the GPU would have, of what the GPU has room for; nothing is on its way there.
    gpu_residency: Residency,
    /// Most bytes on the GPU for a byte of a page.
    gpu_share: f64,
    /// Whether all that is in memory fits on the GPU too, so that nobody has to ask.
    gpu_has_room: bool,
    budgets: Budgets,
    fetch: Fetch,
    pages: Vec<Option<Arc<PageData>>>,
    borders: Borders,
    visibility: Visibility,
    /// By group: the last frame that it was asked in.
    asked: Vec<u32>,
    /// The first page that could not be read by a frame that did not wait.
    damage: Option<ViewerError>,
    /// All of those.
    damaged: Vec<ClusterId>,
    tint: Tint,
}

/// Clusters that came into sight.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct News {
    /// Clusters of the cut.
    pub clusters: u64,
    /// Groups, or something below them.
    pub groups: u64,
}

/// Threads that read pages.
const READERS: usize = 2;
/// Most bytes of blocks that readers have made and no frame has sent; at most an eighth of the memory.
const BLOCKS: Bytes = Bytes::mib(64);
/// Groups that are asked in a frame, beyond which none is asked before its turn.
const MOST_ASKED: usize = 2048;
/// Most bytes that are read ahead in a frame.
const AHEAD: Bytes = Bytes::mib(4);

impl Scene {
    /// Nothing is in memory; `gpu_room` are the bytes of blocks that the GPU can count on.
    ///
    /// # Errors
    /// [`ViewerError::Budget`], [`ViewerError::Open`], [`ViewerError::Thread`].
    pub fn new(
        file: Arc<Chpm<MappedFile>>,
        tint: Tint,
        budgets: Budgets,
        gpu_room: Bytes,
    ) -> Result<Self, ViewerError> {
        // The roots are never let go, so they have to fit.
        let (held, on_gpu) = (held_bytes(&file, &tint), gpu_bytes(&file, &tint));
        let page_bytes = Bytes(file.roots().map(|root| held[root.index()]).sum());
        if page_bytes > budgets.memory {
            return Err(ViewerError::Budget { what: "memory", needed: page_bytes, got: budgets.memory });
        }
        let root_bytes: u64 = file.roots().map(|root| on_gpu[root.index()]).sum();
        if root_bytes > gpu_room.0 {
            // What is lost at the ends of slabs comes on top.
            let needed = Bytes(root_bytes + 2 * on_gpu.iter().max().copied().unwrap_or(0));
            return Err(ViewerError::Budget { what: "GPU memory", needed, got: budgets.gpu_memory });
        }

        // Blocks that readers have made wait in main memory, which leaves less of it for pages.
        let room = BLOCKS.0.min(budgets.memory.0 / 8).min(budgets.memory.0 - page_bytes.0);
        let memory = Bytes(budgets.memory.0 - room);
        let fetch = Fetch::tinted(Arc::clone(&file), tint.clone(), READERS, memory)?;
        fetch.make_blocks(Bytes(room));

        Ok(Scene {
            gpu_share: on_gpu
                .iter()
                .zip(&held)
                .map(|(gpu, held)| *gpu as f64 / *held as f64)
                .fold(0.0, f64::max),
            gpu_has_room: true,
            split: vec![Cell::new(false); file.groups().len()],
            bounds: Bounds::new(file.groups().len()),
            hierarchy: Hierarchy::new(&file),
            list: ActiveList::of_checked_pages(&file),
            pager: Pager::of_sizes(&file, memory, held),
            gpu_residency: Residency::of_sizes(&file, gpu_room, on_gpu),
            fetch,
            pages: file.clusters().iter().map(|_| None).collect(),
            borders: Borders::new(&file),
            visibility: Visibility::new(&file),
            asked: vec![0; file.groups().len()],
            damage: None,
            damaged: Vec::new(),
            tint,
            budgets: Budgets { memory, gpu_memory: gpu_room },
            file,
        })
    }

    /// Where the colours of vertices come from.
    pub fn tint(&self) -> &Tint {
        &self.tint
    }

    /// Asks for what a view wants, and lets go what it does not need; `reach` is what throws shadows on what is seen. Answers the bytes of
    /// the pages asked for.
    pub fn want(&mut self, view: &View, culling: Culling, reach: Option<&Reach>) -> u64 {
        let (file, hierarchy, list) = (&*self.file, &self.hierarchy, self.list.front());
        self.bounds.turn();
        self.visibility.turn();

        // What is split stays so; what is not is split where somebody sees it.
        let bound = |group| self.bounds.of(group, hierarchy, view);
        let gaze = Gaze { file, hierarchy, visibility: &self.visibility, view, culling, reach };
        self.pager.follow(file, hierarchy, bound, |group| list.is_split(group) || gaze.sees(group));
        for entered in self.pager.wanted().entered() {
            self.visibility.forget(file.clusters()[entered.cluster.index()].group());
        }

        // Main memory first. Where all of that fits on the GPU too, nobody has to choose there.
        let wanted = self.wanted_by_priority(view, culling);
        let traffic = self.pager.request(&self.file, &self.hierarchy, wanted.clone());
        let most = self.pager.reserved().0 as f64 * self.gpu_share;
        self.gpu_has_room = most <= self.budgets.gpu_memory.0 as f64;
        if !self.gpu_has_room {
            let on_gpu = self.gpu_residency.update(&self.file, &self.hierarchy, wanted);
            for cluster in on_gpu.requests {
                self.gpu_residency.arrive(&self.file, cluster);
            }
        }
        self.dispatch(traffic, false)
    }

    /// Asks for what a view to come will want, after [`Scene::want`]: all that it splits, and what it would split next. Answers bytes.
    pub fn foresee(&mut self, ahead: &View, culling: Culling) -> u64 {
        let (file, hierarchy) = (&*self.file, &self.hierarchy);
        let visibility = &self.visibility;
        let gaze = Gaze { file, hierarchy, visibility, view: ahead, culling, reach: None };
        let traffic = self.pager.foresee(
            file,
            hierarchy,
            ahead,
            AHEAD,
            |group| gaze.sees(group),
            |group| gaze.may_turn_to(group),
        );
        self.dispatch(traffic, true)
    }

    /// The groups that are wanted split; where memory may be short, those of which nothing is seen come last.
    fn wanted_by_priority(&self, view: &View, culling: Culling) -> Vec<Wanted> {
        fn is_short(used: Bytes, all: Bytes) -> bool {
            used.0 > all.0 / 4 * 3
        }
        let short = is_short(self.pager.reserved(), self.budgets.memory)
            || is_short(self.gpu_residency.reserved(), self.budgets.gpu_memory);

        let (list, groups) = (self.list.front(), self.pager.wanted().split_groups());
        let wanted = groups.iter().map(|group| match !short && list.is_split(*group) {
            // It is there, and nobody asks which goes first.
            true => Wanted { group: *group, priority: f64::INFINITY },
            false => Wanted::by(view, &self.hierarchy, *group),
        });
        let mut wanted: Vec<Wanted> = wanted.collect();

        // A group is of use if anything below it is seen.
        if short && culling != (Culling { frustum: false, occlusion: false }) {
            let (file, hierarchy) = (&*self.file, &self.hierarchy);
            // What is seen by its shadow alone comes last.
            let visibility = &self.visibility;
            let gaze = Gaze { file, hierarchy, visibility, view, culling, reach: None };
            let mut seen = vec![false; file.groups().len()];
            for group in self.pager.wanted().open_groups() {
                seen[group.index()] = gaze.sees(*group);
            }
            // Those below come first.
            for wanted in wanted.iter_mut().rev() {
                let any = self
                    .file
                    .fine(wanted.group)
                    .iter()
                    .any(|fine| seen[self.file.clusters()[*fine as usize].group().index()]);
                seen[wanted.group.index()] |= any;
                if !seen[wanted.group.index()] {
                    wanted.priority = 0.0;
                }
            }
        }
        wanted
    }

    fn dispatch(&mut self, traffic: Traffic, ahead: bool) -> u64 {
        for cluster in traffic.evictions {
            self.pages[cluster.index()] = None;
            self.fetch.evict(cluster);
        }
        let mut requested_bytes = 0;
        for cluster in traffic.requests {
            requested_bytes += u64::from(self.file.clusters()[cluster.index()].page_len);
            if ahead {
                self.fetch.request_ahead(cluster)
            } else {
                self.fetch.request(cluster)
            };
        }
        requested_bytes
    }

    /// Takes in the pages that have come, and before that waits for what is on its way: as long as it takes if no patience is told.
    ///
    /// # Errors
    /// Those of reading a page.
    pub fn receive(&mut self, patience: Option<Duration>) -> Result<usize, ViewerError> {
        if patience.is_none() {
            // What could not be read is tried again.
            self.damaged.iter().for_each(|cluster| self.fetch.request(*cluster));
        }
        let arrived = match patience {
            None => self.fetch.wait_arrived(),
            Some(patience) if patience.is_zero() => self.fetch.try_arrived(),
            Some(patience) => self.fetch.wait_arrived_for(patience),
        };
        let count = arrived.len();
        for (cluster, page) in arrived {
            let page = match page {
                Ok(page) => {
                    self.damaged.retain(|damaged| *damaged != cluster);
                    page
                }
                // Who waits wants all of it. Who does not is shown what there is: the group above stays as it is.
                Err(error) if patience.is_none() => return Err(error),
                Err(error) => {
                    self.damage.get_or_insert(error);
                    self.damaged.push(cluster);
                    continue;
                }
            };
            if self.pager.arrive(&self.file, cluster) {
                self.pages[cluster.index()] = Some(page);
            }
        }
        Ok(count)
    }

    /// Whether something can be drawn.
    pub fn has_roots(&self) -> bool {
        self.pager.has_roots()
    }

    /// Reads the roots, and waits for them.
    ///
    /// # Errors
    /// Those of reading a page.
    pub fn read_roots(&mut self) -> Result<(), ViewerError> {
        let traffic = self.pager.request(&self.file, &self.hierarchy, Vec::new());
        self.dispatch(traffic, false);
        self.receive(None).map(drop)
    }

    /// Brings the cut to what is wanted and there, all of it or as far as what splits bring for the GPU is at most so many bytes; what
    /// exceeds them is split by a later frame, but for one split, which is always possible. `sent` is whether the GPU has the block of a
    /// cluster.
    ///
    /// # Errors
    /// None that a page which was checked could cause.
    pub fn refine(
        &mut self,
        view: &View,
        most: Option<u64>,
        sent: impl Fn(ClusterId) -> bool,
    ) -> Result<Changes, ViewerError> {
        let (file, pages) = (&*self.file, &self.pages);

        // A group may split where all of it is there, and one frame can send what it brings.
        let to_send = |clusters: &[u32]| {
            let clusters =
                clusters.iter().map(|cluster| ClusterId(*cluster)).filter(|cluster| !sent(*cluster));
            clusters.map(|cluster| sent_bytes(file, cluster, &self.tint)).sum::<u64>()
        };
        let brought = Cell::new(0);
        let ready = |group: GroupId| {
            let is_there =
                self.pager.is_ready(group) && (self.gpu_has_room || self.gpu_residency.is_ready(group));
            let Some(most) = most.filter(|_| is_there && !self.split[group.index()].get()) else {
                return is_there;
            };
            // What has entered with this update and leaves again is never sent.
            let bytes =
                (brought.get() + to_send(file.fine(group))).saturating_sub(to_send(file.coarse(group)));
            let has_place = brought.get() == 0 || bytes <= most;
            if has_place {
                brought.set(bytes);
                // It is asked about once more, whether it is to stay.
                self.split[group.index()].set(true);
            }
            has_place
        };

        let bound = |group| self.bounds.of(group, &self.hierarchy, view);
        let changes = self.list.update_with(file, &self.hierarchy, bound, ready, |cluster: ClusterId, _| {
            let page = pages[cluster.index()].as_ref();
            page.map(|page| PageBuf::from(page.page()))
                .ok_or(RefineError::Cluster { cluster, count: pages.len() })
        });
        if changes.is_err() {
            // The list starts anew.
            self.split.fill(Cell::new(false));
        }
        let changes = changes?;

        // Who has entered tells which groups are split now, and is as visible as what it came from.
        let front = self.list.front();
        for entered in front.entered() {
            let record = &file.clusters()[entered.cluster.index()];
            let group = if entered.finest { record.group() } else { record.parent_group() };
            self.split[group.index()].set(front.is_split(group));
        }
        self.visibility.follow(file, front.entered(), self.list.left(), |cluster: ClusterId| {
            front.is_active(&file.clusters()[cluster.index()])
        });
        Ok(changes)
    }

    /// Tells what is in the image and what not; without a test for occlusion, what is in it is visible.
    pub fn look(&mut self, view: &View, culling: Culling) {
        let clusters = self.file.clusters();
        for member in self.list.members() {
            let cluster = member.cluster;
            let outside = culling.frustum && !is_visible(&clusters[cluster.index()], view);
            let before = self.visibility.of(cluster);
            let now = match (outside, culling.occlusion) {
                (true, _) => Sight::Outside,
                (false, true) if before == Sight::Hidden => Sight::Hidden,
                // What comes into the image is drawn, and tested.
                (false, _) => Sight::Visible,
            };
            self.visibility.set(cluster, now);
        }
    }

    /// The clusters of the cut, and whether they are seen.
    pub fn members(&self) -> impl Iterator<Item = (Member, Sight)> + '_ {
        self.list.members().map(|member| (member, self.visibility.of(member.cluster)))
    }

    /// Groups that the view wants split, that are in the image, and of which nothing is seen: all below is to be asked for. With a group
    /// that nothing is known of, those below that the view would want next are asked too.
    pub fn doubtful(&mut self, view: &View, culling: Culling) -> Vec<(Subject, TestBox)> {
        let (file, hierarchy, asked, bounds) =
            (&*self.file, &self.hierarchy, &mut self.asked, &mut self.bounds);
        // The last update's view is this one.
        let turn = bounds.turn;
        let mut asks = |group: GroupId| {
            let is_new = std::mem::replace(&mut asked[group.index()], turn) != turn;
            let is_wanted = is_new && hierarchy.wants(group, bounds.of(group, hierarchy, view));
            is_wanted && (!culling.frustum || !view.misses(hierarchy.region(group)))
        };
        let open = self.pager.wanted().open_groups().iter().copied();
        let mut groups: Vec<GroupId> = open.filter(|group| asks(*group)).collect();
        let mut next = 0;
        while let Some(&group) = groups.get(next)
            && groups.len() < MOST_ASKED
        {
            next += 1;
            if !self.visibility.hides(group) {
                let below = file.fine(group).iter().map(|fine| file.clusters()[*fine as usize].group());
                groups.extend(below.filter(|below| asks(*below)));
            }
        }
        groups
            .into_iter()
            .map(|group| (Subject::Group(group), TestBox::of_region(hierarchy.region(group))))
            .collect()
    }

    /// Takes in answers.
    pub fn answer(&mut self, answers: impl Iterator<Item = (Subject, bool)>) -> News {
        let mut news = News::default();
        for (subject, visible) in answers {
            let count = match subject {
                Subject::Cluster(_) => &mut news.clusters,
                Subject::Group(_) => &mut news.groups,
            };
            *count += u64::from(self.visibility.answer(subject, visible));
        }
        news
    }

    /// Why some of the model stays coarser than it is wanted, if anything of the file could not be read.
    pub fn damage(&self) -> Option<&ViewerError> {
        self.damage.as_ref()
    }

    /// The page of a cluster of the cut.
    pub fn page(&self, cluster: ClusterId) -> Option<&Arc<PageData>> {
        self.pages[cluster.index()].as_ref()
    }

    /// The file.
    pub fn file(&self) -> &Arc<Chpm<MappedFile>> {
        &self.file
    }

    /// Number of clusters of the cut.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Bytes of pages that are there or on their way.
    pub fn resident(&self) -> Bytes {
        self.pager.reserved()
    }

    /// Groups that are wanted split and are not.
    pub fn withheld(&self) -> u64 {
        fn splits(front: &Front) -> u64 {
            front.split_groups().len() as u64
        }
        splits(self.pager.wanted()).saturating_sub(splits(self.list.front()))
    }
}

/// The bounds of one view, for all fronts that follow it.
#[derive(Clone, Debug)]
struct Bounds {
    turn: u32,
    /// By group: the turn that it was asked for in, and the answer.
    known: Vec<(u32, f32)>,
}

impl Bounds {
    fn new(groups: usize) -> Self {
        Bounds { turn: 0, known: vec![(0, 0.0); groups] }
    }

    /// Another view.
    fn turn(&mut self) {
        self.turn = self.turn.wrapping_add(1);
        if self.turn == 0 {
            self.known.fill((0, 0.0));
            self.turn = 1;
        }
    }

    fn of(&mut self, group: GroupId, hierarchy: &Hierarchy, view: &View) -> f32 {
        let known = &mut self.known[group.index()];
        if known.0 != self.turn {
            *known = (self.turn, hierarchy.bound(group, view));
        }
        known.1
    }
}

#[cfg(test)]
#[path = "../../chpm-refine/examples/front_pass/plane.rs"]
mod plane;

/// Bytes of each cluster's block.
pub fn gpu_bytes(file: &Chpm<MappedFile>, tint: &Tint) -> Vec<u64> {
    let ids = (0..file.header().cluster_count).map(ClusterId);
    ids.map(|id| Layout::of(file, id, tint).bytes()).collect()
}

/// Bytes that a cluster takes to be sent: its block, and its sheet.
fn sent_bytes(file: &Chpm<MappedFile>, cluster: ClusterId, tint: &Tint) -> u64 {
    let sheet = tint
        .longest_sheet()
        .map_or(0, |longest| Sizes::bytes_of(file.sheets()[cluster.index()].size, longest));
    Layout::of(file, cluster, tint).bytes() + sheet
}
