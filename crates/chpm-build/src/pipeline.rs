//! The build on one page.

use crate::checkpoint::{Arranged, Checkpoints, Key, Work, beside};
use crate::clock::Clock;
use crate::config::{BuildConfig, Positions, Resources, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::fingerprint::Fingerprint;
use crate::memo::Memo;
use crate::output::OutputFiles;
use crate::progress::{BuildProgress, Stage};
use crate::report::BuildReport;
use crate::{allowance, decompose, emit, hierarchy, ingest, layout, sheets, simplify, trim};
use chpm_extmem::{Cancel, ExtmemError, Lock, Store, WorkDir, process};
use chpm_import::Supply;
use chpm_mesh::Counted;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// Builds `output` from `source`, a mesh file of any format that [`Input`](chpm_import::Input) reads, or a pipe that one comes
/// through: it is copied to a file of the work directory first, and such a build keeps no checkpoints.
///
/// The output appears complete or not at all. The same source and settings give the same bytes, whatever the resources, and
/// whether an earlier run was ended on the way or not.
///
/// # Errors
/// See [`BuildError`]; nothing is left behind then, or it says what.
pub fn build(
    source: &Path,
    output: &Path,
    config: &BuildConfig,
    progress: &dyn BuildProgress,
    cancel: &Cancel,
) -> Result<BuildReport, BuildError> {
    make(output, config, progress, cancel, |folder| {
        Ok(Supply::take(source, folder, &config.resources.fail_points, cancel)?)
    })
}

/// Builds `output` from what an open file holds, as if it came through a pipe under the name `name`. The file needs no name in a folder.
///
/// # Errors
/// See [`BuildError`]; nothing is left behind then.
pub fn build_open(
    name: &Path,
    source: File,
    output: &Path,
    config: &BuildConfig,
    progress: &dyn BuildProgress,
    cancel: &Cancel,
) -> Result<BuildReport, BuildError> {
    make(output, config, progress, cancel, |_| Ok(Supply::opened(name, source)))
}

/// Makes `output` from what `take` supplies; it is told a folder for what has to be copied.
fn make(
    output: &Path,
    config: &BuildConfig,
    progress: &dyn BuildProgress,
    cancel: &Cancel,
    take: impl FnOnce(&Path) -> Result<Supply, BuildError>,
) -> Result<BuildReport, BuildError> {
    sheets::check(&config.settings)?;
    // Lock, partial file and work belong to the file that is written, by whatever link it is named.
    let output = &chpm_extmem::target(output, config.overwrite)?;
    let _lock = Lock::acquire(output)?;
    let fail_points = config.resources.fail_points.clone();
    let out = OutputFiles::create(output, config.settings.volumes, config.overwrite, fail_points)?;
    let resources = &config.resources;
    let folder = resources.work_dir.as_deref().unwrap_or(beside(output));
    let source = &take(folder)?;
    let fingerprint = Fingerprint::of(source, config.settings.images(), cancel)?;
    fingerprint.refuse_output(output)?;
    // What came through a pipe does not come again, so that no other run could go on; nor would a memo know of what an earlier run has done.
    let keeps_memo = resources.memo || resources.update.is_some();
    let every = resources.checkpoint.filter(|_| !source.is_spooled() && !keeps_memo);
    let resources = &Resources { checkpoint: every, ..resources.clone() };
    let (mut checkpoints, dir) = match every {
        Some(_) => {
            Checkpoints::open(folder, &Key::of(output, &fingerprint, &config.settings)?, resources, progress)?
        }
        None => {
            (Checkpoints::default(), WorkDir::create(folder)?.with_fail_points(resources.fail_points.clone()))
        }
    };
    let mut context = context(dir, fingerprint.len, resources, progress, cancel)?;
    if keeps_memo {
        let earlier = resources.update.as_deref();
        context.memo =
            Some(Memo::open((output, config.overwrite), earlier, &resources.fail_points, &context.store)?);
    }
    let (context, dir) = (&context, &context.store.workdir);
    match run(source, &fingerprint, out, &config.settings, context, &mut checkpoints) {
        Ok(report) => {
            checkpoints.finish(dir);
            Ok(report)
        }
        Err(mut error) => {
            if let BuildError::Extmem(ExtmemError::Budget { asked, used, work: work @ 1.., enough, .. }) =
                &mut error
            {
                let arrays = (*used + *asked).saturating_sub(*work);
                *enough = allowance::enough(&config.resources, available(), fingerprint.len, *work, arrays);
            }
            Err(checkpoints.explain(error, dir))
        }
    }
}

/// The stages, one after the other. Those that an earlier run has done are passed over.
fn run(
    source: &Supply,
    fingerprint: &Fingerprint,
    out: OutputFiles,
    settings: &Settings,
    context: &Context<'_>,
    checkpoints: &mut Checkpoints,
) -> Result<BuildReport, BuildError> {
    let mut work = Work::resume(checkpoints, context)?;

    work.ingest(|| {
        let read = || ingest::run(source, settings, context);
        let source = context.stage(Stage::Ingest, fingerprint.len, read)?;
        fingerprint.check()?;
        Ok(source)
    })?;

    work.decompose(|source, known| {
        context.progress.counted(known.facts.triangles);
        context.stage(Stage::Decompose, decompose::PASSES * known.facts.triangles, || {
            let settings = known.facts.settled(settings);
            decompose::run(source, &settings, context, &mut known.repairs)
        })
    })?;

    work.arrange(|leaves| {
        context
            .stage(Stage::Hierarchy, leaves.leaves.len() as u64, || hierarchy::run(leaves, settings, context))
    })?;

    let tables = allowance::tables(work.node_count());
    let _tables = context.store.budget.reserve_work("tables of clusters", tables)?;
    work.simplify(|arranged, begun, keep| {
        let nodes = arranged.tree.nodes.len() as u64;
        context.stage(Stage::Simplify, nodes, || {
            let Arranged { leaves, tree, release } = &arranged;
            let inputs = simplify::Inputs { decomposition: leaves, tree, release, settings, context };
            let clusters = simplify::run(&inputs, begun, |levels| keep(&arranged, levels))?;
            trim::run(arranged.tree, clusters, context)
        })
    })?;

    let (known, painted, built) = work.finish();
    let nodes = built.clusters.refs.iter().flatten().count() as u64;
    let sheets = painted
        .map(|painted| context.stage(Stage::Sheets, nodes, || sheets::run(&built, &painted, context)))
        .transpose()?;
    let order = layout::order(&built, settings);
    let remnants = simplify::REMNANT_BYTES * built.clusters.remnant_count() as u64;
    let _remnants = context.store.budget.reserve_work("remnants", remnants)?;
    let file = emit::Output::begin(out, &order, &built, &known, sheets.as_ref(), settings)?;
    drop(sheets);
    let records = context.stage(Stage::Layout, order.len() as u64, || {
        let write = |place, page: &[u8]| file.write_page(place, page);
        let (records, memo) = rayon::join(
            || layout::run(&order, &built, settings, context, write),
            || context.memo.as_ref().map_or(Ok(()), Memo::finish),
        );
        memo.and(records)
    })?;

    let mut notes = std::mem::take(&mut checkpoints.notes);
    notes.extend(notes_of(&known.facts, settings));
    notes.extend(context.memo.iter().flat_map(Memo::notes));
    let written = context
        .stage(Stage::Emit, 1, || file.finish(records, context).inspect(|_| context.progress.advance(1)))?;
    Ok(BuildReport {
        source_vertices: known.facts.provenance.vertex_count,
        triangles: known.facts.triangles,
        source_len: known.facts.provenance.byte_len,
        output_len: written.len,
        clusters: written.clusters,
        roots: written.roots,
        stages: context.stage_reports(),
        levels: built.clusters.levels,
        repairs: known.repairs,
        warnings: known.facts.warnings,
        resumed: checkpoints.resumed,
        taken_over: context.memo.as_ref().and_then(Memo::taken_over),
        lattice_step: known.facts.lattice_step,
        notes,
        budget_peak: context.store.budget.peak(),
        peak_resident: process::peak_resident(),
    })
}

fn available() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Storage and threads for a source of so many bytes.
pub(crate) fn context<'a>(
    dir: WorkDir,
    source_len: u64,
    resources: &Resources,
    progress: &'a dyn BuildProgress,
    cancel: &Cancel,
) -> Result<Context<'a>, BuildError> {
    process::return_large_blocks();
    let (threads, budget) = allowance::divide(resources, available(), source_len);
    let store = Store { budget, workdir: Arc::new(dir) };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| BuildError::Threads { threads, reason: e.to_string() })?;
    let clock = Clock::new(resources.checkpoint);
    let mut context = Context::with_clock(store, pool, progress, cancel.clone(), clock);
    (context.ids, context.trace) = (resources.ids, resources.trace.clone());
    Ok(context)
}

/// Sentences about what was chosen for the source.
pub(crate) fn notes_of(facts: &emit::Facts, settings: &Settings) -> Vec<String> {
    let images = facts.images.map(|images| match images {
        0 => "colours of vertices are those of materials".to_owned(),
        images => format!("colours of vertices are averages of the texels of {}", Counted(images, "image")),
    });
    let step = (settings.positions == Positions::Auto).then(|| match facts.lattice_step {
        Some(step) => {
            format!("coordinates are multiples of {step}, a step by how fine the model's detail is")
        }
        None => "coordinates are exact: no lattice of 24 bits is as fine as the model's detail".to_owned(),
    });
    images.into_iter().chain(step).collect()
}
