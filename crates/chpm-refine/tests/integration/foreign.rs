//! A reader written from FORMAT.md alone, over the bytes alone.

use crate::select::any_plan;
use crate::strips::{File, LOPSIDED, MORE};
use chpm_mesh::Level;
use chpm_refine::{Camera, Cut, Hierarchy, View, select};
use proptest::prelude::*;

/// Tables and pages by their offsets.
struct Reader(Vec<u8>);

/// A group's members, level, error and sphere.
struct Group {
    coarse: Vec<usize>,
    fine: Vec<usize>,
    level: u32,
    min_error: f32,
    center: [f64; 3],
    radius: f64,
}

impl Reader {
    fn u16(&self, at: usize) -> usize {
        usize::from(u16::from_le_bytes([self.0[at], self.0[at + 1]]))
    }

    fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(std::array::from_fn(|i| self.0[at + i]))
    }

    fn u64(&self, at: usize) -> usize {
        u64::from_le_bytes(std::array::from_fn(|i| self.0[at + i])) as usize
    }

    fn f32(&self, at: usize) -> f32 {
        f32::from_bits(self.u32(at))
    }

    fn point(&self, at: usize) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(self.f32(at + 4 * axis)))
    }

    /// Where the section of a kind starts.
    fn section(&self, kind: u32) -> usize {
        let entries = (0..self.u32(32) as usize).map(|entry| 256 + 40 * entry);
        entries.filter(|at| self.u32(*at) == kind).map(|at| self.u64(at + 8)).next().unwrap()
    }

    fn cluster(&self, id: usize) -> usize {
        self.section(1) + 128 * id
    }

    fn group(&self, id: usize) -> Group {
        let (at, members) = (self.section(2) + 64 * id, self.section(3));
        let ids = |first: usize, count: usize| {
            let places =
                (0..self.u32(at + count) as usize).map(|i| members + 4 * (self.u32(at + first) as usize + i));
            places.map(|place| self.u32(place) as usize).collect()
        };
        Group {
            coarse: ids(0, 4),
            fine: ids(8, 12),
            level: self.u32(at + 16),
            min_error: self.f32(at + 24),
            center: self.point(at + 32),
            radius: f64::from(self.f32(at + 44)),
        }
    }

    /// The cut, by replacing groups as long as one is wanted.
    fn refine(&self, wanted: impl Fn(usize, &Group) -> bool) -> Vec<usize> {
        let none = u32::MAX;
        let mut cut: Vec<usize> =
            (0..self.u32(64) as usize).filter(|id| self.u32(self.cluster(*id) + 40) == none).collect();
        loop {
            let groups = (0..self.u32(68) as usize).map(|id| (id, self.group(id)));
            let whole = |group: &Group| group.coarse.iter().all(|id| cut.contains(id));
            let Some((_, group)) =
                groups.into_iter().find(|(id, g)| !g.fine.is_empty() && whole(g) && wanted(*id, g))
            else {
                return cut;
            };
            cut.retain(|id| !group.coarse.contains(id));
            cut.extend(&group.fine);
        }
    }

    /// Triangles of a cluster within an error, or at its base or finest mesh.
    fn triangles(&self, id: usize, bound: f32) -> u64 {
        let page = self.u64(self.cluster(id));
        let [vertices, base, count] = [8, 12, 16].map(|at| self.u32(page + at) as usize);
        let (shared, scale) = (self.u32(page + 24) as usize, self.f32(page + 32));
        let attributes = self.u16(page + 6);
        let of_vertices = 12 + 12 * (attributes & 1) + 4 * (attributes >> 1 & 1);
        let triangles = page + 64 + of_vertices * vertices + 4 * shared;
        let (targets, codes) = (triangles + 6 * count, triangles + 6 * count + 2 * (vertices - base));
        let error = |n: usize| match self.u16(codes + 2 * (n - base)) as u32 {
            0 => 0.0,
            code => scale * f32::from_bits(f32::exp2(-31.0).to_bits() + ((code - 1) << 12)),
        };
        let n = (base..vertices).find(|n| error(*n) <= bound).unwrap_or(vertices);
        let mut place: Vec<usize> = (0..vertices).collect();
        for i in n..vertices {
            place[i] = place[self.u16(targets + 2 * (i - base))];
        }
        let alive = |t: &usize| {
            let [a, b, c] = [0, 2, 4].map(|corner| place[self.u16(triangles + 6 * t + corner)]);
            a != b && b != c && c != a
        };
        (0..count).filter(alive).count() as u64
    }

    fn count(&self, cut: &[usize], bound: impl Fn(usize) -> f32) -> u64 {
        cut.iter().map(|id| self.triangles(*id, bound(self.u32(self.cluster(*id) + 36) as usize))).sum()
    }

    /// The box of a group: its coarse clusters' and those of all below.
    fn bounds(&self, id: usize) -> [[f64; 3]; 2] {
        let group = self.group(id);
        let own = group.coarse.iter().map(|id| [56, 68].map(|at| self.point(self.cluster(*id) + at)));
        let below = group.fine.iter().map(|id| self.bounds(self.u32(self.cluster(*id) + 36) as usize));
        let wider = |[a, b]: [[f64; 3]; 2], [c, d]: [[f64; 3]; 2]| {
            [std::array::from_fn(|x| a[x].min(c[x])), std::array::from_fn(|x| b[x].max(d[x]))]
        };
        own.chain(below).reduce(wider).unwrap()
    }
}

