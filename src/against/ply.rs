//! PLY: a header that says what follows, and numbers.

use super::mesh::Mesh;
use super::stream::{Stream, real, words};
use anyhow::{Result, bail, ensure};
use std::collections::HashSet;

/// Corners that a polygon may have.
const CORNERS: usize = 1 << 20;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn parse(name: &str) -> Option<Type> {
        Some(match name {
            "char" | "int8" => Type::I8,
            "uchar" | "uint8" => Type::U8,
            "short" | "int16" => Type::I16,
            "ushort" | "uint16" => Type::U16,
            "int" | "int32" => Type::I32,
            "uint" | "uint32" => Type::U32,
            "float" | "float32" => Type::F32,
            "double" | "float64" => Type::F64,
            _ => return None,
        })
    }

    fn is_whole(self) -> bool {
        !matches!(self, Type::F32 | Type::F64)
    }

    fn size(self) -> u64 {
        match self {
            Type::I8 | Type::U8 => 1,
            Type::I16 | Type::U16 => 2,
            Type::I32 | Type::U32 | Type::F32 => 4,
            Type::F64 => 8,
        }
    }
}

/// A property: its name, its type and, of a list, the type of its length.
struct Property {
    name: String,
    of: Type,
    length: Option<Type>,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// Samples of a row of a range grid.
    columns: Option<u64>,
}

/// Reads a PLY; an error is told with its place.
pub(super) fn read(mut stream: Stream, mesh: &mut Mesh<'_>) -> Result<()> {
    let Header { encoding, elements, columns } = header(&mut stream)?;
    let vertices = elements.iter().position(|e| e.name == "vertex");
    let vertex_count = vertices.map_or(0, |at| elements[at].count);
    let has_faces = elements.iter().any(|e| e.name == "face" && e.count > 0);
    let is_grid = |at: usize, e: &Element, columns: u64| {
        let is_behind = vertices.is_some_and(|vertices| vertices < at);
        e.name == "range_grid" && e.count > 0 && !has_faces && is_behind && e.count.is_multiple_of(columns)
    };
    let columns =
        columns.filter(|columns| elements.iter().enumerate().any(|(at, e)| is_grid(at, e, *columns)));
    mesh.is_grid = columns.is_some();
    let mut reader = Reader { stream, encoding, vertices: vertex_count, invalid: HashSet::new() };
    for (at, element) in elements.iter().enumerate() {
        let done = match (element.name.as_str(), columns) {
            ("vertex", _) => {
                let done = reader.vertices(element, mesh)?;
                mesh.end_of_vertices()?;
                done
            }
            ("face", _) => reader.lists(element, mesh, &mut Faces::default())?,
            ("tristrips", _) => reader.lists(element, mesh, &mut Strips::default())?,
            ("range_grid", Some(columns)) if is_grid(at, element, columns) => {
                reader.lists(element, mesh, &mut Grid { columns, ..Grid::default() })?
            }
            _ => reader.skipped(element, mesh)?,
        };
        if done < element.count {
            ensure!(mesh.drops, reader.stream.wrong(END));
            let counts = |e: &Element| matches!(e.name.as_str(), "face" | "tristrips");
            let missing: u64 = elements[at..].iter().filter(|e| counts(e)).map(|e| e.count).sum();
            mesh.counts.missing_faces += missing - if counts(element) { done } else { 0 };
            break;
        }
    }
    Ok(())
}

/// The file ended where a number should be.
const END: &str = "the file ends here, and its header promises more";

struct Reader {
    stream: Stream,
    encoding: Encoding,
    /// Vertices that the header declares.
    vertices: u64,
    /// Those that are not finite.
    invalid: HashSet<u32>,
}

