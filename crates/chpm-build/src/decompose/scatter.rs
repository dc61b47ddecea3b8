//! Regions that other processes work on: their meshes go into one part, what becomes of them into others, and that is put together in their order.

use super::gather::{About, Gatherer};
use super::region::{self, Done, Mesh};
use super::{Decomposition, LEAVES, cost, divide, leaf_count, load, share_of};
use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::in_order::in_order;
use crate::ingest::Source;
use crate::report::Repairs;
use bincode::serde::{decode_from_slice, encode_to_vec};
use bytemuck::Pod;
use chpm_extmem::{Extent, ExtmemError, PartFile, PartWriter, Spool};
use chpm_mesh::{Attributes, Vertices};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// The regions of a source, in the order that decides all ids. Their meshes are in the part that this is the record of.
#[derive(Serialize, Deserialize)]
pub(crate) struct Regions {
    about: About,
    carried: Attributes,
    border_count: u32,
    /// Copies of triangles that were left out on the way.
    copies: u64,
    /// Leaves that are wanted of all.
    pub(crate) leaves: u32,
    rows: Vec<Row>,
}

/// One region.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Row {
    /// Where its mesh begins.
    offset: u64,
    vertices: u32,
    triangles: u32,
    copies: u64,
    referenced: u64,
    leaves: u32,
    /// Bytes of memory that it takes.
    cost: u64,
}

/// Where the results of some regions are in a part.
#[derive(Default, Serialize, Deserialize)]
pub(crate) struct Results(Vec<(u64, u32)>);

/// Divides the source, and writes the mesh of each region.
pub(crate) fn scatter(
    source: Source,
    settings: &Settings,
    context: &Context<'_>,
    out: &mut PartWriter,
) -> Result<Regions, BuildError> {
    let about = About::of(&source);
    let carried = source.vertices.attributes();
    let leaves = leaf_count(source.triangles.len(), settings);
    let divided = divide::run(source, leaves, settings, context)?;
    let costs: Vec<u64> =
        (0..divided.region_count()).map(|region| cost(&divided, region, settings)).collect();

    let (divided, workers, _share) = share_of(divided, &costs, context)?;
    let mut rows = Vec::with_capacity(costs.len());
    let load = |region| {
        context.check()?;
        let (mesh, leaves) = load(&divided, region, leaves, settings, context)?;
        Ok((mesh, leaves))
    };
    in_order(divided.region_count(), workers, load, |(mesh, leaves)| {
        let (vertices, triangles) = (mesh.border.len() as u32, mesh.triangles.len() as u32);
        let offset = write(&mesh, out)?;
        let (copies, referenced, cost) = (mesh.copies, mesh.referenced, costs[rows.len()]);
        context.progress.advance(u64::from(triangles));
        rows.push(Row { offset, vertices, triangles, copies, referenced, leaves, cost });
        Ok(())
    })?;
    let (border_count, copies) = (divided.border_count() as u32, divided.copies);
    Ok(Regions { about, carried, border_count, copies, leaves, rows })
}

/// Writes the arrays of a mesh one after another, and answers where they begin.
fn write(mesh: &Mesh, out: &mut PartWriter) -> Result<u64, ExtmemError> {
    let Vertices { positions, normals, octahedral: _, colors, scalars } = &mesh.vertices;
    let offset = out.append(bytemuck::cast_slice(positions))?;
    out.append(bytemuck::cast_slice(normals))?;
    out.append(bytemuck::cast_slice(colors))?;
    out.append(bytemuck::cast_slice(scalars))?;
    out.append(bytemuck::cast_slice(&mesh.border))?;
    out.append(bytemuck::cast_slice(&mesh.triangles))?;
    Ok(offset)
}

/// Reads arrays that lie one after another.
struct Reader<'a> {
    part: &'a PartFile,
    offset: u64,
}

impl Reader<'_> {
    fn next<T: Pod>(&mut self, count: usize) -> Result<Vec<T>, ExtmemError> {
        let mut items = vec![T::zeroed(); count];
        let bytes = bytemuck::cast_slice_mut(&mut items);
        self.part.read_exact(self.offset, bytes)?;
        self.offset += bytes.len() as u64;
        Ok(items)
    }
}

