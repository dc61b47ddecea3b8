//! Settings of a person for a model, from one time to the next: a small TOML file for each model in the user's state folder.
//!
//! The file's name is made of the model's absolute path, and the path is in it, too. A file that is missing says nothing; one that is
//! damaged, or of another path, says so and is ignored, and replaced when the window closes.

use crate::window::settings::Settings;
use chpm_extmem::{AtomicFile, platform, read_text};
use chpm_refine::Camera;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// First field of every file; another one is not read.
const VERSION: u32 = 1;
/// Most bytes of what is remembered of a model.
const MOST: u64 = 1 << 20;
/// Sizes of a window, in pixels, that are taken for one.
const SIZES: std::ops::RangeInclusive<u32> = 64..=32_768;

/// Remembered settings of a model.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Remembered {
    version: u32,
    /// The model's absolute path.
    model: String,
    /// Width and height of the window, pixels.
    pub window: [u32; 2],
    camera: SavedCamera,
    /// The panel.
    pub settings: Settings,
}

/// A camera as text.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
struct SavedCamera {
    position: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    fov: f64,
    /// Degrees that the picture is turned counterclockwise.
    #[serde(default)]
    roll: f64,
}

impl Remembered {
    /// Settings to remember of a model: an upright camera, and how far its picture is rolled.
    pub fn new(model: &Path, window: [u32; 2], camera: &Camera, roll: f64, settings: &Settings) -> Self {
        let Camera { position, target, up, fov, .. } = *camera;
        let camera = SavedCamera { position, target, up, fov, roll };
        Remembered { version: VERSION, model: key(model), window, camera, settings: settings.clone() }
    }

    /// The camera, in the model's coordinates, and how far its picture is rolled. Whether it can be one, who uses it checks.
    pub fn camera(&self) -> (Camera, f64) {
        let SavedCamera { position, target, up, fov, roll } = self.camera;
        (Camera { position, target, up, fov, near: 0.0 }, roll)
    }

    fn check(self, model: &Path) -> Result<Self, String> {
        if self.version != VERSION {
            return Err(format!("it is of version {}, this program writes {VERSION}", self.version));
        }
        if self.model != key(model) {
            return Err(format!("it is about another model, '{}'", self.model));
        }
        if !self.window.iter().all(|size| SIZES.contains(size)) {
            return Err(format!("{:?} is no window", self.window));
        }
        self.settings.check()?;
        Ok(self)
    }
}

/// Where the files are.
#[derive(Clone, Debug)]
pub struct Memory {
    folder: Option<PathBuf>,
}

impl Memory {
    /// In the user's folder for what programs remember; where there is none, nothing is remembered.
    pub fn of_user() -> Self {
        Memory { folder: platform::state_folder().map(|folder| folder.join("chpm")) }
    }

    /// In this folder.
    pub fn at(folder: PathBuf) -> Self {
        Memory { folder: Some(folder) }
    }

    /// Remembered settings of a model, if there are any; a note for the user if they cannot be read.
    pub fn recall(&self, model: &Path) -> Result<Option<Remembered>, String> {
        let Some(file) = self.file(model) else { return Ok(None) };
        let note = |why: String| {
            format!("what was remembered of this model is ignored: '{}': {why}", file.display())
        };
        let text = match read_text(&file, MOST) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(note(error.to_string())),
        };
        let remembered: Remembered =
            toml::from_str(&text).map_err(|error| note(error.message().to_owned()))?;
        remembered.check(model).map(Some).map_err(note)
    }

    /// Remembers, in a file that is complete or not there.
    pub fn keep(&self, model: &Path, remembered: &Remembered) -> Result<(), String> {
        let Some(file) = self.file(model) else { return Ok(()) };
        let text = toml::to_string(remembered).map_err(io::Error::other);
        let kept = text.and_then(|text| write(&file, text.as_bytes()));
        kept.map_err(|error| format!("cannot remember the view in '{}': {error}", file.display()))
    }

    /// The file of a model.
    pub fn file(&self, model: &Path) -> Option<PathBuf> {
        let key = key(model);
        let stem = model.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        // The stem is for people who look into the folder; the hash tells models apart.
        let plain: String =
            stem.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).take(40).collect();
        Some(self.folder.as_ref()?.join(format!("{plain}-{:016x}.toml", fnv1a(key.as_bytes()))))
    }
}

fn write(file: &Path, bytes: &[u8]) -> io::Result<()> {
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder)?;
    }
    let mut out = AtomicFile::create(file, true).map_err(io::Error::other)?;
    out.write_all(bytes)?;
    out.publish().map_err(io::Error::other)
}

