//! What an input is, by its first bytes.

use super::lines::words;
use std::fmt;

/// The formats that meshes come in.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Format {
    /// Stanford PLY; also the answer where nothing else fits, since its reader says best what is wrong.
    Ply,
    /// STL as records of 50 bytes.
    StlBinary,
    /// STL as text.
    StlAscii,
    /// Wavefront OBJ.
    Obj,
    /// A list of range scans with their poses.
    RangeScans,
}

impl Format {
    /// Bytes of the beginning that [`Format::detect`] makes use of.
    pub const HEAD: usize = 4096;

    /// Tells by the beginning, `head`, of an input of `len` bytes if that is known. The extension of its name decides only
    /// where the content leaves it open: a binary STL begins with 80 bytes of anything.
    pub fn detect(head: &[u8], len: Option<u64>, extension: Option<&str>) -> Format {
        let is_named = |name: &str| extension.is_some_and(|extension| extension.eq_ignore_ascii_case(name));
        if is_ply(head) {
            return Format::Ply;
        }
        if Format::is_binary_stl(head, len) {
            return Format::StlBinary;
        }
        let is_text = is_text(head);
        let begins_solid = words(head).next().is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
        if is_text && begins_solid {
            return Format::StlAscii;
        }
        if is_text && let Some(format) = first_keywords(head) {
            return format;
        }
        match () {
            () if is_named("stl") => Format::StlBinary,
            () if is_named("obj") => Format::Obj,
            () if is_named("conf") => Format::RangeScans,
            () => Format::Ply,
        }
    }

    /// Whether an input of `len` bytes is as long as it is as a binary STL. Its header may be any 80 bytes, also those that another
    /// format or a compressed file begins with.
    pub fn is_binary_stl(head: &[u8], len: Option<u64>) -> bool {
        let promised = head
            .get(80..84)
            .map(|count| 84 + 50 * u64::from(u32::from_le_bytes([count[0], count[1], count[2], count[3]])));
        promised.is_some() && promised == len
    }

    /// Whether an input has what no other format has.
    pub(crate) fn has_magic(head: &[u8], len: Option<u64>) -> bool {
        is_ply(head) || head == b"ply" || Format::is_binary_stl(head, len)
    }
}

fn is_ply(head: &[u8]) -> bool {
    head.starts_with(b"ply") && head.get(3).is_some_and(|byte| matches!(byte, b'\n' | b'\r' | b' '))
}

pub(crate) fn is_text(head: &[u8]) -> bool {
    !head.iter().any(|byte| matches!(byte, 0..=8 | 14..=31))
}

/// The first line that is no comment; empty if there is none.
pub(crate) fn first_line(head: &[u8]) -> &[u8] {
    let mut lines = head.split(|byte| matches!(byte, b'\n' | b'\r'));
    let says = |line: &&[u8]| words(line).next().is_some_and(|word| !word.starts_with(b"#"));
    lines.find(says).unwrap_or_default()
}

/// By the first line that is no comment.
fn first_keywords(head: &[u8]) -> Option<Format> {
    let line = first_line(head);
    let (word, count) = (words(line).next()?, words(line).count());
    match word {
        b"bmesh" | b"camera" if count >= 8 => Some(Format::RangeScans),
        b"v" | b"vn" | b"vt" | b"vp" | b"f" | b"mtllib" | b"usemtl" | b"o" | b"g" | b"s" => Some(Format::Obj),
        _ => None,
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Format::Ply => "ply",
            Format::StlBinary => "stl, binary",
            Format::StlAscii => "stl, ascii",
            Format::Obj => "obj",
            Format::RangeScans => "range scans",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_decides_whatever_the_name() {
        let mut stl = vec![b' '; 80];
        stl[..5].copy_from_slice(b"solid");
        stl.extend(2u32.to_le_bytes());
        let stl_len = Some(84 + 100);
        let cases: [(&[u8], Option<u64>, Format); 10] = [
            (b"ply\nformat", None, Format::Ply),
            (b"ply\r\nformat", None, Format::Ply),
            (b"solid cube\nfacet normal 0 0 1\n", Some(30), Format::StlAscii),
            (b"  SOLID\n", None, Format::StlAscii),
            (&stl, stl_len, Format::StlBinary),
            (b"# made by hand\n\nmtllib x.mtl\nv 0 0 0\n", None, Format::Obj),
            (b"v 1 2 3", None, Format::Obj),
            (b"camera 0 0 0 0 0 0 1\nbmesh a.ply 0 0 0 0 0 0 1\n", None, Format::RangeScans),
            (b"bmesh a.ply 0 0 0 0 0 0 1", None, Format::RangeScans),
            (b"plywood", None, Format::Ply),
        ];
        for (head, len, format) in cases {
            for extension in [None, Some("ply"), Some("dat")] {
                assert_eq!(Format::detect(head, len, extension), format, "{}", head.escape_ascii());
            }
        }
    }

    #[test]
    fn the_name_decides_what_the_content_leaves_open() {
        let garbage = [0x89; 200];
        assert_eq!(Format::detect(&garbage, Some(200), Some("STL")), Format::StlBinary);
        assert_eq!(Format::detect(&garbage, Some(200), Some("ply")), Format::Ply);
        assert_eq!(Format::detect(b"", None, Some("obj")), Format::Obj);
        assert_eq!(Format::detect(b"# nothing\n", None, Some("conf")), Format::RangeScans);
        assert_eq!(Format::detect(b"", None, None), Format::Ply);
    }
}
