//! Errors of PLY files, with their places.

use super::header::Encoding;
use crate::location::SourceLocation;
use chpm_mesh::MOST_SCALAR_WORDS;
use std::io;

fn scalar_refused(name: &str, lies: Option<&str>, known: &[String]) -> String {
    let known = match known {
        [] => "vertices of this file have none".to_owned(),
        known => format!("vertices of this file have {}", known.join(", ")),
    };
    match lies {
        Some(what) => format!("'{name}' is {what} and no scalar to keep; {known}"),
        None => format!("no scalar '{name}' to keep; {known}"),
    }
}

/// Why a PLY file cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlyError {
    /// The input could not be read.
    #[error("reading failed at byte {offset}: {source}")]
    Read {
        /// Bytes that were read before.
        offset: u64,
        /// Cause.
        source: io::Error,
    },
    /// The file does not begin with a line `ply`.
    #[error("this is not a PLY file: the first line is not 'ply'")]
    NotPly,
    /// The header does not end within its limit.
    #[error("no 'end_header' within the first {limit} bytes; this is not a usable PLY file")]
    HeaderTooLong {
        /// Bytes that a header may have.
        limit: usize,
    },
    /// The file ends inside the header.
    #[error("the file ends at byte {offset}, inside its header; copy the file again")]
    HeaderTruncated {
        /// Length of the file in bytes.
        offset: u64,
    },
    /// A line of the header makes no sense.
    #[error("header line {line}: expected {expected}, got '{got}'")]
    Header {
        /// Line from 1.
        line: u64,
        /// Expected text.
        expected: &'static str,
        /// Found text, shortened.
        got: String,
    },
    /// The format line names no known format.
    #[error(
        "header line {line}: unknown format '{got}'; expected ascii, binary_little_endian or binary_big_endian, \
         version 1.0"
    )]
    Format {
        /// Line from 1.
        line: u64,
        /// Found text, shortened.
        got: String,
    },
    /// The header has no vertices.
    #[error("the header declares no 'vertex' element; there is no mesh in this file")]
    NoVertexElement,
    /// A coordinate is not declared.
    #[error("element 'vertex' has no property '{axis}'; x, y and z are all needed")]
    NoCoordinate {
        /// Name of the coordinate.
        axis: &'static str,
    },
    /// A coordinate is declared as a list.
    #[error("property '{property}' of element '{element}' is a list; expected one number")]
    NotScalar {
        /// Name of the element.
        element: String,
        /// Name of the property.
        property: String,
    },
    /// A scalar that was asked for is not there, or is none.
    #[error("{}", scalar_refused(name, *lies, known))]
    NoScalar {
        /// Its name.
        name: String,
        /// Kind of property that has that name.
        lies: Option<&'static str>,
        /// Names that could be asked for.
        known: Vec<String>,
    },
    /// More scalars than a vertex may have.
    #[error(
        "the scalars to keep take {words} words of a vertex; the limit is {MOST_SCALAR_WORDS}; name those that are needed"
    )]
    TooManyScalars {
        /// Words that they take.
        words: usize,
    },
    /// There is no list of integers to take corners from.
    #[error(
        "element '{element}' has no list of integers 'vertex_indices' or 'vertex_index' to take corners from"
    )]
    NoIndices {
        /// Name of the element.
        element: String,
    },
    /// There are vertices and nothing that connects them.
    #[error("no faces: this is a point cloud of {vertices} vertices; reconstruct a surface first")]
    PointCloud {
        /// Vertices that the header declares.
        vertices: u64,
    },
    /// There are vertices and lines, and no faces.
    #[error(
        "no faces: these are {edges} lines between {vertices} vertices; give a mesh of triangles or polygons"
    )]
    Lines {
        /// Vertices that the header declares.
        vertices: u64,
        /// Lines that the header declares.
        edges: u64,
    },
    /// More vertices than indices can tell apart.
    #[error("the header declares {count} vertices; the limit is {limit}; split the model")]
    TooManyVertices {
        /// Vertices that the header declares.
        count: u64,
        /// Vertices that are possible.
        limit: u64,
    },
    /// Invalid vertices are to be dropped, and the faces come before it is known which these are.
    #[error(
        "element '{element}' comes before the vertices, so faces of invalid vertices cannot be dropped while reading; \
         refuse invalid data instead, or write the vertices first"
    )]
    FacesFirst {
        /// Name of the element.
        element: String,
    },
    /// A corner that is no vertex.
    #[error("{place}: vertex index {index} is out of range; the file has {vertices} vertices")]
    IndexOutOfRange {
        /// Where the index is.
        place: SourceLocation,
        /// The index.
        index: i64,
        /// Vertices that the header declares.
        vertices: u64,
    },
    /// A coordinate that is NaN or infinite.
    #[error(
        "{place}: coordinate '{property}' is {value}; expected a finite number; repair the file, or leave out what has none with --drop-invalid"
    )]
    NotFinite {
        /// Where the coordinate is.
        place: SourceLocation,
        /// Name of the coordinate.
        property: String,
        /// The coordinate.
        value: f64,
    },
    /// The file ends before its elements do.
    #[error(
        "{place}: the file ends here; {read} of {count} of these elements were read; copy the file again"
    )]
    Truncated {
        /// The element that is not whole, and the length of the file.
        place: SourceLocation,
        /// Whole elements of this name.
        read: u64,
        /// Elements of this name that the header declares.
        count: u64,
    },
    /// A text that is no number of its type.
    #[error("{place}: expected {expected}, got '{got}'")]
    Number {
        /// Where the text is.
        place: SourceLocation,
        /// Expected text.
        expected: &'static str,
        /// Found text, shortened.
        got: String,
    },
    /// A list of a negative length.
    #[error("{place}: a list cannot have {count} entries")]
    NegativeCount {
        /// Where the length is.
        place: SourceLocation,
        /// The length.
        count: i64,
    },
    /// A polygon of absurdly many corners.
    #[error(
        "{place}: a polygon of {count} corners; the limit is {limit}; this is most likely a damaged file"
    )]
    TooManyCorners {
        /// Where the number of corners is.
        place: SourceLocation,
        /// The number of corners.
        count: u64,
        /// Corners that are possible.
        limit: u64,
    },
    /// A double coordinate that no `f32` can hold.
    #[error("{place}: coordinate {value:e} is beyond single precision; scale the model down")]
    BeyondSingle {
        /// The vertex.
        place: SourceLocation,
        /// The coordinate.
        value: f64,
    },
    /// The stream was asked for more after it had failed.
    #[error("an earlier error has ended this stream")]
    Ended,
    /// The output could not be written.
    #[error("writing the {encoding} PLY failed: {source}")]
    Write {
        /// How it is written.
        encoding: Encoding,
        /// Cause.
        source: io::Error,
    },
    /// Vertices or triangles that are written are not as many as announced.
    #[error("expected {expected} {what} to write, got {got}")]
    WriteCount {
        /// Name of the quantity.
        what: &'static str,
        /// As announced.
        expected: u64,
        /// As handed over.
        got: u64,
    },
    /// A triangle to write has a corner that is no vertex.
    #[error("triangle {triangle} to write has corner {index}; there are {vertices} vertices")]
    WriteIndex {
        /// Which triangle, from 0.
        triangle: u64,
        /// The corner.
        index: u32,
        /// Vertices as announced.
        vertices: u64,
    },
}

/// Error of a value, before the reader adds its place: the source keeps the offset of the last value.
#[derive(Debug)]
pub(super) enum Fault {
    Io(io::Error),
    End,
    Number {
        expected: &'static str,
        got: String,
    },
    /// The element before this one has more values than are declared.
    LineGoesOn(String),
    NegativeCount(i64),
    TooManyCorners(u64),
    NotFinite {
        property: String,
        value: f64,
    },
    Index(i64),
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        Fault::Io(error)
    }
}
