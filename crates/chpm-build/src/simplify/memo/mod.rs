//! Results of groups, kept beside a model for the next build of a source that has changed somewhere (`chpm build --update`).
//!
//! A result goes by a hash of all that decides it ([`key`]), in which shared vertices are numbered by the group alone ([`ids`]); so it is the same in whatever
//! model the group is found again, and needs no rule for what a change reaches. The file is a part with the results one after another and their places by key.

mod entry;
mod ids;
mod key;

use super::group::{GroupDone, GroupTask};
use crate::error::BuildError;
use crate::fingerprint::GENERATOR;
use bincode::serde::{decode_from_slice, encode_to_vec};
use chpm_extmem::{ExtmemError, FailPoints, PartFile, PartWriter, Spool, Store};
use ids::Ids;
pub(super) use key::Reader;
use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};

const CONFIG: bincode::config::Configuration = bincode::config::standard();
/// Changes with the meaning of keys and results.
const VERSION: u32 = 1;

/// Hash of all that decides what becomes of a group.
type Key = u128;

/// Place of a result: its key, where it is, how long it is.
type Row = (Key, u64, u32);

/// The file beside a model.
pub(crate) fn beside(model: &Path) -> PathBuf {
    let mut name = OsString::from(model);
    name.push(".memo");
    PathBuf::from(name)
}

/// The results of one model's groups.
#[derive(Debug)]
pub(crate) struct Memo {
    /// The file that is made.
    path: PathBuf,
    fail_points: FailPoints,
    /// Those of an earlier build; none once what is kept of it has been copied.
    earlier: Mutex<Option<Arc<Earlier>>>,
    /// Those of this one.
    fresh: Spool,
    /// Where all that the model has are, in the order of its groups.
    kept: Mutex<Vec<Kept>>,
    taken: AtomicU64,
    made: AtomicU64,
    damaged: AtomicU64,
}

/// A result that the model has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kept {
    key: Key,
    is_fresh: bool,
    offset: u64,
    len: u32,
}

/// Results of an earlier build.
#[derive(Debug)]
struct Earlier {
    part: Arc<PartFile>,
    /// Ascending.
    rows: Vec<Row>,
}

impl Earlier {
    fn open(model: &Path, fail_points: &FailPoints) -> Result<Self, BuildError> {
        let path = beside(model);
        let refused = |reason: String| BuildError::Part {
            path: path.clone(),
            reason,
            remedy: format!("build once with --updatable instead of --update '{}'", model.display()),
        };
        let part = PartFile::open(&path, fail_points.clone()).map_err(|error| match error {
            ExtmemError::Damaged { reason, .. } => refused(reason.to_owned()),
            error => error.into(),
        })?;
        let unreadable = || refused("is no memo of a model".to_owned());
        let ((version, program), _): ((u32, String), usize) =
            decode_from_slice(part.head(), CONFIG).map_err(|_| unreadable())?;
        if version != VERSION || program != GENERATOR {
            return Err(refused(format!("is of another version ({program}, memo {version})")));
        }
        let record = part.record()?;
        let (rows, _): (Vec<Row>, usize) = decode_from_slice(&record, CONFIG).map_err(|_| unreadable())?;
        Ok(Earlier { part: Arc::new(part), rows })
    }

    fn find(&self, key: Key) -> Option<Row> {
        self.rows.binary_search_by_key(&key, |row| row.0).ok().map(|at| self.rows[at])
    }
}

impl Memo {
    /// For a build of `model` alone, or one that takes what is still right from the memo of an earlier model.
    ///
    /// # Errors
    /// [`BuildError::Part`] if that has none, or one of another version.
    pub(crate) fn open(
        model: &Path,
        earlier: Option<&Path>,
        fail_points: &FailPoints,
        store: &Store,
    ) -> Result<Self, BuildError> {
        let earlier = earlier.map(|model| Earlier::open(model, fail_points)).transpose()?;
        Ok(Memo {
            path: beside(model),
            fail_points: fail_points.clone(),
            earlier: Mutex::new(earlier.map(Arc::new)),
            fresh: Spool::new(store, "results of groups"),
            kept: Mutex::default(),
            taken: AtomicU64::new(0),
            made: AtomicU64::new(0),
            damaged: AtomicU64::new(0),
        })
    }

