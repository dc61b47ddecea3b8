//! The writer, for streams whose counts are known before.

use super::{
    error::PlyError,
    header::{Encoding, ScalarType},
    scalars::type_of,
};
use chpm_mesh::{
    Attributes, Scalar, ScalarKind, TriMesh, VertexSlices, scalar_names, scalar_places, scalar_words,
};
use std::io::Write;

/// Bytes that are gathered before they are written.
const BLOCK: usize = 1 << 16;

/// Writes vertices and then triangles. What it writes, [`PlyReader`](super::PlyReader) reads back bit by bit.
pub struct PlyWriter<W: Write> {
    writer: W,
    buffer: Vec<u8>,
    encoding: Encoding,
    attributes: Attributes,
    scalars: Vec<Scalar>,
    double: bool,
    vertex_count: u64,
    triangle_count: u64,
    vertices: u64,
    triangles: u64,
}

impl<W: Write> PlyWriter<W> {
    /// Writes the header. Positions are `double` or `float`, normals `float`, colours four `uchar`, indices `int`, or `uint` if
    /// there are more than 2^31 vertices. Line breaks in comments become blanks.
    ///
    /// # Errors
    /// If there are more vertices than indices can tell apart, or if writing fails.
    pub fn new(
        writer: W,
        encoding: Encoding,
        vertex_count: u64,
        triangle_count: u64,
        attributes: Attributes,
        double: bool,
        comments: &[&str],
    ) -> Result<Self, PlyError> {
        Self::with_scalars(writer, encoding, vertex_count, triangle_count, attributes, &[], double, comments)
    }

    /// As [`PlyWriter::new`], for vertices with named scalars; each is written as the type that its source had. A scalar that has the name of a
    /// channel of the colour is written in its place.
    ///
    /// # Errors
    /// As [`PlyWriter::new`].
    #[expect(clippy::too_many_arguments, reason = "all of the header, said once")]
    pub fn with_scalars(
        writer: W,
        encoding: Encoding,
        vertex_count: u64,
        triangle_count: u64,
        attributes: Attributes,
        scalars: &[Scalar],
        double: bool,
        comments: &[&str],
    ) -> Result<Self, PlyError> {
        let limit = super::MAX_VERTICES;
        if vertex_count > limit {
            return Err(PlyError::TooManyVertices { count: vertex_count, limit });
        }

        let mut header = format!("ply\nformat {encoding} 1.0\n");
        for comment in comments {
            header += &format!("comment {}\n", comment.replace(['\r', '\n'], " "));
        }
        fn properties(ty: ScalarType, names: &[&str]) -> String {
            names.iter().map(|name| format!("property {ty} {name}\n")).collect()
        }
        header += &format!("element vertex {vertex_count}\n");
        header += &properties(if double { ScalarType::Double } else { ScalarType::Float }, &["x", "y", "z"]);
        if attributes.normals {
            header += &properties(ScalarType::Float, &["nx", "ny", "nz"]);
        }
        if attributes.colors {
            let names: Vec<&str> = CHANNELS.into_iter().filter(|name| !is_taken(name, scalars)).collect();
            header += &properties(ScalarType::UChar, &names);
        }
        for (name, Scalar { kind, .. }) in scalar_names(scalars, &TAKEN, one_word).iter().zip(scalars) {
            header += &properties(type_of(*kind), &[name]);
        }
        let index = if vertex_count > 1 << 31 { ScalarType::UInt } else { ScalarType::Int };
        header += &format!("element face {triangle_count}\nproperty list uchar {index} vertex_indices\n");
        header += "end_header\n";

        let mut writer = PlyWriter {
            writer,
            buffer: header.into_bytes(),
            encoding,
            attributes,
            scalars: scalars.to_vec(),
            double,
            vertex_count,
            triangle_count,
            vertices: 0,
            triangles: 0,
        };
        writer.flush()?;
        Ok(writer)
    }

