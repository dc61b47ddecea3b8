//! The part of the Python package `chpm` that is not Python: builds, opens and judges files, selects meshes and hands them over as NumPy
//! arrays.
//!
//! What is selected, `chpm-refine` decides, as it does for `chpm extract`; the docstrings here are those that Python shows.
#![forbid(unsafe_code)]

mod asked;
mod camera;
mod cast;
mod error;
mod file;
mod job;
mod judge;
mod make;
mod page;
mod section;
mod selection;
mod settings;
mod terminations;
mod view;

use pyo3::prelude::*;

/// The part of the package that is not Python; use the package `chpm`.
#[pymodule]
mod _chpm {
    #[pymodule_export]
    use super::camera::Camera;
    #[pymodule_export]
    use super::cast::Hits;
    #[pymodule_export]
    use super::file::{File, Level};
    #[pymodule_export]
    use super::judge::{measure_file, measure_meshes, verify};
    #[pymodule_export]
    use super::make::{build, simplify};
    #[pymodule_export]
    use super::page::Page;
    #[pymodule_export]
    use super::section::Section;
    #[pymodule_export]
    use super::selection::Selection;
}
