//! The reader: which element is next, what to hand over, and where an error is.

use super::{
    error::{Fault, PlyError},
    faces::Strip,
    grid::Grid,
    header::{Element, Encoding, Header, PropertyType},
    schema::{Field, Role, Schema, Slot},
    source::Source,
    warning::Warning,
    wedges::Wedges,
};
use crate::batch::{Batch, BatchKind, MAX_CORNERS, Tally};
use crate::location::SourceLocation;
use crate::options::{Invalid, Options};
use crate::vertex_format::VertexFormat;
use crate::vertex_set::VertexSet;
use crate::{Triangulator, polygon};
use chpm_mesh::{Scalar, TriMesh};
use std::io::Read;

/// Reads a PLY file once, front to back. See the [module](super) for what it understands.
pub struct PlyReader<R: Read> {
    header: Header,
    schema: Schema,
    body: Body<R>,
    /// Which element of the header is being read.
    element: usize,
    vertices: u64,
    faces: u64,
    state: State,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Open,
    Ended,
    Failed,
}

/// State that moves while the body is read.
pub(super) struct Body<R> {
    pub(super) source: Source<R>,
    pub(super) invalid_data: Invalid,
    pub(super) vertex_count: u64,
    /// How many of the current element were read whole.
    pub(super) index: u64,
    pub(super) strip: Strip,
    /// Corners of one face.
    pub(super) corners: Vec<u32>,
    pub(super) grid: Grid,
    /// Vertices that are not finite.
    pub(super) invalid: VertexSet,
    pub(super) tally: Tally,
    /// Vertices whose colours are real numbers beyond 0 to 1.
    pub(super) clamped: u64,
    /// Texture coordinates of the last vertices, where they are asked for.
    pub(super) coordinates: Vec<[f32; 2]>,
    /// How faces name images, where they do.
    pub(super) wedges: Option<Box<Wedges>>,
}

impl<R: Read> PlyReader<R> {
    /// Reads the header. Does not read beyond it by more than a block of 1 MiB.
    ///
    /// # Errors
    /// If the header is none, or describes no mesh: see the variants of [`PlyError`] without a [`SourceLocation`].
    pub fn new(reader: R, options: Options) -> Result<Self, PlyError> {
        let mut source = Source::new(reader);
        let header = Header::parse(&mut source)?;
        let schema = Schema::new(&header, &options)?;
        let body = Body {
            source,
            invalid_data: options.invalid,
            vertex_count: header.vertex_count,
            index: 0,
            strip: Strip::default(),
            corners: Vec::new(),
            grid: Grid::default(),
            invalid: VertexSet::default(),
            tally: Tally::default(),
            clamped: 0,
            coordinates: Vec::new(),
            wedges: None,
        };
        Ok(PlyReader { header, schema, body, element: 0, vertices: 0, faces: 0, state: State::Open })
    }

    /// Hands over texture coordinates: those of vertices, to be taken after each batch, and triangles of faces that `wedges` is for.
    /// To be called before all else.
    pub(super) fn read_textures(&mut self, of_vertices: Option<[Field; 2]>, wedges: Option<Wedges>) {
        self.schema.warnings.retain(|warning| !matches!(warning, Warning::TextureDropped { .. }));
        self.body.wedges = wedges.map(Box::new);
        for role in &mut self.schema.roles {
            if let (Role::Vertices(plan), Some(fields)) = (role, of_vertices) {
                plan.texture = Some(fields);
                let slots = fields.iter().enumerate();
                slots.for_each(|(axis, field)| plan.slots[field.property] = Slot::Texture(axis));
            }
        }
    }

    /// Texture coordinates of the vertices since this was asked last.
    pub(super) fn take_coordinates(&mut self, out: &mut Vec<[f32; 2]>) {
        out.clear();
        std::mem::swap(out, &mut self.body.coordinates);
    }

    /// Faces up to now whose image or coordinates are none that there may be.
    pub(super) fn wrongly_textured(&self) -> u64 {
        self.body.wedges.as_ref().map_or(0, |wedges| wedges.wrong)
    }

    /// Header of the file.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Format of the delivered vertices.
    pub fn vertex_format(&self) -> VertexFormat {
        self.schema.format
    }

    /// The named scalars that are delivered, without their ranges.
    pub fn scalars(&self) -> &[Scalar] {
        self.schema.scalars()
    }

