//! Which way a smooth surface faces where clusters meet, of files without normals: the same for all clusters that have a vertex.
//!
//! A cluster has only a part of the faces about a vertex that it shares. All of them are in the coarsest clusters that still have the vertex: those
//! that a split above it brings together, or, where the vertex collapses within a group, the coarse ones of that group. So these
//! are read, and what they say depends on nothing but the file. It takes four bytes for each id.

use crate::error::RayError;
use crate::readers::Readers;
use chpm_format::Chpm;
use chpm_mesh::facing::{Facing, area};
use chpm_mesh::{ClusterId, GroupId};

/// Facts about shared vertices.
#[derive(Debug)]
pub(super) struct Borders {
    readers: Readers,
    /// By id: which way it faces, so changed that 0 is what no code can be.
    codes: Vec<u32>,
    /// By group: whether what its split brings has been looked at, and what collapses in it.
    below: Vec<bool>,
    within: Vec<bool>,
    has_roots: bool,
}

/// No vertex has this code.
const UNKNOWN: u32 = 0x8000_8000;

impl Borders {
    /// Bytes that they take.
    pub(super) fn memory<D: AsRef<[u8]>>(file: &Chpm<D>) -> u64 {
        4 * u64::from(file.header().shared_vertex_count) + 2 * file.groups().len() as u64
    }

    pub(super) fn new<D: AsRef<[u8]>>(file: &Chpm<D>, readers: Readers) -> Self {
        let groups = file.groups().len();
        Borders {
            readers,
            codes: vec![0; file.header().shared_vertex_count as usize],
            below: vec![false; groups],
            within: vec![false; groups],
            has_roots: false,
        }
    }

    /// The code of a shared vertex; none where its clusters have not been looked at.
    pub(super) fn code(&self, id: u32) -> Option<u32> {
        self.codes.get(id as usize).map(|code| *code ^ UNKNOWN).filter(|code| *code != UNKNOWN)
    }

    /// Looks at all that decides about vertices of clusters, which are drawn at their finest where `is_finest` says so.
    pub(super) fn learn<D: AsRef<[u8]> + Sync>(
        &mut self,
        file: &Chpm<D>,
        clusters: &[ClusterId],
        is_finest: impl Fn(ClusterId) -> bool,
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<(), RayError> {
        let above = |cluster: &ClusterId| file.clusters()[cluster.index()].parent_group();
        let mut open: Vec<GroupId> = clusters.iter().map(above).filter(|group| group.is_some()).collect();
        let mut due = Vec::new();
        while let Some(group) = open.pop() {
            if std::mem::replace(&mut self.below[group.index()], true) {
                continue;
            }
            due.push(group);
            let coarse = file.coarse(group).iter().map(|coarse| above(&ClusterId(*coarse)));
            open.extend(coarse.filter(|group| group.is_some()));
        }
        if !std::mem::replace(&mut self.has_roots, true) {
            let roots: Vec<u32> = file.roots().map(|root| root.0).collect();
            let told = self.look(file, &roots, false, go_on)?;
            self.take(told);
        }
        // From above: what a coarse cluster says of a vertex holds below it.
        let level = |group: &GroupId| file.groups()[group.index()].level;
        due.sort_unstable_by_key(|group| (std::cmp::Reverse(level(group)), group.0));
        for same in due.chunk_by(|a, b| level(a) == level(b)) {
            self.look_within(file, same, go_on)?;
            self.look_at(file, same, |group| (file.fine(group), false), go_on)?;
        }
        let mut own: Vec<GroupId> = clusters
            .iter()
            .filter(|cluster| is_finest(**cluster))
            .map(|cluster| file.clusters()[cluster.index()].group())
            .collect();
        own.sort_unstable();
        own.dedup();
        self.look_within(file, &own, go_on)
    }

    /// Vertices that collapse in groups.
    fn look_within<D: AsRef<[u8]> + Sync>(
        &mut self,
        file: &Chpm<D>,
        groups: &[GroupId],
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<(), RayError> {
        let new: Vec<GroupId> = groups
            .iter()
            .copied()
            .filter(|group| !std::mem::replace(&mut self.within[group.index()], true))
            .collect();
        self.look_at(file, &new, |group| (file.coarse(group), true), go_on)
    }

    fn look_at<'f, D: AsRef<[u8]> + Sync>(
        &mut self,
        file: &'f Chpm<D>,
        groups: &[GroupId],
        members: impl Fn(GroupId) -> (&'f [u32], bool) + Sync,
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<(), RayError> {
        // Some at a time, so that little is held of what they say.
        for some in groups.chunks(4 * rayon::current_num_threads()) {
            let look = |group: &GroupId| {
                let (clusters, collapses) = members(*group);
                self.look(file, clusters, collapses, go_on)
            };
            let told = self.readers.read(some, look)?;
            told.into_iter().for_each(|told| self.take(told));
        }
        Ok(())
    }

    fn take(&mut self, told: Vec<(u32, u32)>) {
        for (id, code) in told {
            if self.code(id).is_none() {
                self.codes[id as usize] = code ^ UNKNOWN;
            }
        }
    }

    /// Vertices that nothing is known of, and what clusters together say of each.
    fn look<D: AsRef<[u8]>>(
        &self,
        file: &Chpm<D>,
        clusters: &[u32],
        collapses: bool,
        go_on: &impl Fn() -> bool,
    ) -> Result<Vec<(u32, u32)>, RayError> {
        let mut faces: Vec<(u32, [f64; 3])> = Vec::new();
        let mut ids = Vec::new();
        for cluster in clusters {
            if !go_on() {
                return Err(RayError::Stopped);
            }
            let page = file.page(ClusterId(*cluster))?;
            let page = page.view();
            ids.clear();
            ids.resize(page.vertex_count(), u32::MAX);
            for (vertex, id) in page.shared() {
                let is_asked = (usize::from(vertex) >= page.base_vertex_count) == collapses;
                if is_asked && self.code(id).is_none() {
                    ids[usize::from(vertex)] = id;
                }
            }
            for corners in page.triangles {
                for vertex in corners {
                    let id = ids[usize::from(*vertex)];
                    if id != u32::MAX {
                        faces.push((id, area(page.positions, corners)));
                    }
                }
            }
        }
        faces.sort_by_key(|(id, _)| *id);
        let of_vertex = |faces: &[(u32, [f64; 3])]| {
            let areas: Vec<[f64; 3]> = faces.iter().map(|(_, area)| *area).collect();
            (faces[0].0, Facing::of_faces(&areas).code())
        };
        Ok(faces.chunk_by(|a, b| a.0 == b.0).map(of_vertex).collect())
    }
}
