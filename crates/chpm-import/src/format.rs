//! The table of formats that are read, and what an input is by its first bytes.

use super::lines::words;
use crate::error::ImportError;
use crate::reader::{MeshReader, Opening, Start};
use crate::stream::Stream;
use crate::texture::Images;
use crate::{conf, gltf, obj, off, ply, stl, tiles};
use chpm_extmem::Cancel;
use std::fmt;
use std::path::{Path, PathBuf};

/// All formats that are read. What an input is, is asked in this order; the first is the answer where nothing else fits, since its
/// reader says best what is wrong.
pub static FORMATS: &[Format] =
    &[ply::FORMAT, stl::FORMAT, gltf::FORMAT, conf::FORMAT, tiles::FORMAT, obj::FORMAT, off::FORMAT];

/// Extensions of compressed files, which come behind those of formats.
pub const COMPRESSED: [&str; 2] = ["gz", "zst"];

/// A format that meshes come in.
pub struct Format {
    /// Name for users.
    pub name: &'static str,
    /// Extensions of such files, in lower case.
    pub extensions: &'static [&'static str],
    /// Whether files of this format are lists of meshes, not meshes.
    pub is_list: bool,
    /// How sure it is that an input is of this format.
    pub(crate) sniff: fn(&Start<'_>) -> Likeness,
    /// Begins to read.
    pub(crate) open: fn(Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError>,
    /// The other files that the one at a path names; no function if none of them does.
    pub(crate) names: Option<NamedFiles>,
}

/// Lists the other files that the one at a path names, with images as they are asked for.
pub(crate) type NamedFiles = fn(Stream, &Path, Images, &Cancel) -> Result<Vec<PathBuf>, ImportError>;

/// How sure a format is that an input is its own.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum Likeness {
    None,
    /// By words that such a file begins with.
    Likely,
    /// By what no other file has.
    Certain,
}

impl Format {
    /// Bytes of the beginning that [`Format::detect`] makes use of.
    pub const HEAD: usize = 4096;

    /// Tells by its beginning what an input is. The extension of its name decides only where the content leaves it open: a binary STL
    /// begins with 80 bytes of anything.
    pub fn detect(start: &Start<'_>) -> &'static Format {
        let content = FORMATS.iter().find(|format| (format.sniff)(start) != Likeness::None);
        let name = || FORMATS.iter().find(|format| format.extensions.iter().any(|it| start.is_named(it)));
        content.or_else(name).unwrap_or(&FORMATS[0])
    }

    /// Whether an input has what no other format has.
    pub(crate) fn is_certain(start: &Start<'_>) -> bool {
        FORMATS.iter().any(|format| (format.sniff)(start) == Likeness::Certain)
    }

    /// Whether an input begins as one of a format that is read does.
    pub(crate) fn is_likely(start: &Start<'_>) -> bool {
        FORMATS.iter().any(|format| (format.sniff)(start) != Likeness::None)
    }

    /// Whether this is the one that is the answer where nothing else fits.
    pub(crate) fn is_fallback(&self) -> bool {
        *self == FORMATS[0]
    }
}

impl PartialEq for Format {
    fn eq(&self, other: &Format) -> bool {
        self.name == other.name
    }
}

impl fmt::Debug for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

/// All extensions of meshes, in lower case and without a dot.
pub fn extensions() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().flat_map(|format| format.extensions.iter().copied())
}

/// The formats in words, for helps and refusals: `PLY, STL or OBJ, as it is or as .gz or .zst, or a Stanford .conf set of scans`.
pub fn read_formats() -> String {
    let (sets, meshes): (Vec<&Format>, Vec<&Format>) = FORMATS.iter().partition(|format| format.is_list);
    let [last, others @ ..] = &meshes.iter().rev().map(|format| format.name).collect::<Vec<_>>()[..] else {
        return String::new();
    };
    let others: Vec<&str> = others.iter().rev().copied().collect();
    let packed = COMPRESSED.map(|extension| format!(".{extension}")).join(" or ");
    let sets: String = sets.iter().map(|format| format!(", or a {}", format.name)).collect();
    format!("{} or {last}, as it is or as {packed}{sets}", others.join(", "))
}

/// The extension of a name in lower case, below one that names a compression.
pub fn extension(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let packed = COMPRESSED.iter().find_map(|packed| name.strip_suffix(packed)?.strip_suffix('.'));
    packed.unwrap_or(&name).rsplit_once('.').map(|(_, extension)| extension.to_owned())
}

pub(crate) fn is_text(head: &[u8]) -> bool {
    !head.iter().any(|byte| matches!(byte, 0..=8 | 14..=31))
}

/// Mark of their encoding that text editors put before what they save.
pub(crate) const MARK: &[u8] = b"\xef\xbb\xbf";

/// A text without that mark.
pub(crate) fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(MARK).unwrap_or(text)
}

/// The first line that is no comment; empty if there is none.
pub(crate) fn first_line(head: &[u8]) -> &[u8] {
    let mut lines = without_mark(head).split(|byte| matches!(byte, b'\n' | b'\r'));
    fn says(line: &&[u8]) -> bool {
        words(line).next().is_some_and(|word| !word.starts_with(b"#"))
    }
    lines.find(says).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn detect(head: &[u8], len: Option<u64>, extension: Option<&str>) -> &'static str {
        Format::detect(&Start { head, len, extension }).name
    }

    #[test]
    fn content_decides_whatever_the_name() {
        let mut stl = vec![b' '; 80];
        stl[..5].copy_from_slice(b"solid");
        stl.extend(2u32.to_le_bytes());
        let stl_len = Some(84 + 100);
        let cases: [(&[u8], Option<u64>, &str); 10] = [
            (b"ply\nformat", None, "PLY"),
            (b"ply\r\nformat", None, "PLY"),
            (b"solid cube\nfacet normal 0 0 1\n", Some(30), "STL"),
            (b"  SOLID\n", None, "STL"),
            (&stl, stl_len, "STL"),
            (b"# made by hand\n\nmtllib x.mtl\nv 0 0 0\n", None, "OBJ"),
            (b"v 1 2 3", None, "OBJ"),
            (b"camera 0 0 0 0 0 0 1\nbmesh a.ply 0 0 0 0 0 0 1\n", None, conf::FORMAT.name),
            (b"bmesh a.ply 0 0 0 0 0 0 1", None, conf::FORMAT.name),
            (b"plywood", None, "PLY"),
        ];

        for (head, len, format) in cases {
            for extension in [None, Some("ply"), Some("dat")] {
                assert_eq!(detect(head, len, extension), format, "{}", head.escape_ascii());
            }
        }
    }

    #[test]
    fn the_name_decides_what_the_content_leaves_open() {
        let garbage = [0x89; 200];
        assert_eq!(detect(&garbage, Some(200), Some("STL")), "STL");
        assert_eq!(detect(&garbage, Some(200), Some("ply")), "PLY");
        assert_eq!(detect(b"", None, Some("obj")), "OBJ");
        assert_eq!(detect(b"# nothing\n", None, Some("conf")), conf::FORMAT.name);
        assert_eq!(detect(b"", None, None), "PLY");
    }

    #[test]
    fn words_and_extensions_come_from_the_table() {
        let told = read_formats();
        for format in FORMATS {
            assert!(told.contains(format.name), "{told}");
        }
        for (path, found) in
            [("a.ply", Some("ply")), ("a.PLY.gz", Some("ply")), ("b/a.x.stl.zst", Some("stl")), ("a", None)]
        {
            assert_eq!(extension(Path::new(path)).as_deref(), found);
        }
    }
}
