//! Positions as they are stored: single precision about a local origin. What decides about it are the vertices that faces use;
//! a stray one somewhere else costs the others no digits.

use super::used::Used;
use crate::context::Context;
use crate::error::BuildError;
use crate::vertex_columns::POSITIONS;
use chpm_extmem::{BufferWriter, Column};
use chpm_import::ply::Coordinates;
use chpm_mesh::Aabb;
use std::fmt::Write;

/// Vertices that are looked at in one step.
const STEP: usize = 1 << 14;
/// Rounding beyond this share of the diagonal can be seen, and is told.
const VISIBLE: f64 = 1e-6;

/// Positions in single precision, with their origin and rounding.
pub(super) struct Local {
    /// Unused vertices are moved into the bounds.
    pub(super) positions: Column<[f32; 3]>,
    /// Of the used vertices.
    pub(super) bounds: Aabb,
    pub(super) origin: [f64; 3],
    /// By how much a coordinate of a used vertex was changed at most.
    pub(super) rounding: f64,
    /// Step that all coordinates are multiples of, if they lie on a lattice.
    pub(super) lattice_step: Option<f64>,
    pub(super) warning: Option<String>,
}

/// Singles stay as they are. `bounds` are those of all vertices.
pub(super) fn singles(
    positions: Column<[f32; 3]>,
    bounds: Aabb,
    used: &Used,
    context: &Context<'_>,
) -> Result<Local, BuildError> {
    let mut all = (positions, bounds);
    if used.count() < all.0.len() as u64 {
        let mut bounds = Aabb::EMPTY;
        each(&all.0, context, |first, points| {
            let used = (first..).zip(points).filter(|(vertex, _)| used.contains(*vertex));
            used.for_each(|(_, point)| bounds.add(*point));
            Ok(())
        })?;
        if bounds != all.1 {
            let mut inside = BufferWriter::new(&context.store, POSITIONS, all.0.len())?;
            each(&all.0, context, |_, points| {
                Ok(inside
                    .extend_from_slice(&points.iter().map(|p| within(*p, &bounds)).collect::<Vec<_>>())?)
            })?;
            all = (inside.finish_column()?, bounds);
        }
    }
    let (positions, bounds) = all;
    Ok(Local { positions, bounds, origin: [0.0; 3], rounding: 0.0, lattice_step: None, warning: None })
}

/// Doubles are rounded about an origin, unless singles hold them as they are.
pub(super) fn doubles(
    positions: Column<[f64; 3]>,
    coordinates: Coordinates,
    used: &Used,
    context: &Context<'_>,
) -> Result<Local, BuildError> {
    let mut extent = Extent::default();
    each(&positions, context, |first, points| {
        let used = (first..).zip(points).filter(|(vertex, _)| used.contains(*vertex));
        used.for_each(|(_, point)| extent.add(*point, coordinates));
        Ok(())
    })?;

    let origin = extent.origin(coordinates);
    let (mut rounding, mut bounds) = (0.0f64, Aabb::EMPTY);
    fn local(point: &[f64; 3], origin: &[f64; 3]) -> [f64; 3] {
        std::array::from_fn::<f64, 3, _>(|axis| point[axis] - origin[axis])
    }

    // Where unused vertices are to be moved must be known before the first of them is stored.
    if used.count() < positions.len() as u64 {
        each(&positions, context, |first, points| {
            let used = (first..).zip(points).filter(|(vertex, _)| used.contains(*vertex));
            used.for_each(|(_, point)| bounds.add(local(point, &origin).map(|x| x as f32)));
            Ok(())
        })?;
    }

    let room = bounds;
    let mut stored = BufferWriter::new(&context.store, POSITIONS, positions.len())?;
    let mut singles = Vec::new();
    each(&positions, context, |first, points| {
        singles.clear();
        for (vertex, point) in (first..).zip(points) {
            let exact = local(point, &origin);
            let single = exact.map(|x| x as f32);
            if used.contains(vertex) {
                bounds.add(single);
                for axis in 0..3 {
                    let lost = (f64::from(single[axis]) - exact[axis]).abs();
                    rounding =
                        rounding.max(lost + lost_by_difference(point[axis], origin[axis], exact[axis]));
                }
                singles.push(single);
            } else {
                singles.push(within(single, &room));
            }
        }
        Ok(stored.extend_from_slice(&singles)?)
    })?;

    // Its digits are those of singles: what they round to is what was meant.
    if coordinates == Coordinates::TextOfSingles && origin == [0.0; 3] && extent.are_singles {
        rounding = 0.0;
    }
    let warning = (rounding > 0.0).then(|| rounding_warning(rounding, origin, extent.diagonal()));
    Ok(Local { positions: stored.finish_column()?, bounds, origin, rounding, lattice_step: None, warning })
}

/// By how much a difference in doubles is off: by nothing, unless the two are of very different size. Exact, after Knuth.
fn lost_by_difference(from: f64, less: f64, difference: f64) -> f64 {
    let part = difference - from;
    ((from - (difference - part)) - (less + part)).abs()
}

