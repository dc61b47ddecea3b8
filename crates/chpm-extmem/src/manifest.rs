//! The manifest of a work directory: what the next run is told, whole or not at all.
//!
//! Eight bytes say what it is, then comes what the caller writes, then the XXH3 of both. It is written under another name, synced and
//! renamed, so that there is always the last one or the next; the files that it names are synced before.

use crate::platform::sync_folder;
use crate::{ExtmemError, WorkDir};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// The last digit is the version of what surrounds the content.
const MAGIC: [u8; 8] = *b"CHPMWRK1";
const HASH: u64 = 8;

impl WorkDir {
    /// The manifest's name.
    pub const MANIFEST: &str = "manifest";
    const NEXT: &str = "manifest.next";

    /// Replaces the manifest by what `write` writes, which answers with the names of the files that it needs. From now on the directory
    /// is kept. Files that only the last manifest needed are removed.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] naming the directory; the last manifest then stays, or the next has come.
    pub fn publish(
        &self,
        write: impl FnOnce(&mut dyn Write) -> io::Result<BTreeSet<String>>,
    ) -> Result<(), ExtmemError> {
        let failed = |source: io::Error| match source.downcast::<ExtmemError>() {
            Ok(own) => own,
            Err(source) => ExtmemError::io("write a manifest in", self.place(), 0, source),
        };
        let names = self.write_next(write).map_err(failed)?;
        names.iter().for_each(|name| self.protect(name));
        let renamed = self
            .fail_points()
            .access()
            .and_then(|()| fs::rename(self.path().join(Self::NEXT), self.manifest_path()));
        renamed.map_err(failed)?;
        self.keep(true);
        let synced = self.fail_points().access().and_then(|()| sync_folder(self.path()));
        synced.map_err(failed)?;
        self.list(names);
        Ok(())
    }

    fn write_next(
        &self,
        write: impl FnOnce(&mut dyn Write) -> io::Result<BTreeSet<String>>,
    ) -> io::Result<BTreeSet<String>> {
        self.fail_points().access()?;
        let file = File::create(self.path().join(Self::NEXT))?;
        let mut out = Hashing { inner: BufWriter::new(file), hash: Xxh3::new() };
        out.write_all(&MAGIC)?;
        let names = write(&mut out)?;
        let hash = out.hash.digest().to_le_bytes();
        let mut file = out.inner;
        file.write_all(&hash)?;
        self.fail_points().access()?;
        file.flush()?;
        self.fail_points().access()?;
        file.get_ref().sync_data()?;
        Ok(names)
    }

    /// The content of the manifest, if there is one; it was checked.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if it is not what was written, [`ExtmemError::Io`].
    pub fn manifest(&self) -> Result<Option<impl Read + use<>>, ExtmemError> {
        let path = self.manifest_path();
        let failed = |source| ExtmemError::io("read", &path, 0, source);
        fn damaged(reason: &'static str, path: &Path) -> ExtmemError {
            ExtmemError::Damaged { path: path.to_owned(), reason }
        }
        let open = || self.fail_points().access().and_then(|()| File::open(&path));

        let file = match open() {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            opened => opened.map_err(failed)?,
        };
        let len = file.metadata().map_err(failed)?.len();
        let Some(content) = len.checked_sub(MAGIC.len() as u64 + HASH) else {
            return Err(damaged("is too short", &path));
        };

        // The hash is checked first: nobody gets to read a byte that is not as it was written.
        let mut magic = [0; MAGIC.len()];
        let mut hashing = Hashing { inner: BufReader::new(file), hash: Xxh3::new() };
        hashing.read_exact(&mut magic).map_err(failed)?;
        if magic != MAGIC {
            return Err(damaged("is of another version", &path));
        }
        io::copy(&mut (&mut hashing).take(content), &mut io::sink()).map_err(failed)?;
        let mut stored = [0; HASH as usize];
        hashing.inner.read_exact(&mut stored).map_err(failed)?;
        if hashing.hash.digest() != u64::from_le_bytes(stored) {
            return Err(damaged("is not what was written", &path));
        }

        let mut file = BufReader::new(open().map_err(failed)?);
        file.read_exact(&mut magic).map_err(failed)?;
        Ok(Some(file.take(content)))
    }

    /// Takes up the files that the manifest names, and removes all others.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] naming the directory.
    pub fn resume(&self, names: BTreeSet<String>) -> Result<(), ExtmemError> {
        self.sweep(&names, true)?;
        self.list(names);
        Ok(())
    }

    /// Removes everything: nothing of it is of use.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] naming the directory.
    pub fn clear(&self) -> Result<(), ExtmemError> {
        self.list(BTreeSet::new());
        self.sweep(&BTreeSet::new(), false)?;
        self.keep(false);
        Ok(())
    }

    fn manifest_path(&self) -> PathBuf {
        self.path().join(Self::MANIFEST)
    }
}

/// Hashes what passes through.
struct Hashing<T> {
    inner: T,
    hash: Xxh3,
}

