//! Poses as they are typed, and files of them.

use anyhow::{Context, Result, anyhow, ensure};
use chpm_extmem::read_text;
use chpm_mesh::Bytes;
use chpm_proximity::Pose;
use std::path::Path;

/// A pose from the command line.
pub(crate) fn typed(text: &str) -> Result<Pose, String> {
    let numbers: Option<Vec<f64>> = text
        .split(|c: char| c == ',' || c.is_whitespace())
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().ok())
        .collect();
    let pose = match *numbers.unwrap_or_default().as_slice() {
        [x, y, z] => Pose::of_quaternion([0.0, 0.0, 0.0, 1.0], [x, y, z]),
        [x, y, z, a, b, c, d] => Pose::of_quaternion([a, b, c, d], [x, y, z]),
        [a, b, c, x, d, e, f, y, g, h, i, z, ref last @ ..]
            if last.is_empty() || last == [0.0, 0.0, 0.0, 1.0] =>
        {
            Pose::of_matrix([[a, b, c], [d, e, f], [g, h, i]], [x, y, z])
        }
        _ => {
            return Err(format!(
                "'{text}' is no pose: write X,Y,Z; X,Y,Z,QX,QY,QZ,QW; or the 12 or 16 numbers of a matrix, row by row"
            ));
        }
    };
    pose.map_err(|error| error.to_string())
}

/// Most bytes of a file of poses.
const MOST: Bytes = Bytes::mib(64);

/// A file of poses, one a line; what begins with # is no pose.
pub(crate) fn read_path(path: &Path) -> Result<Vec<Pose>> {
    let name = path.display();
    let text = read_text(path, MOST.0)
        .with_context(|| format!("cannot read '{name}'; a file of poses is text, one pose a line"))?;
    let lines = text.lines().enumerate().map(|(at, line)| (at + 1, line.trim()));
    let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let poses: Result<Vec<Pose>> = lines
        .map(|(at, line)| typed(line).map_err(|error| anyhow!("'{name}', line {at}: {error}")))
        .collect();
    let poses = poses?;
    ensure!(!poses.is_empty(), "'{name}' has no pose; write one a line");
    Ok(poses)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_typed_in_four_ways() {
        let moved = typed("1,-2,3").unwrap();
        assert_eq!(moved.apply([1.0, 0.0, 0.0]), [2.0, -2.0, 3.0]);
        for text in ["1,-2,3,0,0,0,1", "1 0 0 1  0 1 0 -2  0 0 1 3", "1,0,0,1, 0,1,0,-2, 0,0,1,3, 0,0,0,1"] {
            assert_eq!(typed(text), Ok(moved), "{text}");
        }
        for (text, told) in [
            ("1,2", "12 or 16"),
            ("", "12 or 16"),
            ("1,2,x", "12 or 16"),
            ("1,0,0,1, 0,1,0,-2, 0,0,1,3, 0,0,1,1", "12 or 16"),
            ("2,0,0,1, 0,2,0,-2, 0,0,2,3", "changes lengths"),
            ("1,2,3,0,0,0,0", "length zero"),
            ("nan,0,0", "1e100"),
        ] {
            assert!(typed(text).unwrap_err().contains(told), "{text}: {:?}", typed(text));
        }
    }
}