    /// Whether triangles are made of a range grid.
    pub fn has_grid(&self) -> bool {
        self.schema.roles.iter().any(|role| matches!(role, Role::Grid(..)))
    }

    /// Losses and changes; complete when the stream has ended.
    pub fn warnings(&self) -> &[Warning] {
        &self.schema.warnings
    }

    /// Elements that were not delivered up to now.
    pub fn tally(&self) -> Tally {
        self.body.tally
    }

    /// Bytes of the file that are behind us, header included.
    pub fn bytes_read(&self) -> u64 {
        self.body.source.offset()
    }

    /// Refills `batch` with what comes next in the file. A batch holds vertices or faces and never both, some 16 thousand at
    /// most, or one polygon more.
    ///
    /// # Errors
    /// See the variants of [`PlyError`] with a [`SourceLocation`]. The batch then holds nothing of use, and the stream is
    /// over: calling again is [`PlyError::Ended`].
    pub fn next_batch(&mut self, batch: &mut Batch) -> Result<BatchKind, PlyError> {
        batch.clear();
        if self.state == State::Failed {
            return Err(PlyError::Ended);
        }
        let result = self.fill(batch);
        if result.is_err() {
            self.state = State::Failed;
        }
        result
    }

    fn fill(&mut self, batch: &mut Batch) -> Result<BatchKind, PlyError> {
        while self.state == State::Open {
            let Some(element) = self.header.elements.get(self.element) else {
                self.end()?;
                break;
            };

            let role = &self.schema.roles[self.element];
            let result = match role {
                Role::Skip => self.body.skip(element),
                Role::Vertices(plan) => self.body.vertices(element, plan, self.schema.format, batch),
                Role::Faces(plan) => self.body.faces(element, plan, batch),
                Role::Strips(plan) => self.body.strips(element, plan, batch),
                Role::Grid(plan, columns) => self.body.grid(element, plan, *columns, batch),
            };

            match result {
                Ok(()) if self.body.index >= element.count => {
                    self.element += 1;
                    self.body.index = 0;
                }
                Ok(()) => {}
                Err(Fault::End) if self.body.invalid_data == Invalid::Drop => self.end_early(),
                Err(Fault::LineGoesOn(got)) if self.body.index == 0 => {
                    // The line is that of the last element of those before.
                    let before = self.header.elements[..self.element].iter().rev().find(|it| it.count > 0);
                    let element = before.unwrap_or(element);
                    self.body.index = element.count;
                    return Err(self.body.locate(element, Fault::LineGoesOn(got)));
                }
                Err(fault) => return Err(self.body.locate(element, fault)),
            }

            if batch.vertex_count() > 0 {
                batch.first = self.vertices;
                self.vertices += batch.vertex_count() as u64;
                return Ok(BatchKind::Vertices);
            }
            if batch.has_faces() {
                batch.first = self.faces;
                self.faces += (batch.triangles.len() + batch.polygons.iter().count()) as u64;
                return Ok(BatchKind::Triangles);
            }
        }
        Ok(BatchKind::End)
    }

    /// The body is whole; looks whether something comes after it.
    fn end(&mut self) -> Result<(), PlyError> {
        self.warn_of_attributes();
        let source = &mut self.body.source;
        let trailing = match source.encoding {
            Encoding::Ascii => source.skip_space(),
            _ => source.need(1),
        };
        let offset = source.offset();
        if trailing.map_err(|error| PlyError::Read { offset, source: error })? {
            self.schema.warnings.push(Warning::TrailingData { offset });
        }
        self.state = State::Ended;
        Ok(())
    }

    /// The file is cut, and what is missing is counted.
    fn end_early(&mut self) {
        let mut read = self.body.index;
        for (element, role) in self.header.elements.iter().zip(&self.schema.roles).skip(self.element) {
            let missing = element.count - read;
            match role {
                Role::Skip | Role::Grid(..) => {}
                Role::Vertices(_) => self.body.tally.missing_vertices += missing,
                Role::Faces(_) | Role::Strips(_) => {
                    self.body.tally.missing_faces = self.body.tally.missing_faces.saturating_add(missing);
                }
            }
            read = 0;
        }
        self.warn_of_attributes();
        self.state = State::Ended;
    }

