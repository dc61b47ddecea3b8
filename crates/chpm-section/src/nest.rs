//! Nesting: which closed lines of a section lie in which, and what they enclose.

use crate::crossing::crossing;
use crate::line::Line;
use crate::planes::dot;

/// A segment of a closed line in the plane, from its lower end to its upper one.
#[derive(Clone, Copy, Debug)]
struct Side {
    low: [f64; 2],
    high: [f64; 2],
    line: u32,
}

/// A point of a closed line.
#[derive(Clone, Copy, Debug)]
struct Probe {
    at: [f64; 2],
    line: u32,
    /// Whether a line that turns left goes up here, and has its inside on the side of smaller x.
    is_up: bool,
}

/// Tells every closed line its area, the lines that it lies in, and turns it so that what is filled is on its left. Of lines that do not cross, a single point of
/// each decides; of those that do, what lies in what is as that point has it.
pub(crate) fn nest(lines: &mut [Line], [u, v]: [[f64; 3]; 2]) {
    let (mut numbers, mut rings): (Vec<u32>, Vec<Vec<[f64; 2]>>) = Default::default();
    for (number, line) in (0..).zip(lines.iter_mut()).filter(|(_, line)| line.is_closed) {
        let mut flat: Vec<[f64; 2]> =
            line.points.iter().map(|point| [dot(u, *point), dot(v, *point)]).collect();
        let area = area(&flat);
        line.area = area.abs();
        // Until it is known how deep it lies, all turn left.
        if area < 0.0 {
            line.points[1..].reverse();
            flat[1..].reverse();
        }
        numbers.push(number);
        rings.push(flat);
    }
    let crosses = crossing(&rings.iter().map(Vec::as_slice).collect::<Vec<_>>());
    numbers.iter().zip(crosses).for_each(|(number, crosses)| lines[*number as usize].crosses = crosses);

    let (mut sides, mut probes) = (Vec::new(), Vec::new());
    for (line, ring) in numbers.into_iter().zip(rings) {
        let mut highest = (-1.0, Probe { at: ring[0], line, is_up: true });
        for (a, b) in ring.iter().zip(ring[1..].iter().chain(&ring[..1])) {
            let across = b[1] - a[1];
            if across.abs() > highest.0 {
                let at = [a[0].midpoint(b[0]), a[1].midpoint(b[1])];
                highest = (across.abs(), Probe { at, line, is_up: across > 0.0 });
            }
            if across != 0.0 {
                let [low, high] = if across > 0.0 { [*a, *b] } else { [*b, *a] };
                sides.push(Side { low, high, line });
            }
        }
        probes.push(highest.1);
    }

    // So that no two lie in each other, as copies might: only what is larger, or came before, is around.
    let rank = |line: u32, lines: &[Line]| (lines[line as usize].area, std::cmp::Reverse(line));
    for (number, mut around) in within(sides, probes) {
        around.retain(|other| rank(*other, lines) > rank(number, lines));
        let line = &mut lines[number as usize];
        line.depth = around.len() as u32;
        line.parent = around.first().copied();
        if line.depth % 2 == 1 {
            line.points[1..].reverse();
        }
    }
}

/// For each probe, the lines that it lies in, the innermost first: those that a ray from it crosses an odd number of times. A probe on another line, as of solids side
/// by side, is taken as just inside of its own.
fn within(mut sides: Vec<Side>, mut probes: Vec<Probe>) -> Vec<(u32, Vec<u32>)> {
    sides.sort_by(|a, b| a.low[1].total_cmp(&b.low[1]));
    probes.sort_by(|a, b| a.at[1].total_cmp(&b.at[1]).then(a.line.cmp(&b.line)));
    let mut sides = sides.into_iter().peekable();
    let mut active: Vec<Side> = Vec::new();
    let mut found = Vec::with_capacity(probes.len());

    for Probe { at: [x, y], line, is_up } in probes {
        while let Some(side) = sides.next_if(|side| side.low[1] <= y) {
            active.push(side);
        }
        active.retain(|side| side.high[1] > y);
        let others = active.iter().filter(|side| side.line != line);
        let mut hits: Vec<(f64, u32)> = others
            .filter_map(|Side { low, high, line }| {
                let slope = (high[0] - low[0]) / (high[1] - low[1]);
                let hit = low[0] + slope * (y - low[1]);
                // Both are rounded.
                let slack = 4.0 * f64::EPSILON * (low[0].abs() + high[0].abs() + slope.abs() * y.abs());
                let is_hit = if (hit - x).abs() <= slack { is_up } else { hit > x };
                is_hit.then_some((hit, *line))
            })
            .collect();
        hits.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));

        // A ray leaves the innermost line for the first time before it leaves any other.
        let mut names: Vec<u32> = hits.iter().map(|(_, line)| *line).collect();
        names.sort_unstable();
        let odd = names.chunk_by(|a, b| a == b).filter(|run| run.len() % 2 == 1).map(|run| run[0]);
        let odd: Vec<u32> = odd.collect();
        let mut around = Vec::with_capacity(odd.len());
        for (_, line) in hits {
            if odd.binary_search(&line).is_ok() && !around.contains(&line) {
                around.push(line);
            }
        }
        found.push((line, around));
    }
    found
}

/// Area of a polygon, positive where it turns left. About its first point, so that what is far from the zero point loses nothing.
fn area(points: &[[f64; 2]]) -> f64 {
    let [x, y] = points[0];
    let near = |point: &[f64; 2]| [point[0] - x, point[1] - y];
    points
        .windows(2)
        .map(|pair| (near(&pair[0]), near(&pair[1])))
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum::<f64>()
        / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(low: f64, high: f64) -> Line {
        let points = vec![[low, low, 0.0], [low, high, 0.0], [high, high, 0.0], [high, low, 0.0]];
        Line { points, is_closed: true, length: 0.0, area: 0.0, depth: 0, parent: None, crosses: false }
    }

    #[test]
    fn squares_lie_in_each_other() {
        let mut lines =
            vec![square(2.0, 3.0), square(0.0, 10.0), square(1.0, 4.0), square(5.0, 6.0), square(20.0, 21.0)];
        lines.push(Line { is_closed: false, ..square(0.5, 0.6) });
        nest(&mut lines, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let told: Vec<_> = lines.iter().map(|line| (line.depth, line.parent, line.area)).collect();
        let expected = [
            (2, Some(2), 1.0),
            (0, None, 100.0),
            (1, Some(1), 9.0),
            (1, Some(1), 1.0),
            (0, None, 1.0),
            (0, None, 0.0),
        ];
        assert_eq!(told, expected);
        let turns = |line: &Line| {
            let flat: Vec<[f64; 2]> = line.points.iter().map(|[x, y, _]| [*x, *y]).collect();
            area(&flat) > 0.0
        };
        assert_eq!(lines[..5].iter().map(turns).collect::<Vec<_>>(), [true, true, false, false, true]);
    }
}
