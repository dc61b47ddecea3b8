//! Triangles on a grid of texels: which middles they cover, each of an edge that two share being one's.

/// Parts of a texel that corners are rounded to.
const PARTS: f64 = 256.0;
const ONE: i64 = 256;

/// Calls `row` with each row and the columns whose middles are in the triangle, from the first to one behind the last. Corners are in texels, and no farther from zero
/// than a sheet is wide.
pub(super) fn spans(corners: [[f64; 2]; 3], mut row: impl FnMut(i64, i64, i64)) {
    let [a, b, c] = corners.map(|corner| corner.map(|place| (place * PARTS + 0.5).floor() as i64));
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let [a, b, c] = match area.signum() {
        0 => return,
        1 => [a, b, c],
        _ => [a, c, b],
    };
    let (top, bottom) = (a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]));
    let edges = [Edge::new(a, b), Edge::new(b, c), Edge::new(c, a)];
    for y in (top + ONE / 2 - 1).div_euclid(ONE)..=(bottom - ONE / 2).div_euclid(ONE) {
        let (mut begin, mut end) = (i64::MIN, i64::MAX);
        for edge in &edges {
            let value = edge.start + edge.down * y;
            match edge.step {
                0 if value < 0 => end = i64::MIN,
                0 => {}
                // The least column with value + step * column >= 0.
                step @ 1.. => begin = begin.max(-value.div_euclid(step)),
                step => end = end.min(value.div_euclid(-step) + 1),
            }
        }
        if begin < end {
            row(y, begin, end);
        }
    }
}

/// A function of columns and rows that is not negative where the triangle is.
struct Edge {
    start: i64,
    step: i64,
    down: i64,
}

impl Edge {
    fn new(from: [i64; 2], to: [i64; 2]) -> Self {
        let [x, y] = [to[0] - from[0], to[1] - from[1]];
        // A middle on an edge is that triangle's for which it is a left edge, or an upper one.
        let is_own = y < 0 || (y == 0 && x > 0);
        let at_zero = x * (ONE / 2 - from[1]) - y * (ONE / 2 - from[0]);
        Edge { start: at_zero - i64::from(!is_own), step: -y * ONE, down: x * ONE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How often each texel of a square is covered.
    fn counts(triangles: &[[[f64; 2]; 3]], side: usize) -> Vec<u32> {
        let mut counts = vec![0; side * side];
        for corners in triangles {
            spans(*corners, |y, begin, end| {
                (begin..end).for_each(|x| counts[y as usize * side + x as usize] += 1);
            });
        }
        counts
    }

    #[test]
    fn triangles_that_share_edges_cover_once() {
        // A fan about points on and beside middles of texels, turned either way.
        for middle in [[8.0, 8.0], [7.5, 8.5], [3.25, 11.1], [8.5, 2.5]] {
            let around =
                [[0.0, 0.0], [5.5, 0.0], [16.0, 0.0], [16.0, 9.5], [16.0, 16.0], [2.5, 16.0], [0.0, 16.0]];
            for is_turned in [false, true] {
                let fan: Vec<_> = (0..around.len())
                    .map(|i| [around[i], around[(i + 1) % around.len()], middle])
                    .map(|[a, b, c]| if is_turned { [b, a, c] } else { [a, b, c] })
                    .collect();
                assert_eq!(counts(&fan, 16), vec![1; 256], "{middle:?} {is_turned}");
            }
        }
    }

    #[test]
    fn what_has_no_area_covers_nothing() {
        assert_eq!(counts(&[[[1.5, 1.5], [9.5, 9.5], [5.5, 5.5]], [[2.0; 2]; 3]], 16), vec![0; 256]);
    }
}
