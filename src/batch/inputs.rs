//! Models from typed inputs: files, folders, patterns, lists.

use super::manifest;
use anyhow::{Context, Result, bail, ensure};
use chpm_build::Cancel;
use chpm_import::{COMPRESSED, FORMATS, Images, extension, extensions, input};
use glob::MatchOptions;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs;
use std::io::BufRead;
use std::path::{Component, Path, PathBuf};

/// A model to build.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Model {
    /// The output's path below the output folder, without its extension; the same wherever the batch runs.
    pub(crate) name: String,
    pub(crate) source: PathBuf,
    /// Arguments for this model alone.
    pub(crate) settings: Vec<String>,
}

/// The models that `inputs` name, ordered by name. `-` reads a list from `stdin`.
pub(crate) fn collect(inputs: &[PathBuf], stdin: impl BufRead) -> Result<Vec<Model>> {
    let mut found = Vec::new();
    let mut stdin = Some(stdin);
    for input in inputs {
        if input.as_os_str() == "-" {
            let Some(stdin) = stdin.take() else { bail!("'-' was given twice; there is one standard input") };
            for line in stdin.lines() {
                let line = line.context("cannot read the list on standard input")?;
                // A shell may put the mark of UTF-8 before what it hands on.
                let line = line.trim_start_matches('\u{feff}').trim_end_matches('\r');
                if !line.trim().is_empty() {
                    take(Path::new(line), &mut found)?;
                }
            }
        } else {
            take(input, &mut found)?;
        }
    }
    ensure!(!found.is_empty(), "no models: the inputs name no mesh");
    unique(found)
}

/// Adds the models of one input.
fn take(input: &Path, found: &mut Vec<Model>) -> Result<()> {
    let before = found.len();

    if input.is_dir() {
        walk(input, input, &BTreeSet::new(), found)?;
        ensure!(
            found.len() > before,
            "no mesh in the folder '{}' ({})",
            input.display(),
            extensions().collect::<Vec<_>>().join(", ")
        );
    } else if input.exists() && manifest::is_manifest(input) {
        for listed in manifest::read(input)? {
            let name = listed.name.map_or_else(|| stem(&listed.source), Ok)?;
            found.push(Model { name: checked(&name)?, source: listed.source, settings: listed.settings });
        }
    } else if input.exists() {
        found.push(Model { name: stem(input)?, source: input.to_owned(), settings: Vec::new() });
    } else {
        let text = input.to_str().unwrap_or_default();
        ensure!(text.contains(['*', '?', '[']), "'{}' does not exist", input.display());
        let options = MatchOptions { require_literal_leading_dot: true, ..MatchOptions::new() };
        let matches =
            glob::glob_with(text, options).with_context(|| format!("'{text}' is no valid pattern"))?;
        for path in matches {
            let path = path.context("cannot look into a folder")?;
            if path.is_dir() || is_mesh(&path) {
                take(&path, found)?;
            }
        }
        ensure!(found.len() > before, "nothing matches '{text}'");
    }
    Ok(())
}

/// The meshes of a folder and those below it; `parts`, of which lists there or above are made, are no models of their own.
fn walk(root: &Path, folder: &Path, parts: &BTreeSet<PathBuf>, found: &mut Vec<Model>) -> Result<()> {
    let unread = || format!("cannot look into '{}'", folder.display());
    let mut entries: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(folder).with_context(unread)? {
        let entry = entry.with_context(unread)?;
        // A link to a folder may lead back here.
        let is_link = entry.file_type().with_context(unread)?.is_symlink();
        let path = entry.path();
        let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
        if is_hidden || is_link && path.is_dir() {
            continue;
        }
        entries.push(path);
    }
    entries.sort();
    let mut parts = parts.clone();
    for list in entries.iter().filter(|path| is_list(path)) {
        // What is wrong with a list is told when it is built.
        parts.extend(
            input::files(list, Images::Ignored, &Cancel::default()).unwrap_or_default().into_iter().skip(1),
        );
    }
    for path in entries {
        if path.is_dir() {
            walk(root, &path, &parts, found)?;
        } else if is_mesh(&path) && !parts.contains(&path) {
            let relative = path.strip_prefix(root).unwrap_or(&path);
            let name = relative.with_file_name(stem(relative)?);
            let parts: Vec<Cow<'_, str>> = name.iter().map(OsStr::to_string_lossy).collect();
            // The same on every system.
            let name = parts.join("/");
            found.push(Model { name, source: path, settings: Vec::new() });
        }
    }
    Ok(())
}

