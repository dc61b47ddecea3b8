//! `chpm dump`: a file as text, for eyes and for `diff`.

use super::{Verdict, open, reading, stdout};
use crate::memory::{self, MemoryArgs};
use crate::number;
use anyhow::{Error, Result, bail};
use chpm_format::FormatError;
use chpm_mesh::ClusterId;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `chpm dump`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The clusters' vertices, triangles and collapses as well
    #[arg(long)]
    pages: bool,
    /// Only cluster ID, with its contents; may be given several times
    #[arg(long, value_name = "ID", value_parser = number::count(0..=u32::MAX))]
    cluster: Vec<u32>,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Writes the text to stdout.
pub(crate) fn run(args: &Args) -> Result<Verdict> {
    let file = open(&args.file)?;
    memory::divide(&file, args.memory.memory(), 0)?;
    reading(&file, || {
        let mut out = stdout();
        let count = file.header().cluster_count;
        if let Some(id) = args.cluster.iter().find(|id| **id >= count) {
            bail!("'{}' has no cluster {id}: the last is {}", args.file.display(), count - 1);
        }
        let told = match &args.cluster[..] {
            [] => chpm_format::dump(&file, &mut out, args.pages),
            ids => ids.iter().try_for_each(|id| chpm_format::dump::cluster(&file, ClusterId(*id), &mut out)),
        };
        // What is told of a damaged page comes before the error.
        out.flush()?;
        told.map_err(plain)?;
        Ok(Verdict::Good)
    })
}

/// Error of the output, which is not about the file.
fn plain(error: FormatError) -> Error {
    match error {
        FormatError::Write(source) => source.into(),
        error => error.into(),
    }
}