    /// Writes vertices, which carry what the header says.
    ///
    /// # Errors
    /// If these are not as many as announced, if they do not carry what the header says, or if writing fails.
    pub fn vertices(&mut self, vertices: VertexSlices<'_>) -> Result<(), PlyError> {
        self.write_vertices(vertices.positions, vertices)
    }

    /// As [`vertices`](Self::vertices), but at `positions`; rounds to single precision unless the header says double.
    ///
    /// # Errors
    /// As [`vertices`](Self::vertices).
    pub fn vertices_f64(
        &mut self,
        positions: &[[f64; 3]],
        vertices: VertexSlices<'_>,
    ) -> Result<(), PlyError> {
        self.write_vertices(positions, vertices)
    }

    fn write_vertices<T: Copy + Into<f64>>(
        &mut self,
        positions: &[[T; 3]],
        vertices: VertexSlices<'_>,
    ) -> Result<(), PlyError> {
        let VertexSlices { normals, colors, .. } = vertices;
        let given = |wanted: bool| if wanted { positions.len() } else { 0 };
        expect("normals", given(self.attributes.normals) as u64, normals.len() as u64)?;
        expect("colours", given(self.attributes.colors) as u64, colors.len() as u64)?;
        let words = scalar_words(&self.scalars);
        expect("words of scalars", (words * positions.len()) as u64, vertices.scalars.len() as u64)?;
        let channels = CHANNELS.map(|name| !is_taken(name, &self.scalars));
        let scalars = std::mem::take(&mut self.scalars);
        self.vertices += positions.len() as u64;
        if self.vertices > self.vertex_count {
            expect("vertices", self.vertex_count, self.vertices)?;
        }

        for (at, position) in positions.iter().enumerate() {
            for &x in position {
                if self.double { self.put_f64(x.into()) } else { self.put_f32(x.into() as f32) }
            }
            for &x in normals.get(at).into_iter().flatten() {
                self.put_f32(x);
            }
            for (&x, _) in colors.get(at).into_iter().flatten().zip(channels).filter(|(_, written)| *written)
            {
                self.put_u8(x);
            }
            for (place, scalar) in scalar_places(&scalars) {
                self.put_scalar(scalar.kind, &vertices.scalars[at * words..][place]);
            }
            self.end_element()?;
        }
        self.scalars = scalars;
        self.flush()
    }

    /// A value as the type that its source had.
    fn put_scalar(&mut self, kind: ScalarKind, words: &[u32]) {
        let value = kind.value(words);
        match (kind, self.encoding) {
            (ScalarKind::Float64, _) => self.put_f64(value),
            (ScalarKind::Float32, Encoding::Ascii) => self.put_f32(value as f32),
            // The bits themselves, whatever they are.
            (ScalarKind::Float32, _) => self.put_bytes(words[0].to_le_bytes()),
            (_, Encoding::Ascii) => self.put_text(format_args!("{} ", value as i64)),
            (ScalarKind::Int8 | ScalarKind::Uint8, _) => self.put_bytes([value as i64 as u8]),
            (ScalarKind::Int16 | ScalarKind::Uint16, _) => {
                self.put_bytes((value as i64 as u16).to_le_bytes())
            }
            (ScalarKind::Int32 | ScalarKind::Uint32, _) => {
                self.put_bytes((value as i64 as u32).to_le_bytes())
            }
        }
    }

    /// Writes triangles, after all vertices.
    ///
    /// # Errors
    /// If a corner is no vertex, if vertices are missing, if these are more triangles than announced, or if writing fails.
    pub fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<(), PlyError> {
        expect("vertices", self.vertex_count, self.vertices)?;
        let total = self.triangles + triangles.len() as u64;
        if total > self.triangle_count {
            expect("triangles", self.triangle_count, total)?;
        }
        for corners in triangles {
            if let Some(&index) = corners.iter().find(|index| u64::from(**index) >= self.vertex_count) {
                let (triangle, vertices) = (self.triangles, self.vertex_count);
                return Err(PlyError::WriteIndex { triangle, index, vertices });
            }
            self.put_u8(3);
            for &corner in corners {
                self.put_u32(corner);
            }
            self.triangles += 1;
            self.end_element()?;
        }
        self.flush()
    }

