//! What can go wrong, and which exception of the package it becomes.

use chpm_build::BuildError;
use chpm_export::ExportError;
use chpm_extmem::ExtmemError;
use chpm_format::FormatError;
use chpm_import::SourceError;
use chpm_refine::RefineError;
use chpm_verify::VerifyError;
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use std::io;
use std::path::{Path, PathBuf};

/// Exceptions are classes of Python, so that they can be caught as what Python has of the kind, too.
mod raised {
    pyo3::import_exception!(chpm._errors, BuildError);
    pyo3::import_exception!(chpm._errors, DamagedError);
    pyo3::import_exception!(chpm._errors, FileError);
    pyo3::import_exception!(chpm._errors, MissingFileError);
    pyo3::import_exception!(chpm._errors, SelectionError);
    pyo3::import_exception!(chpm._errors, ClosedError);
}

/// Why something could not be done. The texts are those of the command.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    #[error(transparent)]
    System(#[from] ExtmemError),
    #[error("cannot open '{}': {source}", path.display())]
    Open { path: PathBuf, source: FormatError },
    #[error("cannot read '{}': {source}", path.display())]
    Read { path: PathBuf, source: FormatError },
    #[error("'{}' does not have that: {source}", path.display())]
    Lacks { path: PathBuf, source: RefineError },
    #[error(transparent)]
    Source(SourceError),
    #[error(transparent)]
    Built(BuildError),
    #[error(transparent)]
    Judged(VerifyError),
    #[error(transparent)]
    Refused(RefineError),
    #[error(transparent)]
    Textured(ExportError),
    #[error("{0}")]
    Asked(String),
    #[error("'{}' is closed; open it again", .0.display())]
    Closed(PathBuf),
    #[error("no memory for {0}; select fewer")]
    Memory(String),
    #[error(transparent)]
    Python(#[from] PyErr),
}

impl From<RefineError> for Failure {
    /// Without the file's name, which [`Failure::of`] adds.
    fn from(error: RefineError) -> Self {
        Failure::Refused(error)
    }
}

impl From<FormatError> for Failure {
    fn from(error: FormatError) -> Self {
        Failure::Refused(error.into())
    }
}

impl From<ExportError> for Failure {
    fn from(error: ExportError) -> Self {
        match error {
            ExportError::Format(error) => error.into(),
            error => Failure::Textured(error),
        }
    }
}

impl From<BuildError> for Failure {
    fn from(error: BuildError) -> Self {
        match error {
            BuildError::Source(error) => (*error).into(),
            BuildError::Extmem(error) => Failure::System(error),
            error => Failure::Built(error),
        }
    }
}

impl From<SourceError> for Failure {
    fn from(error: SourceError) -> Self {
        match error {
            SourceError::Extmem(error) => Failure::System(error),
            error => Failure::Source(error),
        }
    }
}

impl From<VerifyError> for Failure {
    fn from(error: VerifyError) -> Self {
        match error {
            VerifyError::Extmem(error) => Failure::System(error),
            VerifyError::Source(error) => error.into(),
            VerifyError::Format(error) => error.into(),
            VerifyError::Refine(error) => Failure::Refused(error),
            error => Failure::Judged(error),
        }
    }
}

impl Failure {
    /// The same with the name of the file that it is about.
    pub(crate) fn of(self, path: &Path) -> Self {
        let path = path.to_owned();
        match self {
            Failure::Refused(RefineError::Format(source)) => Failure::Read { path, source },
            Failure::Refused(source @ (RefineError::Level { .. } | RefineError::Coarsest { .. })) => {
                Failure::Lacks { path, source }
            }
            other => other,
        }
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        let told = failure.to_string();
        match failure {
            Failure::Python(error) => error,
            Failure::System(ExtmemError::Io { path, source, .. }) => {
                let about = (told, source.raw_os_error(), path);
                match source.kind() {
                    io::ErrorKind::NotFound => raised::MissingFileError::new_err(about),
                    _ => raised::FileError::new_err(about),
                }
            }
            Failure::Source(SourceError::Read { path, source }) => {
                let about = (told, source.raw_os_error(), path);
                match source.kind() {
                    io::ErrorKind::NotFound => raised::MissingFileError::new_err(about),
                    _ => raised::FileError::new_err(about),
                }
            }
            Failure::System(ExtmemError::Exists { path }) => raised::FileError::new_err(format!(
                "'{}' exists already; force=True replaces it, or choose another name",
                path.display()
            )),
            Failure::System(ExtmemError::Budget { .. }) => PyMemoryError::new_err(told),
            Failure::Source(_) | Failure::Built(_) | Failure::Judged(_) => raised::BuildError::new_err(told),
            Failure::System(_) => raised::FileError::new_err(told),
            Failure::Open { .. } | Failure::Read { .. } | Failure::Textured(_) => {
                raised::DamagedError::new_err(told)
            }
            Failure::Lacks { .. } | Failure::Refused(_) | Failure::Asked(_) => {
                raised::SelectionError::new_err(told)
            }
            Failure::Closed(_) => raised::ClosedError::new_err(told),
            Failure::Memory(_) => PyMemoryError::new_err(told),
        }
    }
}
