//! Vertex data: a position for each vertex, and the attributes that a mesh carries besides.
//!
//! Every stage copies, gathers and compares vertices by the types of this file, whatever they carry. Whoever adds an attribute adds it here, to
//! `VertexColumns` of `chpm-build` for what does not fit memory, to the readers and writers of sources, and to the page of the file.

use crate::octahedral::Octahedral;
use crate::scalar::MOST_SCALAR_WORDS;
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

/// Which per-vertex attributes a mesh carries; an attribute that is not there takes no bytes.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct Attributes {
    /// Unit (or as-given) normals, three f32 each.
    pub normals: bool,
    /// Normals of three bytes each, in place of those.
    pub octahedral: bool,
    /// Colours, four bytes each: red, green, blue, alpha.
    pub colors: bool,
    /// Words of named scalars, four bytes each; see [`scalar`](crate::scalar).
    pub scalar_words: u8,
}

impl Attributes {
    /// Positions only.
    pub const NONE: Attributes =
        Attributes { normals: false, octahedral: false, colors: false, scalar_words: 0 };
    /// Every attribute that a source can have without a name of its own.
    pub const ALL: Attributes = Attributes { normals: true, colors: true, ..Attributes::NONE };

    /// Whether vertices have normals, however they are stored.
    pub fn has_normals(self) -> bool {
        self.normals || self.octahedral
    }

    /// Bytes of a vertex: its position and what it carries.
    pub fn vertex_len(self) -> usize {
        let lens = [(self.normals, 12), (self.octahedral, 3), (self.colors, 4)];
        let named = 4 * usize::from(self.scalar_words);
        12 + named + lens.iter().map(|(is_carried, len)| if *is_carried { *len } else { 0 }).sum::<usize>()
    }

    /// The same with normals of three numbers each, if there are any.
    pub fn decoded(self) -> Attributes {
        Attributes { normals: self.has_normals(), octahedral: false, ..self }
    }

    /// Attributes that both have.
    pub fn common(self, other: Attributes) -> Attributes {
        Attributes {
            normals: self.normals && other.normals,
            octahedral: self.octahedral && other.octahedral,
            colors: self.colors && other.colors,
            scalar_words: self.scalar_words.min(other.scalar_words),
        }
    }

    /// Attributes that one of the two has, or both.
    pub fn joined(self, other: Attributes) -> Attributes {
        Attributes {
            normals: self.normals || other.normals,
            octahedral: self.octahedral || other.octahedral,
            colors: self.colors || other.colors,
            scalar_words: self.scalar_words.max(other.scalar_words),
        }
    }
}

/// One vertex with every attribute but named scalars; those that its mesh does not carry are zero.
#[derive(Clone, Copy, PartialEq, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Vertex {
    /// Object units.
    pub position: [f32; 3],
    /// As given, or a unit vector of those that three bytes can tell.
    pub normal: [f32; 3],
    /// Red, green, blue, alpha.
    pub color: [u8; 4],
}

impl Vertex {
    /// The bits of these attributes, to sort and compare by.
    pub fn look(&self) -> ([u32; 3], [u8; 4]) {
        (self.normal.map(f32::to_bits), self.color)
    }
}

/// Vertices, an array for each attribute; one that they do not carry is empty, the others are as long as the positions.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Vertices {
    /// Vertex positions, object units.
    pub positions: Vec<[f32; 3]>,
    /// Vertex normals, or empty.
    pub normals: Vec<[f32; 3]>,
    /// Vertex normals of three bytes, or empty.
    pub octahedral: Vec<Octahedral>,
    /// Vertex colours (RGBA), or empty.
    pub colors: Vec<[u8; 4]>,
    /// The words of each vertex's named scalars, as many for each; or empty.
    pub scalars: Vec<u32>,
}

impl Vertices {
    /// Vertices that carry nothing else.
    pub fn new(positions: Vec<[f32; 3]>) -> Self {
        Vertices { positions, ..Vertices::default() }
    }

    /// No vertices, and room for `count` of them.
    pub fn with_capacity(count: usize, carried: Attributes) -> Self {
        fn room(is_carried: bool, count: usize) -> usize {
            if is_carried { count } else { 0 }
        }
        Vertices {
            positions: Vec::with_capacity(count),
            normals: Vec::with_capacity(room(carried.normals, count)),
            octahedral: Vec::with_capacity(room(carried.octahedral, count)),
            colors: Vec::with_capacity(room(carried.colors, count)),
            scalars: Vec::with_capacity(count * usize::from(carried.scalar_words)),
        }
    }

