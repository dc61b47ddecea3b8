//! The container of a glTF: a GLB, or a file of JSON with its buffer in a file beside it.

use crate::error::ExportError;
use crate::gltf::padded;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::{self, Write};

/// Where a glTF goes.
#[derive(Debug)]
pub enum Container<W> {
    /// All of it into one file.
    Glb(W),
    /// JSON, and the buffer beside it.
    Gltf {
        /// The JSON.
        json: W,
        /// The buffer; nothing is written to it where there is no mesh.
        buffer: W,
        /// The buffer's name, as the file beside the JSON is called.
        name: String,
    },
}

impl<W: Write> Container<W> {
    /// Writes the JSON, and whatever else is in front of a body of so many bytes.
    pub(crate) fn begin(&mut self, mut root: Value, body: u64) -> Result<(), ExportError> {
        if let (Container::Gltf { name, .. }, Some(buffer)) = (&self, root.pointer_mut("/buffers/0")) {
            buffer["uri"] = uri(name).into();
        }
        let written = match self {
            Container::Glb(writer) => writer.write_all(&framed(&root, body)?),
            Container::Gltf { json, .. } => writeln!(json, "{root:#}"),
        };
        written.map_err(|source| self.failed(source))
    }

    /// Writes bytes of the body.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> Result<(), ExportError> {
        let (Container::Glb(body) | Container::Gltf { buffer: body, .. }) = self;
        body.write_all(bytes).map_err(|source| self.failed(source))
    }

    /// Ends the body.
    pub(crate) fn finish(mut self) -> Result<Self, ExportError> {
        let flushed = match &mut self {
            Container::Glb(writer) => writer.flush(),
            Container::Gltf { json, buffer, .. } => json.flush().and_then(|()| buffer.flush()),
        };
        match flushed {
            Ok(()) => Ok(self),
            Err(source) => Err(self.failed(source)),
        }
    }

    /// The GLB, or the JSON.
    pub fn into_main(self) -> W {
        let (Container::Glb(main) | Container::Gltf { json: main, .. }) = self;
        main
    }

    fn failed(&self, source: io::Error) -> ExportError {
        let format = match self {
            Container::Glb(_) => "GLB",
            Container::Gltf { .. } => "glTF",
        };
        ExportError::Write { format, source }
    }
}

/// A relative address of a file in the same folder.
pub fn uri(name: &str) -> String {
    let mut uri = String::with_capacity(name.len());
    for byte in name.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => uri.push(byte.into()),
            _ => _ = write!(uri, "%{byte:02X}"),
        }
    }
    uri
}

/// The JSON, and all that stands about it in front of a body of so many bytes.
fn framed(root: &Value, body: u64) -> Result<Vec<u8>, ExportError> {
    let mut text = root.to_string().into_bytes();
    text.resize(padded(text.len() as u64) as usize, b' ');

    let chunk = if body > 0 { 8 + body } else { 0 };
    let len = 12 + 8 + text.len() as u64 + chunk;
    let whole = u32::try_from(len).map_err(|_| ExportError::TooLarge {
        format: "GLB",
        what: "bytes",
        limit: u32::MAX.into(),
        got: len,
        remedy: "write a .gltf or a PLY, ask for fewer triangles, or compress it with --meshopt",
    })?;

    let mut front = Vec::with_capacity(28 + text.len());
    front.extend(b"glTF");
    front.extend(2_u32.to_le_bytes());
    front.extend(whole.to_le_bytes());
    front.extend((text.len() as u32).to_le_bytes());
    front.extend(b"JSON");
    front.extend(text);
    if body > 0 {
        front.extend((body as u32).to_le_bytes());
        front.extend(b"BIN\0");
    }
    Ok(front)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn names_become_addresses_that_every_reader_takes_back() {
        for (name, expected) in [
            ("a-1_b.~bin", "a-1_b.~bin"),
            ("my scan.bin", "my%20scan.bin"),
            ("50%#?.bin", "50%25%23%3F.bin"),
            ("gr\u{fc}n.bin", "gr%C3%BCn.bin"),
            ("c:d.bin", "c%3Ad.bin"),
        ] {
            assert_eq!(uri(name), expected);
        }
    }

    #[test]
    fn a_gltf_is_json_and_a_buffer_that_it_names() {
        let (json, buffer) = (Vec::new(), Vec::new());
        let mut container = Container::Gltf { json, buffer, name: "a b.bin".to_owned() };
        let root = json!({ "asset": { "version": "2.0" }, "buffers": [{ "byteLength": 4 }] });
        container.begin(root.clone(), 4).unwrap();
        container.write(b"body").unwrap();
        let Ok(Container::Gltf { json, buffer, .. }) = container.finish() else { unreachable!() };
        let mut told: Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(told["buffers"][0]["uri"], "a%20b.bin");
        told["buffers"][0].as_object_mut().unwrap().remove("uri");
        assert_eq!((told, buffer), (root, b"body".to_vec()));
    }

    #[test]
    fn an_error_names_what_was_written() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::StorageFull.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let error = Container::Glb(Full).begin(json!({}), 0).unwrap_err().to_string();
        assert!(error.contains("GLB"), "{error}");
        let mut apart = Container::Gltf { json: Full, buffer: Full, name: String::new() };
        let error = apart.write(b"x").unwrap_err().to_string();
        assert!(error.contains("glTF"), "{error}");
    }
}
