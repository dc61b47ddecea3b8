//! Regions that other processes work on: what each is made of lies in several parts, what becomes of them goes into others, and that is put together in their
//! order.

use super::divide::{Borders, Foreign, Routed, is_too_large};
use super::gather::Gatherer;
use super::ground::{Ground, Opened, Sent, SentRow};
use super::load::Material;
use super::region::{self, Done, Mesh};
use super::size::{Shares, Size};
use super::{Decomposition, LEAVES};
use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::{Id, with_ids};
use crate::in_order::in_order;
use crate::report::Repairs;
use bincode::serde::{decode_from_slice, encode_to_vec};
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{Extent, PartFile, PartFolder, PartReader, PartWriter, Spool};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// The regions of a source, in the order that decides all ids.
#[derive(Serialize, Deserialize)]
pub(crate) struct Regions {
    shares: Shares,
    border_count: u32,
    /// Parts that triangles are in: names and identities.
    sources: Vec<(String, u64)>,
    rows: Vec<Row>,
}

/// One region.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Row {
    /// Where its pieces are told. Behind them are its vertices of others, and those of its own that others use.
    offset: u64,
    pieces: u64,
    first_border: u32,
    size: Size,
}

/// Triangles of a region in one part.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Piece {
    /// The part, by its place among the sources; [`HERE`] is the part that says so.
    source: u64,
    offset: u64,
    count: u64,
}

/// The part that a piece is told in: triangles of a region that was split.
const HERE: u64 = u64::MAX;

/// Where the results of some regions are in a part.
#[derive(Default, Serialize, Deserialize)]
pub(crate) struct Results(Vec<(u64, u32)>);

/// Numbers the border vertices of all that parts of the source have sent to regions, and writes for each region what it is made of. Too large
/// ones are split.
pub(crate) fn write(
    ground: &Ground,
    plan: &Arc<PartFile>,
    sent: &[(Arc<PartFile>, Sent)],
    settings: &Settings,
    context: &Context<'_>,
    out: &mut PartWriter,
) -> Result<Regions, BuildError> {
    with_ids!(ground.ids(), type I => write_as::<I>(ground, plan, sent, settings, context, out))
}

fn write_as<I: Id>(
    ground: &Ground,
    plan: &Arc<PartFile>,
    sent: &[(Arc<PartFile>, Sent)],
    settings: &Settings,
    context: &Context<'_>,
    out: &mut PartWriter,
) -> Result<Regions, BuildError> {
    let Opened { homes, .. } = ground.open::<I>(plan)?;
    let mut routed = Routed::<I>::new(homes.count(), &context.store);
    let mut pieces = vec![Vec::new(); homes.count()];
    let mut counts = vec![0; homes.count()];
    for (source, (part, Sent { rows, copies })) in (0..).zip(sent) {
        routed.copies += copies;
        for SentRow { region, offset, triangles, visits, uses } in rows {
            context.check()?;
            let region = *region as usize;
            if region >= homes.count() {
                return Err(BuildError::Record(format!("{}: no such region", part.path().display())));
            }
            if *triangles > 0 {
                pieces[region].push(Piece { source, offset: *offset, count: *triangles });
            }
            counts[region] += triangles;
            routed.uses[region] += uses;
            let behind = offset.saturating_add(triangles.saturating_mul(size_of::<[I; 3]>() as u64));
            let visits: Vec<[I; 2]> = part.read_items(behind, *visits as usize)?;
            visits.into_iter().try_for_each(|visit| routed.visits.push(region, visit))?;
        }
    }

    // Those that are split are read, and have none of their own then.
    for region in 0..homes.count() {
        if is_too_large(counts[region], routed.uses[region], settings) {
            for Piece { source, offset, count } in std::mem::take(&mut pieces[region]) {
                let part = &sent[source as usize].0;
                each_step(part, offset, count, |triangle| Ok(routed.triangles.push(region, triangle)?))?;
            }
            counts[region] = 0;
        }
    }
    routed.split(&homes, settings, context)?;
    let borders = Borders::of(&mut routed, &homes, context)?;

    let mut rows = Vec::with_capacity(routed.region_count());
    for region in 0..routed.region_count() {
        context.check()?;
        let count = routed.triangles.len(region) as u64;
        let mut pieces = pieces.get_mut(region).map(std::mem::take).unwrap_or_default();
        if count > 0 {
            let mut triangles = Vec::new();
            routed.triangles.read(region, &mut triangles)?;
            pieces =
                vec![Piece { source: HERE, offset: out.append(bytemuck::cast_slice(&triangles))?, count }];
        }
        let triangles = counts.get(region).copied().unwrap_or_default() + count;
        let mut foreign = Vec::new();
        borders.foreign.read(region, &mut foreign)?;
        let offset = out.append(bytemuck::cast_slice(&pieces))?;
        out.append(bytemuck::cast_slice(&foreign))?;
        out.append(bytemuck::cast_slice(&borders.own(region)?))?;
        rows.push(Row {
            offset,
            pieces: pieces.len() as u64,
            first_border: borders.first(region),
            size: borders.size(region, triangles as usize, &homes),
        });
    }
    let name = |part: &PartFile| part.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Regions {
        shares: routed.shares(ground.leaves, &homes),
        border_count: borders.count(),
        sources: sent.iter().map(|(part, _)| (name(part), part.id())).collect(),
        rows,
    })
}

