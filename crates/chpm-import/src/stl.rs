//! STL: a soup of facets, each with its own three corners. Joining corners to vertices needs all of them and is left to the caller.

use super::error::ImportError;
use super::format::{Format, Likeness, is_text};
use super::lines::{Lines, number, words};
use crate::Triangulator;
use crate::batch::Tally;
use crate::location::SourceLocation;
use crate::options::Invalid;
use crate::reader::{MeshReader, Opening, Start};
use crate::stream::Stream;
use crate::weld::Welder;
use chpm_mesh::FAR;
use std::io::{self, Read};

/// STL, binary or as text.
pub(crate) const FORMAT: Format =
    Format { name: "STL", extensions: &["stl"], is_list: false, sniff, open, names: None };

fn sniff(start: &Start<'_>) -> Likeness {
    match () {
        () if is_binary(start.head, start.len) => Likeness::Certain,
        () if begins_solid(start.head) => Likeness::Likely,
        () => Likeness::None,
    }
}

/// Whether an input of `len` bytes is as long as it is as a binary STL. Its header may be any 80 bytes, also those that another
/// format or a compressed file begins with.
pub(crate) fn is_binary(head: &[u8], len: Option<u64>) -> bool {
    let count = head.get(80..84).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    count.is_some_and(|count| len == Some(84 + 50 * u64::from(count)))
}

fn begins_solid(head: &[u8]) -> bool {
    let is_solid = words(head).next().is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    is_solid && (is_text(head) || is_padded(head))
}

fn is_padding(byte: &u8) -> bool {
    matches!(byte, 0 | 0x1a)
}

/// Whether this is text but for zeros, which some programs fill a name or the end of a file with, or the mark of its end that DOS had. Facets tell it from a binary
/// header that says `solid`.
fn is_padded(head: &[u8]) -> bool {
    let mut lines = head.split(|byte| matches!(byte, b'\n' | b'\r'));
    let is_facet = |line: &[u8]| {
        let line = line.trim_ascii_start().get(..5);
        line.is_some_and(|word| word.eq_ignore_ascii_case(b"facet"))
    };
    head.split(is_padding).all(is_text) && lines.any(is_facet)
}

