//! How a source is to be read, whatever its format.

use crate::texture::Images;
use serde::{Deserialize, Serialize};

/// Treatment of invalid data.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Invalid {
    /// Stop with an error that says where.
    #[default]
    Refuse,
    /// Go on without it, and count it in the [`Tally`](crate::Tally).
    ///
    /// A vertex with a coordinate that is not finite is delivered as the zero point and listed in
    /// [`Batch::invalid_vertices`](crate::Batch::invalid_vertices), so that indices stay as they are. Faces, and triangles of strips, that use such a vertex or
    /// an index out of range are not delivered. A file that ends early ends the stream early. Needs the vertices
    /// before the faces. Text that is no number, and absurd lists, are refused all the same: nothing after them can be trusted.
    Drop,
}

/// Which named scalars of vertices to deliver: numbers besides coordinates, normals and colours.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
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
    /// Which images to read. Default: none.
    pub images: Images,
    /// Whether a set of files may have more vertices than a `u32` numbers: then [`Batch::base`](crate::Batch::base) counts. Default: no.
    pub wide: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            invalid: Invalid::Refuse,
            normals: true,
            colors: true,
            keep: Keep::default(),
            images: Images::Ignored,
            wide: false,
        }
    }
}
