//! Files of hits: a row for each ray, in the order of the rays.

use super::npy;
use anyhow::Result;
use chpm_rays::Hit;
use std::io::Write;

/// The answer to a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Answered {
    pub(crate) hit: Option<Hit>,
    /// The source is not met before; infinite where it is not met at all. Only of coarse meshes.
    pub(crate) least: Option<f64>,
}

/// Writes answers.
pub(crate) struct HitWriter {
    is_array: bool,
    has_least: bool,
    origin: [f64; 3],
    /// Whether only that something is met is told.
    any: bool,
}

/// Columns, but for `least`.
const COLUMNS: [&str; 10] = ["hit", "distance", "x", "y", "z", "nx", "ny", "nz", "cluster", "triangle"];

impl HitWriter {
    pub(crate) fn begin(
        is_array: bool,
        has_least: bool,
        any: bool,
        origin: [f64; 3],
        rows: u64,
        out: &mut impl Write,
    ) -> Result<Self> {
        if is_array {
            npy::write(rows, COLUMNS.len() + usize::from(has_least), out)?;
        } else {
            writeln!(out, "{}{}", COLUMNS.join(","), if has_least { ",least" } else { "" })?;
        }
        Ok(HitWriter { is_array, has_least, origin, any })
    }

    pub(crate) fn add(&self, answered: &Answered, out: &mut impl Write) -> Result<()> {
        let mut row = [f64::NAN; 10];
        row[0] = f64::from(u8::from(answered.hit.is_some()));
        if let Some(hit) = answered.hit.filter(|_| !self.any) {
            row[1] = hit.distance + 0.0;
            for axis in 0..3 {
                // Zeros without a sign.
                row[2 + axis] = hit.point[axis] + self.origin[axis] + 0.0;
                row[5 + axis] = hit.normal[axis] + 0.0;
            }
            row[8] = hit.cluster.0.into();
            row[9] = hit.triangle.into();
        }
        let least = answered.least.filter(|_| self.has_least);
        if self.is_array {
            for number in row.into_iter().chain(least) {
                out.write_all(&number.to_le_bytes())?;
            }
            return Ok(());
        }
        for (column, number) in row.iter().enumerate() {
            let comma = if column > 0 { "," } else { "" };
            if number.is_nan() { write!(out, "{comma}")? } else { write!(out, "{comma}{number}")? }
        }
        least.map_or(Ok(()), |least| write!(out, ",{least}"))?;
        Ok(writeln!(out)?)
    }
}
