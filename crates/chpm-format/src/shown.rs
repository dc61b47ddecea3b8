//! Settings that tell how and where a model is shown; whoever reads a file may leave them alone.

use crate::metadata::Metadata;

/// The model's name, in words.
pub const TITLE: &str = "title";
/// The direction that is up: x, y, z, -x, -y or -z.
pub const UP: &str = "up";
/// The side that is seen first: front, back, left, right, top, bottom or iso.
pub const VIEW: &str = "view";
/// Whose it is, in words.
pub const CREDIT: &str = "credit";
/// The colour behind it: six hexadecimal digits.
pub const BACKGROUND: &str = "background";

/// The system that its coordinates are of, as in EPSG:32633.
pub const CRS: &str = "crs";

/// All of their names.
const NAMES: [&str; 6] = [TITLE, UP, VIEW, CREDIT, BACKGROUND, CRS];

impl Metadata {
    /// The value of a setting.
    pub fn setting(&self, name: &str) -> Option<&str> {
        self.settings.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// Takes settings that tell how the model is shown, in place of those of the same names.
    pub fn show(&mut self, told: Vec<(String, String)>) {
        for (name, value) in told {
            debug_assert!(NAMES.contains(&name.as_str()));
            self.settings.retain(|(known, _)| *known != name);
            self.settings.push((name, value));
        }
    }
}
