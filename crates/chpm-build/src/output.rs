//! The files of an output: the model's own and its volumes, if it is to have any. They get their names together.

use crate::config::Volumes;
use crate::error::BuildError;
use chpm_extmem::{AtomicFile, ExtmemError, FailPoints, platform, target};
use chpm_format::volume::{self, Cutter, TOLD};
use chpm_format::{RemoteChpm, Tables, VolumeFault, VolumeRecord};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Most volumes that are open at a time, as they are while they are written; a page takes more room before it is packed.
const MOST_OPEN: u64 = 500;

/// Files of an output while they are written. A *place* in them is an offset in the model's own file or, where it is to have volumes, an offset in the files of all
/// volumes, of one size each. Whatever is dropped before it is published leaves nothing.
#[derive(Debug)]
pub struct OutputFiles {
    main: AtomicFile,
    volumes: Volumes,
    parts: Vec<AtomicFile>,
    overwrite: bool,
    fail_points: FailPoints,
}

/// Places for what is written one behind the other, whole in one file.
#[derive(Debug)]
pub struct Append {
    /// Size of a volume's file, and where in it the next one goes.
    cutter: Option<(u64, Cutter)>,
    start: u64,
}

impl Append {
    /// The place of the next so many bytes, padding included.
    ///
    /// # Errors
    /// [`BuildError::Format`] for more than fit a volume.
    pub fn next(&mut self, len: u64) -> Result<u64, BuildError> {
        let Some((size, cutter)) = &mut self.cutter else {
            let place = self.start;
            self.start += len;
            return Ok(place);
        };
        let (number, offset) = cutter.place(len)?;
        Ok(self.start + (number as u64 - 1) * *size + offset)
    }
}

impl OutputFiles {
    /// Creates the model's own file under a hidden name, which proves that the folder can be written, and looks whether it may have its volumes.
    ///
    /// # Errors
    /// [`BuildError::Extmem`] as [`AtomicFile::create`] has it, also of a volume; [`BuildError::NoVolume`] where something else has the name of one.
    pub fn create(
        path: &Path,
        volumes: Volumes,
        overwrite: bool,
        fail_points: FailPoints,
    ) -> Result<Self, BuildError> {
        let main = AtomicFile::create_with(path, overwrite, fail_points.clone())?;
        let files = OutputFiles { main, volumes, parts: Vec::new(), overwrite, fail_points };
        if volumes != Volumes::One {
            files.check(1)?;
            // How many there will be is not known; but what is nobody's volume would be found when all is done.
            (2..=MOST_OPEN as u32)
                .try_for_each(|number| is_free(&volume::path(files.main.path(), number)))?;
        }
        Ok(files)
    }

    /// Whether a volume of this number may get its name.
    fn check(&self, number: u32) -> Result<PathBuf, BuildError> {
        let path = volume::path(self.main.path(), number);
        let target = target(&path, self.overwrite)?;
        is_free(&path)?;
        Ok(target)
    }

    /// Where a byte of the file to be goes, by tables that have their places.
    ///
    /// # Errors
    /// [`BuildError::Format`] as [`Tables::volumes`] has it.
    pub fn places(&self, tables: &Tables) -> Result<impl Fn(u64) -> u64 + use<>, BuildError> {
        let (size, volumes) = (self.volumes.size().unwrap_or(0), tables.volumes()?);
        Ok(move |offset| {
            let (number, offset) = volume::place(&volumes, offset);
            (number as u64).saturating_sub(1) * size + offset
        })
    }

    /// Places from `end` on, or in volumes behind all that have been begun.
    pub fn append(&self, end: u64) -> Append {
        match self.volumes.size() {
            None => Append { cutter: None, start: end },
            Some(size) => {
                let start = self.parts.len() as u64 * size;
                Append { cutter: Some((size, Cutter::new(size))), start }
            }
        }
    }

    /// Makes the files that places below `end` are in, before they are written.
    ///
    /// # Errors
    /// [`BuildError::Extmem`] where they cannot be made, [`BuildError::TooManyVolumes`].
    pub fn make_room(&mut self, end: u64) -> Result<(), BuildError> {
        let Some(size) = self.volumes.size() else { return Ok(()) };
        let count = end.div_ceil(size);
        if count > MOST_OPEN {
            return Err(BuildError::TooManyVolumes { size, most: MOST_OPEN });
        }
        while (self.parts.len() as u64) < count {
            let path = volume::path(self.main.path(), self.parts.len() as u32 + 1);
            // Whether it may have its name is looked at when it is known that it needs one.
            self.parts.push(AtomicFile::create_with(&path, true, self.fail_points.clone())?);
        }
        Ok(())
    }

