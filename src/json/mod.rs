//! Results for programs: a type for each document that `--json` prints. `JSON.md` is made of these types and their comments.
//!
//! Within a version of a schema keys are never renamed, removed or given another meaning or unit; new ones may come.

pub(crate) mod file;
pub(crate) mod judged;
pub(crate) mod made;
pub(crate) mod near;
// The page has the documents of every feature.
#[cfg(all(test, feature = "viewer", feature = "web"))]
mod page;
pub(crate) mod seen;

use anyhow::{Context, Result};
use chpm_extmem::read_limited;
use chpm_mesh::Bytes;
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// Length of a document that is read, at most: what is named may be another file, or have no end.
const MOST: Bytes = Bytes(256 << 20);

/// Reads a document.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    read_limited(path, MOST.0).with_context(|| format!("cannot read '{}'", path.display()))
}

/// Prints a document, its keys in alphabetical order.
pub(crate) fn print(document: &impl Serialize, out: &mut (impl Write + ?Sized)) -> Result<()> {
    Ok(writeln!(out, "{:#}", serde_json::to_value(document)?)?)
}

/// A path as it was named.
pub(crate) fn named(path: &Path) -> String {
    path.display().to_string()
}