fn open(opening: Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError> {
    let Opening { stream, start, options, store, .. } = opening;
    let is_text = StlReader::<Stream>::is_text(&start);
    let reader = StlReader::new(stream, is_text, options.invalid)?;
    Ok(match is_text {
        true => Box::new(Welder::<[u128; 2]>::new(reader, store)),
        false => Box::new(Welder::<u128>::new(reader, store)),
    })
}

/// Positions of a facet's corners, in order.
pub type Corners = [[f64; 3]; 3];

/// Facets after which a batch is handed over; only a polygon can take it beyond.
const FULL: usize = 1 << 13;
const HEADER: usize = 84;
const RECORD: usize = 50;

/// Reads an STL once, front to back. Coordinates are those of single precision, or what text says; minus zero becomes zero, so that equal positions have
/// equal bits. Normals are left out: the corners tell them.
pub struct StlReader<R: Read> {
    body: Body<R>,
    invalid: Invalid,
    tally: Tally,
    warnings: Vec<String>,
    /// Facets behind us.
    facets: u64,
    /// Facets with attribute bytes, which some programs hold colours in.
    attributed: u64,
    state: State,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Open,
    Ended,
    Failed,
}

enum Body<R: Read> {
    Binary(Records<R>),
    Ascii { lines: Lines<R>, inside: bool, corners: Vec<[f64; 3]>, solids: u64, closed: u64 },
}

/// Binary facets, read block by block.
struct Records<R> {
    reader: R,
    block: Vec<u8>,
    count: u64,
    offset: u64,
}

impl<R: Read> StlReader<R> {
    /// Whether an STL that begins so is text.
    pub fn is_text(start: &Start<'_>) -> bool {
        !is_binary(start.head, start.len) && begins_solid(start.head)
    }

    /// Reads what comes before the facets, which are text or records.
    ///
    /// # Errors
    /// If the input cannot be read or is shorter than its header.
    pub fn new(reader: R, is_text: bool, invalid: Invalid) -> Result<Self, ImportError> {
        let body = if is_text {
            let corners = Vec::new();
            Body::Ascii { lines: Lines::new(reader), inside: false, corners, solids: 0, closed: 0 }
        } else {
            Body::Binary(Records::begin(reader)?)
        };
        let tally = Tally::default();
        Ok(StlReader {
            body,
            invalid,
            tally,
            warnings: Vec::new(),
            facets: 0,
            attributed: 0,
            state: State::Open,
        })
    }

    /// Name of the encoding.
    pub fn encoding(&self) -> &'static str {
        match &self.body {
            Body::Binary(_) => "stl, binary",
            Body::Ascii { .. } => "stl, ascii",
        }
    }

    /// Facets that a binary header declares.
    pub fn declared(&self) -> Option<u64> {
        match &self.body {
            Body::Binary(records) => Some(records.count),
            Body::Ascii { .. } => None,
        }
    }

    /// Facets that were read up to now.
    pub fn facets(&self) -> u64 {
        self.facets
    }

    /// Elements that were not delivered up to now.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Losses, in words; complete when the stream has ended.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Refills `batch` with the facets that come next; none are left if it stays empty and the answer is false.
    ///
    /// # Errors
    /// Where and why the facets cannot be read; calling again is [`ImportError::Ended`].
    pub fn next_batch(&mut self, batch: &mut Vec<Corners>) -> Result<bool, ImportError> {
        batch.clear();
        if self.state == State::Failed {
            return Err(ImportError::Ended);
        }

        let result = match (self.state, &mut self.body) {
            (State::Open, Body::Binary(_)) => self.fill_binary(batch),
            (State::Open, Body::Ascii { .. }) => self.fill_ascii(batch),
            _ => Ok(false),
        };

        match result {
            Ok(true) => {}
            Ok(false) if self.state == State::Open => {
                self.state = State::Ended;
                if self.attributed > 0 {
                    let count = self.attributed;
                    self.warnings.push(format!("dropped the attribute bytes (colours) of {count} facets"));
                }
            }
            Ok(false) => {}
            Err(_) => self.state = State::Failed,
        }

        result
    }

    fn fill_binary(&mut self, batch: &mut Vec<Corners>) -> Result<bool, ImportError> {
        let Body::Binary(records) = &mut self.body else { return Ok(false) };
        let wanted = (records.count - self.facets).min(FULL as u64) as usize;
        if wanted == 0 {
            if records.fill(1)? > 0 {
                self.warnings
                    .push(format!("ignored data after the last facet, from byte {} on", records.offset - 1));
            }
            return Ok(false);
        }

        let before = records.offset;
        let whole = records.fill(wanted * RECORD)? / RECORD;
        for at in 0..whole {
            let record = &records.block[at * RECORD..][..RECORD];
            let corners = corners(record);
            self.attributed += u64::from(record[48..] != [0, 0]);
            let bad = corners.as_flattened().iter().copied().find(|x| x.is_nan() || x.abs() > FAR);
            match bad {
                None => batch.push(corners),
                Some(value) if drops(value, self.invalid) => self.tally.dropped_faces += 1,
                Some(value) => {
                    let offset = before + (at * RECORD) as u64;
                    let place = SourceLocation {
                        element: "facet".to_owned(),
                        index: self.facets + at as u64,
                        offset,
                        line: None,
                    };
                    return Err(unusable(place, value));
                }
            }
        }
        self.facets += whole as u64;

        if whole < wanted {
            let missing = records.count - self.facets;
            if self.invalid == Invalid::Refuse {
                let place = SourceLocation {
                    element: "facet".to_owned(),
                    index: self.facets,
                    offset: records.offset,
                    line: None,
                };
                return Err(ImportError::Truncated { place, expected: format!("{missing} facets more") });
            }
            self.tally.missing_faces += missing;
            records.count = self.facets;
        }
        Ok(whole > 0)
    }

    fn fill_ascii(&mut self, batch: &mut Vec<Corners>) -> Result<bool, ImportError> {
        let Body::Ascii { lines, inside, corners, solids, closed } = &mut self.body else { return Ok(false) };
        while batch.len() < FULL {
            if !lines.advance()? {
                let expected = match () {
                    () if *inside => "the rest of the facet",
                    () if closed < solids => "'endsolid'",
                    () => return Ok(!batch.is_empty()),
                };
                if self.invalid == Invalid::Refuse {
                    let place = lines.place("facet", self.facets);
                    return Err(ImportError::Truncated { place, expected: expected.to_owned() });
                }
                self.tally.missing_faces += u64::from(*inside);
                (*inside, *closed) = (false, *solids);
                return Ok(!batch.is_empty());
            }
            // Statements may share a line, and be in any case.
            let mut words = lines.current().split(is_padding).flat_map(words);
            // A normal is any text, too, up to what can follow it.
            let mut in_normal = false;
            while let Some(word) = words.next() {
                let mut word = word.to_owned();
                word.make_ascii_lowercase();
                in_normal &= !matches!(&word[..], b"outer" | b"vertex" | b"endfacet");
                if in_normal {
                    continue;
                }
                let wrong = |expected, got| {
                    let place = lines.place("facet", self.facets);
                    Err(ImportError::Text { place, expected, got })
                };
                match (&word[..], *inside) {
                    // Their names are any text.
                    (b"solid", false) => {
                        *solids += 1;
                        break;
                    }
                    (b"endsolid", false) => {
                        *closed += 1;
                        break;
                    }
                    (b"facet", false) => {
                        (*inside, in_normal, _) = (true, true, corners.clear());
                    }
                    (b"outer" | b"loop" | b"endloop", true) => {}
                    (b"vertex", true) => {
                        let mut position = [0.0f64; 3];
                        for x in &mut position {
                            match number::<f64>(words.next()) {
                                // Adding zero takes the sign from a zero, and changes nothing else.
                                Ok(value) => *x = value + 0.0,
                                Err(got) => return wrong("three numbers after 'vertex'", got),
                            }
                        }
                        if corners.len() as u64 >= crate::batch::MAX_CORNERS {
                            return wrong("'endfacet'", "yet another vertex".to_owned());
                        }
                        corners.push(position);
                    }
                    (b"endfacet", true) => {
                        *inside = false;
                        let bad =
                            corners.as_flattened().iter().copied().find(|x| x.is_nan() || x.abs() > FAR);
                        match bad {
                            Some(value) if drops(value, self.invalid) => self.tally.dropped_faces += 1,
                            Some(value) => {
                                let place = lines.place("facet", self.facets);
                                return Err(unusable(place, value));
                            }
                            None => push_facet(corners, &mut self.tally, batch),
                        }
                        self.facets += 1;
                    }
                    (_, true) => return wrong("'vertex' or 'endfacet'", crate::location::excerpt(&word)),
                    (_, false) => return wrong("'facet' or 'endsolid'", crate::location::excerpt(&word)),
                }
            }
        }
        Ok(true)
    }
}

