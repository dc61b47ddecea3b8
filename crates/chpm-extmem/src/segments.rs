//! The segments of a spool: in memory as long as the budget grants it and no work asks for it, else in one file.

use crate::budget::Movable;
use crate::file::DataFile;
use crate::{ExtmemError, Reservation, Store, WorkDir};
use std::ops::Range;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// All segments of a spool, which the budget may have moved to disk at any time.
#[derive(Debug)]
pub(crate) struct Segments {
    segment_len: usize,
    /// Name of the file, if it can be saved.
    name: Option<String>,
    workdir: Arc<WorkDir>,
    state: RwLock<State>,
}

#[derive(Debug, Default)]
struct State {
    list: Vec<Arc<Segment>>,
    /// Has each segment at its own offset: those on disk, and those in memory as far as they were saved.
    file: Option<Arc<DataFile>>,
    /// Whether memory was refused, or taken back.
    is_full: bool,
}

/// Some bytes of a spool.
#[derive(Debug)]
pub(crate) struct Segment(RwLock<Storage>);

#[derive(Debug)]
enum Storage {
    Memory { bytes: Vec<u8>, _reservation: Reservation },
    Disk(Arc<DataFile>),
}

impl Segments {
    pub(crate) fn new(store: &Store, segment_len: usize, name: Option<&str>) -> Arc<Self> {
        Arc::new(Segments {
            segment_len,
            name: name.map(str::to_owned),
            workdir: Arc::clone(&store.workdir),
            state: RwLock::default(),
        })
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.read().list.len()
    }

    /// A segment, if there is one.
    pub(crate) fn get(&self, index: usize) -> Option<Arc<Segment>> {
        self.read().list.get(index).map(Arc::clone)
    }

    /// The file, made if there is none yet.
    pub(crate) fn file(&self) -> Result<Arc<DataFile>, ExtmemError> {
        self.file_of(&mut self.write())
    }

    /// Adds segments until there are `count`; `what` names the spool in errors.
    pub(crate) fn grow(
        self: &Arc<Self>,
        store: &Store,
        what: &'static str,
        count: usize,
    ) -> Result<(), ExtmemError> {
        if self.count() >= count {
            return Ok(());
        }
        let mut state = self.write();
        while state.list.len() < count {
            let segment = self.new_segment(&mut state, store, what)?;
            state.list.push(Arc::new(Segment(RwLock::new(segment))));
        }
        Ok(())
    }

    /// Has all of a file's segments, which another run has written.
    pub(crate) fn adopt(&self, file: DataFile, len: u64) -> Result<(), ExtmemError> {
        let (file, count) = (Arc::new(file), len.div_ceil(self.segment_len as u64));
        file.set_len(count * self.segment_len as u64)?;
        let mut state = self.write();
        let segment = |_| Arc::new(Segment(RwLock::new(Storage::Disk(Arc::clone(&file)))));
        state.list.extend((0..count).map(segment));
        state.file = Some(file);
        Ok(())
    }

    fn new_segment(
        self: &Arc<Self>,
        state: &mut State,
        store: &Store,
        what: &'static str,
    ) -> Result<Storage, ExtmemError> {
        if !state.is_full {
            let reservation = store.budget.try_reserve(what, self.segment_len as u64);
            if let Some(_reservation) = reservation
                && let Ok(bytes) = bytemuck::try_zeroed_vec(self.segment_len)
            {
                if state.list.is_empty() {
                    store.budget.register(Arc::downgrade(self) as _);
                }
                return Ok(Storage::Memory { bytes, _reservation });
            }
            state.is_full = true;
        }
        let file = self.file_of(state)?;
        // The whole segment exists from now on, as zeros (and as a hole, where the file system knows holes).
        file.set_len((state.list.len() as u64 + 1) * self.segment_len as u64)?;
        Ok(Storage::Disk(file))
    }

    fn file_of(&self, state: &mut State) -> Result<Arc<DataFile>, ExtmemError> {
        if let Some(file) = &state.file {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(DataFile::create(&self.workdir, self.name.as_deref())?);
        Ok(Arc::clone(state.file.insert(file)))
    }

    fn read(&self) -> RwLockReadGuard<'_, State> {
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, State> {
        self.state.write().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Movable for Segments {
    fn move_to_disk(&self) -> Result<(), ExtmemError> {
        let mut state = self.write();
        state.is_full = true;
        let offsets = (0..).step_by(self.segment_len);
        for (segment, offset) in state.list.clone().iter().zip(offsets) {
            let mut place = segment.0.write().unwrap_or_else(PoisonError::into_inner);
            if let Storage::Memory { bytes, .. } = &*place {
                let file = self.file_of(&mut state)?;
                file.write_all_at(bytes, offset)?;
                *place = Storage::Disk(file);
            }
        }
        Ok(())
    }
}

impl Segment {
    /// Fills `out` with `range` of the segment, which lies at `offset` of the file; answers whether it was there.
    pub(crate) fn read(&self, range: Range<usize>, offset: u64, out: &mut [u8]) -> Result<bool, ExtmemError> {
        if let Storage::Memory { bytes, .. } = &*self.place() {
            out.copy_from_slice(&bytes[range]);
            return Ok(false);
        }
        self.file().map_or(Ok(()), |file| file.read_exact_at(out, offset))?;
        Ok(true)
    }

    /// The file that it is in, if it is on disk.
    fn file(&self) -> Option<Arc<DataFile>> {
        match &*self.place() {
            Storage::Memory { .. } => None,
            Storage::Disk(file) => Some(Arc::clone(file)),
        }
    }

    /// Replaces `range` of the segment, which lies at `offset` of the file.
    pub(crate) fn put(&self, range: Range<usize>, offset: u64, from: &[u8]) -> Result<(), ExtmemError> {
        // What is on disk stays there, and many write to it at a time.
        if let Some(file) = self.file() {
            return file.write_all_at(from, offset);
        }
        match &mut *self.0.write().unwrap_or_else(PoisonError::into_inner) {
            Storage::Memory { bytes, .. } => {
                bytes[range].copy_from_slice(from);
                Ok(())
            }
            Storage::Disk(file) => file.write_all_at(from, offset),
        }
    }

    fn place(&self) -> RwLockReadGuard<'_, Storage> {
        self.0.read().unwrap_or_else(PoisonError::into_inner)
    }
}