/// The model's absolute path, symbolic links followed where they can be.
fn key(model: &Path) -> String {
    let path = model.canonicalize().or_else(|_| std::path::absolute(model));
    path.unwrap_or_else(|_| model.to_owned()).to_string_lossy().into_owned()
}

/// The hash of Fowler, Noll and Vo, 64 bits: the same in every version of this program.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn remembered(model: &Path) -> Remembered {
        let camera = Camera { up: [0.0, 0.0, 1.0], ..Camera::looking([1.5, -2.25, 1e9], [0.1; 3]) };
        Remembered::new(model, [1280, 720], &camera, -15.0, &Settings::default())
    }

    #[test]
    fn what_was_kept_is_recalled_by_any_name_of_the_model() {
        let folder = tempfile::tempdir().unwrap();
        let memory = Memory::at(folder.path().join("deep/state"));
        let model = folder.path().join("a model.chpm");
        fs::write(&model, "").unwrap();
        assert_eq!(memory.recall(&model), Ok(None));
        memory.keep(&model, &remembered(&model)).unwrap();
        let again = folder.path().join("deep/../a model.chpm");
        assert_eq!(memory.recall(&again), Ok(Some(remembered(&model))));
        assert_eq!(memory.recall(&again).unwrap().unwrap().camera(), remembered(&model).camera());
        assert_eq!(memory.recall(&folder.path().join("other.chpm")), Ok(None));
        let mut other = remembered(&model);
        other.window = [800, 600];
        memory.keep(&model, &other).unwrap();
        assert_eq!(memory.recall(&model), Ok(Some(other)));
        assert_eq!(fs::read_dir(folder.path().join("deep/state")).unwrap().count(), 1, "no temporary files");
    }

    /// A camera that an earlier version kept has no roll.
    #[test]
    fn an_upright_camera_says_nothing_of_roll() {
        let folder = tempfile::tempdir().unwrap();
        let memory = Memory::at(folder.path().to_owned());
        let model = Path::new("/no/where/model.chpm");
        let text = toml::to_string(&remembered(model)).unwrap();
        fs::write(memory.file(model).unwrap(), text.replace("roll = -15.0\n", "")).unwrap();
        assert_eq!(memory.recall(model).unwrap().unwrap().camera(), (remembered(model).camera().0, 0.0));
    }

    #[test]
    fn damage_is_told_and_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let memory = Memory::at(folder.path().to_owned());
        let model = Path::new("/no/where/model.chpm");
        let file = memory.file(model).unwrap();
        let good = toml::to_string(&remembered(model)).unwrap();

        let swapped = |from: &str, to: &str| {
            assert!(good.contains(from), "{from} in {good}");
            good.replacen(from, to, 1).into_bytes()
        };

        for bad in [
            Vec::new(),
            b"\xff\xfe".to_vec(),
            [good.as_bytes(), &vec![b'#'; MOST as usize]].concat(),
            good.as_bytes()[..good.find("-2.25").unwrap()].to_vec(),
            swapped("version = 1", "version = 2"),
            swapped("model.chpm", "other.chpm"),
            swapped("1280", "0"),
            swapped("poe = 1.0", "poe = nan"),
        ] {
            fs::write(&file, &bad).unwrap();
            let note = memory.recall(model).unwrap_err();
            assert!(note.contains(file.to_str().unwrap()), "{note}");
        }

        fs::write(&file, &good).unwrap();
        assert_eq!(memory.recall(model), Ok(Some(remembered(model))));
        assert_eq!(Memory { folder: None }.recall(model), Ok(None));
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_told() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        let memory = Memory::at(folder.path().join("file/state"));
        let model = Path::new("model.chpm");
        assert!(memory.keep(model, &remembered(model)).unwrap_err().contains("cannot remember"));
    }

    proptest! {
        /// Whatever is in the file, nothing panics.
        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..300), at in 0usize..400) {
            let folder = tempfile::tempdir().unwrap();
            let memory = Memory::at(folder.path().to_owned());
            let model = Path::new("/no/where/model.chpm");
            let file = memory.file(model).unwrap();
            fs::write(&file, &bytes).unwrap();
            let _ = memory.recall(model);
            let mut text = toml::to_string(&remembered(model)).unwrap().into_bytes();
            for (place, byte) in text.iter_mut().skip(at).zip(&bytes).take(4) {
                *place = *byte;
            }
            fs::write(&file, &text).unwrap();
            let _ = memory.recall(model);
        }
    }
}
