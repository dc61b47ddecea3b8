//! How far a build is, and how that is written to a manifest and read back: the only place that knows how it is encoded.
//!
//! A point is one record: tables as they are, and in the place of arrays and spools the files that these lie in.

use super::work::{Arranged, Left};
use crate::decompose::Decomposition;
use crate::emit::Known;
use crate::error::BuildError;
use crate::ingest::{Painted, Source};
use crate::progress::Stage;
use crate::report::Reached;
use crate::simplify::{Levels, level_reports};
use crate::trim::Built;
use bincode::error::{DecodeError, EncodeError};
use bincode::serde::{decode_from_std_read, encode_into_std_write};
use chpm_extmem::{ExtmemError, Store, WorkDir, archived};
use serde::Serialize;
use std::io::{self, BufReader};

/// Changes with the meaning of what is written.
const VERSION: u32 = 13;
/// Most bytes that decoding may take.
const LIMIT: usize = 1 << 36;

/// A checkpoint that is written. What is read is `(Known, Option<Painted>, Left)`.
#[derive(Serialize)]
pub(super) struct Point<'a> {
    pub(super) known: &'a Known,
    pub(super) painted: Option<&'a Painted>,
    pub(super) left: LeftRef<'a>,
}

/// [`Left`] as it is written while the work goes on.
#[derive(Serialize)]
pub(super) enum LeftRef<'a> {
    Nothing,
    Ingested(&'a Source),
    Decomposed(&'a Decomposition),
    Arranged(&'a Arranged, Option<&'a Levels>),
    Simplified(&'a Built),
}

impl<'a> LeftRef<'a> {
    pub(super) fn of(left: &'a Left) -> Self {
        match left {
            Left::Nothing => LeftRef::Nothing,
            Left::Ingested(source) => LeftRef::Ingested(source),
            Left::Decomposed(leaves) => LeftRef::Decomposed(leaves),
            Left::Arranged(arranged, levels) => LeftRef::Arranged(arranged, levels.as_deref()),
            Left::Simplified(built) => LeftRef::Simplified(built),
        }
    }

    /// How far this is.
    pub(super) fn reached(&self) -> Reached {
        match self {
            LeftRef::Nothing | LeftRef::Ingested(_) => Reached::Stage(Stage::Ingest),
            LeftRef::Decomposed(_) => Reached::Stage(Stage::Decompose),
            LeftRef::Arranged(_, None) => Reached::Stage(Stage::Hierarchy),
            LeftRef::Arranged(_, Some(levels)) => levels.reached(),
            LeftRef::Simplified(_) => Reached::Stage(Stage::Simplify),
        }
    }
}

impl Point<'_> {
    /// Saves the arrays and publishes the manifest.
    pub(super) fn write(&self, store: &Store, key: u64) -> Result<(), ExtmemError> {
        store.workdir.publish(|mut out| {
            encode_into_std_write((VERSION, key), &mut out, config()).map_err(unwritten)?;
            let record =
                || encode_into_std_write(self, &mut out, config()).map_err(|e| Unwritten(unwritten(e)));
            archived(store, record).map(|(_, names)| names).map_err(|Unwritten(error)| error)
        })
    }
}

/// A checkpoint that was read.
pub(super) type Restored = (Known, Option<Painted>, Left);

/// Results of an earlier run, if there are any: its files are opened and checked, and what else is in the folder goes.
///
/// # Errors
/// [`ExtmemError::Damaged`] if they cannot be used, or are not for `key`.
pub(super) fn read(store: &Store, key: u64) -> Result<Option<Restored>, BuildError> {
    let dir = &store.workdir;
    let Some(content) = dir.manifest()? else { return Ok(None) };
    let mut content = BufReader::new(content);
    let path = || dir.path().join(WorkDir::MANIFEST);
    let wrong = |reason| ExtmemError::Damaged { path: path(), reason };
    let failed = |error| match error {
        DecodeError::Io { inner, .. } => ExtmemError::io("read", &path(), 0, inner),
        _ => wrong("cannot be understood"),
    };
    let (version, found): (u32, u64) = decode_from_std_read(&mut content, config()).map_err(failed)?;
    if version != VERSION {
        return Err(wrong("is of another version").into());
    }
    if found != key {
        return Err(wrong("is of other work").into());
    }

    let record = || decode_from_std_read::<Restored, _, _>(&mut content, config()).map_err(failed);
    let ((known, painted, left), names) = archived(store, record)?;
    dir.resume(names)?;
    Ok(Some((known, painted, completed(left, store)?)))
}

/// Adds what a record does not have: memory that is held, and sums that are made again.
fn completed(left: Left, store: &Store) -> Result<Left, BuildError> {
    Ok(match left {
        Left::Decomposed(leaves) => Left::Decomposed(leaves.hold(store)?),
        Left::Arranged(Arranged { leaves, tree, release }, levels) => {
            Left::Arranged(Arranged { leaves: leaves.hold(store)?, tree, release }, levels)
        }
        Left::Simplified(mut built) => {
            let clusters = &mut built.clusters;
            clusters.levels = level_reports(&built.tree, &clusters.refs, &clusters.reports);
            Left::Simplified(built)
        }
        left => left,
    })
}

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<LIMIT>()
}

/// Why a record was not written, whether an array of it or the manifest failed.
struct Unwritten(io::Error);

impl From<ExtmemError> for Unwritten {
    fn from(error: ExtmemError) -> Self {
        Unwritten(io::Error::other(error))
    }
}

fn unwritten(error: EncodeError) -> io::Error {
    match error {
        EncodeError::Io { inner, .. } => inner,
        other => io::Error::other(other),
    }
}