impl<R: Read> Records<R> {
    fn begin(reader: R) -> Result<Self, ImportError> {
        let mut records = Records { reader, block: vec![0; FULL * RECORD], count: 0, offset: 0 };
        if records.fill(HEADER)? < HEADER {
            let place =
                SourceLocation { element: "header".to_owned(), index: 0, offset: records.offset, line: None };
            return Err(ImportError::Truncated { place, expected: format!("a header of {HEADER} bytes") });
        }
        let count = &records.block[80..84];
        records.count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]).into();
        Ok(records)
    }

    /// Fills the block with the next `wanted` bytes, or what is left.
    fn fill(&mut self, wanted: usize) -> Result<usize, ImportError> {
        let mut len = 0;
        while len < wanted {
            match self.reader.read(&mut self.block[len..wanted]) {
                Ok(0) => break,
                Ok(count) => len = wanted.min(len + count),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(source) => return Err(ImportError::Read { offset: self.offset + len as u64, source }),
            }
        }
        self.offset += len as u64;
        Ok(len)
    }
}

/// A facet of any number of corners, as triangles.
fn push_facet(corners: &[[f64; 3]], tally: &mut Tally, batch: &mut Vec<Corners>) {
    tally.degenerate_faces += u64::from(corners.len() < 3);
    tally.polygons_triangulated += u64::from(corners.len() > 3);
    if let [a, b, c] = *corners {
        batch.push([a, b, c]);
        return;
    }
    let numbers: Vec<u32> = (0..corners.len() as u32).collect();
    let mut triangles = Vec::new();
    tally.degenerate_faces += Triangulator::default().cut(&numbers, corners, &mut triangles);
    batch.extend(triangles.iter().map(|t| t.map(|i| corners[i as usize])));
}

/// Whether a facet with such a coordinate is left out. One that is only far says that the units are wrong.
fn drops(value: f64, invalid: Invalid) -> bool {
    invalid == Invalid::Drop && !value.is_finite()
}

fn unusable(place: SourceLocation, value: f64) -> ImportError {
    match value.is_finite() {
        true => ImportError::TooFar { place, value },
        false => ImportError::NotFinite { place, value },
    }
}

/// The corners of a record, which come after its normal.
fn corners(record: &[u8]) -> Corners {
    std::array::from_fn(|corner| {
        std::array::from_fn(|axis| {
            let at = 12 + 12 * corner + 4 * axis;
            let bytes = [record[at], record[at + 1], record[at + 2], record[at + 3]];
            f64::from(f32::from_le_bytes(bytes)) + 0.0
        })
    })
}
