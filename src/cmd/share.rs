//! `chpm share`: a model, and the page that shows it, as a folder for any host of static files.

use super::relayout;
use super::{Verdict, open, stdout, word};
use crate::args::Pages;
use crate::folder::{OutputFolder, above};
use crate::json::{self, made, named};
use crate::memory::MemoryArgs;
use crate::output;
use crate::stop::Stop;
use crate::web::{FILES, PAGE, page_for};
use anyhow::Result;
use chpm_mesh::Bytes;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `chpm share`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The folder to write; one that is there has to be empty
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// How the model's pages are stored; as they are if not given
    #[arg(long, value_name = "HOW", value_enum)]
    pages: Option<Pages>,
    /// Replace the folder if it is an earlier one
    #[arg(short, long)]
    force: bool,
    /// What was written as JSON on stdout
    #[arg(long)]
    json: bool,
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
/// Names in the folder.
const NAMES: [&str; 4] = [MODEL, INDEX, "view", "chpm"];

/// Writes the folder, which is whole or not there.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    output::check_folder("share", &args.output)?;
    let file = open(&args.file)?;
    let index = page_for(&file, Some(MODEL))?;
    let folder = OutputFolder::create(&args.output, args.force, &NAMES, None)?;
    let (model, memory) = (folder.path(MODEL), args.memory.clone());
    let bytes = relayout::store_pages(&args.file, &model, args.pages, args.quiet, memory, stop)?;
    for file in FILES {
        if file.path == PAGE {
            folder.write(INDEX, index.as_bytes())?;
            continue;
        }
        folder.folder(above(file.path))?;
        folder.write(file.path, file.text.as_bytes())?;
    }
    folder.publish()?;
    output::finish(&args.output);

    let mut out = stdout();
    if args.json {
        let shared = made::Share {
            schema: "chpm-share/1",
            file: named(&args.file),
            output: named(&args.output),
            model: named(&args.output.join(MODEL)),
            model_bytes: bytes,
        };
        json::print(&shared, &mut out)?;
        out.flush()?;
        return Ok(Verdict::Good);
    }
    writeln!(
        out,
        "{}: a model of {}; put this folder on any host of static files that answers range requests",
        args.output.display(),
        Bytes(bytes)
    )?;
    writeln!(out, "to try it here: chpm serve {}", word(&args.output.join(MODEL)))?;
    out.flush()?;
    Ok(Verdict::Good)
}
