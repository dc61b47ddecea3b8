//! A file that goes on in volumes: which they are, and which of them has a byte.

use super::{Chpm, check_alignment};
use crate::error::{FilePart, FormatError, VolumeFault};
use crate::section::SectionKind;
use crate::volume::{self, VolumeRecord};
use chpm_mesh::ClusterId;
use std::error::Error;
use std::io;
use std::path::Path;

impl<D: AsRef<[u8]>> Chpm<D> {
    /// Opens a file that is at `path`, with the volumes beside it if it has any, each of which `open` is asked for.
    ///
    /// # Errors
    /// As [`Chpm::open`]; [`FormatError::Volume`] and [`FormatError::Unread`] with the volume's name.
    pub fn open_at<E: Error + Send + Sync + 'static>(
        data: D,
        path: &Path,
        mut open: impl FnMut(&Path) -> Result<D, E>,
    ) -> Result<Self, FormatError> {
        Self::open_with(data, |records| {
            let opened = (1..=records.len() as u32).map(|number| {
                let path = volume::path(path, number);
                let opened = open(&path).map_err(|error| unopened(&path, error))?;
                let (bytes, place) = (opened.as_ref(), FilePart::Volume(number));
                volume::check_file(records, number, bytes, bytes.len() as u64)
                    .map_err(|fault| FormatError::Volume { path, fault })?;
                check_alignment(bytes, place)?;
                Ok(opened)
            });
            opened.collect()
        })
    }

    /// The data of its volumes, in their order; none where pages are in the file itself.
    pub fn volumes(&self) -> &[D] {
        &self.volumes
    }

    /// Records of its volumes.
    pub fn volume_records(&self) -> &[VolumeRecord] {
        self.table(SectionKind::Volumes)
    }

    /// Bytes of all its files, heads of volumes among them.
    pub fn stored_len(&self) -> u64 {
        self.header.file_len + self.volumes.len() as u64 * volume::HEAD_LEN
    }

    /// All data: that of the file itself, and those of its volumes.
    pub fn parts(&self) -> impl Iterator<Item = &D> {
        std::iter::once(&self.data).chain(&self.volumes)
    }

    /// Bytes from a place in the file on, in whichever part they are; none where they are not in one.
    pub(crate) fn at(&self, offset: u64, len: u64) -> Option<&[u8]> {
        let (part, start) = self.place(offset);
        let data = if part == 0 { &self.data } else { &self.volumes[part - 1] };
        let start = usize::try_from(start).ok()?;
        data.as_ref().get(start..start.checked_add(usize::try_from(len).ok()?)?)
    }

    /// Where a byte of the file is, as [`volume::place`] has it.
    pub(super) fn place(&self, offset: u64) -> (usize, u64) {
        // Most files have none, and need not look for their table.
        if self.volumes.is_empty() { (0, offset) } else { volume::place(self.volume_records(), offset) }
    }

    /// Where a cluster's page is: the part, 0 for the file itself and else the number of a volume, and the offset there.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page_place(&self, id: ClusterId) -> (usize, u64) {
        self.place(self.clusters()[id.index()].page_offset)
    }

    /// The same of a cluster's sheet, and how many bytes there are; none if there are no sheets.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn sheet_place(&self, id: ClusterId) -> Option<((usize, u64), u64)> {
        let record = self.header.has_sheets().then(|| &self.sheets()[id.index()])?;
        Some((self.place(self.sections.body().start + record.offset), record.len()))
    }
}

/// Why a volume is not there.
fn unopened(path: &Path, error: impl Error + Send + Sync + 'static) -> FormatError {
    let path = path.to_owned();
    let mut cause: Option<&(dyn Error + 'static)> = Some(&error);
    while let Some(error) = cause {
        if error.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == io::ErrorKind::NotFound) {
            return FormatError::Volume { path, fault: VolumeFault::Missing };
        }
        cause = error.source();
    }
    FormatError::Unread { path, source: error.into() }
}