    fn part(&self, place: u64) -> (&AtomicFile, u64) {
        match self.volumes.size() {
            Some(size) => (&self.parts[(place / size) as usize], place % size),
            None => (&self.main, place),
        }
    }

    /// Writes at a place, from any thread, for which there is [room](Self::make_room).
    ///
    /// # Errors
    /// [`BuildError::Extmem`] where the file cannot be written.
    pub fn write_all_at(&self, bytes: &[u8], place: u64) -> Result<(), BuildError> {
        let (part, offset) = self.part(place);
        Ok(part.write_all_at(bytes, offset)?)
    }

    /// Reads what was written at a place.
    ///
    /// # Errors
    /// [`BuildError::Extmem`] where the file cannot be read.
    pub fn read_exact_at(&self, bytes: &mut [u8], place: u64) -> Result<(), BuildError> {
        let (part, offset) = self.part(place);
        Ok(part.read_exact_at(bytes, offset)?)
    }

    /// Writes the tables and heads of volumes, and gives all their names: volumes first, the model last. Volumes of a model that is replaced go then, if they have names that
    /// this one does not need. Answers how long all files are together.
    ///
    /// # Errors
    /// [`BuildError::Format`] for tables that no file may have; [`BuildError::Extmem`], after which there is nothing new, but where volumes have replaced others already.
    pub fn publish(mut self, tables: &mut Tables) -> Result<u64, BuildError> {
        let (head, len) = (tables.encode()?, tables.file_len()?);
        let volumes = tables.volumes()?;
        // What packing made shorter needs fewer.
        self.parts.truncate(volumes.len());
        for ((number, record), part) in (1..).zip(&volumes).zip(&mut self.parts) {
            part.set_len(record.file_len())?;
            part.write_all_at(&volume::head(&volumes, number), 0)?;
            part.sync()?;
        }
        self.main.set_len(if volumes.is_empty() { len } else { head.len() as u64 })?;
        self.main.write_all_at(&head, 0)?;
        self.main.sync()?;

        let paths = (1..=volumes.len() as u32).map(|number| self.check(number));
        let paths = paths.collect::<Result<Vec<_>, _>>()?;
        let old = if self.overwrite { volumes_of(self.main.path()) } else { Vec::new() };
        let model = self.main.path().to_owned();
        let mut new = Vec::new();
        let rename = || -> Result<(), ExtmemError> {
            for (part, path) in self.parts.drain(..).zip(paths) {
                if path.symlink_metadata().is_err() {
                    new.push(path);
                }
                part.publish()?;
            }
            self.main.publish()
        };
        if let Err(error) = rename() {
            // It may have its name, and only its folder have failed.
            if volumes_of(&model) != volumes {
                new.iter().for_each(|path| drop(fs::remove_file(path)));
            }
            return Err(error.into());
        }
        remove(&model, &old, volumes.len() as u32);
        Ok(len + volumes.len() as u64 * volume::HEAD_LEN)
    }
}

/// An error if what has the name of a volume is none: what somebody else has called so is not ours to replace.
fn is_free(path: &Path) -> Result<(), BuildError> {
    match start_of(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Ok(start) if start.starts_with(&volume::MAGIC) || start.is_empty() => Ok(()),
        Ok(_) => Err(BuildError::NoVolume { path: path.to_owned() }),
        Err(source) => Err(ExtmemError::io("read", path, 0, source).into()),
    }
}

/// The first bytes of a file that may be a volume.
fn start_of(path: &Path) -> io::Result<Vec<u8>> {
    let mut start = Vec::new();
    platform::open_to_read(path)?.take(TOLD as u64).read_to_end(&mut start)?;
    Ok(start)
}

/// The volumes of the model that has a name now; none if there is no such model.
fn volumes_of(path: &Path) -> Vec<VolumeRecord> {
    let open = || {
        let file = File::open(path).ok().filter(|file| file.metadata().is_ok_and(|found| found.is_file()))?;
        let len = file.metadata().ok()?.len();
        let read = |_: usize, offset: u64, bytes: &mut [u8]| platform::read_exact_at(&file, bytes, offset);
        RemoteChpm::open(len, read).ok().map(|model| model.volumes().to_vec())
    };
    open().unwrap_or_default()
}

/// Removes volumes that a model had beyond those that it has. Other files of such names stay.
fn remove(model: &Path, old: &[VolumeRecord], kept: u32) {
    for number in kept + 1..=old.len() as u32 {
        let path = volume::path(model, number);
        let Ok(start) = start_of(&path) else { continue };
        let len = old[number as usize - 1].file_len();
        let is_old =
            matches!(volume::check_file(old, number, &start, len), Ok(()) | Err(VolumeFault::Len { .. }));
        if is_old {
            // It is in nobody's way: the model is whole.
            let _ = fs::remove_file(&path);
        }
    }
}
