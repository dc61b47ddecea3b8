//! Wavefront OBJ: `v` and `f` lines, and where images are asked for, materials and texture coordinates; whatever else there is, is
//! left out with a warning.

mod libraries;
mod mtl;
mod statements;
mod wedges;

use super::error::ImportError;
use super::format::{Format, Likeness, first_line, is_text};
use super::lines::{meaning, number, words};
use crate::batch::{Batch, BatchKind, MAX_VERTICES, Tally};
use crate::color_scale::ColorScale;
use crate::location::{SourceLocation, excerpt};
use crate::options::{Invalid, Options};
use crate::ply::Warning;
use crate::reader::{MeshReader, Opening, SourceInfo, Start};
use crate::stream::Stream;
use crate::texture::Images;
use crate::vertex_format::{Coordinates, VertexFormat};
use crate::vertex_set::VertexSet;
use chpm_extmem::Cancel;
use chpm_mesh::{Attributes, FAR};
use libraries::Libraries;
use statements::Joined;
use std::io::Read;
use wedges::{Faces, Wedges};

/// Wavefront OBJ.
pub(crate) const FORMAT: Format =
    Format { name: "OBJ", extensions: &["obj"], is_list: false, sniff, open, names: Some(libraries::files) };

/// Goes by the first line that is no comment.
fn sniff(start: &Start<'_>) -> Likeness {
    let keyword = words(first_line(start.head)).next().unwrap_or_default();
    let is_obj =
        matches!(keyword, b"v" | b"vn" | b"vt" | b"vp" | b"f" | b"mtllib" | b"usemtl" | b"o" | b"g" | b"s");
    if is_obj && is_text(start.head) { Likeness::Likely } else { Likeness::None }
}

fn open(opening: Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError> {
    let Opening { stream, options, store, cancel, supply, .. } = opening;
    // Nothing lies beside a pipe.
    let images = if supply.is_spooled() { Images::Ignored } else { options.images };
    let wedges = match images {
        Images::Ignored => None,
        images => {
            let libraries = Libraries::new(&supply.path, images, Some(store), cancel)?;
            Some(Box::new(Wedges::new(libraries, store)?))
        }
    };
    let reader = ObjReader::with(stream, options, wedges)?;
    Ok(Box::new(ObjMesh { reader, cancel: cancel.clone() }))
}

/// An OBJ, and then the triangles that its images are on.
struct ObjMesh {
    reader: ObjReader<Stream>,
    cancel: Cancel,
}

impl MeshReader for ObjMesh {
    fn format(&self) -> VertexFormat {
        self.reader.vertex_format()
    }

    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        self.reader.next_batch(batch)
    }

    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError> {
        let ObjMesh { reader, cancel, .. } = *self;
        let mut info = SourceInfo {
            encoding: "obj".to_owned(),
            vertex_count: reader.vertices(),
            face_count: reader.faces(),
            tally: reader.tally(),
            warnings: reader.warnings(),
            ..SourceInfo::default()
        };
        if let Some(faces) = reader.faces {
            let table = faces.libraries.table;
            info.warnings.extend(table.warnings());
            info.beside = table.beside(&cancel)?;
            info.textures = table.finish(false);
        }
        Ok(info)
    }
}

/// Reads an OBJ once, front to back.
///
/// Coordinates are text without a type and delivered as `f64`. Corners may be `v`, `v/vt`, `v//vn` or `v/vt/vn`, count from 1 or
/// from the last vertex backwards (-1), and may name vertices that come later.
/// A vertex has a colour if three more numbers follow its position, from 0 to 1 or from 0 to 255; the first vertex decides for all whether there are any. Normals belong to corners and are handed over as such.
pub struct ObjReader<R: Read> {
    lines: Joined<R>,
    read: Statements,
    delivered: [u64; 2],
    state: State,
    /// Textured faces, when all is read.
    faces: Option<Box<Faces>>,
}

/// State of the statements up to now.
#[derive(Default)]
struct Statements {
    invalid_data: Invalid,
    /// Vertices and triangles that are read and not handed over yet.
    pending: Batch,
    colored: bool,
    /// Whether colours are asked for.
    wants_colors: bool,
    color_scale: ColorScale,
    /// Whether normals are asked for.
    wants_normals: bool,
    /// Whether a corner without a normal was told.
    has_bare_corner: bool,
    vertices: u64,
    normals: u64,
    faces: u64,
    /// The greatest index that was beyond the vertices when it was read.
    highest: Option<(i64, SourceLocation)>,
    invalid: VertexSet,
    corners: Vec<u32>,
    corner_normals: Vec<[u32; 2]>,
    tally: Tally,
    left_out: LeftOut,
    /// Where images are asked for.
    wedges: Option<Box<Wedges>>,
}

