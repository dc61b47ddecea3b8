//! Sampled distances of a file's levels and cuts to its source.

use crate::against::{self, Comparison};
pub use crate::certify::Which;
use crate::cuts;
use crate::deviation::{self, Judge, LevelDeviation};
use crate::error::VerifyError;
use crate::memory;
use chpm_extmem::{Cancel, MappedFile, Progress, Store};
use chpm_format::Chpm;
use chpm_measure::sweep::Block;
use chpm_mesh::Bytes;
use chpm_refine::Hierarchy;
use std::path::Path;

/// Bytes that are found out about each cluster.
const FOUND: u64 = 1664;

/// Request for a measurement.
#[derive(Clone, Copy, Debug)]
pub struct Measures {
    /// Whether all levels are.
    pub levels: bool,
    /// Positions of each level.
    pub positions: u32,
    /// Random cuts.
    pub cuts: u32,
    /// Seed of the first cut.
    pub seed: u64,
    /// Samples on each triangle of the finer mesh at least.
    pub samples: u32,
}

impl Default for Measures {
    fn default() -> Self {
        Measures { levels: true, positions: 2, cuts: 0, seed: 0, samples: 10 }
    }
}

/// Result of a measurement.
#[derive(Debug)]
pub struct Measured {
    /// Levels, from the finest on, and then cuts.
    pub rows: Vec<(Which, LevelDeviation)>,
    /// How many of these are levels.
    pub levels: usize,
    /// The leaves beside the source.
    pub compared: Comparison,
    /// Distances up to this count as none.
    pub slack: f64,
}

impl Measured {
    /// Samples that are farther away than the file states.
    pub fn violations(&self) -> u64 {
        self.rows.iter().map(|(_, found)| found.violations.samples).sum()
    }
}

/// Measures a file beside the source that it was built from, within `memory` of the whole process. What does not fit goes to a folder in
/// `scratch`.
///
/// # Errors
/// [`VerifyError::Trimmed`] and [`VerifyError::Different`] if the leaves are not the source; else see [`VerifyError`].
pub fn measure(
    file: &Chpm<MappedFile>,
    source: &Path,
    measures: &Measures,
    memory: Bytes,
    scratch: &Path,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Measured, VerifyError> {
    let path = file.get_ref().path().to_owned();
    if file.is_trimmed() {
        let what = format!(
            "'{}' to be measured against; measure what `chpm extract` takes out of it against the source",
            source.display()
        );
        return Err(VerifyError::Trimmed { path, what });
    }
    let free = memory::divide(file, memory, FOUND * file.clusters().len() as u64)?;
    let compared = {
        let store = Store::create(scratch, free.saturating_sub(against::OWN))?;
        against::compare(file, source, &store, progress, cancel)?
    };
    if !compared.is_equal() {
        let (source_path, faults) = (source.to_owned(), compared.fault_count);
        return Err(VerifyError::Different { path, source_path, faults });
    }

    let each = memory::of_searcher(memory::largest(file)) + Block::BYTES;
    memory::on_few(free, each, |free| {
        let judge = Judge::new(file, measures.samples as usize, free, progress, cancel)?;
        rows(&judge, measures, compared, progress, cancel)
    })
}

/// All that is asked for.
fn rows(
    judge: &Judge<'_>,
    measures: &Measures,
    compared: Comparison,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Measured, VerifyError> {
    let file = judge.file();
    let mut rows = Vec::new();
    if measures.levels {
        deviation::levels(judge, measures.positions, progress, cancel, |level, collapsed, found| {
            rows.push((Which::Level { level, collapsed }, found));
        })?;
    }
    let levels = rows.len();
    let hierarchy = Hierarchy::new(file);
    for seed in (0..measures.cuts).map(|i| measures.seed.wrapping_add(i.into())) {
        cancel.check()?;
        let cut = cuts::draw(file, &hierarchy, seed)?;
        let members = judge.cut(&cut, &format!("cut {seed}"), progress, cancel)?;
        rows.push((Which::Cut { seed }, LevelDeviation::of(&members, judge.slack())));
    }
    Ok(Measured { rows, levels, compared, slack: judge.slack() })
}
