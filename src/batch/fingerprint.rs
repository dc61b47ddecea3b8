//! Whether an output is what a build would make: the file itself says from what, and with which settings, it was built.

use super::summary::Row;
use crate::cmd;
use anyhow::Result;
use chpm_build::{Cancel, Settings};
use chpm_extmem::platform::modified;
use chpm_format::{LATTICE_STEP, Metadata, Source, Tables, VolumeRecord};
use chpm_import::{Images, input};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// The program and version that the files of this one name.
const GENERATOR: &str = concat!("chpm ", env!("CARGO_PKG_VERSION"));

/// Why a model is built whose source is not as it was.
pub(crate) const CHANGED: &str = "source changed";

/// Work that a model needs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Need {
    /// Nothing: the output is what a build would make.
    Nothing,
    /// A build, for this reason.
    Build(&'static str),
}

/// Looks at the `output` of a model. Where the source's files have the sizes and times that the `earlier` run noted, they are taken for
/// unchanged; else they are read and their hash decides.
pub(crate) fn need(
    source: &Path,
    output: &Path,
    settings: &Settings,
    earlier: Option<&Row>,
    cancel: &Cancel,
) -> Need {
    if output.symlink_metadata().is_err() {
        return Need::Build("new");
    }
    // What is no file would be waited for; the build refuses it.
    if chpm_extmem::target(output, true).is_err() {
        return Need::Build("output is no file");
    }
    let Ok(Built { metadata, volumes }) = built(output, settings) else {
        return Need::Build("output unreadable");
    };
    let Metadata { generator, settings: built_with, source: Source { byte_len: len, hash, .. }, .. } =
        metadata;
    if generator != GENERATOR {
        return Need::Build("other version");
    }
    if !is_of(&built_with, settings) || !volumes {
        return Need::Build("other settings");
    }
    // A source that cannot be read is a build's error to tell.
    let Ok(files) = input::files(source, settings.images(), cancel) else {
        return Need::Build("source unreadable");
    };
    let fingerprint = fingerprint(&files);
    if earlier.is_some_and(|row| {
        row.hash == hash_text(hash) && !fingerprint.is_empty() && row.fingerprint == fingerprint
    }) {
        return Need::Nothing;
    }
    match input::fingerprint(&files, cancel) {
        Ok(found) if found == (len, hash) => Need::Nothing,
        Ok(_) => Need::Build(CHANGED),
        Err(_) => Need::Build("source unreadable"),
    }
}

/// Whether what is there as the output of a model may be replaced: an `earlier` run made it, or it tells that it is of a source of this name.
pub(crate) fn is_ours(source: &Path, output: &Path, earlier: Option<&Row>) -> bool {
    let name = source.file_name().map(|name| name.to_string_lossy());
    let is_of_source = || {
        let metadata = cmd::open(output).and_then(|file| Ok(file.metadata()?));
        metadata.is_ok_and(|metadata| name.is_some_and(|name| metadata.source.name == name))
    };
    // What is no file the build refuses.
    !output.is_file()
        || earlier.is_some_and(|row| row.output == output && !row.hash.is_empty())
        || is_of_source()
}

/// Whether a file has these settings. That its colours are those of images is up to its source, where they are read.
fn is_of(built: &[(String, String)], settings: &Settings) -> bool {
    let reads_images = settings.images() != Images::Ignored;
    let is_textured = |entry: &(String, String)| [&entry.0, &entry.1] == settings.of_images();
    let is_found = |entry: &(String, String)| [LATTICE_STEP, Settings::LEAF_TRIANGLES].contains(&&*entry.0);
    let asked = built.iter().filter(|entry| !(is_found(entry) || reads_images && is_textured(entry)));
    let is_dense = built.iter().any(|(name, _)| name == Settings::LEAF_TRIANGLES);
    asked.eq(&settings.describe()) && (settings.fewer_for_texels || !is_dense)
}

/// Facts that a file that is there tells of itself.
struct Built {
    metadata: Metadata,
    /// Whether its pages are in the files that are asked for.
    volumes: bool,
}

fn built(output: &Path, settings: &Settings) -> Result<Built> {
    let file = cmd::open(output)?;
    let mut tables = Tables::of(&file)?;
    tables.header.volume_size = settings.volumes.size();
    let volumes = tables.volumes().is_ok_and(|volumes| {
        let lens = |volumes: &[VolumeRecord]| volumes.iter().map(|volume| volume.len).collect::<Vec<_>>();
        lens(&volumes) == lens(file.volume_records())
    });
    Ok(Built { metadata: tables.metadata, volumes })
}

/// Sizes and times of a source's files; empty if one cannot be looked at.
pub(crate) fn fingerprint(files: &[PathBuf]) -> String {
    let mut text = String::new();
    for file in files {
        let Ok(metadata) = fs::metadata(file) else { return String::new() };
        let separator = if text.is_empty() { "" } else { " " };
        let (seconds, nanoseconds) = modified(&metadata);
        let _ = write!(text, "{separator}{}@{seconds}.{nanoseconds:09}", metadata.len());
    }
    text
}

/// A hash as it is written.
pub(crate) fn hash_text(hash: u64) -> String {
    format!("{hash:016x}")
}
