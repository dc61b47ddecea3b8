//! The files of a work directory, read and written at their offsets.

use crate::{ExtmemError, WorkDir, platform};
use std::fs::File;
use std::io;
use std::sync::Arc;

/// A file of a work directory. One without a name goes when it is closed; one with a name goes then, too, unless a manifest
/// names it.
#[derive(Debug)]
pub(crate) struct DataFile {
    file: File,
    name: Option<Name>,
    dir: Arc<WorkDir>,
}

#[derive(Debug)]
struct Name {
    name: String,
    dir: Arc<WorkDir>,
}

impl DataFile {
    /// A new file, with the given name where the directory is kept for another run.
    pub(crate) fn create(dir: &Arc<WorkDir>, name: Option<&str>) -> Result<Self, ExtmemError> {
        match name.filter(|_| dir.is_resumable()) {
            Some(name) => Ok(Self::named(dir, name, dir.create_file(name)?)),
            None => Ok(DataFile { file: dir.unnamed_file()?, name: None, dir: Arc::clone(dir) }),
        }
    }

    /// A file that was written by another run.
    pub(crate) fn open(dir: &Arc<WorkDir>, name: &str) -> Result<Self, ExtmemError> {
        Ok(Self::named(dir, name, dir.open_file(name)?))
    }

    fn named(dir: &Arc<WorkDir>, name: &str, file: File) -> Self {
        let name = Some(Name { name: name.to_owned(), dir: Arc::clone(dir) });
        DataFile { file, name, dir: Arc::clone(dir) }
    }

    /// File name, if it has one.
    pub(crate) fn name(&self) -> Option<&str> {
        self.name.as_ref().map(|name| name.name.as_str())
    }

    /// The file itself, if it has no name.
    pub(crate) fn into_unnamed(self) -> Option<File> {
        self.name.is_none().then_some(self.file)
    }

    /// Bytes of the file.
    pub(crate) fn len(&self) -> Result<u64, ExtmemError> {
        self.attempt("examine a work file in", 0, || Ok(self.file.metadata()?.len()))
    }

    pub(crate) fn read_exact_at(&self, out: &mut [u8], offset: u64) -> Result<(), ExtmemError> {
        self.attempt("read a work file in", 0, || platform::read_exact_at(&self.file, out, offset))
    }

    pub(crate) fn write_all_at(&self, bytes: &[u8], offset: u64) -> Result<(), ExtmemError> {
        self.attempt("write a work file in", bytes.len() as u64, || {
            platform::write_all_at(&self.file, bytes, offset)
        })
    }

    /// Sets the length; bytes that are never written read as zeros.
    pub(crate) fn set_len(&self, len: u64) -> Result<(), ExtmemError> {
        self.attempt("extend a work file in", len, || self.file.set_len(len))
    }

    /// Has all that was written on the disk.
    pub(crate) fn sync(&self) -> Result<(), ExtmemError> {
        self.attempt("sync a work file in", 0, || self.file.sync_data())
    }

    fn attempt<T>(
        &self,
        action: &'static str,
        needed: u64,
        run: impl FnOnce() -> io::Result<T>,
    ) -> Result<T, ExtmemError> {
        let result = self.dir.fail_points().access().and_then(|()| run());
        result.map_err(|source| ExtmemError::io(action, self.dir.place(), needed, source))
    }
}

impl Drop for Name {
    fn drop(&mut self) {
        self.dir.discard(&self.name);
    }
}

/// A file that is written front to back.
#[derive(Debug)]
pub(crate) struct Appender {
    file: DataFile,
    buffer: Vec<u8>,
    written: u64,
}

impl Appender {
    /// Bytes gathered before a write, beside the budget.
    const BUFFER: usize = 1 << 18;

    pub(crate) fn new(file: DataFile) -> Self {
        Appender { file, buffer: Vec::new(), written: 0 }
    }

    pub(crate) fn append(&mut self, bytes: &[u8]) -> Result<(), ExtmemError> {
        if self.buffer.len() + bytes.len() > Self::BUFFER {
            self.flush()?;
        }
        if bytes.len() >= Self::BUFFER {
            self.file.write_all_at(bytes, self.written)?;
            self.written += bytes.len() as u64;
        } else {
            self.buffer.extend_from_slice(bytes);
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), ExtmemError> {
        if !self.buffer.is_empty() {
            self.file.write_all_at(&self.buffer, self.written)?;
            self.written += self.buffer.len() as u64;
            self.buffer.clear();
        }
        Ok(())
    }

    /// The file with all that was appended.
    pub(crate) fn finish(mut self) -> Result<DataFile, ExtmemError> {
        self.flush()?;
        Ok(self.file)
    }
}
