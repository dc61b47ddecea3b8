//! Images and materials that a source names, and triangles with texture coordinates, whatever the format.
//!
//! Readers hand over triangles with the coordinates of their corners beside those of the mesh, and say at the end which images and
//! materials these are of. Where an image is not there, or of a kind that is not read, its triangles are grey.

pub(crate) mod beside;
mod cut;
mod image;
mod table;

pub(crate) use cut::Cutter;
pub use image::Image;
pub(crate) use table::{Table, file_beside};

use chpm_texture::Material;

/// Which images of a source are read.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Images {
    /// None: texture coordinates are left out.
    #[default]
    Ignored,
    /// All, if one of them is there; the others are grey.
    IfAny,
    /// All; those that are not there are grey.
    Grey,
    /// All; one that is not there is an error.
    Required,
}

/// Images of a source, and materials that its triangles are of.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    /// Materials, by the numbers that triangles have.
    pub materials: Vec<Material>,
    /// Images, by the numbers that materials have.
    pub images: Vec<Image>,
    /// Whether textures are multiplied by the colours that vertices have of their own, and not put in their place.
    pub tints: bool,
    /// Whether there are colours of materials alone: no material has an image, or should have one.
    pub are_plain: bool,
}

/// Colour that stands for an image that is not there.
pub(crate) const GREY: f32 = 128.0 / 255.0;
