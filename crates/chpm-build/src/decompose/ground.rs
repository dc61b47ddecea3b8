//! The source as a plan hands it over: vertices by region, triangles in the source's order, homes. All of it lies in the plan's part, of which everyone reads what
//! they need.

use super::divide::Routed;
use super::gather::About;
use super::homes::{self, Cut, Homes};
use super::number::Cells;
use super::size::leaf_count;
use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::{Id, Ids, with_ids};
use crate::ingest::Source;
use crate::vertex_columns::VertexColumns;
use chpm_extmem::{Column, PartFile, PartReader, PartWriter};
use chpm_mesh::Attributes;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Facts about a source that was cut, and where it is.
#[derive(Serialize, Deserialize)]
pub(crate) struct Ground {
    pub(super) about: About,
    pub(super) carried: Attributes,
    /// Leaves that are wanted of all.
    pub(crate) leaves: u32,
    ids: Ids,
    triangles: u64,
    cells: u64,
    /// Where its columns begin, and where its cells do.
    offsets: [u64; 2],
}

/// A source that was handed over, of which everyone reads what they need.
pub(super) struct Opened<I: Id> {
    pub(super) vertices: VertexColumns,
    pub(super) triangles: Column<[I; 3]>,
    pub(super) homes: Homes,
}

/// Numbers the vertices of a source by cell, cuts the cells into regions, and writes that.
pub(crate) fn write(
    source: Source,
    settings: &Settings,
    context: &Context<'_>,
    out: &mut PartWriter,
) -> Result<Ground, BuildError> {
    let (about, leaves) = (About::of(&source), leaf_count(source.triangles.len(), settings));
    let Source { vertices, triangles, bounds, .. } = source;
    with_ids!(triangles, triangles => {
        let cut = homes::run(vertices, triangles, bounds, leaves, settings, context)?;
        write_cut(cut, about, leaves, out)
    })
}

fn write_cut<I: Id>(
    cut: Cut<I>,
    about: About,
    leaves: u32,
    out: &mut PartWriter,
) -> Result<Ground, BuildError> {
    let Cut { vertices, triangles, homes } = cut;
    let columns = out.len();
    // By region, so that who works on one reads little else.
    let runs = || (0..homes.count()).flat_map(|region| homes.own_runs(region));
    vertices.append_to(out, &runs)?;
    triangles.append_to(0..triangles.len(), out)?;
    let cells: Vec<[u32; 2]> = homes.cells().map(<[u32; 2]>::from).collect();
    let offsets = [columns, out.append(bytemuck::cast_slice(&cells))?];
    let [triangles, cells] = [triangles.len(), cells.len()].map(|count| count as u64);
    Ok(Ground { about, carried: vertices.attributes(), leaves, ids: I::IDS, triangles, cells, offsets })
}

impl Ground {
    /// Kind of its ids.
    pub(super) fn ids(&self) -> Ids {
        self.ids
    }

    /// Triangles of the source.
    pub(crate) fn triangle_count(&self) -> u64 {
        self.triangles
    }

    /// Opens what lies in the plan's part. The homes alone are read.
    pub(super) fn open<I: Id>(&self, part: &Arc<PartFile>) -> Result<Opened<I>, BuildError> {
        let [columns, cells] = self.offsets;
        let mut columns = PartReader::at(part, columns);
        let count = self.about.vertex_count as usize;
        let vertices = VertexColumns::in_part(&mut columns, count, self.carried)?;
        let triangles = columns.column("triangles", self.triangles as usize)?;
        let cells: Vec<[u32; 2]> = part.read_items(cells, self.cells as usize)?;
        let sum: u64 = cells.iter().map(|[count, _]| u64::from(*count)).sum();
        let regions: Vec<u32> = cells.iter().map(|[_, region]| *region).collect();
        if sum != self.about.vertex_count || regions.iter().any(|region| *region as usize >= regions.len()) {
            return Err(BuildError::Record(format!(
                "{}: its cells are none of its own",
                part.path().display()
            )));
        }
        let cells = Cells::new(cells.iter().map(|[count, _]| *count));
        Ok(Opened { vertices, triangles, homes: Homes::new(cells, &regions).laid_by_region() })
    }
}

/// Triangles that one part of the source sends to regions.
#[derive(Serialize, Deserialize)]
pub(crate) struct Sent {
    /// Those that anything was sent to.
    pub(super) rows: Vec<SentRow>,
    /// Copies of triangles that were left out.
    pub(super) copies: u64,
}

/// Triangles and visits that one region got.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(super) struct SentRow {
    pub(super) region: u32,
    /// Where its triangles are, and behind these its visits.
    pub(super) offset: u64,
    pub(super) triangles: u64,
    /// Visits of the vertices at home in it.
    pub(super) visits: u64,
    /// Corners that its triangles have from others.
    pub(super) uses: u64,
}

impl Ground {
    /// Sends the triangles of a range to their regions, and writes for each what it got.
    pub(crate) fn scatter(
        &self,
        range: Range<usize>,
        part: &Arc<PartFile>,
        context: &Context<'_>,
        out: &mut PartWriter,
    ) -> Result<Sent, BuildError> {
        with_ids!(self.ids, type I => self.scatter_as::<I>(range, part, context, out))
    }

    fn scatter_as<I: Id>(
        &self,
        range: Range<usize>,
        part: &Arc<PartFile>,
        context: &Context<'_>,
        out: &mut PartWriter,
    ) -> Result<Sent, BuildError> {
        let Opened { triangles, homes, .. } = self.open::<I>(part)?;
        let mut routed = Routed::new(homes.count(), &context.store);
        routed.take(&triangles, range, &homes, context)?;

        let mut sent = Sent { rows: Vec::new(), copies: routed.copies };
        let (mut block, mut visits) = (Vec::new(), Vec::new());
        for region in 0..homes.count() {
            context.check()?;
            visits.clear();
            routed.visits.read(region, &mut visits)?;
            let triangles = routed.triangles.len(region) as u64;
            if triangles == 0 && visits.is_empty() {
                continue;
            }
            let offset = out.len();
            for number in 0..routed.triangles.block_count(region) {
                routed.triangles.read_block(region, number, &mut block)?;
                out.append(bytemuck::cast_slice(&block))?;
            }
            // Many steps have noted the same.
            visits.sort_unstable();
            visits.dedup();
            out.append(bytemuck::cast_slice(&visits))?;
            let (visits, uses) = (visits.len() as u64, routed.uses[region]);
            sent.rows.push(SentRow { region: region as u32, offset, triangles, visits, uses });
        }
        Ok(sent)
    }
}
