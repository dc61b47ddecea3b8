//! Shapes that no scanner makes, of any size: piles, hubs, knots and scales at which something may stall, crawl or overflow.
//!
//! Each is a formula for its vertices and one for its triangles, so that all are streamed. What they are for is a table: memory, time
//! and checks of each beside those of the plain grid (`benches/pathological.sh`).

use super::noise::{hash, turn, unit, wave};

/// An odd shape by name.
#[derive(Clone, Copy)]
pub struct Odd {
    /// Name on the command line.
    pub name: &'static str,
    /// Description.
    pub is: &'static str,
    plan: fn(u32) -> Plan,
}

/// An odd shape of some size.
pub struct Plan {
    /// Vertices that it has.
    pub vertices: u32,
    /// Triangles that it has.
    pub triangles: u32,
    /// Whether its coordinates are doubles.
    pub double: bool,
    place: Box<dyn Fn(u32) -> [f64; 3]>,
    corners: Box<dyn Fn(u32) -> [u32; 3]>,
}

impl Plan {
    fn new(
        vertices: u32,
        triangles: u32,
        place: impl Fn(u32) -> [f64; 3] + 'static,
        corners: impl Fn(u32) -> [u32; 3] + 'static,
    ) -> Self {
        Plan { vertices, triangles, double: false, place: Box::new(place), corners: Box::new(corners) }
    }

    /// Position of a vertex.
    pub fn place(&self, vertex: u32) -> [f64; 3] {
        (self.place)(vertex)
    }

    /// Vertices of a triangle, three different ones.
    pub fn corners(&self, triangle: u32) -> [u32; 3] {
        (self.corners)(triangle)
    }
}

impl Odd {
    /// The shape with about `triangles`.
    pub fn plan(&self, triangles: u32) -> Plan {
        (self.plan)(triangles.clamp(400, Self::MAX_TRIANGLES))
    }

    /// The most triangles of a shape: each may have vertices of its own, and those have 32-bit numbers.
    pub const MAX_TRIANGLES: u32 = 1 << 30;

    /// The shape of that name.
    pub fn find(name: &str) -> Option<&'static Odd> {
        ODDS.iter().find(|odd| odd.name == name)
    }

    const fn new(name: &'static str, plan: fn(u32) -> Plan, is: &'static str) -> Odd {
        Odd { name, is, plan }
    }
}

/// Every odd shape; the first is the plain one that the others are measured by.
pub const ODDS: [Odd; 22] = [
    Odd::new("grid", |n| Grid::of(n).plan(), "a wavy grid"),
    Odd::new("shuffled", shuffled, "the grid with vertices and triangles in no order"),
    Odd::new("loose", loose, "the grid, each triangle with vertices of its own"),
    Odd::new("soup", |n| pieces(n, 1, 0.005), "triangles in a cube that share no vertex"),
    Odd::new("scattered", |n| pieces(n, 1, 1e-6), "triangles far apart"),
    Odd::new("tetrahedra", |n| pieces(n, 4, 1e-6), "tetrahedra far apart"),
    Odd::new("fan", fan, "a wavy disc of triangles about one vertex"),
    Odd::new("poles", poles, "a ring of vertices, each joined to the next and to two poles"),
    Odd::new("needles", needles, "a band of triangles ten million times as long as wide"),
    Odd::new("copies", copies, "one triangle, again and again"),
    Odd::new("stacked", stacked, "one triangle, again and again, each time with vertices of its own"),
    Odd::new("coincident", |n| layers(n, 0.0), "fifty grids in one place"),
    Odd::new("overlapping", |n| layers(n, 1e-3), "fifty grids, each a thousandth of a step from the next"),
    Odd::new("edge", edge, "triangles about one edge that all have"),
    Odd::new("hubs", hubs, "a path through a cloud, each of its edges joined to one of a hundred hubs"),
    Odd::new("random", random, "triangles with any three of half as many vertices"),
    Odd::new(
        "knots",
        knots,
        "triangles with any three corners of a lattice's cell: edges of many faces everywhere",
    ),
    Odd::new("stretched", stretched, "the grid, 1e14 times as long as high"),
    Odd::new("logarithmic", logarithmic, "the grid from 2^-43 to 2^43 along two axes"),
    Odd::new("giant", giant, "tiny triangles that share no vertex, and one of a million units"),
    Odd::new(
        "far",
        |n| far(n, 1e9, 0.01),
        "the grid in steps of 0.01 and in doubles, 1e9 units from the origin",
    ),
    Odd::new("farther", |n| far(n, 1e15, 1.0), "the grid in doubles, 1e15 units from the origin"),
];

