//! The metadata section: where a file comes from. The only place that knows how it is encoded.

use crate::error::FormatError;
use bincode::error::DecodeError;
use chpm_mesh::Counted;
use serde::{Deserialize, Serialize};

/// Version of the encoding, in front of the metadata.
pub const METADATA_VERSION: u16 = 1;
/// Most bytes of the metadata, and most that decoding may allocate.
pub const METADATA_LIMIT: usize = 16 << 20;

/// The setting that tells [`Metadata::lattice_step`].
pub const LATTICE_STEP: &str = "lattice-step";

/// Provenance of a file. Nothing in it is needed to draw the model.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Metadata {
    /// The program that wrote the file, and its version.
    pub generator: String,
    /// The mesh that went in.
    pub source: Source,
    /// Settings of the build, name and value, in a fixed order.
    pub settings: Vec<(String, String)>,
    /// Repairs, and how often each was made.
    pub repairs: Vec<(String, u64)>,
    /// Warnings of the builder.
    pub warnings: Vec<String>,
}

/// The file that was built from.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Source {
    /// File name without its folder.
    pub name: String,
    /// Its length, bytes.
    pub byte_len: u64,
    /// Its XXH3, 64 bits.
    pub hash: u64,
    /// Its encoding, "binary_little_endian" for example.
    pub encoding: String,
    /// Vertices that it declares.
    pub vertex_count: u64,
    /// Faces that it declares.
    pub face_count: u64,
    /// Its comments.
    pub comments: Vec<String>,
}

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<METADATA_LIMIT>()
}

impl Metadata {
    /// Step that all coordinates of the file are whole multiples of, if it says that its positions are on a lattice.
    ///
    /// # Errors
    /// [`FormatError::Metadata`] where it is no power of two.
    pub fn lattice_step(&self) -> Result<Option<f64>, FormatError> {
        let Some((_, told)) = self.settings.iter().find(|(name, _)| name == LATTICE_STEP) else {
            return Ok(None);
        };
        // A power of two has no other bits than those of its exponent.
        fn is_power(step: &f64) -> bool {
            step.is_normal() && *step > 0.0 && step.to_bits().trailing_zeros() >= 52
        }
        let step = told.parse().ok().filter(is_power);
        step.map(Some)
            .ok_or_else(|| wrong(format_args!("a power of two expected as {LATTICE_STEP}, got '{told}'")))
    }

    /// The bytes of the section.
    pub(crate) fn encode(&self) -> Result<Vec<u8>, FormatError> {
        let body = bincode::serde::encode_to_vec(self, config()).map_err(wrong)?;
        // A reader that is bound by the limit must be able to take what a writer makes.
        Metadata::decode_body(&body)?;
        let mut bytes = METADATA_VERSION.to_le_bytes().to_vec();
        bytes.extend(body);
        Ok(bytes)
    }

    /// Reads the bytes of the section, all of them.
    pub(crate) fn decode(bytes: &[u8]) -> Result<Metadata, FormatError> {
        let (version, body) =
            bytes.split_first_chunk().ok_or_else(|| wrong("shorter than its version number"))?;
        let version = u16::from_le_bytes(*version);
        if version != METADATA_VERSION {
            return Err(wrong(format_args!("version {METADATA_VERSION} expected, got {version}")));
        }
        Metadata::decode_body(body)
    }

    fn decode_body(body: &[u8]) -> Result<Metadata, FormatError> {
        let (metadata, read) =
            bincode::serde::decode_from_slice(body, config()).map_err(|error| wrong(reason(&error)))?;
        if read != body.len() {
            return Err(wrong(format_args!("{} too many", Counted((body.len() - read) as u64, "byte"))));
        }
        Ok(metadata)
    }
}

/// In words what the decoder says in the terms of its own code.
fn reason(error: &DecodeError) -> &'static str {
    match error {
        DecodeError::UnexpectedEnd { .. } => "it ends early",
        DecodeError::LimitExceeded => "it is longer than 16 MiB",
        DecodeError::Utf8 { .. } => "a text in it is not UTF-8",
        _ => "it is not encoded as it must be",
    }
}

fn wrong(reason: impl std::fmt::Display) -> FormatError {
    FormatError::Metadata(reason.to_string())
}
