//! Materials: colours of triangles.

use serde::{Deserialize, Serialize};

/// Colour of a triangle: an image, and what it is multiplied by.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Material {
    /// Number of the image, for [`OpenImage`](crate::OpenImage); none for the factor alone.
    pub image: Option<u32>,
    /// Red, green and blue as sRGB has them, and alpha, each from 0 to 1. A factor that is linear, as that of glTF, is to be encoded before.
    pub factor: [f32; 4],
    /// The image outside of coordinates from 0 to 1, for u and v.
    pub wrap: [Wrap; 2],
}

/// An image outside of coordinates from 0 to 1.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Wrap {
    /// It begins again.
    #[default]
    Repeat,
    /// It begins again, every other time mirrored.
    Mirror,
    /// Its border goes on.
    Clamp,
}
