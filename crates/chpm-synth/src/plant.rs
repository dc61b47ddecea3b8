//! A plant: pipes, bolts and tanks, each a closed component in a cell of its own, so that none touches another.
//!
//! Every part is a row of rings about a way. A tank and a bolt end in a point; a pipe has a bore, and its rings go back inside to where they began.

use super::Batch;
use super::noise::{hash, turn, unit};

/// How many parts, and how fine; parts are made one after the other.
#[derive(Clone, Debug)]
pub(super) struct Plant {
    seed: u64,
    parts: u64,
    /// Triangles of a part of weight 1.
    size: f64,
    counts: [u64; 2],
}

type Point = [f64; 3];

/// A ring about a middle, in a plane.
#[derive(Clone, Copy)]
struct Ring {
    middle: Point,
    /// Directions of length 1, upright on each other; their cross product goes along the way.
    plane: [Point; 2],
    radius: f64,
    /// Whether it has six corners.
    is_hex: bool,
}

/// How a row of rings ends.
#[derive(Clone, Copy, PartialEq)]
enum Ends {
    Points([Point; 2]),
    /// The last ring is before the first.
    Round,
}

#[derive(Clone, Copy)]
enum Kind {
    Pipe,
    Bolt,
    Tank,
}

/// A part, not yet made.
#[derive(Clone, Copy)]
struct Part {
    number: u64,
    kind: Kind,
    sides: u32,
    /// Rings for each unit of a row's length.
    along: f64,
}

/// Cells are 1 wide, and parts stay so far away from their sides.
const CLEAR: f64 = 0.02;
/// Of a hundred parts so many are pipes; and bolts; tanks are the rest.
const PIPES: u64 = 45;
const BOLTS: u64 = 45;
/// Fewest triangles that a part aims for.
const LEAST: f64 = 96.0;

impl Plant {
    pub(super) fn new(parts: u64, target: u64, seed: u64) -> Self {
        let mut plant = Plant { seed, parts: parts.max(1), size: 0.0, counts: [0; 2] };
        let weights: f64 = (0..plant.parts).map(|number| plant.kind(number).weight()).sum();
        plant.size = target as f64 / weights;
        // Whole rings and sides miss what was aimed for a little: so much that a few corrections find it.
        for _ in 0..6 {
            plant.counts = plant.count();
            let off = target as f64 / plant.counts[1] as f64;
            if (off - 1.0).abs() < 0.01 {
                break;
            }
            plant.size *= off;
        }
        plant.counts = plant.count();
        plant
    }

    fn count(&self) -> [u64; 2] {
        let mut rings = Vec::new();
        (0..self.parts).fold([0; 2], |[vertices, triangles], number| {
            let part = self.part(number);
            let ends = part.rings(&mut rings, self.seed);
            let grid = u64::from(part.sides) * rings.len() as u64;
            // Two points take as many triangles as one more row of quads.
            [vertices + grid + if ends == Ends::Round { 0 } else { 2 }, triangles + 2 * grid]
        })
    }

    fn kind(&self, number: u64) -> Kind {
        match hash(self.seed, [number as i64, 1, 0]) % 100 {
            x if x < PIPES => Kind::Pipe,
            x if x < PIPES + BOLTS => Kind::Bolt,
            _ => Kind::Tank,
        }
    }

    fn part(&self, number: u64) -> Part {
        let kind = self.kind(number);
        let triangles = (self.size * kind.weight()).max(LEAST);
        // About as many rings as make quads square; sides of a bolt are a multiple of its corners.
        let sides = (triangles / 2.0 / kind.length()).sqrt();
        let sides = match kind {
            Kind::Bolt => 6 * (sides / 6.0).round().clamp(1.0, 4096.0) as u32,
            _ => sides.round().clamp(6.0, 24_576.0) as u32,
        };
        let along = triangles / 2.0 / f64::from(sides) / kind.length();
        Part { number, kind, sides, along }
    }

    pub(super) fn vertex_count(&self) -> u64 {
        self.counts[0]
    }

    pub(super) fn triangle_count(&self) -> u64 {
        self.counts[1]
    }

