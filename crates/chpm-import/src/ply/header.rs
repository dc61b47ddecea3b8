//! The header: what the body holds, line by line.

use super::{
    error::PlyError,
    source::{BLOCK, Source},
};
use crate::batch::MAX_VERTICES;
use crate::format::MARK;
use crate::location::excerpt;
use std::{fmt, io::Read};

/// How the body is written.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Encoding {
    /// Numbers as text.
    Ascii,
    /// Binary, least significant byte first.
    #[default]
    BinaryLittleEndian,
    /// Binary, most significant byte first.
    BinaryBigEndian,
}

impl Encoding {
    pub(super) const ALL: [Encoding; 3] =
        [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian];
}

impl fmt::Display for Encoding {
    /// The name in the format line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Encoding::Ascii => "ascii",
            Encoding::BinaryLittleEndian => "binary_little_endian",
            Encoding::BinaryBigEndian => "binary_big_endian",
        })
    }
}

/// Type of a number.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ScalarType {
    /// `char` or `int8`.
    Char,
    /// `uchar` or `uint8`.
    UChar,
    /// `short` or `int16`.
    Short,
    /// `ushort` or `uint16`.
    UShort,
    /// `int` or `int32`.
    Int,
    /// `uint` or `uint32`.
    UInt,
    /// `float` or `float32`.
    Float,
    /// `double` or `float64`.
    Double,
}

impl ScalarType {
    /// Bytes of a number in a binary body.
    pub fn size(self) -> usize {
        match self {
            ScalarType::Char | ScalarType::UChar => 1,
            ScalarType::Short | ScalarType::UShort => 2,
            ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
            ScalarType::Double => 8,
        }
    }

    /// Whether this is one of the six integer types.
    pub fn is_integer(self) -> bool {
        self.range().is_some()
    }

    /// Whether there are values that an f32 rounds.
    pub(super) fn exceeds_single(self) -> bool {
        matches!(self, ScalarType::Double | ScalarType::Int | ScalarType::UInt)
    }

    /// Least and greatest value of an integer type.
    pub(super) fn range(self) -> Option<(i64, i64)> {
        Some(match self {
            ScalarType::Char => (i8::MIN.into(), i8::MAX.into()),
            ScalarType::UChar => (0, u8::MAX.into()),
            ScalarType::Short => (i16::MIN.into(), i16::MAX.into()),
            ScalarType::UShort => (0, u16::MAX.into()),
            ScalarType::Int => (i32::MIN.into(), i32::MAX.into()),
            ScalarType::UInt => (0, u32::MAX.into()),
            ScalarType::Float | ScalarType::Double => return None,
        })
    }

    /// Description of a valid text of this type, for errors.
    pub(super) fn expectation(self) -> &'static str {
        match self {
            ScalarType::Char => "a whole number from -128 to 127",
            ScalarType::UChar => "a whole number from 0 to 255",
            ScalarType::Short => "a whole number from -32768 to 32767",
            ScalarType::UShort => "a whole number from 0 to 65535",
            ScalarType::Int => "a whole number from -2147483648 to 2147483647",
            ScalarType::UInt => "a whole number from 0 to 4294967295",
            ScalarType::Float | ScalarType::Double => "a number",
        }
    }

    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => ScalarType::Char,
            "uchar" | "uint8" => ScalarType::UChar,
            "short" | "int16" => ScalarType::Short,
            "ushort" | "uint16" => ScalarType::UShort,
            "int" | "int32" => ScalarType::Int,
            "uint" | "uint32" => ScalarType::UInt,
            "float" | "float32" => ScalarType::Float,
            "double" | "float64" => ScalarType::Double,
            _ => return None,
        })
    }
}

impl fmt::Display for ScalarType {
    /// The older of the two names.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ScalarType::Char => "char",
            ScalarType::UChar => "uchar",
            ScalarType::Short => "short",
            ScalarType::UShort => "ushort",
            ScalarType::Int => "int",
            ScalarType::UInt => "uint",
            ScalarType::Float => "float",
            ScalarType::Double => "double",
        })
    }
}

/// Type of a property.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PropertyType {
    /// One number.
    Scalar(ScalarType),
    /// A length and that many numbers.
    List {
        /// Type of the length, an integer type.
        count: ScalarType,
        /// Type of the numbers.
        item: ScalarType,
    },
}

