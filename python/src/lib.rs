//! The part of the Python package `chpm` that is not Python: opens files, selects meshes and hands them over as NumPy arrays.
//!
//! What is selected, `chpm-refine` decides, as it does for `chpm extract`; the docstrings here are those that Python shows.
#![forbid(unsafe_code)]

mod asked;
mod camera;
mod error;
mod file;
mod page;
mod selection;
mod view;

use pyo3::prelude::*;

/// The part of the package that is not Python; use the package `chpm`.
#[pymodule]
mod _chpm {
    #[pymodule_export]
    use super::camera::Camera;
    #[pymodule_export]
    use super::file::{File, Level};
    #[pymodule_export]
    use super::page::Page;
    #[pymodule_export]
    use super::selection::Selection;
}
