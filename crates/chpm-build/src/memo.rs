//! Results of regions and groups, kept beside a model for the next build of a source that has changed somewhere (`chpm build --update`).
//!
//! A result goes by a hash of all that decides it, in which vertices have numbers of the region's or group's own: so it is the same in whatever model that is found
//! again, and no rule is needed for how far a change reaches. The file is a part with the results one after another and their places by key.

use crate::config::GENERATOR;
use crate::error::BuildError;
use crate::report::TakenOver;
use bincode::serde::{decode_from_slice, encode_to_vec};
use chpm_extmem::{ExtmemError, FailPoints, PartFile, PartWriter, Spool, Store};
use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use xxhash_rust::xxh3::Xxh3;

const CONFIG: bincode::config::Configuration = bincode::config::standard();
/// Changes with the meaning of keys and results.
const VERSION: u32 = 3;

/// Hash of all that decides a result.
pub(crate) type Key = u128;

/// Place of a result: its key, where it is, how long it is.
type Row = (Key, u64, u32);

/// The file of results beside a model, as [`Resources::memo`](crate::Resources::memo) has it made.
pub fn beside(model: &Path) -> PathBuf {
    let mut name = OsString::from(model);
    name.push(".memo");
    PathBuf::from(name)
}

/// Whose result it is. Results are kept in this order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum Owner {
    /// A region, whose leaves are known.
    Region(usize),
    /// A group of a level, whose members are simplified.
    Group(u32, usize),
}

impl Owner {
    fn kind(self) -> usize {
        match self {
            Owner::Region(_) => 0,
            Owner::Group(..) => 1,
        }
    }
}

/// Adds a value to a hash.
pub(crate) fn hash_value(hash: &mut Xxh3, value: &impl serde::Serialize) -> Result<(), BuildError> {
    hash.update(&encoded(value)?);
    Ok(())
}

/// A value as results have it.
pub(crate) fn encoded(value: &impl serde::Serialize) -> Result<Vec<u8>, BuildError> {
    encode_to_vec(value, CONFIG).map_err(|error| BuildError::Record(error.to_string()))
}

/// A result: a record, and behind it the blobs that places in it are of.
pub(crate) fn sealed(record: &impl serde::Serialize, blobs: &[u8]) -> Result<Vec<u8>, BuildError> {
    let record = encoded(record)?;
    Ok([&(record.len() as u64).to_le_bytes()[..], &record, blobs].concat())
}

/// Record and blobs of a result.
pub(crate) fn opened<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<(T, Blobs<'_>), BuildError> {
    let (len, rest) = bytes.split_first_chunk::<8>().ok_or_else(unknown)?;
    let (record, blobs) = rest.split_at_checked(u64::from_le_bytes(*len) as usize).ok_or_else(unknown)?;
    Ok((decode_from_slice(record, CONFIG).map_err(|_| unknown())?.0, Blobs(blobs)))
}

/// Blobs of a result.
pub(crate) struct Blobs<'a>(&'a [u8]);

impl<'a> Blobs<'a> {
    pub(crate) fn get(&self, place: u64, len: usize) -> Result<&'a [u8], BuildError> {
        let place = place as usize;
        place.checked_add(len).and_then(|end| self.0.get(place..end)).ok_or_else(unknown)
    }
}

fn unknown() -> BuildError {
    BuildError::Record("a result in a memo".to_owned())
}

/// The results of one model.
#[derive(Debug)]
pub(crate) struct Memo {
    /// The file that is made.
    path: PathBuf,
    /// Whether there was one to take from.
    updates: bool,
    fail_points: FailPoints,
    /// Those of an earlier build; none once what is kept of it has been copied.
    earlier: Mutex<Option<Arc<Earlier>>>,
    /// Those of this one.
    fresh: Spool,
    /// Where all that the model has are.
    kept: Mutex<Vec<Kept>>,
    /// By kind.
    taken: [AtomicU64; 2],
    made: [AtomicU64; 2],
    damaged: AtomicU64,
}

