//! Where the .chpm of a mesh is that `view` builds: beside the mesh, or where its folder cannot be written, in the user's cache.

use crate::batch::inputs;
use anyhow::{Context, Result};
use chpm_extmem::platform;
use std::fs;
use std::hash::Hasher;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// A place for the file of a mesh.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Beside {
    pub(crate) path: PathBuf,
    /// Whether it is in the cache: what is there may be replaced.
    pub(crate) is_cached: bool,
}

impl Beside {
    /// That of a mesh: under its name in its folder. If that cannot be written, and nothing is there that `is_current`, in the
    /// user's cache, which is made if it is not there.
    pub(crate) fn of(source: &Path, is_current: impl Fn(&Path) -> bool) -> Result<Beside> {
        Self::with_cache(source, is_current, cache())
    }

    fn with_cache(
        source: &Path,
        is_current: impl Fn(&Path) -> bool,
        cache: Option<PathBuf>,
    ) -> Result<Beside> {
        let stem = inputs::stem(source)?;
        let path = source.with_file_name(format!("{stem}.chpm"));
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if is_writable(folder) || is_current(&path) {
            return Ok(Beside { path, is_cached: false });
        }
        let name = source.display();
        let cache = cache.with_context(|| {
            format!(
                "the folder of '{name}' cannot be written, and there is no folder for caches: set XDG_CACHE_HOME, or \
                 build it elsewhere with chpm build -o"
            )
        })?;
        let made = fs::create_dir_all(&cache);
        made.with_context(|| {
            format!(
                "the folder of '{name}' cannot be written, nor that for caches, '{}': set XDG_CACHE_HOME, or build it \
                 elsewhere with chpm build -o",
                cache.display()
            )
        })?;
        // Meshes of one name in many folders have a file each.
        let whole = fs::canonicalize(source).with_context(|| format!("cannot read '{name}'"))?;
        let mut hash = Xxh3::new();
        hash.write(whole.as_os_str().as_encoded_bytes());
        Ok(Beside { path: cache.join(format!("{stem}-{:016x}.chpm", hash.finish())), is_cached: true })
    }
}

/// Whether files can be made in a folder. What else is wrong with it is told by whoever writes there.
fn is_writable(folder: &Path) -> bool {
    match tempfile::tempfile_in(folder) {
        Ok(_) => true,
        Err(error) => !matches!(error.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem),
    }
}

/// The folder for files that can be made again.
fn cache() -> Option<PathBuf> {
    platform::cache_folder().map(|folder| folder.join("chpm"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_in_a_folder_that_can_be_written_has_its_file_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("scan.ply.gz");
        let place = Beside::with_cache(&source, |_| false, None).unwrap();
        assert_eq!(place, Beside { path: folder.path().join("scan.chpm"), is_cached: false });
    }

    /// Not even the administrator makes files there.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_mesh_in_one_that_cannot_has_a_file_of_its_own_in_the_cache() {
        let folder = tempfile::tempdir().unwrap();
        let cache = folder.path().join("caches").join("chpm");
        // Any file that can be named there.
        let [one, other] = ["/proc/self/status", "/proc/self/stat"].map(Path::new);
        let place = |source, cache| Beside::with_cache(source, |_| false, cache);
        let (first, second) =
            (place(one, Some(cache.clone())).unwrap(), place(other, Some(cache.clone())).unwrap());
        assert!(first.is_cached && first.path.parent() == Some(&cache) && cache.is_dir());
        assert!(first.path.file_name().unwrap().to_string_lossy().starts_with("status-"));
        assert_ne!(first, second);
        assert!(place(one, None).unwrap_err().to_string().contains("XDG_CACHE_HOME"));
        // What somebody else has built beside it is used.
        let theirs = Beside::with_cache(one, |path| path.ends_with("status.chpm"), Some(cache)).unwrap();
        assert!(!theirs.is_cached);
    }
}
