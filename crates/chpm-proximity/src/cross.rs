//! Whether two triangles meet, exactly: every decision is the sign of a determinant of the numbers as they are.

use chpm_mesh::geom;
use nalgebra::Point3;
use robust::{Coord, Coord3D, orient2d, orient3d};

type Corners = [[f32; 3]; 3];

/// Whether two triangles, with their borders, have a point in common.
pub(crate) fn meet(t: &Corners, u: &Corners) -> bool {
    let (t, u) = (t.map(geom::to_f64), u.map(geom::to_f64));
    fn edges(c: &[Point3<f64>; 3]) -> [[Point3<f64>; 2]; 3] {
        [[c[0], c[1]], [c[1], c[2]], [c[2], c[0]]]
    }
    edges(&t).iter().any(|edge| edge_meets(edge, &u)) || edges(&u).iter().any(|edge| edge_meets(edge, &t))
}

fn volume(a: Point3<f64>, b: Point3<f64>, c: Point3<f64>, d: Point3<f64>) -> f64 {
    let [a, b, c, d] = [a, b, c, d].map(|p| Coord3D { x: p.x, y: p.y, z: p.z });
    orient3d(a, b, c, d)
}

/// The sign of a turn, seen along an axis.
fn turn(a: Point3<f64>, b: Point3<f64>, c: Point3<f64>, axis: usize) -> f64 {
    let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
    let [a, b, c] = [a, b, c].map(|p| Coord { x: p[x], y: p[y] });
    orient2d(a, b, c)
}

fn agree(signs: [f64; 3]) -> bool {
    signs.iter().all(|x| *x >= 0.0) || signs.iter().all(|x| *x <= 0.0)
}

fn edge_meets([p, q]: &[Point3<f64>; 2], u: &[Point3<f64>; 3]) -> bool {
    let [a, b, c] = *u;
    let (above, below) = (volume(a, b, c, *p), volume(a, b, c, *q));
    if (above > 0.0 && below > 0.0) || (above < 0.0 && below < 0.0) {
        return false;
    }
    if above == 0.0 && below == 0.0 {
        let sides = [[a, b], [b, c], [c, a]];
        return sides.iter().any(|side| segments_meet(&[*p, *q], side)) || is_inside(*p, u);
    }
    agree([volume(*p, *q, a, b), volume(*p, *q, b, c), volume(*p, *q, c, a)])
}

/// Whether two segments meet: they do if all three views of them do, since one view at least shows the plane that they lie in, or their line.
fn segments_meet(s: &[Point3<f64>; 2], r: &[Point3<f64>; 2]) -> bool {
    volume(s[0], s[1], r[0], r[1]) == 0.0 && (0..3).all(|axis| views_meet(s, r, axis))
}

fn views_meet(s: &[Point3<f64>; 2], r: &[Point3<f64>; 2], axis: usize) -> bool {
    let apart = [(axis + 1) % 3, (axis + 2) % 3]
        .into_iter()
        .any(|x| s[0][x].max(s[1][x]) < r[0][x].min(r[1][x]) || r[0][x].max(r[1][x]) < s[0][x].min(s[1][x]));
    !apart && divides(s, r, axis) && divides(r, s, axis)
}

fn divides(by: &[Point3<f64>; 2], other: &[Point3<f64>; 2], axis: usize) -> bool {
    let (from, to) = (turn(by[0], by[1], other[0], axis), turn(by[0], by[1], other[1], axis));
    !((from > 0.0 && to > 0.0) || (from < 0.0 && to < 0.0))
}

/// Whether a point of a triangle's plane is in the triangle; never, where the triangle is none.
fn is_inside(p: Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> bool {
    let is_triangle = (0..3).any(|axis| turn(*a, *b, *c, axis) != 0.0);
    is_triangle
        && (0..3).all(|axis| agree([turn(*a, *b, p, axis), turn(*b, *c, p, axis), turn(*c, *a, p, axis)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: Corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    #[test]
    fn triangles_meet_where_they_have_a_point_in_common() {
        let lower = f32::from_bits(1);
        for (other, expected) in [
            // Through it, on it at a corner, and above it by the least number there is.
            ([[0.2, 0.2, -1.0], [0.2, 0.2, 1.0], [3.0, 3.0, 1.0]], true),
            ([[0.2, 0.2, 0.0], [0.2, 0.2, 1.0], [3.0, 3.0, 1.0]], true),
            ([[0.2, 0.2, lower], [0.2, 0.2, 1.0], [3.0, 3.0, 1.0]], false),
            // In its plane: inside, across, with an edge in common, beside it.
            ([[0.1, 0.1, 0.0], [0.2, 0.1, 0.0], [0.1, 0.2, 0.0]], true),
            ([[-1.0, 0.2, 0.0], [2.0, 0.3, 0.0], [2.0, 0.2, 0.0]], true),
            ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, -1.0, 0.0]], true),
            ([[0.5, 0.5, 0.0], [1.0, 1.0, 0.0], [1.0, 0.5, 0.0]], true),
            ([[0.6, 0.5, 0.0], [1.0, 1.0, 0.0], [1.0, 0.5, 0.0]], false),
            // Without area: a needle through it, one beside it in its plane, a point on it and one off it.
            ([[0.2, 0.2, -1.0], [0.2, 0.2, 1.0], [0.2, 0.2, 0.5]], true),
            ([[2.0, 0.0, 0.0], [3.0, 0.0, 0.0], [4.0, 0.0, 0.0]], false),
            ([[0.5, 0.0, 0.0], [3.0, 0.0, 0.0], [4.0, 0.0, 0.0]], true),
            ([[0.25, 0.25, 0.0]; 3], true),
            ([[0.75, 0.75, 0.0]; 3], false),
        ] {
            for turn in 0..3 {
                // Whatever the axes and the order of corners.
                let turned = |t: &Corners| t.map(|p| [p[turn], p[(turn + 1) % 3], p[(turn + 2) % 3]]);
                let (t, mut u) = (turned(&FLAT), turned(&other));
                u.rotate_left(turn);
                assert_eq!(meet(&t, &u), expected, "{other:?}");
                assert_eq!(meet(&u, &t), expected, "{other:?}");
            }
        }
    }

    #[test]
    fn triangles_without_area_meet_in_points_and_lines() {
        let needle = |a: [f32; 3], b: [f32; 3]| [a, b, b];
        let along = needle([0.0, 0.0, 0.0], [3.0, 3.0, 3.0]);
        assert!(meet(&along, &needle([1.0, 1.0, 1.0], [9.0, 9.0, 9.0])));
        assert!(!meet(&along, &needle([4.0, 4.0, 4.0], [9.0, 9.0, 9.0])));
        assert!(meet(&along, &needle([0.0, 1.0, 2.0], [2.0, 1.0, 0.0])));
        assert!(!meet(&along, &needle([0.0, 1.0, 2.0], [2.0, 1.0, 0.5])));
        assert!(meet(&[[1.0; 3]; 3], &along) && !meet(&[[1.0, 1.0, 2.0]; 3], &along));
    }
}
