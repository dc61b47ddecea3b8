//! Processes that share the steps of a build without an engine: each looks for a step that can be done and that nobody has in hand.

use super::folder::Folder;
use super::job::{self, Plan};
use super::step::Step;
use super::{StepReport, output_of, run};
use crate::config::Resources;
use crate::error::BuildError;
use crate::progress::BuildProgress;
use chpm_extmem::{Cancel, ExtmemError};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

/// Times that a step may fail for a part that it reads, which then is made again.
const MOST_FAULTS: u32 = 3;
/// Waits between two looks at what others have done.
const FIRST_WAIT: Duration = Duration::from_millis(50);
const LAST_WAIT: Duration = Duration::from_secs(5);

/// Does whatever steps of the plan in `folder` nobody else does, until all are done. Any number of processes may do so side by side, on any machines that
/// see the folder: a step is in the hands of whoever holds its lock, which a process gives back however it ends. Parts that turn out
/// to be damaged are made again. `told` gets a report of each step that this process has done.
///
/// # Errors
/// See [`BuildError`].
pub fn work(
    folder: &Path,
    output: Option<(&Path, bool)>,
    resources: &Resources,
    progress: &dyn BuildProgress,
    cancel: &Cancel,
    mut told: impl FnMut(&StepReport) -> Result<(), BuildError>,
) -> Result<(), BuildError> {
    let open = || Folder::open::<Plan>(folder, &resources.fail_points, None);
    let Plan { parts, levels, .. } = open().map_err(|error| super::explained(error, folder))?.1.record;
    let steps = Step::all(parts, levels);
    let default = output_of(folder);
    let model = output.map_or(default.as_path(), |(path, _)| path);
    let (mut done, mut faults) = (BTreeSet::from([Step::Plan]), BTreeMap::<Step, u32>::new());
    let mut wait = FIRST_WAIT;

    while done.len() < steps.len() {
        let mut did_any = false;
        for step in &steps {
            cancel.check()?;
            let needed = step.inputs(parts, levels);
            if done.contains(step) || !needed.iter().all(|input| done.contains(input)) {
                continue;
            }
            let (now, _) = open()?;
            if now.is_current(*step, !faults.is_empty())
                && (*step != Step::Finish || job::is_finished(&now, model))
            {
                done.insert(*step);
                did_any = true;
                continue;
            }
            match run(*step, folder, output, resources, progress, cancel) {
                Ok(report) => {
                    if !report.was_there {
                        told(&report)?;
                    }
                    done.insert(*step);
                    did_any = true;
                }
                // Somebody else has it in hand.
                Err(BuildError::Extmem(ExtmemError::Locked { .. })) => {}
                Err(error) => {
                    let count = faults.entry(*step).or_insert(0);
                    *count += 1;
                    if *count > MOST_FAULTS || !is_about_part(&error) || !now.is_current(Step::Plan, true) {
                        return Err(error);
                    }
                    // What it refers to may be further below: all is looked at again, to the last byte.
                    progress.note(&error.to_string());
                    done = BTreeSet::from([Step::Plan]);
                    did_any = true;
                    break;
                }
            }
        }
        wait = if did_any { FIRST_WAIT } else { LAST_WAIT.min(2 * wait) };
        if !did_any {
            std::thread::sleep(wait);
        }
    }
    Ok(())
}

fn is_about_part(error: &BuildError) -> bool {
    matches!(error, BuildError::Part { .. } | BuildError::Extmem(ExtmemError::Damaged { .. }))
}
