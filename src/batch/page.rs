//! The page of a batch.

use super::summary::{self, Status, Summary};
use crate::cmd;
use crate::number::Short;
use anyhow::Result;
use chpm_export::uri;
use chpm_mesh::Bytes;
use chpm_report::page::{self, Card};
use std::path::{MAIN_SEPARATOR, Path};

/// By which a page of a batch is known.
const MARK: &str = "<meta name=\"generator\" content=\"chpm batch\">";

/// The page of a batch, failures first; a model of which there is no picture has none.
pub(crate) fn index(summary: &Summary, folder: &Path) -> Result<String> {
    let mut cards: Vec<Card<'_>> = Vec::new();
    for row in &summary.models {
        let is_there = matches!(row.status, Status::Built | Status::Current);
        let seconds = if row.seconds > 0.0 { format!(", {:.1} s", row.seconds) } else { String::new() };
        cards.push(Card {
            name: &row.name,
            status: row.status.word(),
            error: row.error.as_deref(),
            warnings: &row.warnings,
            picture: is_there.then(|| picture(&row.output).ok()).flatten(),
            facts: format!("{}, {}{seconds}", Short(row.triangles).of("triangle"), Bytes(row.output_bytes)),
            link: address(row.output.strip_prefix(folder).unwrap_or(&row.output)),
        });
    }
    let page = page::index(&summary.line(), cards)?;
    Ok(page.replacen("<head>\n", &format!("<head>\n{MARK}\n"), 1))
}

/// An error if a page is there that no batch wrote.
pub(crate) fn check(path: &Path) -> Result<()> {
    summary::replaces(path, |text| text.windows(MARK.len()).any(|part| part == MARK.as_bytes()))
}

/// A relative path as a browser takes it, whatever its names are made of.
fn address(path: &Path) -> String {
    let path = path.display().to_string();
    path.split(MAIN_SEPARATOR).map(uri).collect::<Vec<_>>().join("/")
}

fn picture(path: &Path) -> Result<String> {
    Ok(page::thumbnail(&cmd::open(path)?)?)
}
