//! Files and rays for tests.

use chpm_build::{BuildConfig, Cancel, Resources, Settings, Silent, build};
use chpm_format::Chpm;
use chpm_import::ply::{Encoding, write_mesh};
use chpm_mesh::{Bytes, ClusterId, Places, TriMesh};
use chpm_rays::{Bound, Caster, Hit, Memory, Ray, Seek};
use std::fs;

pub(crate) type File = Chpm<Vec<u8>>;
pub(crate) type Corners = [[f32; 3]; 3];

pub(crate) fn built(mesh: &TriMesh) -> File {
    let folder = tempfile::tempdir().unwrap();
    let (source, output) = (folder.path().join("in.ply"), folder.path().join("in.chpm"));
    write_mesh(fs::File::create(&source).unwrap(), mesh, Encoding::BinaryLittleEndian).unwrap();
    let config = BuildConfig {
        settings: Settings { cluster_triangles: 64, cell_vertices: 4, ..Settings::default() },
        resources: Resources { threads: 1, memory: Bytes::mib(256), ..Resources::default() },
        overwrite: false,
    };
    build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
    Chpm::open(fs::read(output).unwrap()).unwrap()
}

pub(crate) const ROOM: Memory = Memory::new(Bytes(1 << 30), 1 << 20);

pub(crate) fn cast(file: &File, rays: &[Ray], bound: &Bound, seek: Seek) -> Vec<(Option<Hit>, f64)> {
    cast_in(file, rays, bound, seek, ROOM).0
}

pub(crate) fn cast_in(
    file: &File,
    rays: &[Ray],
    bound: &Bound,
    seek: Seek,
    memory: Memory,
) -> (Vec<(Option<Hit>, f64)>, chpm_rays::Reads) {
    let mut caster = Caster::new(file, memory);
    let mut all = Vec::new();
    caster.cast(rays, bound, seek, &|| true, |hit, distance| all.push((hit, distance))).unwrap();
    (all, caster.reads())
}

/// The triangles that a uniform bound stands for, found without a tree: a cluster's base mesh if its group keeps to the bound and the group above does not, a leaf's finest
/// mesh if its group does not.
pub(crate) fn mesh_within(file: &File, error: f64) -> Vec<(Corners, u32, u32)> {
    let splits = |group: chpm_mesh::GroupId| {
        group.is_some() && f64::from(file.groups()[group.index()].max_error) > error
    };
    let mut all = Vec::new();
    for (cluster, record) in (0..).zip(file.clusters()) {
        let is_above = !record.parent_group().is_some() || splits(record.parent_group());
        let own = splits(record.group());
        let is_there = (is_above && !own) || (own && record.is_leaf());
        if !is_there {
            continue;
        }
        let page = file.page(ClusterId(cluster)).unwrap();
        let page = page.view();
        let n = if own { page.vertex_count() } else { page.base_vertex_count };
        let mut places = Places::default();
        places.go_to(&page.progressive_mesh(), n);
        for (place, corners) in (0..).zip(page.triangles) {
            let corners = corners.map(|v| places.of(v));
            if chpm_mesh::pm::is_alive(&corners) {
                all.push((corners.map(|v| page.positions[usize::from(v)]), cluster, place));
            }
        }
    }
    all
}

/// Numbers that look random and are the same everywhere.
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    pub(crate) fn number(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// From 0 to 1.
    pub(crate) fn share(&mut self) -> f64 {
        (self.number() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.number() % count.max(1) as u64) as usize
    }
}

pub(crate) fn less(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Rays of many kinds at some triangles: from far and near, along axes, at vertices, edges and faces, and anywhere.
pub(crate) fn rays_at(triangles: &[(Corners, u32, u32)], count: usize, seed: u64) -> Vec<Ray> {
    let mut dice = Dice(seed);
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for corner in triangles.iter().flat_map(|(corners, ..)| corners) {
        for axis in 0..3 {
            low[axis] = low[axis].min(f64::from(corner[axis]));
            high[axis] = high[axis].max(f64::from(corner[axis]));
        }
    }
    let size = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let size = if size > 0.0 { size } else { 1.0 };
    let place = |dice: &mut Dice, wider: f64| -> [f64; 3] {
        std::array::from_fn(|axis| {
            let wide = high[axis] - low[axis] + 2.0 * wider * size;
            // As f32, so that differences are nearly exact.
            f64::from((low[axis] - wider * size + wide * dice.share()) as f32)
        })
    };
    let mut rays = Vec::new();
    for number in 0..count {
        let origin = place(&mut dice, [0.0, 0.5, 20.0][number % 3]);
        let (corners, ..) = triangles[dice.below(triangles.len())];
        let corners = corners.map(|corner| corner.map(f64::from));
        let target: [f64; 3] = match number % 5 {
            0 => corners[dice.below(3)],
            1 => {
                let share = dice.share();
                std::array::from_fn(|i| corners[0][i] + share * (corners[1][i] - corners[0][i]))
            }
            2 => std::array::from_fn(|i| (corners[0][i] + corners[1][i] + corners[2][i]) / 3.0),
            3 => place(&mut dice, 0.1),
            _ => {
                let axis = dice.below(3);
                let mut to = corners[dice.below(3)];
                to[axis] = low[axis] - size;
                let mut from = to;
                from[axis] = high[axis] + size;
                rays.push(Ray::new(from, less(to, from)));
                continue;
            }
        };
        let direction = less(target, origin);
        if direction.iter().any(|x| *x != 0.0) {
            let mut ray = Ray::new(origin, direction);
            if number % 7 == 0 {
                ray.reach = size * dice.share();
            }
            rays.push(ray);
        }
    }
    rays
}
