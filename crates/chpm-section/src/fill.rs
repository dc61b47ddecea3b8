//! The inside of a section as triangles, for whoever draws it.

use crate::planes::dot;
use crate::section::Section;
use earcut::Earcut;

/// Triangles between the closed lines of a section: all that lies in an odd number of them. Where lines cross each other, as those of surfaces do that cross
/// themselves, it is nearly that.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Fill {
    /// Relative to the file's origin.
    pub points: Vec<[f64; 3]>,
    /// Places of corners in the points.
    pub triangles: Vec<[u32; 3]>,
}

impl Fill {
    /// Of a section of planes with these [`axes`](crate::Planes::axes). Each line of even depth is filled but for those directly in it.
    pub fn of(section: &Section, [u, v]: [[f64; 3]; 2]) -> Self {
        let lines = &section.lines;
        // Holes, by the lines that they are in.
        let mut holes: Vec<(usize, usize)> = Vec::new();
        for (number, line) in lines.iter().enumerate() {
            if let (true, 1, Some(parent)) = (line.is_closed, line.depth % 2, line.parent) {
                holes.push((parent as usize, number));
            }
        }
        holes.sort_unstable();

        let (mut fill, mut earcut) = (Fill::default(), Earcut::new());
        let (mut flat, mut starts, mut corners): (Vec<[f64; 2]>, Vec<u32>, Vec<u32>) = Default::default();
        for (number, line) in
            lines.iter().enumerate().filter(|(_, line)| line.is_closed && line.depth % 2 == 0)
        {
            let from = holes.partition_point(|(parent, _)| *parent < number);
            let own = holes[from..].iter().take_while(|(parent, _)| *parent == number);
            let before = fill.points.len();
            starts.clear();
            fill.points.extend(&line.points);
            for (_, hole) in own {
                starts.push((fill.points.len() - before) as u32);
                fill.points.extend(&lines[*hole].points);
            }
            flat.clear();
            flat.extend(fill.points[before..].iter().map(|point| [dot(u, *point), dot(v, *point)]));
            earcut.earcut(flat.iter().copied(), &starts, &mut corners);
            let placed = |corner: &u32| before as u32 + corner;
            fill.triangles
                .extend(corners.chunks_exact(3).map(|c| [placed(&c[0]), placed(&c[1]), placed(&c[2])]));
        }
        fill
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line::Line;
    use crate::nest::nest;

    const AXES: [[f64; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    fn ring(x: f64, radius: f64, corners: u32) -> Line {
        let point = |n: u32| {
            let angle = f64::from(n) / f64::from(corners) * std::f64::consts::TAU;
            [x + radius * angle.cos(), radius * angle.sin(), 7.0]
        };
        Line {
            points: (0..corners).map(point).collect(),
            is_closed: true,
            length: 0.0,
            area: 0.0,
            depth: 0,
            parent: None,
            crosses: false,
        }
    }

    #[test]
    fn what_is_filled_has_the_section_s_area() {
        let mut lines =
            vec![ring(0.0, 10.0, 500), ring(0.0, 8.0, 33), ring(1.0, 3.0, 3), ring(-5.0, 1.0, 90)];
        lines.extend([ring(40.0, 2.0, 4), Line { is_closed: false, ..ring(0.0, 20.0, 9) }]);
        nest(&mut lines, AXES);
        let section = Section { offset: 7.0, lines };
        let fill = Fill::of(&section, AXES);
        let area = |[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|corner| fill.points[*corner as usize]);
            ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs() / 2.0
        };
        let all: f64 = fill.triangles.iter().map(area).sum();
        let expected = section.area().unwrap();
        assert!(expected > 100.0 && (all / expected - 1.0).abs() < 1e-12, "{all} {expected}");
        // A polygon with holes has two triangles fewer than corners, and two more for each hole.
        let closed = section.lines.iter().filter(|line| line.is_closed);
        let outer = closed.clone().filter(|line| line.depth % 2 == 0).count();
        let corners: usize = closed.clone().map(|line| line.points.len()).sum();
        assert_eq!(fill.triangles.len(), corners + 2 * (closed.count() - outer) - 2 * outer);
    }

    #[test]
    fn where_nothing_is_closed_nothing_is_filled() {
        let section = Section { offset: 7.0, lines: vec![Line { is_closed: false, ..ring(0.0, 1.0, 9) }] };
        assert_eq!(Fill::of(&section, AXES), Fill::default());
    }
}
