//! Work of each step between the parts that it reads and the one that it writes.

use super::folder::{Folder, Opened};
use super::step::{Share, Step};
use crate::checkpoint::Arranged;
use crate::config::Settings;
use crate::context::Context;
use crate::decompose::{self, Ground, Parts, Regions, Results, Sent};
use crate::emit::{Known, Output};
use crate::error::BuildError;
use crate::output::OutputFiles;
use crate::progress::Stage;
use crate::simplify::{self, Handed, Inputs, Levels};
use crate::trim::{self, Built};
use crate::{allowance, hierarchy, layout};
use chpm_extmem::{FailPoints, PartFile, PartWriter, Reservation};
use chpm_format::{ClusterRecord, Remnant};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// Record of a plan; vertices and triangles of the source are the part's blobs.
#[derive(Serialize, Deserialize)]
pub(super) struct Plan {
    pub(super) settings: Settings,
    pub(super) parts: u32,
    /// Levels that are simplified in parts.
    pub(super) levels: u32,
    pub(super) known: Known,
    pub(super) ground: Ground,
}

impl Plan {
    /// An error unless a step is one of this plan.
    pub(super) fn check(&self, step: Step, folder: &Path) -> Result<(), BuildError> {
        if step != Step::Plan && Step::all(self.parts, self.levels).contains(&step) {
            return Ok(());
        }
        let (before, behind) = step.words();
        Err(BuildError::Part {
            path: folder.join(Step::Plan.file()),
            reason: format!(
                "has parts: {}, levels in parts: {}, and no step '{}{behind}'",
                self.parts, self.levels, before
            ),
            remedy: "name one that it has, or plan again".to_owned(),
        })
    }
}

/// The step that a file in the folder is of, as far as that can be told.
pub(super) fn step_of(folder: &Path, path: &Path) -> Option<Step> {
    let name = path.file_name()?.to_str()?;
    if name == Step::Plan.file() {
        return Some(Step::Plan);
    }
    let (_, plan) = Folder::open::<Plan>(folder, &FailPoints::default(), None).ok()?;
    let Plan { parts, levels, .. } = plan.record;
    let step = Step::all(parts, levels).into_iter().find(|step| step.file() == name)?;
    (path.parent() == Some(folder)).then_some(step)
}

/// Length and identity of the model, where it has been finished.
#[derive(Serialize, Deserialize)]
struct Finished {
    len: u64,
}

/// Whether the model that was finished is still there.
pub(super) fn is_finished(folder: &Folder, output: &Path) -> bool {
    let finished = folder.read::<Finished>(Step::Finish, None);
    finished.is_ok_and(|finished| output.metadata().is_ok_and(|found| found.len() == finished.record.len))
}

/// Tables of some clusters, as bytes; their pages are the part's blobs.
#[derive(Default, Serialize, Deserialize)]
struct Emitted {
    records: Vec<u8>,
    /// Each names its cluster by its place in the file.
    remnants: Vec<u8>,
}

/// The surroundings of a step.
pub(super) struct Job<'a> {
    pub(super) folder: &'a Folder,
    pub(super) plan: &'a Opened<Plan>,
    pub(super) context: &'a Context<'a>,
}

/// Leaves under a tree, and the memory for tables.
struct Under {
    arranged: Arranged,
    _tables: Reservation,
}