/// A property of an element.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Property {
    /// Its name, unique in the element.
    pub name: String,
    /// Type.
    pub ty: PropertyType,
}

/// A kind of thing in the body.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Element {
    /// Its name, unique in the file.
    pub name: String,
    /// How many the header promises.
    pub count: u64,
    /// Its properties in the order of the body.
    pub properties: Vec<Property>,
}

/// A parsed header.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Header {
    /// How the body is written.
    pub format: Encoding,
    /// The elements in the order of the body.
    pub elements: Vec<Element>,
    /// The comments, at most [`Header::MAX_NOTES`].
    pub comments: Vec<String>,
    /// The `obj_info` lines, at most [`Header::MAX_NOTES`].
    pub obj_info: Vec<String>,
    /// Elements `vertex` that are promised, at most [`MAX_VERTICES`].
    pub vertex_count: u64,
    /// Elements `face` that are promised: polygons, not triangles.
    pub face_count: u64,
    /// Elements `tristrips` that are promised: lists, each of any number of strips.
    pub strip_count: u64,
    /// Length of the header in bytes: where the body begins.
    pub len: u64,
}

impl Header {
    /// Bytes that a header may have.
    pub const MAX_LEN: usize = BLOCK;
    /// Comments, and `obj_info` lines, that are kept; more are skipped.
    pub const MAX_NOTES: usize = 256;
    /// Elements that a file may have.
    pub const MAX_ELEMENTS: usize = 256;
    /// Properties that an element may have.
    pub const MAX_PROPERTIES: usize = 1024;

    pub(super) fn parse<R: Read>(source: &mut Source<R>) -> Result<Self, PlyError> {
        let end_of_line = magic(source)?;
        let mut header = Header::default();
        let mut has_format = false;
        loop {
            let number = source.line;
            let line = next_line(source, end_of_line)?;
            let text = String::from_utf8_lossy(line).into_owned();
            let wrong =
                |expected| PlyError::Header { line: number, expected, got: excerpt(text.trim().as_bytes()) };

            // The format comes before all but comments; what it says decides how the rest is read.
            let mut words = words(&text);
            let keyword = words.next();
            match keyword {
                Some("comment") => note(&mut header.comments, &text, "comment"),
                Some("obj_info") => note(&mut header.obj_info, &text, "obj_info"),
                Some("format") if !has_format => {
                    let unknown = || PlyError::Format { line: number, got: excerpt(text.trim().as_bytes()) };
                    let (Some(name), Some("1.0"), None) = (words.next(), words.next(), words.next()) else {
                        return Err(unknown());
                    };
                    let known = Encoding::ALL.into_iter().find(|encoding| encoding.to_string() == name);
                    header.format = known.ok_or_else(unknown)?;
                    has_format = true;
                }
                Some("element") if has_format => {
                    let (Some(name), Some(count), None) = (words.next(), words.next(), words.next()) else {
                        return Err(wrong("'element <name> <count>'"));
                    };
                    let count = count.parse().map_err(|_| wrong("a count of elements from 0"))?;
                    header.add_element(name, count).map_err(wrong)?;
                }
                Some("property") if has_format => {
                    let property = property(words).map_err(wrong)?;
                    header.add_property(property).map_err(wrong)?;
                }
                Some("end_header") if has_format => break,
                None if line_is_blank(&text) => {}
                _ if has_format => return Err(wrong("element, property, comment, obj_info or end_header")),
                _ => return Err(wrong("a format line first, as in 'format ascii 1.0'")),
            }
        }

        header.len = source.offset();
        if header.vertex_count > MAX_VERTICES {
            return Err(PlyError::TooManyVertices { count: header.vertex_count, limit: MAX_VERTICES });
        }
        source.encoding = header.format;
        Ok(header)
    }

    fn add_element(&mut self, name: &str, count: u64) -> Result<(), &'static str> {
        if self.elements.iter().any(|element| element.name == name) {
            return Err("an element that was not declared before");
        }
        if self.elements.len() == Self::MAX_ELEMENTS {
            return Err("at most 256 elements");
        }
        match name {
            "vertex" => self.vertex_count = count,
            "face" => self.face_count = count,
            "tristrips" => self.strip_count = count,
            _ => {}
        }
        self.elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
        Ok(())
    }

    fn add_property(&mut self, property: Property) -> Result<(), &'static str> {
        let element = self.elements.last_mut().ok_or("an element before its properties")?;
        if element.properties.iter().any(|other| other.name == property.name) {
            return Err("a property that the element does not have yet");
        }
        if element.properties.len() == Self::MAX_PROPERTIES {
            return Err("at most 1024 properties of an element");
        }
        element.properties.push(property);
        Ok(())
    }
}

