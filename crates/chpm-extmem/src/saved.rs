//! Record of a file in a manifest: name, length, and hashes that show whether it is whole.

use crate::file::DataFile;
use crate::{ExtmemError, WorkDir};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3;

/// Bytes that are looked at in one step, beside the budget.
pub(crate) const STEP: usize = 1 << 20;

/// A file as it was saved. What lies behind its length is of no meaning.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct SavedFile {
    name: String,
    /// Ends of the ranges that were saved one after another, and the XXH3 of each.
    ranges: Vec<(u64, u64)>,
}

impl SavedFile {
    pub(crate) fn new(name: &str) -> Self {
        SavedFile { name: name.to_owned(), ranges: Vec::new() }
    }

    /// The file's name in its directory; none if nothing was saved and there is no file.
    pub fn name(&self) -> Option<&str> {
        (!self.is_empty()).then_some(self.name.as_str())
    }

    /// The name, whether there is a file or not.
    pub(crate) fn file_name(&self) -> &str {
        &self.name
    }

    /// Bytes that were saved.
    pub fn len(&self) -> u64 {
        self.ranges.last().map_or(0, |range| range.0)
    }

    /// Whether nothing was saved.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Notes that the bytes up to `end` were saved, too.
    pub(crate) fn extend(&mut self, end: u64, hash: u64) {
        self.ranges.push((end, hash));
    }

    /// Opens the file and hands all that was saved to `take`, front to back. It is whole if this succeeds, and nothing of it may be
    /// used if not.
    pub(crate) fn open(
        &self,
        dir: &Arc<WorkDir>,
        mut take: impl FnMut(&[u8]) -> Result<(), ExtmemError>,
    ) -> Result<DataFile, ExtmemError> {
        let damaged = |reason| ExtmemError::Damaged { path: dir.path().join(&self.name), reason };

        let file = DataFile::open(dir, &self.name)?;
        if file.len()? < self.len() {
            return Err(damaged("is shorter than it was"));
        }

        let mut scratch = vec![0; STEP.min(self.len() as usize)];
        let mut offset = 0;
        for (end, expected) in &self.ranges {
            let mut hash = Xxh3::new();
            if *end < offset {
                return Err(damaged("has a range that ends before it begins"));
            }
            while offset < *end {
                let step = scratch.len().min((*end - offset) as usize);
                file.read_exact_at(&mut scratch[..step], offset)?;
                hash.update(&scratch[..step]);
                take(&scratch[..step])?;
                offset += step as u64;
            }

            if hash.digest() != *expected {
                return Err(damaged("is not what was saved"));
            }
        }
        Ok(file)
    }
}
