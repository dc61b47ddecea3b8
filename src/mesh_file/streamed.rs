//! The mesh of a cut, streamed into a file batch by batch.

use super::ReadyMesh;
use crate::output::Output;
use crate::progress::Meter;
use crate::stop;
use crate::whole::Whole;
use anyhow::Result;
use chpm_build::Cancel;
use chpm_export::{
    Container, Extent, Facts, GlbWriter, Level, ObjWriter, PIECE_VERTICES, PackedGlb, Placement, StlWriter,
    Turn,
};
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, ErrorKind};
use chpm_import::ply::{Encoding, PlyWriter};
use chpm_mesh::{Aabb, Attributes, VertexSlices};
use serde_json::Map;

/// Progress, and the wish to stop.
pub(super) struct Steps<'a> {
    pub(super) meter: &'a Meter,
    pub(super) cancel: &'a Cancel,
}

impl Steps<'_> {
    fn begin(&self, total: u64) {
        self.meter.start("extract", total);
    }

    fn done(&self, count: usize) -> Result<()> {
        stop::check(self.cancel)?;
        self.meter.add(count as u64);
        Ok(())
    }
}

/// Facts about levels whose positions are relative to an origin, if that is not zero.
pub(super) fn facts(
    file: &Chpm<MappedFile>,
    (levels, origin): (&[ReadyMesh<'_>], Option<[f64; 3]>),
    by: &str,
    offset: Option<[f64; 3]>,
    turn: Turn,
) -> Facts {
    let of = |level: &ReadyMesh<'_>| {
        let mut extras = Map::new();
        extras.insert("error".to_owned(), f64::from(level.bounds.error).into());
        if file.has_gaps() {
            extras.insert("distance".to_owned(), f64::from(level.bounds.distance).into());
        }
        let is_certified = file.header().error_kind() == Some(ErrorKind::Certified);
        extras.insert("certified".to_owned(), is_certified.into());
        if let Some(offset) = offset {
            extras.insert("origin".to_owned(), offset.to_vec().into());
        }
        Level { extras, coverage: level.coverage }
    };
    let generator = format!("chpm {} {by}", env!("CARGO_PKG_VERSION"));
    let placement = Placement { origin: origin.unwrap_or_default(), turn };
    Facts {
        generator,
        placement,
        levels: levels.iter().map(of).collect(),
        scalars: file.scalars().to_vec(),
        grid: None,
    }
}

/// In doubles if the model is far from the zero point: single precision would move vertices there.
pub(super) fn ply(
    mesh: &Whole<'_>,
    output: Output,
    ascii: bool,
    comment: &str,
    steps: &Steps<'_>,
) -> Result<Output> {
    let encoding = if ascii { Encoding::Ascii } else { Encoding::BinaryLittleEndian };
    let (vertices, triangles) = (u64::from(mesh.vertex_count()), mesh.triangle_count());
    let origin = mesh.origin();
    steps.begin(vertices + triangles);
    let attributes = mesh.attributes();
    let (scalars, double) = (mesh.scalars(), origin.is_some());
    let mut ply = PlyWriter::with_scalars(
        output,
        encoding,
        vertices,
        triangles,
        attributes,
        scalars,
        double,
        &[comment],
    )?;

    let mut absolute = Vec::new();
    mesh.vertices(|batch| {
        steps.done(batch.positions.len())?;
        if let Some(origin) = origin {
            absolute.clear();
            absolute.extend(batch.absolute(origin));
            ply.vertices_f64(&absolute, batch)?;
        } else {
            ply.vertices(batch)?;
        }
        anyhow::Ok(())
    })?;
    mesh.triangles(|batch| {
        steps.done(batch.len())?;
        anyhow::Ok(ply.triangles(batch)?)
    })?;
    Ok(ply.finish()?)
}

pub(super) fn stl(
    mesh: &Whole<'_>,
    output: Output,
    ascii: bool,
    comment: &str,
    steps: &Steps<'_>,
) -> Result<Output> {
    steps.begin(mesh.triangle_count());
    let mut stl = StlWriter::new(output, ascii, mesh.triangle_count(), comment)?;
    let origin = mesh.origin().unwrap_or_default();
    mesh.pieces(PIECE_VERTICES, |vertices, triangles| {
        steps.done(triangles.len())?;
        let corners = triangles.iter().map(|corners| {
            corners.map(|v| {
                let position = vertices.positions[v as usize];
                std::array::from_fn(|axis| f64::from(position[axis]) + origin[axis])
            })
        });
        anyhow::Ok(stl.triangles(corners)?)
    })?;
    Ok(stl.finish()?)
}

pub(super) fn obj(mesh: &Whole<'_>, output: Output, comment: &str, steps: &Steps<'_>) -> Result<Output> {
    let (vertices, triangles) = (u64::from(mesh.vertex_count()), mesh.triangle_count());
    steps.begin(vertices + triangles);
    let mut obj = ObjWriter::new(output, vertices, triangles, mesh.attributes(), comment)?;
    mesh.vertices(|batch| {
        steps.done(batch.positions.len())?;
        anyhow::Ok(obj.vertices(batch, mesh.origin())?)
    })?;
    mesh.triangles(|batch| {
        steps.done(batch.len())?;
        anyhow::Ok(obj.triangles(batch)?)
    })?;
    Ok(obj.finish()?)
}

/// Levels of detail, the finest first; as many as the facts are of.
pub(super) fn gltf(
    levels: &[Whole<'_>],
    container: Container<Output>,
    facts: &Facts,
    steps: &Steps<'_>,
) -> Result<Container<Output>> {
    let count = |mesh: &Whole<'_>| 2 * u64::from(mesh.vertex_count()) + mesh.triangle_count();
    steps.begin(levels.iter().map(count).sum());
    let mut extents = Vec::new();
    for mesh in levels {
        let mut bounds = Aabb::EMPTY;
        mesh.vertices(|batch| {
            bounds.merge(&Aabb::of_points(batch.positions));
            steps.done(batch.positions.len())
        })?;
        let (vertices, triangles) = (u64::from(mesh.vertex_count()), mesh.triangle_count());
        extents.push(Extent { vertices, triangles, bounds });
    }
    let mut glb = GlbWriter::new(container, facts, attributes(levels), &extents)?;
    for (number, mesh) in levels.iter().enumerate() {
        if number > 0 {
            glb.next_level()?;
        }
        mesh.vertices(|batch| {
            steps.done(batch.positions.len())?;
            anyhow::Ok(glb.vertices(batch)?)
        })?;
        mesh.triangles(|batch| {
            steps.done(batch.len())?;
            anyhow::Ok(glb.triangles(batch)?)
        })?;
    }
    Ok(glb.finish()?)
}

/// Attributes of all levels, which are of one file.
fn attributes(levels: &[Whole<'_>]) -> Attributes {
    levels.first().map_or(Attributes::NONE, Whole::attributes)
}

/// The same, compressed.
pub(super) fn packed_gltf(
    levels: &[Whole<'_>],
    container: Container<Output>,
    facts: Facts,
    steps: &Steps<'_>,
) -> Result<Container<Output>> {
    steps.begin(2 * levels.iter().map(Whole::triangle_count).sum::<u64>());
    let mut measured = PackedGlb::new(facts, attributes(levels));
    for (number, mesh) in levels.iter().enumerate() {
        if number > 0 {
            measured.next_level();
        }
        mesh.pieces(PIECE_VERTICES, |vertices: VertexSlices<'_>, triangles| {
            steps.done(triangles.len())?;
            anyhow::Ok(measured.measure(vertices, triangles)?)
        })?;
    }
    let mut glb = measured.begin(container)?;
    for mesh in levels {
        mesh.pieces(PIECE_VERTICES, |vertices, triangles| {
            steps.done(triangles.len())?;
            anyhow::Ok(glb.write(vertices, triangles)?)
        })?;
    }
    Ok(glb.finish()?)
}
