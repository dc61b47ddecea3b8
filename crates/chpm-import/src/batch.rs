//! Batches of vertices and faces, which every reader hands over, and counts of what was left out of them.

use crate::Polygons;
use crate::location::SourceLocation;
use chpm_mesh::Vertices;
use chpm_texture::TexturedTriangle;

/// Vertices that a file may have at most: an index is a `u32`, and one value of it is kept free.
pub const MAX_VERTICES: u64 = u32::MAX as u64;

/// Corners that one polygon may have at most; it is read whole, so that a bad corner can drop all of it.
pub const MAX_CORNERS: u64 = 1 << 20;

/// Content of a [`Batch`].
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum BatchKind {
    /// At least one vertex.
    Vertices,
    /// At least one triangle or polygon.
    Triangles,
    /// Nothing: the stream is over.
    End,
}

/// Some vertices or some faces; refilled by every call, so that its memory is used again.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Batch {
    /// Index of the first vertex, or the number of faces delivered before.
    pub first: u64,
    /// The vertex that triangles count from: 0, but in a set of files with more vertices than a `u32` numbers.
    pub base: u64,
    /// Positions are empty if the file's coordinates need double precision. Normals are as given: not necessarily of unit length; zero where
    /// not finite.
    pub vertices: Vertices,
    /// Positions if the file's coordinates need double precision, else empty.
    pub positions_f64: Vec<[f64; 3]>,
    /// Indices, in this file, of vertices of this batch that are not finite; always empty with [`Invalid::Refuse`](crate::Invalid::Refuse).
    pub invalid_vertices: Vec<u64>,
    /// Vertices of this batch with a coordinate beyond [`FAR`](chpm_mesh::FAR): where each is, ascending.
    pub far: Vec<SourceLocation>,
    /// Normals that corners of faces name, numbered through the whole file; zero where not finite. For formats that give them to
    /// corners and not to vertices.
    pub listed_normals: Vec<[f32; 3]>,
    /// For each corner of a face its vertex and the number of its normal, which may come later; [`u32::MAX`], told once, if it
    /// has none. Empty if there are no normals or none are asked for.
    pub corner_normals: Vec<[u32; 2]>,
    /// Triangles: three different vertices each, all in range.
    pub triangles: Vec<[u32; 3]>,
    /// Faces of more than three corners, all in range: which triangles they are is known when all vertices are. They come
    /// after the triangles of the whole file; see [`Triangulator`](crate::Triangulator).
    pub polygons: Polygons,
    /// Triangles with texture coordinates: where images are asked for, those of all faces that have a material, in any order and whenever
    /// they are known.
    pub textured: Vec<TexturedTriangle>,
}

impl Batch {
    /// Vertices, triangles or corners of polygons after which a batch is handed over; only a polygon can take it beyond.
    pub(crate) const FULL: usize = 1 << 14;

    pub(crate) fn clear(&mut self) {
        self.base = 0;
        self.vertices.clear_vertices();
        self.positions_f64.clear();
        self.invalid_vertices.clear();
        self.far.clear();
        self.listed_normals.clear();
        self.corner_normals.clear();
        self.triangles.clear();
        self.polygons.clear();
        self.textured.clear();
    }

    /// Whether there are as many faces as a batch should have.
    pub(crate) fn is_full_of_faces(&self) -> bool {
        self.triangles.len() >= Batch::FULL || self.polygons.as_words().len() >= 4 * Batch::FULL
    }

    /// Whether there is any face.
    pub(crate) fn has_faces(&self) -> bool {
        !self.triangles.is_empty() || !self.polygons.is_empty()
    }

    /// A face: a polygon, a triangle, or one that counts as degenerate. Returns whether it is delivered.
    pub(crate) fn push_face(&mut self, corners: &[u32], tally: &mut Tally) -> bool {
        match *corners {
            [a, b, c] if a != b && b != c && c != a => self.triangles.push([a, b, c]),
            [_, _, _, _, ..] => {
                tally.polygons_triangulated += 1;
                self.polygons.push(corners);
            }
            _ => {
                tally.degenerate_faces += 1;
                return false;
            }
        }
        true
    }

    /// Vertices in it.
    pub fn vertex_count(&self) -> usize {
        self.vertices.vertex_count().max(self.positions_f64.len())
    }
}

/// Elements that were not delivered as they are in the file.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Tally {
    /// Vertices with a coordinate that is not finite (delivered as zero and listed).
    pub dropped_vertices: u64,
    /// Faces, and triangles of strips, with an invalid corner.
    pub dropped_faces: u64,
    /// Vertices that the header declares and the file has not.
    pub missing_vertices: u64,
    /// Faces and strip lists that the header declares and the file has not, or not whole.
    pub missing_faces: u64,
    /// Faces of fewer than three corners, and triangles with two equal corners. Never delivered. Those that polygons would have
    /// are counted by who cuts them.
    pub degenerate_faces: u64,
    /// Faces of more than three corners.
    pub polygons_triangulated: u64,
    /// Triangle strips of at least three corners.
    pub strips: u64,
    /// Normals that were not finite and are delivered as zero.
    pub zeroed_normals: u64,
}

impl Tally {
    /// Adds the counts of another file.
    pub fn add(&mut self, other: &Tally) {
        let sums = [
            (&mut self.dropped_vertices, other.dropped_vertices),
            (&mut self.dropped_faces, other.dropped_faces),
            (&mut self.missing_vertices, other.missing_vertices),
            (&mut self.missing_faces, other.missing_faces),
            (&mut self.degenerate_faces, other.degenerate_faces),
            (&mut self.polygons_triangulated, other.polygons_triangulated),
            (&mut self.strips, other.strips),
            (&mut self.zeroed_normals, other.zeroed_normals),
        ];
        for (sum, count) in sums {
            *sum = sum.saturating_add(count);
        }
    }
}