impl<T: Write> Write for Hashing<T> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.hash.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl<T: Read> Read for Hashing<T> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(bytes)?;
        self.hash.update(&bytes[..count]);
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FailPoints, MemoryBudget, Spool, Store};
    use std::path::Path;
    use std::sync::Arc;

    fn open(path: &Path, fail_points: FailPoints) -> Store {
        let workdir = Arc::new(WorkDir::resumable(path, fail_points).unwrap());
        Store { budget: MemoryBudget::new(1 << 20), workdir }
    }

    fn names(path: &Path) -> Vec<String> {
        let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<String> = fs::read_dir(path).unwrap().map(name).collect();
        names.sort();
        names
    }

    fn content(store: &Store) -> Option<String> {
        store.workdir.manifest().unwrap().map(|mut content| {
            let mut text = String::new();
            content.read_to_string(&mut text).unwrap();
            text
        })
    }

    fn publish(store: &Store, text: &str, names: &[&str]) -> Result<(), ExtmemError> {
        let names = names.iter().map(|name| name.to_string()).collect();
        store.workdir.publish(|out| out.write_all(text.as_bytes()).map(|()| names))
    }

    #[test]
    fn files_stay_as_long_as_a_manifest_names_them() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("work");
        let store = open(&path, FailPoints::default());
        assert_eq!(content(&store), None);
        let spools = ["a", "b", "c"].map(|name| Spool::named(&store, "blobs", name));
        spools.iter().for_each(|spool| assert_eq!(spool.append(b"0123456789").unwrap(), 0));
        let [a, b, c] = spools;
        let saved = a.save().unwrap();
        b.save().unwrap();
        publish(&store, "first", &["a", "b"]).unwrap();
        drop(c);
        drop(b);
        assert_eq!(names(&path), ["a", "b", "manifest"], "b is closed, and named still");
        a.append(b"more").unwrap();
        publish(&store, "second", &["a"]).unwrap();
        assert_eq!(
            (names(&path), content(&store).as_deref()),
            (vec!["a".into(), "manifest".into()], Some("second"))
        );
        drop((a, store));

        // Another run finds what was saved, and nothing that came later.
        fs::write(path.join("left"), b"half-writ").unwrap();
        let store = open(&path, FailPoints::default());
        store.workdir.resume(["a".to_owned()].into()).unwrap();
        assert_eq!(names(&path), ["a", "manifest"]);
        let a = Spool::load(&store, "blobs", "a", &saved).unwrap();
        assert_eq!(a.append(b"x").unwrap(), 10);
        let mut out = Vec::new();
        a.read(0, 11, &mut out).unwrap();
        assert_eq!(out, b"0123456789x");
        let saved = a.save().unwrap();
        assert_eq!((saved.len(), saved.name()), (11, Some("a")));
        assert!(Spool::load(&store, "blobs", "a", &saved).is_ok());
        drop(a);
        store.workdir.clear().unwrap();
        drop(store);
        assert!(!path.exists());
    }

    #[test]
    fn what_is_not_what_was_written_is_damaged() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("work");
        let store = open(&path, FailPoints::default());

        let spool = Spool::named(&store, "blobs", "a");
        spool.append(&[7; 3000]).unwrap();
        spool.save().unwrap();
        spool.append(&[8; 1000]).unwrap();
        let saved = spool.save().unwrap();
        publish(&store, "text", &["a"]).unwrap();
        drop(spool);

        for (name, len) in [("manifest", 8 + 4 + 8), ("a", 4000)] {
            let whole = fs::read(path.join(name)).unwrap();
            for at in [0, 9, 19, 2999, 3999].into_iter().filter(|at| *at < len) {
                let mut bytes = whole.clone();
                bytes[at] ^= 1;
                fs::write(path.join(name), &bytes).unwrap();
                let error = match name {
                    "a" => Spool::load(&store, "blobs", "a", &saved).err(),
                    _ => store.workdir.manifest().err(),
                };
                assert!(matches!(error, Some(ExtmemError::Damaged { .. })), "{name} at {at}: {error:?}");
            }

            fs::write(path.join(name), &whole[..len.min(3000) - 1]).unwrap();
            let error = match name {
                "a" => Spool::load(&store, "blobs", "a", &saved).err(),
                _ => store.workdir.manifest().err(),
            };
            assert!(matches!(error, Some(ExtmemError::Damaged { .. })), "{name}: {error:?}");
            fs::write(path.join(name), &whole).unwrap();
        }

        Spool::load(&store, "blobs", "a", &saved).unwrap();
        assert_eq!(content(&store).as_deref(), Some("text"));
    }

    #[test]
    fn a_fault_leaves_the_last_manifest_or_the_next() {
        for at in 0.. {
            let parent = tempfile::tempdir().unwrap();
            let path = parent.path().join("work");
            let store = open(&path, FailPoints::default());
            publish(&store, "first", &[]).unwrap();
            drop(store);
            // The first access makes the directory.
            let fail_points = FailPoints::fail_at(at + 1, at % 2 == 0);
            let result = publish(&open(&path, fail_points.clone()), "second", &[]);
            let found = content(&open(&path, FailPoints::default())).unwrap();
            if fail_points.seen() <= at + 1 {
                result.unwrap();
                assert!(found == "second" && at > 3, "{at}");
                return;
            }
            assert!(result.is_err(), "{at}");
            assert!(found == "first" || found == "second", "{found}");
        }
    }
}