    pub(super) fn vertices<E>(&self, batch: &mut Batch<'_, [f32; 3], E>) -> Result<(), E> {
        let mut rings = Vec::new();
        let side = (1..).find(|side: &u64| side.pow(3) >= self.parts).unwrap_or(1);
        for number in 0..self.parts {
            let part = self.part(number);
            let ends = part.rings(&mut rings, self.seed);
            let cell = [number % side, number / side % side, number / (side * side)];
            // A cyclic change of axes turns a part without mirroring it.
            let turned = hash(self.seed, [number as i64, 2, 0]) as usize % 3;
            let place =
                |p: Point| std::array::from_fn(|axis| (cell[axis] as f64 + p[(axis + turned) % 3]) as f32);
            for ring in &rings {
                for at in 0..part.sides {
                    batch.push(place(ring.point(at, part.sides)))?;
                }
            }
            if let Ends::Points(ends) = ends {
                ends.into_iter().try_for_each(|end| batch.push(place(end)))?;
            }
        }
        Ok(())
    }

    pub(super) fn triangles<E>(&self, batch: &mut Batch<'_, [u32; 3], E>) -> Result<(), E> {
        let (mut rings, mut first) = (Vec::new(), 0_u32);
        for number in 0..self.parts {
            let part = self.part(number);
            let ends = part.rings(&mut rings, self.seed);
            let (sides, count) = (part.sides, rings.len() as u32);
            let at = |ring: u32, side: u32| first + ring % count * sides + side % sides;
            let rows = if ends == Ends::Round { count } else { count - 1 };
            for ring in 0..rows {
                for side in 0..sides {
                    let quad = [(ring, side), (ring, side + 1), (ring + 1, side + 1), (ring + 1, side)];
                    batch.push_quad(quad.map(|(ring, side)| at(ring, side)))?;
                }
            }
            let mut next = first + count * sides;
            if ends != Ends::Round {
                for side in 0..sides {
                    batch.push([next, at(0, side + 1), at(0, side)])?;
                    batch.push([next + 1, at(count - 1, side), at(count - 1, side + 1)])?;
                }
                next += 2;
            }
            first = next;
        }
        Ok(())
    }
}

impl Kind {
    /// Triangles of such a part, beside those of others.
    fn weight(self) -> f64 {
        match self {
            Kind::Pipe => 1.2,
            Kind::Bolt => 0.5,
            Kind::Tank => 2.0,
        }
    }

    /// Length of its row of rings beside the way around it, about.
    fn length(self) -> f64 {
        match self {
            Kind::Pipe => 4.0,
            Kind::Bolt => 1.5,
            Kind::Tank => 1.2,
        }
    }
}

impl Ring {
    fn point(&self, at: u32, sides: u32) -> Point {
        let (cos, sin) = turn(f64::from(at) / f64::from(sides));
        let radius = if self.is_hex {
            // The distance of a side is the cosine of 30 degrees; the angle is that from its middle.
            let corner = f64::from(6 * at) / f64::from(sides);
            let (off, _) = turn((corner - corner.floor() - 0.5) / 6.0);
            self.radius * 0.75_f64.sqrt() / off
        } else {
            self.radius
        };
        let [u, v] = self.plane;
        std::array::from_fn(|axis| self.middle[axis] + radius * (cos * u[axis] + sin * v[axis]))
    }
}

