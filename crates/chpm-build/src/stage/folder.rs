//! The folder of a build in stages: its parts, each of which says what made it, of what, and for which plan. What its hashes vouch for is
//! believed: they find accidents.

use super::step::Step;
use crate::config::GENERATOR;
use crate::error::BuildError;
use bincode::config::Configuration;
use bincode::serde::{decode_from_slice, encode_to_vec};
use chpm_extmem::{ExtmemError, FailPoints, PartFile, PartFolder, PartWriter, Store, archived_among};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

const CONFIG: Configuration = bincode::config::standard();
/// Changes with the meaning of what is in parts.
const VERSION: u32 = 6;

/// Head of each part.
#[derive(Serialize, Deserialize)]
struct Header {
    program: String,
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
        self.header(&part, step)?;
        let bytes = part.record()?;
        let decode = || -> Result<T, Undecoded> { Ok(decode_from_slice(&bytes, CONFIG)?.0) };
        let record = match store {
            Some(store) => archived_among(store, Some(&self.parts), decode).map(|(record, _)| record),
            None => decode(),
        };
        Ok(Opened { record: record.map_err(|error| error.of(&part))?, part })
    }

    /// The header of a part, if it is of this program, of this plan and of the step.
    fn header(&self, part: &PartFile, step: Step) -> Result<Header, BuildError> {
        let refused = |reason: String| BuildError::Part {
            path: part.path().to_owned(),
            reason,
            remedy: "make it again by the same program, for this plan".to_owned(),
        };
        let (version, length): (u32, usize) =
            decode_from_slice(part.head(), CONFIG).map_err(|_| refused("cannot be understood".to_owned()))?;
        if version != VERSION {
            return Err(refused(format!(
                "is of another version of parts ({version}, this program writes {VERSION})"
            )));
        }
        let (header, _): (Header, usize) = decode_from_slice(&part.head()[length..], CONFIG)
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
        Ok(header)
    }

    /// An error unless a step is done: its file is made of what is there now, and whole, which is looked at to the last byte if it is to be sure.
    pub(super) fn examine(&self, step: Step, sure: bool) -> Result<(), BuildError> {
        // Opened anew: it may have been replaced.
        let part = PartFile::open(&self.parts.path().join(step.file()), self.fail_points.clone())?;
        for (name, id) in self.header(&part, step)?.inputs {
            if self.parts.open(&name)?.id() != id {
                return Err(BuildError::Part {
                    path: part.path().to_owned(),
                    reason: format!("is made of another {name}"),
                    remedy: String::new(),
                });
            }
        }
        if sure {
            part.check_all()?;
        }
        Ok(())
    }

    /// Whether a step is done.
    pub(super) fn is_current(&self, step: Step, sure: bool) -> bool {
        self.examine(step, sure).is_ok()
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
        let header = Header { program, plan: self.plan, step, inputs };
        let encode = || -> Result<_, Undecoded> {
            Ok((encode_to_vec((VERSION, &header), CONFIG)?, encode_to_vec(&value, CONFIG)?))
        };
        let ((head, record), _) =
            archived_among(store, Some(&self.parts), encode).map_err(|error| match error {
                Undecoded::Array(error) => error.into(),
                Undecoded::Record(reason) => BuildError::Record(reason),
            })?;
        let len = out.len();
        out.finish(&head, &record)?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::Share;

    fn reason(folder: &Folder, step: Step) -> String {
        match folder.read::<u32>(step, None) {
            Ok(_) => "read".to_owned(),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn what_another_program_or_plan_made_is_refused_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let none = FailPoints::default();
        let store = Store::create(dir.path(), 1 << 20).unwrap();
        let step = Step::Regions(Share { index: 2, of: 3 });
        Folder::new(dir.path(), &none).write(Step::Plan, &[], &store, |_| Ok(7_u32)).unwrap();
        let (folder, plan) = Folder::open::<u32>(dir.path(), &none, None).unwrap();
        assert_eq!(plan.record, 7);
        folder.write(step, &[Step::Plan], &store, |_| Ok(8_u32)).unwrap();
        assert!(reason(&folder, step) == "read" && folder.is_current(step, true));

        // The same with another header each time.
        let right = |program: &str, version| {
            (
                version,
                Header {
                    program: program.to_owned(),
                    plan: folder.plan,
                    step: step.file(),
                    inputs: vec![(Step::Plan.file(), folder.plan)],
                },
            )
        };
        let other_plan = |(version, header): (u32, Header)| (version, Header { plan: 1, ..header });
        let other_input = |(version, header): (u32, Header)| {
            (version, Header { inputs: vec![(Step::Plan.file(), 1)], ..header })
        };
        for (header, told) in [
            (right(GENERATOR, VERSION), "read"),
            (right("chpm 99.0.0", VERSION), "is of another version (chpm 99.0.0"),
            (right(GENERATOR, 99), "is of another version of parts (99"),
            (other_plan(right(GENERATOR, VERSION)), "is of another plan"),
            (other_input(right(GENERATOR, VERSION)), "read"),
        ] {
            let is_current = header.1.inputs[0].1 == folder.plan && told == "read";
            let [head, record] =
                [encode_to_vec(header, CONFIG).unwrap(), encode_to_vec(8_u32, CONFIG).unwrap()];
            let out = PartWriter::create(&dir.path().join(step.file()), none.clone()).unwrap();
            out.finish(&head, &record).unwrap();
            let (folder, _) = Folder::open::<u32>(dir.path(), &none, None).unwrap();
            let found = reason(&folder, step);
            assert!(found.contains(told), "{found}");
            assert!(told == "read" || found.contains("regions-2-of-3.part"), "{found}");
            assert_eq!(folder.is_current(step, true), is_current, "{told}");
        }
    }
}
