//! The mesh of a tile.

use super::{Options, SharedNormals, tile_path};
use crate::container::Container;
use crate::error::ExportError;
use crate::glb::{Extent, GlbWriter};
use crate::gltf::Facts;
use crate::packed_glb;
use crate::scene::Level;
use crate::textured::{Charted, PartImage, TexturedPart, write_textured};
use chpm_format::{Chpm, ErrorKind, ImageCodec, Page, Sheet};
use chpm_mesh::{Aabb, Attributes, ClusterId, Places, TriMesh, pm};
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

/// The file beside the tiles of a cluster that has two: the image that both show, its name behind the tiles' folder and its bytes. None where the file
/// has no sheets, or the one tile has the image in it.
///
/// # Errors
/// [`ExportError::Format`] for a damaged sheet.
pub fn tile_image<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    cluster: ClusterId,
) -> Result<Option<(String, Vec<u8>)>, ExportError> {
    let is_shared = Mesh::of(file, cluster).len() > 1;
    let Some(sheet) = file.sheet(cluster)?.filter(|_| is_shared) else { return Ok(None) };
    Ok(Some((image_path(cluster, &sheet), sheet.image.to_vec())))
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
    let error = page.error_at(mesh.position(&page));
    let (mut mesh, places) = played(&page, mesh, normals);

    let facts = Facts {
        generator: options.generator.clone(),
        placement: options.placement(),
        levels: vec![Level { extras: facts(file, cluster, error), coverage: 0.0 }],
        scalars: Vec::new(),
        grid: None,
    };
    if let Some(sheet) = file.sheet(cluster)? {
        let charts = page.triangles.iter().zip(&sheet.layout.chart_of);
        let shown = charts.filter(|(corners, _)| pm::is_alive(&corners.map(|v| places.of(v))));
        let image = match Mesh::of(file, cluster) {
            [_] => PartImage::Inside(sheet.image.to_vec()),
            // In the same folder.
            _ => PartImage::Beside(last(&image_path(cluster, &sheet)).to_owned()),
        };
        let mut part = textured(&mesh, shown.map(|(_, chart)| *chart), &sheet, image);
        reproject(file, options, &mut part.positions, &mut part.normals)?;
        let glb =
            write_textured(Container::Glb(Vec::new()), &facts, &[vec![part]], options.packed)?.into_main();
        return Ok((glb, mesh.triangles.len() as u64));
    }
    let TriMesh { vertices, .. } = &mut mesh;
    reproject(file, options, &mut vertices.positions, &mut vertices.normals)?;
    let stored = file.header().attributes().decoded();
    let attributes = Attributes { normals: stored.normals || normals.is_some(), ..stored };
    let glb = content(&facts, attributes, &mesh, options.packed)?;
    Ok((glb, mesh.triangles.len() as u64))
}

/// A mesh of a cluster; positions are relative to the file's origin. With `normals`, the file has none.
pub(crate) fn mesh_of<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    cluster: ClusterId,
    mesh: Mesh,
    normals: Option<&SharedNormals>,
) -> Result<TriMesh, ExportError> {
    Ok(played(&file.page(cluster)?.view(), mesh, normals).0)
}

/// A mesh of a page, and where its vertices have gone.
fn played(page: &Page<'_>, mesh: Mesh, normals: Option<&SharedNormals>) -> (TriMesh, Places) {
    let mut places = Places::default();
    places.go_to(&page.progressive_mesh(), mesh.position(page));
    let (mut mesh, used) = compact(page, &places);
    if let Some(normals) = normals {
        normals.give(page, &used, &mut mesh);
    }
    (mesh, places)
}

/// Takes vertices, whose positions are relative to the file's origin, to the frame of the tiles, if that is another one.
fn reproject<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    options: &Options,
    positions: &mut [[f32; 3]],
    normals: &mut [[f32; 3]],
) -> Result<(), ExportError> {
    match &options.reprojection {
        Some(reprojection) => reprojection.apply(file.header().origin, positions, normals),
        None => Ok(()),
    }
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
    let extent = Extent { vertices, triangles, bounds };
    let mut glb = GlbWriter::new(Container::Glb(Vec::new()), facts, attributes, &[extent])?;
    glb.vertices(mesh.view())?;
    glb.triangles(&mesh.triangles)?;
    Ok(glb.finish()?.into_main())
}

/// A mesh over its sheet, given the chart of each of its triangles. Colours of vertices are left out: the image has them.
fn textured(
    mesh: &TriMesh,
    charts: impl Iterator<Item = u16>,
    sheet: &Sheet<'_>,
    image: PartImage,
) -> TexturedPart {
    let Charted { vertices, triangles } = Charted::new(mesh.triangles.iter().copied().zip(charts));
    let (layout, size) = (&sheet.layout, sheet.record.size.map(f64::from));
    let place = |(vertex, chart): &(u32, u16)| {
        let position = mesh.positions[*vertex as usize];
        let texel = layout.charts[usize::from(*chart)].place(layout.origin, position);
        [0, 1].map(|axis| (texel[axis] / size[axis]) as f32)
    };
    let normals = vertices.iter().filter_map(|(vertex, _)| mesh.normals.get(*vertex as usize).copied());
    TexturedPart {
        positions: vertices.iter().map(|(vertex, _)| mesh.positions[*vertex as usize]).collect(),
        normals: normals.collect(),
        places: vertices.iter().map(place).collect(),
        triangles,
        image,
        is_png: sheet.record.codec() == Some(ImageCodec::Png),
        is_blended: false,
    }
}

/// Where the image of a cluster's two tiles lies.
fn image_path(cluster: ClusterId, sheet: &Sheet<'_>) -> String {
    let kind = if sheet.record.codec() == Some(ImageCodec::Png) { "png" } else { "jpg" };
    tile_path(cluster, Mesh::Base).replace("glb", kind)
}

fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
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

/// The mesh at a position, without vertices that no triangle uses; and the page's index of each of them.
fn compact(page: &Page<'_>, places: &Places) -> (TriMesh, Vec<usize>) {
    const UNUSED: u32 = u32::MAX;
    let mut numbers = vec![UNUSED; page.vertex_count()];
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
