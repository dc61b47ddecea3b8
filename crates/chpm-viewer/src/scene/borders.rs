//! Which way a smooth surface faces where clusters meet, of files without normals: the same for all clusters that have a vertex, whichever of
//! them are drawn.
//!
//! A cluster has only a part of the faces about a vertex that it shares. All of them are in the coarsest clusters that still have the vertex,
//! and those are always read before any finer ones, together: a vertex that goes on upward is in the clusters above a split, too, one that
//! collapses does so in one group, and is drawn only with all of it. So what those clusters say holds for all below, depends on nothing but
//! the file, and is known before the vertex is drawn. It takes four bytes for each id.
//!
//! Collapses beside a vertex may also leave a cluster without a face about it, while it goes on in others of the group: that cluster says nothing about it then.

use super::Scene;
use crate::fetch::PageData;
use crate::gpu::Block;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Page};
use chpm_mesh::facing::{Facing, area};
use chpm_mesh::{ClusterId, GroupId};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Facts about shared vertices.
#[derive(Clone, Debug, Default)]
pub(super) struct Borders {
    /// By id: which way it faces, so changed that 0 is what no code can be.
    codes: Vec<u32>,
    /// By group: whether what its split brings has been looked at, and what collapses in it.
    below: Vec<bool>,
    group_borders: Vec<bool>,
    roots: bool,
}

/// No vertex has this code.
const UNKNOWN: u32 = 0x8000_8000;

/// Clusters that are looked at together.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Together {
    Roots,
    /// A group whose split brings it.
    Below(GroupId),
    /// The coarse clusters of a group, for what collapses in them.
    GroupBorders(GroupId),
}

impl Borders {
    /// Nothing is known; nothing need be where the file has normals.
    pub(super) fn new(file: &Chpm<MappedFile>) -> Self {
        if file.header().attributes().has_normals() {
            return Borders::default();
        }
        let groups = file.groups().len();
        Borders {
            codes: vec![0; file.header().shared_vertex_count as usize],
            below: vec![false; groups],
            group_borders: vec![false; groups],
            roots: false,
        }
    }

    fn code(&self, id: u32) -> Option<u32> {
        Some(self.codes[id as usize] ^ UNKNOWN).filter(|code| *code != UNKNOWN)
    }

    fn is_done(&mut self, together: Together) -> &mut bool {
        match together {
            Together::Roots => &mut self.roots,
            Together::Below(group) => &mut self.below[group.index()],
            Together::GroupBorders(group) => &mut self.group_borders[group.index()],
        }
    }

    /// Looks at clusters, if all of their pages are there, and at those above them before.
    fn learn(&mut self, file: &Chpm<MappedFile>, pages: &[Option<Arc<PageData>>], together: Together) {
        let mut due = vec![together];
        while let Some(&together) = due.last() {
            let before = due.len();
            if let Together::Below(group) | Together::GroupBorders(group) = together
                && !*self.is_done(together)
            {
                let above = file.coarse(group).iter().map(|coarse| brought_by(file, ClusterId(*coarse)));
                // What has collapsed in the group is there below it.
                let borders = (together == Together::Below(group)).then_some(Together::GroupBorders(group));
                for above in above.chain(borders) {
                    if !*self.is_done(above) {
                        due.push(above);
                    }
                }
            }
            if due.len() == before {
                due.pop();
                if !*self.is_done(together) && !self.look(file, pages, together) {
                    return;
                }
                *self.is_done(together) = true;
            }
        }
    }