/// A result that the model has.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct Kept {
    owner: Owner,
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
    /// [`BuildError::Part`] if that has none, or one of another version; [`BuildError::Extmem`] if something else has the name of the new one and is not to be
    /// replaced.
    pub(crate) fn open(
        (model, overwrite): (&Path, bool),
        earlier: Option<&Path>,
        fail_points: &FailPoints,
        store: &Store,
    ) -> Result<Self, BuildError> {
        let earlier = earlier.map(|model| Earlier::open(model, fail_points)).transpose()?;
        // A memo may be there from a run that was killed.
        let path = beside(model);
        if PartFile::open(&path, fail_points.clone()).is_err() {
            chpm_extmem::target(&path, overwrite)?;
        }
        Ok(Memo {
            path,
            updates: earlier.is_some(),
            fail_points: fail_points.clone(),
            earlier: Mutex::new(earlier.map(Arc::new)),
            fresh: Spool::new(store, "results for later builds"),
            kept: Mutex::default(),
            taken: Default::default(),
            made: Default::default(),
            damaged: AtomicU64::new(0),
        })
    }

    /// A result of the earlier build. One that is damaged is none.
    pub(crate) fn find(&self, owner: Owner, key: Key) -> Result<Option<Vec<u8>>, BuildError> {
        let Some(earlier) = lock(&self.earlier).clone() else { return Ok(None) };
        let Some((key, offset, len)) = earlier.find(key) else { return Ok(None) };
        match earlier.part.read_items(offset, len as usize) {
            Ok(bytes) => {
                self.taken[owner.kind()].fetch_add(1, Relaxed);
                lock(&self.kept).push(Kept { owner, key, is_fresh: false, offset, len });
                Ok(Some(bytes))
            }
            Err(ExtmemError::Damaged { .. }) => {
                self.damaged.fetch_add(1, Relaxed);
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Takes in a result that was made.
    pub(crate) fn add(&self, owner: Owner, key: Key, bytes: &[u8]) -> Result<(), BuildError> {
        self.made[owner.kind()].fetch_add(1, Relaxed);
        let (offset, len) = (self.fresh.append(bytes)?, bytes.len() as u32);
        lock(&self.kept).push(Kept { owner, key, is_fresh: true, offset, len });
        Ok(())
    }

    /// Writes the memo of the model, once all is done.
    pub(crate) fn finish(&self) -> Result<(), BuildError> {
        let mut out = PartWriter::create(&self.path, self.fail_points.clone())?;
        let earlier = lock(&self.earlier).take();
        let (mut rows, mut met) = (Vec::new(), HashSet::new());
        let mut bytes = Vec::new();
        let mut kept = std::mem::take(&mut *lock(&self.kept));
        kept.sort_unstable();
        for Kept { key, is_fresh, offset, len, .. } in kept {
            // What is the same in the same place has one.
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
        out.finish(&encoded(&(VERSION, GENERATOR))?, &encoded(&rows)?)?;
        Ok(())
    }

    /// Regions and groups that are as before, if there was anything before.
    pub(crate) fn taken_over(&self) -> Option<TakenOver> {
        let told = |kind: usize| {
            let [taken, made] = [&self.taken, &self.made].map(|counts| counts[kind].load(Relaxed));
            [taken, taken + made]
        };
        self.updates.then(|| TakenOver {
            regions: told(Owner::Region(0).kind()),
            groups: told(Owner::Group(0, 0).kind()),
        })
    }

    /// Sentences about results that were taken over, and about damaged ones.
    pub(crate) fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = self.taken_over().iter().map(TakenOver::to_string).collect();
        let damaged = self.damaged.load(Relaxed);
        if damaged > 0 {
            notes.push(format!("results that were damaged in the memo, and were made anew: {damaged}"));
        }
        notes
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