    /// All of them, to look at.
    #[inline]
    pub fn view(&self) -> VertexSlices<'_> {
        VertexSlices {
            positions: &self.positions,
            normals: &self.normals,
            octahedral: &self.octahedral,
            colors: &self.colors,
            scalars: &self.scalars,
        }
    }

    /// Attributes of the vertices.
    pub fn attributes(&self) -> Attributes {
        self.view().attributes()
    }

    /// How many there are.
    #[inline]
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Drops all vertices and keeps the memory.
    pub fn clear_vertices(&mut self) {
        self.positions.clear();
        self.normals.clear();
        self.octahedral.clear();
        self.colors.clear();
        self.scalars.clear();
    }

    /// Appends a vertex with those of its attributes that are `carried`; its scalars are to follow.
    #[inline]
    pub fn push_vertex(&mut self, vertex: &Vertex, carried: Attributes) {
        self.positions.push(vertex.position);
        self.normals.extend(carried.normals.then_some(vertex.normal));
        self.octahedral.extend(carried.octahedral.then(|| Octahedral::of(vertex.normal.map(f64::from))));
        self.colors.extend(carried.colors.then_some(vertex.color));
    }

    /// Appends other vertices, which carry the same.
    pub fn extend_from_slices(&mut self, from: VertexSlices<'_>) {
        self.positions.extend_from_slice(from.positions);
        self.normals.extend_from_slice(from.normals);
        self.octahedral.extend_from_slice(from.octahedral);
        self.colors.extend_from_slice(from.colors);
        self.scalars.extend_from_slice(from.scalars);
    }

    /// Appends those of other vertices that `order` names, in its order.
    #[inline]
    pub fn gather(&mut self, from: VertexSlices<'_>, order: impl Iterator<Item = usize> + Clone) {
        self.positions.extend(order.clone().map(|v| from.positions[v]));
        if !from.normals.is_empty() {
            self.normals.extend(order.clone().map(|v| from.normals[v]));
        }
        if !from.octahedral.is_empty() {
            self.octahedral.extend(order.clone().map(|v| from.octahedral[v]));
        }
        if !from.colors.is_empty() {
            self.colors.extend(order.clone().map(|v| from.colors[v]));
        }
        if !from.scalars.is_empty() {
            order.for_each(|v| self.scalars.extend_from_slice(from.scalars_of(v)));
        }
    }

    /// Turns normals of three bytes into those of three numbers.
    pub fn decode_normals(&mut self) {
        self.normals.extend(self.octahedral.drain(..).map(|code| code.vector()));
    }

    /// Appends other vertices and leaves none of them behind.
    pub fn append_vertices(&mut self, other: &mut Vertices) {
        self.positions.append(&mut other.positions);
        self.normals.append(&mut other.normals);
        self.octahedral.append(&mut other.octahedral);
        self.colors.append(&mut other.colors);
        self.scalars.append(&mut other.scalars);
    }
}

/// [`Vertices`] that lie elsewhere, as in a page of a file.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct VertexSlices<'a> {
    /// Vertex positions.
    pub positions: &'a [[f32; 3]],
    /// Normals, one a vertex or none.
    pub normals: &'a [[f32; 3]],
    /// Normals of three bytes, one a vertex or none.
    pub octahedral: &'a [Octahedral],
    /// Colours (RGBA), one a vertex or none.
    pub colors: &'a [[u8; 4]],
    /// The words of each vertex's named scalars, or none.
    pub scalars: &'a [u32],
}

impl<'a> VertexSlices<'a> {
    /// Vertices that carry nothing else.
    pub fn new(positions: &'a [[f32; 3]]) -> Self {
        VertexSlices { positions, ..VertexSlices::default() }
    }

    /// Attributes of the vertices.
    pub fn attributes(self) -> Attributes {
        Attributes {
            normals: !self.normals.is_empty(),
            octahedral: !self.octahedral.is_empty(),
            colors: !self.colors.is_empty(),
            scalar_words: self.scalars_each() as u8,
        }
    }

    /// Words of a vertex's scalars.
    fn scalars_each(self) -> usize {
        self.scalars.len().checked_div(self.positions.len()).unwrap_or(0)
    }

