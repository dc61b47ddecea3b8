//! Results for programs: a type for each document that `--json` prints. `JSON.md` is made of these types and their comments.
//!
//! Within a version of a schema keys are never renamed, removed or given another meaning or unit; new ones may come.

pub(crate) mod file;
pub(crate) mod judged;
pub(crate) mod made;
pub(crate) mod near;
#[cfg(test)]
mod page;
pub(crate) mod seen;

use anyhow::{Context, Result, ensure};
use chpm_mesh::Bytes;
use serde::Serialize;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

/// Length of a document that is read, at most: what is named may be another file, or have no end.
const MOST: Bytes = Bytes(256 << 20);

/// Reads a document.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    let (mut text, told) = (Vec::new(), || format!("cannot read '{}'", path.display()));
    File::open(path).and_then(|file| file.take(MOST.0 + 1).read_to_end(&mut text)).with_context(told)?;
    ensure!(text.len() as u64 <= MOST.0, "{}: it is longer than {MOST}: is it another file?", told());
    Ok(text)
}

/// Prints a document, its keys in alphabetical order.
pub(crate) fn print(document: &impl Serialize, out: &mut (impl Write + ?Sized)) -> Result<()> {
    Ok(writeln!(out, "{:#}", serde_json::to_value(document)?)?)
}

/// A path as it was named.
pub(crate) fn named(path: &Path) -> String {
    path.display().to_string()
}
