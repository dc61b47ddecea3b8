//! Lists of range scans as the Stanford 3D Scanning Repository has them (`.conf`): which scans make up a model, and how each
//! of them is moved into the model's frame.

use super::error::{ImportError, SourceError};
use super::format::{Format, Likeness, first_line, is_text};
use super::lines::{Lines, number, words};
use crate::file_set::{self, FileSet};
use crate::location::excerpt;
use crate::options::Options;
use crate::reader::{MeshReader, Opening, Start};
use crate::stream::Stream;
use crate::texture::Images;
use chpm_extmem::Cancel;
use chpm_mesh::FAR;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Lists of range scans.
pub(crate) const FORMAT: Format = Format {
    name: "Stanford .conf set of scans",
    extensions: &["conf"],
    is_list: true,
    sniff,
    open,
    names: Some(files),
};

/// Goes by the first line that is no comment.
fn sniff(start: &Start<'_>) -> Likeness {
    let line = first_line(start.head);
    let is_list = matches!(words(line).next(), Some(b"bmesh" | b"camera")) && words(line).count() >= 8;
    if is_list && is_text(start.head) { Likeness::Likely } else { Likeness::None }
}

fn open(opening: Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError> {
    let Opening { stream, options, store, cancel, supply, .. } = opening;
    if supply.is_spooled() {
        let (path, what) = (supply.path.clone(), "a list of range scans");
        return Err(SourceError::NamesFiles { path, what }.into());
    }
    let list = RangeScans::read(stream)?;
    let member = |scan: Scan| (supply.path.with_file_name(&scan.file), Some(scan.pose));
    let members = list.scans.into_iter().map(member).collect();
    // Whoever scans ranges has no images of them.
    let options = Options { images: Images::Ignored, ..options };
    Ok(Box::new(FileSet::open(&supply.path, members, "range scans", options, store, cancel)?))
}

/// The scans of the list at `path`.
fn files(stream: Stream, path: &Path, _: Images, cancel: &Cancel) -> Result<Vec<PathBuf>, ImportError> {
    let list = RangeScans::read(stream)?;
    file_set::files(list.scans.iter().map(|scan| path.with_file_name(&scan.file)), Images::Ignored, cancel)
}

/// The scans of one model.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct RangeScans {
    /// In the order of the list.
    pub scans: Vec<Scan>,
}

/// One `bmesh` line.
#[derive(Clone, PartialEq, Debug)]
pub struct Scan {
    /// The scan's file, relative to the list's folder.
    pub file: String,
    /// From the scan's frame to the model's.
    pub pose: Pose,
}

/// A rigid motion: a point is rotated, then translated.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Pose {
    /// The rotation's rows.
    pub rotation: [[f64; 3]; 3],
    /// In the scans' units.
    pub translation: [f64; 3],
}

impl Pose {
    /// Stands still.
    pub const IDENTITY: Pose =
        Pose { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation: [0.0; 3] };

    /// From the seven numbers of a line: a translation and a quaternion `x y z w` of any length but zero.
    ///
    /// The files mean the inverse of what `v -> q v q*` does: their tools multiply row vectors with the usual matrix. With
    /// the bunny's list, points of its second scan come within a millimetre of the published reconstruction so, and are
    /// centimetres away otherwise.
    pub fn stanford(numbers: [f64; 7]) -> Option<Pose> {
        let [tx, ty, tz, x, y, z, w] = numbers;
        let length = [x, y, z, w].iter().map(|n| n * n).sum::<f64>().sqrt();
        if !numbers.iter().all(|n| n.abs() <= FAR) || !length.is_normal() {
            return None;
        }
        let [x, y, z, w] = [x, y, z, w].map(|n| n / length);
        let rotation = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        Some(Pose { rotation, translation: [tx, ty, tz] })
    }

    /// Moves a point. The identity keeps every bit.
    pub fn point(&self, p: [f64; 3]) -> [f64; 3] {
        let turned = self.direction(p);
        std::array::from_fn(|axis| {
            if self.translation[axis] == 0.0 { turned[axis] } else { turned[axis] + self.translation[axis] }
        })
    }

    /// Rotates a direction.
    pub fn direction(&self, p: [f64; 3]) -> [f64; 3] {
        if self.rotation == Pose::IDENTITY.rotation {
            return p;
        }
        self.rotation.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2])
    }
}

