//! The sphere as the surface of a box of cells, rounded: no poles, valences 4 to 6 (3 to 6 at the box's corners).

use super::Batch;

/// A box surface of `n[0]` by `n[1]` by `n[2]` cells. Vertices go layer by layer in z: the full bottom, a ring for
/// every layer between, the full top.
#[derive(Clone, Debug)]
pub(super) struct Sphere {
    n: [u32; 3],
}

impl Sphere {
    pub(super) fn new(target: u64) -> Self {
        let quads = target as f64 / 2.0;
        let n = ((quads / 6.0).sqrt().round() as u32).max(1);
        // Two square ends; what they leave is shared by four walls.
        let side = f64::from(n);
        let nz = (((quads - 2.0 * side * side) / (4.0 * side)).round() as u32).max(1);
        Sphere { n: [n, n, nz] }
    }

    pub(super) fn triangle_count(&self) -> u64 {
        let [x, y, z] = self.n.map(u64::from);
        4 * (x * y + y * z + z * x)
    }

    pub(super) fn vertex_count(&self) -> u64 {
        // Closed, genus 0, three edges to two faces.
        self.triangle_count() / 2 + 2
    }

    pub(super) fn vertices<E>(&self, batch: &mut Batch<'_, [f32; 3], E>) -> Result<(), E> {
        let [nx, ny, nz] = self.n;
        for z in 0..=nz {
            if z == 0 || z == nz {
                for y in 0..=ny {
                    for x in 0..=nx {
                        batch.push(self.position([x, y, z]))?;
                    }
                }
            } else {
                for i in 0..2 * (nx + ny) {
                    let [x, y] = self.on_ring(i);
                    batch.push(self.position([x, y, z]))?;
                }
            }
        }
        Ok(())
    }

    pub(super) fn triangles<E>(&self, batch: &mut Batch<'_, [u32; 3], E>) -> Result<(), E> {
        let [nx, ny, nz] = self.n;
        let (ring, full) = (2 * (nx + ny), (nx + 1) * (ny + 1));
        for y in 0..ny {
            for x in 0..nx {
                let a = y * (nx + 1) + x;
                batch.push_quad([a, a + nx + 1, a + nx + 2, a + 1])?;
            }
        }
        for z in 0..nz {
            for i in 0..ring {
                let next = (i + 1) % ring;
                let corners = [(i, z), (next, z), (next, z + 1), (i, z + 1)];
                batch.push_quad(corners.map(|(i, z)| self.around(i, z)))?;
            }
        }
        let top = full + (nz - 1) * ring;
        for y in 0..ny {
            for x in 0..nx {
                let a = top + y * (nx + 1) + x;
                batch.push_quad([a, a + 1, a + nx + 2, a + nx + 1])?;
            }
        }
        Ok(())
    }

    /// The `i`-th vertex around layer `z`.
    fn around(&self, i: u32, z: u32) -> u32 {
        let [nx, ny, nz] = self.n;
        let (ring, full) = (2 * (nx + ny), (nx + 1) * (ny + 1));
        let [x, y] = self.on_ring(i);
        match z {
            0 => y * (nx + 1) + x,
            z if z == nz => full + (nz - 1) * ring + y * (nx + 1) + x,
            z => full + (z - 1) * ring + i,
        }
    }

    /// Where the `i`-th vertex of a ring is, counter-clockwise seen from above.
    fn on_ring(&self, i: u32) -> [u32; 2] {
        let [nx, ny, _] = self.n;
        match i {
            i if i < nx => [i, 0],
            i if i < nx + ny => [nx, i - nx],
            i if i < 2 * nx + ny => [2 * nx + ny - i, ny],
            i => [0, 2 * (nx + ny) - i],
        }
    }

    /// The smooth map from the cube [-1, 1]^3 to the ball that takes its surface to the sphere.
    fn position(&self, cell: [u32; 3]) -> [f32; 3] {
        let c: [f64; 3] = std::array::from_fn(|a| 2.0 * f64::from(cell[a]) / f64::from(self.n[a]) - 1.0);
        let [x, y, z] = c.map(|c| c * c);
        fn root(a: f64, b: f64) -> f64 {
            (1.0 - a / 2.0 - b / 2.0 + a * b / 3.0).sqrt()
        }
        [c[0] * root(y, z), c[1] * root(z, x), c[2] * root(x, y)].map(|c| c as f32)
    }
}
