//! One mesh out of a cut: clusters are welded where they share vertices.

use crate::cut::Cut;
use crate::error::RefineError;
use crate::lod::Lod;
use crate::pieces::pieces;
use chpm_format::{Chpm, Page, PageBuf};
use chpm_mesh::{Attributes, Scalar, TriMesh, VertexSlices, Vertices};
use std::borrow::Cow;
use std::num::NonZeroU32;

/// Extracts the mesh of a legal cut into memory. Positions are relative to the header's origin; vertices that no triangle
/// uses are left out; clusters come in the order of the file.
///
/// # Errors
/// As [`Extraction::new`].
pub fn extract<D: AsRef<[u8]>>(file: &Chpm<D>, cut: &Cut) -> Result<TriMesh, RefineError> {
    let extraction = Extraction::new(file, cut)?;
    let mut mesh = TriMesh::default();
    mesh.positions.reserve_exact(extraction.vertex_count() as usize);
    mesh.triangles.reserve_exact(extraction.triangle_count() as usize);
    extraction.both(|vertices, triangles| {
        mesh.extend_from_slices(vertices);
        mesh.triangles.extend_from_slice(triangles);
        Ok::<_, RefineError>(())
    })?;
    Ok(mesh)
}

/// The mesh of a cut, handed out cluster by cluster, so that a large one can be written without being held: memory is
/// that of one cluster, four bytes for each shared vertex, and the pages that were packed, as many as are to be kept. Every pass reads
/// the cut's other pages again.
#[derive(Clone, Debug)]
pub struct Extraction<'a, D> {
    file: &'a Chpm<D>,
    cut: &'a Cut,
    vertex_count: u32,
    triangle_count: u64,
    coincident_count: u64,
    error: f32,
    distance: f32,
    /// By member, of the first ones: its page, if that was packed. What lies in place is looked up anew, so that whoever maps the file knows of it.
    kept: Vec<Option<PageBuf<'a>>>,
    /// The mesh that is handed out instead of the cut's own.
    replaced: Option<TriMesh>,
    /// Remnants beside the members, behind all of them.
    specks: TriMesh,
}

impl<'a, D: AsRef<[u8]>> Extraction<'a, D> {
    /// Checks the cut and counts its mesh.
    ///
    /// # Errors
    /// What [`Cut::check`] refuses; [`RefineError::Format`] for a damaged page; [`RefineError::TooManyVertices`].
    pub fn new(file: &'a Chpm<D>, cut: &'a Cut) -> Result<Self, RefineError> {
        Self::keeping(file, cut, 0, || Ok(()))
    }

    /// As [`Extraction::new`], asking after each cluster whether to go on, and keeping pages that were packed in at most so many bytes, so that
    /// each is unpacked once.
    ///
    /// # Errors
    /// As [`Extraction::new`], and what `go_on` answers.
    pub fn keeping<E: From<RefineError>>(
        file: &'a Chpm<D>,
        cut: &'a Cut,
        bytes: u64,
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Self, E> {
        cut.check(file)?;

        let mut room = bytes;
        let mut kept = Vec::new();
        let [mut error, mut distance] = [0.0_f32; 2];
        let (mut triangles, mut coincident_count, mut keys) = (0, 0, Vec::new());
        let mut weld = Weld::new(file.header().shared_vertex_count);

        for (number, member) in cut.members().iter().enumerate() {
            let page = member.page(file)?;
            let view = page.view();
            weld.enter(&view, member.vertices as usize)?;
            triangles += weld.triangles.len() as u64;
            coincident_count += coincident(&weld.triangles, &mut keys);
            let own = view.error_at(member.vertices as usize);
            error = error.max(own);
            distance = distance.max(cut.distance_of(file, member, own));

            // Pages are kept from the first one on, as far as they fit.
            let takes = page.bytes_or(&[]).len() as u64;
            if kept.len() == number && takes <= room {
                room -= takes;
                kept.push((takes > 0).then_some(page));
            }
            go_on()?;
        }

        let specks = cut.remnant_mesh(file)?;
        let remnants = cut.remnants().iter().map(|number| file.remnants()[*number as usize].bound);
        let error = remnants.fold(error, f32::max);
        triangles += specks.triangles.len() as u64;
        let vertex_count =
            u32::try_from(specks.positions.len()).ok().and_then(|more| weld.count.checked_add(more));
        let vertex_count = vertex_count.ok_or(RefineError::TooManyVertices { limit: UNUSED })?;
        Ok(Extraction {
            file,
            cut,
            vertex_count,
            triangle_count: triangles,
            coincident_count,
            error,
            distance,
            kept,
            replaced: None,
            specks,
        })
    }

    /// Hands out another mesh instead, which is within a distance of the source; normals decoded.
    #[must_use]
    pub fn replaced(mut self, mesh: TriMesh, distance: f32) -> Self {
        (self.error, self.distance) = (distance, distance);
        self.vertex_count = mesh.positions.len() as u32;
        self.triangle_count = mesh.triangles.len() as u64;
        self.coincident_count = coincident(&mesh.triangles, &mut Vec::new());
        self.replaced = Some(mesh);
        self
    }

    /// As [`Cut::error`].
    pub fn error(&self) -> f32 {
        self.error
    }

    /// As [`Cut::distance`].
    pub fn distance(&self) -> f32 {
        self.distance
    }

    /// Vertices of the mesh.
    pub fn vertex_count(&self) -> u32 {
        self.vertex_count
    }

    /// Triangles of the mesh.
    pub fn triangle_count(&self) -> u64 {
        self.triangle_count
    }

    /// Triangles that have the three vertices of another one before them, in the same turn or the other: the two sides of a sheet, or of a handle
    /// that was pressed flat. Those of two clusters are not among them.
    pub fn coincident_count(&self) -> u64 {
        self.coincident_count
    }

    /// Attributes of the vertices. Normals are three numbers each, however the file has them.
    pub fn attributes(&self) -> Attributes {
        self.file.header().attributes().decoded()
    }

    /// The named scalars of the vertices.
    pub fn scalars(&self) -> &'a [Scalar] {
        self.file.scalars()
    }

