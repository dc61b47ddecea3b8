//! The mesh of a cut as it is written: streamed in the order of the file, or held and put into another.

use crate::frame::Frame;
use crate::report::count;
use crate::stop;
use anyhow::{Result, bail, ensure};
use chpm_build::{Cancel, MOST_ORDERED, ORDER_BYTES, order_mesh};
use chpm_extmem::MappedFile;
use chpm_mesh::{Attributes, Scalar, TriMesh, VertexSlices, Vertices};
use chpm_refine::{Extraction, pieces};

/// In which order vertices and triangles are written.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Order {
    /// Cluster by cluster, as the file has them; in memory that does not grow with the mesh
    File,
    /// Vertices and triangles for caches of any size, whatever reads them; the mesh is held in memory meanwhile
    CacheOblivious,
}

impl Order {
    /// Bytes that it takes.
    pub(crate) fn memory(self, mesh: &Extraction<'_, MappedFile>) -> u64 {
        let (vertices, triangles) = (u64::from(mesh.vertex_count()), mesh.triangle_count());
        let [vertex, triangle] = ORDER_BYTES;
        match self {
            Order::File => 0,
            // Vertices are there twice while they move.
            Order::CacheOblivious => {
                vertices * (2 * mesh.attributes().vertex_len() as u64 + 4 + vertex)
                    + triangles * (12 + triangle)
            }
        }
    }
}

/// A mesh that goes into a file.
pub(crate) struct Whole<'a> {
    mesh: &'a Extraction<'a, MappedFile>,
    frame: Frame,
    /// Where it is held.
    held: Option<TriMesh>,
}

impl<'a> Whole<'a> {
    pub(crate) fn new(
        mesh: &'a Extraction<'a, MappedFile>,
        frame: Frame,
        order: Order,
        cancel: &Cancel,
    ) -> Result<Self> {
        let held = match order {
            Order::File => None,
            Order::CacheOblivious => Some(ordered(mesh, cancel)?),
        };
        Ok(Whole { mesh, frame, held })
    }

    pub(crate) fn vertex_count(&self) -> u32 {
        self.mesh.vertex_count()
    }

    pub(crate) fn triangle_count(&self) -> u64 {
        self.mesh.triangle_count()
    }

    pub(crate) fn attributes(&self) -> Attributes {
        self.frame.attributes(self.mesh.attributes())
    }

    /// The named scalars of the vertices.
    pub(crate) fn scalars(&self) -> &'a [Scalar] {
        self.mesh.scalars()
    }

    /// Vector to add to positions, unless it is zero.
    pub(crate) fn origin(&self) -> Option<[f64; 3]> {
        self.frame.origin()
    }

    /// As [`Extraction::vertices`].
    pub(crate) fn vertices(&self, mut sink: impl FnMut(VertexSlices<'_>) -> Result<()>) -> Result<()> {
        let mut room = Vertices::default();
        match &self.held {
            Some(held) => sink(self.frame.apply(held.view(), &mut room)),
            None => self.mesh.vertices(|batch| sink(self.frame.apply(batch, &mut room))),
        }
    }

    /// As [`Extraction::triangles`].
    pub(crate) fn triangles(&self, sink: impl FnMut(&[[u32; 3]]) -> Result<()>) -> Result<()> {
        match &self.held {
            Some(held) => held.triangles.chunks(BATCH).try_for_each(sink),
            None => self.mesh.triangles(sink),
        }
    }

    /// As [`Extraction::pieces`].
    pub(crate) fn pieces(
        &self,
        limit: usize,
        mut sink: impl FnMut(VertexSlices<'_>, &[[u32; 3]]) -> Result<()>,
    ) -> Result<()> {
        let mut room = Vertices::default();
        let mut sink = |batch: VertexSlices<'_>, triangles: &[[u32; 3]]| {
            sink(self.frame.apply(batch, &mut room), triangles)
        };
        match &self.held {
            Some(held) => pieces(held, limit, sink),
            None => self.mesh.pieces(limit, &mut sink),
        }
    }
}

/// Triangles that are handed on at a time.
const BATCH: usize = 1 << 16;

fn ordered(mesh: &Extraction<'_, MappedFile>, cancel: &Cancel) -> Result<TriMesh> {
    let mut vertices = Vertices::default();
    let mut triangles = Vec::new();
    ensure!(
        mesh.triangle_count() <= MOST_ORDERED,
        "{} triangles are more than can be ordered at once, {}: ask for fewer, or for the order of the file",
        count(mesh.triangle_count()),
        count(MOST_ORDERED)
    );
    triangles.reserve_exact(mesh.triangle_count() as usize);
    mesh.triangles(|batch| {
        triangles.extend_from_slice(batch);
        stop::check(cancel)
    })?;
    let places = order_mesh(mesh.vertex_count() as usize, &mut triangles, || !cancel.is_cancelled());
    let Some(places) = places else { bail!(stop::TOLD) };
    // Read after that, so that they are not beside the graph.
    mesh.vertices(|batch| {
        vertices.extend_from_slices(batch);
        stop::check(cancel)
    })?;
    let mut at_place = vec![0; places.len()];
    (0..).zip(&places).for_each(|(vertex, place)| at_place[*place as usize] = vertex);
    let mut moved = Vertices::default();
    moved.gather(vertices.view(), at_place.into_iter());
    Ok(TriMesh { vertices: moved, triangles })
}
