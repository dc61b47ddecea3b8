//! Wavefront OBJ, as text.

use crate::error::{ExportError, expect};
use chpm_mesh::{Attributes, VertexSlices};
use std::io::Write;

/// Bytes that are gathered before they are written.
const BLOCK: usize = 1 << 16;

/// Writes vertices and then triangles. Every number reads back as the same. Colours are three numbers from 0 to 1
/// behind the position, as many programs read them; alpha has no place.
///
/// ```
/// use chpm_export::ObjWriter;
///
/// let mesh = chpm_synth::hand::tetrahedron();
/// let mut writer = ObjWriter::new(Vec::new(), 4, 4, mesh.attributes(), "a tetrahedron")?;
/// writer.vertices(mesh.view(), None)?;
/// writer.triangles(&mesh.triangles)?;
/// let text = String::from_utf8(writer.finish()?).unwrap();
/// assert_eq!(text.lines().filter(|line| line.starts_with("f ")).count(), 4);
/// # Ok::<(), chpm_export::ExportError>(())
/// ```
pub struct ObjWriter<W: Write> {
    writer: W,
    buffer: Vec<u8>,
    attributes: Attributes,
    announced: [u64; 2],
    written: [u64; 2],
}

impl<W: Write> ObjWriter<W> {
    /// Writes the comment.
    ///
    /// # Errors
    /// [`ExportError::Write`].
    pub fn new(
        writer: W,
        vertices: u64,
        triangles: u64,
        attributes: Attributes,
        comment: &str,
    ) -> Result<Self, ExportError> {
        let buffer = format!("# {}\n", comment.replace(['\r', '\n'], " ")).into_bytes();
        Ok(ObjWriter { writer, buffer, attributes, announced: [vertices, triangles], written: [0; 2] })
    }

    /// Writes vertices, each moved by `origin`.
    ///
    /// # Errors
    /// [`ExportError::Count`] for more than were announced; [`ExportError::Write`].
    pub fn vertices(
        &mut self,
        vertices: VertexSlices<'_>,
        origin: Option<[f64; 3]>,
    ) -> Result<(), ExportError> {
        self.written[0] += vertices.positions.len() as u64;
        if self.written[0] > self.announced[0] {
            return expect("vertices", self.announced[0], self.written[0]);
        }
        let origin = origin.unwrap_or_default();
        for (at, position) in vertices.positions.iter().enumerate() {
            // As doubles: whoever reads them so finds what is here, and not what is nearest to fewer digits.
            let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| f64::from(position[axis]) + origin[axis]);
            // Writing to a vector does not fail.
            let _ = write!(self.buffer, "v {x:?} {y:?} {z:?}");
            if let Some([red, green, blue, _]) = vertices.colors.get(at) {
                for channel in [red, green, blue] {
                    let _ = write!(self.buffer, " {}", f32::from(*channel) / 255.0);
                }
            }
            self.buffer.push(b'\n');
            if let Some([x, y, z]) = vertices.normals.get(at) {
                let _ = writeln!(self.buffer, "vn {x:?} {y:?} {z:?}");
            }
            if self.buffer.len() >= BLOCK {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Writes triangles, after all vertices.
    ///
    /// # Errors
    /// As [`ObjWriter::vertices`].
    pub fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<(), ExportError> {
        expect("vertices", self.announced[0], self.written[0])?;
        self.written[1] += triangles.len() as u64;
        if self.written[1] > self.announced[1] {
            return expect("triangles", self.announced[1], self.written[1]);
        }
        for corners in triangles {
            let [a, b, c] = corners.map(|v| u64::from(v) + 1);
            let _ = match self.attributes.normals {
                true => writeln!(self.buffer, "f {a}//{a} {b}//{b} {c}//{c}"),
                false => writeln!(self.buffer, "f {a} {b} {c}"),
            };
            if self.buffer.len() >= BLOCK {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Ends the file and gives the output back.
    ///
    /// # Errors
    /// [`ExportError::Count`] if something is missing; [`ExportError::Write`].
    pub fn finish(mut self) -> Result<W, ExportError> {
        expect("vertices", self.announced[0], self.written[0])?;
        expect("triangles", self.announced[1], self.written[1])?;
        self.flush()?;
        self.writer.flush().map_err(failed)?;
        Ok(self.writer)
    }

    fn flush(&mut self) -> Result<(), ExportError> {
        self.writer.write_all(&self.buffer).map_err(failed)?;
        self.buffer.clear();
        Ok(())
    }
}

fn failed(source: std::io::Error) -> ExportError {
    ExportError::Write { format: "OBJ", source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_are_as_readers_take_them() {
        let vertices = VertexSlices {
            positions: &[[0.1, 0.0, -2.0]],
            normals: &[[0.0, 0.0, 1.0]],
            colors: &[[255, 51, 0, 9]],
            ..VertexSlices::default()
        };
        let write = |vertices: VertexSlices<'_>, origin| {
            let mut obj = ObjWriter::new(Vec::new(), 1, 1, vertices.attributes(), "one\ntwo").unwrap();
            obj.vertices(vertices, origin).unwrap();
            obj.triangles(&[[0, 0, 0]]).unwrap();
            String::from_utf8(obj.finish().unwrap()).unwrap()
        };
        let all = "# one two\nv 0.10000000149011612 0.0 -2.0 1 0.2 0\nvn 0.0 0.0 1.0\nf 1//1 1//1 1//1\n";
        assert_eq!(write(vertices, None), all);
        let bare = write(VertexSlices::new(&[[0.5, 0.25, 1.0]]), Some([5e6, 0.1, 0.0]));
        assert_eq!(bare, "# one two\nv 5000000.5 0.35 1.0\nf 1 1 1\n");
        let mut short = ObjWriter::new(Vec::new(), 2, 0, Attributes::NONE, "").unwrap();
        assert!(matches!(short.triangles(&[]), Err(ExportError::Count { what: "vertices", .. })));
    }
}
