//! `chpm share`: a model, and the page that shows it, as a folder for any host of static files.

use super::relayout::{self, Pages};
use super::{Verdict, open, stdout};
use crate::memory::MemoryArgs;
use crate::stop::Stop;
use crate::web::{FILES, PAGE};
use anyhow::{Context, Result, bail, ensure};
use chpm_mesh::Bytes;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// What `chpm share` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The folder to write; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// How the model's pages are stored; as they are if not given
    #[arg(long, value_name = "HOW", value_enum)]
    pages: Option<Pages>,
    /// Replace files that the folder has
    #[arg(short, long)]
    force: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// The name that the model has in the folder.
const MODEL: &str = "model.chpm";
/// The page's name there, which hosts show for the folder.
const INDEX: &str = "index.html";

/// Writes the folder, the model last: as long as it is not there, the page says so.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    open(&args.file)?;
    let page =
        FILES.iter().find(|file| file.path == PAGE).context("the program was compiled without its page")?;
    let index = page.text.replace("<body>", &format!("<body data-file=\"{MODEL}\">"));
    let others = FILES.iter().filter(|file| file.path != PAGE).map(|file| (file.path, file.text));
    let files: Vec<(&str, &str)> = [(INDEX, &index[..])].into_iter().chain(others).collect();

    let taken =
        files.iter().map(|(name, _)| *name).chain([MODEL]).find(|name| args.output.join(name).exists());
    if let Some(name) = taken.filter(|_| !args.force) {
        bail!("'{}' exists; --force replaces it", args.output.join(name).display());
    }
    ensure!(!args.output.is_file(), "the output '{}' is a file; name a folder", args.output.display());
    for (name, text) in files {
        write(&args.output.join(name), text)?;
    }
    let model = args.output.join(MODEL);
    let memory = args.memory.clone();
    let bytes = relayout::store_pages(&args.file, &model, args.pages, args.force, args.quiet, memory, stop)?;

    let mut out = stdout();
    writeln!(
        out,
        "{}: a model of {}; put this folder on any host of static files that answers range requests",
        args.output.display(),
        Bytes(bytes)
    )?;
    writeln!(out, "to try it here: chpm serve '{}'", model.display())?;
    out.flush()?;
    Ok(Verdict::Good)
}

fn write(path: &Path, text: &str) -> Result<()> {
    let failed = || format!("cannot write '{}'", path.display());
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(failed)?;
    }
    fs::write(path, text).with_context(failed)
}