fn bytes(file: File) -> Reader {
    Reader(file.into_inner())
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn levels_and_uniform_bounds() {
    for plan in MORE.into_iter().chain([LOPSIDED]) {
        let (file, reader) = (plan.build(), bytes(plan.build()));
        for level in 0..5 {
            let cut = reader.refine(|_, group| group.level > level);
            let whole = |id: usize| reader.group(id).coarse.iter().all(|id| cut.contains(id));
            let got = reader.count(&cut, |group| if whole(group) { -1.0 } else { f32::INFINITY });
            let expected = Cut::at_level(&file, Level(level)).triangle_count(&file).unwrap();
            assert_eq!(got, expected, "{plan:?} at level {level}");
        }
        for step in 0..60 {
            let bound = step as f32 / 4.0;
            let cut = reader.refine(|_, group| bound < group.min_error);
            let expected = Cut::at_error(&file, bound).unwrap().triangle_count(&file).unwrap();
            assert_eq!(reader.count(&cut, |_| bound), expected, "{plan:?} at {bound}");
        }
    }
}

proptest! {
    #[test]
    fn bounds_of_cameras(
        plan in any_plan(),
        eye in [-20.0..60.0, -20.0..30.0, -40.0..40.0],
        near in prop_oneof![Just(0.0), 0.0..9.0],
        pixels in -9.0..9.0,
        fov in 5.0..120.0,
    ) {
        let (file, reader) = (plan.build(), bytes(plan.build()));
        let (eye, pixels): ([f64; 3], f64) = (eye, f64::exp2(pixels));
        let rows = 64.0;
        let bound = |id: usize| {
            let (group, [low, high]) = (reader.group(id), reader.bounds(id));
            let to_box: [f64; 3] = std::array::from_fn(|a| eye[a].clamp(low[a], high[a]));
            let reach = (distance(group.center, eye) - group.radius).max(distance(to_box, eye)).max(near);
            pixels * (2.0 * f64::tan(f64::to_radians(fov) / 2.0) / rows) * reach
        };
        let cut = reader.refine(|id, group| bound(id) < f64::from(group.min_error));
        let got = reader.count(&cut, |id| bound(id) as f32);
        let camera = Camera { fov, near, ..Camera::looking(eye, [eye[0], eye[1] + 1.0, eye[2]]) };
        let view = View::new(&camera, [99, 64], pixels).unwrap();
        let expected = select(&file, &Hierarchy::new(&file), &view).unwrap();
        prop_assert_eq!(got, expected.triangle_count(&file).unwrap());
    }
}
