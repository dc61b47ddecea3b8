//! Triangles and error of a cluster at every number of its vertices. Choosing a cut needs them again and again for the same clusters, and to read and
//! unpack their pages each time would be most of the work.

use crate::error::RefineError;
use crate::lod::Lod;
use chpm_format::{Chpm, Page, PageBuf};
use chpm_mesh::ClusterId;
use chpm_mesh::pm::is_alive;
use std::collections::BTreeMap;

/// The errors and the triangles of a cluster's meshes, from the base mesh to the finest.
struct Profile {
    base_vertex_count: usize,
    own_end: usize,
    errors: Vec<f32>,
    triangles: Vec<u32>,
}

/// The profiles of a file's clusters, as many as there is room for, of the first that are asked for; of the others, the pages.
pub(crate) struct Profiles<'a, D, G> {
    file: &'a Chpm<D>,
    kept: BTreeMap<ClusterId, Profile>,
    /// Bytes that are left.
    room: u64,
    /// Asked before a page is read.
    go_on: G,
    lod: Lod,
}

/// A cluster's meshes, from one or the other.
pub(crate) struct Meshes<'a> {
    held: Held<'a>,
    lod: &'a mut Lod,
}

enum Held<'a> {
    Kept(&'a Profile),
    Page(PageBuf<'a>),
}

impl<'a, D, E, G> Profiles<'a, D, G>
where
    D: AsRef<[u8]>,
    E: From<RefineError>,
    G: FnMut() -> Result<(), E>,
{
    /// Profiles in so many bytes at most.
    pub(crate) fn new(file: &'a Chpm<D>, room: u64, go_on: G) -> Self {
        Profiles { file, kept: BTreeMap::new(), room, go_on, lod: Lod::default() }
    }

    /// The meshes of a cluster.
    pub(crate) fn of(&mut self, cluster: ClusterId) -> Result<Meshes<'_>, E> {
        let lod = &mut self.lod;
        // Looked for twice, since what is answered may not be borrowed where something is put in.
        if self.kept.contains_key(&cluster) {
            return Ok(Meshes { held: Held::Kept(&self.kept[&cluster]), lod });
        }
        (self.go_on)()?;
        let page = self.file.page(cluster).map_err(RefineError::from)?;
        let Some(room) = self.room.checked_sub(Profile::bytes(&page.view())) else {
            return Ok(Meshes { held: Held::Page(page), lod });
        };
        self.room = room;
        let profile = self.kept.entry(cluster).or_insert(Profile::new(&page.view()));
        Ok(Meshes { held: Held::Kept(profile), lod })
    }

    /// A page, with all that it holds.
    pub(crate) fn page(&mut self, cluster: ClusterId) -> Result<PageBuf<'a>, E> {
        (self.go_on)()?;
        Ok(self.file.page(cluster).map_err(RefineError::from)?)
    }
}

impl Profile {
    fn new(page: &Page<'_>) -> Self {
        let (mesh, base) = (page.progressive_mesh(), page.base_vertex_count);
        let positions = base..=page.vertex_count();
        let mut triangles = vec![0; positions.clone().count()];
        for corners in page.triangles.iter().filter(|corners| is_alive(corners)) {
            triangles[mesh.birth(*corners) - base] += 1;
        }
        let mut sum = 0;
        for count in &mut triangles {
            sum += *count;
            *count = sum;
        }
        let errors = positions.map(|n| page.error_at(n)).collect();
        Profile { base_vertex_count: base, own_end: own_end(page), errors, triangles }
    }

    /// Bytes of a profile in memory.
    fn bytes(page: &Page<'_>) -> u64 {
        // The last is for its place among the others.
        (8 * (page.vertex_count() - page.base_vertex_count + 1) + 3 * size_of::<Profile>()) as u64
    }
}

impl Meshes<'_> {
    /// Error of the mesh of `n` vertices.
    pub(crate) fn error_at(&self, n: usize) -> f32 {
        match &self.held {
            Held::Kept(profile) => profile.errors[n - profile.base_vertex_count],
            Held::Page(page) => page.view().error_at(n),
        }
    }

    /// The fewest vertices whose mesh has an error of at most `bound`; all if there are none.
    pub(crate) fn vertices_for(&self, bound: f32) -> usize {
        match &self.held {
            Held::Kept(profile) => {
                // The finest mesh is what is left, whatever its error; a bound that is no number is met by nothing.
                let coarser = &profile.errors[..profile.errors.len() - 1];
                profile.base_vertex_count + coarser.partition_point(|error| bound.is_nan() || *error > bound)
            }
            Held::Page(page) => page.view().vertices_for(bound),
        }
    }

    /// Triangles of the mesh of `n` vertices.
    pub(crate) fn triangles(&mut self, n: usize) -> u64 {
        match &self.held {
            Held::Kept(profile) => profile.triangles[n - profile.base_vertex_count].into(),
            Held::Page(page) => self.lod.count(&page.view().progressive_mesh(), n) as u64,
        }
    }

    /// The position up to which all that is undone is the cluster's own: no vertex that comes is shared.
    pub(crate) fn own_end(&self) -> usize {
        match &self.held {
            Held::Kept(profile) => profile.own_end,
            Held::Page(page) => own_end(&page.view()),
        }
    }
}

fn own_end(page: &Page<'_>) -> usize {
    let mut shared = page.shared().map(|(vertex, _)| usize::from(vertex));
    shared.find(|vertex| *vertex >= page.base_vertex_count).unwrap_or(page.vertex_count())
}
