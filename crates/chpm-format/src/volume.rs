//! Volumes: files of their own that pages are in, and where in them a byte of the file is.

use crate::error::{FilePart, FormatError, VolumeFault, invalid, require, require_eq};
use bytemuck::{Pod, Zeroable};
use std::ops::Range;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// The first eight bytes of a volume's file.
pub const MAGIC: [u8; 8] = [0x89, b'C', b'H', b'P', b'V', 0x0d, 0x0a, 0x1a];
/// Bytes in front of those that a volume holds: pages keep their alignment.
pub const HEAD_LEN: u64 = 4096;
/// Most volumes of a file: their names have four digits.
pub const MOST_VOLUMES: u32 = 9999;
/// Bytes of a head that say whose it is.
pub const TOLD: usize = 16 + size_of::<VolumeRecord>();

/// A volume in the table of them; see FORMAT.md, "Volumes".
#[derive(Clone, Copy, Pod, Zeroable, PartialEq, Eq, Debug)]
#[repr(C)]
pub struct VolumeRecord {
    /// Its first byte, as an offset in the file.
    pub offset: u64,
    /// Bytes that it holds.
    pub len: u64,
    /// Checksum of the checksums of all sheets and pages in it.
    pub identity: u64,
}

const _: () = assert!(size_of::<VolumeRecord>() == 24);

impl VolumeRecord {
    /// Length of its file, bytes.
    pub fn file_len(&self) -> u64 {
        HEAD_LEN.saturating_add(self.len)
    }
}

/// The name of a volume's file, by its number from 1: `scan.0001.pages` for `scan.chpm`.
pub fn path(model: &Path, number: u32) -> PathBuf {
    let is_named = model.extension().is_some_and(|extension| extension == "chpm");
    let stem = if is_named { model.file_stem() } else { model.file_name() };
    let mut name = stem.unwrap_or_default().to_owned();
    name.push(format!(".{number:04}.pages"));
    model.with_file_name(name)
}

/// Where a byte of the file is: the number of a volume, or 0 for the file itself, and the offset there.
pub fn place(volumes: &[VolumeRecord], offset: u64) -> (usize, u64) {
    let number = volumes.partition_point(|volume| volume.offset <= offset);
    match number.checked_sub(1) {
        Some(index) => (number, HEAD_LEN + offset - volumes[index].offset),
        None => (0, offset),
    }
}

/// The head of a volume's file, by its number from 1.
///
/// # Panics
/// For a volume that there is not.
pub fn head(volumes: &[VolumeRecord], number: u32) -> Vec<u8> {
    let mut head = MAGIC.to_vec();
    head.extend_from_slice(&number.to_le_bytes());
    head.extend_from_slice(&(volumes.len() as u32).to_le_bytes());
    head.extend_from_slice(bytemuck::bytes_of(&volumes[number as usize - 1]));
    head.resize(HEAD_LEN as usize, 0);
    head
}

/// Whether a file of `len` bytes that begins so is the volume of this number, from 1.
///
/// # Errors
/// The [`VolumeFault`] that says what it is instead.
///
/// # Panics
/// For a volume that there is not.
pub fn check_file(volumes: &[VolumeRecord], number: u32, start: &[u8], len: u64) -> Result<(), VolumeFault> {
    let is = |number| start.get(..TOLD).is_some_and(|told| told == &head(volumes, number)[..TOLD]);
    let expected = volumes[number as usize - 1].file_len();
    if !start.starts_with(&MAGIC) {
        return Err(if start.is_empty() { VolumeFault::Len { expected, got: 0 } } else { VolumeFault::None });
    }
    if !is(number) {
        let other = (1..=volumes.len() as u32).find(|other| is(*other));
        return Err(other.map_or(VolumeFault::Foreign, |other| VolumeFault::Other { number, other }));
    }
    if len == expected { Ok(()) } else { Err(VolumeFault::Len { expected, got: len }) }
}

/// Whatever is whole in one volume: a sheet or a page. Padding behind it is with it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unit {
    pub(crate) offset: u64,
    pub(crate) checksum: u64,
}

/// Places in volumes for what is whole in one, as it comes.
#[derive(Clone, Copy, Debug)]
pub struct Cutter {
    size: u64,
    number: usize,
    /// Where in its file the next one goes.
    end: u64,
}

impl Cutter {
    /// For files of at most `size` bytes.
    pub fn new(size: u64) -> Self {
        Cutter { size, number: 0, end: size }
    }

    /// The number, from 1, of the volume that the next `len` bytes go to, padding included, and where in its file they begin.
    ///
    /// # Errors
    /// More bytes than fit a volume.
    pub fn place(&mut self, len: u64) -> Result<(usize, u64), FormatError> {
        if self.end.saturating_add(len) > self.size {
            let least = HEAD_LEN.saturating_add(len);
            let told = format_args!("at least {least}, for the largest page");
            require(least <= self.size, FilePart::File, "size of a volume", told, self.size)?;
            (self.number, self.end) = (self.number + 1, HEAD_LEN);
        }
        let start = self.end;
        self.end += len;
        Ok((self.number, start))
    }
}

