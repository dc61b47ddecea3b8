//! The way of one ray through the tree of groups and the meshes that are there.

use crate::bound::Bound;
use crate::mesh::{Found, Mesh};
use crate::ray::{LOST, Ray, Ready, Seek};
use crate::tree::{MeshKey, Tree};
use crate::wide::{FIRST, LEAF, Wide, over};
use chpm_format::{Chpm, ClusterRecord, GroupRecord};
use chpm_mesh::Aabb;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// A split group, a node or a mesh that a ray still has to look at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Open {
    /// From where the ray comes to the model's box.
    enter: f32,
    what: u32,
}

/// Above it are meshes, below groups.
const MESH: u32 = 1 << 31;

/// Boxes over meshes, in place of groups.
#[derive(Debug)]
pub(crate) struct Flat {
    nodes: Vec<Wide>,
    /// None where there is no mesh.
    top: Option<u32>,
}

impl Flat {
    pub(crate) fn new<D: AsRef<[u8]>>(file: &Chpm<D>, keys: &[MeshKey]) -> Self {
        let bounds = |key: &MeshKey| file.clusters()[*key as usize / 2].aabb();
        let mut boxes: Vec<(Aabb, u32)> = keys.iter().map(|key| (bounds(key), *key)).collect();
        let mut nodes = Vec::new();
        let top = (!boxes.is_empty()).then(|| over(&mut boxes, &mut nodes));
        Flat { nodes, top }
    }
}

/// An entry of boxes over meshes as one of those that are open.
fn opened(below: u32) -> u32 {
    if below & LEAF != 0 { MESH | below & FIRST } else { below }
}

/// How a ray is about to go on.
#[derive(Clone, Debug)]
pub(crate) enum State {
    Begins,
    /// Until this mesh is in memory.
    Waits(MeshKey, Found, Box<[Open]>),
    Done(Found),
}

/// A mesh in memory, and when it last was needed.
#[derive(Debug)]
pub(crate) struct Resident {
    pub(crate) mesh: Arc<Mesh>,
    pub(crate) last: AtomicU32,
}

/// All that rays have in common.
pub(crate) struct Walk<'w, 'a, D> {
    pub(crate) file: &'a Chpm<D>,
    /// Tables of the file.
    pub(crate) clusters: &'a [ClusterRecord],
    pub(crate) records: &'a [GroupRecord],
    pub(crate) members: &'a [u32],
    pub(crate) tree: &'w Tree,
    pub(crate) bound: &'w Bound,
    pub(crate) seek: Seek,
    /// Boxes over the meshes of a bound that is common to all rays.
    pub(crate) flat: Option<&'w Flat>,
    pub(crate) meshes: &'w [Option<Resident>],
    pub(crate) round: u32,
}

impl<D: AsRef<[u8]>> Walk<'_, '_, D> {
    /// Goes on until the ray is through, or has come to a mesh that is not in memory. `open` is scratch.
    pub(crate) fn go(&self, ray: &Ray, state: State, open: &mut Vec<Open>) -> State {
        let wider = if let Seek::Within(distance) = self.seek { distance * (1.0 + 1e-6) } else { 0.0 };
        open.clear();
        let (ready, mut found) = match state {
            State::Done(_) => return state,
            State::Waits(_, found, kept) => {
                open.extend_from_slice(&kept);
                (Ready::new(ray, &self.file.header().aabb(), wider), found)
            }
            State::Begins => {
                let found = Found { hit: None, upper: ray.reach, is_met: false };
                let ready = Ready::new(ray, &self.file.header().aabb(), wider);
                if let Some(ready) = &ready {
                    self.begin(ray, ready, &found, open);
                }
                (ready, found)
            }
        };
        let Some(ready) = ready else { return State::Done(found) };

        while let Some(next) = open.pop() {
            let limit = found.limit(&ready);
            if next.enter * (1.0 - LOST) > limit * (1.0 + LOST) {
                continue;
            }
            if next.what & MESH == 0 {
                if let Some(flat) = self.flat {
                    let begin = open.len();
                    for (enter, below) in flat.nodes[next.what as usize].enter(&ready, limit) {
                        let entry = Open { enter, what: opened(below) };
                        open.push(entry);
                        let mut at = open.len() - 1;
                        while at > begin && open[at - 1].enter < enter {
                            open[at] = open[at - 1];
                            at -= 1;
                        }
                        open[at] = entry;
                    }
                    continue;
                }
                self.split(next.what, ray, &ready, &found, open);
                continue;
            }
            let key = next.what & !MESH;
            let Some(resident) = &self.meshes[key as usize] else {
                open.push(next);
                return State::Waits(key, found, open.as_slice().into());
            };
            if resident.last.load(Relaxed) != self.round {
                resident.last.store(self.round, Relaxed);
            }
            resident.mesh.meet(&ready, self.seek, key / 2, &mut found);
            if self.seek == Seek::Any && found.hit.is_some() {
                break;
            }
        }
        State::Done(found)
    }

