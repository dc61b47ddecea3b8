//! The archive of a tileset: `.3tz`, the 3D Tiles archive format 1.3.
//!
//! It is a ZIP whose files are stored as they are. The last one is an index: where each file is, by the MD5 of its path. So a reader finds a tile by one
//! search and one read, without the ZIP's directory, which is slow to read where tiles are many. No library of ZIP: lengths are known beforehand, so that
//! nothing is written behind or sought back for.

use crate::error::ExportError;
use md5::{Digest, Md5};
use std::io::Write;

const FORMAT: &str = "3D Tiles archive";
/// Name of the index.
const INDEX: &str = "@3dtilesIndex1@";
/// A place in the index: a hash in two numbers, and the offset of the file's header; each of eight bytes.
type Place = [u8; 24];

/// Fields of two bytes and of four that say: the number is elsewhere, in eight bytes.
const LARGE_2: u16 = u16::MAX;
const LARGE_4: u32 = u32::MAX;
/// Versions of ZIP that know no such fields, and that do.
const PLAIN: u16 = 20;
const ZIP64: u16 = 45;
/// The first day that a ZIP knows: bytes do not depend on when they were written.
const DAY: u16 = 1 << 5 | 1;

/// A tileset as one file, written front to back.
///
/// ```
/// use chpm_export::tiles::Archive;
///
/// let mut archive = Archive::new(Vec::new());
/// archive.add("tileset.json", b"{}")?;
/// let (bytes, len) = archive.finish()?;
/// assert!(bytes.starts_with(b"PK\x03\x04") && bytes.len() as u64 == len);
/// # Ok::<(), chpm_export::ExportError>(())
/// ```
pub struct Archive<W> {
    out: W,
    /// Where the first file begins, and where the next one does.
    begin: u64,
    end: u64,
    entries: Vec<Entry>,
    /// Paths of all entries, one behind the other.
    names: String,
}

struct Entry {
    crc: u32,
    len: u32,
    name_len: u16,
}

impl<W: Write> Archive<W> {
    /// Memory for each file, at most, of paths of up to 32 bytes: while vectors grow, and the index.
    pub const EACH: u64 = 2 * (size_of::<Entry>() as u64 + 32) + size_of::<Place>() as u64;

    /// Begins one.
    pub fn new(out: W) -> Self {
        Archive { out, begin: 0, end: 0, entries: Vec::new(), names: String::new() }
    }

    /// Adds a file.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`] for one of 4 GiB, [`ExportError::Write`].
    pub fn add(&mut self, path: &str, bytes: &[u8]) -> Result<(), ExportError> {
        let format = FORMAT;
        let too_large = |what, limit, got| {
            let remedy = "export into a folder";
            ExportError::TooLarge { format, what, limit, got, remedy }
        };
        let limit = u64::from(LARGE_4) - 1;
        let len = u32::try_from(bytes.len()).ok().filter(|len| *len != LARGE_4);
        let len = len.ok_or_else(|| too_large("bytes in a file", limit, bytes.len() as u64))?;
        let name_len = u16::try_from(path.len());
        let name_len =
            name_len.map_err(|_| too_large("bytes in a path", LARGE_2.into(), path.len() as u64))?;

        let entry = Entry { crc: crc32fast::hash(bytes), len, name_len };
        let mut header = Record(b"PK\x03\x04".to_vec());
        header.u16(PLAIN).facts(&entry).u16(0).bytes(path.as_bytes());
        self.write(&header.0)?;
        self.write(bytes)?;
        self.entries.push(entry);
        self.names.push_str(path);
        Ok(())
    }

    /// Writes the index and the directory; answers what was written into, and how many bytes the archive has.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub fn finish(mut self) -> Result<(W, u64), ExportError> {
        let index = index(&self.entries, &self.names, self.begin);
        self.add(INDEX, index.as_flattened())?;
        drop(index);

        let (entries, names) = (std::mem::take(&mut self.entries), std::mem::take(&mut self.names));
        let directory = self.end;
        for (entry, name, offset) in placed(&entries, &names, self.begin) {
            self.write(&row(entry, name, offset))?;
        }
        let end = end(entries.len() as u64, directory, self.end);
        self.write(&end)?;
        self.out.flush().map_err(|source| ExportError::Write { format: FORMAT, source })?;
        Ok((self.out, self.end - self.begin))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), ExportError> {
        self.out.write_all(bytes).map_err(|source| ExportError::Write { format: FORMAT, source })?;
        self.end += bytes.len() as u64;
        Ok(())
    }
}