    /// What becomes of a group: as it was before where that is known, else as `run` does it.
    pub(super) fn group(
        &self,
        task: &GroupTask<'_>,
        group: &[u32],
        reader: &mut Reader,
        run: impl FnOnce() -> Result<GroupDone, BuildError>,
    ) -> Result<GroupDone, BuildError> {
        // Errors of a root are found beside meshes far below it.
        if group.iter().any(|node| task.tree.is_root(*node)) {
            return run();
        }
        let (key, ids) = reader.key(task, group)?;
        if let Some(done) = self.known(task, key, &ids)? {
            self.taken.fetch_add(1, Relaxed);
            return Ok(done);
        }
        let mut done = run()?;
        let bytes = entry::encode(task, &done, &ids)?;
        let kept = Kept { key, is_fresh: true, offset: self.fresh.append(&bytes)?, len: bytes.len() as u32 };
        done.kept = Some(kept);
        self.made.fetch_add(1, Relaxed);
        Ok(done)
    }

    /// A result of the earlier build. One that is damaged is none.
    fn known(&self, task: &GroupTask<'_>, key: Key, ids: &Ids) -> Result<Option<GroupDone>, BuildError> {
        let Some(earlier) = lock(&self.earlier).clone() else { return Ok(None) };
        let Some((key, offset, len)) = earlier.find(key) else { return Ok(None) };
        let bytes: Vec<u8> = match earlier.part.read_items(offset, len as usize) {
            Ok(bytes) => bytes,
            Err(ExtmemError::Damaged { .. }) => {
                self.damaged.fetch_add(1, Relaxed);
                return Ok(None);
            }
            Err(error) => return Err(error.into()),
        };
        let mut done = entry::decode(task, &bytes, ids)?;
        done.kept = Some(Kept { key, is_fresh: false, offset, len });
        Ok(Some(done))
    }

    /// Notes the result of the next group.
    pub(super) fn keep(&self, kept: Option<Kept>) {
        lock(&self.kept).extend(kept);
    }

    /// Writes the memo of the model, once all its groups are done.
    pub(crate) fn finish(&self) -> Result<(), BuildError> {
        let mut out = PartWriter::create(&self.path, self.fail_points.clone())?;
        let earlier = lock(&self.earlier).take();
        let (mut rows, mut met) = (Vec::new(), HashSet::new());
        let mut bytes = Vec::new();
        for Kept { key, is_fresh, offset, len } in lock(&self.kept).drain(..) {
            // Groups of the same shape in the same place have one.
            if !met.insert(key) {
                continue;
            }
            match &earlier {
                Some(earlier) if !is_fresh => bytes = earlier.part.read_items(offset, len as usize)?,
                _ => self.fresh.read(offset, len as usize, &mut bytes)?,
            }
            rows.push((key, out.append(&bytes)?, len));
        }
        // Where it is replaced, some systems want that nobody has it open.
        drop(earlier);
        rows.sort_unstable();
        let encoded = |error: bincode::error::EncodeError| BuildError::Record(error.to_string());
        let head = encode_to_vec((VERSION, GENERATOR), CONFIG).map_err(encoded)?;
        out.finish(&head, &encode_to_vec(&rows, CONFIG).map_err(encoded)?)?;
        Ok(())
    }

    /// Groups that were as before, of how many, in a sentence; and whether any were damaged.
    pub(crate) fn notes(&self) -> Vec<String> {
        let [taken, made, damaged] =
            [&self.taken, &self.made, &self.damaged].map(|count| count.load(Relaxed));
        let mut notes = vec![format!("{taken} of {} groups of clusters are as they were", taken + made)];
        if damaged > 0 {
            notes.push(format!("{damaged} more were damaged in the memo, and were made anew"));
        }
        notes
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