/// Volumes for units that lie one behind the other and end at `end`, of files of at most `size` bytes.
pub(crate) fn cut(units: &[Unit], end: u64, size: u64) -> Result<Vec<VolumeRecord>, FormatError> {
    let mut volumes: Vec<VolumeRecord> = Vec::new();
    let (mut cutter, mut hash) = (Cutter::new(size), Xxh3::new());
    for (index, unit) in units.iter().enumerate() {
        let len = units.get(index + 1).map_or(end, |next| next.offset) - unit.offset;
        if cutter.place(len)?.0 > volumes.len() {
            hash = Xxh3::new();
            volumes.push(VolumeRecord { offset: unit.offset, len: 0, identity: 0 });
        }
        hash.update(&unit.checksum.to_le_bytes());
        if let Some(last) = volumes.last_mut() {
            (last.len, last.identity) = (last.len + len, hash.digest());
        }
    }
    let (count, most) = (volumes.len(), MOST_VOLUMES as usize);
    require(
        count <= most,
        FilePart::File,
        "volumes",
        format_args!("at most {most}, of a larger size"),
        count,
    )?;
    Ok(volumes)
}

/// Checks that volumes hold a range of the file, one behind the other.
pub(crate) fn check(volumes: &[VolumeRecord], range: Range<u64>) -> Result<(), FormatError> {
    let (count, most) = (volumes.len(), MOST_VOLUMES as usize);
    let told = format_args!("1 to {most}");
    require((1..=most).contains(&count), FilePart::File, "volumes", told, count)?;
    let mut end = range.start;
    for (number, volume) in (1..).zip(volumes) {
        let place = FilePart::Volume(number);
        require_eq(place, "offset", end, volume.offset)?;
        let aligned = volume.offset.is_multiple_of(crate::PACKED_ALIGN) && volume.len > 0;
        require(aligned, place, "offset and len", "a multiple of 8, and more than 0", volume.offset)?;
        let behind = volume.offset.checked_add(volume.len);
        end = behind.ok_or_else(|| invalid(place, "len", "less than 2^64", volume.len))?;
    }
    require_eq(FilePart::File, "end of the last volume", range.end, end)
}

/// Checks that each volume begins with one of the units, which come in the order of the file, and has the identity of those in it.
pub(crate) fn check_units(
    volumes: &[VolumeRecord],
    units: impl Iterator<Item = Unit>,
) -> Result<(), FormatError> {
    let mut units = units.peekable();
    for (number, volume) in (1..).zip(volumes) {
        let place = FilePart::Volume(number);
        let begins = units.peek().is_some_and(|unit| unit.offset == volume.offset);
        require(begins, place, "offset", "that of a page or sheet", volume.offset)?;
        let mut hash = Xxh3::new();
        while let Some(unit) = units.next_if(|unit| unit.offset - volume.offset < volume.len) {
            hash.update(&unit.checksum.to_le_bytes());
        }
        let (expected, got) = (hash.digest(), volume.identity);
        require_eq(place, "identity", format!("{expected:016x}"), format!("{got:016x}"))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volumes_are_named_as_their_model() {
        let named = |model: &str, number| path(Path::new(model), number).to_string_lossy().into_owned();
        assert_eq!(named("a/scan.chpm", 1), "a/scan.0001.pages");
        assert_eq!(named("scan.v2.chpm", 20), "scan.v2.0020.pages");
        assert_eq!(named("scan", 9999), "scan.9999.pages");
        assert_eq!(named("scan.old", 3), "scan.old.0003.pages");
    }

    #[test]
    fn cuts_are_between_units_and_every_byte_has_its_place() {
        let units = [104, 168, 304, 368].map(|offset| Unit { offset: 4096 + offset, checksum: offset });
        let (size, end) = (HEAD_LEN + 240, 4096 + 608);
        let volumes = cut(&units, end, size).unwrap();
        let ranges: Vec<_> = volumes.iter().map(|volume| (volume.offset, volume.len)).collect();
        assert_eq!(ranges, [(4200, 200), (4400, 64), (4464, 240)]);
        check(&volumes, 4200..end).unwrap();
        check_units(&volumes, units.into_iter()).unwrap();
        let places = [0, 4199, 4200, 4399, 4400, 4464].map(|offset| place(&volumes, offset));
        assert_eq!(places, [(0, 0), (0, 4199), (1, 4096), (1, 4295), (2, 4096), (3, 4096)]);
        assert!(cut(&units, end, size - 1).unwrap_err().to_string().contains("at least 4336"));
        assert!(check(&volumes[1..], 4200..end).is_err() && check(&[], 0..0).is_err());
        assert!(check_units(&volumes, units[..3].iter().copied()).is_err());
        let moved = VolumeRecord { offset: u64::MAX - 7, ..volumes[0] };
        assert!(check(&[moved], moved.offset..7).is_err());
    }

    #[test]
    fn a_file_in_anothers_place_is_told() {
        let units = [0, 64].map(|offset| Unit { offset, checksum: offset });
        let volumes = cut(&units, 128, HEAD_LEN + 64).unwrap();
        let second = head(&volumes, 2);
        let len = HEAD_LEN + 64;
        assert!(check_file(&volumes, 2, &second, len).is_ok());
        let fault = |number, start: &[u8], len| check_file(&volumes, number, start, len).unwrap_err();
        assert_eq!(fault(1, &second, len), VolumeFault::Other { number: 1, other: 2 });
        assert_eq!(fault(2, &second, len - 1), VolumeFault::Len { expected: len, got: len - 1 });
        assert_eq!(fault(2, &[], 0), VolumeFault::Len { expected: len, got: 0 });
        assert_eq!(fault(2, b"text", 4), VolumeFault::None);
        let mut foreign = second.clone();
        foreign[32] ^= 1;
        assert_eq!(fault(2, &foreign, len), VolumeFault::Foreign);
        assert_eq!(fault(2, &second[..20], 20), VolumeFault::Foreign);
    }
}
