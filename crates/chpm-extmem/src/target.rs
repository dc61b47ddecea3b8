//! Where a result goes: what its name stands for, whether that may be replaced, and how what is hidden beside it is called.

use crate::ExtmemError;
use crate::platform::{self, Kind, first_bytes, id_at};
use std::ffi::{OsStr, OsString};
use std::fs::FileType;
use std::io;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Bytes that a name may have on all common file systems.
const LONGEST: usize = 255;
/// Bytes that are kept free for what [`hidden_name`] appends: `.XXXXXXXX-XXXXXXXX.work` is the longest.
const TAIL: usize = 24;

/// The file that is written, or replaced, when a result is to be called `path`: the one that a symbolic link points at, or `path`
/// itself. It is a regular file or not there.
///
/// # Errors
/// [`ExtmemError::NotAFile`] for a path that ends in no name, [`ExtmemError::Irregular`] if something other than a regular file has the
/// name, [`ExtmemError::Dangling`] if it is a link to nothing, [`ExtmemError::Exists`] if it is a file and `overwrite` is false,
/// [`ExtmemError::Io`] if the system does not tell.
pub fn target(path: &Path, overwrite: bool) -> Result<PathBuf, ExtmemError> {
    let failed = |source| ExtmemError::io("create", path, 0, source);
    // What ends in a slash or a dot is a directory, whether it is there or not.
    if !path.file_name().is_some_and(|name| ends_with(path.as_os_str(), name)) {
        return Err(ExtmemError::NotAFile { path: path.to_owned() });
    }
    let is_link = match path.symlink_metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(path.to_owned()),
        found => found.map_err(failed)?.is_symlink(),
    };
    let kind = match path.metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let to = path.read_link().unwrap_or_default();
            return Err(ExtmemError::Dangling { path: path.to_owned(), to });
        }
        found => found.map_err(failed)?.file_type(),
    };
    if !kind.is_file() {
        return Err(ExtmemError::Irregular { path: path.to_owned(), is: kind_name(kind) });
    }
    if !overwrite {
        return Err(ExtmemError::Exists { path: path.to_owned() });
    }
    if is_link { path.canonicalize().map_err(failed) } else { Ok(path.to_owned()) }
}

fn ends_with(path: &OsStr, name: &OsStr) -> bool {
    path.as_encoded_bytes().ends_with(name.as_encoded_bytes())
}

fn kind_name(kind: FileType) -> &'static str {
    match platform::kind(kind) {
        Kind::Folder => "a directory",
        Kind::Pipe => "a FIFO",
        Kind::Socket => "a socket",
        Kind::Terminal | Kind::Blocks => "a device",
        Kind::File | Kind::Other => "no regular file",
    }
}

/// Whether two names are of one file, by a link of either kind or by another way to it.
pub fn same_file(a: &Path, b: &Path) -> bool {
    matches!((id_at(a), id_at(b)), (Ok(a), Ok(b)) if a == b)
}

