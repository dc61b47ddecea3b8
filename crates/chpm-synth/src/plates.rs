//! Drilled plates as a CAD program tessellates them: flat faces of long thin triangles between few sharp edges.
//!
//! A plate is a row of unit squares with a round hole each. Every side of a square has `q` segments and every hole `4q`,
//! joined by radial quads; holes are in turn wide and so narrow that their triangles are slivers. A plate with
//! `h` holes is closed and has genus `h`.

use super::{Batch, noise::hash};

/// `count` plates, a multiple of four; the number `p` has `1 + p % 4` holes.
#[derive(Clone, Debug)]
pub(super) struct Plates {
    seed: u64,
    count: u64,
    q: u32,
}

/// One plate: how many holes, and the segments of a square's side.
#[derive(Clone, Copy)]
struct Plate {
    holes: u32,
    q: u32,
}

impl Plates {
    const THICKNESS: f64 = 0.1;
    /// A hole's edges are this long at the narrow holes, whose triangles are about 0.5 long.
    const NARROW_EDGE: f64 = 3e-4;
    const WIDE_RADIUS: f64 = 0.35;
    /// Segments of a side in a large mesh.
    const Q: u64 = 64;

    pub(super) fn new(target: u64, seed: u64) -> Self {
        let four = (0..4).map(|p| Plates { seed, count: 4, q: 1 }.plate(p).triangle_count()).sum::<u64>();
        let count = 4 * (target / (four * Self::Q)).max(1);
        let mut plates = Plates { seed, count, q: 1 };
        // Every term of a plate's count is a multiple of q.
        let unit = plates.triangle_count();
        plates.q = ((target + unit / 2) / unit).clamp(1, 1 << 12) as u32;
        plates
    }

    fn plate(&self, number: u64) -> Plate {
        Plate { holes: 1 + (number % 4) as u32, q: self.q }
    }

    pub(super) fn triangle_count(&self) -> u64 {
        (0..self.count).map(|p| self.plate(p).triangle_count()).sum()
    }

    pub(super) fn vertex_count(&self) -> u64 {
        (0..self.count).map(|p| 2 * u64::from(self.plate(p).layer_len())).sum()
    }

    pub(super) fn vertices<E>(&self, batch: &mut Batch<'_, [f32; 3], E>) -> Result<(), E> {
        let side = libm::cbrt(self.count as f64).ceil() as u64;
        for number in 0..self.count {
            let plate = self.plate(number);
            let cell = [number % side, number / side % side, number / (side * side)];
            // A cyclic change of axes turns the plate without mirroring it.
            let turn = hash(self.seed, [number as i64, 0, 0]) as usize % 3;
            let place =
                |p: [f64; 3]| std::array::from_fn(|a| (5.0 * cell[a] as f64 + p[(a + turn) % 3]) as f32);
            for z in [0.0, Self::THICKNESS] {
                plate.outline(&mut |[x, y]| batch.push(place([x, y, z])))?;
                for square in 0..plate.holes {
                    let narrow = Self::NARROW_EDGE * f64::from(4 * self.q) / std::f64::consts::TAU;
                    let is_wide = (u64::from(square) + number) % 2 == 1;
                    let radius = if is_wide { Self::WIDE_RADIUS } else { narrow.min(Self::WIDE_RADIUS) };
                    for k in 0..4 * self.q {
                        let [x, y] = plate.on_square(k).map(|c| c - 0.5);
                        let scale = radius / (x * x + y * y).sqrt();
                        batch.push(place([f64::from(square) + 0.5 + scale * x, 0.5 + scale * y, z]))?;
                    }
                }
            }
        }
        Ok(())
    }

    pub(super) fn triangles<E>(&self, batch: &mut Batch<'_, [u32; 3], E>) -> Result<(), E> {
        let mut base = 0;
        for number in 0..self.count {
            let plate = self.plate(number);
            plate.triangles(base, batch)?;
            base += 2 * plate.layer_len();
        }
        Ok(())
    }
}

impl Plate {
    fn triangle_count(self) -> u64 {
        let (h, q) = (u64::from(self.holes), u64::from(self.q));
        // Two faces of 4q quads per hole, a wall of 4q per hole, the outer wall.
        2 * (8 * q * h + 4 * q * h + 2 * q * h + 2 * q)
    }

    /// Vertices of one face: the lines across, the sides between them, the holes.
    fn layer_len(self) -> u32 {
        let Plate { holes: h, q } = self;
        (h + 1) * (q + 1) + 2 * h * (q - 1) + 4 * q * h
    }

    /// The `k`-th of the `4q` points around the unit square, counter-clockwise from its origin.
    fn on_square(self, k: u32) -> [f64; 2] {
        let t = f64::from(k % self.q) / f64::from(self.q);
        match k / self.q {
            0 => [t, 0.0],
            1 => [1.0, t],
            2 => [1.0 - t, 1.0],
            _ => [0.0, 1.0 - t],
        }
    }

    /// Emits the points of the squares' sides in the order that [`Self::on_outline`] numbers them.
    fn outline<E>(self, emit: &mut dyn FnMut([f64; 2]) -> Result<(), E>) -> Result<(), E> {
        let q = f64::from(self.q);
        for line in 0..=self.holes {
            for j in 0..=self.q {
                emit([f64::from(line), f64::from(j) / q])?;
            }
        }
        for square in 0..self.holes {
            for y in [0.0, 1.0] {
                for i in 1..self.q {
                    emit([f64::from(square) + f64::from(i) / q, y])?;
                }
            }
        }
        Ok(())
    }

    /// The vertex at the `k`-th point around a square.
    fn on_outline(self, square: u32, k: u32) -> u32 {
        let q = self.q;
        fn line(line: u32, j: u32, q: u32) -> u32 {
            line * (q + 1) + j
        }
        fn side(top: u32, i: u32, square: u32, q: u32, holes: u32) -> u32 {
            match i {
                0 => line(square, top * q, q),
                i if i == q => line(square + 1, top * q, q),
                i => (holes + 1) * (q + 1) + (2 * square + top) * (q - 1) + i - 1,
            }
        }
        let i = k % q;
        match k / q % 4 {
            0 => side(0, i, square, q, self.holes),
            1 => line(square + 1, i, q),
            2 => side(1, q - i, square, q, self.holes),
            _ => line(square, q - i, q),
        }
    }

    fn on_hole(self, square: u32, k: u32) -> u32 {
        self.layer_len() - 4 * self.q * (self.holes - square) + k % (4 * self.q)
    }

    fn triangles<E>(self, base: u32, batch: &mut Batch<'_, [u32; 3], E>) -> Result<(), E> {
        let up = self.layer_len();
        for square in 0..self.holes {
            for k in 0..4 * self.q {
                let [a, b] = [k, k + 1].map(|k| base + self.on_outline(square, k));
                let [c, d] = [k, k + 1].map(|k| base + self.on_hole(square, k));
                batch.push_quad([a, c, d, b])?;
                batch.push_quad([up + a, up + b, up + d, up + c])?;
                batch.push_quad([d, c, up + c, up + d])?;
                let is_outside = match k / self.q {
                    1 => square + 1 == self.holes,
                    3 => square == 0,
                    _ => true,
                };
                if is_outside {
                    batch.push_quad([a, b, up + b, up + a])?;
                }
            }
        }
        Ok(())
    }
}
