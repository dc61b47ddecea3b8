//! A folder of results that appears complete or not at all.

use anyhow::{Context, Result, bail, ensure};
use chpm_extmem::hidden_name;
use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// A folder that is being filled under a hidden name, `.NAME.PROCESS.partial`. Dropping it removes it.
pub(crate) struct OutputFolder {
    partial: PathBuf,
    target: PathBuf,
    published: bool,
}

impl OutputFolder {
    /// Begins a folder that will be called `target`. Where one is there already, it is replaced if it is empty, or, with `force`, if it holds nothing
    /// but `names`, of which the first has to be there: what else somebody keeps in it is not for us to remove.
    pub(crate) fn create(target: &Path, force: bool, names: &[&str]) -> Result<Self> {
        let name = target
            .file_name()
            .with_context(|| format!("'{}' is no name for a new folder", target.display()))?;
        let place = target.parent().filter(|place| *place != Path::new("")).unwrap_or(Path::new("."));
        ensure!(!target.is_symlink(), "'{}' is a link; name the folder itself", target.display());
        if target.exists() {
            ensure!(target.is_dir(), "'{}' is there and is no folder; choose another name", target.display());
            replaceable(target, force, names)?;
        }
        let begin = hidden_name(name, ".");
        sweep(place, &begin);
        let mut hidden = begin;
        hidden.push(format!("{}.partial", std::process::id()));
        let partial = place.join(hidden);
        fs::create_dir(&partial).with_context(|| format!("cannot make a folder in '{}'", place.display()))?;
        Ok(OutputFolder { partial, target: target.to_owned(), published: false })
    }

    /// Makes a folder in it.
    pub(crate) fn folder(&self, name: &str) -> Result<()> {
        fs::create_dir_all(self.partial.join(name)).with_context(|| self.failed(name))
    }

    /// Writes a file in it, from any thread.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        fs::write(self.partial.join(name), bytes).with_context(|| self.failed(name))
    }

    fn failed(&self, name: &str) -> String {
        format!("cannot write '{name}' of '{}'", self.target.display())
    }

    /// All is written: it goes to disk, and the folder gets its name.
    pub(crate) fn publish(mut self) -> Result<()> {
        let failed = || format!("cannot finish '{}'", self.target.display());
        // One call for thousands of files.
        let opened = File::open(&self.partial).with_context(failed)?;
        nix::unistd::syncfs(&opened).with_context(failed)?;
        let mut old = self.partial.clone().into_os_string();
        old.push(".old");
        let replaces = fs::rename(&self.target, &old).is_ok();
        if let Err(error) = fs::rename(&self.partial, &self.target) {
            if replaces {
                let _ = fs::rename(&old, &self.target);
            }
            return Err(error).with_context(failed);
        }
        self.published = true;
        if replaces {
            let _ = fs::remove_dir_all(&old);
        }
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if !self.published {
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
}

fn replaceable(target: &Path, force: bool, names: &[&str]) -> Result<()> {
    let told = || format!("cannot look into '{}'", target.display());
    let entries = fs::read_dir(target).with_context(told)?;
    let found: Vec<OsString> =
        entries.map(|entry| Ok(entry?.file_name())).collect::<std::io::Result<_>>().with_context(told)?;
    if found.is_empty() {
        return Ok(());
    }
    ensure!(
        force,
        "'{}' is there already; use --force to replace it, or choose another name",
        target.display()
    );
    let foreign = found.iter().find(|found| !names.iter().any(|name| *found == name));
    if let Some(foreign) = foreign {
        bail!(
            "'{}' holds '{}', which no export made; choose another folder",
            target.display(),
            foreign.display()
        );
    }
    ensure!(target.join(names[0]).is_file(), "'{}' is no export; choose another folder", target.display());
    Ok(())
}

/// Removes what processes left that were killed.
fn sweep(place: &Path, begin: &OsString) {
    for entry in fs::read_dir(place).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let rest = name.as_encoded_bytes().strip_prefix(begin.as_encoded_bytes());
        let process = rest.and_then(|rest| rest.strip_suffix(b".partial")).map(String::from_utf8_lossy);
        let is_dead = |id: &str| {
            !id.is_empty() && id.bytes().all(|c| c.is_ascii_digit()) && !Path::new("/proc").join(id).exists()
        };
        if process.is_some_and(|id| is_dead(&id)) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 2] = ["index", "parts"];

    fn names(place: &Path) -> Vec<String> {
        let entries = fs::read_dir(place).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn fill(target: &Path, force: bool, text: &str) -> Result<()> {
        let folder = OutputFolder::create(target, force, &NAMES)?;
        folder.folder("parts/1")?;
        folder.write("parts/1/a", b"part")?;
        folder.write("index", text.as_bytes())?;
        folder.publish()
    }

    #[test]
    fn a_folder_is_whole_or_not_there() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        let half = OutputFolder::create(&target, false, &NAMES).unwrap();
        half.write("index", b"half").unwrap();
        assert!(!target.exists() && half.write("no/such", b"").is_err());
        drop(half);
        assert!(names(place.path()).is_empty());
        fill(&target, false, "one").unwrap();
        assert_eq!(
            (names(place.path()), names(&target)),
            (vec!["out".to_owned()], vec!["index".to_owned(), "parts".to_owned()])
        );
        assert!(fill(&target, false, "two").unwrap_err().to_string().contains("--force"));
        fill(&target, true, "two").unwrap();
        assert_eq!(
            (fs::read(target.join("index")).unwrap(), names(place.path()).len()),
            (b"two".to_vec(), 1)
        );
        let empty = place.path().join("empty");
        fs::create_dir(&empty).unwrap();
        fill(&empty, false, "three").unwrap();
    }

    #[test]
    fn what_is_not_ours_stays() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("photos");
        fs::create_dir(&target).unwrap();
        fs::write(target.join("parts"), b"").unwrap();
        assert!(fill(&target, true, "").unwrap_err().to_string().contains("no export"));
        fs::write(target.join("index"), b"").unwrap();
        fs::write(target.join("holiday.jpg"), b"").unwrap();
        assert!(fill(&target, true, "").unwrap_err().to_string().contains("holiday.jpg"));
        assert_eq!(names(&target).len(), 3);
        let file = place.path().join("file");
        fs::write(&file, b"").unwrap();
        assert!(fill(&file, true, "").is_err() && fill(&place.path().join("no/such"), true, "").is_err());
        std::os::unix::fs::symlink("photos", place.path().join("link")).unwrap();
        assert!(fill(&place.path().join("link"), true, "").is_err());
        // Left by a process that is no more, and by one that is.
        let alive = format!(".new.{}.partial", std::process::id());
        for left in [".new.4194999.partial", ".new.x.partial", ".other.4194999.partial", "a.partial"] {
            fs::create_dir(place.path().join(left)).unwrap();
        }
        fill(&place.path().join("new"), false, "").unwrap();
        let left = names(place.path());
        assert!(!left.contains(&".new.4194999.partial".to_owned()) && !left.contains(&alive), "{left:?}");
        assert!(
            [".new.x.partial", ".other.4194999.partial", "a.partial"]
                .iter()
                .all(|n| left.contains(&(*n).to_owned()))
        );
    }
}