impl Job<'_> {
    /// Does the step.
    pub(super) fn run(&self, step: Step, output: &Path, overwrite: bool) -> Result<(), BuildError> {
        match step {
            Step::Plan => Ok(()),
            Step::Scatter(share) => self.write(step, Stage::Decompose, |job, out| job.scatter(share, out)),
            Step::Borders => self.write(step, Stage::Decompose, |job, out| job.borders(out)),
            Step::Regions(share) => self.write(step, Stage::Decompose, |job, out| job.regions(share, out)),
            Step::Hierarchy => self.write(step, Stage::Hierarchy, |job, _| job.hierarchy()),
            Step::Group(level) => self.write(step, Stage::Simplify, |job, _| job.group(level)),
            Step::Simplify(level, share) => {
                self.write(step, Stage::Simplify, |job, out| job.simplify(level, share, out))
            }
            Step::Top(_) => self.write(step, Stage::Simplify, |job, out| job.top(out)),
            Step::Layout => self.write(step, Stage::Layout, |job, _| job.layout()),
            Step::Emit(share) => self.write(step, Stage::Layout, |job, out| job.emit(share, out)),
            Step::Finish => self.write(step, Stage::Emit, |job, _| job.finish(output, overwrite)),
        }
    }

    /// Writes the part of a step.
    fn write<T: Serialize + Send>(
        &self,
        step: Step,
        stage: Stage,
        make: impl FnOnce(&Self, &mut PartWriter) -> Result<T, BuildError> + Send,
    ) -> Result<(), BuildError> {
        let Plan { parts, levels, known, .. } = &self.plan.record;
        let inputs = step.inputs(*parts, *levels);
        let total = known.facts.triangles;
        let write = |out: &mut PartWriter| self.context.stage(stage, total, || make(self, out));
        self.folder.write(step, &inputs, &self.context.store, write).map(|_| ())
    }

    fn settings(&self) -> &Settings {
        &self.plan.record.settings
    }

    fn scatter(&self, share: Share, out: &mut PartWriter) -> Result<Sent, BuildError> {
        let Opened { part, record: Plan { ground, .. } } = self.plan;
        ground.scatter(share.of_equal(ground.triangle_count()), part, self.context, out)
    }

    /// Records of all parts of a step.
    fn read_all<T: DeserializeOwned>(
        &self,
        step: fn(Share) -> Step,
    ) -> Result<Vec<(Arc<PartFile>, T)>, BuildError> {
        let read = |share| self.folder.read::<T>(step(share), None);
        let parted = |share| read(share).map(|Opened { part, record }| (part, record));
        Share::all(self.plan.record.parts).map(parted).collect()
    }

    fn borders(&self, out: &mut PartWriter) -> Result<Regions, BuildError> {
        let Opened { part, record: Plan { ground, settings, .. } } = self.plan;
        let sent = self.read_all(Step::Scatter)?;
        decompose::write_regions(ground, part, &sent, settings, self.context, out)
    }

    fn regions(&self, share: Share, out: &mut PartWriter) -> Result<Results, BuildError> {
        let Opened { part, record } = self.folder.read::<Regions>(Step::Borders, None)?;
        let (ground, plan) = (&self.plan.record.ground, &self.plan.part);
        let parts = Parts { ground, plan, regions: &part, folder: &self.folder.parts };
        record.work(share.range(record.weights()), &parts, self.settings(), self.context, out)
    }

    fn hierarchy(&self) -> Result<(Known, Arranged), BuildError> {
        let Plan { known, ground, settings, .. } = &self.plan.record;
        let mut known = known.clone();
        let regions = self.folder.read::<Regions>(Step::Borders, None)?.record;
        let results = self.read_all(Step::Regions)?;
        let leaves = regions.gather(ground, &results, settings, self.context, &mut known.repairs)?;
        known.facts.add_leaves(&leaves);
        let (tree, release) = hierarchy::run(&leaves, settings, self.context)?;
        Ok((known, Arranged { leaves, tree, release }))
    }

    fn under(&self) -> Result<Under, BuildError> {
        let store = &self.context.store;
        let (_, Arranged { leaves, tree, release }) =
            self.folder.read::<(Known, Arranged)>(Step::Hierarchy, Some(store))?.record;
        let tables = allowance::tables(tree.nodes.len());
        Ok(Under {
            _tables: store.budget.reserve_work("tables of clusters", tables)?,
            arranged: Arranged { leaves: leaves.hold(store)?, tree, release },
        })
    }

    fn inputs<'a>(&'a self, under: &'a Under) -> Inputs<'a> {
        let Arranged { leaves, tree, release } = &under.arranged;
        Inputs { decomposition: leaves, tree, release, settings: self.settings(), context: self.context }
    }

    /// The levels with all that the parts of the last one before `level` have made.
    fn levels_below(&self, level: u32, inputs: &Inputs<'_>) -> Result<Levels, BuildError> {
        let Some(below) = level.checked_sub(1) else { return Ok(Levels::begin(inputs)) };
        let mut levels = self.folder.read::<Levels>(Step::Group(below), Some(&self.context.store))?.record;
        for share in Share::all(self.plan.record.parts) {
            let Opened { part, record } = self.folder.read::<Handed>(Step::Simplify(below, share), None)?;
            levels.take_over(&part, record, inputs)?;
        }
        match levels.is_whole() {
            true => Ok(levels),
            false => Err(BuildError::Record(format!("parts of level {below} do not have all its groups"))),
        }
    }

    fn group(&self, level: u32) -> Result<Levels, BuildError> {
        let under = self.under()?;
        let inputs = self.inputs(&under);
        let mut levels = self.levels_below(level, &inputs)?;
        levels.form(&inputs)?;
        Ok(levels)
    }

    fn simplify(&self, level: u32, share: Share, out: &mut PartWriter) -> Result<Handed, BuildError> {
        let under = self.under()?;
        let inputs = self.inputs(&under);
        let levels = self.folder.read::<Levels>(Step::Group(level), Some(&self.context.store))?.record;
        let range = share.range(levels.weights(&inputs).into_iter());
        levels.hand_over(range, &inputs, out)
    }

    fn top(&self, out: &mut PartWriter) -> Result<Built, BuildError> {
        let under = self.under()?;
        let begun = {
            let inputs = self.inputs(&under);
            self.levels_below(self.plan.record.levels, &inputs)?
        };
        let clusters = simplify::run(&self.inputs(&under), Some(Box::new(begun)), |_| Ok(()))?;
        let mut built = trim::run(under.arranged.tree, clusters, self.context)?;
        built.clusters.hand_over(out, &self.context.store)?;
        Ok(built)
    }

    fn built(&self) -> Result<(Built, Reservation), BuildError> {
        let store = &self.context.store;
        let Opened { part, record: mut built } =
            self.folder.read::<Built>(Step::Top(self.plan.record.levels), Some(store))?;
        let tables = allowance::tables(built.tree.nodes.len());
        let tables = store.budget.reserve_work("tables of clusters", tables)?;
        built.clusters.take_over(&part, &built.tree)?;
        Ok((built, tables))
    }

    fn layout(&self) -> Result<Vec<u32>, BuildError> {
        let (built, _tables) = self.built()?;
        Ok(layout::order(&built, self.settings()))
    }

    fn emit(&self, share: Share, out: &mut PartWriter) -> Result<Emitted, BuildError> {
        let (built, _tables) = self.built()?;
        let order = self.folder.read::<Vec<u32>>(Step::Layout, None)?.record;
        let weights = order.iter().map(|node| u64::from(built.clusters.page(*node).len));
        let range = share.range(weights);
        let mut places = range.start as u32..;
        let mut emitted = Emitted::default();
        layout::run_in_order(
            range,
            &order,
            &built,
            self.settings(),
            self.context,
            |record, mut found, page| {
                out.append(page)?;
                let place = places.next().unwrap_or_default();
                found.iter_mut().for_each(|remnant| remnant.cluster = place);
                emitted.records.extend_from_slice(bytemuck::bytes_of(record));
                emitted.remnants.extend_from_slice(bytemuck::cast_slice(&found));
                Ok(())
            },
        )?;
        Ok(emitted)
    }

    fn finish(&self, output: &Path, overwrite: bool) -> Result<Finished, BuildError> {
        let output = &chpm_extmem::target(output, overwrite)?;
        let _lock = chpm_extmem::Lock::acquire(output)?;
        let fail_points = self.context.store.workdir.fail_points().clone();
        let out = OutputFiles::create(output, self.settings().volumes, overwrite, fail_points)?;
        let known =
            self.folder.read::<(Known, Arranged)>(Step::Hierarchy, Some(&self.context.store))?.record.0;
        let (built, _tables) = self.built()?;
        let remnants = simplify::REMNANT_BYTES * built.clusters.remnant_count() as u64;
        let _remnants = self.context.store.budget.reserve_work("remnants", remnants)?;
        let order = self.folder.read::<Vec<u32>>(Step::Layout, None)?.record;
        let file = Output::begin(out, &order, &built, &known, None, self.settings())?;

        let (mut records, mut page) = (Vec::with_capacity(order.len()), Vec::new());
        for share in Share::all(self.plan.record.parts) {
            let Opened { part, record: emitted } = self.folder.read::<Emitted>(Step::Emit(share), None)?;
            let mut offset = 0;
            for bytes in emitted.records.chunks_exact(size_of::<ClusterRecord>()) {
                self.context.check()?;
                let record: ClusterRecord = bytemuck::pod_read_unaligned(bytes);
                page.resize(record.page_len as usize, 0);
                part.read_exact(offset, &mut page)?;
                file.write_page(records.len(), &page)?;
                offset += u64::from(record.page_len);
                records.push((record, Vec::new()));
            }
            for bytes in emitted.remnants.chunks_exact(size_of::<Remnant>()) {
                let remnant: Remnant = bytemuck::pod_read_unaligned(bytes);
                let cluster: Option<&mut (_, Vec<_>)> = records.get_mut(remnant.cluster as usize);
                let (_, of_cluster) = cluster.ok_or_else(|| {
                    BuildError::Record("a remnant is of no cluster that is there".to_owned())
                })?;
                of_cluster.push(remnant);
            }
        }
        let written = file.finish(records, self.context)?;
        Ok(Finished { len: written.len })
    }
}
