//! Checkpoints: what a build has done is kept in a work folder from time to time, so that a build that was killed goes on there.
//!
//! The folder lies beside the output (or in the work directory that was given). Its name says for which output it is, and holds a hash of
//! the source's identity, the settings and the program: other work has another name. Its manifest names the files of the last
//! checkpoint, and nothing else in it is ever read. Establishes I12.

use crate::config::{Resources, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::point::{Known, Point, Work};
use crate::progress::Progress;
use crate::report::Reached;
use crate::stamp::{self, Stamp};
use chpm_extmem::{ExtmemError, Store, WorkDir, hidden_name};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use xxhash_rust::xxh3::Xxh3;

/// Which work this is.
#[derive(Clone, Debug)]
pub(crate) struct Key {
    /// Begins the names of all folders for the output.
    prefix: OsString,
    /// Of everything that decides the bytes of the output.
    hash: u64,
}

impl Key {
    const END: &str = ".work";

    /// The work of making `output` from a source.
    pub(crate) fn of(output: &Path, source: &Stamp, settings: &Settings) -> Result<Key, BuildError> {
        let name = output.file_name().ok_or_else(|| ExtmemError::NotAFile { path: output.to_owned() })?;
        let folder = beside(output);
        let folder =
            folder.canonicalize().map_err(|source| ExtmemError::io("find the folder", folder, 0, source))?;
        let mut hash = Xxh3::new();
        // Each with its length, so that no two lists are one text.
        let add = |hash: &mut Xxh3, bytes: &[u8]| {
            hash.update(&(bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        };
        add(&mut hash, folder.as_os_str().as_encoded_bytes());
        add(&mut hash, name.as_encoded_bytes());
        let place = hash.digest();
        add(&mut hash, stamp::GENERATOR.as_bytes());
        // A program that was changed may decide otherwise, whatever its version says.
        for identity in Stamp::of_program().iter().chain([source]) {
            identity.visit(|bytes| add(&mut hash, bytes));
        }
        for (name, value) in settings.describe() {
            add(&mut hash, name.as_bytes());
            add(&mut hash, value.as_bytes());
        }
        let prefix = hidden_name(name, &format!(".{:08x}-", place as u32));
        Ok(Key { prefix, hash: hash.digest() })
    }

    fn folder(&self) -> OsString {
        let mut name = self.prefix.clone();
        name.push(format!("{:08x}{}", self.hash as u32, Key::END));
        name
    }

    /// Folders of other work for the same output. Those without a manifest hold nothing, and are removed; the output's lock says that
    /// nobody is at work there.
    fn others(&self, parent: &Path) -> Vec<PathBuf> {
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

/// A checkpoint waits for so many times what the last one took, beyond its interval.
const INTERVAL_BY_COST: u32 = 30;

/// When checkpoints are made, and the last one.
#[derive(Debug)]
pub(crate) struct Checkpoints {
    every: Option<Duration>,
    keep_work: bool,
    key: u64,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    last: Instant,
    /// What the last one took.
    cost: Duration,
    /// What the manifest holds.
    reached: Option<Reached>,
    resumed: Option<Reached>,
    notes: Vec<String>,
}

impl Checkpoints {
    /// None are made, and none is looked for.
    pub(crate) fn off() -> Self {
        Checkpoints { every: None, keep_work: false, key: 0, state: Mutex::new(State::new()) }
    }

    /// Opens the folder of this work in `parent`.
    pub(crate) fn open(
        parent: &Path,
        key: &Key,
        resources: &Resources,
        progress: &dyn Progress,
    ) -> Result<(Self, WorkDir), BuildError> {
        let dir = WorkDir::resumable(&parent.join(key.folder()), resources.faults.clone())?;
        let mut state = State::new();
        for other in key.others(parent) {
            let text = format!(
                "'{}' is the work of another source or other settings; it is not used: delete it if you do not need it",
                other.display()
            );
            progress.note(&text);
            state.notes.push(text);
        }
        let Resources { checkpoint: every, keep_work, .. } = *resources;
        Ok((Checkpoints { every, keep_work, key: key.hash, state: Mutex::new(state) }, dir))
    }

    /// What the last checkpoint of an earlier run holds, or the beginning. A checkpoint that is not what was written is not used.
    pub(crate) fn resume(&self, context: &Context<'_>) -> Result<(Known, Work), BuildError> {
        let begin = || (Known::default(), Work::Begin);
        if self.every.is_none() {
            return Ok(begin());
        }
        let dir = &context.store.workdir;
        let restore = || match Point::read(dir, self.key)? {
            Some(point) => Ok(Some((point.reached(), point.restore(context)?))),
            None => Ok(None),
        };
        match restore() {
            Ok(Some((reached, restored))) => {
                self.note(format!("going on after {reached}"), context);
                let mut state = self.state();
                (state.reached, state.resumed) = (Some(reached), Some(reached));
                Ok(restored)
            }
            Ok(None) => {
                dir.clear()?;
                Ok(begin())
            }
            Err(BuildError::Extmem(error @ ExtmemError::Damaged { .. })) => {
                self.note(format!("earlier work is not used: {error}"), context);
                dir.clear()?;
                Ok(begin())
            }
            Err(error) => Err(error),
        }
    }

    fn note(&self, text: String, context: &Context<'_>) {
        context.progress.note(&text);
        self.state().notes.push(text);
    }

    /// Whether it is time: later, but not twice as late, where checkpoints take long.
    pub(crate) fn due(&self) -> bool {
        self.every.is_some_and(|every| {
            let state = self.state();
            state.last.elapsed() >= every + every.min(INTERVAL_BY_COST * state.cost)
        })
    }

    /// Makes a checkpoint if it is time, of what a stage has left.
    pub(crate) fn offer(&self, known: &Known, work: &Work, store: &Store) -> Result<(), BuildError> {
        let is_last = matches!(work, Work::Simplified(..)) && self.keep_work && self.every.is_some();
        if !self.due() && !is_last {
            return Ok(());
        }
        self.save(&store.workdir, || Point::of(known, work, store))
    }

    /// Makes a checkpoint, if there is something to keep.
    pub(crate) fn save<'a>(
        &self,
        dir: &WorkDir,
        point: impl FnOnce() -> Result<Option<Point<'a>>, BuildError>,
    ) -> Result<(), BuildError> {
        let begun = Instant::now();
        let Some(point) = point()? else { return Ok(()) };
        point.write(dir, self.key)?;
        let mut state = self.state();
        (state.last, state.cost) = (Instant::now(), begun.elapsed());
        state.reached = Some(point.reached());
        Ok(())
    }

    /// The work is done.
    pub(crate) fn finish(&self, dir: &WorkDir) {
        dir.keep(self.keep_work && self.reached().is_some());
    }

    /// Says of an error where the next run goes on, if there is something, or that what there was is gone.
    pub(crate) fn explain(&self, error: BuildError, dir: &WorkDir) -> BuildError {
        let (error, folder) = (Box::new(error), dir.path().to_owned());
        match self.reached() {
            _ if !folder.exists() => BuildError::WorkRemoved { error, folder },
            Some(reached) if folder.join(WorkDir::MANIFEST).exists() => {
                BuildError::Kept { error, reached, folder }
            }
            _ => *error,
        }
    }

    /// What this run began with.
    pub(crate) fn resumed(&self) -> Option<Reached> {
        self.state().resumed
    }

    /// What the next run would begin with.
    fn reached(&self) -> Option<Reached> {
        self.state().reached
    }

    /// What is to be told about earlier work.
    pub(crate) fn notes(&self) -> Vec<String> {
        self.state().notes.clone()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn new() -> Self {
        State { last: Instant::now(), cost: Duration::ZERO, reached: None, resumed: None, notes: Vec::new() }
    }
}
