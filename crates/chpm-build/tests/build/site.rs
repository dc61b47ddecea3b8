//! A place to build in, and what must hold for every file that is built there.

use chpm_build::{
    BuildConfig, BuildError, BuildProgress, BuildReport, Cancel, Resources, Settings, Silent, build,
};
use chpm_format::{Chpm, verify};
use chpm_import::ply::{Encoding, PlyWriter, write_mesh};
use chpm_measure::{cracks, weld};
use chpm_mesh::{Bytes, Level, TriMesh};
use chpm_refine::{Cut, extract, random_cut};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::PathBuf;

pub(crate) type ChpmFile = Chpm<Vec<u8>>;

/// A folder with a source in it.
pub(crate) struct Site {
    dir: tempfile::TempDir,
}

impl Site {
    pub(crate) fn empty() -> Self {
        Site { dir: tempfile::tempdir().unwrap() }
    }

    pub(crate) fn of(mesh: &TriMesh) -> Self {
        let site = Site::empty();
        write_mesh(File::create(site.source()).unwrap(), mesh, Encoding::BinaryLittleEndian).unwrap();
        site
    }

    /// A source of double coordinates: the mesh's, moved by `offset`.
    pub(crate) fn of_doubles(mesh: &TriMesh, offset: [f64; 3]) -> Self {
        let site = Site::empty();
        let file = File::create(site.source()).unwrap();
        let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
        let encoding = Encoding::BinaryLittleEndian;
        let mut ply =
            PlyWriter::new(file, encoding, vertices, triangles, mesh.attributes(), true, &[]).unwrap();
        let moved: Vec<[f64; 3]> = mesh.positions.iter().map(|p| moved(*p, offset)).collect();
        ply.vertices_f64(&moved, mesh.view()).unwrap();
        ply.triangles(&mesh.triangles).unwrap();
        ply.finish().unwrap();
        site
    }

    pub(crate) fn source(&self) -> PathBuf {
        self.dir.path().join("mesh.ply")
    }

    pub(crate) fn output(&self) -> PathBuf {
        self.dir.path().join("mesh.chpm")
    }

    /// Names of everything in the folder.
    pub(crate) fn files(&self) -> Vec<String> {
        let name = |e: std::io::Result<fs::DirEntry>| e.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<String> = fs::read_dir(self.dir.path()).unwrap().map(name).collect();
        names.sort();
        names
    }

    pub(crate) fn try_build(
        &self,
        config: &BuildConfig,
        progress: &dyn BuildProgress,
        cancel: &Cancel,
    ) -> Result<BuildReport, BuildError> {
        build(&self.source(), &self.output(), config, progress, cancel)
    }

    /// Builds, looks at what is left in the folder, and takes the output away.
    pub(crate) fn bytes(&self, config: &BuildConfig) -> (BuildReport, Vec<u8>) {
        let report = self.try_build(config, &Silent, &Cancel::default()).unwrap();
        assert_eq!(self.files(), ["mesh.chpm", "mesh.ply"]);
        let bytes = fs::read(self.output()).unwrap();
        assert_eq!(report.output_len, bytes.len() as u64);
        fs::remove_file(self.output()).unwrap();
        (report, bytes)
    }

    /// Builds, and checks all that the file alone can show.
    pub(crate) fn build(&self, config: &BuildConfig) -> (BuildReport, ChpmFile) {
        let (report, bytes) = self.bytes(config);
        let file = Chpm::open(bytes).unwrap();
        let found = verify(&file, |_, _| ());
        assert!(found.is_ok(), "{:#?}", &found.faults[..found.faults.len().min(5)]);
        assert_eq!(report.clusters as usize, file.clusters().len());
        assert_eq!(report.roots as usize, file.roots().count());
        (report, file)
    }
}

/// Two threads and clusters of `cluster_triangles`.
pub(crate) fn config(cluster_triangles: u32) -> BuildConfig {
    let cell_vertices = (cluster_triangles / 64).clamp(4, 48);
    BuildConfig {
        settings: Settings { cluster_triangles, cell_vertices, ..Settings::default() },
        resources: Resources { threads: 2, memory: Bytes::mib(256), ..Resources::default() },
        overwrite: false,
    }
}

pub(crate) fn moved(p: [f32; 3], offset: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| f64::from(p[axis]) + offset[axis])
}

/// Everything that a vertex has, as bits.
pub(crate) type VertexBits = ([u32; 3], [u32; 3], [u8; 4]);

pub(crate) fn vertex_bits(mesh: &TriMesh, v: u32) -> VertexBits {
    let v = v as usize;
    let normal = mesh.normals.get(v).map_or([0; 3], |n| n.map(f32::to_bits));
    (mesh.positions[v].map(f32::to_bits), normal, mesh.colors.get(v).copied().unwrap_or_default())
}

