//! `chpm share`: a model, and the page that shows it, as a folder for any host of static files.

use super::relayout::{self, Pages};
use super::{Verdict, open, stdout};
use crate::memory::MemoryArgs;
use crate::stop::Stop;
use crate::web::{FILES, PAGE};
use anyhow::{Context, Result, bail, ensure};
use chpm_extmem::AtomicFile;
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

/// Writes the folder. The page gets its names when the model has its own, so that what cannot be shared leaves nothing.
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
    let mut made = Made::default();
    let written = |(name, text): (&str, &str)| {
        let path = args.output.join(name);
        made.folder(path.parent().unwrap_or(&args.output))?;
        let mut file = AtomicFile::create(&path, args.force)?;
        file.write_all(text.as_bytes()).map_err(|source| file.error(source))?;
        file.flush().map_err(|source| file.error(source))?;
        Ok(file)
    };
    let pages: Vec<AtomicFile> = files.into_iter().map(written).collect::<Result<_>>()?;
    let model = args.output.join(MODEL);
    let memory = args.memory.clone();
    let bytes = relayout::store_pages(&args.file, &model, args.pages, args.force, args.quiet, memory, stop)?;
    pages.into_iter().try_for_each(AtomicFile::publish)?;

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

/// Folders that were made. Those that are empty in the end go again.
#[derive(Default)]
struct Made(Vec<PathBuf>);

impl Made {
    fn folder(&mut self, path: &Path) -> Result<()> {
        let new = path.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let new: Vec<&Path> = new.collect();
        for path in new.into_iter().rev() {
            fs::create_dir(path).with_context(|| format!("cannot make the folder '{}'", path.display()))?;
            self.0.push(path.to_owned());
        }
        Ok(())
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        for path in self.0.iter().rev() {
            let _ = fs::remove_dir(path);
        }
    }
}
