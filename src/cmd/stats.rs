//! `chpm stats`: how good a file is, and where it is not.

use super::{Verdict, open, reading};
use crate::claim::Claim;
use crate::json;
use crate::memory::{self, MemoryArgs};
use crate::output;
use crate::progress::line;
use crate::stats_tables;
use crate::stop::Stop;
use anyhow::{Context, Result, anyhow};
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::Chpm;
use chpm_report::ReportError;
use chpm_report::stats::{self, Stats};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm stats`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// Assert a measure of the whole file, as in 'acmr24<0.8'; may be given several times. Exit code 1 if one does not hold. The measures are
    /// those of --json
    #[arg(long, value_name = "CLAIM")]
    assert: Vec<Claim>,
    /// Also write a row for each cluster; - for standard output
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Replace the CSV if it exists
    #[arg(short, long)]
    force: bool,
    /// What `chpm measure FILE --against SOURCE --json` printed: how tight the stored errors are
    #[arg(long, value_name = "JSON")]
    measured: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
    /// Nothing but the assertions that do not hold
    #[arg(short, long, conflicts_with = "json")]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Reads every page, and tells.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    let h = file.header();
    let [shared, cluster] = stats::MEMORY;
    let own = shared * u64::from(h.shared_vertex_count) + cluster * u64::from(h.cluster_count);
    memory::divide(&file, args.memory.memory(), own)?;
    reading(&file, || tell(&file, args, &stop.heed()))
}

fn tell(file: &Chpm<MappedFile>, args: &Args, cancel: &Cancel) -> Result<Verdict> {
    let mut inputs = vec![args.file.as_path()];
    inputs.extend(args.measured.as_deref());
    let csv =
        args.csv.as_ref().map(|path| output::STATS_CSV.create(path, args.force, &inputs)).transpose()?;
    let mut out = output::messages(&csv, args.json, args.quiet)?;
    let (rows, borders) = stats::rows(file, cancel)?;
    let mut stats = Stats::new(args.file.display().to_string(), file, &rows, &borders);
    args.measured.as_ref().map_or(Ok(()), |measured| add_measured(&mut stats, measured))?;
    // An assertion that means nothing is an error before anything is written.
    let checked = args.assert.iter().map(|claim| claim.check(&stats.measures));
    let failed = checked.collect::<Result<Vec<_>, String>>().map_err(|error| anyhow!("--assert: {error}"))?;
    if let Some(mut csv) = csv {
        stats_tables::csv(&rows, &mut csv)?;
        csv.publish()?;
    }
    if args.json {
        writeln!(out, "{}", serde_json::to_string_pretty(&stats)?)?;
    } else if !args.quiet {
        stats_tables::print(&stats, &mut out)?;
    }
    out.flush()?;
    let mut verdict = Verdict::Good;
    for failed in failed.into_iter().flatten() {
        line(&failed);
        verdict = Verdict::Faulty;
    }
    Ok(verdict)
}

/// Takes what `chpm measure` has printed into a file.
fn add_measured(stats: &mut Stats, path: &Path) -> Result<()> {
    let name = path.display();
    let text = json::read(path)?;
    let document =
        serde_json::from_slice(&text).with_context(|| format!("'{name}' is {}", ReportError::Measured))?;
    stats.add_measured(&document).map_err(|error| anyhow!("'{name}' is {error}"))
}
