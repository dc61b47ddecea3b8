//! Rectangles packed into one: a skyline, the tallest first.

use std::cmp::Reverse;

/// A stretch of the skyline.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    begin: u32,
    width: u32,
    height: u32,
}

/// Places rectangles of a width and height, none over another, in a strip of so many columns: upper left corners, and the height that they take. Each is at
/// most as wide as the strip.
pub fn pack(sizes: &[[u32; 2]], columns: u32) -> (Vec<[u32; 2]>, u32) {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|at| (Reverse(sizes[*at][1]), Reverse(sizes[*at][0]), *at));
    let mut skyline = vec![Stretch { begin: 0, width: columns, height: 0 }];
    let (mut places, mut rows) = (vec![[0; 2]; sizes.len()], 0);
    for at in order {
        let [width, height] = sizes[at];
        let (first, place) = lowest(&skyline, width, columns);
        places[at] = place;
        rows = rows.max(place[1] + height);
        raise(&mut skyline, first, Stretch { begin: place[0], width, height: place[1] + height });
    }
    (places, rows)
}

/// Where a width fits lowest, and the stretch that it begins with.
fn lowest(skyline: &[Stretch], width: u32, columns: u32) -> (usize, [u32; 2]) {
    let mut best = (0, [0, u32::MAX]);
    for (first, stretch) in skyline.iter().enumerate() {
        if stretch.begin + width > columns {
            break;
        }
        let end = stretch.begin + width;
        let below = skyline[first..].iter().take_while(|stretch| stretch.begin < end);
        let height = below.map(|stretch| stretch.height).max().unwrap_or(0);
        if height < best.1[1] {
            best = (first, [stretch.begin, height]);
        }
    }
    best
}

/// Puts a stretch over those below it, from the `first` on.
fn raise(skyline: &mut Vec<Stretch>, first: usize, new: Stretch) {
    let end = new.begin + new.width;
    let covered = skyline[first..].iter().take_while(|stretch| stretch.begin + stretch.width <= end).count();
    if let Some(cut) = skyline.get_mut(first + covered).filter(|stretch| stretch.begin < end) {
        cut.width -= end - cut.begin;
        cut.begin = end;
    }
    skyline.splice(first..first + covered, [new]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_do_not_overlap() {
        let mut state = 1u32;
        let mut next = |most: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            1 + (state >> 16) % most
        };
        for (count, most, columns) in [(1, 9, 16), (50, 30, 64), (400, 12, 128), (3, 100, 100)] {
            let sizes: Vec<[u32; 2]> = (0..count).map(|_| [next(most), next(most)]).collect();
            let (places, rows) = pack(&sizes, columns);
            let mut taken = vec![false; (columns * rows) as usize];
            for ([x, y], [width, height]) in places.iter().zip(&sizes) {
                assert!(x + width <= columns && y + height <= rows);
                for at in (0..*height)
                    .flat_map(|row| (0..*width).map(move |column| (y + row) * columns + x + column))
                {
                    assert!(!std::mem::replace(&mut taken[at as usize], true), "{at}");
                }
            }
            let used: u32 = sizes.iter().map(|[width, height]| width * height).sum();
            assert!(count < 50 || used * 10 > columns * rows * 7, "{used} of {columns} x {rows}");
        }
    }
}
