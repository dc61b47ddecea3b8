//! Shapes over a rectangle of quads: the terrain, which is open, and the torus, which wraps both ways.

use super::{
    Batch,
    noise::{turn, value2},
};

/// Columns and rows of quads, two triangles each.
#[derive(Clone, Copy, Debug)]
struct Quads {
    nx: u32,
    ny: u32,
}

impl Quads {
    /// `nx` about `aspect * ny`, each at least `least`, with about `target` triangles.
    fn new(target: u64, aspect: f64, least: u32) -> Self {
        let quads = target as f64 / 2.0;
        let nx = ((quads * aspect).sqrt().round() as u32).max(least);
        let ny = ((quads / f64::from(nx)).round() as u32).max(least);
        Quads { nx, ny }
    }

    fn triangle_count(self) -> u64 {
        2 * u64::from(self.nx) * u64::from(self.ny)
    }
}

/// Value noise summed over octaves, down to features of a few quads.
#[derive(Clone, Debug)]
pub(super) struct Terrain {
    quads: Quads,
    seed: u64,
}

impl Terrain {
    const HEIGHT: f64 = 0.2;

    pub(super) fn new(target: u64, seed: u64) -> Self {
        Terrain { quads: Quads::new(target, 1.0, 1), seed }
    }

    pub(super) fn vertex_count(&self) -> u64 {
        (u64::from(self.quads.nx) + 1) * (u64::from(self.quads.ny) + 1)
    }

    pub(super) fn triangle_count(&self) -> u64 {
        self.quads.triangle_count()
    }

    pub(super) fn vertices<E>(&self, batch: &mut Batch<'_, [f32; 3], E>) -> Result<(), E> {
        let Quads { nx, ny } = self.quads;
        let step = 1.0 / f64::from(nx.max(ny));
        let octaves = libm::log2(f64::from(nx.max(ny)) / 8.0).floor().max(1.0) as u64;
        for y in 0..=ny {
            for x in 0..=nx {
                let point = [f64::from(x) * step, f64::from(y) * step];
                let height = Self::HEIGHT * self.height(point, octaves);
                batch.push([point[0], point[1], height].map(|c| c as f32))?;
            }
        }
        Ok(())
    }

    /// In [-1, 1]: every octave halves the features; the gentle gain keeps fine octaves rough.
    fn height(&self, point: [f64; 2], octaves: u64) -> f64 {
        let (mut sum, mut gain, mut scale) = (0.0, 0.5, 3.0);
        for octave in 0..octaves {
            // Odd shifts keep the octaves' lattices from lining up.
            let shift = 0.37 * octave as f64;
            let seed = self.seed.wrapping_add(octave.wrapping_mul(0x51_7cc1_b727_220b));
            sum += gain * value2(seed, point.map(|c| scale * c + shift));
            gain *= 0.48;
            scale *= 2.0;
        }
        sum
    }

    pub(super) fn triangles<E>(&self, batch: &mut Batch<'_, [u32; 3], E>) -> Result<(), E> {
        let Quads { nx, ny } = self.quads;
        let row = nx + 1;
        for y in 0..ny {
            for x in 0..nx {
                let a = y * row + x;
                batch.push_quad([a, a + 1, a + row + 1, a + row])?;
            }
        }
        Ok(())
    }
}

/// A tube of radius 0.4 about the unit circle.
#[derive(Clone, Debug)]
pub(super) struct Torus {
    quads: Quads,
}

impl Torus {
    const TUBE: f64 = 0.4;

    pub(super) fn new(target: u64) -> Self {
        Torus { quads: Quads::new(target, Self::TUBE, 3) }
    }

    pub(super) fn vertex_count(&self) -> u64 {
        u64::from(self.quads.nx) * u64::from(self.quads.ny)
    }

    pub(super) fn triangle_count(&self) -> u64 {
        self.quads.triangle_count()
    }

    /// Row by row around the circle; columns go around the tube.
    pub(super) fn vertices<E>(&self, batch: &mut Batch<'_, [f32; 3], E>) -> Result<(), E> {
        let Quads { nx, ny } = self.quads;
        for y in 0..ny {
            let (cos, sin) = turn(f64::from(y) / f64::from(ny));
            for x in 0..nx {
                let (out, up) = turn(f64::from(x) / f64::from(nx));
                let reach = 1.0 + Self::TUBE * out;
                batch.push([reach * cos, reach * sin, Self::TUBE * up].map(|c| c as f32))?;
            }
        }
        Ok(())
    }

    pub(super) fn triangles<E>(&self, batch: &mut Batch<'_, [u32; 3], E>) -> Result<(), E> {
        let Quads { nx, ny } = self.quads;
        for y in 0..ny {
            let next_y = (y + 1) % ny;
            for x in 0..nx {
                let next_x = (x + 1) % nx;
                fn at(x: u32, y: u32, nx: u32) -> u32 {
                    y * nx + x
                }
                batch.push_quad([
                    at(x, y, nx),
                    at(x, next_y, nx),
                    at(next_x, next_y, nx),
                    at(next_x, y, nx),
                ])?;
            }
        }
        Ok(())
    }
}
