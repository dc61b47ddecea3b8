//! Options of the reader, and batches.

use super::error::Place;
use crate::Polygons;
use chpm_mesh::Vertices;

/// Treatment of invalid data.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Invalid {
    /// Stop with an error that says where.
    #[default]
    Refuse,
    /// Go on without it, and count it in the [`Tally`].
    ///
    /// A vertex with a coordinate that is not finite is delivered as the zero point and listed in
    /// [`Batch::invalid_vertices`], so that indices stay as they are. Faces, and triangles of strips, that use such a vertex or
    /// an index out of range are not delivered. A file that ends early ends the stream early. Needs the vertices
    /// before the faces. Text that is no number, and absurd lists, are refused all the same: nothing after them can be trusted.
    Drop,
}

/// Which named scalars of vertices to deliver: numbers besides coordinates, normals and colours.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Keep {
    /// All that the file has. None is missed where it has none.
    pub all: bool,
    /// These, in this order and before all others; each must be there.
    pub names: Vec<String>,
}

/// From names as users give them; `all` means all.
impl From<Vec<String>> for Keep {
    fn from(mut names: Vec<String>) -> Keep {
        let all = names.iter().any(|name| name == "all");
        names.retain(|name| name != "all");
        Keep { all, names }
    }
}

/// How to read.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Options {
    /// Treatment of invalid data. Default: refuse.
    pub invalid: Invalid,
    /// Whether to deliver vertex normals if there are any. Default: yes.
    pub normals: bool,
    /// Whether to deliver vertex colours if there are any. Default: yes.
    pub colors: bool,
    /// Which named scalars to deliver. Default: none.
    pub keep: Keep,
}

impl Default for Options {
    fn default() -> Self {
        Options { invalid: Invalid::Refuse, normals: true, colors: true, keep: Keep::default() }
    }
}

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
    /// Positions are empty if the file's coordinates need double precision. Normals are as given: not necessarily of unit length; zero where
    /// not finite.
    pub vertices: Vertices,
    /// Positions if the file's coordinates need double precision, else empty.
    pub positions_f64: Vec<[f64; 3]>,
    /// Indices, in this file, of vertices of this batch that are not finite; always empty with [`Invalid::Refuse`].
    pub invalid_vertices: Vec<u64>,
    /// Vertices of this batch with a coordinate beyond [`FAR`](chpm_mesh::FAR): where each is, ascending.
    pub far: Vec<Place>,
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
}

impl Batch {
    /// Vertices, triangles or corners of polygons after which a batch is handed over; only a polygon can take it beyond.
    pub(crate) const FULL: usize = 1 << 14;

    pub(crate) fn clear(&mut self) {
        self.vertices.clear_vertices();
        self.positions_f64.clear();
        self.invalid_vertices.clear();
        self.far.clear();
        self.listed_normals.clear();
        self.corner_normals.clear();
        self.triangles.clear();
        self.polygons.clear();
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

    pub(super) fn vertex_count(&self) -> usize {
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
