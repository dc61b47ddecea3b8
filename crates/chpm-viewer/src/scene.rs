//! What is drawn of one model: selection, pages in memory, and what is hidden.
//!
//! Two fronts: what the view wants of what may be seen, whether it is in memory or not; and the cut that is drawn, which follows as
//! far as pages have come and fit. Both stop at groups of which nothing is seen; a hidden group that is split stays so until memory
//! is short. A group enters the wanted front one level a frame, since its box must be asked first.

pub mod visibility;

use crate::error::ViewerError;
use crate::fetch::{Fetch, PageData};
use crate::gpu::TestBox;
use crate::gpu::block::Layout;
use crate::request::Budgets;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, ClusterRecord};
use chpm_mesh::{Bytes, ClusterId, GroupId};
use chpm_refine::{
    ActiveList, Changes, Front, Hierarchy, Member, RefineError, Residency, Traffic, View, Wanted, is_visible,
};
use std::sync::Arc;
use visibility::{Sight, Subject, Visibility};

/// What is culled.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Culling {
    /// What lies outside the image.
    pub frustum: bool,
    /// What is hidden.
    pub occlusion: bool,
}

/// One model.
#[derive(Debug)]
pub struct Scene {
    file: Arc<Chpm<MappedFile>>,
    hierarchy: Hierarchy,
    wanted: Front,
    foreseen: Front,
    list: ActiveList,
    residency: Residency,
    /// The same for what the GPU has room for; nothing is on its way there.
    gpu_residency: Residency,
    budgets: Budgets,
    fetch: Fetch,
    pages: Vec<Option<Arc<PageData>>>,
    visibility: Visibility,
}

/// What a selection did.
#[derive(Clone, Copy, Debug, Default)]
pub struct Selected {
    /// Pages asked for, bytes.
    pub requested_bytes: u64,
}

/// Threads that read pages.
const READERS: usize = 2;
/// Most bytes that are read ahead in a frame.
const AHEAD: Bytes = Bytes::mib(4);

impl Scene {
    /// Nothing is in memory; `gpu_room` are the bytes of blocks that the GPU can count on.
    ///
    /// # Errors
    /// [`ViewerError::Budget`], [`ViewerError::Open`], [`ViewerError::Thread`].
    pub fn new(file: Arc<Chpm<MappedFile>>, budgets: Budgets, gpu_room: Bytes) -> Result<Self, ViewerError> {
        let of_roots = |size: fn(&ClusterRecord) -> u64| {
            Bytes(file.roots().map(|root| size(&file.clusters()[root.index()])).sum())
        };
        let page_bytes = of_roots(|cluster| u64::from(cluster.page_len));
        for (what, needed, got) in [
            ("memory", page_bytes, budgets.memory),
            ("GPU memory", of_roots(|cluster| gpu_bytes(cluster, true)), gpu_room),
        ] {
            if needed > got {
                return Err(ViewerError::Budget { what, needed, got });
            }
        }
        let colors = file.header().attributes().colors;
        Ok(Scene {
            hierarchy: Hierarchy::new(&file),
            wanted: Front::new(&file),
            foreseen: Front::new(&file),
            list: ActiveList::of_checked_pages(&file),
            residency: Residency::new(&file, budgets.memory),
            gpu_residency: Residency::of_sizes(&file, gpu_room, |cluster| gpu_bytes(cluster, colors)),
            fetch: Fetch::new(Arc::clone(&file), READERS, budgets.memory)?,
            pages: file.clusters().iter().map(|_| None).collect(),
            visibility: Visibility::new(&file),
            budgets: Budgets { gpu_memory: gpu_room, ..budgets },
            file,
        })
    }

    /// Asks for what a view wants, and lets go what it does not need.
    pub fn want(&mut self, view: &View, culling: Culling) -> Selected {
        let (file, hierarchy, list) = (&*self.file, &self.hierarchy, self.list.front());
        let visibility = &self.visibility;
        self.wanted.update(file, hierarchy, view, |group| {
            let in_image = || !culling.frustum || !view.misses(hierarchy.region(group));
            let seen = || !culling.occlusion || visibility.sees(file, group);
            list.is_split(group) || in_image() && seen()
        });
        for entered in self.wanted.entered() {
            self.visibility.forget(file.clusters()[entered.cluster.index()].group());
        }
        let wanted = self.wanted_by_priority(view, culling);
        let on_gpu = self.gpu_residency.update(file, hierarchy, wanted.clone());
        for cluster in on_gpu.requests {
            self.gpu_residency.arrive(file, cluster);
        }
        let traffic = self.residency.update(file, hierarchy, wanted);
        self.dispatch(traffic, false)
    }

    /// Asks for what a view to come will want, after [`Scene::want`]: all that it splits, and what it would split next.
    pub fn foresee(&mut self, ahead: &View, culling: Culling) -> Selected {
        let (file, hierarchy, visibility) = (&*self.file, &self.hierarchy, &self.visibility);
        let known = &self.wanted;
        self.foreseen.update(file, hierarchy, ahead, |group| {
            let in_image = || !culling.frustum || !ahead.misses(hierarchy.region(group));
            let seen = || !culling.occlusion || visibility.sees(file, group);
            known.is_split(group) || in_image() && seen()
        });
        let open = self.foreseen.open_groups().iter();
        let next = open.filter(|group| {
            !file.fine(**group).is_empty() && (!culling.occlusion || visibility.sees(file, **group))
        });
        let groups = self.foreseen.split_groups().iter().chain(next);
        let ahead = groups.map(|group| self.asked(*group, ahead)).collect();
        let traffic = self.residency.prefetch(file, hierarchy, ahead, AHEAD);
        self.dispatch(traffic, true)
    }

