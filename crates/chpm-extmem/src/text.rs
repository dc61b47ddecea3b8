//! Files of limited length: what is named may be another file, or have no end.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Reads a file of `most` bytes or fewer.
///
/// # Errors
/// As [`std::fs::read`], and [`ErrorKind::FileTooLarge`] for a longer one, of which no more is read.
pub fn read_limited(path: &Path, most: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let told = format!("it is longer than {:.1} MiB: is it another file?", most as f64 / 1_048_576.0);
        return Err(Error::new(ErrorKind::FileTooLarge, told));
    }
    Ok(bytes)
}

/// Mark of UTF-8.
const MARK: char = '\u{feff}';

/// Reads a text file of `most` bytes or fewer, without the mark of UTF-8 that some editors put before it.
///
/// # Errors
/// As [`read_limited`], and [`ErrorKind::InvalidData`] for what is no text.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    let mut text = String::from_utf8(read_limited(path, most)?)
        .map_err(|_| Error::new(ErrorKind::InvalidData, "it is no text in UTF-8"))?;
    if text.starts_with(MARK) {
        text.drain(..MARK.len_utf8());
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_too_long_is_told_of() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, vec![b'x'; 1 << 20]).unwrap();
        assert_eq!(read_text(&path, 1 << 20).unwrap().len(), 1 << 20);
        let error = read_text(&path, (1 << 20) - 1).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        // A file without an end is not read to it.
        let error = read_text(Path::new("/dev/zero"), 2 << 20).unwrap_err();
        assert!(error.to_string().contains("longer than 2.0 MiB"), "{error}");
        std::fs::write(&path, "\u{feff}a\u{feff}").unwrap();
        assert_eq!(read_text(&path, 9).unwrap(), "a\u{feff}");
        std::fs::write(&path, [0xff]).unwrap();
        assert_eq!(read_text(&path, 1).unwrap_err().kind(), ErrorKind::InvalidData);
    }
}