/// The words of a line, apart where those of the body are: at vertical tabs, too.
pub(super) fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split([' ', '\t', '\n', '\u{b}', '\u{c}', '\r']).filter(|word| !word.is_empty())
}

fn line_is_blank(text: &str) -> bool {
    text.trim().is_empty()
}

fn note(notes: &mut Vec<String>, text: &str, keyword: &str) {
    if notes.len() < Header::MAX_NOTES {
        let text = text.trim_start();
        notes.push(text.strip_prefix(keyword).unwrap_or(text).trim().to_owned());
    }
}

fn property<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Property, &'static str> {
    const LINE: &str = "'property <type> <name>' or 'property list <type> <type> <name>'";
    const TYPE: &str = "a type: char, uchar, short, ushort, int, uint, float or double";
    let mut word = || words.next().ok_or(LINE);
    fn scalar(name: &str) -> Result<ScalarType, &'static str> {
        ScalarType::parse(name).ok_or(TYPE)
    }
    let first = word()?;
    let ty = if first == "list" {
        let (count, item) = (scalar(word()?)?, scalar(word()?)?);
        if !count.is_integer() {
            return Err("an integer type for the length of a list");
        }
        PropertyType::List { count, item }
    } else {
        PropertyType::Scalar(scalar(first)?)
    };
    let name = word()?.to_owned();
    if word().is_ok() { Err(LINE) } else { Ok(Property { name, ty }) }
}

/// Consumes the first line, and says what ends the lines of this header.
///
/// A header of CR lines must be told from one of CRLF lines at once: after `end_header`, a line feed may be binary data.
fn magic<R: Read>(source: &mut Source<R>) -> Result<u8, PlyError> {
    fn read(offset: u64, source: std::io::Error) -> PlyError {
        PlyError::Read { offset, source }
    }
    source.need(MARK.len() + 5).map_err(|error| read(0, error))?;
    if source.bytes().starts_with(MARK) {
        source.consume(MARK.len());
    }
    let (end_of_line, length) = match source.bytes() {
        [b'p', b'l', b'y', b'\r', b'\n', ..] => (b'\n', 5),
        [b'p', b'l', b'y', b'\r', ..] => (b'\r', 4),
        [b'p', b'l', b'y', b'\n', ..] => (b'\n', 4),
        // Some writers leave blanks.
        [b'p', b'l', b'y', b' ' | b'\t', ..] => {
            let line = next_line(source, b'\n')?;
            if line[3..].iter().any(|byte| !byte.is_ascii_whitespace()) {
                return Err(PlyError::NotPly);
            }
            return Ok(b'\n');
        }
        [b'p', b'l', b'y'] => return Err(PlyError::HeaderTruncated { offset: 3 }),
        _ => return Err(PlyError::NotPly),
    };
    source.consume(length);
    source.line += 1;
    Ok(end_of_line)
}