/// Message about the rounding, and its reason if it can be seen.
fn rounding_warning(rounding: f64, origin: [f64; 3], diagonal: f64) -> String {
    let mut text = format!(
        "double coordinates were rounded to 24 bits about the origin {origin:?}: by at most {rounding:.3e}"
    );
    if rounding > VISIBLE * diagonal {
        let share = rounding / diagonal;
        // Writing to a string does not fail.
        let _ = write!(
            text,
            ", {share:.1e} of the diagonal, since the model is only {diagonal:.1e} large and single precision ends at 1.4e-45; scale it up"
        );
    }
    text
}

/// Bounds and precision of double coordinates.
#[derive(Default)]
struct Extent {
    range: Option<[(f64, f64); 3]>,
    /// Whether a single does not hold one of them.
    rounds: bool,
    /// Whether all of them are what a single is printed as.
    are_singles: bool,
    /// Precision that they would lose about zero.
    lost: f64,
    digits: String,
}

impl Extent {
    fn add(&mut self, point: [f64; 3], coordinates: Coordinates) {
        let is_text = matches!(coordinates, Coordinates::Text | Coordinates::TextOfSingles);
        if self.range.is_none() {
            self.are_singles = is_text;
        }
        let range = self.range.get_or_insert(point.map(|x| (x, x)));
        for (range, x) in range.iter_mut().zip(point) {
            *range = (range.0.min(x), range.1.max(x));
            let lost = (f64::from(x as f32) - x).abs();
            self.rounds |= lost > 0.0;
            self.lost = self.lost.max(lost);
            if self.are_singles && lost > 0.0 {
                self.are_singles = lost <= half_a_digit(x, &mut self.digits);
            }
        }
    }

    fn diagonal(&self) -> f64 {
        self.range
            .map_or(0.0, |range| range.iter().map(|(low, high)| (high - low).powi(2)).sum::<f64>().sqrt())
    }

    /// The middle, or zero where nothing would be gained: a single if there is one in the range, so that a reader may use it
    /// as one.
    fn origin(&self, coordinates: Coordinates) -> [f64; 3] {
        let suffice = match coordinates {
            Coordinates::TextOfSingles => self.are_singles,
            _ => self.are_singles && self.lost <= VISIBLE * self.diagonal(),
        };
        match self.range {
            Some(range) if self.rounds && !suffice => range.map(middle),
            _ => [0.0; 3],
        }
    }
}

fn middle((low, high): (f64, f64)) -> f64 {
    let middle = 0.5 * low + 0.5 * high;
    let single = f64::from(middle as f32);
    if (low..=high).contains(&single) { single } else { middle }
}

/// Half of the last decimal digit that it takes to tell `x` from other doubles. A single that is printed with as many digits
/// is no farther from it.
fn half_a_digit(x: f64, digits: &mut String) -> f64 {
    digits.clear();
    // Writing to a string does not fail.
    let _ = write!(digits, "{x:e}");
    let (mantissa, exponent) = digits.split_once('e').unwrap_or((digits, "0"));
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len() as i32);
    // The double itself is rounded, too.
    0.5 * 10f64.powi(exponent.parse().unwrap_or(0) - decimals) * (1.0 + 1e-9) + x.abs() * f64::EPSILON
}

/// The nearest place in the box.
pub(super) fn within(point: [f32; 3], bounds: &Aabb) -> [f32; 3] {
    std::array::from_fn(|axis| point[axis].max(bounds.min[axis]).min(bounds.max[axis]))
}

/// Shows all points, some at a time, with the number of the first.
pub(super) fn each<T: bytemuck::Pod>(
    points: &Column<T>,
    context: &Context<'_>,
    mut look: impl FnMut(usize, &[T]) -> Result<(), BuildError>,
) -> Result<(), BuildError> {
    let mut scratch = Vec::new();
    for start in (0..points.len()).step_by(STEP) {
        context.check()?;
        look(start, points.read(start..points.len().min(start + STEP), &mut scratch)?)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_singles_are_printed_as_is_told_from_what_says_more() {
        let mut digits = String::new();
        let mut like = |text: &str| {
            let x: f64 = text.parse().unwrap();
            (f64::from(x as f32) - x).abs() <= half_a_digit(x, &mut digits)
        };
        for text in [
            "0",
            "0.1",
            "-0.0378297",
            "512345.7",
            "512345.688",
            "1e-40",
            "3.4028235e38",
            "0.333333",
            "0.33333334",
        ] {
            assert!(like(text), "{text}");
        }
        for text in
            ["512345.678", "16777217", "0.3333333333", "5234567.8912", "0.1234567890123", "1.00000001"]
        {
            assert!(!like(text), "{text}");
        }
        // Printed with any number of digits, a single is one.
        for single in [0.1f32, 1.0 / 3.0, 512_345.67, -7.3e-12, 1.17e-38, 8_388_609.0] {
            for digits in 0..20 {
                assert!(like(&format!("{single:.digits$e}")), "{single:.digits$e}");
            }
        }
    }
}
