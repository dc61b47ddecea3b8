//! OFF, as text or binary: positions, normals, colours and polygons; what else there is, is left out with a warning.

use super::error::ImportError;
use super::format::{Format, Likeness, first_line, is_text};
use super::lines::{Lines, meaning, number, words};
use crate::batch::{Batch, BatchKind, MAX_CORNERS, MAX_VERTICES, Tally};
use crate::color_scale::ColorScale;
use crate::location::SourceLocation;
use crate::options::{Invalid, Options};
use crate::ply::Warning;
use crate::reader::{MeshReader, Opening, SourceInfo, Start};
use crate::stream::Stream;
use crate::vertex_format::{Coordinates, VertexFormat};
use crate::vertex_set::VertexSet;
use chpm_mesh::{Attributes, FAR};
use std::io::{self, BufReader, Read};

/// Object File Format of Geomview.
pub(crate) const FORMAT: Format =
    Format { name: "OFF", extensions: &["off"], is_list: false, sniff, open, names: None };

/// Goes by the keyword; a file without one is known by its name alone.
fn sniff(start: &Start<'_>) -> Likeness {
    let line = first_line(start.head);
    let is_off = words(line).next().is_some_and(|word| Keyword::of(word).is_some());
    if is_off && is_text(line) { Likeness::Likely } else { Likeness::None }
}