/// A square of `m` by `m` quads.
#[derive(Clone, Copy)]
struct Grid {
    m: u32,
}

impl Grid {
    fn of(triangles: u32) -> Self {
        Grid { m: (f64::from(triangles) / 2.0).sqrt() as u32 }
    }

    fn vertices(self) -> u32 {
        (self.m + 1) * (self.m + 1)
    }

    fn triangles(self) -> u32 {
        2 * self.m * self.m
    }

    /// Steps of one, waves of some dozen, and roughness.
    fn place(self, vertex: u32) -> [f64; 3] {
        let [x, y] = [vertex % (self.m + 1), vertex / (self.m + 1)].map(f64::from);
        [x, y, 4.0 * wave(x / 90.0) * wave(y / 110.0) + 0.1 * chance(vertex, 0)]
    }

    fn corners(self, triangle: u32) -> [u32; 3] {
        let quad = triangle / 2;
        let a = quad / self.m * (self.m + 1) + quad % self.m;
        let c = a + self.m + 2;
        if triangle.is_multiple_of(2) { [a, a + 1, c] } else { [a, c, c - 1] }
    }

    fn plan(self) -> Plan {
        Plan::new(self.vertices(), self.triangles(), move |v| self.place(v), move |t| self.corners(t))
    }

    /// With each vertex moved by `f`.
    fn bent(self, f: impl Fn([f64; 3]) -> [f64; 3] + 'static) -> Plan {
        Plan { place: Box::new(move |v| f(self.place(v))), ..self.plan() }
    }
}

/// A number in [0, 1) for part `part` of piece `piece`.
fn chance(piece: u32, part: i64) -> f64 {
    unit(hash(11, [piece.into(), part, 0]))
}

/// One of `count` numbers.
fn pick(piece: u32, part: i64, count: u32) -> u32 {
    (hash(13, [piece.into(), part, 1]) % u64::from(count)) as u32
}

/// The numbers below `count` in another order, each once: in steps that have no factor in common with `count`.
#[derive(Clone, Copy)]
struct Steps {
    step: u64,
    count: u64,
}

fn mixed(count: u32) -> Steps {
    let count = u64::from(count);
    let mut step = (count as f64 * 0.618_034) as u64;
    while euclid(step, count).0 > 1 {
        step += 1;
    }
    Steps { step, count }
}

impl Steps {
    fn of(self, i: u32) -> u32 {
        (u64::from(i) * self.step % self.count) as u32
    }

    /// Where each number is.
    fn back(self) -> Self {
        Steps { step: euclid(self.step, self.count).1, ..self }
    }
}

/// The greatest common divisor, and what `a` has to be multiplied by to be that, up to multiples of `b`.
fn euclid(a: u64, b: u64) -> (u64, u64) {
    let (mut left, mut right) = ((i128::from(b), 0i128), (i128::from(a), 1i128));
    while right.0 != 0 {
        let times = left.0 / right.0;
        (left, right) = (right, (left.0 - times * right.0, left.1 - times * right.1));
    }
    (left.0 as u64, left.1.rem_euclid(i128::from(b)) as u64)
}

fn shuffled(n: u32) -> Plan {
    let grid = Grid::of(n);
    let (vertices, order) = (mixed(grid.vertices()), mixed(grid.triangles()));
    let went = vertices.back();
    Plan::new(
        grid.vertices(),
        grid.triangles(),
        move |v| grid.place(vertices.of(v)),
        move |t| grid.corners(order.of(t)).map(|v| went.of(v)),
    )
}

fn loose(n: u32) -> Plan {
    let grid = Grid::of(n);
    Plan::new(
        3 * grid.triangles(),
        grid.triangles(),
        move |v| grid.place(grid.corners(v / 3)[v as usize % 3]),
        own,
    )
}

/// The corners of triangle `t` where none has a vertex of another.
fn own(t: u32) -> [u32; 3] {
    [3 * t, 3 * t + 1, 3 * t + 2]
}

