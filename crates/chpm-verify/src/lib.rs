//! Judges `.chpm` files: whether the leaves are the source's triangles, whether cuts have cracks, and how far meshes are from the source,
//! sampled and proven.
//!
//! [`verify()`] does what `chpm verify` does, [`measure()`] and [`measure_texture()`] what `chpm measure` does; the modules below are their parts. What is wrong with
//! a file is a finding. Errors are reasons why it could not be judged.
//!
//! ```
//! use chpm_build::{BuildConfig, build};
//! use chpm_extmem::{Cancel, MappedFile, Silent};
//! use chpm_format::Chpm;
//! use chpm_mesh::Bytes;
//! use chpm_verify::{Checks, verify};
//! # use chpm_import::ply::{Encoding, write_mesh};
//! # let folder = tempfile::tempdir()?;
//! # let (source, output) = (folder.path().join("ball.ply"), folder.path().join("ball.chpm"));
//! # write_mesh(std::fs::File::create(&source)?, &chpm_synth::hand::icosphere(3), Encoding::BinaryLittleEndian)?;
//!
//! let cancel = Cancel::default();
//! build(&source, &output, &BuildConfig::default(), &Silent, &cancel)?;
//!
//! let file = Chpm::open(MappedFile::open(&output)?)?;
//! let checks = Checks { against: Some(source), cuts: Some(10), errors: true, ..Checks::default() };
//! let found = verify(&file, &checks, Bytes::mib(256), folder.path(), &Silent, &cancel)?;
//! assert!(found.is_sound());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod against;
pub mod certify;
pub mod cuts;
pub mod deviation;
mod error;
pub mod measure;
pub mod memory;
mod points;
pub mod texture;
mod verification;

pub use error::VerifyError;
pub use measure::{Measured, Measures, measure};
pub use points::Points;
pub use texture::{LevelTexture, TextureMeasures, measure_texture};
pub use verification::{Checks, Verification, describe, verify};