    /// Ends the file and gives the output back.
    ///
    /// # Errors
    /// If vertices or triangles are missing, or if writing fails.
    pub fn finish(mut self) -> Result<W, PlyError> {
        expect("vertices", self.vertex_count, self.vertices)?;
        expect("triangles", self.triangle_count, self.triangles)?;
        self.flush()?;
        let encoding = self.encoding;
        self.writer.flush().map_err(|source| PlyError::Write { encoding, source })?;
        Ok(self.writer)
    }

    fn put_u8(&mut self, value: u8) {
        match self.encoding {
            Encoding::Ascii => self.put_text(format_args!("{value} ")),
            _ => self.buffer.push(value),
        }
    }

    fn put_u32(&mut self, value: u32) {
        match self.encoding {
            Encoding::Ascii => self.put_text(format_args!("{value} ")),
            _ => self.put_bytes(value.to_le_bytes()),
        }
    }

    /// As text, the shortest that reads back as the same number.
    fn put_f32(&mut self, value: f32) {
        match self.encoding {
            Encoding::Ascii => self.put_text(format_args!("{value:?} ")),
            _ => self.put_bytes(value.to_le_bytes()),
        }
    }

    fn put_f64(&mut self, value: f64) {
        match self.encoding {
            Encoding::Ascii => self.put_text(format_args!("{value:?} ")),
            _ => self.put_bytes(value.to_le_bytes()),
        }
    }

    fn put_bytes<const N: usize>(&mut self, mut bytes: [u8; N]) {
        if self.encoding == Encoding::BinaryBigEndian {
            bytes.reverse();
        }
        self.buffer.extend_from_slice(&bytes);
    }

    fn put_text(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing to a vector does not fail.
        let _ = self.buffer.write_fmt(text);
    }

    fn end_element(&mut self) -> Result<(), PlyError> {
        if self.encoding == Encoding::Ascii
            && let Some(blank) = self.buffer.last_mut()
        {
            *blank = b'\n';
        }
        if self.buffer.len() >= BLOCK { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), PlyError> {
        let encoding = self.encoding;
        self.writer.write_all(&self.buffer).map_err(|source| PlyError::Write { encoding, source })?;
        self.buffer.clear();
        Ok(())
    }
}

/// Names of a colour's channels.
const CHANNELS: [&str; 4] = ["red", "green", "blue", "alpha"];

/// Names that mean something else.
const TAKEN: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// A name as a header may have it: without blanks and line breaks.
fn one_word(name: &str) -> String {
    name.replace(|c: char| c.is_whitespace() || c.is_control(), "_")
}

/// Whether a scalar has the name of a channel, of which it then knows more.
fn is_taken(channel: &str, scalars: &[Scalar]) -> bool {
    scalars.iter().any(|scalar| scalar.name == channel)
}

fn expect(what: &'static str, expected: u64, got: u64) -> Result<(), PlyError> {
    if expected == got { Ok(()) } else { Err(PlyError::WriteCount { what, expected, got }) }
}

/// Writes a whole mesh.
///
/// # Errors
/// If an attribute is not as long as the positions, if a corner is no vertex, or if writing fails.
pub fn write_mesh<W: Write>(writer: W, mesh: &TriMesh, encoding: Encoding) -> Result<(), PlyError> {
    let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let mut writer = PlyWriter::new(writer, encoding, vertices, triangles, mesh.attributes(), false, &[])?;
    // Names of scalars are not known here.
    writer.vertices(VertexSlices { scalars: &[], ..mesh.view() })?;
    writer.triangles(&mesh.triangles)?;
    writer.finish()?;
    Ok(())
}
