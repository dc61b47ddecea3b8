//! `chpm completions` and `chpm man`: the command line for shells and for `man`.

use super::{Verdict, stdout};
use crate::examples;
use anyhow::{Context, Result};
use chpm_extmem::AtomicFile;
use chpm_mesh::Counted;
use clap_complete::Shell;
use clap_mangen::Man;
use std::fs;
use std::io::Write;
use std::path::PathBuf;

/// What `chpm completions` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// What `chpm man` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct ManArgs {
    /// The folder of the pages; made if it is not there
    folder: PathBuf,
    /// Replace pages that exist
    #[arg(short, long)]
    force: bool,
}

/// Writes the script to stdout.
pub(crate) fn run(args: &Args) -> Result<Verdict> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut examples::command(), "chpm", &mut script);
    let mut out = stdout();
    out.write_all(&script)?;
    out.flush()?;
    Ok(Verdict::Good)
}

/// Writes a page for the command and one for each verb.
pub(crate) fn man(args: &ManArgs) -> Result<Verdict> {
    let told = || format!("cannot make the folder '{}'", args.folder.display());
    fs::create_dir_all(&args.folder).with_context(told)?;
    let mut command = examples::command();
    command.build();
    let verbs = command.get_subcommands().filter(|verb| !verb.is_hide_set() && verb.get_name() != "help");
    let pages: Vec<Man> = std::iter::once(&command).chain(verbs).map(|verb| Man::new(verb.clone())).collect();
    for page in &pages {
        let mut file = AtomicFile::create(&args.folder.join(page.get_filename()), args.force)?;
        page.render(&mut file)?;
        file.publish()?;
    }
    let mut out = stdout();
    writeln!(out, "{}: {}", args.folder.display(), Counted(pages.len() as u64, "page"))?;
    out.flush()?;
    Ok(Verdict::Good)
}
