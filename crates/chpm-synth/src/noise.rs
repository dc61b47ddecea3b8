//! Hashes, value noise and circles that give the same bits on every machine: only additions, multiplications,
//! divisions and square roots, which IEEE 754 fixes; the platform's `sin` is not among them.

/// Hashes a seed and lattice coordinates to 64 well mixed bits.
pub(super) fn hash(seed: u64, lattice: [i64; 3]) -> u64 {
    lattice.iter().fold(mix(seed), |state, &c| mix(state ^ c as u64))
}

fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    let x = (x ^ (x >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    x ^ (x >> 32)
}

/// A hash as a number in [0, 1).
pub(super) fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// Smooth noise in [-1, 1] with features of size 1: hashed values at the lattice points, blended between them.
pub(super) fn value2(seed: u64, point: [f64; 2]) -> f64 {
    let base = point.map(f64::floor);
    let [u, v] = [0, 1].map(|a| fade(point[a] - base[a]));
    let [x, y] = base.map(|b| b as i64);
    let at = |dx, dy| unit(hash(seed, [x + dx, y + dy, 0]));
    2.0 * lerp(lerp(at(0, 0), at(1, 0), u), lerp(at(0, 1), at(1, 1), u), v) - 1.0
}

/// [`value2`] in space.
pub(super) fn value3(seed: u64, point: [f64; 3]) -> f64 {
    let base = point.map(f64::floor);
    let [u, v, w] = [0, 1, 2].map(|a| fade(point[a] - base[a]));
    let [x, y, z] = base.map(|b| b as i64);
    let at = |dx, dy, dz| unit(hash(seed, [x + dx, y + dy, z + dz]));
    let plane = |dz| lerp(lerp(at(0, 0, dz), at(1, 0, dz), u), lerp(at(0, 1, dz), at(1, 1, dz), u), v);
    2.0 * lerp(plane(0), plane(1), w) - 1.0
}

/// A smooth periodic wave of period 1 in [-1, 1] with the zeros and extremes of a sine.
pub(super) fn wave(t: f64) -> f64 {
    let f = t - t.floor();
    if f < 0.5 { 16.0 * f * (0.5 - f) } else { -16.0 * (f - 0.5) * (1.0 - f) }
}

/// Cosine and sine of `t` whole turns.
pub(super) fn turn(t: f64) -> (f64, f64) {
    let quarter = (4.0 * t).round();
    let x = (4.0 * t - quarter) * std::f64::consts::FRAC_PI_2;
    let (cos, sin) = (series(1.0, 0, x), series(x, 1, x));
    match quarter.rem_euclid(4.0) as u8 {
        0 => (cos, sin),
        1 => (-sin, cos),
        2 => (-cos, -sin),
        _ => (sin, -cos),
    }
}

/// Taylor series on an eighth of a turn to either side; the next terms are below the last bit.
fn series(first: f64, start: u32, x: f64) -> f64 {
    (1..9)
        .fold((first, first), |(sum, term): (f64, f64), k: u32| {
            let next = -term * x * x / f64::from((2 * k + start) * (2 * k + start - 1));
            (sum + next, next)
        })
        .0
}

fn fade(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + t * (b - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_cosines_and_sines() {
        for i in -50..50 {
            let t = f64::from(i) / 17.0;
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * t);
            let (c, s) = turn(t);
            assert!((c - cos).abs() < 1e-14 && (s - sin).abs() < 1e-14, "{t}");
        }
        assert_eq!([turn(0.25), turn(0.5), turn(1.0)], [(-0.0, 1.0), (-1.0, -0.0), (1.0, 0.0)]);
    }

    #[test]
    fn noise_meets_its_lattice_and_stays_in_range() {
        assert_eq!(value2(7, [3.0, -2.0]), 2.0 * unit(hash(7, [3, -2, 0])) - 1.0);
        assert_eq!(value3(7, [3.0, -2.0, 5.0]), 2.0 * unit(hash(7, [3, -2, 5])) - 1.0);
        for i in 0..1000 {
            let x = 0.37 * f64::from(i);
            assert!(value3(1, [x, -x, 0.5 * x]).abs() <= 1.0 && wave(x).abs() <= 1.0);
        }
        assert_eq!([wave(0.0), wave(0.25), wave(0.5), wave(0.75)], [0.0, 1.0, 0.0, -1.0]);
    }
}
