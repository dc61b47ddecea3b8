//! Verification of a file: every byte and invariant and, where asked for, the source, distances and cuts.

use crate::against::{self, Comparison};
use crate::certify::{self, Certified, Wanted};
use crate::cuts::{self, Checked, Cuts};
use crate::error::VerifyError;
use crate::memory;
use chpm_extmem::{Cancel, Cancelled, MappedFile, Progress, Store};
use chpm_format::verify::Fault;
use chpm_format::{Chpm, FormatError, Report};
use chpm_mesh::Bytes;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Checks besides those of every byte and invariant.
#[derive(Clone, Debug)]
pub struct Checks {
    /// The source, whose triangles must be those of the leaves.
    pub against: Option<PathBuf>,
    /// Whether stored errors and distances are to be proven; of no effect without a source.
    pub errors: bool,
    /// Levels whose errors are proven; all if there are none.
    pub levels: Vec<u32>,
    /// Positions of each level.
    pub positions: u32,
    /// Pieces that a triangle may be cut into for each triangle of the other surface that may lie under it.
    pub effort: u32,
    /// Random cuts to look for cracks in.
    pub cuts: Option<u32>,
    /// Seed of the first cut.
    pub seed: u64,
}

impl Default for Checks {
    fn default() -> Self {
        Checks {
            against: None,
            errors: false,
            levels: Vec::new(),
            positions: 1,
            effort: 256,
            cuts: None,
            seed: 0,
        }
    }
}

/// Findings.
#[derive(Debug, Default)]
pub struct Verification {
    /// Every fault that is told in full.
    pub faults: Vec<String>,
    /// All faults, also those that are only counted.
    pub fault_count: u64,
    /// Bytes and invariants; none if the file does not even open.
    pub checked: Option<Report>,
    /// Whether detail of the source was left out, so that the leaves are not it.
    pub trimmed: bool,
    /// The leaves beside the source.
    pub compared: Option<Comparison>,
    /// Proofs of errors and distances.
    pub errors: Option<Certified>,
    /// Random cuts.
    pub cuts: Option<Cuts>,
    /// The file's origin, which places of proofs are relative to.
    pub origin: [f64; 3],
}

impl Verification {
    /// The verification of a file that does not even open.
    pub fn unopened(error: &FormatError) -> Self {
        Verification {
            faults: vec![format!("I10 bytes: {error}")],
            fault_count: 1,
            ..Verification::default()
        }
    }

    /// Whether there is no fault.
    pub fn is_sound(&self) -> bool {
        self.fault_count == 0
    }

    /// Whether all pages can be read, so that more than bytes can be looked at.
    pub fn is_readable<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> bool {
        self.checked.as_ref().is_some_and(|report| report.good_pages == file.clusters().len() as u64)
    }
}

/// Verifies a file within `memory` of the whole process. What does not fit goes to a folder in `scratch`. Each step
/// looks at `cancel`.
///
/// # Errors
/// See [`VerifyError`]; faults are no errors.
pub fn verify(
    file: &Chpm<MappedFile>,
    checks: &Checks,
    memory: Bytes,
    scratch: &Path,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Verification, VerifyError> {
    let memory = divided(file, checks, memory)?;
    let mut found = structure(file, memory, progress, cancel)?;
    // Pages that cannot be read have been told; what their triangles were cannot be.
    if !found.is_readable(file) {
        return Ok(found);
    }

    if let Some(source) = checks.against.as_deref().filter(|_| !found.trimmed) {
        let store = Store::create(scratch, memory.saturating_sub(against::OWN))?;
        let compared = against::compare(file, source, &store, progress, cancel)?;
        found.add(&compared.faults, compared.fault_count);
        found.compared = Some(compared);
    }

    if checks.errors && found.compared.as_ref().is_some_and(Comparison::is_equal) {
        let wanted = Wanted {
            levels: checks.levels.clone(),
            positions: checks.positions,
            cuts: (checks.seed, checks.cuts.unwrap_or(0)),
            effort: checks.effort,
        };
        let certified = certify::certify(file, &wanted, memory, progress, cancel)?;
        let (faults, triangles) = certify::faults(&certified, found.origin);
        found.add(&faults, triangles);
        found.errors = Some(certified);
    }

    if let Some(count) = checks.cuts {
        let store = Store::create(scratch, memory)?;
        let is_even = found.checked.as_ref().is_some_and(Report::is_ok);
        let sound = Checked { file, is_even };
        let cuts = cuts::check(sound, count, checks.seed, &store, memory, progress, cancel)?;
        found.add(&cuts.faults, cuts.fault_count);
        found.cuts = Some(cuts);
    }
    Ok(found)
}

/// The memory that is left for the checks, if they make sense for the file.
fn divided(file: &Chpm<MappedFile>, checks: &Checks, memory: Bytes) -> Result<u64, VerifyError> {
    let path = || file.get_ref().path().to_owned();
    if checks.errors && file.is_trimmed() {
        let what = "the source that --errors could be held against".to_owned();
        return Err(VerifyError::Trimmed { path: path(), what });
    }
    let levels = file.levels().len();
    if let Some(level) = checks.levels.iter().find(|level| **level as usize >= levels) {
        return Err(VerifyError::Level { path: path(), level: *level, highest: levels - 1 });
    }
    let mut own = if checks.errors { certify::FOUND * file.clusters().len() as u64 } else { 0 };
    if checks.cuts.is_some() {
        own += cuts::least(file);
    }
    memory::divide(file, memory, own)
}

/// Bytes and invariants.
fn structure(
    file: &Chpm<MappedFile>,
    memory: u64,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Verification, VerifyError> {
    let (mut before, mut is_told) = (0, false);
    let checked = chpm_format::verify_within(file, memory, |done, all| {
        if !std::mem::replace(&mut is_told, true) {
            progress.begin("verify", all);
        }
        progress.advance(done - before);
        before = done;
        if cancel.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    progress.end();
    let checked = checked.ok_or(Cancelled)?;
    Ok(Verification {
        faults: checked.faults.iter().map(describe).collect(),
        fault_count: checked.fault_count,
        checked: Some(checked),
        trimmed: file.is_trimmed(),
        origin: file.header().origin,
        ..Verification::default()
    })
}

impl Verification {
    /// Adds faults, of which some are told.
    pub fn add(&mut self, faults: &[String], count: u64) {
        self.faults.extend_from_slice(faults);
        self.fault_count += count;
    }
}

/// A fault as it is printed. Where its message names the place already, it is not named twice.
pub fn describe(fault: &Fault) -> String {
    let names_place = fault.message.starts_with(&fault.place.to_string());
    if names_place { format!("{}: {}", fault.invariant, fault.message) } else { fault.to_string() }
}
