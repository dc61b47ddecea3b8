//! Several sources of one model: a list of tiles that stands for them.

use crate::number;
use crate::output;
use anyhow::{Context, Result, bail, ensure};
use chpm_extmem::same_file;
use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Sources of one model, on a command line.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct SourceArgs {
    /// The mesh: a file, a pipe, - for standard input, or several tiles
    ///
    /// {meshes}. Several sources are tiles of one model: they share a frame, and vertices of different files in one place become one. A list of them
    /// is left beside the output, as scan.tiles for scan.chpm: whatever reads a mesh reads it. Commands of a workflow each read it, so that there it is
    /// files alone.
    #[arg(value_name = "SOURCE", required = true)]
    sources: Vec<PathBuf>,
    /// Of several sources: join vertices of different files that are this near, in their units
    #[arg(long, value_name = "DISTANCE", value_parser = number::decimal, hide_short_help = true)]
    weld: Option<f64>,
}

impl SourceArgs {
    /// The source by whose folder settings are found.
    pub(crate) fn first(&self) -> &Path {
        self.sources.first().map_or(Path::new(""), PathBuf::as_path)
    }

    /// All of them.
    pub(crate) fn all(&self) -> &[PathBuf] {
        &self.sources
    }

    /// How near vertices of several sources are joined.
    ///
    /// # Errors
    /// Where there is only one.
    pub(crate) fn weld(&self) -> Result<Option<f64>> {
        if let (Some(one), Some(_)) = (self.only(), self.weld) {
            bail!(
                "--weld joins several sources, and '{}' is one: a .tiles list has its distance in its first line",
                one.display()
            );
        }
        Ok(self.weld)
    }

    /// The only one; nothing where there are several.
    pub(crate) fn only(&self) -> Option<&Path> {
        if let [one] = self.sources.as_slice() { Some(one) } else { None }
    }

    /// The only source, or the list of all of them, which is written beside `output` unless it is there.
    ///
    /// # Errors
    /// A name that a list cannot have, a list that is there with other tiles, unless `force` replaces it.
    pub(crate) fn source(&self, output: &Path, force: bool) -> Result<PathBuf> {
        let weld = self.weld()?;
        if let Some(one) = self.only() {
            return Ok(one.to_owned());
        }
        let inputs: Vec<&Path> = self.sources.iter().map(PathBuf::as_path).collect();
        let shown = output.display();
        ensure!(
            !inputs.iter().any(|input| same_file(input, output)),
            "the output '{shown}' is one of the sources; choose another name"
        );
        let list = output.with_extension("tiles");
        let text = self.list(&list, weld)?;
        match fs::read(&list) {
            Ok(there) if there == text.as_bytes() => return Ok(list),
            Ok(_) => ensure!(
                force,
                "'{}' is there and lists other tiles: delete it, or name another output with -o",
                list.display()
            ),
            Err(_) => {}
        }
        let mut file = output::TILES.create_file(&list, force, &inputs)?;
        file.write_all(text.as_bytes()).with_context(|| format!("cannot write '{}'", list.display()))?;
        file.publish()?;
        Ok(list)
    }

    /// The text of a list that is to lie at `list`.
    fn list(&self, list: &Path, weld: Option<f64>) -> Result<String> {
        let folder = list.parent().unwrap_or(Path::new(""));
        let mut text = "tiles".to_owned();
        if let Some(weld) = weld {
            text += &format!(" weld {weld}");
        }
        text.push('\n');
        for (place, source) in self.sources.iter().enumerate() {
            let shown = source.display();
            ensure!(
                fs::metadata(source).with_context(|| format!("cannot read '{shown}'"))?.is_file(),
                "'{shown}' is no file: several sources are read more than once, so none of them is a pipe or a folder"
            );
            ensure!(
                !self.sources[..place].contains(source),
                "'{shown}' is named twice, and tiles of one model are different files"
            );
            let name = from(folder, source)?;
            let Some(name) = name.to_str().filter(|name| is_a_line(name)) else {
                bail!(
                    "a list of tiles cannot name '{shown}': give the file a name in UTF-8 without line breaks and blanks at its ends"
                );
            };
            text += name;
            text.push('\n');
        }
        Ok(text)
    }
}

/// The name of a file as one calls it in a folder.
fn from(folder: &Path, file: &Path) -> Result<PathBuf> {
    if file.is_absolute() || folder.as_os_str().is_empty() || folder == OsStr::new(".") {
        return Ok(file.to_owned());
    }
    if let Ok(below) = file.strip_prefix(folder) {
        return Ok(below.to_owned());
    }
    std::path::absolute(file).with_context(|| format!("cannot find '{}'", file.display()))
}

/// Whether a line of a list can be this name.
fn is_a_line(name: &str) -> bool {
    name.trim_ascii() == name && !name.starts_with('#') && !name.contains(['\n', '\r'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_from_the_folder_of_the_list() {
        let name = |folder: &str, file: &str| from(Path::new(folder), Path::new(file)).unwrap();
        assert_eq!(name("", "a/b.ply"), Path::new("a/b.ply"));
        assert_eq!(name(".", "../b.ply"), Path::new("../b.ply"));
        assert_eq!(name("a", "a/b.ply"), Path::new("b.ply"));
        assert_eq!(name("c", "/a/b.ply"), Path::new("/a/b.ply"));
        assert!(name("c", "a/b.ply").is_absolute() && name("c", "a/b.ply").ends_with("a/b.ply"));
    }

    #[test]
    fn lines_are_what_a_list_reads_back() {
        assert!(is_a_line("b c.ply"));
        for name in [" b.ply", "b.ply ", "#b.ply", "b\n.ply", "b\r.ply"] {
            assert!(!is_a_line(name), "{name:?}");
        }
    }
}
