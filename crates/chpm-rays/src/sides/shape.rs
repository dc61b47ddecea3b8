//! Sums over the triangles of a component.

use chpm_mesh::Aabb;

/// Sums of triangles, in any order but for rounding.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    bounds: Aabb,
    /// Six times the signed volume of the cones from the file's origin.
    volume: f64,
    /// Twice the sum of the area vectors.
    area: [f64; 3],
    /// Twice the area.
    size: f64,
    /// Edges, each way as the other's negative: zero where all cancel.
    edges: u64,
    /// The vertices that are farthest ahead and farthest back, and how far that is.
    pub(super) far: [[f32; 3]; 2],
    pub(super) reach: [f64; 2],
    pub(super) triangles: u64,
}

/// A direction that no flat part of a model is likely to have.
pub(super) const AHEAD: [f64; 3] = [0.299_792_458, 0.662_607_015, 0.686_329_174];
/// So many times larger is the box about all of whose points the volume of what is open must have one sign.
const SURE: f64 = 4.0;
/// Share of area and size that rounding leaves of no volume.
const ROUNDED: f64 = 1e-12;

impl Shape {
    pub(super) const EMPTY: Shape = Shape {
        bounds: Aabb::EMPTY,
        volume: 0.0,
        area: [0.0; 3],
        size: 0.0,
        edges: 0,
        far: [[0.0; 3]; 2],
        reach: [f64::NEG_INFINITY; 2],
        triangles: 0,
    };

    /// Takes a triangle; keys are those of its corners.
    pub(super) fn add(&mut self, corners: [[f32; 3]; 3], keys: [u64; 3]) {
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
        let area = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        self.volume += dot(a, area);
        self.size += dot(area, area).sqrt();
        self.area = [0, 1, 2].map(|axis| self.area[axis] + area[axis]);
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            self.edges = self.edges.wrapping_add(edge(keys[from], keys[to]));
        }
        for corner in corners {
            self.bounds.add(corner);
            let reach = dot(corner.map(f64::from), AHEAD);
            self.reached([corner; 2], [reach, -reach]);
        }
        self.triangles += 1;
    }

    /// Both together.
    pub(super) fn with(mut self, other: &Shape) -> Self {
        self.reached(other.far, other.reach);
        self.bounds.merge(&other.bounds);
        self.volume += other.volume;
        self.size += other.size;
        self.area = [0, 1, 2].map(|axis| self.area[axis] + other.area[axis]);
        self.edges = self.edges.wrapping_add(other.edges);
        self.triangles += other.triangles;
        self
    }

    /// Whether each edge is gone along as often one way as the other.
    pub(super) fn is_closed(&self) -> bool {
        self.edges == 0
    }

    /// Whether it is turned inside out; nothing where it has no inside.
    pub(super) fn is_turned(&self) -> Option<bool> {
        let (low, high) = (self.bounds.min.map(f64::from), self.bounds.max.map(f64::from));
        let middle = [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]));
        let volume = self.volume - dot(middle, self.area);
        let half = [0, 1, 2].map(|axis| 0.5 * (high[axis] - low[axis]));
        let open: f64 =
            if self.is_closed() { 0.0 } else { (0..3).map(|axis| self.area[axis].abs() * half[axis]).sum() };
        let far = low.iter().chain(&high).fold(0.0_f64, |far, x| far.max(x.abs()));
        let is_sure = volume.abs() > SURE * open + ROUNDED * self.size * far;
        is_sure.then_some(volume < 0.0)
    }

    /// Whether another one's box has this one's.
    pub(super) fn is_in_box_of(&self, other: &Shape) -> bool {
        let [own, other] = [&self.bounds, &other.bounds];
        (0..3).all(|axis| other.min[axis] <= own.min[axis] && own.max[axis] <= other.max[axis])
    }

    fn reached(&mut self, at: [[f32; 3]; 2], reach: [f64; 2]) {
        for way in 0..2 {
            if reach[way] > self.reach[way] {
                (self.far[way], self.reach[way]) = (at[way], reach[way]);
            }
        }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Mixes bits, as splitmix64 does.
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A number for a position: one for both zeros.
pub(super) fn key(position: &[f32; 3]) -> u64 {
    let [x, y, z] = position.map(|x| u64::from((x + 0.0).to_bits()));
    mix(mix(x << 32 | y).wrapping_add(0x9e37_79b9_7f4a_7c15).wrapping_add(z))
}

/// A number for an edge, the negative of that for the other way.
fn edge(from: u64, to: u64) -> u64 {
    let both = mix(mix(from.min(to)).wrapping_add(from.max(to)));
    if from < to {
        both
    } else if to < from {
        both.wrapping_neg()
    } else {
        0
    }
}
