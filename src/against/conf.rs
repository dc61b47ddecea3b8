//! Lists of range scans (`.conf`): which files make up a model, and how each is moved into its frame.

use super::stream::{Stream, words};
use anyhow::{Result, bail, ensure};

/// A scan's file, relative to the list, and its motion.
pub(super) struct Scan {
    pub(super) file: String,
    pub(super) motion: Motion,
}

/// A rotation and a translation after it.
pub(super) struct Motion {
    rows: [[f64; 3]; 3],
    translation: [f64; 3],
}

impl Motion {
    /// Of a translation and a quaternion `x y z w`, which means the inverse of the rotation that it usually stands for: its tools
    /// multiply a row by the usual matrix. Operations are in the order that rounds as the builder does.
    fn new([tx, ty, tz, x, y, z, w]: [f64; 7]) -> Option<Motion> {
        let length = (x * x + y * y + z * z + w * w).sqrt();
        if !length.is_normal() || ![tx, ty, tz].iter().all(|t| t.is_finite()) {
            return None;
        }
        let (x, y, z, w) = (x / length, y / length, z / length, w / length);
        let rows = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        Some(Motion { rows, translation: [tx, ty, tz] })
    }

    /// Where a point goes. What does not turn, or does not move along an axis, keeps its bits.
    pub(super) fn of(&self, point: [f64; 3]) -> [f64; 3] {
        let stays = self.rows == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let [x, y, z] = point;
        let turned = if stays { point } else { self.rows.map(|[a, b, c]| a * x + b * y + c * z) };
        std::array::from_fn(|axis| match self.translation[axis] {
            0.0 => turned[axis],
            t => turned[axis] + t,
        })
    }
}

/// Reads a list: `bmesh FILE tx ty tz qx qy qz qw`, `camera` lines and comments.
pub(super) fn read(mut stream: Stream) -> Result<Vec<Scan>> {
    let (mut line, mut scans) = (Vec::new(), Vec::new());
    while stream.line(&mut line)? {
        let all: Vec<&str> = words(&line).collect();
        let wrong = || stream.wrong(format!("not understood: '{}'", line.escape_ascii()));
        match all[..] {
            [] | ["camera", ..] => {}
            [word, ..] if word.starts_with('#') => {}
            ["bmesh" | "mesh", ref name @ .., tx, ty, tz, qx, qy, qz, qw] if !name.is_empty() => {
                let mut numbers = [0.0; 7];
                for (number, word) in numbers.iter_mut().zip([tx, ty, tz, qx, qy, qz, qw]) {
                    *number = word.parse().map_err(|_| wrong())?;
                }
                let motion = Motion::new(numbers).ok_or_else(wrong)?;
                scans.push(Scan { file: name.join(" "), motion });
            }
            _ => bail!(wrong()),
        }
    }
    ensure!(!scans.is_empty(), stream.wrong("the list names no scan"));
    Ok(scans)
}
