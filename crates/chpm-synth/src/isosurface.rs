//! A noisy isosurface by marching tetrahedra, slab by slab.
//!
//! Every cell of a grid is cut into six tetrahedra about its main diagonal (Kuhn's), so that neighbours agree on their
//! shared faces; a mesh vertex sits on a grid edge between an inside and an outside point and is numbered by that
//! edge. The grid's hull counts as outside, so the surface is closed, and each tetrahedron edge has a disc of
//! triangles around it, so the surface is manifold. The field's features have a fixed size in cells: a larger
//! mesh has more components and handles, as a scan has, not smoother ones.

use super::{
    Batch,
    noise::{hash, unit, value3, wave},
};

/// A grid of `n` by `n` by `nz` cells, and the counts of its surface.
#[derive(Clone, Debug)]
pub(super) struct Isosurface {
    seed: u64,
    n: u32,
    nz: u32,
    vertices: u64,
    triangles: u64,
    cells: Vec<Vec<[Cut; 3]>>,
}

/// A grid edge, seen from a cell: where it starts (a corner, one bit per axis) and where it goes (the bits it adds).
#[derive(Clone, Copy, Debug)]
struct Cut {
    corner: u8,
    direction: u8,
}

/// The cut edges that start in a layer of grid points, as one bit per direction, and their first vertices' numbers.
struct Layer {
    masks: Vec<u8>,
    first: Vec<u32>,
}

impl Isosurface {
    /// Cells are cut into about this many triangles; it shapes the grid and decides no count.
    const TRIANGLES_PER_CELL: f64 = 2.0;
    /// Cells from one wall of the gyroid to the one after next.
    const PERIOD: f64 = 20.0;
    const MOST_TRIANGLES_PER_CELL: u64 = 12;

    /// Tries a few widths of the grid, since one slab more or less is a large step in a small mesh.
    pub(super) fn new(target: u64, seed: u64) -> Self {
        let n = libm::cbrt(target as f64 / (4.0 * Self::TRIANGLES_PER_CELL)).round() as u32;
        let n = n.clamp(6, 1 << 12);
        fn off(plan: &Isosurface, target: u64) -> u64 {
            target.abs_diff(plan.triangles)
        }
        let mut best = Self::stacked(target, seed, n);
        for wider in 1..4 {
            if 50 * off(&best, target) <= target {
                break;
            }
            let other = Self::stacked(target, seed, n + wider);
            best = if off(&other, target) < off(&best, target) { other } else { best };
        }
        best
    }

    /// Stacks slabs until the closed surface has the number of triangles that is nearest to `target`.
    fn stacked(target: u64, seed: u64, n: u32) -> Self {
        let mut plan = Isosurface { seed, n, nz: 1, vertices: 0, triangles: 0, cells: cell_table() };
        let outside = vec![-1.0; plan.layer_len()];
        let (mut vertices, mut triangles) = (0, 0);
        let mut below = outside.clone();
        // A field that stays outside for this long would be a strange one, but must end too.
        for nz in 1..=64 * n + 64 {
            let most = Self::MOST_TRIANGLES_PER_CELL * u64::from(n) * u64::from(n);
            if triangles + most >= target {
                let (v, t) = plan.count(&below, &outside);
                if target.abs_diff(triangles + t) < target.abs_diff(plan.triangles) || plan.triangles == 0 {
                    (plan.nz, plan.vertices, plan.triangles) = (nz, vertices + v, triangles + t);
                }
                if triangles + t >= target && plan.triangles > 0 {
                    break;
                }
            }
            let above = plan.field(nz, u32::MAX);
            let (v, t) = plan.count(&below, &above);
            (vertices, triangles) = (vertices + v, triangles + t);
            below = above;
        }
        plan
    }

    pub(super) fn vertex_count(&self) -> u64 {
        self.vertices
    }

    pub(super) fn triangle_count(&self) -> u64 {
        self.triangles
    }

