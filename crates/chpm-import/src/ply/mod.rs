//! PLY as it is found in the world: a streaming reader that is total on hostile bytes, and a writer.
//!
//! [`PlyReader`] parses the header at once and then hands over the body in [`Batch`]es. It reads the file once,
//! front to back, in blocks of 1 MiB, and nothing that it allocates is sized by a number from the file. What it reads:
//!
//! - ASCII, binary little endian and binary big endian; header lines that end in LF, CRLF or CR; in ASCII every element
//!   begins on a new line, so that a header with wrong counts is found out;
//! - elements in any order, properties in any order and of any scalar type; other elements and properties are skipped, with
//!   a [`Warning`];
//! - `vertex`: `x y z`, and if asked for `nx ny nz`, and `red green blue [alpha]` or `diffuse_red ...`, and
//!   any other number as a named [scalar](chpm_mesh::scalar);
//! - `face`: a list `vertex_indices` or `vertex_index`. Faces of more than three corners come as
//!   [`Polygons`](crate::Polygons);
//! - where images are asked for, comments `TextureFile`, `texcoord` and `texnumber` of faces, and coordinates of vertices;
//! - `tristrips`: the same lists, as strips of alternating winding that -1 restarts;
//! - `range_grid`, where an `obj_info num_cols` line gives the length of its rows: lists of one vertex or none. Neighbours become
//!   triangles, also where the scanner's view jumps in depth: who wants a surface has to leave those out.
//!
//! Coordinates of type `float` or of an integer type of at most 16 bits are delivered as `f32` and are exact; `double`,
//! `int` and `uint` coordinates are delivered as `f64` and are exact too. So is text of any real type, since its digits may
//! say more than the type that the header declares.

mod ascii;
mod binary;
mod error;
mod faces;
mod grid;
mod header;
mod mesh;
mod read;
mod scalars;
mod schema;
mod source;
mod texture;
mod vertices;
mod warning;
mod wedges;
mod write;

pub use crate::batch::{Batch, BatchKind, MAX_CORNERS, MAX_VERTICES, Tally};
pub use crate::location::SourceLocation;
pub use crate::options::{Invalid, Keep, Options};
pub use crate::vertex_format::{Coordinates, VertexFormat};
pub use error::PlyError;
pub use header::{Element, Encoding, Header, Property, PropertyType, ScalarType};
pub(crate) use mesh::FORMAT;
pub use read::{PlyReader, read_mesh};
pub use warning::Warning;
pub use write::{PlyWriter, write_mesh};
