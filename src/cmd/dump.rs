//! `chpm dump`: a file as text, for eyes and for `diff`.

use super::{Verdict, open, reading, stdout};
use crate::memory::{self, MemoryArgs};
use anyhow::Result;
use std::io::Write;
use std::path::PathBuf;

/// What `chpm dump` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The clusters' vertices, triangles and collapses as well
    #[arg(long)]
    pages: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Writes the text to stdout.
pub(crate) fn run(args: &Args) -> Result<Verdict> {
    let file = open(&args.file)?;
    memory::divide(&file, args.memory.memory(), 0)?;
    reading(&file, || {
        let mut out = stdout();
        chpm_format::dump(&file, &mut out, args.pages)?;
        out.flush()?;
        Ok(Verdict::Good)
    })
}