/// Reads so many triangles from an offset on, some at a time.
fn each_step<I: Id>(
    part: &PartFile,
    mut offset: u64,
    count: u64,
    mut take: impl FnMut([I; 3]) -> Result<(), BuildError>,
) -> Result<(), BuildError> {
    const STEP: u64 = 1 << 16;
    for start in (0..count).step_by(STEP as usize) {
        let step: Vec<[I; 3]> = part.read_items(offset, STEP.min(count - start) as usize)?;
        offset += size_of_val(&step[..]) as u64;
        step.into_iter().try_for_each(&mut take)?;
    }
    Ok(())
}

/// Parts that regions are made of.
pub(crate) struct Parts<'a> {
    pub(crate) ground: &'a Ground,
    /// That of the plan, which has the ground.
    pub(crate) plan: &'a Arc<PartFile>,
    /// That which [`Regions`] is the record of.
    pub(crate) regions: &'a Arc<PartFile>,
    pub(crate) folder: &'a PartFolder,
}

impl Regions {
    /// Triangles of each region, copies included.
    pub(crate) fn weights(&self) -> impl Iterator<Item = u64> + Clone {
        self.rows.iter().map(|row| row.size.triangles)
    }

    fn load<I: Id>(
        &self,
        region: usize,
        parts: &Parts<'_>,
        ground: &Opened<I>,
        context: &Context<'_>,
    ) -> Result<Mesh, BuildError> {
        let Row { offset, pieces, first_border, size } = self.rows[region];
        let mut reader = PartReader::at(parts.regions, offset);
        let pieces: Vec<Piece> = reader.items(pieces as usize)?;
        let foreign: Vec<Foreign<I>> = reader.items(size.foreign as usize)?;
        let border = reader.items(size.border as usize)?;
        let mut triangles = Vec::<[I; 3]>::new();
        for Piece { source, offset, count } in pieces {
            let part = match self.sources.get(source as usize) {
                Some((name, id)) => &parts.folder.open_same(name, *id)?,
                None => parts.regions,
            };
            triangles.append(&mut part.read_items(offset, count as usize)?);
        }
        let material = Material { triangles, foreign, border, first_border };
        material.load(region, &ground.homes, &ground.vertices, context)
    }

    /// Cuts the regions of a range into leaves, and writes these and all else that becomes of them.
    pub(crate) fn work(
        &self,
        range: Range<usize>,
        parts: &Parts<'_>,
        settings: &Settings,
        context: &Context<'_>,
        out: &mut PartWriter,
    ) -> Result<Results, BuildError> {
        with_ids!(parts.ground.ids(), type I => self.work_as::<I>(range, parts, settings, context, out))
    }

    fn work_as<I: Id>(
        &self,
        range: Range<usize>,
        parts: &Parts<'_>,
        settings: &Settings,
        context: &Context<'_>,
        out: &mut PartWriter,
    ) -> Result<Results, BuildError> {
        let ground = parts.ground.open::<I>(parts.plan)?;
        let carried = parts.ground.carried;
        let cost = |row: &Row| row.size.cost(carried, settings);
        let largest = self.rows[range.clone()].iter().map(cost).max().unwrap_or(0);
        let budget = &context.store.budget;
        let workers =
            (budget.available_for_work() / largest.max(1)).clamp(1, rayon::current_num_threads() as u64);
        let _share = budget.reserve_work("a region", workers * largest)?;

        let spool = Spool::new(&context.store, LEAVES);
        let phase = context.trace.phase();
        let work = |at: usize| {
            let _traced = phase.task("region");
            context.check()?;
            let mesh = self.load(range.start + at, parts, &ground, context)?;
            let leaves = self.shares.of(&mesh, settings);
            region::done(mesh, leaves, self.border_count, settings, &spool, context)
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
        ground: &Ground,
        parts: &[(Arc<PartFile>, Results)],
        settings: &Settings,
        context: &Context<'_>,
        repairs: &mut Repairs,
    ) -> Result<Decomposition, BuildError> {
        let mut spool = Spool::named(&context.store, LEAVES, LEAVES);
        let mut gatherer = Gatherer::new(self.border_count, self.shares.copies, settings, &context.store)?;
        for (part, Results(results)) in parts {
            let before = spool.earlier_len();
            spool.push_earlier(Extent::new(Arc::clone(part), 0..part.len())?);
            for (offset, len) in results {
                context.check()?;
                let record: Vec<u8> = part.read_items(*offset, *len as usize)?;
                let (mut done, _): (Done, usize) = decode_from_slice(&record, CONFIG)
                    .map_err(|error| BuildError::Record(error.to_string()))?;
                done.leaves.iter_mut().for_each(|leaf| leaf.shift(before));
                gatherer.take(done)?;
            }
        }
        gatherer.finish(ground.about, spool, context, repairs)
    }
}

const CONFIG: bincode::config::Configuration = bincode::config::standard();