fn open(opening: Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError> {
    let Opening { stream, start, options, .. } = opening;
    Ok(Box::new(OffReader::new(stream, start.head, options)?))
}

/// Attributes of a vertex besides its position, as the keyword says: `STCNOFF` has all.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
struct Keyword {
    texture: bool,
    color: bool,
    normal: bool,
    /// Whether positions have other than three coordinates.
    is_of_other_dimension: bool,
}

impl Keyword {
    fn of(word: &[u8]) -> Option<Keyword> {
        let mut rest = word.strip_suffix(b"OFF")?;
        let mut take = |prefix: &[u8]| match rest.strip_prefix(prefix) {
            Some(after) => {
                rest = after;
                true
            }
            None => false,
        };
        let (texture, color, normal) = (take(b"ST"), take(b"C"), take(b"N"));
        let is_of_other_dimension = take(b"4") | take(b"n");
        rest.is_empty().then_some(Keyword { texture, color, normal, is_of_other_dimension })
    }
}

/// Reads an OFF once, front to back.
struct OffReader<R> {
    body: Body<R>,
    keyword: Keyword,
    invalid_data: Invalid,
    /// Attributes that are delivered of those.
    attributes: Attributes,
    /// Vertices and faces that the header declares, and those that are behind us.
    declared: [u64; 2],
    read: [u64; 2],
    /// Numbers of a vertex, and corners of a face.
    numbers: Vec<f64>,
    corners: Vec<i64>,
    valid_corners: Vec<u32>,
    invalid: VertexSet,
    tally: Tally,
    further_numbers: u64,
    colored_faces: u64,
    colors: ColorScale,
    /// Where data begins that belongs to no face.
    trailing: Option<u64>,
    has_ended: bool,
    has_failed: bool,
}

enum Body<R> {
    Text(Lines<R>),
    /// Big-endian numbers of four bytes, and the offset of the next.
    Binary(BufReader<R>, u64),
}

impl<R: Read> OffReader<R> {
    /// Reads the header of an input that begins with `head`.
    fn new(reader: R, head: &[u8], options: Options) -> Result<Self, ImportError> {
        let mut header = words(first_line(head));
        let keyword = header.next().and_then(Keyword::of);
        let is_binary = keyword.is_some() && header.next() == Some(b"BINARY");
        let mut body = match is_binary {
            true => Body::Binary(BufReader::new(reader), 0),
            false => Body::Text(Lines::new(reader)),
        };
        let declared = body.header(keyword.is_some(), head)?;

        let keyword = keyword.unwrap_or_default();
        if keyword.is_of_other_dimension {
            let what =
                "an OFF whose vertices have other than three coordinates is not read; project them first";
            return Err(ImportError::Unsupported(what.to_owned()));
        }
        if declared[0] > MAX_VERTICES {
            let place = body.place("vertex", MAX_VERTICES);
            return Err(ImportError::TooMany { place, what: "vertices", limit: MAX_VERTICES });
        }
        let attributes = Attributes {
            normals: keyword.normal && options.normals,
            colors: keyword.color && options.colors,
            ..Attributes::NONE
        };
        Ok(OffReader {
            body,
            keyword,
            invalid_data: options.invalid,
            attributes,
            declared,
            read: [0; 2],
            numbers: Vec::new(),
            corners: Vec::new(),
            valid_corners: Vec::new(),
            invalid: VertexSet::default(),
            tally: Tally::default(),
            further_numbers: 0,
            colored_faces: 0,
            colors: ColorScale::default(),
            trailing: None,
            has_ended: false,
            has_failed: false,
        })
    }

    fn is_binary(&self) -> bool {
        matches!(self.body, Body::Binary(..))
    }

    fn fill(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        batch.first = self.read[0];
        while self.read[0] < self.declared[0] && !self.has_ended {
            if self.body.vertex(&mut self.numbers, self.keyword, self.read[0])? {
                self.take_vertex(batch)?;
            } else {
                self.end_early("vertices", 0)?;
            }
            if (self.read[0] - batch.first) as usize >= Batch::FULL {
                break;
            }
        }
        if self.read[0] > batch.first {
            return Ok(BatchKind::Vertices);
        }

        batch.first = self.read[1] - self.tally.dropped_faces - self.tally.degenerate_faces;
        while self.read[1] < self.declared[1] && !self.has_ended && !batch.is_full_of_faces() {
            match self.body.face(&mut self.corners, self.read[1])? {
                Some(is_colored) => {
                    self.colored_faces += u64::from(is_colored);
                    self.take_face(batch)?;
                }
                None => self.end_early("faces", 1)?,
            }
        }
        if batch.has_faces() {
            return Ok(BatchKind::Triangles);
        }
        if !self.has_ended {
            self.has_ended = true;
            self.trailing = self.body.trailing()?;
        }
        Ok(BatchKind::End)
    }

    /// Delivers the vertex whose numbers were read.
    fn take_vertex(&mut self, batch: &mut Batch) -> Result<(), ImportError> {
        let vertex = self.read[0];
        let mut position = [self.numbers[0], self.numbers[1], self.numbers[2]];
        if let Some(&value) = position.iter().find(|x| !x.is_finite()) {
            if self.invalid_data == Invalid::Refuse {
                let place = self.body.place("vertex", vertex);
                return Err(ImportError::NotFinite { place, value });
            }
            // It stays as a vertex at zero, so that the others keep their numbers. Its faces go.
            position = [0.0; 3];
            self.invalid.insert(vertex);
            self.tally.dropped_vertices += 1;
            batch.invalid_vertices.push(vertex);
        }
        if position.iter().any(|x| x.abs() > FAR) {
            batch.far.push(self.body.place("vertex", vertex));
        }
        match self.is_binary() {
            true => batch.vertices.positions.push(position.map(|x| x as f32)),
            false => batch.positions_f64.push(position),
        }

        let mut rest = &self.numbers[3..];
        if self.keyword.normal {
            let (normal, after) = rest.split_at(rest.len().min(3));
            rest = after;
            let normal = <[f64; 3]>::try_from(normal).unwrap_or([f64::NAN; 3]).map(|x| x as f32);
            let is_finite = normal.iter().all(|x| x.is_finite());
            if self.attributes.normals {
                self.tally.zeroed_normals += u64::from(!is_finite);
                batch.vertices.normals.push(if is_finite { normal } else { [0.0; 3] });
            }
        }
        if self.keyword.texture {
            rest = &rest[..rest.len().saturating_sub(2)];
        }
        if self.attributes.colors {
            self.colors.push(rest, &mut batch.vertices.colors);
        }
        self.further_numbers += u64::from(!self.keyword.color && !rest.is_empty());
        self.read[0] += 1;
        Ok(())
    }

    /// Delivers the face whose corners were read.
    fn take_face(&mut self, batch: &mut Batch) -> Result<(), ImportError> {
        let vertices = self.read[0];
        self.valid_corners.clear();
        for index in &self.corners {
            let is_in_range = u64::try_from(*index).is_ok_and(|index| index < vertices);
            if !is_in_range && self.invalid_data == Invalid::Refuse {
                let place = self.body.place("face", self.read[1]);
                return Err(ImportError::IndexOutOfRange { place, index: *index, vertices });
            }
            if is_in_range && !self.invalid.contains(*index as u64) {
                self.valid_corners.push(*index as u32);
            }
        }
        self.read[1] += 1;
        match self.valid_corners.len() == self.corners.len() {
            true => _ = batch.push_face(&self.valid_corners, &mut self.tally),
            false => self.tally.dropped_faces += 1,
        }
        Ok(())
    }

    /// The input ends before what its header declares.
    fn end_early(&mut self, what: &'static str, which: usize) -> Result<(), ImportError> {
        let missing = [0, 1].map(|i| self.declared[i] - self.read[i]);
        if self.invalid_data == Invalid::Refuse {
            let element = if which == 0 { "vertex" } else { "face" };
            let place = self.body.place(element, self.read[which]);
            return Err(ImportError::Truncated {
                place,
                expected: format!("{} {what} more", missing[which]),
            });
        }
        self.has_ended = true;
        self.tally.missing_vertices += missing[0];
        self.tally.missing_faces += missing[1];
        Ok(())
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let mut warn = |count: u64, text: String| warnings.extend((count > 0).then_some(text));
        let count = self.tally.zeroed_normals;
        warn(count, Warning::NormalsZeroed { count }.to_string());
        let (vertices, further, faces) = (self.read[0], self.further_numbers, self.colored_faces);
        warn(
            if self.keyword.texture { vertices } else { 0 },
            format!("dropped {vertices} texture coordinates"),
        );
        warn(further, format!("ignored further numbers of {further} vertices"));
        warn(faces, format!("dropped colours of {faces} faces"));
        let trailing = self.trailing.map(|offset| Warning::TrailingData { offset }.to_string());
        warnings.into_iter().chain(trailing).collect()
    }
}

impl MeshReader for OffReader<Stream> {
    fn format(&self) -> VertexFormat {
        let coordinates = if self.is_binary() { Coordinates::Single } else { Coordinates::Text };
        VertexFormat { coordinates, attributes: self.attributes }
    }

    fn declared(&self) -> Option<(u64, u64)> {
        Some((self.declared[0], self.declared[1]))
    }

    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        batch.clear();
        if self.has_failed {
            return Err(ImportError::Ended);
        }
        let result = self.fill(batch);
        self.has_failed = result.is_err();
        result
    }

    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError> {
        Ok(SourceInfo {
            encoding: if self.is_binary() { "off, binary" } else { "off, ascii" }.to_owned(),
            vertex_count: self.declared[0],
            face_count: self.declared[1],
            tally: self.tally,
            warnings: self.warnings(),
            ..SourceInfo::default()
        })
    }
}