/// Refuses two models with one output; the same model given twice is one.
fn unique(found: Vec<Model>) -> Result<Vec<Model>> {
    let mut models: BTreeMap<String, Model> = BTreeMap::new();
    for model in found {
        match models.get(&model.name) {
            Some(other) if *other == model => {}
            Some(other) => bail!(
                "'{}' and '{}' would both be built as '{}.chpm'; give one of them another name in a list, or build them \
                 into different folders",
                other.source.display(),
                model.source.display(),
                model.name,
            ),
            None => {
                models.insert(model.name.clone(), model);
            }
        }
    }
    Ok(models.into_values().collect())
}

/// The file's name without the extensions of a mesh; others belong to it. What of it is no text becomes U+FFFD, so that it is built like others.
pub(crate) fn stem(path: &Path) -> Result<String> {
    let name =
        path.file_name().with_context(|| format!("'{}' has no name", path.display()))?.to_string_lossy();
    let name = cut(&name, |extension| COMPRESSED.contains(&extension)).unwrap_or_else(|| name.into_owned());
    Ok(cut(&name, is_of_mesh).unwrap_or(name))
}

fn cut(name: &str, is_known: fn(&str) -> bool) -> Option<String> {
    let (stem, extension) = name.rsplit_once('.')?;
    (is_known(&extension.to_ascii_lowercase()) && !stem.is_empty()).then(|| stem.to_owned())
}

fn is_list(path: &Path) -> bool {
    let lists = FORMATS.iter().filter(|format| format.is_list).flat_map(|format| format.extensions);
    extension(path).is_some_and(|extension| lists.into_iter().any(|list| *list == extension))
}

fn is_of_mesh(name: &str) -> bool {
    extensions().any(|extension| extension == name)
}

pub(crate) fn is_mesh(path: &Path) -> bool {
    extension(path).is_some_and(|extension| is_of_mesh(&extension)) && path.is_file()
}

/// A name from a list, which must stay below the output folder, in the one way that its file is called.
fn checked(name: &str) -> Result<String> {
    let mut parts = Vec::new();
    for part in Path::new(name).components() {
        match part {
            Component::Normal(part) => parts.push(part.to_string_lossy()),
            Component::CurDir => {}
            _ => bail!("the name '{name}' leads out of the output folder"),
        }
    }
    ensure!(!parts.is_empty(), "the name '{name}' names no file");
    Ok(parts.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lose_the_extensions_of_meshes_only() {
        for (path, name) in [
            ("a/lucy.ply", "lucy"),
            ("lucy.PLY.gz", "lucy"),
            ("lucy.v2.stl.zst", "lucy.v2"),
            ("bun.conf", "bun"),
            ("lucy", "lucy"),
            ("lucy.v2", "lucy.v2"),
            (".ply", ".ply"),
        ] {
            assert_eq!(stem(Path::new(path)).unwrap(), name);
        }
    }

    #[test]
    fn names_stay_below_the_output_folder() {
        for bad in ["../x", "/x", "a/../../x", ""] {
            assert!(checked(bad).is_err(), "{bad}");
        }
        for same in ["a/b", "a//b", "./a/b", "a/./b"] {
            assert_eq!(checked(same).unwrap(), "a/b", "{same}");
        }
    }

    #[test]
    fn folders_patterns_and_lists_name_the_same_models() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("sub")).unwrap();
        for name in ["b.ply", "a.ply.gz", "note.txt", ".hidden.ply", "sub/c.STL", "one.ply"] {
            fs::write(at(name), "").unwrap();
        }
        fs::write(at("set.conf"), "bmesh one.ply 0 0 0 0 0 0 1\n").unwrap();
        let names = |inputs: &[PathBuf], stdin: &str| -> Vec<String> {
            collect(inputs, stdin.as_bytes()).unwrap().into_iter().map(|model| model.name).collect()
        };
        let root = folder.path().to_owned();
        assert_eq!(names(std::slice::from_ref(&root), ""), ["a", "b", "set", "sub/c"]);
        assert_eq!(names(&[at("*.ply")], ""), ["b", "one"]);
        assert_eq!(
            names(&["-".into()], &format!("\u{feff}{0}/b.ply\r\n\n{0}/a.ply.gz\n", root.display())),
            ["a", "b"]
        );
        assert_eq!(names(&[at("b.ply"), at("b.ply")], ""), ["b"]);
        let error = |inputs: &[PathBuf]| format!("{:#}", collect(inputs, &b""[..]).unwrap_err());
        fs::write(at("sub/b.ply"), "").unwrap();
        assert!(error(&[at("b.ply"), at("sub/b.ply")]).contains("would both be built as 'b.chpm'"));
        assert!(error(&[at("none.ply")]).contains("does not exist"));
        assert!(error(&[at("*.obj")]).contains("nothing matches"));
    }
}
