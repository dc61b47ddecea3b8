//! Models that are built for a test, and poses.

use chpm_build::{BuildConfig, Cancel, Resources, Settings, Silent, build};
use chpm_format::Chpm;
use chpm_import::ply::{Encoding, PlyWriter};
use chpm_mesh::{Bytes, TriMesh};
use chpm_proximity::Pose;
use std::fs::{self, File};

/// A mesh, what was added to its positions, and the file that was built of it.
pub(crate) struct Built {
    pub(crate) name: String,
    pub(crate) mesh: TriMesh,
    pub(crate) offset: [f64; 3],
    pub(crate) file: Chpm<Vec<u8>>,
}

/// Settings with small clusters, so that small models have several.
fn small(settings: &Settings) -> Settings {
    Settings { cluster_triangles: 32, cell_vertices: 4, ..settings.clone() }
}

impl Built {
    pub(crate) fn new(name: &str, mesh: TriMesh, offset: [f64; 3], packed: bool) -> Self {
        let moved = mesh.positions.iter().map(|p| [0, 1, 2].map(|axis| f64::from(p[axis]) + offset[axis]));
        let doubles: Option<Vec<[f64; 3]>> = (offset != [0.0; 3]).then(|| moved.collect());
        let settings = small(&Settings { packed, ..Settings::default() });
        Built { offset, ..Built::of(name, mesh, doubles.as_deref(), settings) }
    }

    /// With other positions than the mesh's.
    pub(crate) fn of_doubles(name: &str, mesh: TriMesh, positions: &[[f64; 3]]) -> Self {
        Built::of(name, mesh, Some(positions), small(&Settings::default()))
    }

    /// With clusters of the usual size.
    pub(crate) fn in_large_clusters(name: &str, mesh: TriMesh) -> Self {
        Built::of(name, mesh, None, Settings::default())
    }

    /// By other settings, with clusters that are as small as those of all models here.
    pub(crate) fn with(name: &str, mesh: TriMesh, settings: &Settings) -> Self {
        Built::of(name, mesh, None, small(settings))
    }

    fn of(name: &str, mesh: TriMesh, doubles: Option<&[[f64; 3]]>, settings: Settings) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let (source, output) = (dir.path().join("mesh.ply"), dir.path().join("mesh.chpm"));
        let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
        let mut ply = PlyWriter::new(
            File::create(&source).unwrap(),
            Encoding::BinaryLittleEndian,
            vertices,
            triangles,
            mesh.attributes(),
            doubles.is_some(),
            &[],
        )
        .unwrap();
        match doubles {
            Some(positions) => ply.vertices_f64(positions, mesh.view()).unwrap(),
            None => ply.vertices(mesh.view()).unwrap(),
        }
        ply.triangles(&mesh.triangles).unwrap();
        ply.finish().unwrap();
        let config = BuildConfig {
            settings,
            resources: Resources { threads: 1, memory: Bytes::mib(256), ..Resources::default() },
            overwrite: false,
        };
        build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
        let offset = [0.0; 3];
        Built { name: name.to_owned(), mesh, offset, file: Chpm::open(fs::read(output).unwrap()).unwrap() }
    }

    /// Its triangles in the world, of f64 numbers.
    pub(crate) fn placed(&self, pose: &Pose) -> Vec<[[f64; 3]; 3]> {
        let place = |v: u32| {
            let p = self.mesh.positions[v as usize];
            pose.apply([0, 1, 2].map(|axis| f64::from(p[axis]) + self.offset[axis]))
        };
        self.mesh.triangles.iter().map(|t| t.map(place)).collect()
    }

    pub(crate) fn center(&self) -> [f64; 3] {
        let center = self.file.header().aabb().center();
        [0, 1, 2].map(|axis| center[axis] + self.file.header().origin[axis])
    }

    pub(crate) fn diagonal(&self) -> f64 {
        self.file.header().aabb().diagonal()
    }
}

/// Numbers from a seed.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Random(seed)
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// From -1 to 1.
    pub(crate) fn signed(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A pose in which the middle of `moved` is away from that of `fixed` by up to so many times the sum of their sizes.
    pub(crate) fn pose(&mut self, fixed: &Built, moved: &Built, times: f64) -> Pose {
        let turn = [0; 4].map(|_| self.signed());
        let about = Pose::of_quaternion(turn, [0.0; 3]).unwrap();
        let away = times * 0.5 * (fixed.diagonal() + moved.diagonal());
        let (from, to) = (about.apply(moved.center()), fixed.center());
        let translation = [0, 1, 2].map(|axis| to[axis] - from[axis] + away * self.signed());
        Pose::of_quaternion(turn, translation).unwrap()
    }
}
