//! Generated models and the ways that a camera goes about them.

use chpm_build::{BuildConfig, Cancel, Settings, Silent, build};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_import::ply::{Encoding, PlyWriter};
use chpm_mesh::TriMesh;
use chpm_refine::{Camera, CameraPath};
use chpm_synth::{Shape, Synth, hand};
use std::fs::File;
use std::path::PathBuf;
use tempfile::TempDir;

/// A built file in a folder that goes with it.
pub(crate) struct Model {
    dir: TempDir,
}

impl Model {
    /// Builds a mesh, with clusters small enough that there are many.
    pub(crate) fn of(mesh: &TriMesh, cluster_triangles: u32) -> Self {
        Self::far(mesh, [0.0; 3], cluster_triangles)
    }

    /// The same of a mesh moved by `offset`, in double precision.
    pub(crate) fn far(mesh: &TriMesh, offset: [f64; 3], cluster_triangles: u32) -> Self {
        Self::built(mesh, offset, Settings { cluster_triangles, ..Settings::default() })
    }

    /// The same with any settings.
    pub(crate) fn built(mesh: &TriMesh, offset: [f64; 3], settings: Settings) -> Self {
        let model = Model { dir: tempfile::tempdir().expect("a temporary folder") };
        let source = model.dir.path().join("model.ply");
        let file = File::create(&source).expect("a file created");
        let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
        let is_far = offset != [0.0; 3];
        let encoding = Encoding::BinaryLittleEndian;
        let mut ply = PlyWriter::new(file, encoding, vertices, triangles, mesh.attributes(), is_far, &[])
            .expect("a PLY");
        if is_far {
            let moved = |p: &[f32; 3]| std::array::from_fn(|axis| offset[axis] + f64::from(p[axis]));
            let positions: Vec<[f64; 3]> = mesh.positions.iter().map(moved).collect();
            ply.vertices_f64(&positions, mesh.view()).expect("vertices written");
        } else {
            ply.vertices(mesh.view()).expect("vertices written");
        }
        ply.triangles(&mesh.triangles).expect("triangles written");
        ply.finish().expect("a PLY written");
        let config = BuildConfig { settings, ..BuildConfig::default() };
        build(&source, &model.path(), &config, &Silent, &Cancel::default()).expect("a model built");
        model
    }

    /// Of a generated shape.
    pub(crate) fn synth(shape: Shape, triangles: u64, cluster_triangles: u32) -> Self {
        Self::of(&Synth::new(shape, triangles, 1).to_mesh(), cluster_triangles)
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.dir.path().join("model.chpm")
    }

    pub(crate) fn open(&self) -> Chpm<MappedFile> {
        Chpm::open(MappedFile::open(&self.path()).expect("a map")).expect("a file")
    }
}

/// All of a mesh, scaled and moved, behind what is there.
fn add(all: &mut TriMesh, mesh: &TriMesh, scale: f32, by: [f32; 3]) {
    let first = all.positions.len() as u32;
    let moved = |p: &[f32; 3]| std::array::from_fn(|axis| scale * p[axis] + by[axis]);
    all.positions.extend(mesh.positions.iter().map(moved));
    all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| first + v)));
}

/// Spheres in each other: from outside, only one is seen.
pub(crate) fn shells() -> Model {
    let sphere = Synth::new(Shape::Sphere, 3000, 1).to_mesh();
    let mut all = TriMesh::default();
    for scale in [1.0, 0.8, 0.6, 0.4] {
        add(&mut all, &sphere, scale, [0.0; 3]);
    }
    Model::of(&all, 128)
}

/// A wall, and behind it many parts. It is at the z of a camera's side that looks at the whole.
pub(crate) fn wall() -> Model {
    let mut all = TriMesh::default();
    // The unit square, in quads.
    let grid = hand::grid(40, 40);
    let side = grid.positions.iter().flatten().copied().fold(0.0, f32::max);
    add(&mut all, &grid, 8.0 / side, [-4.0, -4.0, 3.0]);
    let part = Synth::new(Shape::Torus, 400, 1).to_mesh();
    for place in 0..27_u16 {
        let at = [place % 3, place / 3 % 3, place / 9].map(|n| 2.4 * (f32::from(n) - 1.0));
        add(&mut all, &part, 0.8, [at[0], at[1], at[2] - 1.0]);
    }
    Model::of(&all, 128)
}

/// Open, with hills that hide valleys.
pub(crate) fn terrain() -> Model {
    Model::synth(Shape::Terrain, 10_000, 128)
}

/// High genus, many components.
pub(crate) fn isosurface() -> Model {
    Model::synth(Shape::Isosurface, 12_000, 128)
}

/// Where single precision has steps of a sixteenth, or half a unit.
pub(crate) fn far_away() -> Model {
    Model::far(&Synth::new(Shape::Isosurface, 8_000, 2).to_mesh(), [1e6, -4e6, 3e5], 128)
}

/// The least model.
pub(crate) fn triangle() -> Model {
    Model::of(&TriMesh::new(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.8, 0.1]], vec![[0, 1, 2]]), 128)
}

/// Around, towards, and from one place to any other, in the model's coordinates.
pub(crate) fn cameras(file: &Chpm<MappedFile>, each: usize) -> Vec<Camera> {
    let header = file.header();
    let bounds = header.aabb();
    let page = file.page(file.roots().next().expect("a root")).expect("a sound page");
    let page = page.view();
    let point = page.positions[page.base_vertex_count / 2].map(f64::from);
    let mut all = CameraPath::orbit(&bounds, each).cameras;
    all.extend(CameraPath::dive(&bounds, point, each).cameras);
    // The places between which a random path goes smoothly, without the way.
    all.extend(CameraPath::random(&bounds, 5, 30 * each).cameras.into_iter().step_by(30));
    all.iter().map(|camera| camera.relative_to(header.origin.map(|x| -x))).collect()
}