    /// The point that positions are relative to, unless it is zero: then they need more than single precision.
    pub fn origin(&self) -> Option<[f64; 3]> {
        Some(self.file.header().origin).filter(|origin| *origin != [0.0; 3])
    }

    /// Hands all vertices to `sink`, in the order of their indices: of each cluster those that none before it had. Positions are relative
    /// to the header's origin.
    ///
    /// # Errors
    /// What `sink` answers; [`RefineError::Format`] for a damaged page.
    pub fn vertices<E: From<RefineError>>(
        &self,
        mut sink: impl FnMut(VertexSlices<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(mesh) = &self.replaced {
            return sink(mesh.view());
        }
        let mut fresh = Vertices::default();
        self.walk(|page, weld| {
            fresh.clear_vertices();
            fresh.gather(page.vertices, weld.fresh.iter().map(|v| usize::from(*v)));
            fresh.decode_normals();
            sink(fresh.view())
        })?;
        if self.specks.triangles.is_empty() { Ok(()) } else { sink(self.specks.view()) }
    }

    /// Hands all triangles to `sink`; corners are indices into the vertices.
    ///
    /// # Errors
    /// As [`Extraction::vertices`].
    pub fn triangles<E: From<RefineError>>(
        &self,
        mut sink: impl FnMut(&[[u32; 3]]) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(mesh) = &self.replaced {
            return mesh.triangles.chunks(BATCH).try_for_each(sink);
        }
        let mut triangles = Vec::new();
        self.walk(|_, weld| {
            triangles.clear();
            triangles
                .extend(weld.triangles.iter().map(|corners| corners.map(|v| weld.index[usize::from(v)])));
            sink(&triangles)
        })?;
        let specks = self.specks_behind();
        if specks.is_empty() { Ok(()) } else { sink(&specks) }
    }

    /// Triangles beside the members, with corners as all vertices count.
    fn specks_behind(&self) -> Vec<[u32; 3]> {
        let first = self.vertex_count - self.specks.positions.len() as u32;
        self.specks.triangles.iter().map(|corners| corners.map(|v| first + v)).collect()
    }

    /// Hands the mesh to `sink` in pieces of whole clusters, each with at most `limit` vertices of its own where clusters are no larger; corners
    /// count from the piece's first vertex. What several pieces share, each of them has, bit for bit. One pass over the pages does it.
    ///
    /// # Errors
    /// As [`Extraction::vertices`].
    pub fn pieces<E: From<RefineError>>(
        &self,
        limit: usize,
        mut sink: impl FnMut(VertexSlices<'_>, &[[u32; 3]]) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(mesh) = &self.replaced {
            return pieces(mesh, limit, sink);
        }
        let mut weld = Weld::new(self.file.header().shared_vertex_count);
        let (mut piece, mut shared) = (TriMesh::default(), Vec::new());
        for (number, member) in self.cut.members().iter().enumerate() {
            let page = self.page(number)?;
            let page = page.view();
            let before = piece.positions.len();

            if before > 0 && before + member.vertices as usize > limit {
                sink(piece.view(), &piece.triangles)?;
                piece.clear_vertices();
                piece.triangles.clear();
                weld.forget(shared.drain(..));
            }

            weld.enter(&page, member.vertices as usize)?;
            shared.extend_from_slice(page.shared_ids);
            piece.gather(page.vertices, weld.fresh.iter().map(|v| usize::from(*v)));
            piece.decode_normals();
            piece
                .triangles
                .extend(weld.triangles.iter().map(|corners| corners.map(|v| weld.index[usize::from(v)])));
        }
        if !piece.triangles.is_empty() {
            sink(piece.view(), &piece.triangles)?;
        }
        pieces(&self.specks, limit, sink)
    }

    /// The page of a member by its number.
    fn page(&self, number: usize) -> Result<Cow<'_, PageBuf<'a>>, RefineError> {
        match self.kept.get(number) {
            Some(Some(page)) => Ok(Cow::Borrowed(page)),
            _ => Ok(Cow::Owned(self.cut.members()[number].page(self.file)?)),
        }
    }

    /// Hands all vertices and all triangles to `sink`, cluster by cluster, as [`Extraction::vertices`] and [`Extraction::triangles`] do one after the
    /// other; one pass over the pages does it.
    ///
    /// # Errors
    /// As [`Extraction::vertices`].
    pub fn both<E: From<RefineError>>(
        &self,
        mut sink: impl FnMut(VertexSlices<'_>, &[[u32; 3]]) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(mesh) = &self.replaced {
            return sink(mesh.view(), &mesh.triangles);
        }
        let (mut fresh, mut triangles) = (Vertices::default(), Vec::new());
        self.walk(|page, weld| {
            fresh.clear_vertices();
            fresh.gather(page.vertices, weld.fresh.iter().map(|v| usize::from(*v)));
            fresh.decode_normals();
            triangles.clear();
            triangles
                .extend(weld.triangles.iter().map(|corners| corners.map(|v| weld.index[usize::from(v)])));
            sink(fresh.view(), &triangles)
        })?;
        if self.specks.triangles.is_empty() {
            Ok(())
        } else {
            sink(self.specks.view(), &self.specks_behind())
        }
    }

    /// Every pass takes the same walk, so that all number the vertices alike.
    fn walk<E: From<RefineError>>(
        &self,
        mut visit: impl FnMut(&Page<'_>, &Weld) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut weld = Weld::new(self.file.header().shared_vertex_count);
        for (number, member) in self.cut.members().iter().enumerate() {
            let page = self.page(number)?;
            let page = page.view();
            weld.enter(&page, member.vertices as usize)?;
            visit(&page, &weld)?;
        }
        Ok(())
    }
}

/// Counts the triangles that have the same vertices as another one before them; `keys` is scratch.
pub fn coincident<I: Copy + Ord>(triangles: &[[I; 3]], keys: &mut Vec<[I; 3]>) -> u64 {
    keys.clear();
    keys.extend_from_slice(triangles);
    keys.iter_mut().for_each(|corners| corners.sort_unstable());
    keys.sort_unstable();
    keys.windows(2).filter(|pair| pair[0] == pair[1]).count() as u64
}

/// Triangles of a held mesh that are handed on at a time.
const BATCH: usize = 1 << 16;

/// Index of a vertex that no triangle uses; larger than that of any vertex.
const UNUSED: u32 = u32::MAX;

/// Numbers the vertices of one cluster after the other.
struct Weld {
    /// By shared id: one more than the index that the vertex got. Zeroed memory that is not written takes no space.
    shared: Vec<Option<NonZeroU32>>,
    /// Vertices so far.
    count: u32,
    lod: Lod,
    /// Triangles of the current cluster at its position, in local indices.
    triangles: Vec<[u16; 3]>,
    /// By local index: the index in the mesh.
    index: Vec<u32>,
    /// Local indices of the vertices that no cluster before had, ascending.
    fresh: Vec<u16>,
}

impl Weld {
    fn new(shared_vertex_count: u32) -> Self {
        Weld {
            shared: vec![None; shared_vertex_count as usize],
            count: 0,
            lod: Lod::default(),
            triangles: Vec::new(),
            index: Vec::new(),
            fresh: Vec::new(),
        }
    }

    /// Begins to number anew; `ids` are those of all clusters since the last time.
    fn forget(&mut self, ids: impl Iterator<Item = u32>) {
        for id in ids {
            self.shared[id as usize] = None;
        }
        self.count = 0;
    }

    /// Goes on to the mesh of `n` vertices of a page.
    fn enter(&mut self, page: &Page<'_>, n: usize) -> Result<(), RefineError> {
        self.lod.collect(&page.progressive_mesh(), n, &mut self.triangles);
        self.index.clear();
        self.index.resize(n, UNUSED);
        for v in self.triangles.as_flattened() {
            self.index[usize::from(*v)] = 0;
        }

        self.fresh.clear();
        let mut shared = page.shared().peekable();
        for (local, index) in self.index.iter_mut().enumerate() {
            let id = shared.next_if(|(vertex, _)| usize::from(*vertex) == local);
            if *index == UNUSED {
                continue;
            }

            let known = id.and_then(|(_, id)| self.shared[id as usize]);
            let next = self.count.checked_add(1).and_then(NonZeroU32::new);
            let number = known.or(next).ok_or(RefineError::TooManyVertices { limit: UNUSED })?;
            *index = number.get() - 1;
            if known.is_none() {
                self.count = number.get();
                self.fresh.push(local as u16);
                if let Some((_, id)) = id {
                    self.shared[id as usize] = Some(number);
                }
            }
        }
        Ok(())
    }
}
