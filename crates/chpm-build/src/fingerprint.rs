//! Identity of files, without reading them: paths, lengths and times.

use crate::error::BuildError;
use chpm_extmem::{Cancel, platform};
use chpm_import::{Images, SourceError, Supply, input};
use std::fs;
use std::path::{Path, PathBuf};

/// The identity of a source, or of the program. Whoever changes a file without changing its length or time is not seen.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Fingerprint {
    files: Vec<File>,
    /// Bytes of all files.
    pub(crate) len: u64,
}

#[derive(Clone, PartialEq, Eq, Debug)]
struct File {
    path: PathBuf,
    len: u64,
    /// Of the last change: seconds and nanoseconds.
    time: (i64, u32),
}

impl Fingerprint {
    /// The identity of `source` as it is now. What came through a pipe has none: nobody else can change it.
    pub(crate) fn of(source: &Supply, images: Images, cancel: &Cancel) -> Result<Fingerprint, BuildError> {
        if source.is_spooled() {
            return Ok(Fingerprint { files: Vec::new(), len: source.len() });
        }
        let found = input::files(&source.path, images, cancel)?;
        let list = &source.path;
        let files = found.into_iter().enumerate().map(|(at, path)| match (at, File::of(path)) {
            // Behind a list come its scans.
            (1.., Err(error)) => {
                Err(SourceError::Member { list: list.clone(), index: at - 1, error: Box::new(error) })
            }
            (_, file) => file,
        });
        Ok(Fingerprint::new(files.collect::<Result<_, _>>()?))
    }

    fn new(files: Vec<File>) -> Fingerprint {
        Fingerprint { len: files.iter().map(|file| file.len).sum(), files }
    }

    /// The identity of the program that runs, where the system tells.
    pub(crate) fn of_program() -> Option<Fingerprint> {
        std::env::current_exe()
            .ok()
            .and_then(|path| File::of(path).ok())
            .map(|file| Fingerprint::new(vec![file]))
    }

    /// An error if a file is no longer what it was.
    pub(crate) fn check(&self) -> Result<(), BuildError> {
        for file in &self.files {
            if File::of(file.path.clone()).ok().as_ref() != Some(file) {
                return Err(BuildError::SourceChanged { path: file.path.clone() });
            }
        }
        Ok(())
    }

    /// An error if the output would replace one of the files.
    pub(crate) fn refuse_output(&self, output: &Path) -> Result<(), BuildError> {
        match self.files.iter().any(|file| chpm_extmem::same_file(&file.path, output)) {
            true => Err(BuildError::OutputIsSource { path: output.to_owned() }),
            false => Ok(()),
        }
    }

    /// Hands everything to `add`, piece by piece.
    pub(crate) fn visit(&self, mut add: impl FnMut(&[u8])) {
        for file in &self.files {
            add(file.path.as_os_str().as_encoded_bytes());
            let (seconds, nanoseconds) = file.time;
            for number in [file.len, seconds as u64, u64::from(nanoseconds)] {
                add(&number.to_le_bytes());
            }
        }
    }
}

impl File {
    fn of(path: PathBuf) -> Result<File, SourceError> {
        look(&path).map_err(|source| SourceError::Read { path: path.clone(), source })
    }
}

fn look(path: &Path) -> Result<File, std::io::Error> {
    let metadata = fs::metadata(path)?;
    let time = platform::modified(&metadata);
    Ok(File { path: path.canonicalize()?, len: metadata.len(), time })
}