/// Consumes a line of the header.
fn next_line<R: Read>(source: &mut Source<R>, end_of_line: u8) -> Result<&[u8], PlyError> {
    let too_long = PlyError::HeaderTooLong { limit: Header::MAX_LEN };
    let mut length = 0;
    loop {
        let rest = &source.bytes()[length..];
        let found = rest.iter().position(|&byte| byte == end_of_line);
        length += found.map_or(rest.len(), |at| at + 1);
        if source.offset() + length as u64 > Header::MAX_LEN as u64 {
            return Err(too_long);
        }

        if found.is_some() {
            break;
        }
        let offset = source.read_offset();
        if offset >= Header::MAX_LEN as u64 {
            return Err(too_long);
        }
        if !source.more().map_err(|error| PlyError::Read { offset, source: error })? {
            return Err(PlyError::HeaderTruncated { offset });
        }
    }

    source.consume(length);
    source.line += 1;
    Ok(source.consumed(length))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Header, PlyError> {
        Header::parse(&mut Source::new(text.as_bytes()))
    }

    const HEADER: &str = "ply\nformat ascii 1.0\ncomment  by hand \nobj_info 7\nelement vertex 3\n\
        property float x\nproperty list uint8 float64 w\nelement face 1\ncomment\nend_header\n";

    #[test]
    fn line_ends_do_not_matter() {
        let header = parse(HEADER).unwrap();
        assert_eq!(header.comments, ["by hand", ""]);
        assert_eq!(header.obj_info, ["7"]);
        assert_eq!((header.vertex_count, header.face_count, header.strip_count), (3, 1, 0));
        assert_eq!(header.elements[0].properties[0].ty, PropertyType::Scalar(ScalarType::Float));
        let list = PropertyType::List { count: ScalarType::UChar, item: ScalarType::Double };
        assert_eq!(header.elements[0].properties[1], Property { name: "w".into(), ty: list });
        for end in ["\r\n", "\r", " \t\n"] {
            let text = HEADER.replace('\n', end);
            let same = Header { len: header.len, ..parse(&text).unwrap() };
            assert_eq!(same, header, "{end:?}");
        }
        // Nor does what is between words.
        let spread = HEADER.replace("vertex 3", "vertex\x0b3\x0c").replace("float x", "float \x0bx");
        assert_eq!(Header { len: header.len, ..parse(&spread).unwrap() }, header);
    }

    #[test]
    fn a_carriage_return_ends_the_header_where_the_first_line_does() {
        for (text, body) in [
            ("ply\rformat ascii 1.0\rend_header\r\n1", "\n1"),
            ("ply\r\nformat ascii 1.0\r\nend_header\r\n\n1", "\n1"),
            ("ply\nformat ascii 1.0\nend_header\n\r1", "\r1"),
        ] {
            let mut source = Source::new(text.as_bytes());
            Header::parse(&mut source).unwrap();
            assert_eq!(source.bytes(), body.as_bytes());
        }
    }

    #[test]
    fn wrong_lines_are_named() {
        for (from, to, line) in [
            ("property float x", "property floot x", 6),
            ("property float x", "property float", 6),
            ("property float x", "property float x y", 6),
            ("list uint8", "list float", 7),
            ("property float x", "element vertex 3", 6),
            ("element vertex 3", "element vertex -3", 5),
            ("element vertex 3", "element vertex", 5),
            ("element vertex 3", "element vertex 99999999999999999999", 5),
            ("element vertex 3", "comment", 6),
            ("float64 w", "float64 x", 7),
            ("obj_info 7", "junk \u{1}", 4),
            ("format ascii 1.0\n", "", 4),
            ("obj_info 7", "format ascii 1.0", 4),
        ] {
            match parse(&HEADER.replacen(from, to, 1)) {
                Err(PlyError::Header { line: at, .. }) => assert_eq!(at, line, "{to}"),
                other => panic!("{to}: {other:?}"),
            }
        }

        for format in ["format ascii 2.0", "format binary_middle_endian 1.0", "format ascii", "format"] {
            let result = parse(&HEADER.replace("format ascii 1.0", format));
            assert!(matches!(result, Err(PlyError::Format { line: 2, .. })), "{format}");
        }
    }

    #[test]
    fn a_header_has_an_end() {
        for text in ["", "p", "plyx", "plx\n", "ply x\n", "solid cube", "PLY\n"] {
            assert!(matches!(parse(text), Err(PlyError::NotPly)), "{text}");
        }
        assert!(matches!(parse("ply"), Err(PlyError::HeaderTruncated { offset: 3 })));
        assert!(matches!(parse("ply\nformat"), Err(PlyError::HeaderTruncated { offset: 10 })));
        let comments = "comment all work and no play\n".repeat(40_000);
        let long = HEADER.replace("obj_info 7\n", &comments);
        assert!(matches!(parse(&long), Err(PlyError::HeaderTooLong { .. })));
        let endless = HEADER.replace("obj_info 7\n", &"x".repeat(2 << 20));
        assert!(matches!(parse(&endless), Err(PlyError::HeaderTooLong { .. })));
        let fits = HEADER.replace("obj_info 7\n", &comments[..comments.len() / 2]);
        assert_eq!(parse(&fits).unwrap().comments.len(), Header::MAX_NOTES);
    }

    #[test]
    fn too_many_vertices_name_the_limit() {
        let text = HEADER.replace("vertex 3", "vertex 4294967295");
        assert_eq!(parse(&text).unwrap().vertex_count, MAX_VERTICES);
        let text = HEADER.replace("vertex 3", "vertex 4294967296");
        assert!(parse(&text).unwrap_err().to_string().contains("4294967295"));
    }
}