/// Triangles, or tetrahedra of four, at any places of the unit cube.
fn pieces(n: u32, faces: u32, size: f64) -> Plan {
    let count = n / faces;
    let corners = if faces == 1 { 3 } else { 4 };
    Plan::new(
        corners * count,
        faces * count,
        move |v| [0, 1, 2].map(|axis| chance(v / corners, axis) + size * chance(v, 3 + axis)),
        move |t| {
            let first = t / faces * corners;
            let [a, b, c] = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]][(t % faces) as usize];
            [first + a, first + b, first + c]
        },
    )
}

/// Vertices 0 and 1 are below and above the middle of a ring of `count`, the others on it.
fn on_poles(v: u32, count: u32) -> [f64; 3] {
    match v {
        0 => [0.0, 0.0, -1.0],
        1 => [0.0, 0.0, 1.0],
        _ => ring(v - 2, count, 0.0),
    }
}

/// Vertex `i` of a ring of `count`.
fn ring(i: u32, count: u32, height: f64) -> [f64; 3] {
    let (cos, sin) = turn(f64::from(i) / f64::from(count));
    [cos, sin, height]
}

fn fan(n: u32) -> Plan {
    fn place(v: u32, n: u32) -> [f64; 3] {
        match v.checked_sub(1) {
            None => [0.0; 3],
            Some(i) => ring(i, n, 0.1 * wave(8.0 * f64::from(i) / f64::from(n))),
        }
    }
    Plan::new(n + 1, n, move |v| place(v, n), move |t| [0, 1 + t, 1 + (t + 1) % n])
}

fn poles(n: u32) -> Plan {
    let count = n / 2;
    Plan::new(
        count + 2,
        2 * count,
        move |v| on_poles(v, count),
        move |t| {
            let (a, b) = (2 + t / 2, 2 + (t / 2 + 1) % count);
            if t.is_multiple_of(2) { [1, a, b] } else { [0, b, a] }
        },
    )
}

fn needles(n: u32) -> Plan {
    let count = n / 2;
    fn place(v: u32) -> [f64; 3] {
        let (i, far) = (f64::from(v / 2), f64::from(v % 2));
        [1e-4 * i, 1000.0 * far, wave(i / 600.0 + 0.25 * far)]
    }
    fn triangle(t: u32) -> [u32; 3] {
        if t.is_multiple_of(2) { [t, t + 2, t + 1] } else { [t + 1, t + 2, t] }
    }
    Plan::new(2 * count + 2, 2 * count, place, triangle)
}

fn corner(v: u32) -> [f64; 3] {
    [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]][v as usize % 3]
}

fn copies(n: u32) -> Plan {
    Plan::new(3, n, corner, |t| [t % 3, (t + 1) % 3, (t + 2) % 3])
}

fn stacked(n: u32) -> Plan {
    Plan::new(3 * n, n, corner, own)
}

fn layers(n: u32, apart: f64) -> Plan {
    const LAYERS: u32 = 50;
    let grid = Grid::of(n / LAYERS);
    let (vertices, triangles) = (grid.vertices(), grid.triangles());
    Plan::new(
        LAYERS * vertices,
        LAYERS * triangles,
        move |v| {
            let (layer, [x, y, z]) = (v / vertices, grid.place(v % vertices));
            [x, y, z + apart * f64::from(layer)]
        },
        move |t| grid.corners(t % triangles).map(|v| v + t / triangles * vertices),
    )
}

fn edge(n: u32) -> Plan {
    Plan::new(n + 2, n, move |v| on_poles(v, n), |t| [0, 1, t + 2])
}

fn cloud(v: u32) -> [f64; 3] {
    [0, 1, 2].map(|axis| chance(v, axis))
}

fn hubs(n: u32) -> Plan {
    const HUBS: u32 = 100;
    Plan::new(HUBS + n + 1, n, cloud, |t| [pick(t, 0, HUBS), HUBS + t, HUBS + t + 1])
}

fn random(n: u32) -> Plan {
    fn triangle(t: u32, count: u32) -> [u32; 3] {
        let a = pick(t, 0, count);
        let b = (a + 1 + pick(t, 1, count - 2)) % count;

        // Neither of the two: the numbers beside them, passed over.
        let mut c = pick(t, 2, count - 2);
        for taken in [a.min(b), a.max(b)] {
            c += u32::from(c >= taken);
        }
        [a, b, c]
    }
    let count = n / 2;
    Plan::new(count, n, cloud, move |t| triangle(t, count))
}

