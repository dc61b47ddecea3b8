//! Sheets: an image for each cluster. Those of leaves are baked from the source's images, those of parents from their children's sheets, triangle by triangle, since the finest
//! mesh of a parent is what its children's base meshes are together (I4).
//!
//! Geometry is as it would be without them. Level by level, clusters are tasks over the threads; what depends on others, and with it on order, is read only.

mod cluster;
mod found;
mod raw;
mod seams;

use crate::config::{Settings, Texture};
use crate::context::Context;
use crate::error::BuildError;
use crate::ingest::Painted;
use crate::progress::Stage;
use crate::trim::Built;
use chpm_extmem::Spool;
use chpm_format::{ImageCodec, SheetLayout, SheetRecord, checksum};
use chpm_image::encode;
use chpm_texture::sheet::Plan;
use cluster::{Cluster, Scratch};
use found::Found;
use raw::{Raw, RawRef};
use rayon::prelude::*;

/// Sheets of all clusters, as they are stored.
pub(crate) struct Sheets {
    bytes: Spool,
    /// By node: its record, but for what follows from its place, and where its bytes are.
    made: Vec<Option<(SheetRecord, u64)>>,
}

impl Sheets {
    /// The record of a node's sheet, without its place in the file.
    pub(crate) fn record(&self, node: u32) -> SheetRecord {
        self.made[node as usize].map_or_else(|| unreachable!("node {node} has a sheet"), |(record, _)| record)
    }

    /// Reads the bytes of a node's sheet.
    pub(crate) fn read(&self, node: u32, out: &mut Vec<u8>) -> Result<(), BuildError> {
        let Some((record, offset)) = self.made[node as usize] else { return Ok(()) };
        Ok(self.bytes.read(offset, record.len() as usize, out)?)
    }
}

/// Makes the sheets of all clusters.
pub(crate) fn run(built: &Built, painted: &Painted, context: &Context<'_>) -> Result<Sheets, BuildError> {
    let Built { tree, clusters, .. } = built;
    let found = Found::new(built, painted, context)?;
    let bytes = Spool::new(&context.store, "sheets");
    let mut made = vec![None; tree.nodes.len()];
    let mut raws: Vec<Option<RawRef>> = vec![None; tree.nodes.len()];
    // By level, and how high its sheets are read.
    let mut levels: Vec<(Raw, u32)> = Vec::new();
    let phase = context.trace.phase();
    for level in 0..tree.level_count() {
        let nodes: Vec<u32> =
            tree.level(level).map(|node| node as u32).filter(|node| clusters.is_built(*node)).collect();
        let parents = nodes.iter().filter_map(|node| tree.nodes[*node as usize].parent);
        let last = parents.map(|parent| tree.nodes[parent as usize].level).max().unwrap_or(level);
        levels.push((Raw::new(&context.store), last));
        let (own, bytes, raws_below) = (&levels[level as usize].0, &bytes, &raws);
        let results = nodes.par_iter().with_max_len(1).map_init(Scratch::default, |scratch, node| {
            let _traced = phase.task("sheet");
            context.check()?;
            let cluster =
                Cluster { node: *node, built, painted, found: &found, levels: &levels, raws: raws_below };
            let (plan, texels, _memory) = cluster.bake(scratch, context)?;
            let raw = own.append(&plan, &texels)?;
            let (record, stored) = stored(&plan, &texels)?;
            let offset = bytes.append(&stored)?;
            context.progress.advance(1);
            Ok((*node, (record, offset), raw))
        });
        for (node, sheet, raw) in results.collect::<Result<Vec<_>, BuildError>>()? {
            (made[node as usize], raws[node as usize]) = (Some(sheet), Some(raw));
        }
        for (below, (raw, last)) in (0..).zip(&mut levels) {
            if *last <= level && below < level {
                *raw = Raw::new(&context.store);
            }
        }
    }
    Ok(Sheets { bytes, made })
}

/// A sheet as it is stored, and its record.
fn stored(plan: &Plan, texels: &[[u8; 4]]) -> Result<(SheetRecord, Vec<u8>), BuildError> {
    let size = plan.size.map(|side| side as u16);
    let image = encode(texels, size).map_err(|error| BuildError::Record(error.to_string()))?;
    let layout =
        SheetLayout { origin: plan.origin, charts: plan.charts.clone(), chart_of: plan.chart_of.clone() };
    let mut bytes = layout.encode()?;
    let record = SheetRecord {
        chart_count: plan.charts.len() as u32,
        layout_len: bytes.len() as u32,
        image_len: image.bytes.len() as u32,
        size,
        codec: if image.is_png { ImageCodec::Png } else { ImageCodec::Jpeg } as u32,
        texel: plan.texel() as f32,
        ..SheetRecord::default()
    };
    bytes.extend_from_slice(&image.bytes);
    Ok((SheetRecord { checksum: checksum(&bytes), ..record }, bytes))
}

/// Refuses settings that images do not go with, and those that sheets do not go with yet.
pub(crate) fn check(settings: &Settings) -> Result<(), BuildError> {
    if !settings.colors && matches!(settings.texture, Texture::Vertices | Texture::Sheets) {
        return Err(BuildError::NoColors { texture: settings.of_images()[1] });
    }
    match settings.without_sheets().filter(|_| settings.texture == Texture::Sheets) {
        Some(setting) => Err(BuildError::NoSheets { setting }),
        None => Ok(()),
    }
}

/// A cluster has more charts than there are numbers for.
fn too_many(triangles: usize) -> BuildError {
    let (what, limit) = ("charts of a cluster", chpm_format::sheet::MAX_CHARTS as u64);
    BuildError::Limit { stage: Stage::Sheets, what, got: triangles as u64, limit }
}