impl Reader {
    /// The next number; none at the end of the file.
    fn number(&mut self, of: Type) -> Result<Option<f64>> {
        let stream = &mut self.stream;
        macro_rules! bytes {
            ($type:ty) => {{
                let from = if self.encoding == Encoding::Big {
                    <$type>::from_be_bytes
                } else {
                    <$type>::from_le_bytes
                };
                Ok(stream.take()?.map(from).map(f64::from))
            }};
        }
        match of {
            _ if self.encoding == Encoding::Ascii => self.text(of),
            Type::I8 => bytes!(i8),
            Type::U8 => bytes!(u8),
            Type::I16 => bytes!(i16),
            Type::U16 => bytes!(u16),
            Type::I32 => bytes!(i32),
            Type::U32 => bytes!(u32),
            Type::F32 => bytes!(f32),
            Type::F64 => bytes!(f64),
        }
    }

    fn text(&mut self, of: Type) -> Result<Option<f64>> {
        let Some(word) = self.stream.word()? else { return Ok(None) };
        let value = match of {
            // Text says what it says, whatever type the header names.
            Type::F32 | Type::F64 => real(word, f64::NAN),
            _ => word.parse::<i64>().ok().map(|value| value as f64),
        };
        if value.is_none() {
            let told = format!("expected a number, got '{}'", word.escape_default());
            bail!(self.stream.wrong(told));
        }
        Ok(value)
    }

    fn length(&mut self, of: Type) -> Result<Option<u64>> {
        match self.number(of)? {
            Some(count) if count < 0.0 => Err(self.stream.wrong("a list of negative length")),
            count => Ok(count.map(|count| count as u64)),
        }
    }