impl Regions {
    /// Triangles of each region.
    pub(crate) fn weights(&self) -> impl Iterator<Item = u64> {
        self.rows.iter().map(|row| u64::from(row.triangles))
    }

    fn read(&self, region: usize, part: &PartFile) -> Result<Mesh, BuildError> {
        let Row { offset, vertices, triangles, copies, referenced, .. } = self.rows[region];
        let (count, Attributes { normals, colors, scalar_words, .. }) = (vertices as usize, self.carried);
        let mut reader = Reader { part, offset };
        let of = |is_carried: bool| if is_carried { count } else { 0 };
        let mut vertices = Vertices::new(reader.next(count)?);
        vertices.normals = reader.next(of(normals))?;
        vertices.colors = reader.next(of(colors))?;
        vertices.scalars = reader.next(count * usize::from(scalar_words))?;
        let border = reader.next(count)?;
        let triangles = reader.next(triangles as usize)?;
        Ok(Mesh { vertices, triangles, copies, border, referenced })
    }

    /// Cuts the regions of a range, whose meshes are in `part`, into leaves, and writes these and all else that becomes of them.
    pub(crate) fn work(
        &self,
        range: Range<usize>,
        part: &PartFile,
        settings: &Settings,
        context: &Context<'_>,
        out: &mut PartWriter,
    ) -> Result<Results, BuildError> {
        let largest = self.rows[range.clone()].iter().map(|row| row.cost).max().unwrap_or(0);
        let budget = &context.store.budget;
        let workers =
            (budget.available_for_work() / largest.max(1)).clamp(1, rayon::current_num_threads() as u64);
        let _share = budget.reserve_work("a region", workers * largest)?;

        let spool = Spool::new(&context.store, LEAVES);
        let phase = context.trace.phase();
        let work = |at: usize| {
            let _traced = phase.task("region");
            context.check()?;
            let region = range.start + at;
            let mesh = self.read(region, part)?;
            region::done(mesh, self.rows[region].leaves, self.border_count, settings, &spool, context)
        };
        // Leaves were spooled by whoever was first, and are written in their order.
        let (mut results, mut page) = (Results::default(), Vec::new());
        in_order(range.len(), workers as usize, work, |mut done| {
            for leaf in &mut done.leaves {
                leaf.move_to(&spool, &mut page, |page| out.append(page))?;
            }
            let record =
                encode_to_vec(&done, CONFIG).map_err(|error| BuildError::Record(error.to_string()))?;
            results.0.push((out.append(&record)?, record.len() as u32));
            Ok(())
        })?;
        Ok(results)
    }

    /// Puts together what became of all regions; `parts` have it in their order.
    pub(crate) fn gather(
        &self,
        parts: &[(Arc<PartFile>, Results)],
        settings: &Settings,
        context: &Context<'_>,
        repairs: &mut Repairs,
    ) -> Result<Decomposition, BuildError> {
        let mut spool = Spool::named(&context.store, LEAVES, LEAVES);
        let mut gatherer = Gatherer::new(self.border_count, self.copies, settings, &context.store)?;
        let mut record = Vec::new();
        for (part, Results(results)) in parts {
            let before = spool.earlier_len();
            spool.push_earlier(Extent::new(Arc::clone(part), 0..part.len())?);
            for (offset, len) in results {
                context.check()?;
                record.resize(*len as usize, 0);
                part.read_exact(*offset, &mut record)?;
                let (mut done, _): (Done, usize) = decode_from_slice(&record, CONFIG)
                    .map_err(|error| BuildError::Record(error.to_string()))?;
                done.leaves.iter_mut().for_each(|leaf| leaf.shift(before));
                gatherer.take(done)?;
            }
        }
        gatherer.finish(self.about, spool, context, repairs)
    }
}

const CONFIG: bincode::config::Configuration = bincode::config::standard();
