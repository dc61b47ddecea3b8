//! Reports on `.chpm` files: statistics of levels, groups, bytes and clusters, plots, and pages of HTML that need nothing else.
//!
//! ```
//! use chpm_build::{BuildConfig, build};
//! use chpm_extmem::{Cancel, MappedFile, Silent};
//! use chpm_format::Chpm;
//! use chpm_report::page::{Shown, html};
//! # use chpm_import::ply::{Encoding, write_mesh};
//! # let folder = tempfile::tempdir()?;
//! # let (source, output) = (folder.path().join("ball.ply"), folder.path().join("ball.chpm"));
//! # write_mesh(std::fs::File::create(&source)?, &chpm_synth::hand::icosphere(3), Encoding::BinaryLittleEndian)?;
//!
//! build(&source, &output, &BuildConfig::default(), &Silent, &Cancel::default())?;
//! let file = Chpm::open(MappedFile::open(&output)?)?;
//! let shown = Shown::new("ball.chpm".to_owned(), &file, &Cancel::default())?;
//! assert_eq!(shown.stats.measures["triangles"], 1280.0);
//! assert!(html(&shown, None, None)?.starts_with("<!DOCTYPE html>"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod chart;
pub mod colors;
pub mod digest;
mod error;
mod level;
pub mod page;
mod short;
pub mod stats;

pub use error::ReportError;
pub use level::{LevelRow, levels_of, per_triangle};
pub use short::Short;
