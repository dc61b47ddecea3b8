//! A small dialog that goes through folders and chooses a file; with no toolkit of the system behind it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Something that can be chosen.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Entry {
    /// As it is shown: a folder with a slash behind.
    pub name: String,
    /// Where it is.
    pub path: PathBuf,
    /// Whether choosing it goes on in it.
    pub is_folder: bool,
}

/// The folder that is looked at, and what is in it.
#[derive(Clone, Debug, Default)]
pub struct Browser {
    folder: PathBuf,
    entries: Vec<Entry>,
    fault: Option<String>,
}

impl Browser {
    /// Looks at a folder; `wanted` tells the files that are shown.
    pub fn new(folder: &Path, wanted: impl Fn(&Path) -> bool) -> Self {
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        let (entries, fault) = match entries(&folder, wanted) {
            Ok(entries) => (entries, None),
            Err(error) => (Vec::new(), Some(error.to_string())),
        };
        Browser { folder, entries, fault }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Entries of the folder: folders first, by name.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Why nothing is shown.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }
}

fn entries(folder: &Path, wanted: impl Fn(&Path) -> bool) -> io::Result<Vec<Entry>> {
    let mut found = Vec::new();
    for path in fs::read_dir(folder)?.flatten().map(|entry| entry.path()) {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let is_folder = path.is_dir();
        if name.starts_with('.') || !(is_folder || wanted(&path)) {
            continue;
        }
        let name = if is_folder { name + "/" } else { name };
        found.push(Entry { name, path, is_folder });
    }
    found.sort_by(|a, b| (!a.is_folder, &a.name).cmp(&(!b.is_folder, &b.name)));
    if let Some(parent) = folder.parent() {
        found.insert(0, Entry { name: "../".to_owned(), path: parent.to_owned(), is_folder: true });
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_come_first_and_files_that_are_not_wanted_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.chpm", "a.txt", ".hidden.chpm", "a.chpm"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        fs::create_dir(folder.path().join("z")).unwrap();
        let wanted = |path: &Path| path.extension().is_some_and(|extension| extension == "chpm");
        let browser = Browser::new(folder.path(), wanted);
        let names: Vec<&str> = browser.entries().iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(names, ["../", "z/", "a.chpm", "b.chpm"]);
        assert_eq!(browser.entries()[0].path, folder.path().parent().unwrap());
        assert!(browser.entries()[1].is_folder && !browser.entries()[2].is_folder);
        assert!(Browser::new(&folder.path().join("none"), wanted).fault().is_some());
    }
}
