//! Names of formats without a reader, by a file's first bytes: so that a refusal can name it and a remedy.

use super::format::{Format, first_line, is_text, read_formats, without_mark};
use super::lines::words;
use super::reader::Start;
use std::fmt;

/// A file that is not read.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Foreign {
    /// With its article, as in `an OFF mesh`.
    what: &'static str,
    remedy: &'static str,
}

const CONVERT: &str = "convert it, for example with MeshLab or Blender";
const TESSELLATE: &str = "have a CAD program, such as FreeCAD, write its surface as triangles";
const RECONSTRUCT: &str =
    "reconstruct a surface from the points first, for example with MeshLab or CloudCompare";
const UNPACK: &str = "unpack it and name the mesh in it";
const NO_MESH: &str = "name a mesh";

/// First bytes of formats, their names, and remedies.
const MAGICS: [(&[u8], &str, &str); 44] = [
    (b"\x89CHPM", "a .chpm file, which is built already", "look at it with chpm info or chpm view"),
    (b"Kaydara FBX Binary", "an FBX scene", CONVERT),
    (b"; FBX", "an FBX scene as text", CONVERT),
    (b"BLENDER", "a Blender file", "export it from Blender as PLY or OBJ"),
    (b"PXR-USDC", "a USD scene", CONVERT),
    (b"#usda", "a USD scene as text", CONVERT),
    (b"#VRML", "a VRML scene", CONVERT),
    (b"#X3D", "an X3D scene", CONVERT),
    (b"DRACO", "a Draco mesh", CONVERT),
    (b"MMMesh", "an OpenCTM mesh", CONVERT),
    (b"OCTM", "an OpenCTM mesh", CONVERT),
    (b"nxs ", "a Nexus model", CONVERT),
    (b"# vtk DataFile", "a VTK file", "have ParaView save its surface as PLY or STL"),
    (b"<VTKFile", "a VTK file", "have ParaView save its surface as PLY or STL"),
    (b"$MeshFormat", "a Gmsh mesh", "have Gmsh export its surface as STL or PLY"),
    (b"MeshVersionFormatted", "a Medit mesh", CONVERT),
    (b"ISO-10303-21", "a STEP model", TESSELLATE),
    (b"DBRep_DrawableShape", "a BREP model", TESSELLATE),
    (b"LASF", "LAS or LAZ, a point cloud", RECONSTRUCT),
    (b"ASTM-E57", "E57, a point cloud", RECONSTRUCT),
    (b"# .PCD", "PCD, a point cloud", RECONSTRUCT),
    (b"II*\0", "a TIFF image", "make a mesh of its heights first"),
    (b"MM\0*", "a TIFF image", "make a mesh of its heights first"),
    (b"II+\0", "a BigTIFF image", "make a mesh of its heights first"),
    (b"MM\0+", "a BigTIFF image", "make a mesh of its heights first"),
    (b"\x89PNG", "a PNG image", NO_MESH),
    (b"\xff\xd8\xff", "a JPEG image", NO_MESH),
    (b"GIF8", "a GIF image", NO_MESH),
    (b"v/1\x01", "an EXR image", NO_MESH),
    (b"\x89HDF", "HDF5 data", NO_MESH),
    (b"SIMPLE  =", "FITS data", NO_MESH),
    (b"%PDF", "a PDF document", NO_MESH),
    (b"\x7fELF", "a program", NO_MESH),
    (b"PK\x03\x04", "a ZIP archive", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", UNPACK),
    (b"Rar!", "a RAR archive", UNPACK),
    (b"\xfd7zXZ\0", "an XZ file", "unpack it, or pack it with gzip or zstd"),
    (b"\x1f\x8b", "a gzip file, packed once more", "unpack it once"),
    (b"\x28\xb5\x2f\xfd", "a zstd file, packed once more", "unpack it once"),
    (b"BZh", "a bzip2 file", "unpack it, or pack it with gzip or zstd"),
    (b"\x04\x22\x4d\x18", "an LZ4 file", "unpack it, or pack it with gzip or zstd"),
    (b"version https://git-lfs", "a pointer of Git LFS, not the file itself", "fetch that with git lfs pull"),
    (b"<!DOCTYPE", "a web page, not the file that was to be downloaded", "download it again"),
    (b"<html", "a web page, not the file that was to be downloaded", "download it again"),
];

impl Foreign {
    /// Recognizes an input that is of none of the formats that are read, by its first bytes and its length, if that is known.
    /// None for what a reader is for, or for what `extension` says is a format without a beginning of its own.
    pub fn detect(input: &Start<'_>) -> Option<Foreign> {
        let Start { head, extension, .. } = *input;
        let named = |what, remedy| Some(Foreign { what, remedy });
        if head.is_empty() {
            return named("an empty file", "copy it again");
        }
        if Format::is_certain(input) {
            return None;
        }
        if is_wide(head) {
            return named("text in UTF-16 or UTF-32", "save it as UTF-8, or as ASCII");
        }
        let start = without_mark(head);
        if let Some((magic, what, remedy)) = MAGICS.iter().find(|(magic, ..)| start.starts_with(magic)) {
            let is_3mf = *magic == b"PK\x03\x04" && has(head, b"3D/3dmodel.model");
            let is_office = *magic == b"PK\x03\x04" && has(head, b"[Content_Types].xml");
            return match (is_3mf, is_office) {
                (true, _) => named("a 3MF model", CONVERT),
                (_, true) if extension.is_some_and(|name| name.eq_ignore_ascii_case("3mf")) => {
                    named("a 3MF model", CONVERT)
                }
                _ => named(what, remedy),
            };
        }
        if head.get(257..262) == Some(b"ustar") {
            return named("a tar archive", UNPACK);
        }
        if is_text(head) {
            return of_text(start, input);
        }
        match Format::detect(input).is_fallback() {
            true => named("of no format that is known", "name a mesh"),
            false => None,
        }
    }

    /// A list of meshes in a list of meshes.
    pub fn list_in_list() -> Foreign {
        Foreign { what: "a list of meshes, which no other list may name", remedy: "name its meshes" }
    }
}

/// Recognizes a text.
fn of_text(head: &[u8], input: &Start<'_>) -> Option<Foreign> {
    fn named(what: &'static str, remedy: &'static str) -> Option<Foreign> {
        Some(Foreign { what, remedy })
    }
    let line = first_line(head);
    let first = words(line).next().unwrap_or_default();
    if head.trim_ascii_start().first() == Some(&b'{') {
        return if Format::is_likely(input) { None } else { named("JSON", CONVERT) };
    }
    if first.starts_with(b"<") {
        let xml = [
            (&b"<COLLADA"[..], "a COLLADA scene"),
            (b"<X3D", "an X3D scene"),
            (b"<VTKFile", "a VTK file"),
            (b"<amf", "an AMF model"),
            (b"<LandXML", "a LandXML surface"),
            (b"CityGML", "a CityGML model"),
            (b"<html", "a web page, not the file that was to be downloaded"),
        ];
        let found = xml.iter().find(|(word, _)| has(head, word));
        return named(found.map_or("XML", |(_, what)| what), CONVERT);
    }
    if !Format::detect(&Start { head, ..*input }).is_fallback() {
        return None;
    }
    fn is_number(word: &[u8]) -> bool {
        std::str::from_utf8(word).is_ok_and(|word| word.parse::<f64>().is_ok())
    }
    let is_row = |line: &[u8]| {
        let cells = line.split(|byte| byte.is_ascii_whitespace() || matches!(byte, b',' | b';'));
        let mut cells = cells.filter(|cell| !cell.is_empty()).peekable();
        cells.peek().is_some() && cells.all(is_number)
    };
    if is_row(line) {
        return named("rows of numbers, most likely a point cloud as text", RECONSTRUCT);
    }
    // Text of any language has blanks and line ends; what is mostly beyond ASCII without being UTF-8 is none.
    let is_binary = std::str::from_utf8(head).is_err_and(|error| error.error_len().is_some())
        && 2 * head.iter().filter(|byte| byte.is_ascii()).count() < head.len();
    if is_binary {
        named("of no format that is known", NO_MESH)
    } else {
        named("text that is no mesh", NO_MESH)
    }
}

/// Whether this is text of two or four bytes a character: by its mark, or since every other byte, or three of four, is zero.
fn is_wide(head: &[u8]) -> bool {
    /// Characters that are looked at.
    const SOME: usize = 32;
    let is_text = |byte: u8| matches!(byte, b'\t'..=b'\r' | b' '..=b'~');
    let is = |width: usize, of_text: usize| {
        let mut characters = head.chunks_exact(width).take(SOME);
        let is_one = |character: &[u8]| {
            character
                .iter()
                .enumerate()
                .all(|(at, byte)| if at == of_text { is_text(*byte) } else { *byte == 0 })
        };
        head.len() >= 4 * width && characters.all(is_one)
    };
    let is_marked = head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff");
    is_marked || head.starts_with(b"\0\0\xfe\xff") || is(2, 0) || is(2, 1) || is(4, 0) || is(4, 3)
}

fn has(head: &[u8], wanted: &[u8]) -> bool {
    head.windows(wanted.len()).any(|bytes| bytes == wanted)
}

impl fmt::Display for Foreign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Foreign { what, remedy } = self;
        write!(f, "this is {what}; what is read is {}: {remedy}", read_formats())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn description(head: &[u8], extension: Option<&str>) -> Option<&'static str> {
        Foreign::detect(&Start { head, len: Some(head.len() as u64), extension }).map(|foreign| foreign.what)
    }

    #[test]
    fn what_is_not_read_is_named() {
        let tar = [&[b'a'; 257][..], b"ustar\0"].concat();
        let wide = |text: &str| text.encode_utf16().flat_map(u16::to_be_bytes).collect::<Vec<u8>>();
        let cases: [(&[u8], Option<&str>, &str); 19] = [
            (b"\x1f\x8b\x08\0", Some("ply"), "a gzip file, packed once more"),
            (&wide("v 0 0 0\nv 1 0 0\n"), Some("obj"), "text in UTF-16 or UTF-32"),
            (b"s\0o\0l\0i\0d\0 \0a\0\n\0", Some("stl"), "text in UTF-16 or UTF-32"),
            (b"\xff\xfe\0\0p\0\0\0l\0\0\0y\0\0\0", Some("ply"), "text in UTF-16 or UTF-32"),
            (b"", Some("stl"), "an empty file"),
            (b" {\"version\": \"2.0\"}", Some("obj"), "JSON"),
            (b"PK\x03\x04....3D/3dmodel.model", None, "a 3MF model"),
            (b"PK\x03\x04....[Content_Types].xml", Some("3mf"), "a 3MF model"),
            (b"PK\x03\x04....scan.ply", None, "a ZIP archive"),
            (b"# vtk DataFile Version 3.0\no\nASCII\n", Some("obj"), "a VTK file"),
            (b"<?xml version=\"1.0\"?>\n<COLLADA>", Some("dae"), "a COLLADA scene"),
            (
                b"\xef\xbb\xbf<!DOCTYPE html>",
                Some("ply"),
                "a web page, not the file that was to be downloaded",
            ),
            (b"0.5, 1.25, -3e2, 7\n", Some("xyz"), "rows of numbers, most likely a point cloud as text"),
            (b"hello", Some("ply"), "text that is no mesh"),
            (b"plywood", None, "text that is no mesh"),
            (&[0x01; 90], None, "of no format that is known"),
            (&[0x89; 90], None, "of no format that is known"),
            ("Dreiecksnetz für Köln".as_bytes(), None, "text that is no mesh"),
            (&tar, Some("ply"), "a tar archive"),
        ];

        for (head, extension, what) in cases {
            assert_eq!(description(head, extension), Some(what), "{}", head.escape_ascii());
        }
    }

    #[test]
    fn what_is_read_is_not_foreign() {
        let mut stl = b"glTF".to_vec();
        stl.resize(80, b' ');
        stl.extend([0; 4]);
        let cases: [(&[u8], Option<&str>); 13] = [
            (b"ply\nformat", None),
            (b"ply", None),
            (&stl, None),
            (b"solid glTF\n", None),
            (b"v 0 0 0", Some("ply")),
            (b"o\nv 0 0 0", None),
            (b"bmesh a.ply 0 0 0 0 0 0 1", None),
            (b"\xef\xbb\xbfOFF\n8 6 0\n", None),
            (b"glTF\x02\0\0\0", None),
            (b" {\"asset\": {\"version\": \"2.0\"}}", None),
            (b"# made by hand\nSTCNOFF\n8 6 0\n", None),
            // What these readers say of it is more.
            (&[0x01; 90], Some("stl")),
            (b"hello", Some("obj")),
        ];
        for (head, extension) in cases {
            assert_eq!(description(head, extension), None, "{}", head.escape_ascii());
        }
    }
}
