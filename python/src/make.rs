//! From a mesh to a file, or to a smaller mesh.

use crate::asked::{Amount, Asked};
use crate::error::Failure;
use crate::file::{File, Model};
use crate::job::{self, Board};
use crate::selection::{self, Further, Selection};
use crate::settings::build_config;
use chpm_build::config::Texture;
use chpm_build::{BuildConfig, BuildError};
use chpm_extmem::{Cancel, WorkDir, same_file};
use chpm_import::SourceError;
use chpm_refine::{Request, Shortfall};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fs;
use std::path::{Path, PathBuf};

/// Where a mesh comes from.
#[derive(FromPyObject)]
pub(crate) enum Source {
    /// A file that Python has open, and the name that its content goes by.
    Open((u32, PathBuf)),
    /// A file, or a pipe.
    Path(PathBuf),
}

impl Source {
    fn build(
        self,
        output: &Path,
        config: &BuildConfig,
        board: &Board,
        cancel: &Cancel,
    ) -> Result<(), Failure> {
        match self {
            Source::Path(path) => {
                if same_file(&path, output) {
                    return Err(BuildError::OutputIsSource { path: output.to_owned() }.into());
                }
                chpm_build::build(&path, output, config, board, cancel)?;
            }
            Source::Open((descriptor, name)) => {
                let opened = fs::File::open(format!("/proc/self/fd/{descriptor}"));
                let opened = opened.map_err(|source| SourceError::Read { path: name.clone(), source })?;
                chpm_build::build_open(&name, opened, output, config, board, cancel)?;
            }
        }
        Ok(())
    }

    fn name(&self) -> &Path {
        let (Source::Path(name) | Source::Open((_, name))) = self;
        name
    }
}

/// Builds a file, and opens it; ``chpm.build`` is what to call.
#[pyfunction]
pub(crate) fn build(
    py: Python<'_>,
    source: Source,
    output: PathBuf,
    settings: &Bound<'_, PyDict>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<File> {
    let config = build_config(settings)?;
    job::run(py, progress, |board, cancel| source.build(&output, &config, board, cancel))?;
    File::open(py, output)
}

fn level(asked: i64, is_within: bool) -> Result<u8, Failure> {
    if !is_within {
        return Err(Failure::Asked(
            "effort: that is how long to look for a mesh within a distance; give within".to_owned(),
        ));
    }
    match u8::try_from(asked) {
        Ok(level @ 0..=3) => Ok(level),
        _ => Err(Failure::Asked(format!("effort: 0 to 3 expected, got {asked}"))),
    }
}

/// Builds in a folder of its own and takes one mesh out; ``chpm.simplify`` is what to call.
#[pyfunction]
pub(crate) fn simplify(
    py: Python<'_>,
    source: Source,
    within: Option<Amount>,
    triangles: Option<Amount>,
    effort: Option<i64>,
    settings: &Bound<'_, PyDict>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Selection> {
    let effort = effort.map(|asked| level(asked, within.is_some())).transpose()?;
    let mut config = build_config(settings)?;
    // Nobody sees the sheets.
    if config.settings.texture == Texture::Found {
        config.settings.texture = Texture::FoundForVertices;
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(config.resources.threads).build();
    let pool = pool.map_err(|error| Failure::Asked(format!("cannot start threads: {error}")))?;
    let asked = Asked { error: within, triangles, ..Asked::default() };
    let (selected, origin) = job::run(py, progress, |board, cancel| {
        let place = config.resources.work_dir.clone().unwrap_or_else(std::env::temp_dir);
        // All of the work is in one folder, so that all of it goes.
        let folder = WorkDir::create(&place)?;
        let (model, name) = (folder.path().join("model.chpm"), source.name().to_owned());
        source.build(&model, &config, board, cancel)?;
        // What is told is told of the mesh: nobody knows of the file.
        let model = Model { path: name, ..Model::open(model)? };
        let effort = chpm_reduce::level(effort, model.file.header().source_triangle_count);
        let memory = config.resources.memory.0;
        let further = Further { effort, memory, pool: &pool, progress: board, cancel };
        let selected = selection::simplified(&model, &asked, &further)?;
        let diagonal = model.file.header().aabb().diagonal();
        if let (Request::Within(bound), Some(distance)) = (asked.request(&model.file)?, selected.distance)
            && f64::from(distance) > bound.of(diagonal)
        {
            let shortfall = Shortfall::Error { asked: bound, least: distance };
            return Err(Failure::Asked(shortfall.describe(model.path.display(), diagonal)));
        }
        Ok((selected, model.file.header().origin))
    })?;
    let origin = crate::view::row(py, origin.to_vec());
    Selection::new(py, selected, origin)
}
