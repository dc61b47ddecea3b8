//! Files that a text of any system names: found in its folder or below, and nowhere else.

use crate::error::SourceError;
use crate::supply::Supply;
use std::path::{Component, Path, PathBuf};
use std::{fs, io};

const ABSENT: &str = "is not there";

/// Finds the file that the one at `from` calls `name`. A name that leads out of the folder, as those of other machines do, stands for
/// the file of that name beside it.
///
/// # Errors
/// In words why there is none.
pub(crate) fn find(name: &str, from: &Path) -> Result<PathBuf, String> {
    let name = name.trim().trim_matches('"').replace('\\', "/");
    let last = name.rsplit('/').next().unwrap_or_default();
    let mut refused = None;
    for name in is_below(&name).then_some(&*name).into_iter().chain([last]) {
        let path = from.with_file_name("").join(name);
        match Supply::file(&path) {
            Ok(_) if is_below(name) => return Ok(path),
            Ok(_) => {}
            Err(error) => refused = refused.or(Some(why(&error))),
        }
    }
    if let Some(found) = in_bytes(&name, &from.with_file_name("")) {
        return Ok(found);
    }
    let refused = match refused {
        Some(why) if why == ABSENT && !is_below(&name) => Some("is outside the source's folder".to_owned()),
        refused => refused,
    };
    Err(refused.unwrap_or_else(|| "has no name".to_owned()))
}

/// The one file of a folder whose name in bytes that are no UTF-8 reads like this: texts in other codes were read so, too.
fn in_bytes(name: &str, folder: &Path) -> Option<PathBuf> {
    let lost = char::REPLACEMENT_CHARACTER;
    let path = Path::new(name);
    let last = path.file_name()?.to_str().filter(|last| last.contains(lost))?;
    let within = folder.join(path.parent().filter(|_| is_below(name))?);
    let within = if within.as_os_str().is_empty() { PathBuf::from(".") } else { within };
    let entries = fs::read_dir(within).into_iter().flatten().flatten();
    let mut alike = entries.filter(|entry| {
        let name = entry.file_name();
        name.to_str().is_none() && name.to_string_lossy() == last
    });
    let found = alike.next().filter(|_| alike.next().is_none())?.path();
    Supply::file(&found).is_ok().then_some(found)
}

/// Whether a name leads to something in a folder or below.
fn is_below(name: &str) -> bool {
    let is_plain = |it: Component<'_>| matches!(it, Component::Normal(_) | Component::CurDir);
    let has_drive = name.as_bytes().get(1) == Some(&b':');
    !name.is_empty() && !has_drive && Path::new(name).components().all(is_plain)
}

fn why(error: &SourceError) -> String {
    match error {
        SourceError::Read { source, .. } if source.kind() == io::ErrorKind::NotFound => ABSENT.to_owned(),
        SourceError::Read { source, .. } => format!("cannot be read: {source}"),
        SourceError::NotAFile { what, .. } => format!("is {what}"),
        error => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_all_systems_lead_to_files_beside() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("model");
        fs::create_dir_all(folder.join("maps")).unwrap();
        for name in ["my wall.png", "maps/roof.png", "../outside.png"] {
            fs::write(folder.join(name), "").unwrap();
        }

        let find = |name: &str| find(name, &folder.join("a.obj"));
        for (name, found) in [
            ("my wall.png", "my wall.png"),
            (" \"my wall.png\" ", "my wall.png"),
            (".\\maps\\roof.png", "./maps/roof.png"),
            ("C:\\Users\\me\\my wall.png", "my wall.png"),
            ("/home/me/my wall.png", "my wall.png"),
            ("../textures/my wall.png", "my wall.png"),
        ] {
            assert_eq!(find(name), Ok(folder.join(found)), "{name}");
        }
        for (name, told) in [
            ("other.png", "is not there"),
            ("maps", "is a folder"),
            ("../outside.png", "is outside the source's folder"),
            ("C:\\maps\\other.png", "is outside the source's folder"),
            ("..", "is a folder"),
            ("a/..", "is a folder"),
            ("", "is a folder"),
        ] {
            assert_eq!(find(name).unwrap_err(), told, "{name}");
        }
        assert!(find("a\0b.png").unwrap_err().starts_with("cannot be read"));
    }
}