    fn is_split(&self, group: u32, ray: &Ray) -> bool {
        self.tree.is_split(group, self.bound, &ray.origin, ray.cap)
    }

    /// Begins at the groups without one above, and at the roots.
    fn begin(&self, ray: &Ray, ready: &Ready, found: &Found, open: &mut Vec<Open>) {
        if let Some(flat) = self.flat {
            open.extend(flat.top.map(|top| Open { enter: 0.0, what: opened(top) }));
            return;
        }
        self.groups(&self.tree.top, ray, ready, found, open);
        self.bases(self.tree.roots.iter().copied(), ray, ready, found, open);
        sort(open);
    }

    /// Takes the place of a split group: all that is below it.
    fn split(&self, group: u32, ray: &Ray, ready: &Ready, found: &Found, open: &mut Vec<Open>) {
        let begin = open.len();
        let record = &self.records[group as usize];
        let members = |first: u32, count: u32| &self.members[first as usize..][..count as usize];
        let fine = members(record.fine_first, record.fine_count);
        if fine.is_empty() {
            for cluster in members(record.coarse_first, record.coarse_count) {
                self.mesh(*cluster, true, ready, found, open);
            }
        } else {
            self.groups(self.tree.below(group), ray, ready, found, open);
            self.bases(fine.iter().copied(), ray, ready, found, open);
        }
        sort(&mut open[begin..]);
    }

    fn groups(&self, groups: &[u32], ray: &Ray, ready: &Ready, found: &Found, open: &mut Vec<Open>) {
        for group in groups {
            let bounds = &self.tree.boxes[*group as usize];
            let enter = ready.slabs.enter(&bounds.min, &bounds.max, found.limit(ready));
            if enter < f32::INFINITY && self.is_split(*group, ray) {
                open.push(Open { enter, what: *group });
            }
        }
    }

    /// The base meshes of those clusters whose own group is not split.
    fn bases(
        &self,
        clusters: impl Iterator<Item = u32>,
        ray: &Ray,
        ready: &Ready,
        found: &Found,
        open: &mut Vec<Open>,
    ) {
        for cluster in clusters {
            let group = self.clusters[cluster as usize].group();
            if !self.is_split(group.0, ray) {
                self.mesh(cluster, false, ready, found, open);
            }
        }
    }

    fn mesh(&self, cluster: u32, is_finest: bool, ready: &Ready, found: &Found, open: &mut Vec<Open>) {
        let bounds = self.clusters[cluster as usize].aabb();
        let enter = ready.slabs.enter(&bounds.min, &bounds.max, found.limit(ready));
        if enter < f32::INFINITY {
            open.push(Open { enter, what: MESH | (2 * cluster) | u32::from(is_finest) });
        }
    }
}

/// The nearest last.
fn sort(open: &mut [Open]) {
    open.sort_unstable_by(|a, b| b.enter.total_cmp(&a.enter).then(a.what.cmp(&b.what)));
}
