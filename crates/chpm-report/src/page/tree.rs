//! The hierarchy as a tree, for the map of the page: each cluster below the one that has most of its base mesh.

use crate::colors::Colors;
use crate::error::ReportError;
use crate::stats::Row;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, GroupId};
use serde_json::{Value, json};
use std::collections::HashMap;

/// Clusters that a page shows, at most: those of the upper levels.
const SHOWN: usize = 20_000;
/// Vertices that are looked up for each cluster: one in so many, at least.
const ASKED: usize = 64;

/// Cluster that each cluster merged into, for all that a split brings. A file tells of groups only; but the finest mesh of a coarse cluster is made of base
/// meshes of fine ones, so that their vertices are its own.
fn parents(file: &Chpm<MappedFile>) -> Result<Vec<Option<u32>>, ReportError> {
    let mut parents = vec![None; file.clusters().len()];
    let mut owners: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
    for group in (0..file.groups().len() as u32).map(GroupId) {
        let (coarse, fine) = (file.coarse(group), file.fine(group));
        if let [only] = coarse {
            fine.iter().for_each(|id| parents[*id as usize] = Some(*only));
            continue;
        }
        owners.clear();
        for id in coarse.iter().filter(|_| !fine.is_empty()) {
            for position in file.page(ClusterId(*id))?.view().positions {
                let known = owners.entry(position.map(f32::to_bits)).or_default();
                if known.last() != Some(id) {
                    known.push(*id);
                }
            }
        }
        for id in fine {
            let page = file.page(ClusterId(*id))?;
            let base = &page.view().positions[..page.view().base_vertex_count];
            let mut votes = vec![0_u32; coarse.len()];
            for position in base.iter().step_by((base.len() / ASKED).max(1)) {
                for owner in owners.get(&position.map(f32::to_bits)).into_iter().flatten() {
                    let place = coarse.iter().position(|id| id == owner);
                    place.into_iter().for_each(|place| votes[place] += 1);
                }
            }
            // The first of the most.
            let most = votes.iter().max().copied();
            parents[*id as usize] = votes.iter().position(|n| Some(*n) == most).map(|place| coarse[place]);
        }
    }
    Ok(parents)
}

/// The clusters as lists of numbers: id, parent (-1 for none), level, triangles of the source below, triangles, error, share of shared
/// vertices, share that is kept, misses of a cache of 24, edge span, bytes of the page.
pub(super) fn json(file: &Chpm<MappedFile>, rows: &[Row<'_>]) -> Result<Value, ReportError> {
    let parents = parents(file)?;
    let mut below: Vec<u64> = rows
        .iter()
        .map(|row| if row.record.is_leaf() { row.record.triangle_count.into() } else { 0 })
        .collect();
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by_key(|index| rows[*index].record.level);
    for index in &order {
        if let Some(parent) = parents[*index] {
            below[parent as usize] += below[*index];
        }
    }

    let least =
        order.len().checked_sub(SHOWN).map_or(0, |more| rows[order[more]].record.level + u32::from(more > 0));
    fn part(a: u32, b: u32) -> f64 {
        (1000.0 * f64::from(a) / f64::from(b.max(1))).round() / 1000.0
    }

    let nodes = rows.iter().filter(|row| row.record.level >= least).map(|row| {
        let r = row.record;
        json!([
            row.id,
            parents[row.id as usize].map_or(-1, i64::from),
            r.level,
            below[row.id as usize],
            r.triangle_count,
            r.max_error,
            part(r.shared_count, r.vertex_count),
            part(r.base_triangle_count, r.triangle_count),
            (1000.0 * row.acmr()[1]).round() / 1000.0,
            row.edge_span().round(),
            r.page_len,
        ])
    });

    let gradient = Colors::new([0.0, 1.0], false).gradient();
    let colors: Vec<&str> = gradient.split(',').collect();
    Ok(json!({ "least": least, "colors": colors, "nodes": nodes.collect::<Vec<_>>() }))
}
