//! Which work a folder holds: that of one source, with these settings, by this program, for one output.

use crate::config::{GENERATOR, Settings};
use crate::error::BuildError;
use crate::fingerprint::Fingerprint;
use chpm_extmem::{ExtmemError, WorkDir, hidden_name};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// Which work this is.
#[derive(Clone, Debug)]
pub(crate) struct Key {
    /// Begins the names of all folders for the output.
    prefix: OsString,
    /// Of everything that decides the bytes of the output.
    pub(super) hash: u64,
}

impl Key {
    const END: &str = ".work";

    /// The work of making `output` from a source.
    pub(crate) fn of(output: &Path, source: &Fingerprint, settings: &Settings) -> Result<Key, BuildError> {
        let name = output.file_name().ok_or_else(|| ExtmemError::NotAFile { path: output.to_owned() })?;
        let folder = beside(output);
        let folder =
            folder.canonicalize().map_err(|source| ExtmemError::io("find the folder", folder, 0, source))?;
        let mut hash = Xxh3::new();
        // Each with its length, so that no two lists are one text.
        fn add(hash: &mut Xxh3, bytes: &[u8]) {
            hash.update(&(bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        }
        add(&mut hash, folder.as_os_str().as_encoded_bytes());
        add(&mut hash, name.as_encoded_bytes());
        let place = hash.digest();
        add(&mut hash, GENERATOR.as_bytes());
        // A program that was changed may decide otherwise, whatever its version says.
        for identity in Fingerprint::of_program().iter().chain([source]) {
            identity.visit(|bytes| add(&mut hash, bytes));
        }
        for (name, value) in settings.describe() {
            add(&mut hash, name.as_bytes());
            add(&mut hash, value.as_bytes());
        }
        add(&mut hash, format!("{:?}", settings.images()).as_bytes());
        let prefix = hidden_name(name, &format!(".{:08x}-", place as u32));
        Ok(Key { prefix, hash: hash.digest() })
    }

    pub(super) fn folder(&self) -> OsString {
        let mut name = self.prefix.clone();
        name.push(format!("{:08x}{}", self.hash as u32, Key::END));
        name
    }

    /// Folders of other work for the same output. Those without a manifest hold nothing, and are removed; the output's lock says that
    /// nobody is at work there.
    pub(super) fn others(&self, parent: &Path) -> Vec<PathBuf> {
        let mut others = Vec::new();
        for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let bytes = name.as_encoded_bytes();
            let is_work =
                bytes.starts_with(self.prefix.as_encoded_bytes()) && bytes.ends_with(Key::END.as_bytes());
            if !is_work || name == self.folder() {
                continue;
            }
            if entry.path().join(WorkDir::MANIFEST).exists() {
                others.push(entry.path());
            } else {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
        others.sort();
        others
    }
}

/// The folder of `path`.
pub(crate) fn beside(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
