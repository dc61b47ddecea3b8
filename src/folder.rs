//! A folder of results that appears complete or not at all, and that a next run goes on with where one was stopped.

use anyhow::{Context, Error, Result, bail, ensure};
use chpm_extmem::platform::{exchange, sync_below, sync_folder};
use chpm_extmem::{Lock, hidden_name};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use xxhash_rust::xxh3::xxh3_64;

/// A folder that is being filled under a hidden name, `.NAME.KEY.partial`. Dropping it removes it.
///
/// A journal in it has a record of each file that is whole: its length and a hash of its bytes, which are looked at before it is believed. So it does
/// not matter where a process was killed, nor what of its files came to disk.
pub(crate) struct OutputFolder {
    partial: PathBuf,
    target: PathBuf,
    /// None from the end on: some systems remove only what nobody has open.
    journal: Option<File>,
    /// Files of an earlier run, by the hash of the name.
    before: Vec<Written>,
    /// Files that the journal names.
    count: AtomicU64,
    stays: bool,
    /// One at a time.
    _lock: Lock,
}

/// Journal entry of a file: the hash of its name, its length, the hash of its bytes, and a number that its writer wants back.
type Written = [u64; 4];

/// The journal's name, and how it begins; behind that is the key.
const JOURNAL: &str = "journal";
const MAGIC: u64 = u64::from_le_bytes(*b"CHPMjrnl");

impl OutputFolder {
    /// Begins a folder that will be called `target`, or goes on with one of the same `key`, which stands for all that decides its bytes; without a key
    /// it begins anew. Where one is there already, it is replaced if it is empty, or, with `force`, if it holds nothing but files like `names`, whatever numbers are in these, of which the
    /// first has to be there: what else somebody keeps in it, or below it, is not for us to remove.
    pub(crate) fn create(target: &Path, force: bool, names: &[&str], key: Option<u64>) -> Result<Self> {
        let name = target
            .file_name()
            .with_context(|| format!("'{}' is no name for a new folder", target.display()))?;
        // Without a point or a slash at its end, by which nothing can be renamed.
        let target = &target.with_file_name(name);
        let place = target.parent().filter(|place| *place != Path::new("")).unwrap_or(Path::new("."));
        ensure!(!target.is_symlink(), "'{}' is a link; name the folder itself", target.display());
        if target.exists() {
            ensure!(target.is_dir(), "'{}' is there and is no folder; choose another name", target.display());
            replaceable(target, force, names)?;
        }
        let failed = || format!("cannot make a folder in '{}'", place.display());
        fs::metadata(place).with_context(failed)?;
        let lock = Lock::acquire(target)?;
        let hidden = hidden_name(name, &format!(".{:08x}.partial", key.unwrap_or(0) as u32));
        sweep(place, &hidden_name(name, "."), &hidden);
        let partial = place.join(hidden);
        let (journal, before) = match key.and_then(|key| resume(&partial, key)) {
            Some(found) => found,
            None => {
                if partial.exists() {
                    fs::remove_dir_all(&partial).with_context(failed)?;
                }
                fs::create_dir(&partial).with_context(failed)?;
                (begin(&partial, key.unwrap_or(0)).with_context(failed)?, Vec::new())
            }
        };
        let count = AtomicU64::new(before.len() as u64);
        let target = target.to_owned();
        Ok(OutputFolder { partial, target, journal: Some(journal), before, count, stays: false, _lock: lock })
    }

    /// Files that are there from a run that was stopped.
    pub(crate) fn found(&self) -> usize {
        self.before.len()
    }

    /// Where a file of it is written.
    #[cfg(feature = "web")]
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Makes a folder in it.
    pub(crate) fn folder(&self, name: &str) -> Result<()> {
        fs::create_dir_all(self.partial.join(name)).with_context(|| self.failed(name))
    }

