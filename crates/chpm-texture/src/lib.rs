//! Texels of a textured mesh, averaged into the colours of its vertices, out of core.
//!
//! An [`Averager`] takes triangles with the coordinates of their corners, in any order. Then it decodes each image once, strip by
//! strip, gives each texel that a triangle covers to the triangle's corners, and hands out [`VertexColors`]. All sums are of
//! whole numbers, so that the colours depend on neither the memory budget nor the order of triangles.
#![forbid(unsafe_code)]

mod averager;
mod colors;
mod error;
mod footprint;
mod images;
mod material;
mod piece;
mod shares;
pub mod sheet;
mod shown;
mod srgb;
mod texels;
mod tiles;
mod triangle;

pub use averager::Averager;
pub use chpm_image::Alpha;
pub use colors::VertexColors;
pub use error::TextureError;
pub use images::{Images, OpenImage, OpenedImage};
pub use material::{Material, Wrap};
pub use srgb::srgb_product;
pub use texels::texel as linear_texel;
pub use tiles::{TileReader, Tiles};
pub use triangle::TexturedTriangle;