    fn asked(&self, group: GroupId, view: &View) -> Wanted {
        let error = self.hierarchy.split_error(group).unwrap_or(0.0);
        Wanted { group, priority: view.pixels_of(error, self.hierarchy.region(group)) }
    }

    /// The groups that are wanted split; where memory may be short, those of which nothing is seen come last.
    fn wanted_by_priority(&self, view: &View, culling: Culling) -> Vec<Wanted> {
        let split = self.wanted.split_groups();
        let mut wanted: Vec<Wanted> = split.iter().map(|group| self.asked(*group, view)).collect();
        let is_short = |used: Bytes, all: Bytes| used.0 > all.0 / 4 * 3;
        let short = is_short(self.residency.reserved(), self.budgets.memory)
            || is_short(self.gpu_residency.reserved(), self.budgets.gpu_memory);
        if short && culling != (Culling { frustum: false, occlusion: false }) {
            let mut seen = vec![false; self.file.groups().len()];
            for group in self.wanted.open_groups() {
                let in_image = !culling.frustum || !view.misses(self.hierarchy.region(*group));
                seen[group.index()] =
                    in_image && (!culling.occlusion || self.visibility.sees(&self.file, *group));
            }
            // Those below come first.
            for wanted in wanted.iter_mut().rev() {
                let below = |fine: &u32| seen[self.file.clusters()[*fine as usize].group().index()];
                let any = self.file.fine(wanted.group).iter().any(below);
                seen[wanted.group.index()] |= any;
                if !seen[wanted.group.index()] {
                    wanted.priority = 0.0;
                }
            }
        }
        wanted
    }

    fn dispatch(&mut self, traffic: Traffic, ahead: bool) -> Selected {
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
        Selected { requested_bytes }
    }

    /// Takes in the pages that have come; waits for all that is on its way if told to.
    ///
    /// # Errors
    /// Those of reading a page.
    pub fn receive(&mut self, wait: bool) -> Result<usize, ViewerError> {
        let arrived = if wait { self.fetch.wait_arrived() } else { self.fetch.try_arrived() };
        let count = arrived.len();
        for (cluster, page) in arrived {
            let page = page?;
            if self.residency.arrive(&self.file, cluster) {
                self.pages[cluster.index()] = Some(page);
            }
        }
        Ok(count)
    }

    /// Whether something can be drawn.
    pub fn has_roots(&self) -> bool {
        self.residency.has_roots()
    }

    /// Brings the cut to what is wanted and there.
    ///
    /// # Errors
    /// None that a page which was checked could cause.
    pub fn refine(&mut self, view: &View) -> Result<Changes, ViewerError> {
        let (file, pages) = (&*self.file, &self.pages);
        let ready = |group| self.residency.is_ready(group) && self.gpu_residency.is_ready(group);
        let page = |cluster: ClusterId, _| {
            let page = pages[cluster.index()].as_ref();
            page.map(|page| page.page()).ok_or(RefineError::Cluster { cluster, count: pages.len() })
        };
        let changes = self.list.update_with(file, &self.hierarchy, view, ready, page)?;
        let front = self.list.front();
        let is_active = |cluster: ClusterId| front.is_active(&file.clusters()[cluster.index()]);
        self.visibility.follow(file, front.entered(), self.list.left(), is_active);
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

    /// Groups that the view wants split, that are in the image, and of which nothing is seen: all below is to be asked for.
    pub fn doubtful<'a>(
        &'a self,
        view: &'a View,
        culling: Culling,
    ) -> impl Iterator<Item = (Subject, TestBox)> + 'a {
        self.wanted.open_groups().iter().copied().filter_map(move |group| {
            let region = self.hierarchy.region(group);
            let is_wanted = self.hierarchy.wants(group, view.bound(region));
            let in_image = !culling.frustum || !view.misses(region);
            (is_wanted && in_image).then(|| (Subject::Group(group), TestBox::of_region(region)))
        })
    }

    /// Takes in answers; answers how many things came into sight.
    pub fn answer(&mut self, answers: impl Iterator<Item = (Subject, bool)>) -> u64 {
        answers.map(|(subject, visible)| u64::from(self.visibility.answer(subject, visible))).sum()
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

    /// Whether nothing was selected yet.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Bytes of pages that are there or on their way.
    pub fn resident(&self) -> Bytes {
        self.residency.reserved()
    }

    /// Groups that are wanted split and are not.
    pub fn withheld(&self) -> u64 {
        let splits = |front: &Front| front.split_groups().len() as u64;
        splits(&self.wanted).saturating_sub(splits(self.list.front()))
    }
}

/// Bytes of a cluster's block.
pub fn gpu_bytes(cluster: &ClusterRecord, colors: bool) -> u64 {
    Layout::new(cluster.vertex_count, cluster.base_vertex_count, cluster.triangle_count, colors).bytes()
}
