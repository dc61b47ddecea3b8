//! The build on one page.

use crate::config::BuildConfig;
use crate::context::Context;
use crate::error::BuildError;
use crate::progress::{Cancel, Progress, Stage};
use crate::report::BuildReport;
use crate::{allowance, decompose, emit, hierarchy, ingest, layout, simplify, trim};
use chpm_extmem::{AtomicFile, Lock, Store, process};
use std::path::Path;

/// Builds `output` from `source`, a mesh file of any format that [`Input`](crate::input::Input) reads.
///
/// The output appears complete or not at all. The same source and settings give the same bytes, whatever the resources.
///
/// # Errors
/// See [`BuildError`]; nothing is left behind then.
pub fn build(
    source: &Path,
    output: &Path,
    config: &BuildConfig,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<BuildReport, BuildError> {
    let settings = &config.settings;
    let _lock = Lock::acquire(output)?;
    let out = AtomicFile::create(output, config.overwrite)?;
    let context = &context(source, output, config, progress, cancel)?;

    let source =
        context.stage(Stage::Ingest, ingest::work(source), || ingest::run(source, settings, context))?;
    let mut repairs = ingest::repairs(&source.tally);
    let facts = emit::Facts::of(&source);

    let triangles = source.triangles.len() as u64;
    let leaves = context
        .stage(Stage::Decompose, triangles, || decompose::run(source, settings, context, &mut repairs))?;

    let leaf_count = leaves.leaves.len() as u64;
    let (mut tree, release) =
        context.stage(Stage::Hierarchy, leaf_count, || hierarchy::run(&leaves, settings, context))?;

    let nodes = tree.nodes.len() as u64;
    let _tables = context.store.budget.charge("tables of clusters", allowance::tables(tree.nodes.len()))?;
    let clusters = context.stage(Stage::Simplify, nodes, || {
        let mut built = simplify::run(&leaves, &tree, &release, settings, context)?;
        trim::run(&mut built, &mut tree, context)?;
        Ok(built)
    })?;
    let facts = facts.with_leaves(&leaves);
    drop(leaves);

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
        triangles,
        source_len: facts.provenance.byte_len,
        output_len: written.len,
        clusters: written.clusters,
        roots: written.roots,
        stages: context.stage_reports(),
        levels: clusters.levels,
        repairs,
        warnings: facts.warnings,
        budget_peak: context.store.budget.peak(),
        peak_resident: process::peak_resident(),
    })
}

fn context<'a>(
    source: &Path,
    output: &Path,
    config: &BuildConfig,
    progress: &'a dyn Progress,
    cancel: &Cancel,
) -> Result<Context<'a>, BuildError> {
    process::return_large_blocks();
    let resources = &config.resources;
    let beside = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let work_dir = resources.work_dir.as_deref().unwrap_or(beside);
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let (threads, budget) = allowance::divide(resources, available, ingest::work(source));
    let store = Store::with_budget(work_dir, budget)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| BuildError::Threads { threads, reason: e.to_string() })?;
    Ok(Context::new(store, pool, progress, cancel.clone()))
}
