//! In which coordinates a mesh is written: turned so that its up is where a format has it, relative to a point near it, without attributes that nobody wants.

use chpm_export::Turn;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, Attributes, VertexSlices, Vertices};

/// Transformation of a file's vertices.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    turn: Turn,
    /// Origin of the file's positions, turned.
    origin: [f64; 3],
    /// Vector taken off positions, besides the file's origin.
    less: [f32; 3],
    /// Origin of written positions, turned; none where coordinates are the model's.
    offset: Option<[f64; 3]>,
    /// How far writing moves a vertex at most.
    rounding: f64,
    normals: bool,
    colors: bool,
}

impl Frame {
    /// The coordinates of a file.
    pub(crate) fn new(file: &Chpm<MappedFile>) -> Self {
        let origin = file.header().origin;
        Frame {
            turn: Turn::NONE,
            origin,
            less: [0.0; 3],
            offset: None,
            rounding: 0.0,
            normals: true,
            colors: true,
        }
    }

    /// Leaves attributes out.
    pub(crate) fn without(self, normals: bool, colors: bool) -> Self {
        Frame { normals: !normals, colors: !colors, ..self }
    }

    /// Relative to the middle of the model: to the file's origin, if it has one, so that nothing is rounded.
    pub(crate) fn about_middle(self, file: &Chpm<MappedFile>) -> Self {
        let header = file.header();
        if header.origin != [0.0; 3] {
            return Frame { offset: Some(header.origin), ..self };
        }
        let Aabb { min, max } = header.aabb();
        let less = [0, 1, 2].map(|axis| min[axis] / 2.0 + max[axis] / 2.0);
        let rounding = chpm_export::rounding(&header.aabb(), less.map(|x| -f64::from(x)));
        Frame { less, offset: Some(less.map(f64::from)), rounding, ..self }
    }

    /// Turned, origin and all.
    pub(crate) fn turned(self, turn: Turn) -> Self {
        let (origin, offset) = (turn.apply(self.origin), self.offset.map(|offset| turn.apply(offset)));
        Frame { turn, origin, offset, ..self }
    }

    /// Rounded by so much on the way into a format.
    pub(crate) fn rounded(self, rounding: f64) -> Self {
        Frame { rounding: self.rounding + rounding, ..self }
    }

    /// Origin of written positions; none where coordinates are the model's.
    pub(crate) fn offset(&self) -> Option<[f64; 3]> {
        self.offset
    }

    /// Vector to add to positions that are handed out, unless it is zero: then it takes more than single precision.
    pub(crate) fn origin(&self) -> Option<[f64; 3]> {
        Some(self.origin).filter(|origin| self.offset.is_none() && *origin != [0.0; 3])
    }

    /// How far writing moves a vertex at most.
    pub(crate) fn rounding(&self) -> f64 {
        self.rounding
    }

    /// Of these, what is written.
    pub(crate) fn attributes(&self, of: Attributes) -> Attributes {
        Attributes { normals: of.normals && self.normals, colors: of.colors && self.colors, ..of }
    }

    /// Where a position is written.
    fn place(&self, position: [f32; 3]) -> [f32; 3] {
        // Through doubles, so that what is lost is lost once.
        let near = [0, 1, 2].map(|axis| f64::from(position[axis]) - f64::from(self.less[axis]));
        self.turn.apply(near.map(|x| x as f32))
    }

    /// The box around what is written of a box.
    pub(crate) fn bounds(&self, of: &Aabb) -> Aabb {
        Aabb::of_points(&[of.min, of.max].map(|corner| self.place(corner)))
    }

    /// Vertices as they are written; `room` is for what has changed.
    pub(crate) fn apply<'a>(&self, from: VertexSlices<'a>, room: &'a mut Vertices) -> VertexSlices<'a> {
        let kept = VertexSlices {
            normals: if self.normals { from.normals } else { &[] },
            colors: if self.colors { from.colors } else { &[] },
            ..from
        };
        if self.turn == Turn::NONE && self.less == [0.0; 3] {
            return kept;
        }
        room.clear_vertices();
        room.extend_from_slices(kept);
        room.positions.iter_mut().for_each(|position| *position = self.place(*position));
        room.normals.iter_mut().for_each(|normal| *normal = self.turn.apply(*normal));
        room.view()
    }
}