    /// Skips a property; false at the end of the file.
    fn skip(&mut self, property: &Property) -> Result<bool> {
        let count = match property.length {
            None => Some(1),
            Some(length) => self.length(length)?,
        };
        let Some(count) = count else { return Ok(false) };
        if self.encoding != Encoding::Ascii {
            return self.stream.skip(count * property.of.size());
        }
        for _ in 0..count {
            if !self.stream.pass_word()? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Skips all of an element, and answers how many were whole.
    fn skipped(&mut self, element: &Element, mesh: &mut Mesh<'_>) -> Result<u64> {
        if element.properties.is_empty() {
            return Ok(element.count);
        }
        for index in 0..element.count {
            mesh.heed()?;
            for property in &element.properties {
                if !self.skip(property)? {
                    return Ok(index);
                }
            }
        }
        Ok(element.count)
    }

    /// Reads vertices, and answers how many were whole.
    fn vertices(&mut self, element: &Element, mesh: &mut Mesh<'_>) -> Result<u64> {
        let axis = |property: &Property| ["x", "y", "z"].into_iter().position(|axis| axis == property.name);
        let axes: Vec<_> = element.properties.iter().map(|p| (p, axis(p))).collect();
        let of = |at: usize| {
            axes.iter().find(|(p, axis)| *axis == Some(at) && p.length.is_none()).map(|(p, _)| p.of)
        };
        let (Some(x), Some(y), Some(z)) = (of(0), of(1), of(2)) else {
            bail!(self.stream.wrong("vertices without x, y and z"));
        };
        let needs_double = |of: &Type| matches!(of, Type::F64 | Type::I32 | Type::U32);
        let is_double = [x, y, z].iter().any(needs_double);
        let is_text = self.encoding == Encoding::Ascii && [x, y, z].iter().any(|of| !of.is_whole());
        mesh.is_told_single = is_text && !is_double;
        mesh.begin(is_double || is_text)?;
        for index in 0..element.count {
            let mut position = [0.0; 3];
            for (property, axis) in &axes {
                let is_there = match axis {
                    None => self.skip(property)?,
                    Some(axis) => match self.number(property.of)? {
                        None => false,
                        Some(x) => {
                            position[*axis] = x;
                            true
                        }
                    },
                };
                if !is_there {
                    return Ok(index);
                }
            }
            if !position.iter().all(|x| x.is_finite()) {
                ensure!(mesh.drops, self.stream.wrong("a coordinate that is not finite"));
                mesh.counts.dropped_vertices += 1;
                self.invalid.insert(index as u32);
            }
            mesh.vertex(position)?;
        }
        Ok(element.count)
    }

    /// Hands the lists of corners of an element to `lists`, and answers how many were whole.
    fn lists(&mut self, element: &Element, mesh: &mut Mesh<'_>, lists: &mut dyn Lists) -> Result<u64> {
        let named = |name| {
            element.properties.iter().position(|p| p.name == name && p.length.is_some() && p.of.is_whole())
        };
        let Some(wanted) = named("vertex_indices").or_else(|| named("vertex_index")) else {
            bail!(self.stream.wrong(format!("'{}' without a list of corners", element.name)));
        };
        for index in 0..element.count {
            mesh.heed()?;
            for (at, property) in element.properties.iter().enumerate() {
                let is_there = match property.length {
                    Some(length) if at == wanted => match self.length(length)? {
                        None => false,
                        Some(count) => self.list(count, property.of, mesh, lists)?,
                    },
                    _ => self.skip(property)?,
                };
                if !is_there {
                    return Ok(index);
                }
            }
            lists.end(mesh)?;
        }
        Ok(element.count)
    }

    fn list(&mut self, count: u64, of: Type, mesh: &mut Mesh<'_>, lists: &mut dyn Lists) -> Result<bool> {
        for _ in 0..count {
            let Some(index) = self.number(of)? else { return Ok(false) };
            let corner = match index {
                // An unsigned list can hold -1 only as the greatest number.
                i if lists.restarts() && (i == -1.0 || i == f64::from(u32::MAX)) => Corner::Restart,
                i if i >= 0.0 && (i as u64) < self.vertices => match self.invalid.contains(&(i as u32)) {
                    true => Corner::Invalid,
                    false => Corner::Vertex(i as u32),
                },
                i => {
                    let told = || format!("a corner is vertex {i}, and there are {}", self.vertices);
                    ensure!(mesh.drops, self.stream.wrong(told()));
                    Corner::Invalid
                }
            };
            lists.corner(corner, mesh)?;
        }
        Ok(true)
    }
}

#[derive(Clone, Copy)]
enum Corner {
    Vertex(u32),
    /// No vertex, and left out.
    Invalid,
    /// A new strip begins.
    Restart,
}

/// Consumer of lists of corners.
trait Lists {
    fn restarts(&self) -> bool {
        false
    }

    fn corner(&mut self, corner: Corner, mesh: &mut Mesh<'_>) -> Result<()>;

    /// A list, and all else of its element, was read.
    fn end(&mut self, mesh: &mut Mesh<'_>) -> Result<()>;
}

#[derive(Default)]
struct Faces {
    corners: Vec<u32>,
    is_invalid: bool,
}

impl Lists for Faces {
    fn corner(&mut self, corner: Corner, _: &mut Mesh<'_>) -> Result<()> {
        ensure!(self.corners.len() < CORNERS, "a face of the source has more than {CORNERS} corners");
        match corner {
            Corner::Vertex(vertex) => self.corners.push(vertex),
            _ => self.is_invalid = true,
        }
        Ok(())
    }

    fn end(&mut self, mesh: &mut Mesh<'_>) -> Result<()> {
        if self.is_invalid {
            mesh.counts.dropped_faces += 1;
        } else {
            mesh.face(&self.corners)?;
        }
        self.corners.clear();
        self.is_invalid = false;
        Ok(())
    }
}

/// Strips of alternating winding.
#[derive(Default)]
struct Strips {
    last: [Option<u32>; 2],
    /// Corners since the strip began.
    run: u64,
}

impl Lists for Strips {
    fn restarts(&self) -> bool {
        true
    }

    fn corner(&mut self, corner: Corner, mesh: &mut Mesh<'_>) -> Result<()> {
        let corner = match corner {
            Corner::Restart => {
                self.run = 0;
                return Ok(());
            }
            Corner::Vertex(vertex) => Some(vertex),
            Corner::Invalid => None,
        };
        let [a, b] = self.last;
        self.last = [b, corner];
        self.run += 1;
        match (a, b, corner) {
            _ if self.run < 3 => Ok(()),
            (Some(a), Some(b), Some(c)) if self.run % 2 == 1 => mesh.face(&[a, b, c]),
            (Some(a), Some(b), Some(c)) => mesh.face(&[b, a, c]),
            _ => {
                mesh.counts.dropped_faces += 1;
                Ok(())
            }
        }
    }

    fn end(&mut self, _: &mut Mesh<'_>) -> Result<()> {
        self.run = 0;
        Ok(())
    }
}

/// Samples in rows; neighbours make triangles.
#[derive(Default)]
struct Grid {
    columns: u64,
    above: Vec<Option<u32>>,
    row: Vec<Option<u32>>,
    /// First corner of the list.
    sample: Option<Corner>,
}

impl Lists for Grid {
    fn corner(&mut self, corner: Corner, _: &mut Mesh<'_>) -> Result<()> {
        self.sample.get_or_insert(corner);
        Ok(())
    }

    fn end(&mut self, mesh: &mut Mesh<'_>) -> Result<()> {
        let sample = match self.sample.take() {
            Some(Corner::Vertex(vertex)) => Some(vertex),
            _ => None,
        };
        let column = self.row.len();
        self.row.push(sample);
        if column > 0 && !self.above.is_empty() {
            let (a, b, c, d) = (self.above[column - 1], self.above[column], sample, self.row[column - 1]);
            let halves =
                if a.is_some() && c.is_some() { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
            for half in halves {
                if let [Some(a), Some(b), Some(c)] = half
                    && a != b
                    && b != c
                    && c != a
                {
                    mesh.face(&[a, b, c])?;
                }
            }
        }
        if self.row.len() as u64 == self.columns {
            self.above = std::mem::take(&mut self.row);
        }
        Ok(())
    }
}

/// Reads the header, up to the first byte of the body.
fn header(stream: &mut Stream) -> Result<Header> {
    let mut line = Vec::new();
    // What ends the first line ends all of them; a line feed after a carriage return may already belong to the body.
    stream.line_to(|byte| matches!(byte, b'\n' | b'\r'), &mut line)?;
    ensure!(line.trim_ascii_end() == b"ply", stream.wrong("expected 'ply'"));
    let end = if stream.ends_in_return() && stream.peek()? != Some(b'\n') { b'\r' } else { b'\n' };
    if stream.ends_in_return() && end == b'\n' {
        stream.skip(1)?;
    }
    let mut header = Header { encoding: Encoding::Ascii, elements: Vec::new(), columns: None };
    let mut has_format = false;
    loop {
        ensure!(stream.line_to(|byte| byte == end, &mut line)?, stream.wrong("the header has no end"));
        let all: Vec<&str> = words(&line).collect();
        let wrong = || stream.wrong(format!("not understood: '{}'", line.escape_ascii()));
        match all[..] {
            [] | ["comment", ..] => {}
            ["obj_info", "num_cols", columns, ..] => {
                header.columns = header.columns.or(columns.parse().ok().filter(|columns| *columns > 0));
            }
            ["obj_info", ..] => {}
            ["format", name, "1.0"] => {
                has_format = true;
                header.encoding = match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => bail!(wrong()),
                };
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| wrong())?;
                header.elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref rest @ .., name] => {
                let (of, length) = match *rest {
                    ["list", length, of] => (Type::parse(of), Some(Type::parse(length).ok_or_else(wrong)?)),
                    [of] => (Type::parse(of), None),
                    _ => bail!(wrong()),
                };
                let property = Property { name: name.to_owned(), of: of.ok_or_else(wrong)?, length };
                header.elements.last_mut().ok_or_else(wrong)?.properties.push(property);
            }
            ["end_header", ..] if has_format => return Ok(header),
            _ => bail!(wrong()),
        }
    }
}
