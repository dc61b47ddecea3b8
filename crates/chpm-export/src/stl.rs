//! STL: triangles without vertices in common, binary or as text.

use crate::error::{ExportError, expect};
use chpm_mesh::Aabb;
use std::io::Write;

/// Bytes that are gathered before they are written.
const BLOCK: usize = 1 << 16;

/// Writes triangles by the positions of their corners. Binary STL has single precision; text keeps all digits.
///
/// ```
/// use chpm_export::StlWriter;
///
/// let mut writer = StlWriter::new(Vec::new(), false, 1, "a triangle")?;
/// writer.triangles([[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])?;
/// assert_eq!(writer.finish()?.len(), 80 + 4 + 50);
/// # Ok::<(), chpm_export::ExportError>(())
/// ```
pub struct StlWriter<W: Write> {
    writer: W,
    buffer: Vec<u8>,
    is_text: bool,
    announced: u64,
    triangles: u64,
}

/// By how much binary STL moves a vertex at most, where positions are relative to `origin`: the diagonal of what rounding does on each axis.
pub fn rounding(bounds: &Aabb, origin: [f64; 3]) -> f64 {
    if origin == [0.0; 3] {
        return 0.0;
    }
    [0, 1, 2]
        .map(|axis| {
            let ends = [bounds.min[axis], bounds.max[axis]].map(|x| (f64::from(x) + origin[axis]).abs());
            // Half of the distance from one single to the next, below that largest number; the least one has twice the denormals'.
            let largest = ends[0].max(ends[1]).max(f64::from(f32::MIN_POSITIVE));
            largest * f64::from(f32::EPSILON) / 2.0
        })
        .iter()
        .map(|x| x * x)
        .sum::<f64>()
        .sqrt()
        * (1.0 + 4.0 * f64::EPSILON)
}

impl<W: Write> StlWriter<W> {
    /// Writes the header, with the first 80 bytes of `comment`.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`] for more triangles than binary STL can count; [`ExportError::Write`].
    pub fn new(writer: W, is_text: bool, triangles: u64, comment: &str) -> Result<Self, ExportError> {
        let mut buffer = Vec::with_capacity(BLOCK + 512);
        if is_text {
            let comment = comment.replace(['\r', '\n'], " ");
            buffer.extend(format!("solid {comment}\n").bytes());
        } else {
            let count = u32::try_from(triangles).map_err(|_| ExportError::TooLarge {
                format: "binary STL",
                what: "triangles",
                limit: u32::MAX.into(),
                got: triangles,
                remedy: "write it as text, or as PLY",
            })?;
            let mut header = [b' '; 80];
            for (to, from) in header.iter_mut().zip(comment.bytes()) {
                *to = from;
            }
            buffer.extend(header);
            buffer.extend(count.to_le_bytes());
        }

        Ok(StlWriter { writer, buffer, is_text, announced: triangles, triangles: 0 })
    }

    /// Writes triangles by their corners; normals are those of the planes, or zero.
    ///
    /// # Errors
    /// [`ExportError::Count`] for more than were announced; [`ExportError::Write`].
    pub fn triangles(&mut self, corners: impl IntoIterator<Item = [[f64; 3]; 3]>) -> Result<(), ExportError> {
        for triangle in corners {
            self.triangles += 1;
            if self.triangles > self.announced {
                return expect("triangles", self.announced, self.triangles);
            }
            let normal = normal(triangle);
            if self.is_text {
                self.put_text(normal, triangle);
            } else {
                for x in normal.iter().chain(triangle.as_flattened()) {
                    self.buffer.extend((*x as f32).to_le_bytes());
                }
                self.buffer.extend([0; 2]);
            }
            if self.buffer.len() >= BLOCK {
                self.flush()?;
            }
        }
        Ok(())
    }

    fn put_text(&mut self, [x, y, z]: [f64; 3], triangle: [[f64; 3]; 3]) {
        // Writing to a vector does not fail.
        let _ = writeln!(self.buffer, "facet normal {x:e} {y:e} {z:e}\n outer loop");
        for [x, y, z] in triangle {
            let _ = writeln!(self.buffer, "  vertex {x:?} {y:?} {z:?}");
        }
        self.buffer.extend(b" endloop\nendfacet\n");
    }

