//! Positions on one lattice: whole multiples of one power of two, the same for the whole model, so that vertices that several clusters
//! share have equal bits and nothing cracks. All that follows sees only these positions, and starts its errors from how far they moved.

use super::local::{Local, each, within};
use super::used::Used;
use crate::config::Positions;
use crate::context::Context;
use crate::error::BuildError;
use crate::vertex_columns::POSITIONS;
use bytemuck::Pod;
use chpm_extmem::{BufferWriter, Column};
use chpm_mesh::Aabb;

/// Whole numbers up to two to this power are singles.
const SINGLE_BITS: i32 = 24;
/// The least single above 0 is two to this power.
const LEAST: i32 = -149;

/// A coordinate as it is read.
pub(super) trait Coordinate: Pod + Into<f64> {}

impl Coordinate for f32 {}
impl Coordinate for f64 {}

/// Puts all positions on a lattice of so many bits.
pub(super) fn round<T: Coordinate>(
    positions: &Column<[T; 3]>,
    bits: u8,
    used: &Used,
    context: &Context<'_>,
) -> Result<Local, BuildError>
where
    [T; 3]: Pod,
{
    let ranges = ranges(positions, used, context)?;
    let lattice = Lattice::of(ranges, bits);
    // Rounding keeps the order of numbers, so that the ends of the ranges go to the ends of the box.
    fn at(end: fn(&(f64, f64)) -> f64, lattice: &Lattice, ranges: &[(f64, f64); 3]) -> [f32; 3] {
        std::array::from_fn(|axis| lattice.point(axis, end(&ranges[axis])).0)
    }
    let bounds =
        Aabb { min: at(|range| range.0, &lattice, &ranges), max: at(|range| range.1, &lattice, &ranges) };

    let mut stored = BufferWriter::new(&context.store, POSITIONS, positions.len())?;
    let (mut singles, mut rounding) = (Vec::new(), 0.0f64);
    each(positions, context, |first, points| {
        singles.clear();
        for (vertex, point) in (first..).zip(points) {
            let moved: [(f32, f64); 3] = std::array::from_fn(|axis| lattice.point(axis, point[axis].into()));
            let single = moved.map(|(single, _)| single);
            if used.contains(vertex) {
                rounding = moved.iter().fold(rounding, |most, (_, way)| most.max(*way));
                singles.push(single);
            } else {
                singles.push(within(single, &bounds));
            }
        }
        Ok(stored.extend_from_slice(&singles)?)
    })?;
    Ok(Local {
        positions: stored.finish_column()?,
        bounds,
        origin: lattice.origin,
        rounding,
        lattice_step: Some(lattice.step),
        warning: None,
    })
}

/// From where to where the used vertices are along each axis.
pub(super) fn ranges<T: Coordinate>(
    positions: &Column<[T; 3]>,
    used: &Used,
    context: &Context<'_>,
) -> Result<[(f64, f64); 3], BuildError>
where
    [T; 3]: Pod,
{
    let mut ranges = [(f64::INFINITY, f64::NEG_INFINITY); 3];
    each(positions, context, |first, points| {
        for (_, point) in (first..).zip(points).filter(|(vertex, _)| used.contains(*vertex)) {
            for (range, x) in ranges.iter_mut().zip(*point) {
                *range = (range.0.min(x.into()), range.1.max(x.into()));
            }
        }
        Ok(())
    })?;
    Ok(ranges)
}

/// Bits of the coarsest lattice over a box whose step is at most `step`, or none if singles are as coarse as that.
pub(super) fn bits_for(ranges: [(f64, f64); 3], step: f64) -> Option<u8> {
    let longest = ranges.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
    if !(longest > 0.0 && step >= f64::MIN_POSITIVE) {
        return None;
    }
    let largest = ceil_log2(step.next_up()) - 1;
    let bits = (ceil_log2(longest) - largest).max(i32::from(*Positions::BITS.start()));
    u8::try_from(bits).ok().filter(|bits| Positions::BITS.contains(bits))
}

/// Where its points are.
#[derive(Debug)]
struct Lattice {
    step: f64,
    origin: [f64; 3],
}

impl Lattice {
    /// The longest range has more than half of two to `bits` steps, and no more than all of these.
    fn of(ranges: [(f64, f64); 3], bits: u8) -> Self {
        let longest = ranges.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
        let farthest = ranges.iter().map(|(low, high)| low.abs().max(high.abs())).fold(0.0, f64::max);
        // One point has no length to go by; a single of its size says as much of where it is.
        let exponent = match longest > 0.0 {
            true => ceil_log2(longest) - i32::from(bits),
            false => ceil_log2(farthest.max(f64::MIN_POSITIVE)) - SINGLE_BITS,
        };
        let step = power_of_two(exponent.max(LEAST));
        let near = farthest / step <= power_of_two(SINGLE_BITS);
        // The middle, on the lattice about zero where doubles hold that, so that what lies on it stays where it is.
        let middle = |(low, high): (f64, f64)| {
            let middle = 0.5 * low + 0.5 * high;
            if (middle / step).abs() < power_of_two(52) { (middle / step).round() * step } else { middle }
        };
        Lattice { step, origin: if near { [0.0; 3] } else { ranges.map(middle) } }
    }

