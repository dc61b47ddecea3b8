//! `chpm report`: a file as one page of HTML.

use super::{Verdict, open, reading};
use crate::json::{self, made, named};
use crate::memory::{self, MemoryArgs};
use crate::output;
use crate::progress::line;
use crate::stop::{self, Stop};
use anyhow::{Context, Result, ensure};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_report::page::{self, Shown};
use chpm_report::stats;
use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm report`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The page; - is standard output
    #[arg(short, long, value_name = "HTML")]
    output: PathBuf,
    /// Another .chpm file, whose numbers and curves stand beside
    #[arg(long, value_name = "FILE")]
    compare: Option<PathBuf>,
    /// What `chpm build --json` printed: time and memory of the stages are shown, too
    #[arg(long, value_name = "JSON")]
    built: Option<PathBuf>,
    /// Replace the page if it exists
    #[arg(short, long)]
    force: bool,
    /// What was written as JSON on stdout
    #[arg(long)]
    json: bool,
    /// Say nothing
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Writes the page.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    let other = args.compare.as_deref().map(open).transpose()?;
    let memory = args.memory.memory();
    match &other {
        Some(other) => {
            memory::divide_among([(&file, memory_of(&file)), (other, memory_of(other))], memory)?;
        }
        None => {
            memory::divide(&file, memory, memory_of(&file))?;
        }
    }

    let cancel = stop.heed();
    let mut inputs = vec![args.file.as_path()];
    inputs.extend(args.compare.as_deref().into_iter().chain(args.built.as_deref()));
    let mut html = output::REPORT.create(&args.output, args.force, &inputs)?;
    let mut out = output::messages([&html], args.json, args.quiet)?;
    let built = args.built.as_deref().map(|path| built(path, &file, args)).transpose()?;
    let other = match (&args.compare, &other) {
        (Some(path), Some(file)) => Some(reading(file, || Ok(Shown::new(name(path), file, &cancel)?))?),
        _ => None,
    };
    let text = reading(&file, || {
        let shown = Shown::new(name(&args.file), &file, &cancel)?;
        Ok(page::html(&shown, other.as_ref(), built.as_ref())?)
    })?;
    stop::check(&cancel)?;
    html.write_all(text.as_bytes())?;
    html.publish()?;

    if args.json {
        let report = made::Report {
            schema: "chpm-report/1",
            file: named(&args.file),
            compared_with: args.compare.as_deref().map(named),
            output: named(&args.output),
            bytes: text.len(),
        };
        json::print(&report, &mut out)?;
    } else if !args.quiet {
        writeln!(out, "{}: open it in a browser", args.output.display())?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

/// Rows and shared vertices as for `stats`, and the map of the clusters.
fn memory_of(file: &Chpm<MappedFile>) -> u64 {
    let [shared, cluster] = stats::MEMORY;
    let h = file.header();
    let image = if h.has_sheets() { 12 << 20 } else { 0 };
    shared * u64::from(h.shared_vertex_count) + 2 * cluster * u64::from(h.cluster_count) + (32 << 20) + image
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// The document of the build of `file`.
fn built(path: &Path, file: &Chpm<MappedFile>, args: &Args) -> Result<Value> {
    let text = json::read(path)?;
    let told = || format!("'{}' is no document of `chpm build --json`", path.display());
    let value: Value = serde_json::from_slice(&text).with_context(told)?;
    ensure!(value["schema"] == "chpm-build/1", told());
    let (header, source) = (file.header(), file.metadata()?.source);
    for (what, told, own) in [
        ("bytes of the source", &value["source"]["bytes"], source.byte_len),
        ("vertices of the source", &value["source"]["vertices"], source.vertex_count),
        ("clusters", &value["clusters"], header.cluster_count.into()),
        ("roots", &value["roots"], header.root_count.into()),
    ] {
        let (json, model) = (path.display(), args.file.display());
        ensure!(
            told.as_u64() == Some(own),
            "'{json}' is of another build than '{model}': {what}: {told} there, {own} here; give what `chpm build --json` printed for this file"
        );
    }
    // A file may have been renamed, or have a sibling that differs only in what is not told.
    let output = value["output"].as_str().map(Path::new).unwrap_or(Path::new(""));
    if !args.quiet && output.file_name() != args.file.file_name() {
        let (json, model, output) = (path.display(), args.file.display(), output.display());
        line(&format!("warning: '{json}' tells of the build of '{output}'; is '{model}' the same?"));
    }
    Ok(value)
}