impl<R: Read> Body<R> {
    /// Numbers of vertices and faces. That of edges comes last, and is often wrong or left out.
    fn header(&mut self, has_keyword: bool, head: &[u8]) -> Result<[u64; 2], ImportError> {
        match self {
            Body::Binary(..) => {
                let mut skipped = vec![0; header_len(head)];
                let mut counts = [0; 3];
                let is_whole = self.bytes(&mut skipped)? && self.integers(&mut counts)?;
                let negative = counts[..2].iter().any(|count| *count < 0);
                let place = self.place("header", 0);
                if !is_whole {
                    return Err(ImportError::Truncated { place, expected: "three counts".to_owned() });
                }
                if negative {
                    let got = format!("{} and {}", counts[0], counts[1]);
                    return Err(ImportError::Text { place, expected: COUNTS, got });
                }
                Ok([counts[0] as u64, counts[1] as u64])
            }
            Body::Text(lines) => {
                let mut counts = [0u64; 2];
                let mut known = 0;
                let mut skips = has_keyword;
                while known < 2 {
                    let is_line = lines.advance()?;
                    let place = lines.place("header", 0);
                    if !is_line {
                        return Err(ImportError::Truncated { place, expected: COUNTS.to_owned() });
                    }
                    for word in words(meaning(lines.current())) {
                        if std::mem::take(&mut skips) {
                            continue;
                        }
                        if known < 2 {
                            let wrong =
                                |got| ImportError::Text { place: place.clone(), expected: COUNTS, got };
                            counts[known] = number(Some(word)).map_err(wrong)?;
                            known += 1;
                        }
                    }
                }
                Ok(counts)
            }
        }
    }