/// `.NAME` and a tail of at most 23 bytes, for what lies beside a file called `name`. Of a name that is too long for that the end is
/// replaced by a hash of the whole: what belongs to one name begins in the same way, whatever the tail, and in another way than
/// what belongs to another name.
pub fn hidden_name(name: &OsStr, tail: &str) -> OsString {
    let mut hidden = OsString::from(".");
    if 1 + name.len() + TAIL <= LONGEST {
        hidden.push(name);
    } else {
        let hash = format!("~{:016x}", xxh3_64(name.as_encoded_bytes()));
        let most = LONGEST - TAIL - 1 - hash.len();
        // Where the name is UTF-8, what is left of it is, too: some file systems take nothing else.
        let cut = name.to_str().map_or(most, |text| text.floor_char_boundary(most));
        hidden.push(first_bytes(name, cut));
        hidden.push(hash);
    }
    hidden.push(tail);
    hidden
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::sys::stat::Mode;
    use std::fs;
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;

    #[test]
    fn only_regular_files_are_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        nix::unistd::mkfifo(&at("fifo"), Mode::S_IRWXU).unwrap();
        let _socket = UnixListener::bind(at("socket")).unwrap();
        fs::create_dir(at("folder")).unwrap();

        for (name, is) in [("fifo", "a FIFO"), ("socket", "a socket"), ("folder", "a directory")] {
            symlink(name, at("link")).unwrap();
            for path in [at(name), at("link")] {
                for overwrite in [false, true] {
                    let error = target(&path, overwrite).unwrap_err();
                    assert!(
                        matches!(error, ExtmemError::Irregular { is: found, .. } if found == is),
                        "{error}"
                    );
                    assert!(error.to_string().contains(is) && !error.to_string().contains("--force"));
                }
            }
            fs::remove_file(at("link")).unwrap();
        }

        fs::write(at("file"), "").unwrap();
        assert_eq!(target(&at("file"), true).unwrap(), at("file"));
        assert!(matches!(target(&at("file"), false), Err(ExtmemError::Exists { .. })));
        assert_eq!(target(&at("new"), false).unwrap(), at("new"));
    }

    #[test]
    fn a_link_stands_for_what_it_points_at() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path().canonicalize().unwrap();
        fs::create_dir(root.join("far")).unwrap();
        fs::write(root.join("far/file"), "").unwrap();
        symlink("far/file", root.join("once")).unwrap();
        symlink("once", root.join("twice")).unwrap();
        assert_eq!(target(&root.join("twice"), true).unwrap(), root.join("far/file"));
        assert!(matches!(target(&root.join("twice"), false), Err(ExtmemError::Exists { .. })));
        symlink("nothing", root.join("dangling")).unwrap();
        let error = target(&root.join("dangling"), true).unwrap_err();
        assert!(error.to_string().contains("'nothing'"), "{error}");
        symlink("round", root.join("round")).unwrap();
        assert!(matches!(target(&root.join("round"), true), Err(ExtmemError::Io { .. })));
    }

    #[test]
    fn what_ends_in_no_name_is_no_file() {
        let dir = tempfile::tempdir().unwrap();
        for path in ["", "/", ".", "..", "new/", "new/.", "a/.."] {
            assert!(
                matches!(target(&dir.path().join(path), true), Err(ExtmemError::NotAFile { .. })),
                "{path}"
            );
        }
        fs::write(dir.path().join("file"), "").unwrap();
        assert!(matches!(target(&dir.path().join("file/x"), true), Err(ExtmemError::Io { .. })));
    }

    #[test]
    fn files_are_the_same_by_any_name() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::write(at("one"), "").unwrap();
        fs::write(at("two"), "").unwrap();
        fs::hard_link(at("one"), at("hard")).unwrap();
        symlink("one", at("soft")).unwrap();
        assert!(same_file(&at("one"), &at("hard")) && same_file(&at("soft"), &at("one")));
        assert!(!same_file(&at("one"), &at("two")) && !same_file(&at("none"), &at("none")));
    }

    #[test]
    fn hidden_names_are_short_enough_and_tell_long_names_apart() {
        let tails = ["", ".lock", ".4294967295.partial", ".01234567-89abcdef.work"];
        for len in 1..=LONGEST {
            for letter in ["a", "ä", "\u{1f600}"] {
                let mut name = letter.repeat(len.div_ceil(letter.len()));
                name.truncate(name.floor_char_boundary(len));
                let hidden = tails.map(|tail| hidden_name(OsStr::new(&name), tail));
                let stem = hidden[0].to_str().unwrap();
                for (hidden, tail) in hidden.iter().zip(tails) {
                    assert!(hidden.len() <= LONGEST && *hidden == *format!("{stem}{tail}"), "{hidden:?}");
                }
                assert!(len > 200 || stem == format!(".{name}"));
            }
        }
        let long = |last: &str| hidden_name(OsStr::new(&("x".repeat(250) + last)), "");
        assert_ne!(long("a"), long("b"));
        hidden_name(OsStr::from_bytes(&[0xff; 255]), ".lock");
    }
}