/// Entries with their paths, and where they lie.
fn placed<'a>(
    entries: &'a [Entry],
    names: &'a str,
    begin: u64,
) -> impl Iterator<Item = (&'a Entry, &'a str, u64)> {
    let (mut rest, mut next) = (names, begin);
    entries.iter().map(move |entry| {
        let (name, others) = rest.split_at(usize::from(entry.name_len));
        let offset = next;
        rest = others;
        next += 30 + u64::from(entry.name_len) + u64::from(entry.len);
        (entry, name, offset)
    })
}

/// Places of all files by their hashes, whose halves are compared as numbers.
fn index(entries: &[Entry], names: &str, begin: u64) -> Vec<Place> {
    let mut places = Vec::with_capacity(entries.len());
    places.extend(placed(entries, names, begin).map(|(_, name, offset)| {
        let mut place = [0; 24];
        place[..16].copy_from_slice(&Md5::digest(name));
        place[16..].copy_from_slice(&offset.to_le_bytes());
        place
    }));
    places.sort_unstable_by_key(|place: &Place| {
        let (numbers, _) = place.as_chunks::<8>();
        [0, 1, 2].map(|i| numbers.get(i).map_or(0, |bytes| u64::from_le_bytes(*bytes)))
    });
    places
}

/// A row of the directory.
fn row(entry: &Entry, name: &str, offset: u64) -> Vec<u8> {
    let small = u32::try_from(offset).ok().filter(|offset| *offset != LARGE_4);
    let (version, extra) = if small.is_some() { (PLAIN, 0) } else { (ZIP64, 12) };
    let mut row = Record(b"PK\x01\x02".to_vec());
    // Made by a system without permissions of files.
    row.u16(version).u16(version).facts(entry).u16(extra);
    // No comment, on the first disk, no attributes.
    row.u16(0).u16(0).u16(0).u32(0).u32(small.unwrap_or(LARGE_4)).bytes(name.as_bytes());
    if small.is_none() {
        row.u16(1).u16(8).u64(offset);
    }
    row.0
}

/// The end of an archive whose directory lies from `begin` to `end`.
fn end(count: u64, begin: u64, end: u64) -> Vec<u8> {
    let len = end - begin;
    let few = u16::try_from(count).unwrap_or(LARGE_2);
    let [short, near] = [len, begin].map(|number| u32::try_from(number).unwrap_or(LARGE_4));
    let mut record = Record(Vec::new());
    if few == LARGE_2 || [short, near].contains(&LARGE_4) {
        record.bytes(b"PK\x06\x06").u64(44).u16(ZIP64).u16(ZIP64).u32(0).u32(0);
        record.u64(count).u64(count).u64(len).u64(begin);
        // Where that is, on one disk.
        record.bytes(b"PK\x06\x07").u32(0).u64(end).u32(1);
    }
    record.bytes(b"PK\x05\x06").u16(0).u16(0).u16(few).u16(few).u32(short).u32(near).u16(0);
    record.0
}

/// Numbers as a ZIP has them.
struct Record(Vec<u8>);