    /// Writes a file in it, from any thread.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        fs::write(self.partial.join(name), bytes).with_context(|| self.failed(name))
    }

    /// The same, for a next run to go on from, which gets `note` back.
    pub(crate) fn write_to_keep(&self, name: &str, bytes: &[u8], note: u64) -> Result<()> {
        self.write(name, bytes)?;
        let record: Written = [xxh3_64(name.as_bytes()), bytes.len() as u64, xxh3_64(bytes), note];
        // In one call, so that those of other threads come before or after.
        if let Some(mut journal) = self.journal.as_ref() {
            let written = journal.write_all(record.map(u64::to_le_bytes).as_flattened());
            written.with_context(|| self.failed(JOURNAL))?;
        }
        self.count.fetch_add(1, Relaxed);
        Ok(())
    }

    /// The length and the note of a file that a stopped run has written, if all of it is there.
    pub(crate) fn whole(&self, name: &str) -> Option<(u64, u64)> {
        let key = xxh3_64(name.as_bytes());
        let at = self.before.binary_search_by_key(&key, |written| written[0]).ok()?;
        let [_, len, hash, note] = self.before[at];
        let bytes = fs::read(self.partial.join(name)).ok()?;
        (bytes.len() as u64 == len && xxh3_64(&bytes) == hash).then_some((len, note))
    }

    fn failed(&self, name: &str) -> String {
        format!("cannot write '{name}' of '{}'", self.target.display())
    }

    /// Keeps the finished files for a next run, if they are worth anything; returns the error with a note.
    pub(crate) fn keep(mut self, error: Error) -> Error {
        let count = self.count.load(Relaxed);
        if count == 0 {
            return error;
        }
        self.stays = true;
        let [target, partial] = [&self.target, &self.partial].map(|path| path.display());
        error.context(format!(
            "'{target}' is not whole: the same command goes on from what is kept in '{partial}', {count} files"
        ))
    }

    /// All is written: it goes to disk, and the folder gets its name.
    pub(crate) fn publish(mut self) -> Result<()> {
        let target = self.target.clone();
        let failed = || format!("cannot finish '{}'", target.display());
        // One call for thousands of files.
        sync_below(&self.partial).with_context(failed)?;
        self.journal = None;
        fs::remove_file(self.partial.join(JOURNAL)).with_context(failed)?;
        sync_folder(&self.partial).with_context(failed)?;
        let replaces = target.exists();
        if replaces { exchange(&self.partial, &target) } else { fs::rename(&self.partial, &target) }
            .with_context(failed)?;
        self.stays = true;
        if replaces {
            let _ = fs::remove_dir_all(&self.partial);
        }
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        self.journal = None;
        if !self.stays {
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
}

/// The folder that a file of a folder lies in.
pub(crate) fn above(name: &str) -> &str {
    Path::new(name).parent().and_then(Path::to_str).unwrap_or_default()
}

fn begin(partial: &Path, key: u64) -> io::Result<File> {
    let mut journal = File::options().append(true).create_new(true).open(partial.join(JOURNAL))?;
    journal.write_all([MAGIC, key, 0, 0].map(u64::to_le_bytes).as_flattened())?;
    Ok(journal)
}

/// The journal of a folder of this key, and what it says, by the hashes of names.
fn resume(partial: &Path, key: u64) -> Option<(File, Vec<Written>)> {
    let mut journal = File::options().read(true).append(true).open(partial.join(JOURNAL)).ok()?;
    let mut bytes = Vec::new();
    journal.read_to_end(&mut bytes).ok()?;
    let (records, rest) = bytes.as_chunks::<32>();
    // The last record may have been written in part.
    journal.set_len((bytes.len() - rest.len()) as u64).ok()?;
    fn written(record: &[u8; 32]) -> Written {
        [0, 1, 2, 3].map(|i| u64::from_le_bytes(std::array::from_fn(|byte| record[8 * i + byte])))
    }
    let (head, records) = records.split_first()?;
    if written(head) != [MAGIC, key, 0, 0] {
        return None;
    }
    // Of a file that was written twice, the last time counts.
    let mut before: Vec<Written> = records.iter().rev().map(written).collect();
    before.sort_by_key(|written| written[0]);
    before.dedup_by_key(|written| written[0]);
    Some((journal, before))
}

fn replaceable(target: &Path, force: bool, names: &[&str]) -> Result<()> {
    let told = || format!("cannot look into '{}'", target.display());
    let mut found = fs::read_dir(target).with_context(told)?.peekable();
    if found.peek().is_none() {
        return Ok(());
    }
    ensure!(
        force,
        "'{}' is there already; use --force to replace it, or choose another name",
        target.display()
    );
    let kinds: Vec<String> = names.iter().map(|name| kind(name)).collect();
    if let Some(foreign) = foreign(target, "", &kinds).with_context(told)? {
        bail!(
            "'{}' holds '{}', which this command did not write; choose another folder",
            target.display(),
            foreign.display()
        );
    }
    let is_ours = target.join(names[0]).is_file();
    ensure!(is_ours, "'{}' has no '{}'; choose another folder", target.display(), names[0]);
    Ok(())
}

/// A name without its numbers, by which files of one kind differ.
fn kind(name: &str) -> String {
    let mut kind = String::new();
    for letter in name.chars() {
        match letter {
            '0'..='9' if kind.ends_with('#') => {}
            '0'..='9' => kind.push('#'),
            _ => kind.push(letter),
        }
    }
    kind
}

/// Something in a folder, or below it, that is of none of the kinds, nor a folder of such; `above` is the folder's own kind.
fn foreign(folder: &Path, above: &str, kinds: &[String]) -> io::Result<Option<PathBuf>> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let own = name.to_str().map(|name| format!("{above}{}", kind(name)));
        let is_folder = entry.file_type()?.is_dir();
        let is_known = own.as_ref().is_some_and(|own| match is_folder {
            true => kinds
                .iter()
                .any(|kind| kind.strip_prefix(own.as_str()).is_some_and(|rest| rest.starts_with('/'))),
            false => kinds.contains(own),
        });
        if !is_known {
            return Ok(Some(name.into()));
        }
        let below = own.filter(|_| is_folder).map(|own| foreign(&entry.path(), &format!("{own}/"), kinds));
        if let Some(found) = below.transpose()?.flatten() {
            return Ok(Some(Path::new(&name).join(found)));
        }
    }
    Ok(None)
}

