//! The folder of a build in stages: its parts, each of which says what made it, of what, and for which plan.

use super::step::Step;
use crate::error::BuildError;
use crate::fingerprint::GENERATOR;
use bincode::config::Configuration;
use bincode::serde::{decode_from_slice, encode_into_std_write};
use chpm_extmem::{ExtmemError, FailPoints, PartFile, PartFolder, PartWriter, Store, archived_among};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

const CONFIG: Configuration = bincode::config::standard();
/// Changes with the meaning of what is in parts.
const VERSION: u32 = 1;

/// What stands at the beginning of each record.
#[derive(Serialize, Deserialize)]
struct Header {
    program: String,
    version: u32,
    /// Identity of the plan; that of a plan itself is the file's.
    plan: u64,
    step: String,
    /// Files that it was made of, with their identities.
    inputs: Vec<(String, u64)>,
}

/// The parts of one plan.
#[derive(Clone, Debug)]
pub(super) struct Folder {
    pub(super) parts: Arc<PartFolder>,
    fail_points: FailPoints,
    plan: u64,
}

/// A part that was opened, with its record.
pub(super) struct Opened<T> {
    pub(super) part: Arc<PartFile>,
    pub(super) record: T,
}

impl Folder {
    /// The folder `path` of which the plan is not known yet.
    pub(super) fn new(path: &Path, fail_points: &FailPoints) -> Self {
        let parts = Arc::new(PartFolder::new(path, fail_points.clone()));
        Folder { parts, fail_points: fail_points.clone(), plan: 0 }
    }

    /// The folder and its plan.
    pub(super) fn open<T: DeserializeOwned>(
        path: &Path,
        fail_points: &FailPoints,
        store: Option<&Store>,
    ) -> Result<(Self, Opened<T>), BuildError> {
        let mut folder = Folder::new(path, fail_points);
        folder.plan = folder.parts.open(&Step::Plan.file())?.id();
        let plan = folder.read(Step::Plan, store)?;
        Ok((folder, plan))
    }

    /// Reads what a step has left. A store is needed where the record has spools.
    pub(super) fn read<T: DeserializeOwned>(
        &self,
        step: Step,
        store: Option<&Store>,
    ) -> Result<Opened<T>, BuildError> {
        let part = self.parts.open(&step.file())?;
        let (_, rest) = self.header(&part, step)?;
        let decode = || -> Result<T, Undecoded> { Ok(decode_from_slice(rest, CONFIG)?.0) };
        let record = match store {
            Some(store) => archived_among(store, Some(&self.parts), decode).map(|(record, _)| record),
            None => decode(),
        };
        Ok(Opened { record: record.map_err(|error| error.of(&part))?, part })
    }

    /// The header of a part, and what comes behind it.
    fn header<'a>(&self, part: &'a PartFile, step: Step) -> Result<(Header, &'a [u8]), BuildError> {
        let refused = |reason: String| BuildError::Part {
            path: part.path().to_owned(),
            reason,
            remedy: "make it again by the same program, for this plan".to_owned(),
        };
        let (version, length): (u32, usize) = decode_from_slice(part.record(), CONFIG)
            .map_err(|_| refused("cannot be understood".to_owned()))?;
        if version != VERSION {
            return Err(refused(format!(
                "is of another version of parts ({version}, this program writes {VERSION})"
            )));
        }
        let (header, rest): (Header, usize) = decode_from_slice(&part.record()[length..], CONFIG)
            .map_err(|_| refused("cannot be understood".to_owned()))?;
        if header.program != GENERATOR {
            return Err(refused(format!("is of another version ({}, this is {GENERATOR})", header.program)));
        }
        if header.step != step.file() {
            return Err(refused(format!("holds what belongs into '{}'", header.step)));
        }
        if step != Step::Plan && header.plan != self.plan {
            return Err(refused("is of another plan".to_owned()));
        }
        Ok((header, &part.record()[length + rest..]))
    }

    /// Whether a step is done: its file is made of what is there now, and whole, which is looked at to the last byte if it is to be sure.
    pub(super) fn is_current(&self, step: Step, sure: bool) -> bool {
        let current = || -> Result<bool, BuildError> {
            // Opened anew: it may have been replaced.
            let part = PartFile::open(&self.parts.path().join(step.file()), self.fail_points.clone())?;
            let (header, _) = self.header(&part, step)?;
            for (name, id) in header.inputs {
                if self.parts.open(&name)?.id() != id {
                    return Ok(false);
                }
            }
            if sure {
                part.check_all()?;
            }
            Ok(true)
        };
        current().unwrap_or(false)
    }

    /// Makes the file of a step of those of `inputs`: `make` writes its blobs and answers its record. Answers the length of the blobs.
    pub(super) fn write<T: Serialize>(
        &self,
        step: Step,
        inputs: &[Step],
        store: &Store,
        make: impl FnOnce(&mut PartWriter) -> Result<T, BuildError>,
    ) -> Result<u64, BuildError> {
        let input = |step: &Step| -> Result<(String, u64), BuildError> {
            let part = self.parts.open(&step.file())?;
            self.header(&part, *step)?;
            Ok((step.file(), part.id()))
        };
        let inputs = inputs.iter().map(input).collect::<Result<_, _>>()?;
        let mut out = PartWriter::create(&self.parts.path().join(step.file()), self.fail_points.clone())?;
        let value = make(&mut out)?;

        let (program, step) = (GENERATOR.to_owned(), step.file());
        let header = Header { program, version: VERSION, plan: self.plan, step, inputs };
        let mut record = Vec::new();
        let encode = || -> Result<(), Undecoded> {
            encode_into_std_write(VERSION, &mut record, CONFIG)?;
            encode_into_std_write(&header, &mut record, CONFIG)?;
            encode_into_std_write(&value, &mut record, CONFIG)?;
            Ok(())
        };
        let encoded = archived_among(store, Some(&self.parts), encode);
        encoded.map_err(|error| match error {
            Undecoded::Array(error) => error.into(),
            Undecoded::Record(reason) => BuildError::Record(reason),
        })?;
        let len = out.len();
        out.finish(&record)?;
        Ok(len)
    }
}

/// Why a record is not written or read: an array of it, or the record itself.
enum Undecoded {
    Array(ExtmemError),
    Record(String),
}

impl Undecoded {
    fn of(self, part: &PartFile) -> BuildError {
        match self {
            Undecoded::Array(error) => error.into(),
            Undecoded::Record(reason) => BuildError::Record(format!("{}: {reason}", part.path().display())),
        }
    }
}

impl From<ExtmemError> for Undecoded {
    fn from(error: ExtmemError) -> Self {
        Undecoded::Array(error)
    }
}

impl From<bincode::error::EncodeError> for Undecoded {
    fn from(error: bincode::error::EncodeError) -> Self {
        Undecoded::Record(error.to_string())
    }
}

impl From<bincode::error::DecodeError> for Undecoded {
    fn from(error: bincode::error::DecodeError) -> Self {
        Undecoded::Record(error.to_string())
    }
}