/// Where a statement is: the element that it tells of, and that one's number.
type PlaceOf<'a> = &'a dyn Fn(&str, u64) -> SourceLocation;

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Open,
    Ended,
    Failed,
}

/// How much there is that does not reach the mesh.
#[derive(Default)]
struct LeftOut {
    texture: u64,
    materials: u64,
    lines_and_points: u64,
    vertex_numbers: u64,
    late_colors: u64,
    statements: u64,
    /// Names of some of the statements.
    names: Vec<String>,
}

impl<R: Read> ObjReader<R> {
    /// Reads up to the first vertex, which says whether there are colours.
    ///
    /// # Errors
    /// What is wrong up to there.
    pub fn new(reader: R, options: Options) -> Result<Self, ImportError> {
        Self::with(reader, options, None)
    }

    fn with(reader: R, options: Options, wedges: Option<Box<Wedges>>) -> Result<Self, ImportError> {
        let Options { invalid: invalid_data, colors: wants_colors, normals: wants_normals, .. } = options;
        let mut obj = ObjReader {
            lines: Joined::new(reader),
            read: Statements {
                invalid_data,
                colored: wants_colors,
                wants_colors,
                wants_normals,
                wedges,
                ..Statements::default()
            },
            delivered: [0; 2],
            state: State::Open,
            faces: None,
        };
        while obj.read.vertices == 0 && obj.state == State::Open && !obj.read.is_full() {
            obj.line()?;
        }
        obj.read.colored &= !obj.read.pending.vertices.colors.is_empty();
        Ok(obj)
    }

    /// Format of the delivered vertices.
    pub fn vertex_format(&self) -> VertexFormat {
        let attributes = Attributes { colors: self.read.colored, ..Attributes::NONE };
        VertexFormat { coordinates: Coordinates::Text, attributes }
    }

    /// Vertices that were read up to now.
    pub fn vertices(&self) -> u64 {
        self.read.vertices
    }

    /// Faces that were read up to now.
    pub fn faces(&self) -> u64 {
        self.read.faces
    }

    /// Elements that were not delivered up to now.
    pub fn tally(&self) -> Tally {
        self.read.tally
    }

    /// Losses, in words; complete when the stream has ended.
    pub fn warnings(&self) -> Vec<String> {
        let LeftOut { texture, mut materials, lines_and_points, .. } = self.read.left_out;
        if self.faces.as_ref().is_some_and(|faces| faces.libraries.table.is_textured()) {
            materials = 0;
        }
        let LeftOut { vertex_numbers, late_colors, statements, ref names, .. } = self.read.left_out;
        let mut warnings = Vec::new();
        let mut warn = |count: u64, text: String| warnings.extend((count > 0).then_some(text));
        warn(texture, format!("dropped {texture} texture coordinates"));
        let count = self.read.tally.zeroed_normals;
        warn(count, Warning::NormalsZeroed { count }.to_string());
        warn(materials, format!("dropped {materials} references to materials"));
        warn(lines_and_points, format!("skipped {lines_and_points} lines and points"));
        warn(vertex_numbers, format!("ignored further numbers of {vertex_numbers} vertices"));
        warn(late_colors, format!("dropped colours of {late_colors} vertices, since the first one has none"));
        warn(statements, format!("skipped {statements} statements that are no mesh: {}", names.join(", ")));
        warnings
    }

    /// Refills `batch`, as [`PlyReader::next_batch`](crate::PlyReader::next_batch) does; vertices and faces come in any order,
    /// and a batch of vertices may hold none, but normals of corners.
    ///
    /// # Errors
    /// Where and why the input cannot be read. That a corner is beyond the last vertex is known at the end only.
    pub fn next_batch(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        batch.clear();
        if self.state == State::Failed {
            return Err(ImportError::Ended);
        }
        let result = self.fill(batch);
        if result.is_err() {
            self.state = State::Failed;
        }
        result
    }

