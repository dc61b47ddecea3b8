//! The mesh of a tile.

use super::{Options, SharedNormals};
use crate::error::ExportError;
use crate::glb::GlbWriter;
use crate::gltf::Facts;
use crate::packed_glb;
use chpm_format::{Chpm, ErrorKind, Page};
use chpm_mesh::{Aabb, Attributes, ClusterId, Places, TriMesh};
use serde_json::{Map, Value};

/// One end of a cluster's progressive mesh.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Mesh {
    /// The coarsest.
    Base,
    /// The finest.
    Finest,
}

impl Mesh {
    /// The meshes of a cluster that are tiles: of a leaf both, unless they are the same.
    pub fn of<D: AsRef<[u8]>>(file: &Chpm<D>, cluster: ClusterId) -> &'static [Mesh] {
        let record = &file.clusters()[cluster.index()];
        let is_leaf = file.groups()[record.group().index()].is_leaf();
        let collapses = record.base_vertex_count < record.vertex_count;
        if is_leaf && collapses { &[Mesh::Base, Mesh::Finest] } else { &[Mesh::Base] }
    }

    /// The number of vertices of this mesh of a page.
    pub(super) fn position(self, page: &Page<'_>) -> usize {
        match self {
            Mesh::Base => page.base_vertex_count,
            Mesh::Finest => page.vertex_count(),
        }
    }
}

/// A tile as a GLB; positions are relative to the file's origin. With `normals`, the file has none. Answers its triangles, too.
///
/// # Errors
/// [`ExportError::Format`] for a damaged page; what the writer of GLB refuses.
pub fn tile<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    cluster: ClusterId,
    mesh: Mesh,
    options: &Options,
    normals: Option<&SharedNormals>,
) -> Result<(Vec<u8>, u64), ExportError> {
    let page = file.page(cluster)?;
    let page = page.view();
    let n = mesh.position(&page);
    let (mut mesh, used) = compact(&page, n);
    if let Some(normals) = normals {
        normals.give(&page, &used, &mut mesh);
    }
    let error = page.error_at(n);

    let facts = Facts {
        generator: options.generator.clone(),
        placement: options.placement(),
        extras: facts(file, cluster, error),
        scalars: Vec::new(),
    };
    let stored = file.header().attributes().decoded();
    let attributes = Attributes { normals: stored.normals || normals.is_some(), ..stored };
    let glb = content(&facts, attributes, &mesh, options.packed)?;
    Ok((glb, mesh.triangles.len() as u64))
}

/// A mesh as a GLB; nothing is not packed, since the extension's buffers have at least a byte.
pub(super) fn content(
    facts: &Facts,
    attributes: Attributes,
    mesh: &TriMesh,
    packed: bool,
) -> Result<Vec<u8>, ExportError> {
    if packed && !mesh.triangles.is_empty() {
        return packed_glb::whole(facts, attributes, mesh.view(), &mesh.triangles);
    }

    let bounds = Aabb::of_points(&mesh.positions);
    let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let mut glb = GlbWriter::new(Vec::new(), facts, attributes, vertices, triangles, &bounds)?;
    glb.vertices(mesh.view())?;
    glb.triangles(&mesh.triangles)?;
    glb.finish()
}

/// The bounds that a cluster's mesh keeps.
fn facts<D: AsRef<[u8]>>(file: &Chpm<D>, cluster: ClusterId, error: f32) -> Map<String, Value> {
    let mut facts = Map::new();
    facts.insert("cluster".to_owned(), cluster.0.into());
    facts.insert("error".to_owned(), f64::from(error).into());
    if file.has_gaps() {
        let distance = file.gaps(file.clusters()[cluster.index()].group()).distance(error);
        facts.insert("distance".to_owned(), f64::from(distance).into());
    }
    facts.insert("certified".to_owned(), (file.header().error_kind() == Some(ErrorKind::Certified)).into());
    facts
}

/// The mesh of `n` vertices, without those that no triangle uses; and the page's index of each of them.
fn compact(page: &Page<'_>, n: usize) -> (TriMesh, Vec<usize>) {
    const UNUSED: u32 = u32::MAX;
    let mut places = Places::default();
    places.go_to(&page.progressive_mesh(), n);
    let mut numbers = vec![UNUSED; n];
    let local: Vec<[u16; 3]> = places.triangles(page.triangles).collect();
    local.as_flattened().iter().for_each(|v| numbers[usize::from(*v)] = 0);
    let mut mesh = TriMesh::default();
    let used = numbers.iter().enumerate().filter(|(_, number)| **number != UNUSED).map(|(v, _)| v);
    mesh.gather(page.vertices, used.clone());
    mesh.decode_normals();
    let used: Vec<usize> = used.collect();
    for (number, vertex) in (0..).zip(&used) {
        numbers[*vertex] = number;
    }
    mesh.triangles = local.iter().map(|corners| corners.map(|v| numbers[usize::from(v)])).collect();
    (mesh, used)
}
