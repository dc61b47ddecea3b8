//! The trait of a reader: bytes of one format in, batches of vertices and triangles out.

use crate::batch::{Batch, BatchKind, Tally};
use crate::error::ImportError;
use crate::options::Options;
use crate::stream::Stream;
use crate::supply::Supply;
use crate::texture::Textures;
use crate::vertex_format::VertexFormat;
use chpm_extmem::{Cancel, Store};
use chpm_mesh::Scalar;
use std::path::{Path, PathBuf};

/// Input of a reader.
pub struct Opening<'a> {
    /// Decompressed bytes, from the first on.
    pub stream: Stream,
    /// The first bytes of the stream and its length, to look at.
    pub start: Start<'a>,
    /// Wanted parts of the mesh.
    pub options: Options,
    /// Memory and disk for what has to be held.
    pub store: &'a Store,
    /// Whether to stop. The stream looks at it by itself.
    pub cancel: &'a Cancel,
    pub(crate) supply: &'a Supply,
}

impl Opening<'_> {
    /// The file that the bytes come from, for messages and to find its neighbours.
    pub fn path(&self) -> &Path {
        &self.supply.path
    }
}

/// The beginning of an input, and what else is known before it is read.
#[derive(Clone, Copy)]
pub struct Start<'a> {
    /// The first [`Format::HEAD`](crate::Format::HEAD) bytes, or all.
    pub head: &'a [u8],
    /// The length, unless the input is compressed.
    pub len: Option<u64>,
    /// The extension of its name, below one that names a compression.
    pub extension: Option<&'a str>,
}

impl Start<'_> {
    /// Whether the name ends so.
    pub(crate) fn is_named(&self, extension: &str) -> bool {
        self.extension.is_some_and(|own| own.eq_ignore_ascii_case(extension))
    }
}

/// A mesh that is being read, whatever its format.
pub trait MeshReader: Send {
    /// Format of the delivered vertices.
    fn format(&self) -> VertexFormat;

    /// The named scalars of the delivered vertices, in the order of their words and without their ranges.
    fn scalars(&self) -> &[Scalar] {
        &[]
    }

    /// Vertices and faces that a header declares, true or not.
    fn declared(&self) -> Option<(u64, u64)> {
        None
    }

    /// Bytes that were read of other files than the source itself.
    fn bytes_beside(&self) -> u64 {
        0
    }

    /// Refills `batch` with what comes next. Vertices and triangles come in any order, and a batch of either may be empty: then
    /// some work was done that has no result yet.
    ///
    /// # Errors
    /// What is wrong, and where; or memory and disk.
    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError>;

    /// Facts about the source, to be asked for after the last batch.
    ///
    /// # Errors
    /// Those of reading what is left.
    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError>;
}

/// Facts about a mesh when all of it was read.
#[derive(Default, Debug)]
pub struct SourceInfo {
    /// The file's name.
    pub name: String,
    /// The format in words, with compression.
    pub encoding: String,
    /// Bytes of all files, as they are on disk.
    pub byte_len: u64,
    /// The hash of the file; where it names others, that of its own bytes' hash and, in its order, of each of theirs.
    pub hash: u64,
    /// Vertices that the file has, or its header declares.
    pub vertex_count: u64,
    /// Faces likewise.
    pub face_count: u64,
    /// Comments of its header.
    pub comments: Vec<String>,
    /// Elements that were not delivered.
    pub tally: Tally,
    /// Losses and changes, in words.
    pub warnings: Vec<String>,
    /// Further files that the mesh is made of, in its order.
    pub beside: Vec<Beside>,
    /// Images of its textured triangles.
    pub textures: Option<Textures>,
}

/// A file that another one names.
#[derive(Clone, Debug)]
pub struct Beside {
    /// Where it is.
    pub path: PathBuf,
    /// The number of its first vertex, if it is a mesh of its own.
    pub first: Option<u64>,
    /// Its length.
    pub len: u64,
    /// The hash of its bytes.
    pub hash: u64,
}