    /// The numbers of the next vertex, at least three; false at the end.
    fn vertex(&mut self, numbers: &mut Vec<f64>, keyword: Keyword, vertex: u64) -> Result<bool, ImportError> {
        numbers.clear();
        if let Body::Binary(..) = self {
            let Keyword { texture, color, normal, .. } = keyword;
            let count = 3 + 3 * usize::from(normal) + 4 * usize::from(color) + 2 * usize::from(texture);
            let mut bits = [0; 12];
            let is_whole = self.integers(&mut bits[..count])?;
            numbers.extend(bits[..count].iter().map(|bits| f64::from(f32::from_bits(*bits as u32))));
            return Ok(is_whole);
        }
        let Body::Text(lines) = self else { return Ok(false) };
        if !advance(lines)? {
            return Ok(false);
        }
        let wrong = |got| ImportError::Text {
            place: lines.place("vertex", vertex),
            expected: "three coordinates",
            got,
        };
        let mut words = words(meaning(lines.current()));
        for _ in 0..3 {
            numbers.push(number(words.next()).map_err(wrong)?);
        }
        for word in words {
            numbers.push(number(Some(word)).map_err(wrong)?);
        }
        Ok(true)
    }

    /// The corners of the next face, and whether it has a colour; none at the end.
    fn face(&mut self, corners: &mut Vec<i64>, face: u64) -> Result<Option<bool>, ImportError> {
        corners.clear();
        let expected = "the number of corners, and so many vertices";
        if let Body::Binary(..) = self {
            let mut value = [0];
            let mut numbers = 0;
            // The corners, and then the numbers of a colour.
            for list in [&mut *corners, &mut Vec::new()] {
                if !self.integers(&mut value)? {
                    return Ok(None);
                }
                numbers = value[0];
                if numbers < 0 || numbers as u64 > MAX_CORNERS {
                    let (place, got) = (self.place("face", face), numbers.to_string());
                    return Err(ImportError::Text { place, expected, got });
                }
                for _ in 0..numbers {
                    if !self.integers(&mut value)? {
                        return Ok(None);
                    }
                    list.push(value[0].into());
                }
            }
            return Ok(Some(numbers > 0));
        }
        let Body::Text(lines) = self else { return Ok(None) };
        if !advance(lines)? {
            return Ok(None);
        }
        let wrong = |got| ImportError::Text { place: lines.place("face", face), expected, got };
        let mut words = words(meaning(lines.current()));
        let count: u64 = number(words.next()).map_err(wrong)?;
        if count > MAX_CORNERS {
            return Err(wrong(count.to_string()));
        }
        for _ in 0..count {
            corners.push(number(words.next()).map_err(wrong)?);
        }
        Ok(Some(words.next().is_some()))
    }

    /// Where data lies behind the last face, if there is any.
    fn trailing(&mut self) -> Result<Option<u64>, ImportError> {
        if let Body::Text(lines) = self {
            return Ok(advance(lines)?.then(|| lines.place("", 0).offset));
        }
        let is_there = self.bytes(&mut [0])?;
        Ok(is_there.then(|| self.place("", 0).offset - 1))
    }

    fn place(&self, element: &str, index: u64) -> SourceLocation {
        match self {
            Body::Text(lines) => lines.place(element, index),
            Body::Binary(_, offset) => {
                SourceLocation { element: element.to_owned(), index, offset: *offset, line: None }
            }
        }
    }

    /// Some of the big-endian numbers of a binary file; false at its end.
    fn integers(&mut self, values: &mut [i32]) -> Result<bool, ImportError> {
        for value in values {
            let mut bytes = [0; 4];
            if !self.bytes(&mut bytes)? {
                return Ok(false);
            }
            *value = i32::from_be_bytes(bytes);
        }
        Ok(true)
    }

    fn bytes(&mut self, bytes: &mut [u8]) -> Result<bool, ImportError> {
        let Body::Binary(reader, offset) = self else { return Ok(false) };
        match reader.read_exact(bytes) {
            Ok(()) => {
                *offset += bytes.len() as u64;
                Ok(true)
            }
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
            Err(source) => Err(ImportError::Read { offset: *offset, source }),
        }
    }
}

const COUNTS: &str = "the numbers of vertices and faces";

/// Bytes of the first line that is no comment and of those before it, with the line's end.
fn header_len(head: &[u8]) -> usize {
    fn is_end(byte: &u8) -> bool {
        matches!(byte, b'\n' | b'\r')
    }
    let mut at = 0;
    while let Some(len) = head[at..].iter().position(is_end) {
        let is_said = !first_line(&head[at..at + len]).is_empty();
        at += len + if head[at + len..].starts_with(b"\r\n") { 2 } else { 1 };
        if is_said {
            break;
        }
    }
    at
}

/// Goes to the next line that says something.
fn advance<R: Read>(lines: &mut Lines<R>) -> Result<bool, ImportError> {
    while lines.advance()? {
        if words(meaning(lines.current())).next().is_some() {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests;
