//! Colours of a file's sheets beside those of its source, and how far they have slid.
//!
//! Samples lie on the meshes of a level. What a sample shows is held against what the source shows where it is nearest. And its colour is followed
//! through the sheets that it came by, chart by chart, down to the triangle of the source that it is of. A sample that lies in a chart outside of its
//! triangles has no such way: its texels were filled. Nor has one where two triangles lie over each other, by less than a texel.
//!
//! Where the way is known, it is held against the errors of the meshes that it leads through: each projection moves a point by no more than the mesh's error
//! and that of the finest mesh together, once in space and once in the chart, where it is longer by one through the cosine of the chart's steepest triangle.

mod cluster;
mod difference;
mod source;
mod way;

pub use difference::{Difference, Slide};

use crate::deviation::at_position;
use crate::error::VerifyError;
use crate::memory;
use chpm_extmem::{Cancel, MappedFile, Progress, Store};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use cluster::Cluster;
use difference::Found;
use rayon::prelude::*;
use source::{Paint, Source};
use std::path::Path;
use way::Ways;

/// Bytes in memory for each triangle of the file: where it is, and how it is found from its parent.
const OF_TRIANGLE: u64 = 160;

/// Request for a measurement of colours.
#[derive(Clone, Copy, Debug)]
pub struct TextureMeasures {
    /// Positions of each level.
    pub positions: u32,
    /// Samples for each triangle, spread by area.
    pub samples: u32,
}

/// Colours of a level.
#[derive(Clone, Debug)]
pub struct LevelTexture {
    /// The level.
    pub level: u32,
    /// The part of its collapses that is applied.
    pub collapsed: f64,
    /// Triangles that it draws.
    pub triangles: u64,
    /// Difference to the source's colours.
    pub difference: Difference,
    /// How far colours have slid.
    pub slide: Slide,
}

/// Measures the colours of all levels beside the source that the file was built from, within `memory` of the whole process. The source and the file's meshes are
/// in memory, images on disk.
///
/// # Errors
/// [`VerifyError::NoSheets`] and [`VerifyError::NoImages`]; else see [`VerifyError`].
pub fn measure_texture(
    file: &Chpm<MappedFile>,
    source: &Path,
    measures: &TextureMeasures,
    memory: Bytes,
    scratch: &Path,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Vec<LevelTexture>, VerifyError> {
    let path = file.get_ref().path().to_owned();
    if !file.header().has_sheets() {
        return Err(VerifyError::NoSheets { path });
    }
    if file.is_trimmed() {
        let what = format!("'{}' to be measured against", source.display());
        return Err(VerifyError::Trimmed { path, what });
    }
    let store = Store::create(scratch, memory::divide(file, memory, 0)?)?;
    let triangles: u64 = file.clusters().iter().map(|record| u64::from(record.triangle_count)).sum();
    let _meshes =
        store.budget.reserve_work("the meshes of a file, to be measured", OF_TRIANGLE * triangles)?;
    let source = Source::read(file, source, &store, progress, cancel)?;

    progress.begin("read clusters", file.clusters().len() as u64);
    let clusters: Result<Vec<Cluster>, VerifyError> = (0..file.clusters().len() as u32)
        .into_par_iter()
        .map(|id| {
            cancel.check()?;
            let cluster = Cluster::read(file, id);
            progress.advance(1);
            cluster
        })
        .collect();
    progress.end();
    let ways = Ways::new(file, clusters?);

    let mut rows = Vec::new();
    for level in 0..file.levels().len() as u32 {
        let first = if level == 0 { measures.positions } else { measures.positions - 1 };
        for step in (0..=first).rev() {
            let collapsed = 1.0 - f64::from(step) / f64::from(measures.positions);
            let cut = at_position(file, level, collapsed)?;
            let members: Vec<_> =
                cut.members().iter().filter(|m| file.clusters()[m.cluster.index()].level == level).collect();
            progress.begin(&format!("level {level}, {:.0} %", 100.0 * collapsed), members.len() as u64);
            let found = members.par_iter().with_max_len(1).map_init(
                || Paint::new(&source),
                |paint, member| {
                    cancel.check()?;
                    let found = ways.sample(file, member, measures.samples, &source, paint);
                    progress.advance(1);
                    found
                },
            );
            let found = found.try_reduce(Found::default, |a, b| Ok(a.merged(b)));
            progress.end();
            let found = found?;
            rows.push(LevelTexture {
                level,
                collapsed,
                triangles: found.triangles,
                difference: found.difference(),
                slide: found.slide,
            });
        }
    }
    Ok(rows)
}