impl Record {
    fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.0.extend_from_slice(bytes);
        self
    }

    fn u16(&mut self, number: u16) -> &mut Self {
        self.bytes(&number.to_le_bytes())
    }

    fn u32(&mut self, number: u32) -> &mut Self {
        self.bytes(&number.to_le_bytes())
    }

    fn u64(&mut self, number: u64) -> &mut Self {
        self.bytes(&number.to_le_bytes())
    }

    /// Fields that a file's header and its row of the directory share: no flags, stored, midnight of a day.
    fn facts(&mut self, entry: &Entry) -> &mut Self {
        let Entry { crc, len, name_len } = *entry;
        self.u16(0).u16(0).u16(0).u16(DAY).u32(crc).u32(len).u32(len).u16(name_len)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Seek, SeekFrom};

    fn number<const N: usize>(bytes: &[u8], at: usize) -> u64 {
        bytes[at..at + N].iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte))
    }

    /// Bytes of a path, found as a reader does: by a binary search of the index, which the directory's last row leads to.
    fn find<'a>(bytes: &'a [u8], begin: u64, index: &[u8], path: &str) -> Option<&'a [u8]> {
        let hash = Md5::digest(path);
        let key = |at: &[u8]| (number::<8>(at, 0), number::<8>(at, 8));
        let places: Vec<&[u8]> = index.chunks(24).collect();
        assert!(places.is_sorted_by_key(|place| key(place)));
        let at = places.binary_search_by_key(&key(&hash), |place| key(place)).ok()?;
        let at = (number::<8>(places[at], 16) - begin) as usize;
        assert_eq!(&bytes[at..at + 4], b"PK\x03\x04");
        let (len, name) = (number::<4>(bytes, at + 18) as usize, number::<2>(bytes, at + 26) as usize);
        assert_eq!((&bytes[at + 30..at + 30 + name], number::<2>(bytes, at + 28)), (path.as_bytes(), 0));
        let found = &bytes[at + 30 + name..at + 30 + name + len];
        assert_eq!(number::<4>(bytes, at + 14), u64::from(crc32fast::hash(found)));
        Some(found)
    }

    /// The last row of the directory, and where the directory begins, how long it is and how many rows it has.
    fn directory(bytes: &[u8], begin: u64) -> (&[u8], [u64; 3]) {
        let end = bytes.len() - 22;
        assert_eq!(&bytes[end..end + 4], b"PK\x05\x06");
        let mut numbers =
            [number::<4>(bytes, end + 16), number::<4>(bytes, end + 12), number::<2>(bytes, end + 10)];
        let locator = end - 20;
        if &bytes[locator..locator + 4] == b"PK\x06\x07" {
            let at = (number::<8>(bytes, locator + 8) - begin) as usize;
            assert_eq!((&bytes[at..at + 4], at + 56), (&b"PK\x06\x06"[..], locator));
            numbers = [48, 40, 32].map(|field| number::<8>(bytes, at + field));
        }
        let last = bytes.windows(4).rposition(|word| word == b"PK\x01\x02").expect("a row");
        (&bytes[last..], numbers)
    }

    fn index_of(bytes: &[u8], begin: u64) -> &[u8] {
        let (row, _) = directory(bytes, begin);
        assert_eq!(&row[46..46 + INDEX.len()], INDEX.as_bytes());
        let small = number::<4>(row, 42);
        let at = if small == u64::from(LARGE_4) { number::<8>(row, 46 + INDEX.len() + 4) } else { small };
        let at = (at - begin) as usize;
        &bytes[at + 30 + INDEX.len()..][..number::<4>(bytes, at + 18) as usize]
    }

    fn filled(begin: u64, count: usize) -> Vec<u8> {
        let mut archive = Archive { begin, end: begin, ..Archive::new(Vec::new()) };
        for i in 0..count {
            archive.add(&format!("tiles/{i}"), &vec![i as u8; i % 7 + 1]).unwrap();
        }
        archive.finish().unwrap().0
    }

    #[test]
    fn files_are_found_by_the_index() {
        // Few, many, and few that begin just before and behind the end of four bytes.
        for (begin, count) in [
            (0, 3),
            (0, 65_533),
            (0, 70_000),
            (LARGE_4.into(), 9),
            (u64::from(LARGE_4) - 100, 9),
            (9 << 40, 9),
        ] {
            let bytes = filled(begin, count);
            let (_, [at, len, rows]) = directory(&bytes, begin);
            assert_eq!(rows, count as u64 + 1);
            assert_eq!(&bytes[(at - begin) as usize..][..4], b"PK\x01\x02");
            let is_large = begin > 0 || count > 65_533;
            let ends = if is_large { 98 } else { 22 };
            assert_eq!(at - begin + len + ends, bytes.len() as u64);
            let index = index_of(&bytes, begin);
            assert_eq!(index.len(), 24 * count);
            for i in (0..count).step_by(count / 3) {
                let found = find(&bytes, begin, index, &format!("tiles/{i}"));
                assert_eq!(found, Some(&vec![i as u8; i % 7 + 1][..]), "{begin} {count} {i}");
            }
            assert_eq!(find(&bytes, begin, index, "tiles/none"), None);
        }
    }

    /// In a file with a hole in front, so that only offsets are large.
    #[test]
    fn python_reads_what_lies_beyond_four_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large.3tz");
        let mut file = std::fs::File::create(&path).unwrap();
        let begin = (1 << 32) - 20;
        file.seek(SeekFrom::Start(begin)).unwrap();
        file.write_all(&filled(begin, 9)).unwrap();
        let read = "import sys, zipfile; z = zipfile.ZipFile(sys.argv[1]); assert z.testzip() is None; \
                    print(len(z.infolist()), z.read('tiles/8') == bytes([8, 8]))";
        match std::process::Command::new("python3").args(["-c", read]).arg(&path).output() {
            Ok(out) => assert_eq!(out.stdout.trim_ascii(), b"10 True", "{}", out.stderr.escape_ascii()),
            Err(_) => println!("skipped: no python3"),
        }
    }

    #[test]
    fn a_path_that_is_too_long_is_refused() {
        let error = Archive::new(Vec::new()).add(&"x".repeat(65_536), b"").unwrap_err().to_string();
        assert!(error.contains("65535 bytes in a path") && error.contains("folder"), "{error}");
    }

    #[test]
    fn a_full_sink_is_an_error() {
        let mut room = [0; 40];
        let mut archive = Archive::new(&mut room[..]);
        let error = archive.add("a", &[0; 40]).unwrap_err().to_string();
        assert!(error.contains("3D Tiles archive"), "{error}");
    }
}
