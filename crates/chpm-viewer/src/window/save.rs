//! Files that a person asks for: pictures and paths, under a name that is free.

use crate::headless::Image;
use chpm_extmem::{AtomicFile, ExtmemError};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Numbers that are tried for a name.
const MOST: u32 = 9999;

/// Writes a file that is complete or not there.
pub(super) fn write(path: &Path, overwrite: bool, bytes: &[u8]) -> Result<(), ExtmemError> {
    let mut file = AtomicFile::create(path, overwrite)?;
    file.write_all(bytes).map_err(|error| file.error(error))?;
    file.publish()?;
    Ok(())
}

/// Writes `STEM-N.EXTENSION` into a folder, with the first number that is free; answers the path.
pub(super) fn numbered(
    folder: &Path,
    stem: &str,
    extension: &str,
    bytes: &[u8],
) -> Result<PathBuf, ExtmemError> {
    let name = |number: u32| folder.join(format!("{stem}-{number}.{extension}"));
    let path = (1..MOST).map(name).find(|path| path.symlink_metadata().is_err());
    let path = path.unwrap_or_else(|| name(MOST));
    write(&path, false, bytes)?;
    Ok(path)
}

/// A picture as a PNG in memory.
pub(super) fn png(image: &Image) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    image.write_png(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_go_on_and_nothing_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let save = |bytes: &[u8]| numbered(folder.path(), "scan", "path", bytes).unwrap();
        assert_eq!(save(b"one"), folder.path().join("scan-1.path"));
        assert_eq!(save(b"two"), folder.path().join("scan-2.path"));
        assert_eq!(std::fs::read(folder.path().join("scan-1.path")).unwrap(), b"one");
        assert!(write(&folder.path().join("scan-1.path"), false, b"three").is_err());
        assert!(numbered(&folder.path().join("none"), "scan", "path", b"").is_err());
    }

    #[test]
    fn a_picture_is_a_png() {
        let image = Image { size: [2, 1], pixels: vec![255, 0, 0, 255, 0, 0, 255, 255] };
        let bytes = png(&image).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; 8];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height, pixels), (2, 1, image.pixels));
    }
}