fn knots(n: u32) -> Plan {
    fn place(v: u32, m: u32) -> [f64; 3] {
        let cell = [v % m, v / m % m, v / m / m];
        [0, 1, 2].map(|axis| f64::from(cell[axis]) + 0.3 * chance(v, axis as i64))
    }
    fn triangle(t: u32, m: u32) -> [u32; 3] {
        let first = [0, 1, 2].map(|axis| pick(t, axis, m - 1));
        // Three different corners of a cell.
        let start = pick(t, 3, 8);
        let step = [1, 3, 5, 7][pick(t, 4, 4) as usize];
        [0, 1, 2].map(|k| {
            let corner = (start + k * step) % 8;
            let at = [0, 1, 2].map(|axis| first[axis] + (corner >> axis & 1));
            (at[2] * m + at[1]) * m + at[0]
        })
    }
    let m = libm::cbrt(f64::from(n) / 40.0).round().max(2.0) as u32;
    Plan::new(m * m * m, n, move |v| place(v, m), move |t| triangle(t, m))
}

fn stretched(n: u32) -> Plan {
    Grid::of(n).bent(|[x, y, z]| [1e8 * x, y, 1e-6 * z])
}

fn logarithmic(n: u32) -> Plan {
    let grid = Grid::of(n);
    let side = f64::from(grid.m);
    grid.bent(move |[x, y, z]| [power(x, side), power(y, side), z])
}

/// Powers of two with straight lines between them: no platform's exponential.
fn power(x: f64, side: f64) -> f64 {
    let exponent = 86.0 * x / side - 43.0;
    let whole = exponent.floor();
    (1.0 + exponent - whole) * 2f64.powi(whole as i32)
}

fn giant(n: u32) -> Plan {
    let tiny = pieces(n - 1, 1, 1e-3);
    let first = tiny.vertices;
    const LARGE: [[f64; 3]; 3] = [[-1e6, -1e6, -1.0], [1e6, 0.0, -1.0], [0.0, 1e6, -1.0]];
    Plan::new(
        first + 3,
        n,
        move |v| v.checked_sub(first).map_or_else(|| tiny.place(v), |i| LARGE[i as usize]),
        own,
    )
}

fn far(n: u32, away: f64, step: f64) -> Plan {
    Plan { double: true, ..Grid::of(n).bent(move |p| p.map(|x| step * x + away)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_shape_is_a_mesh_of_about_the_size_that_was_asked_for() {
        for odd in &ODDS {
            for wanted in [1000, 20_000] {
                let plan = odd.plan(wanted);
                let (name, got) = (odd.name, f64::from(plan.triangles));
                assert!((got / f64::from(wanted) - 1.0).abs() < 0.1, "{name}: {got} of {wanted}");

                let mut used = vec![false; plan.vertices as usize];
                for t in 0..plan.triangles {
                    let [a, b, c] = plan.corners(t);
                    assert!(a != b && b != c && c != a, "{name}: {t}");
                    [a, b, c].iter().for_each(|v| used[*v as usize] = true);
                }

                let unused = used.iter().filter(|used| !**used).count();
                assert!(
                    unused * 100 <= used.len() * if name == "random" { 6 } else { 1 },
                    "{name}: {unused} unused"
                );
                assert!((0..plan.vertices).all(|v| plan.place(v).iter().all(|x| x.is_finite())), "{name}");
            }
        }

        let names: BTreeSet<&str> = ODDS.iter().map(|odd| odd.name).collect();
        assert_eq!(names.len(), ODDS.len());
    }

    #[test]
    fn a_shuffled_grid_is_the_grid() {
        let (grid, shuffled) =
            (Odd::find("grid").unwrap().plan(5000), Odd::find("shuffled").unwrap().plan(5000));
        let triangles = |plan: &Plan| -> BTreeSet<[[u64; 3]; 3]> {
            (0..plan.triangles).map(|t| plan.corners(t).map(|v| plan.place(v).map(f64::to_bits))).collect()
        };
        assert_eq!(triangles(&grid), triangles(&shuffled));
        let jumps = |plan: &Plan| {
            (1..plan.triangles).filter(|t| plan.corners(*t)[0].abs_diff(plan.corners(t - 1)[0]) > 100).count()
        };
        assert!(jumps(&grid) == 0 && jumps(&shuffled) > 4000);
    }
}