    fn warn_of_attributes(&mut self) {
        let count = self.body.tally.zeroed_normals;
        if count > 0 {
            self.schema.warnings.push(Warning::NormalsZeroed { count });
        }
        let count = self.body.clamped;
        if count > 0 {
            self.schema.warnings.push(Warning::ColorsClamped { count });
        }
    }
}

impl<R: Read> Body<R> {
    /// Skips all of an element.
    fn skip(&mut self, element: &Element) -> Result<(), Fault> {
        if element.properties.is_empty() {
            self.index = element.count;
            return Ok(());
        }
        let stride: Option<u64> = match self.source.encoding {
            Encoding::Ascii => None,
            _ => element.properties.iter().try_fold(0, |sum, property| match property.ty {
                PropertyType::Scalar(ty) => Some(sum + ty.size() as u64),
                PropertyType::List { .. } => None,
            }),
        };
        if let Some(stride) = stride {
            // A length that overflows is beyond the end of every file.
            let length = element.count.saturating_mul(stride);
            let skipped = self.source.skip(length)?;
            self.index = skipped / stride;
            return if skipped < length { Err(Fault::End) } else { Ok(()) };
        }
        while self.index < element.count {
            self.source.begin_element()?;
            self.source.skip_values(element.properties.iter().map(|property| &property.ty))?;
            self.index += 1;
        }
        Ok(())
    }

    fn locate(&self, element: &Element, fault: Fault) -> PlyError {
        let offset = match fault {
            Fault::End | Fault::Io(_) => self.source.read_offset(),
            _ => self.source.mark,
        };
        let line = (self.source.encoding == Encoding::Ascii).then_some(self.source.line);
        let place = SourceLocation { element: element.name.clone(), index: self.index, offset, line };
        match fault {
            Fault::Io(source) => PlyError::Read { offset, source },
            Fault::End => PlyError::Truncated { place, read: self.index, count: element.count },
            Fault::LineGoesOn(got) => {
                let place = SourceLocation { index: self.index.saturating_sub(1), ..place };
                let expected = "the line to end here, as the header declares no more values";
                PlyError::Number { place, expected, got }
            }
            Fault::Number { expected, got } => PlyError::Number { place, expected, got },
            Fault::NegativeCount(count) => PlyError::NegativeCount { place, count },
            Fault::TooManyCorners(count) => PlyError::TooManyCorners { place, count, limit: MAX_CORNERS },
            Fault::NotFinite { property, value } => PlyError::NotFinite { place, property, value },
            Fault::Index(index) => PlyError::IndexOutOfRange { place, index, vertices: self.vertex_count },
        }
    }
}

/// Reads a whole file into core; positions in double precision are rounded to single.
///
/// Vertices that are dropped stay in the mesh, at the zero point and in no triangle.
///
/// # Errors
/// As [`PlyReader`], and [`PlyError::BeyondSingle`].
pub fn read_mesh<R: Read>(reader: R, options: Options) -> Result<(TriMesh, Tally, Vec<Warning>), PlyError> {
    let mut reader = PlyReader::new(reader, options)?;
    let mut mesh = TriMesh::default();
    let (mut batch, mut words) = (Batch::default(), Vec::new());
    while reader.next_batch(&mut batch)? != BatchKind::End {
        for (vertex, position) in (batch.first..).zip(&batch.positions_f64) {
            let beyond = position.iter().find(|x| !(**x as f32).is_finite());
            let place = batch.far.iter().find(|place| place.index == vertex);
            if let (Some(&value), Some(place)) = (beyond, place) {
                return Err(PlyError::BeyondSingle { place: place.clone(), value });
            }
        }
        mesh.append_vertices(&mut batch.vertices);
        mesh.positions.extend(batch.positions_f64.iter().map(|position| position.map(|x| x as f32)));
        mesh.triangles.append(&mut batch.triangles);
        words.extend_from_slice(batch.polygons.as_words());
    }

    // Polygons are cut last, since their corners' positions may come after them.
    let mut tally = reader.tally();
    let (mut triangulator, mut places) = (Triangulator::default(), Vec::new());
    for corners in polygon::each(&words) {
        places.clear();
        places
            .extend(corners.iter().filter_map(|v| mesh.positions.get(*v as usize)).map(|p| p.map(f64::from)));
        if places.len() == corners.len() {
            tally.degenerate_faces += triangulator.cut(corners, &places, &mut mesh.triangles);
        }
    }
    Ok((mesh, tally, reader.schema.warnings))
}