/// Removes what stopped runs left that were for something else; whoever calls has the lock.
fn sweep(place: &Path, begin: &OsStr, own: &OsString) {
    for entry in fs::read_dir(place).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let rest = name.as_encoded_bytes().strip_prefix(begin.as_encoded_bytes());
        let key = rest.and_then(|rest| rest.strip_suffix(b".partial"));
        let is_key = key.is_some_and(|key| key.len() == 8 && key.iter().all(u8::is_ascii_hexdigit));
        if is_key && name != *own {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 2] = ["index", "parts/0/a"];

    fn names(place: &Path) -> Vec<String> {
        let entries = fs::read_dir(place).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn fill(target: &Path, force: bool, text: &str) -> Result<()> {
        let folder = OutputFolder::create(target, force, &NAMES, Some(1))?;
        folder.folder("parts/1")?;
        folder.write("parts/1/a", b"part")?;
        folder.write("index", text.as_bytes())?;
        folder.publish()
    }

    #[test]
    fn a_folder_is_whole_or_not_there() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        let half = OutputFolder::create(&target, false, &NAMES, Some(1)).unwrap();
        half.write("index", b"half").unwrap();
        assert!(!target.exists() && half.write("no/such", b"").is_err());
        let second = OutputFolder::create(&target, false, &NAMES, Some(1)).map(drop).unwrap_err().to_string();
        assert!(second.contains("out"), "{second}");
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
        for end in ["/", "/.", "//./"] {
            fill(Path::new(&format!("{}{end}", empty.display())), true, "four").unwrap();
        }
        assert_eq!(names(place.path()), ["empty", "out"]);
    }

    /// As a process leaves it that is killed: nothing is dropped but the lock.
    fn killed(folder: OutputFolder) {
        let mut folder = folder;
        folder.stays = true;
    }

    #[test]
    fn what_was_whole_is_gone_on_from_and_nothing_else() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        let open = |key| OutputFolder::create(&target, false, &NAMES, Some(key)).unwrap();
        let folder = open(1);
        for (name, bytes) in [("a", "whole"), ("b", "cut short"), ("c", "changed"), ("d", "gone")] {
            folder.write_to_keep(name, bytes.as_bytes(), 7).unwrap();
        }
        folder.write("e", b"not in the journal").unwrap();
        let partial = folder.partial.clone();
        killed(folder);
        fs::write(partial.join("b"), "cut").unwrap();
        fs::write(partial.join("c"), "CHANGED").unwrap();
        fs::remove_file(partial.join("d")).unwrap();
        // The kill came while a record was written.
        let journal = fs::read(partial.join(JOURNAL)).unwrap();
        fs::write(partial.join(JOURNAL), [&journal[..], &journal[32..50]].concat()).unwrap();

        let folder = open(1);
        assert_eq!(
            ["a", "b", "c", "d", "e", "f"].map(|name| folder.whole(name)),
            [Some((5, 7)), None, None, None, None, None]
        );
        assert_eq!(folder.found(), 4);
        folder.write_to_keep("b", b"anew", 8).unwrap();
        killed(folder);
        let folder = open(1);
        assert_eq!(["a", "b"].map(|name| folder.whole(name)), [Some((5, 7)), Some((4, 8))]);
        let told = folder.keep(Error::msg("stopped")).to_string();
        assert!(told.contains("the same command goes on") && told.contains("4 files"), "{told}");

        // Another key begins anew, and so does a journal that is none.
        fs::write(partial.join(JOURNAL), "x".repeat(64)).unwrap();
        assert_eq!(open(1).found(), 0);
        assert!(!partial.exists());
        killed(open(1));
        killed(open(2));
        assert!(!partial.exists());
        // Without a key, nothing is gone on from.
        let anew = || OutputFolder::create(&target, false, &NAMES, None).unwrap();
        let first = anew();
        first.write_to_keep("left", b"", 0).unwrap();
        let left = first.partial.join("left");
        killed(first);
        assert!(left.exists());
        drop(anew());
        assert!(!left.exists());
        let last = open(2);
        last.write_to_keep("index", b"", 0).unwrap();
        last.publish().unwrap();
        assert_eq!((names(place.path()), names(&target)), (vec!["out".to_owned()], vec!["index".to_owned()]));
    }

    #[test]
    fn what_is_not_ours_stays() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("photos");
        fs::create_dir(&target).unwrap();
        fs::create_dir_all(target.join("parts/1")).unwrap();
        fs::write(target.join("parts/1/a"), b"").unwrap();
        assert!(fill(&target, true, "").unwrap_err().to_string().contains("has no 'index'"));
        fs::remove_dir_all(target.join("parts")).unwrap();
        fs::write(target.join("index"), b"").unwrap();
        for foreign in
            ["holiday.jpg", "parts/mine", "parts/12/b", "parts/12/a/mine", "parts/x/a", "index/mine"]
        {
            let file = target.join(foreign);
            if foreign.starts_with("index") {
                fs::remove_file(target.join("index")).unwrap();
            }
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(&file, b"").unwrap();
            let told = fill(&target, true, "").unwrap_err().to_string();
            assert!(told.contains("which this command did not write"), "{foreign}: {told}");
            assert!(file.is_file(), "{foreign}");
            fs::remove_file(&file).unwrap();
            let _ = fs::remove_dir(file.parent().unwrap());
        }
        fs::write(target.join("index"), b"").unwrap();
        fs::create_dir_all(target.join("parts/12")).unwrap();
        fs::write(target.join("parts/12/a"), b"").unwrap();
        fill(&target, true, "ours").unwrap();
        assert_eq!(names(&target.join("parts")), ["1"]);
        let file = place.path().join("file");
        fs::write(&file, b"").unwrap();
        assert!(fill(&file, true, "").is_err() && fill(&place.path().join("no/such"), true, "").is_err());
        std::os::unix::fs::symlink("photos", place.path().join("link")).unwrap();
        assert!(fill(&place.path().join("link"), true, "").is_err());
        for left in [".new.0123abcd.partial", ".new.x.partial", ".other.0123abcd.partial", "a.partial"] {
            fs::create_dir(place.path().join(left)).unwrap();
        }
        fill(&place.path().join("new"), false, "").unwrap();
        let left = names(place.path());
        assert!(!left.contains(&".new.0123abcd.partial".to_owned()), "{left:?}");
        assert!(
            [".new.x.partial", ".other.0123abcd.partial", "a.partial"]
                .iter()
                .all(|n| left.contains(&(*n).to_owned()))
        );
    }
}