    pub(super) fn vertices<E>(&self, batch: &mut Batch<'_, [f32; 3], E>) -> Result<(), E> {
        let scale = 1.0 / f64::from(self.n.max(self.nz));
        let mut below = self.field(0, self.nz);
        for z in 0..self.nz {
            let above = self.field(z + 1, self.nz);
            for (x, y) in rows(self.n + 1) {
                let mask = self.mask(&below, &above, x, y);
                let point = [x, y, z].map(f64::from);
                let from = f64::from(below[self.at(x, y)]);
                for direction in (1..8).filter(|d| mask >> (d - 1) & 1 == 1) {
                    let to = f64::from(self.value(&below, &above, x, y, direction));
                    // Kept off the ends, so that no two vertices about a grid point coincide.
                    let t = (from / (from - to)).clamp(0.02, 0.98);
                    let step = [0, 1, 2].map(|axis| f64::from(direction >> axis & 1) * t);
                    batch.push(std::array::from_fn(|a| (scale * (point[a] + step[a])) as f32))?;
                }
            }
            below = above;
        }
        Ok(())
    }

    pub(super) fn triangles<E>(&self, batch: &mut Batch<'_, [u32; 3], E>) -> Result<(), E> {
        let mut next = 0;
        let mut below = self.field(0, self.nz);
        let mut above = self.field(1, self.nz);
        let mut low = self.layer(&below, &above, &mut next);

        for z in 0..self.nz {
            let beyond = self.field(z + 2, self.nz);
            let high = self.layer(&above, &beyond, &mut next);

            for (x, y) in rows(self.n) {
                for triangle in &self.cells[usize::from(self.inside(&below, &above, x, y))] {
                    batch.push(triangle.map(|cut| {
                        let layer = if cut.corner & 4 == 0 { &low } else { &high };
                        let corner = u32::from(cut.corner);
                        let point = self.at(x + (corner & 1), y + (corner >> 1 & 1));
                        let before = layer.masks[point] & ((1 << (cut.direction - 1)) - 1);
                        layer.first[point] + before.count_ones()
                    }))?;
                }
            }

            (below, above, low) = (above, beyond, high);
        }
        Ok(())
    }

    /// Vertices that start in the layer `below` and triangles between the layers.
    fn count(&self, below: &[f32], above: &[f32]) -> (u64, u64) {
        let mut counts = (0, 0);
        for (x, y) in rows(self.n + 1) {
            counts.0 += u64::from(self.mask(below, above, x, y).count_ones());
            if x < self.n && y < self.n {
                counts.1 += self.cells[usize::from(self.inside(below, above, x, y))].len() as u64;
            }
        }
        counts
    }

    fn layer(&self, below: &[f32], above: &[f32], next: &mut u32) -> Layer {
        let mut layer =
            Layer { masks: Vec::with_capacity(below.len()), first: Vec::with_capacity(below.len()) };
        for (x, y) in rows(self.n + 1) {
            let mask = self.mask(below, above, x, y);
            layer.masks.push(mask);
            layer.first.push(*next);
            *next += mask.count_ones();
        }
        layer
    }

    fn layer_len(&self) -> usize {
        (self.n as usize + 1).pow(2)
    }

    fn at(&self, x: u32, y: u32) -> usize {
        y as usize * (self.n as usize + 1) + x as usize
    }

    /// The field at the grid point that lies `direction` away; outside the grid, the hull's value.
    fn value(&self, below: &[f32], above: &[f32], x: u32, y: u32, direction: u8) -> f32 {
        let (x, y) = (x + u32::from(direction & 1), y + u32::from(direction >> 1 & 1));
        let layer = if direction & 4 == 0 { below } else { above };
        if x > self.n || y > self.n { -1.0 } else { layer[self.at(x, y)] }
    }

    /// Which of the seven edges that start at a grid point are cut.
    fn mask(&self, below: &[f32], above: &[f32], x: u32, y: u32) -> u8 {
        let from = below[self.at(x, y)] > 0.0;
        (1..8)
            .map(|d| u8::from(from != (self.value(below, above, x, y, d) > 0.0)) << (d - 1))
            .fold(0, |mask, bit| mask | bit)
    }

    /// Which corners of a cell are inside.
    fn inside(&self, below: &[f32], above: &[f32], x: u32, y: u32) -> u8 {
        let (a, b) = (self.at(x, y), self.at(x, y + 1));
        let corners =
            [below[a], below[a + 1], below[b], below[b + 1], above[a], above[a + 1], above[b], above[b + 1]];
        (0..8).fold(0, |bits, i| bits | u8::from(corners[i] > 0.0) << i)
    }