/// A row of rings along z.
const UPRIGHT: [Point; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

impl Part {
    fn draw(&self, seed: u64, which: i64, low: f64, high: f64) -> f64 {
        low + (high - low) * unit(hash(seed, [self.number as i64, 3, which]))
    }

    /// So many steps for a part of the row.
    fn steps(&self, length: f64, least: u32) -> u32 {
        (self.along * length).round().max(f64::from(least)) as u32
    }

    fn rings(&self, rings: &mut Vec<Ring>, seed: u64) -> Ends {
        rings.clear();
        match self.kind {
            Kind::Pipe => self.pipe(rings, seed),
            Kind::Bolt => self.bolt(rings, seed),
            Kind::Tank => self.tank(rings, seed),
        }
    }

    /// A cylinder with round ends, upright.
    fn tank(&self, rings: &mut Vec<Ring>, seed: u64) -> Ends {
        let radius = self.draw(seed, 0, 0.15, 0.4);
        let [low, high] = [CLEAR + radius, 1.0 - CLEAR - radius];
        let round = self.steps(0.4, 2);
        let straight = self.steps(0.4, 1);
        let mut ring = |z: f64, radius: f64| {
            rings.push(Ring { middle: [0.5, 0.5, z], plane: UPRIGHT, radius, is_hex: false });
        };
        // The points are not rings.
        for step in 1..=round {
            let (cos, sin) = turn(0.25 * f64::from(step) / f64::from(round));
            ring(low - radius * cos, radius * sin);
        }
        for step in 1..straight {
            ring(low + (high - low) * f64::from(step) / f64::from(straight), radius);
        }
        for step in 0..round {
            let (cos, sin) = turn(0.25 * f64::from(step) / f64::from(round));
            ring(high + radius * sin, radius * cos);
        }
        Ends::Points([[0.5, 0.5, low - radius], [0.5, 0.5, high + radius]])
    }

    /// A shaft with a head of six sides, upright.
    fn bolt(&self, rings: &mut Vec<Ring>, seed: u64) -> Ends {
        let radius = self.draw(seed, 0, 0.04, 0.12);
        let (head, long) = (1.8 * radius, self.draw(seed, 1, 0.3, 0.8));
        let at = [self.draw(seed, 2, 0.25, 0.75), self.draw(seed, 3, 0.25, 0.75)];
        let top = long + 1.3 * radius;
        let mut ring = |z: f64, radius: f64, is_hex: bool| {
            rings.push(Ring { middle: [at[0], at[1], CLEAR + z], plane: UPRIGHT, radius, is_hex });
        };
        // Flat faces, and edges between them: under it, the shaft, under the head, the head.
        let under = self.steps(0.1, 1);
        (1..under).for_each(|step| ring(0.0, radius * f64::from(step) / f64::from(under), false));
        let shaft = self.steps(0.8, 1);
        (0..=shaft).for_each(|step| ring(long * f64::from(step) / f64::from(shaft), radius, false));
        let sides = self.steps(0.3, 1);
        (0..=sides)
            .for_each(|step| ring(long + (top - long) * f64::from(step) / f64::from(sides), head, true));
        let lid = self.steps(0.3, 1);
        (1..lid).for_each(|step| ring(top, head * (1.0 - f64::from(step) / f64::from(lid)), true));
        Ends::Points([[at[0], at[1], CLEAR], [at[0], at[1], CLEAR + top]])
    }

    /// From the cell's left side to its top, with one bend, and a bore.
    fn pipe(&self, rings: &mut Vec<Ring>, seed: u64) -> Ends {
        let radius = self.draw(seed, 0, 0.05, 0.18);
        let bore = radius * self.draw(seed, 1, 0.6, 0.9);
        let bend = radius * self.draw(seed, 2, 1.2, 1.6);
        let y = self.draw(seed, 3, 0.25, 0.75);
        // It goes along x, turns at a middle, and then goes along z.
        let [x, z] = [self.draw(seed, 4, 0.55, 0.75), self.draw(seed, 5, 0.25, 0.45)];
        let (straight, round) = (self.steps(0.7, 1), self.steps(0.6, 2));
        let mut way = |radius: f64, step: u32| {
            let along = |step: u32| f64::from(step) / f64::from(straight);
            let (middle, (cos, sin)) = if step <= straight {
                ([CLEAR + (x - bend - CLEAR) * along(step), y, z], (1.0, 0.0))
            } else if step < straight + round {
                let (cos, sin) = turn(0.25 * f64::from(step - straight) / f64::from(round));
                ([x - bend + bend * sin, y, z + bend * (1.0 - cos)], (cos, sin))
            } else {
                let step = step - straight - round;
                ([x, y, z + bend + (1.0 - CLEAR - z - bend) * along(step)], (0.0, 1.0))
            };
            // The way goes along (cos, 0, sin).
            let plane = [[0.0, 1.0, 0.0], [-sin, 0.0, cos]];
            rings.push(Ring { middle, plane, radius, is_hex: false });
        };
        let last = 2 * straight + round;
        (0..=last).for_each(|step| way(radius, step));
        (0..=last).rev().for_each(|step| way(bore, step));
        Ends::Round
    }
}