    fn fill(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        while self.state == State::Open && !self.read.is_full() {
            self.line()?;
        }

        std::mem::swap(&mut batch.listed_normals, &mut self.read.pending.listed_normals);
        std::mem::swap(&mut batch.corner_normals, &mut self.read.pending.corner_normals);

        let vertices = self.read.pending.positions_f64.len();
        if vertices > 0 && (vertices >= Batch::FULL || !self.read.pending.is_full_of_faces()) {
            std::mem::swap(&mut batch.positions_f64, &mut self.read.pending.positions_f64);
            std::mem::swap(&mut batch.invalid_vertices, &mut self.read.pending.invalid_vertices);
            std::mem::swap(&mut batch.vertices, &mut self.read.pending.vertices);
            std::mem::swap(&mut batch.far, &mut self.read.pending.far);
            batch.first = self.delivered[0];
            self.delivered[0] += vertices as u64;
            Ok(BatchKind::Vertices)
        } else if self.read.pending.has_faces() {
            std::mem::swap(&mut batch.triangles, &mut self.read.pending.triangles);
            std::mem::swap(&mut batch.polygons, &mut self.read.pending.polygons);
            batch.first = self.delivered[1];
            self.delivered[1] += (batch.triangles.len() + batch.polygons.iter().count()) as u64;
            Ok(BatchKind::Triangles)
        } else if !batch.listed_normals.is_empty() {
            Ok(BatchKind::Vertices)
        } else {
            self.fill_textured(batch)
        }
    }

    /// Coordinates may come behind the faces that name them, so that textured faces come last.
    fn fill_textured(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        if let Some(wedges) = self.read.wedges.take() {
            self.faces = Some(Box::new(wedges.finish()?));
        }
        let is_any = self.faces.as_mut().map_or(Ok(false), |faces| faces.next(&mut batch.textured))?;
        Ok(if is_any { BatchKind::Triangles } else { BatchKind::End })
    }

    fn line(&mut self) -> Result<(), ImportError> {
        if !self.lines.advance()? {
            return self.end();
        }
        let lines = &self.lines;
        self.read.statement(lines.current(), &|element, index| lines.place(element, index))
    }

    fn end(&mut self) -> Result<(), ImportError> {
        self.state = State::Ended;
        match self.read.highest.take() {
            Some((index, place)) if index as u64 > self.read.vertices => {
                Err(ImportError::IndexOutOfRange { place, index, vertices: self.read.vertices })
            }
            _ => Ok(()),
        }
    }
}

impl Statements {
    /// Whether as much is pending as a batch should have of anything.
    fn is_full(&self) -> bool {
        let Batch { positions_f64, listed_normals, .. } = &self.pending;
        positions_f64.len().max(listed_normals.len()) >= Batch::FULL || self.pending.is_full_of_faces()
    }

    fn statement(&mut self, line: &[u8], place: PlaceOf) -> Result<(), ImportError> {
        let mut words = words(meaning(line));
        let left_out = &mut self.left_out;
        let textured = self.wedges.as_mut().filter(|wedges| wedges.is_textured());
        match words.next() {
            None => {}
            Some(b"v") => self.vertex(words, place)?,
            Some(b"vn") if self.wants_normals => self.normal(words),
            Some(b"f") => self.face(words, place)?,
            Some(b"vt") => match textured {
                Some(wedges) => wedges.coordinate(words)?,
                None => left_out.texture += 1,
            },
            Some(b"vn") => {}
            Some(b"mtllib") => {
                left_out.materials += 1;
                if let Some(wedges) = &mut self.wedges
                    && let Some((_, names)) = mtl::statement(line)
                {
                    wedges.library(names, &mut left_out.texture)?;
                }
            }
            Some(b"usemtl") => {
                left_out.materials += u64::from(textured.is_none());
                if let Some(wedges) = &mut self.wedges {
                    wedges.choose(mtl::statement(line).map_or(&[], |(_, name)| name));
                }
            }
            Some(b"usemap" | b"maplib") => left_out.materials += 1,
            Some(b"l" | b"p") => left_out.lines_and_points += 1,
            Some(b"g" | b"o" | b"s" | b"mg") => {}
            Some(name) => {
                left_out.statements += 1;
                let name = excerpt(name);
                if left_out.names.len() < 8 && !left_out.names.contains(&name) {
                    left_out.names.push(name);
                }
            }
        }
        Ok(())
    }

