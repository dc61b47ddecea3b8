//! Records of values that outlive the process. While a record is written or read, the columns and spools in it serialise themselves: their data
//! lie in files of the work directory, and the record says in which.

use crate::spool::{Extent, SavedExtent};
use crate::{Column, ExtmemError, PartFolder, SavedFile, Spool, Store};
use bytemuck::Pod;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de, ser};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::sync::Arc;

/// What arrays are called that were read back.
const WHAT: &str = "an array of earlier work";

thread_local! {
    /// The record that this thread is at.
    static OPEN: RefCell<Option<Archive>> = const { RefCell::new(None) };
}

/// A record on its way.
#[derive(Debug)]
struct Archive {
    store: Store,
    /// Where parts are that other processes wrote.
    parts: Option<Arc<PartFolder>>,
    /// Files that it needs.
    names: BTreeSet<String>,
    /// Columns so far: each has a file of its own.
    columns: usize,
    /// Why an array could not be saved or read.
    failure: Option<ExtmemError>,
}

/// Runs `serialise`, which writes or reads one record with columns and spools of `store`; answers with the names of the files that they lie in.
///
/// # Errors
/// What an array failed with, else what `serialise` answers.
pub fn archived<T, E: From<ExtmemError>>(
    store: &Store,
    serialise: impl FnOnce() -> Result<T, E>,
) -> Result<(T, BTreeSet<String>), E> {
    archived_among(store, None, serialise)
}

/// The same where spools begin with what is in `parts`.
///
/// # Errors
/// As [`archived`].
pub fn archived_among<T, E: From<ExtmemError>>(
    store: &Store,
    parts: Option<&Arc<PartFolder>>,
    serialise: impl FnOnce() -> Result<T, E>,
) -> Result<(T, BTreeSet<String>), E> {
    let parts = parts.map(Arc::clone);
    let fresh = Archive { store: store.clone(), parts, names: BTreeSet::new(), columns: 0, failure: None };
    let before = OPEN.replace(Some(fresh));
    let result = serialise();
    let Some(archive) = OPEN.replace(before) else { unreachable!("it was put there") };
    match archive.failure {
        Some(failure) => Err(failure.into()),
        None => result.map(|value| (value, archive.names)),
    }
}

/// Does what the record at hand needs, and keeps what it fails with.
fn within<T>(work: impl FnOnce(&mut Archive) -> Result<T, ExtmemError>) -> Result<T, &'static str> {
    OPEN.with_borrow_mut(|open| {
        let archive = open.as_mut().ok_or("an array is written or read outside of an archive")?;
        work(archive).map_err(|failure| {
            archive.failure.get_or_insert(failure);
            "an array cannot be saved or read"
        })
    })
}

impl Archive {
    /// The file of the next column.
    fn column_name(&mut self) -> String {
        self.columns += 1;
        format!("column-{}", self.columns)
    }

    /// Notes a file, which stays from now on.
    fn need(&mut self, saved: &SavedFile) {
        if let Some(name) = saved.name() {
            self.store.workdir.protect(name);
            self.names.insert(name.to_owned());
        }
    }
}

impl<T: Pod> Serialize for Column<T> {
    /// Copies the array to a file: it may change afterwards.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let saved = within(|archive| {
            let name = archive.column_name();
            let saved = self.save(&archive.store, &name)?;
            archive.need(&saved);
            Ok(saved)
        });
        saved.map_err(ser::Error::custom)?.serialize(serializer)
    }
}

impl<'de, T: Pod> Deserialize<'de> for Column<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let saved = SavedFile::deserialize(deserializer)?;
        let column = within(|archive| {
            archive.need(&saved);
            Column::load(&archive.store, WHAT, &saved)
        });
        column.map_err(de::Error::custom)
    }
}

impl Serialize for Spool {
    /// Writes what was appended since the last time. The spool has to have a name.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let saved = within(|archive| {
            let saved = self.save()?;
            archive.need(&saved);
            Ok(saved)
        });
        let earlier: Vec<SavedExtent> = self.earlier().map(Extent::saved).collect();
        (earlier, saved.map_err(ser::Error::custom)?).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Spool {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let (earlier, saved) = <(Vec<SavedExtent>, SavedFile)>::deserialize(deserializer)?;
        let spool = within(|archive| {
            archive.need(&saved);
            let spool = Spool::load(&archive.store, WHAT, saved.file_name(), &saved)?;
            let path = || archive.store.workdir.path().to_owned();
            let open = |extent: &SavedExtent| {
                let absent = || ExtmemError::Damaged { path: path(), reason: "is of no folder of parts" };
                extent.of(archive.parts.as_ref().ok_or_else(absent)?)
            };
            let extents = earlier.iter().map(open).collect::<Result<Vec<_>, _>>()?;
            Ok(spool.with_earlier(extents))
        });
        spool.map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BufferWriter, FailPoints, MemoryBudget, WorkDir};
    use std::sync::Arc;

    type Failed = Box<dyn std::error::Error + Send + Sync>;

    #[derive(Serialize, Deserialize)]
    struct Value {
        numbers: Column<u32>,
        more: Option<Column<u32>>,
        blobs: Spool,
        text: String,
    }

    fn column(store: &Store, items: &[u32]) -> Column<u32> {
        let mut writer = BufferWriter::new(store, "numbers", items.len()).unwrap();
        writer.extend_from_slice(items).unwrap();
        writer.finish_column().unwrap()
    }

    #[test]
    fn a_value_with_arrays_serialises_itself() {
        let dir = tempfile::tempdir().unwrap();
        let workdir = WorkDir::resumable(&dir.path().join("work"), FailPoints::default()).unwrap();
        let store = Store { budget: MemoryBudget::new(16), workdir: Arc::new(workdir) };
        let blobs = Spool::named(&store, "blobs", "blobs");
        blobs.append(b"some bytes").unwrap();
        let (numbers, more) = (column(&store, &[1, 2, 3]), Some(column(&store, &[4; 100])));
        let value = Value { numbers, more, blobs, text: "told".to_owned() };

        let (record, names) = archived::<_, Failed>(&store, || Ok(serde_json::to_vec(&value)?)).unwrap();
        assert_eq!(names.iter().collect::<Vec<_>>(), ["blobs", "column-1", "column-2"]);
        drop(value);

        let read = || archived::<_, Failed>(&store, || Ok(serde_json::from_slice::<Value>(&record)?));
        let (value, again) = read().unwrap();
        assert_eq!((again, value.text.as_str()), (names, "told"));
        let (mut scratch, mut bytes) = (Vec::new(), Vec::new());
        assert_eq!(value.numbers.read(0..3, &mut scratch).unwrap(), [1, 2, 3]);
        assert_eq!(value.more.unwrap().read(98..100, &mut scratch).unwrap(), [4, 4]);
        value.blobs.read(5, 5, &mut bytes).unwrap();
        assert_eq!(bytes, b"bytes");

        // What is not whole is told as what it is.
        std::fs::write(store.workdir.path().join("column-1"), b"else").unwrap();
        let error = read().err().expect("it is damaged");
        let error = error.downcast::<ExtmemError>().expect("the error of the array");
        assert!(matches!(*error, ExtmemError::Damaged { .. }), "{error}");
        assert!(serde_json::from_slice::<Value>(&record).is_err(), "outside of an archive");
    }
}
