//! How vertices are delivered: the type of their coordinates, and their attributes.

use chpm_mesh::Attributes;

/// Format of the delivered vertices.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct VertexFormat {
    /// Type of the coordinates in the file, and how they are delivered.
    pub coordinates: Coordinates,
    /// Attributes that come with each position.
    pub attributes: Attributes,
}

/// Type of a file's coordinates.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Coordinates {
    /// Of types that f32 holds; delivered as f32.
    Single,
    /// Of types that f32 does not hold; delivered as f64.
    Double,
    /// Text, whose digits may say anything; delivered as f64.
    Text,
    /// Text that is declared to be f32; delivered as f64, since its digits may say more all the same.
    TextOfSingles,
}

impl Coordinates {
    /// Whether positions are delivered as f64.
    pub fn are_double(self) -> bool {
        self != Coordinates::Single
    }
}
