//! Files that lie beside an output and are named after it: a glTF's buffer, the material and the images of a mesh.

use crate::inputs;
use crate::output::Output;
use anyhow::{Context, Result, ensure};
use chpm_export::{Container, PartImage, TexturedPart};
use chpm_extmem::AtomicFile;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Files beside an output, each without its name yet.
pub(crate) struct Companions<'a> {
    output: &'a Path,
    /// Files that were read, and stay.
    inputs: &'a [PathBuf],
    force: bool,
    /// Whether blanks of names are kept: words of an OBJ end at them.
    keeps_blanks: bool,
    written: Vec<AtomicFile>,
}

/// The buffer of a glTF that is JSON.
pub(crate) struct Buffer {
    file: AtomicFile,
    name: String,
}

/// A mesh that is complete but for its name, and what lies beside it.
pub(crate) struct Written {
    pub(crate) output: Output,
    pub(crate) beside: Vec<AtomicFile>,
}

impl<'a> Companions<'a> {
    pub(crate) fn new(output: &'a Path, inputs: &'a [PathBuf], force: bool, keeps_blanks: bool) -> Self {
        Companions { output, inputs, force, keeps_blanks, written: Vec::new() }
    }

    /// Writes one whose name is the output's with another end, which is answered.
    pub(crate) fn add(&mut self, end: &str, bytes: &[u8]) -> Result<String> {
        let mut name = named(self.output, end)?;
        if !self.keeps_blanks {
            name = name.replace(char::is_whitespace, "_");
        }
        let path: PathBuf = self.output.with_file_name(&name);
        let inputs: Vec<&Path> = self.inputs.iter().map(PathBuf::as_path).collect();
        inputs::refuse(&path, &inputs)?;
        let mut file = AtomicFile::create(&path, self.force)?;
        file.write_all(bytes).with_context(|| format!("cannot write '{}'", path.display()))?;
        self.written.push(file);
        Ok(name)
    }

    /// Moves the images of parts to files of their own, which are numbered on from those that have `names`.
    pub(crate) fn add_images(&mut self, parts: &mut [TexturedPart], names: &mut Vec<String>) -> Result<()> {
        for part in parts {
            let end = format!(".{}.{}", names.len(), if part.is_png { "png" } else { "jpg" });
            let name = match &part.image {
                PartImage::Inside(bytes) => self.add(&end, bytes)?,
                PartImage::Beside(name) => name.clone(),
            };
            part.image = PartImage::Beside(name.clone());
            names.push(name);
        }
        Ok(())
    }

    /// The files.
    pub(crate) fn into_files(self) -> Vec<AtomicFile> {
        self.written
    }
}

/// A name that is an output's with another end, and not the output's own.
fn named(output: &Path, end: &str) -> Result<String> {
    let stem = output.file_stem().unwrap_or_default().to_str();
    let stem = stem.with_context(|| {
        format!("'{}' has a name that what lies beside it cannot be called after", output.display())
    })?;
    let (name, own) = (format!("{stem}{end}"), output.file_name().unwrap_or_default());
    // Some systems do not tell capitals apart.
    ensure!(
        !own.eq_ignore_ascii_case(&name),
        "'{}' is what the file beside it would be called; choose another name",
        output.display()
    );
    Ok(name)
}

impl Buffer {
    /// Opens one before the work starts. It must be none of the `inputs`.
    pub(crate) fn create(output: &Path, force: bool, inputs: &[&Path]) -> Result<Self> {
        let name = named(output, ".bin")?;
        let path = output.with_file_name(&name);
        inputs::refuse(&path, inputs)?;
        Ok(Buffer { file: AtomicFile::create(&path, force)?, name })
    }
}

/// The container of a glTF.
pub(crate) fn container(output: Output, buffer: Option<Buffer>) -> Container<Output> {
    match buffer {
        Some(Buffer { file, name }) => Container::Gltf { json: output, buffer: Output::File(file), name },
        None => Container::Glb(output),
    }
}

impl Written {
    /// A file with nothing beside it.
    pub(crate) fn alone(output: Output) -> Self {
        Written { output, beside: Vec::new() }
    }

    /// A glTF; one without a mesh has no buffer.
    pub(crate) fn gltf(container: Container<Output>, has_mesh: bool) -> Self {
        match container {
            Container::Gltf { json, buffer: Output::File(buffer), .. } if has_mesh => {
                Written { output: json, beside: vec![buffer] }
            }
            other => Written::alone(other.into_main()),
        }
    }

    /// All of it gets its name: the output last, so that none is there without what it names.
    pub(crate) fn publish(self) -> Result<()> {
        self.beside.into_iter().try_for_each(AtomicFile::publish)?;
        self.output.publish()
    }
}
