//! Files that a verb reads, and so does not replace.

use anyhow::{Result, ensure};
use chpm_extmem::{Cancel, same_file};
use chpm_format::volume;
use chpm_import::{Images, input};
use std::path::{Path, PathBuf};

/// Refuses to write to `path` where it is one of the inputs, or a file that one of them is made of: a tile or scan of a list, the buffer or an
/// image of a glTF, the materials of an OBJ, a volume of a model.
pub(crate) fn refuse(path: &Path, inputs: &[&Path]) -> Result<()> {
    // An input that is gone is told by whoever reads it.
    let is_input = inputs.iter().any(|input| same_file(input, path));
    ensure!(!is_input, "the output '{}' is the input itself; choose another name", path.display());
    if !path.is_file() {
        return Ok(());
    }
    for input in inputs.iter().filter(|input| input.is_file()) {
        let is_part = parts(input).iter().any(|part| same_file(part, path));
        ensure!(
            !is_part,
            "the output '{}' is a file that the input '{}' is made of; choose another name",
            path.display(),
            input.display()
        );
    }
    Ok(())
}

/// The files beside an input that it is made of; none of one that cannot be read, which its reader tells.
fn parts(input: &Path) -> Vec<PathBuf> {
    let volumes = (1..).map(|number| volume::path(input, number)).take_while(|volume| volume.is_file());
    let named = input::files(input, Images::IfAny, &Cancel::default()).unwrap_or_default();
    volumes.chain(named).collect()
}
