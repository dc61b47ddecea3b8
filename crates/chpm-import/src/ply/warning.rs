//! Content of a file that does not reach the mesh.

use super::header::ScalarType;
use chpm_mesh::Counted;
use std::fmt;

/// Something that was left out or changed on the way; the text says what.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Warning {
    /// An element that is no part of a mesh was skipped.
    ElementSkipped {
        /// Name of the element.
        element: String,
        /// How many of them.
        count: u64,
    },
    /// Texture coordinates were dropped.
    TextureDropped {
        /// Name of the element.
        element: String,
        /// Names of the properties.
        properties: Vec<String>,
    },
    /// Attributes of faces or strips were dropped.
    FaceAttributesDropped {
        /// Name of the element.
        element: String,
        /// Names of the properties.
        properties: Vec<String>,
    },
    /// Properties of vertices were dropped.
    VertexPropertiesDropped {
        /// Name of the element.
        element: String,
        /// Names of the properties.
        properties: Vec<String>,
    },
    /// Normals were rounded to single precision.
    NormalsRounded {
        /// Type in the file.
        from: ScalarType,
    },
    /// Colours were quantised to eight bits.
    ColorsQuantised {
        /// Type in the file.
        from: ScalarType,
    },
    /// Normals that are not finite were replaced by zero.
    NormalsZeroed {
        /// How many.
        count: u64,
    },
    /// Colours of real numbers were beyond 0 to 1.
    ColorsClamped {
        /// Of how many vertices.
        count: u64,
    },
    /// There is data after the last element; it was not read.
    TrailingData {
        /// Offset in bytes at which it begins.
        offset: u64,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Warning::ElementSkipped { element, count } => {
                write!(f, "skipped {} '{element}'", Counted(*count, "element"))
            }
            Warning::TextureDropped { element, properties } => {
                write!(f, "dropped texture coordinates of '{element}': {}", properties.join(", "))
            }
            Warning::FaceAttributesDropped { element, properties } => {
                write!(f, "dropped face attributes of '{element}': {}", properties.join(", "))
            }
            Warning::VertexPropertiesDropped { element, properties } => {
                write!(f, "dropped vertex properties of '{element}': {}", properties.join(", "))
            }
            Warning::NormalsRounded { from } => write!(f, "rounded normals from {from} to float"),
            Warning::ColorsQuantised { from } if from.is_integer() && *from != ScalarType::UShort => {
                write!(f, "quantised colours from {from} to uchar: values were taken as 0 to 255 and clamped")
            }
            Warning::ColorsQuantised { from } => write!(f, "quantised colours from {from} to uchar"),
            Warning::NormalsZeroed { count } => {
                write!(f, "replaced by zero {} without finite numbers", Counted(*count, "normal"))
            }
            Warning::ColorsClamped { count } => {
                let vertices = Counted(*count, "vertex");
                write!(f, "clamped colours of {vertices} to 0 to 1; if they go to 255, save them as uchar")
            }
            Warning::TrailingData { offset } => {
                write!(f, "ignored data after the last element, from byte {offset} on")
            }
        }
    }
}