    /// The nearest point to a coordinate, relative to the origin, and how far that is at most.
    fn point(&self, axis: usize, x: f64) -> (f32, f64) {
        let origin = self.origin[axis];
        let local = x - origin;
        // What the difference lost: exact for any two numbers.
        let back = local + origin;
        let lost = (x - back) + ((back - local) - origin);
        let point = (local / self.step).round_ties_even() * self.step;
        // There is one zero on a lattice.
        let single = point as f32 + 0.0;
        let way = (f64::from(single) - local).abs();
        (single, if lost == 0.0 { way } else { (way + lost.abs()).next_up() })
    }
}

/// Two to a power that a double has.
fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

/// The least power of two that is not below a number above 0, up to the least normal double.
fn ceil_log2(x: f64) -> i32 {
    let floor = ((x.max(f64::MIN_POSITIVE).to_bits() >> 52) as i32) - 1023;
    if power_of_two(floor) < x { floor + 1 } else { floor }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sizes() -> impl Strategy<Value = f64> {
        (-140.0..119.0f64, any::<bool>())
            .prop_map(|(log, negative)| if negative { -log.exp2() } else { log.exp2() })
    }

    proptest! {
        #[test]
        fn points_are_singles_near_by_and_stay_where_they_are(
            center in proptest::array::uniform3(prop_oneof![Just(0.0), sizes()]),
            size in -160.0..0.0f64,
            places in proptest::collection::vec(proptest::array::uniform3(-1.0..1.0f64), 1..20),
            flat in 0..8u8,
            bits in Positions::BITS,
        ) {
            let size = center.iter().fold(1.0, |size: f64, x| size.max(x.abs())) * size.exp2();
            let scale = |axis: usize| if flat >> axis & 1 == 1 { 0.0 } else { size };
            let points: Vec<[f64; 3]> = places
                .iter()
                .map(|place| std::array::from_fn(|axis| center[axis] + scale(axis) * place[axis]))
                .collect();
            let ranges: [(f64, f64); 3] = std::array::from_fn(|axis| {
                let all = points.iter().map(|point| point[axis]);
                (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max))
            });
            let lattice = Lattice::of(ranges, bits);
            let longest = ranges.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
            if longest > 0.0 && lattice.step > power_of_two(LEAST) {
                prop_assert!(longest / lattice.step <= power_of_two(bits.into()));
                prop_assert!(longest / lattice.step > power_of_two(i32::from(bits) - 1));
            }
            for point in points {
                for (axis, x) in point.into_iter().enumerate() {
                    let (single, way) = lattice.point(axis, x);
                    let count = f64::from(single) / lattice.step;
                    prop_assert!(count == count.round() && count.abs() <= power_of_two(24), "{count}");
                    prop_assert!(single.to_bits() != (-0.0f32).to_bits());
                    prop_assert!(way <= lattice.step * 0.51, "{way} of {}", lattice.step);
                    let there = lattice.origin[axis] + f64::from(single);
                    if there - lattice.origin[axis] == f64::from(single) {
                        prop_assert!(lattice.point(axis, there).0 == single, "on the lattice it stays");
                    }
                }
            }
        }
    }

    #[test]
    fn what_lies_on_the_lattice_keeps_its_bits_and_costs_nothing() {
        for far in [0.0, 1e6, -3e9] {
            let ranges = [(far, far + 100.0), (0.0, 7.0), (1.0, 1.0)];
            let lattice = Lattice::of(ranges, 16);
            assert_eq!(lattice.step, 128.0 / 65536.0);
            for x in [0.0, 1.0, 99.5, 100.0] {
                let (single, way) = lattice.point(0, far + x);
                assert_eq!((lattice.origin[0] + f64::from(single), way), (far + x, 0.0));
            }
        }
        // Near zero there is no origin, and far away the middle is one.
        assert_eq!(Lattice::of([(0.0, 100.0); 3], 16).origin, [0.0; 3]);
        assert_eq!(Lattice::of([(1e6, 1e6 + 100.0); 3], 16).origin, [1_000_050.0; 3]);
        let point = Lattice::of([(3.0, 3.0); 3], 8);
        assert_eq!(point.point(0, 3.0), (3.0, 0.0));
    }
}