impl RangeScans {
    /// Reads a list: `bmesh FILE tx ty tz qx qy qz qw` lines, `camera` lines, which say where to look from and are skipped, and
    /// comments that begin with `#`.
    ///
    /// # Errors
    /// [`ImportError::Text`] for any other line, [`ImportError::NoScans`] if none is a scan.
    pub fn read(reader: impl Read) -> Result<RangeScans, ImportError> {
        let mut lines = Lines::new(reader);
        let mut scans = Vec::new();
        while lines.advance()? {
            let line: Vec<&[u8]> = words(lines.current()).collect();
            let wrong = |expected, got| ImportError::Text {
                place: lines.place("scan", scans.len() as u64),
                expected,
                got,
            };

            match line[..] {
                [] | [b"camera", ..] => {}
                [word, ..] if word.starts_with(b"#") => {}
                [b"bmesh" | b"mesh", ref name @ .., tx, ty, tz, qx, qy, qz, qw] if !name.is_empty() => {
                    let mut numbers = [0.0; 7];
                    for (value, word) in numbers.iter_mut().zip([tx, ty, tz, qx, qy, qz, qw]) {
                        *value = number(Some(word))
                            .map_err(|got| wrong("translation and quaternion, seven numbers", got))?;
                    }
                    let file = String::from_utf8(name.join(&b' '))
                        .map_err(|_| wrong("a file name in UTF-8", excerpt(&name.join(&b' '))))?;
                    let pose = Pose::stanford(numbers).ok_or_else(|| {
                        wrong("a quaternion that is not zero and finite numbers", excerpt(lines.current()))
                    })?;
                    scans.push(Scan { file, pose });
                }
                [b"bmesh" | b"mesh", ..] => {
                    return Err(wrong("bmesh FILE tx ty tz qx qy qz qw", excerpt(lines.current())));
                }
                [word, ..] => return Err(wrong("'bmesh' or 'camera'", excerpt(word))),
            }
        }

        if scans.is_empty() { Err(ImportError::NoScans) } else { Ok(RangeScans { scans }) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Scan>, ImportError> {
        RangeScans::read(text.as_bytes()).map(|list| list.scans)
    }

    #[test]
    fn scans_come_in_order_with_their_poses() {
        let scans = read(
            "camera -0.0172 -0.0936 -0.734 -0.04 0.97 -0.23 0.01\n# two\n\nbmesh a.ply 0 0 0 0 0 0 1\r\n\
             bmesh my scan.ply 1 2 3 0 0 2 2\n",
        )
        .unwrap();
        assert_eq!(scans.len(), 2);
        assert_eq!(scans[0], Scan { file: "a.ply".to_owned(), pose: Pose::IDENTITY });
        assert_eq!(scans[1].file, "my scan.ply");
        // A quarter turn about z: here it takes x to minus y.
        let moved = scans[1].pose.point([1.0, 0.0, 0.0]);
        for (x, expected) in moved.into_iter().zip([1.0, 1.0, 3.0]) {
            assert!((x - expected).abs() < 1e-15, "{moved:?}");
        }
    }

    #[test]
    fn rotations_keep_lengths_and_the_identity_keeps_bits() {
        let pose = Pose::stanford([
            -0.0520211,
            -0.000383981,
            -0.0109223,
            0.00548449,
            -0.294635,
            -0.0038555,
            0.955586,
        ])
        .unwrap();
        let turned = pose.direction([0.3, -1.2, 0.7]);
        let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
        assert!((square(turned) - square([0.3, -1.2, 0.7])).abs() < 1e-12);
        let still = Pose::IDENTITY.point([-0.0, 1e-300, -3.5]);
        assert_eq!(still.map(f64::to_bits), [-0.0f64, 1e-300, -3.5].map(f64::to_bits));
    }

    #[test]
    fn a_scan_of_the_bunny_meets_its_reconstruction() {
        // A point of the scan bun045, and a vertex of the published bun_zipper. The other way round it would be 31 mm away.
        let numbers = [-0.0520211, -0.000383981, -0.0109223, 0.00548449, -0.294635, -0.0038555, 0.955586];
        let moved = Pose::stanford(numbers).unwrap().point([0.0375, 0.107919, 0.0855621]);
        let vertex = [0.0259904, 0.108758, 0.0377477];
        let distance = moved.iter().zip(vertex).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(distance < 4e-5, "{distance}");
    }

    #[test]
    fn other_lines_are_refused_with_their_place() {
        for (text, words) in [
            ("bmesh a.ply 0 0 0 0 0 1\n", "bmesh FILE"),
            ("# x\nbmesh a.ply 0 0 0 0 0 x 1\n", "line 2"),
            ("bmesh a.ply 0 0 0 0 0 0 0\n", "quaternion"),
            ("bmesh a.ply nan 0 0 0 0 0 1\n", "finite"),
            ("bmehs a.ply 0 0 0 0 0 0 1\n", "bmehs"),
            ("camera 0 0 0 0 0 0 1\n", "no 'bmesh'"),
            ("", "no 'bmesh'"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