/// The mesh with each face once, as the leaves have it.
pub(crate) fn without_copies(mesh: &TriMesh) -> TriMesh {
    let mut seen = BTreeSet::new();
    let turned = |[a, b, c]: [u32; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min();
    let triangles = mesh.triangles.iter().copied().filter(|t| seen.insert(turned(*t))).collect();
    TriMesh { triangles, ..mesh.clone() }
}

/// The triangles as a sorted multiset of corner bits, each from its least corner in its winding.
pub(crate) fn triangle_bits(mesh: &TriMesh) -> Vec<[VertexBits; 3]> {
    let proper = |[a, b, c]: &&[u32; 3]| a != b && b != c && c != a;
    let rotated = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| vertex_bits(mesh, v));
        [a, b, c].min([b, c, a]).min([c, a, b])
    };
    let mut all: Vec<_> = mesh.triangles.iter().filter(proper).map(rotated).collect();
    all.sort_unstable();
    all
}

/// The mesh of every level, and of some random cuts.
pub(crate) fn levels_of_detail(file: &ChpmFile) -> Vec<TriMesh> {
    let levels = (0..=file.levels().len() as u32).map(|level| Cut::at_level(file, Level(level)));
    let random = (0..6).map(|seed| random_cut(file, seed).unwrap());
    levels.chain(random).map(|cut| extract(file, &cut).unwrap()).collect()
}

/// I1: leaves are the source.
pub(crate) fn check_leaves(file: &ChpmFile, source: &TriMesh) {
    let finest = extract(file, &Cut::at_level(file, Level(0))).unwrap();
    assert!(triangle_bits(&finest) == triangle_bits(source), "the leaves are not the source");
}

/// I1, I7 and I8: leaves are the source, no cut has a crack, no vertex is anything but one of the source's.
pub(crate) fn check_against(file: &ChpmFile, source: &TriMesh) {
    check_leaves(file, source);
    let mut known: Vec<VertexBits> =
        (0..source.positions.len() as u32).map(|v| vertex_bits(source, v)).collect();
    known.sort_unstable();
    let welded = weld(source);
    for lod in levels_of_detail(file) {
        assert!((0..lod.positions.len() as u32).all(|v| known.binary_search(&vertex_bits(&lod, v)).is_ok()));
        assert_eq!(cracks(&weld(&lod), &welded), [], "of {} triangles", lod.triangles.len());
    }
}

/// Edges of an odd number of faces, each from its smaller to its larger vertex, ascending. Faces of two corners in one
/// vertex do not count: a build leaves them out.
fn odd_edges(mesh: &TriMesh) -> Vec<[u32; 2]> {
    let proper = |[a, b, c]: &&[u32; 3]| a != b && b != c && c != a;
    let sides = |[a, b, c]: &[u32; 3]| [[*a, *b], [*b, *c], [*c, *a]].map(|[u, v]| [u.min(v), u.max(v)]);
    let mut edges: Vec<[u32; 2]> = mesh.triangles.iter().filter(proper).flat_map(sides).collect();
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).filter(|same| same.len() % 2 == 1).map(|same| same[0]).collect()
}

/// Positions of the ends of such edges, as bits, ascending.
pub(crate) fn odd_vertices(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let mut places: Vec<[u32; 3]> =
        odd_edges(mesh).concat().iter().map(|v| mesh.positions[*v as usize].map(f32::to_bits)).collect();
    places.sort_unstable();
    places.dedup();
    places
}

/// I7 by parity: edges of an odd number of faces, as positions, that do not run between two of the source's `odd_vertices`.
/// Edges of four faces, which a change of topology makes, let nothing through.
pub(crate) fn leaks(lod: &TriMesh, border: &[[u32; 3]]) -> Vec<[[f32; 3]; 2]> {
    let edges = odd_edges(lod).into_iter().map(|edge| edge.map(|v| lod.positions[v as usize]));
    let is_border = |p: &[f32; 3]| border.binary_search(&p.map(f32::to_bits)).is_ok();
    edges.filter(|edge| !edge.iter().all(is_border)).collect()
}

/// I2: no higher than a balanced tree of that many leaves, with one level more to spare.
pub(crate) fn check_height(file: &ChpmFile) {
    let leaves = file.clusters().iter().filter(|c| c.level == 0).count();
    let height = file.levels().len() - 1;
    assert!(height <= leaves.next_power_of_two().ilog2() as usize + 1, "{leaves} leaves, height {height}");
}

/// The mesh with a normal and a colour for every vertex that no other has.
pub(crate) fn with_attributes(mut mesh: TriMesh) -> TriMesh {
    let count = mesh.positions.len() as u32;
    mesh.normals = (0..count).map(|v| [v as f32, -(v as f32), 0.5]).collect();
    mesh.colors = (0..count).map(|v| (v.wrapping_mul(0x9e37_79b9) | 1).to_le_bytes()).collect();
    mesh
}