    /// Ends the file and gives the output back.
    ///
    /// # Errors
    /// [`ExportError::Count`] if triangles are missing; [`ExportError::Write`].
    pub fn finish(mut self) -> Result<W, ExportError> {
        expect("triangles", self.announced, self.triangles)?;
        if self.is_text {
            self.buffer.extend(b"endsolid\n");
        }
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
    ExportError::Write { format: "STL", source }
}

fn normal([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    fn less(p: [f64; 3], a: &[f64; 3]) -> [f64; 3] {
        [p[0] - a[0], p[1] - a[1], p[2] - a[2]]
    }
    let ([ux, uy, uz], [vx, vy, vz]) = (less(b, &a), less(c, &a));
    let cross = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    let length = cross.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Zero says that the reader is to find it.
    if length.is_normal() { cross.map(|x| x / length) } else { [0.0; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNER: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.1, 0.0]];
    const NEEDLE: [[f64; 3]; 3] = [[1.0, 1.0, 1.0]; 3];

    fn written(is_text: bool, triangles: &[[[f64; 3]; 3]]) -> Vec<u8> {
        let mut stl = StlWriter::new(Vec::new(), is_text, triangles.len() as u64, "a\ncomment").unwrap();
        stl.triangles(triangles.iter().copied()).unwrap();
        stl.finish().unwrap()
    }

    #[test]
    fn normals_point_where_corners_go_round() {
        let oblique = [[1.0, 2.0, 3.0], [4.0, 1.0, 5.0], [2.0, 6.0, 4.0]];
        let length = 251_f64.sqrt();
        assert_eq!(normal(oblique), [-9.0 / length, -1.0 / length, 13.0 / length]);
    }

    #[test]
    fn records_have_fifty_bytes_and_text_all_digits() {
        let bytes = written(false, &[CORNER, NEEDLE]);
        assert_eq!((bytes.len(), &bytes[80..84]), (84 + 100, &[2, 0, 0, 0][..]));
        let numbers: Vec<f32> =
            bytes[84..132].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert_eq!(numbers[..7], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0]);
        assert!(bytes[134..146].iter().all(|b| *b == 0), "a needle has no normal");
        let text = String::from_utf8(written(true, &[CORNER])).unwrap();
        assert!(text.starts_with("solid a comment\nfacet normal 0e0 0e0 1e0\n"), "{text}");
        assert!(text.contains("vertex 0.0 0.1 0.0\n") && text.ends_with("endfacet\nendsolid\n"), "{text}");
        assert_eq!(
            (written(false, &[]).len(), written(true, &[])),
            (84, b"solid a comment\nendsolid\n".to_vec())
        );
    }

    #[test]
    fn what_is_not_as_announced_is_an_error() {
        let begin = |count| StlWriter::new(Vec::new(), false, count, "").unwrap();
        assert!(matches!(begin(0).triangles([CORNER]), Err(ExportError::Count { got: 1, .. })));
        assert!(matches!(begin(1).finish(), Err(ExportError::Count { expected: 1, .. })));
        let many = u64::from(u32::MAX) + 1;
        assert!(StlWriter::new(Vec::new(), true, many, "").is_ok());
        let error = StlWriter::new(Vec::new(), false, many, "").err().unwrap();
        assert!(error.to_string().contains("4294967295 triangles"), "{error}");
    }

    #[test]
    fn rounding_is_bounded() {
        let bounds = Aabb { min: [-1.0, -1.0, -1.0], max: [1.0, 3.0, 1.0] };
        assert_eq!(rounding(&bounds, [0.0; 3]), 0.0);
        for origin in [[500_000.3, -4e6, 0.1], [1e-3, 0.1, 7.7], [1e30, 1.0, 1e-30]] {
            let bound = rounding(&bounds, origin);
            for i in 0_u32..1000 {
                let t = f64::from(i) / 999.0;
                let exact: [f64; 3] = std::array::from_fn(|axis| {
                    let (low, high) = (f64::from(bounds.min[axis]), f64::from(bounds.max[axis]));
                    low + t * (high - low) + origin[axis]
                });
                let moved: f64 = exact.iter().map(|x| (f64::from(*x as f32) - x).powi(2)).sum();
                assert!(moved.sqrt() <= bound, "{origin:?} {t}");
            }
            assert!(bound <= 2.0 * 4e6_f64.max(origin[0].abs()) * f64::from(f32::EPSILON));
        }
    }
}