    /// A position, and a colour or a weight if numbers follow it.
    fn vertex<'a>(
        &mut self,
        mut words: impl Iterator<Item = &'a [u8]>,
        place: PlaceOf,
    ) -> Result<(), ImportError> {
        let place = || place("vertex", self.vertices);
        let wrong = |got| ImportError::Text { place: place(), expected: "three coordinates", got };
        let mut position = [0.0f64; 3];
        for x in &mut position {
            *x = number(words.next()).map_err(wrong)?;
        }
        let mut rest = [0.0f64; 3];
        let mut count = 0;
        for word in words {
            if let Some(x) = rest.get_mut(count) {
                *x = number(Some(word)).map_err(wrong)?;
            }
            count += 1;
        }

        if self.vertices == MAX_VERTICES {
            let limit = MAX_VERTICES;
            return Err(ImportError::TooMany { place: place(), what: "vertices", limit });
        }
        if let Some(&value) = position.iter().find(|x| !x.is_finite()) {
            if self.invalid_data == Invalid::Refuse {
                return Err(ImportError::NotFinite { place: place(), value });
            }
            // It stays as a vertex at zero, so that the others keep their numbers. Its faces go.
            position = [0.0; 3];
            self.invalid.insert(self.vertices);
            self.tally.dropped_vertices += 1;
            self.pending.invalid_vertices.push(self.vertices);
        }
        if position.iter().any(|x| x.abs() > FAR) {
            self.pending.far.push(place());
        }
        self.pending.positions_f64.push(position);

        // Three numbers behind the position are a colour, a single one is a weight.
        let is_first = self.vertices == 0;
        match count {
            3 if self.colored => self.color_scale.push(&rest, &mut self.pending.vertices.colors),
            3 => self.left_out.late_colors += u64::from(self.wants_colors),
            0 | 1 => {}
            _ => self.left_out.vertex_numbers += 1,
        }
        if count != 3 && self.colored && !is_first {
            self.pending.vertices.colors.push([255; 4]);
        }
        self.vertices += 1;
        Ok(())
    }

    /// A normal that corners may name. One that is no three numbers is zero, and counted.
    fn normal<'a>(&mut self, mut words: impl Iterator<Item = &'a [u8]>) {
        let mut normal = [0.0f32; 3];
        let are_numbers = normal.iter_mut().all(|x| {
            number(words.next()).is_ok_and(|value: f64| {
                *x = value as f32;
                x.is_finite()
            })
        });
        if !are_numbers {
            normal = [0.0; 3];
            self.tally.zeroed_normals += 1;
        }
        self.pending.listed_normals.push(normal);
        self.normals += 1;
    }

    fn face<'a>(&mut self, words: impl Iterator<Item = &'a [u8]>, place: PlaceOf) -> Result<(), ImportError> {
        self.corners.clear();
        self.corner_normals.clear();
        if let Some(wedges) = &mut self.wedges {
            wedges.begin();
        }
        let mut valid = true;
        for word in words {
            valid &= self.corner(word, place)?;
        }

        self.faces += 1;
        if !valid {
            self.tally.dropped_faces += 1;
            return Ok(());
        }
        let is_delivered = self.pending.push_face(&self.corners, &mut self.tally);
        if let Some(wedges) = self.wedges.as_mut().filter(|_| is_delivered) {
            wedges.end()?;
        }
        for corner in self.corner_normals.iter().filter(|_| is_delivered) {
            // Most files have no normals at all: once is enough to tell this.
            let is_bare = corner[1] == u32::MAX;
            if !is_bare || !self.has_bare_corner {
                self.pending.corner_normals.push(*corner);
            }
            self.has_bare_corner |= is_bare;
        }
        Ok(())
    }

    /// A corner of the face that is read; false if the face has to go because of it.
    fn corner(&mut self, word: &[u8], place: PlaceOf) -> Result<bool, ImportError> {
        let place = || place("face", self.faces);
        let digits = word.split(|byte| *byte == b'/').next();
        let index: i64 = number(digits).map_err(|got| {
            let expected = "the number of a vertex";
            ImportError::Text { place: place(), expected, got }
        })?;
        let vertex =
            if index < 0 { self.vertices.checked_add_signed(index) } else { (index as u64).checked_sub(1) };

        // A face may name vertices that come later: the highest is looked at when all have come.
        let is_known = vertex.is_some_and(|vertex| vertex < self.vertices);
        if !is_known && self.invalid_data == Invalid::Drop {
            return Ok(false);
        }
        let Some(vertex) = vertex.filter(|vertex| *vertex < MAX_VERTICES) else {
            return Err(ImportError::IndexOutOfRange { place: place(), index, vertices: self.vertices });
        };
        if !is_known && self.highest.as_ref().is_none_or(|(highest, _)| index > *highest) {
            self.highest = Some((index, place()));
        }

        self.corners.push(vertex as u32);
        if let Some(wedges) = &mut self.wedges {
            wedges.corner(vertex as u32, word);
        }
        if self.wants_normals {
            let normal = normal(word, self.normals);
            self.corner_normals.push([vertex as u32, normal.unwrap_or(u32::MAX)]);
        }
        Ok(!self.invalid.contains(vertex))
    }
}

/// The normal that a corner names, counted from zero, if it names one. `read` are those before it.
fn normal(corner: &[u8], read: u64) -> Option<u32> {
    let index: i64 = number(Some(corner.split(|byte| *byte == b'/').nth(2)?)).ok()?;
    let normal = if index < 0 { read.checked_add_signed(index) } else { (index as u64).checked_sub(1) };
    u32::try_from(normal?).ok()
}