    /// Takes in what clusters have about each vertex that nothing is known of; not without all of their pages.
    fn look(&mut self, file: &Chpm<MappedFile>, pages: &[Option<Arc<PageData>>], together: Together) -> bool {
        let clusters: Vec<u32> = match together {
            Together::Roots => file.roots().map(|root| root.0).collect(),
            Together::Below(group) => file.fine(group).to_vec(),
            Together::GroupBorders(group) => file.coarse(group).to_vec(),
        };

        let pages: Option<Vec<_>> = clusters.iter().map(|id| pages[*id as usize].as_ref()).collect();
        let Some(pages) = pages else { return false };
        let mut faces: HashMap<u32, Vec<[f64; 3]>> = HashMap::new();
        let (mut ids, mut going_on) = (Vec::new(), HashSet::new());

        for page in pages {
            let page = page.page();
            ids.clear();
            ids.resize(page.vertex_count(), None);
            for (vertex, id) in page.shared() {
                let collapses = usize::from(vertex) >= page.base_vertex_count;
                if self.code(id).is_none() && collapses == matches!(together, Together::GroupBorders(_)) {
                    ids[usize::from(vertex)] = Some(id);
                }
            }
            if !matches!(together, Together::GroupBorders(_)) && ids.iter().any(Option::is_some) {
                let left = left(&page);
                let here = ids.iter().enumerate().filter(|(vertex, _)| left.get(*vertex) == Some(&true));
                going_on.extend(here.filter_map(|(_, id)| *id));
            }
            for corners in page.triangles {
                for id in corners.iter().filter_map(|vertex| ids[usize::from(*vertex)]) {
                    faces.entry(id).or_default().push(area(page.positions, corners));
                }
            }
        }

        let collapses = matches!(together, Together::GroupBorders(_));
        for (id, faces) in faces.into_iter().filter(|(id, _)| collapses || going_on.contains(id)) {
            self.codes[id as usize] = Facing::of_faces(&faces).code() ^ UNKNOWN;
        }
        true
    }
}

/// Per base vertex, whether a triangle of the base mesh has it.
fn left(page: &Page<'_>) -> Vec<bool> {
    let base = page.base_vertex_count;
    let mut to: Vec<u16> = (0..base).map(|vertex| vertex as u16).collect();
    for target in page.targets {
        to.push(to[usize::from(*target)]);
    }
    let mut left = vec![false; base];
    for corners in page.triangles {
        let [a, b, c] = corners.map(|corner| to[usize::from(corner)]);
        if a != b && b != c && c != a {
            [a, b, c].iter().for_each(|corner| left[usize::from(*corner)] = true);
        }
    }
    left
}

/// Whether a vertex of a group goes on to the clusters above it; none if a page is missing.
fn goes_on(
    file: &Chpm<MappedFile>,
    pages: &[Option<Arc<PageData>>],
    group: GroupId,
    id: u32,
) -> Option<bool> {
    let mut any = false;
    for coarse in file.coarse(group) {
        let page = pages[*coarse as usize].as_ref()?.page();
        if let Some((vertex, _)) = page.shared().find(|(_, other)| *other == id) {
            any |= left(&page).get(usize::from(vertex)) == Some(&true);
        }
    }
    Some(any)
}

/// Those that a cluster is read with.
fn brought_by(file: &Chpm<MappedFile>, cluster: ClusterId) -> Together {
    let record = &file.clusters()[cluster.index()];
    if record.is_root() { Together::Roots } else { Together::Below(record.parent_group()) }
}

impl Scene {
    /// Block of a cluster of the cut for the GPU, and the first vertex of which it is not known yet which way it faces: one that is not
    /// drawn before all of the cluster's group is there.
    pub fn block(&mut self, cluster: ClusterId) -> Option<(Block, u32)> {
        let Scene { file, pages, borders, .. } = self;
        let data = pages[cluster.index()].as_ref()?;
        let (page, mut block) = (data.page(), data.block());
        let mut turned = page.vertex_count() as u32;
        if !borders.codes.is_empty() {
            borders.learn(file, pages, brought_by(file, cluster));
            let group = file.clusters()[cluster.index()].group();
            let left = left(&page);
            let is_left = |vertex: u16| left.get(usize::from(vertex)) == Some(&true);
            if page.shared().any(|(vertex, _)| !is_left(vertex)) {
                borders.learn(file, pages, Together::GroupBorders(group));
            }
            for (vertex, id) in page.shared() {
                let ends = usize::from(vertex) < left.len() && !is_left(vertex);
                match if ends { goes_on(file, pages, group, id) } else { Some(true) } {
                    // The cluster's own faces tell.
                    Some(false) => {}
                    Some(true) if let Some(code) = borders.code(id) => block.turn(vertex, code),
                    _ => turned = turned.min(u32::from(vertex)),
                }
            }
        }
        Some((block, turned))
    }
}