    /// A layer of the field; positive is inside, and nothing on the hull of a stack of `nz` cells is.
    fn field(&self, z: u32, nz: u32) -> Vec<f32> {
        fn hull(c: u32, n: u32) -> bool {
            c == 0 || c >= n
        }
        let mut values = Vec::with_capacity(self.layer_len());
        for (x, y) in rows(self.n + 1) {
            let outside = hull(x, self.n) || hull(y, self.n) || hull(z, nz);
            values.push(if outside { -1.0 } else { self.density([x, y, z]) });
        }
        values
    }

    /// A gyroid whose level drifts until it falls to pieces, with noise of a few cells and of one.
    fn density(&self, cell: [u32; 3]) -> f32 {
        let p = cell.map(f64::from);
        let [x, y, z] = p.map(|c| c / Self::PERIOD);
        fn cosine(t: f64) -> f64 {
            wave(t + 0.25)
        }
        let gyroid = wave(x) * cosine(y) + wave(y) * cosine(z) + wave(z) * cosine(x);
        let drift = 1.5 * value3(self.seed, p.map(|c| c / 61.0));
        let rough = 0.9 * value3(self.seed ^ 0x0f0f, p.map(|c| c / 3.7));
        let speckle = 1.8 * (unit(hash(self.seed ^ 0xf0f0, cell.map(i64::from))) - 0.5);
        (gyroid + drift - 0.4 + rough + speckle) as f32
    }
}

/// The places of a square, row by row.
fn rows(n: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..n).flat_map(move |y| (0..n).map(move |x| (x, y)))
}

/// The triangles of a cell for each set of inside corners, facing outward.
fn cell_table() -> Vec<Vec<[Cut; 3]>> {
    // A tetrahedron for each order of the axes, walked from corner 0 to corner 7, and whether the order is odd.
    const ORDERS: [([u8; 3], bool); 6] = [
        ([0, 1, 2], false),
        ([1, 2, 0], false),
        ([2, 0, 1], false),
        ([0, 2, 1], true),
        ([2, 1, 0], true),
        ([1, 0, 2], true),
    ];
    fn cell(inside: usize) -> Vec<[Cut; 3]> {
        let mut triangles = Vec::new();
        for ([a, b, _], odd) in ORDERS {
            add_tetrahedron([0, 1 << a, 1 << a | 1 << b, 7], odd, inside, &mut triangles);
        }
        triangles
    }
    (0..256).map(cell).collect()
}

fn add_tetrahedron(corners: [u8; 4], odd: bool, inside: usize, out: &mut Vec<[Cut; 3]>) {
    let (mut order, outside): (Vec<usize>, Vec<usize>) = (0..4).partition(|i| inside >> corners[*i] & 1 == 1);
    let count_inside = order.len();
    order.extend(outside);
    let inversions = (0..4).flat_map(|i| (0..i).map(move |j| (j, i))).filter(|&(j, i)| order[j] > order[i]);
    let flip = odd ^ (inversions.count() % 2 == 1);
    let mut add = |[a, b, c]: [Cut; 3]| out.push(if flip { [a, c, b] } else { [a, b, c] });
    // In even order: a triangle about the one inside corner faces away from it, and so on.
    match count_inside {
        1 => add([cut(0, 1, &corners, &order), cut(0, 2, &corners, &order), cut(0, 3, &corners, &order)]),
        2 => {
            add([cut(0, 2, &corners, &order), cut(0, 3, &corners, &order), cut(1, 3, &corners, &order)]);
            add([cut(0, 2, &corners, &order), cut(1, 3, &corners, &order), cut(1, 2, &corners, &order)]);
        }
        3 => add([cut(3, 0, &corners, &order), cut(3, 1, &corners, &order), cut(3, 2, &corners, &order)]),
        _ => {}
    }
}

fn cut(i: usize, j: usize, corners: &[u8; 4], order: &[usize]) -> Cut {
    let (from, to) = (corners[order[i].min(order[j])], corners[order[i].max(order[j])]);
    Cut { corner: from, direction: to & !from }
}