    /// The words of a vertex's scalars.
    #[inline]
    pub fn scalars_of(self, at: usize) -> &'a [u32] {
        let words = self.scalars_each();
        &self.scalars[at * words..(at + 1) * words]
    }

    /// The normal of a vertex, if vertices have any.
    #[inline]
    pub fn normal(self, at: usize) -> Option<[f32; 3]> {
        self.normals.get(at).copied().or_else(|| self.octahedral.get(at).map(|code| code.vector()))
    }

    /// One vertex.
    #[inline]
    pub fn vertex(self, at: usize) -> Vertex {
        Vertex {
            position: self.positions[at],
            normal: self.normal(at).unwrap_or_default(),
            color: self.colors.get(at).copied().unwrap_or_default(),
        }
    }

    /// The first `count` vertices.
    pub fn first(self, count: usize) -> VertexSlices<'a> {
        VertexSlices {
            positions: &self.positions[..count],
            normals: self.normals.get(..count).unwrap_or_default(),
            octahedral: self.octahedral.get(..count).unwrap_or_default(),
            colors: self.colors.get(..count).unwrap_or_default(),
            scalars: &self.scalars[..count * self.scalars_each()],
        }
    }

    /// An attribute of which there are neither as many as positions nor none: its name, and how many there are.
    pub fn uneven(self) -> Option<(&'static str, usize)> {
        let lens = [
            ("normals", self.normals.len()),
            ("octahedral normals", self.octahedral.len()),
            ("colors", self.colors.len()),
        ];
        let uneven = lens.into_iter().find(|(_, len)| *len != 0 && *len != self.positions.len());
        let (words, count) = (self.scalars.len(), self.positions.len());
        let is_even = words == count * self.scalars_each() && self.scalars_each() <= MOST_SCALAR_WORDS;
        uneven.or((!is_even).then_some(("words of scalars", words)))
    }

    /// Whether every number is finite, but for scalars, which may be anything.
    pub fn is_finite(self) -> bool {
        let mut numbers = self.positions.as_flattened().iter().chain(self.normals.as_flattened());
        numbers.all(|x| x.is_finite())
    }

    /// The positions as the source has them, where these are relative to `origin`.
    pub fn absolute(self, origin: [f64; 3]) -> impl Iterator<Item = [f64; 3]> + use<'a> {
        self.positions.iter().map(move |p| std::array::from_fn(|axis| origin[axis] + f64::from(p[axis])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some(count: u8, carried: Attributes) -> Vertices {
        let mut vertices = Vertices::default();
        for i in 0..count {
            let x = f32::from(i);
            // Normals that both encodings keep.
            let normal = [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]][usize::from(i % 2)];
            let vertex = Vertex { position: [x; 3], normal, color: [i, 1, 2, 255] };
            vertices.push_vertex(&vertex, carried);
            vertices
                .scalars
                .extend((0..carried.scalar_words).map(|word| u32::from(i) << 8 | u32::from(word)));
        }
        vertices
    }

    #[test]
    fn every_operation_takes_what_vertices_carry() {
        for bits in 0..18 {
            let carried = Attributes {
                normals: bits % 3 == 1,
                octahedral: bits % 3 == 2,
                colors: bits % 6 > 2,
                scalar_words: bits / 6,
            };
            let all = some(5, carried);
            assert_eq!((all.attributes(), all.vertex_count(), all.view().uneven()), (carried, 5, None));

            let mut gathered = Vertices::default();
            gathered.gather(all.view(), [4, 0, 4].into_iter());
            let expected = [4, 0, 4].map(|v| all.view().vertex(v));
            assert_eq!([0, 1, 2].map(|v| gathered.view().vertex(v)), expected);
            assert_eq!(gathered.attributes(), carried);
            assert_eq!(
                [0, 1].map(|v| gathered.view().scalars_of(v)),
                [4, 0].map(|v| all.view().scalars_of(v))
            );

            let mut joined = Vertices::default();
            joined.extend_from_slices(all.view().first(2));
            joined.append_vertices(&mut gathered);
            assert_eq!((joined.vertex_count(), gathered), (5, Vertices::default()));
            assert_eq!(joined.view().vertex(2), expected[0]);
            joined.clear_vertices();
            assert_eq!(joined, Vertices::default());
        }
    }

    #[test]
    fn what_is_uneven_or_not_finite_is_found() {
        let mut vertices = some(3, Attributes::ALL);
        assert!(vertices.view().is_finite());
        vertices.normals[2][1] = f32::NAN;
        assert!(!vertices.view().is_finite());
        vertices.colors.pop();
        assert_eq!(vertices.view().uneven(), Some(("colors", 2)));
        vertices.colors.clear();
        vertices.scalars.extend([1, 2, 3, 4]);
        assert_eq!(vertices.view().uneven(), Some(("words of scalars", 4)));
    }

    #[test]
    fn attributes_join_and_meet() {
        let normals = Attributes { normals: true, ..Attributes::NONE };
        let octahedral = Attributes { octahedral: true, ..Attributes::NONE };
        let colors = Attributes { colors: true, ..Attributes::NONE };
        assert_eq!(octahedral.joined(colors).common(octahedral), octahedral);
        assert_eq!([normals, octahedral, colors].map(Attributes::has_normals), [true, true, false]);
        assert_eq!(octahedral.vertex_len(), 15);
        assert_eq!((normals.joined(colors), normals.common(colors)), (Attributes::ALL, Attributes::NONE));
        assert_eq!((Attributes::NONE.vertex_len(), Attributes::ALL.vertex_len()), (12, size_of::<Vertex>()));
    }
}
