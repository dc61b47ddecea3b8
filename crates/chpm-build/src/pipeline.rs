//! The build on one page.

use crate::checkpoint::{Checkpoints, Key, beside};
use crate::config::{BuildConfig, Resources, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::ingest::Supply;
use crate::point::{Known, Point, Work};
use crate::progress::{Cancel, Progress, Stage};
use crate::report::BuildReport;
use crate::stamp::Stamp;
use crate::{allowance, decompose, emit, hierarchy, ingest, layout, simplify, trim};
use chpm_extmem::{AtomicFile, ExtmemError, Lock, Store, WorkDir, process};
use std::path::Path;
use std::sync::Arc;

/// Builds `output` from `source`, a mesh file of any format that [`Input`](crate::input::Input) reads, or a pipe that one comes
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
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<BuildReport, BuildError> {
    // Lock, partial file and work belong to the file that is written, by whatever link it is named.
    let output = &chpm_extmem::target(output, config.overwrite)?;
    let _lock = Lock::acquire(output)?;
    AtomicFile::sweep(output);
    let out = AtomicFile::create_with(output, config.overwrite, config.resources.faults.clone())?;
    let resources = &config.resources;
    let folder = resources.work_dir.as_deref().unwrap_or(beside(output));
    let source = &Supply::take(source, folder, &resources.faults, cancel)?;
    let stamp = Stamp::of(source, cancel)?;
    stamp.refuse_output(output)?;
    // What came through a pipe does not come again, so that no other run could go on.
    let every = resources.checkpoint.filter(|_| !source.is_spooled());
    let resources = &Resources { checkpoint: every, ..resources.clone() };
    let context = &context(output, &stamp, &config.settings, resources, progress, cancel)?;
    let dir = &context.store.workdir;
    let built = run(source, &stamp, out, config, context);
    match built {
        Ok(report) => {
            context.checkpoints.finish(dir);
            Ok(report)
        }
        Err(mut error) => {
            if let BuildError::Extmem(ExtmemError::Budget { work: work @ 1.., enough, .. }) = &mut error {
                *enough = allowance::enough(&config.resources, available(), stamp.len, *work);
            }
            Err(context.checkpoints.explain(error, dir))
        }
    }
}

/// The stages, each with what the one before has left.
fn run(
    source: &Supply,
    stamp: &Stamp,
    out: AtomicFile,
    config: &BuildConfig,
    context: &Context<'_>,
) -> Result<BuildReport, BuildError> {
    let (settings, store, checkpoints) = (&config.settings, &context.store, &context.checkpoints);
    let (mut known, mut work) = checkpoints.resume(context)?;
    let charge = |tree: &hierarchy::Tree| {
        store.budget.charge("tables of clusters", allowance::tables(tree.nodes.len()))
    };
    let mut tables = None;
    let (tree, clusters) = loop {
        work = match work {
            Work::Begin => {
                let read = || ingest::run(source, settings, context);
                let source = context.stage(Stage::Ingest, stamp.len, read)?;
                stamp.check()?;
                known = Known { facts: emit::Facts::of(&source), repairs: ingest::repairs(&source) };
                Work::Ingested(Box::new(source))
            }
            Work::Ingested(source) => {
                let cut = || decompose::run(*source, settings, context, &mut known.repairs);
                let leaves = context.stage(Stage::Decompose, known.facts.triangles, cut)?;
                known.facts.add_leaves(&leaves);
                Work::Decomposed(leaves)
            }
            Work::Decomposed(leaves) => {
                let arrange = || hierarchy::run(&leaves, settings, context);
                let (tree, release) = context.stage(Stage::Hierarchy, leaves.leaves.len() as u64, arrange)?;
                Work::Arranged(leaves, tree, release, None)
            }
            Work::Arranged(leaves, mut tree, release, levels) => {
                let nodes = tree.nodes.len() as u64;
                tables = Some(charge(&tree)?);
                let clusters = context.stage(Stage::Simplify, nodes, || {
                    let inputs = simplify::Inputs {
                        decomposition: &leaves,
                        tree: &tree,
                        release: &release,
                        settings,
                        context,
                    };
                    let mut built = simplify::run(&inputs, levels, |levels| {
                        checkpoints.save(&store.workdir, || {
                            let levels = Some(levels.save()?);
                            Point::of_levels(&known, &leaves, &tree, &release, levels).map(Some)
                        })
                    })?;
                    trim::run(&mut built, &mut tree, context)?;
                    Ok(built)
                })?;
                Work::Simplified(tree, clusters)
            }
            Work::Simplified(tree, clusters) => break (tree, clusters),
        };
        checkpoints.offer(&known, &work, store)?;
    };

    let _tables = tables.map_or_else(|| charge(&tree), Ok)?;
    let Known { facts, repairs } = known;
    let order = layout::order(&clusters, &tree, settings);
    let file = emit::Output::begin(out, &order, &tree, &clusters, &facts, &repairs, settings)?;
    let write = |place, page: &[u8]| file.write_page(place, page);
    let records = context.stage(Stage::Layout, order.len() as u64, || {
        layout::run(&order, &clusters, &tree, settings, context, write)
    })?;

    let written =
        context.stage(Stage::Emit, 1, || file.finish(records).inspect(|_| context.progress.advance(1)))?;
    Ok(BuildReport {
        source_vertices: facts.provenance.vertex_count,
        triangles: facts.triangles,
        source_len: facts.provenance.byte_len,
        output_len: written.len,
        clusters: written.clusters,
        roots: written.roots,
        stages: context.stage_reports(),
        levels: clusters.levels,
        repairs,
        warnings: facts.warnings,
        resumed: checkpoints.resumed(),
        notes: checkpoints.notes(),
        budget_peak: context.store.budget.peak(),
        peak_resident: process::peak_resident(),
    })
}

fn available() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

fn context<'a>(
    output: &Path,
    stamp: &Stamp,
    settings: &Settings,
    resources: &Resources,
    progress: &'a dyn Progress,
    cancel: &Cancel,
) -> Result<Context<'a>, BuildError> {
    process::return_large_blocks();
    let work_dir = resources.work_dir.as_deref().unwrap_or(beside(output));
    let (threads, budget) = allowance::divide(resources, available(), stamp.len);
    let (checkpoints, dir) = match resources.checkpoint {
        Some(_) => {
            let key = Key::of(output, stamp, settings)?;
            Checkpoints::open(work_dir, &key, resources, progress)?
        }
        None => {
            let dir = WorkDir::create(work_dir)?.with_faults(resources.faults.clone());
            (Checkpoints::off(), dir)
        }
    };
    let store = Store { budget, workdir: Arc::new(dir) };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| BuildError::Threads { threads, reason: e.to_string() })?;
    Ok(Context::with_checkpoints(store, pool, progress, cancel.clone(), checkpoints))
}
