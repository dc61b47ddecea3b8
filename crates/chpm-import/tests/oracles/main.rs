//! Readers of others beside ours: `serde-ply`, `tobj`, `stl_io`, `off-rs` and `gltf` find the same faces in every file that is generated here.

mod gltf;
mod off;

use chpm_extmem::{Cancel, Store};
use chpm_import::Input;
use chpm_import::ply::{Batch, BatchKind, Options};
use chpm_mesh::TriMesh;
use chpm_synth::{Shape, Synth, hand};
use serde::Deserialize;
use std::fmt::Write;
use std::io::Cursor;
use std::path::Path;

/// The corners of a face, by place.
type Face = Vec<[f64; 3]>;

/// Vertices and faces of any number of corners.
struct Fixture {
    name: &'static str,
    points: Vec<[f64; 3]>,
    faces: Vec<Vec<u32>>,
}

impl Fixture {
    fn of(name: &'static str, mesh: &TriMesh) -> Self {
        let points = mesh.positions.iter().map(|point| point.map(f64::from)).collect();
        Fixture { name, points, faces: mesh.triangles.iter().map(|triangle| triangle.to_vec()).collect() }
    }

    /// The same far from zero, with digits that single precision has not.
    fn far(mut self) -> Self {
        self.points.iter_mut().for_each(|[x, y, z]| {
            (*x, *y, *z) = (*x / 3.0 + 435_112.25, *y / 7.0 + 5_411_907.5, *z / 11.0);
        });
        self
    }

    fn corners(&self) -> Vec<Face> {
        let place = |vertex: &u32| self.points[*vertex as usize];
        self.faces.iter().map(|face| face.iter().map(place).collect()).collect()
    }

    fn is_of_triangles(&self) -> bool {
        self.faces.iter().all(|face| face.len() == 3)
    }
}

/// A wavy grid of quads, with a hexagon at its end.
fn polygons() -> Fixture {
    let side = 6;
    let at = |i: u32, j: u32| [f64::from(i), f64::from(j), f64::from((i * j) % 3) * 0.25];
    let points = (0..=side).flat_map(|i| (0..=side).map(move |j| at(i, j))).collect();
    let corner = |i: u32, j: u32| i * (side + 1) + j;
    let quad = |i: u32, j: u32| vec![corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
    let mut faces: Vec<Vec<u32>> = (0..side).flat_map(|i| (0..side).map(move |j| quad(i, j))).collect();
    faces.push(vec![0, 1, 2, 9, 8, 7]);
    faces.push(vec![3, 4, 5]);
    Fixture { name: "polygons", points, faces }
}

fn fixtures() -> Vec<Fixture> {
    let meshes = [
        ("tetrahedron", hand::tetrahedron()),
        ("cube", hand::cube()),
        ("grid", hand::grid(5, 4)),
        ("fan", hand::fan(9)),
        ("strip", hand::strip(12)),
        ("icosphere", hand::icosphere(3)),
        ("bow tie", hand::bow_tie()),
        ("moebius", hand::moebius(12)),
        ("klein bottle", hand::klein_bottle(10)),
        ("two cubes", hand::two_cubes_sharing_an_edge()),
        ("duplicate faces", hand::duplicate_faces()),
        ("mixed winding", hand::mixed_winding()),
        ("soup", hand::soup(40)),
        ("edge fan", hand::edge_fan(5)),
        ("isosurface", Synth::new(Shape::Isosurface, 3_000, 7).to_mesh()),
        ("terrain", Synth::new(Shape::Terrain, 40_000, 3).to_mesh()),
    ];
    let mut all: Vec<Fixture> = meshes.iter().map(|(name, mesh)| Fixture::of(name, mesh)).collect();
    all.push(polygons());
    all.push(Fixture::of("far icosphere", &hand::icosphere(3)).far());
    all.push(Fixture { name: "far polygons", ..polygons() }.far());
    all
}

/// The faces of a file, as ours reads it.
fn ours(path: &Path) -> Vec<Face> {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::create(folder.path(), 1 << 20).unwrap();
    let options = Options { normals: false, colors: false, ..Options::default() };
    let mut input = Input::open(path, options, &store, &Cancel::default()).unwrap();
    let (mut batch, mut points, mut faces) = (Batch::default(), Vec::new(), Vec::<Vec<u32>>::new());
    while input.next_batch(&mut batch).unwrap() != BatchKind::End {
        points.extend(batch.vertices.positions.iter().map(|point| point.map(f64::from)));
        points.append(&mut batch.positions_f64);
        faces.extend(batch.triangles.iter().map(|triangle| triangle.to_vec()));
        faces.extend(batch.polygons.iter().map(<[u32]>::to_vec));
    }
    input.finish().unwrap();
    Fixture { name: "", points, faces }.corners()
}

/// Rounded to single precision.
fn single(mut faces: Vec<Face>) -> Vec<Face> {
    faces.iter_mut().flatten().flatten().for_each(|x| *x = f64::from(*x as f32));
    faces
}

/// In an order that does not depend on the reader: ours hands polygons over after triangles.
fn sorted(mut faces: Vec<Face>) -> Vec<Face> {
    // There is one zero.
    let key = |face: &Face| face.iter().flatten().map(|x| (x + 0.0).to_bits()).collect::<Vec<u64>>();
    faces.sort_by_cached_key(key);
    faces
}

fn assert_same(what: &str, name: &str, ours: Vec<Face>, theirs: Vec<Face>, written: Vec<Face>) {
    let (ours, theirs, written) = (sorted(ours), sorted(theirs), sorted(written));
    assert!(!written.is_empty() && ours.len() == written.len(), "{what} of {name}: {}", ours.len());
    assert!(ours == theirs, "{what} of {name}: another reader finds other faces");
    assert!(ours == written, "{what} of {name}: what was written is not read");
}

#[derive(Deserialize)]
struct PlyVertex {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Deserialize)]
struct PlyFace {
    #[serde(alias = "vertex_index")]
    vertex_indices: Vec<u32>,
}

#[derive(Deserialize)]
struct Ply {
    vertex: Vec<PlyVertex>,
    face: Vec<PlyFace>,
}

/// How a PLY is written.
#[derive(Clone, Copy, Debug)]
struct Dialect {
    format: &'static str,
    real: &'static str,
    count: &'static str,
    index: &'static str,
    list: &'static str,
    /// Whether each vertex has a quality between its coordinates, and each face a flag before its corners.
    has_more: bool,
}

impl Dialect {
    fn all() -> Vec<Dialect> {
        let mut all = Vec::new();
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            for real in ["float", "double"] {
                for (count, index, list) in
                    [("uchar", "int", "vertex_indices"), ("int", "uint", "vertex_index")]
                {
                    let has_more = real == "float";
                    all.push(Dialect { format, real, count, index, list, has_more });
                }
            }
        }
        all
    }

    fn number(&self, bytes: &mut Vec<u8>, of: &str, value: f64) {
        match (self.format, of) {
            ("ascii", "float") => bytes.extend(format!("{} ", value as f32).bytes()),
            ("ascii", _) => bytes.extend(format!("{value} ").bytes()),
            (_, "uchar") => bytes.push(value as u8),
            ("binary_little_endian", "float") => bytes.extend((value as f32).to_le_bytes()),
            ("binary_little_endian", "double") => bytes.extend(value.to_le_bytes()),
            ("binary_little_endian", _) => bytes.extend((value as u32).to_le_bytes()),
            (_, "float") => bytes.extend((value as f32).to_bits().to_be_bytes()),
            (_, "double") => bytes.extend(value.to_bits().to_be_bytes()),
            _ => bytes.extend((value as u32).to_be_bytes()),
        }
    }

    fn end(&self, bytes: &mut Vec<u8>) {
        if self.format == "ascii" {
            bytes.push(b'\n');
        }
    }

    fn write(&self, fixture: &Fixture) -> Vec<u8> {
        let Dialect { format, real, count, index, list, has_more } = *self;
        let more = if has_more { ["property float quality\n", "property uchar flag\n"] } else { [""; 2] };
        let head = format!(
            "ply\nformat {format} 1.0\ncomment by hand\nelement vertex {}\nproperty {real} x\n{}property {real} y\nproperty {real} z\n\
             element face {}\n{}property list {count} {index} {list}\nend_header\n",
            fixture.points.len(),
            more[0],
            fixture.faces.len(),
            more[1],
        );
        let mut bytes = head.into_bytes();
        for [x, y, z] in &fixture.points {
            self.number(&mut bytes, real, *x);
            if has_more {
                self.number(&mut bytes, "float", 0.5);
            }
            self.number(&mut bytes, real, *y);
            self.number(&mut bytes, real, *z);
            self.end(&mut bytes);
        }
        for face in &fixture.faces {
            if has_more {
                self.number(&mut bytes, "uchar", 7.0);
            }
            self.number(&mut bytes, count, face.len() as f64);
            face.iter().for_each(|corner| self.number(&mut bytes, index, f64::from(*corner)));
            self.end(&mut bytes);
        }
        bytes
    }
}

#[test]
fn serde_ply_reads_the_same_ply() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.ply");
    for fixture in fixtures() {
        for dialect in Dialect::all() {
            let bytes = dialect.write(&fixture);
            std::fs::write(&path, &bytes).unwrap();
            let Ply { vertex, face } = serde_ply::from_bytes(&bytes).unwrap();
            let points = vertex.iter().map(|v| [v.x, v.y, v.z]).collect();
            let faces = face.into_iter().map(|face| face.vertex_indices).collect();
            let theirs = Fixture { name: "", points, faces }.corners();
            // Digits of text may say more than the declared type; ours keeps them for the build to judge.
            let [ours, theirs, written] = match dialect.real {
                "float" => [ours(&path), theirs, fixture.corners()].map(single),
                _ => [ours(&path), theirs, fixture.corners()],
            };
            assert_same(&format!("{dialect:?}"), fixture.name, ours, theirs, written);
        }
    }
}

/// How corners of an OBJ are written: as they are, from the end, with what follows slashes.
const CORNERS: [fn(u32, usize) -> String; 4] = [
    |vertex, _| format!("{}", vertex + 1),
    |vertex, count| format!("{}", i64::from(vertex) - count as i64),
    |vertex, _| format!("{0}/{0}", vertex + 1),
    |vertex, _| format!("{0}//{0}", vertex + 1),
];

fn obj(fixture: &Fixture, style: usize) -> String {
    let mut text = "# by hand\r\no one\n".to_owned();
    for [x, y, z] in &fixture.points {
        writeln!(text, "v {x} {y:e}\t{z}").unwrap();
    }
    for _ in fixture.points.iter().filter(|_| style >= 2) {
        text += if style == 2 { "vt 0.5 0.25\n" } else { "vn 0 0 1\n" };
    }
    for face in &fixture.faces {
        let corners = face.iter().map(|vertex| CORNERS[style](*vertex, fixture.points.len()));
        writeln!(text, "f {}", corners.collect::<Vec<_>>().join(" ")).unwrap();
    }
    text
}

#[test]
fn tobj_reads_the_same_obj() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.obj");
    for fixture in fixtures() {
        for style in 0..CORNERS.len() {
            let text = obj(&fixture, style);
            std::fs::write(&path, &text).unwrap();
            let nothing = |_: &Path| tobj::MTLLoadResult::Ok(Default::default());
            let read = tobj::load_obj_buf(&mut Cursor::new(&text), &tobj::LoadOptions::default(), nothing);
            let theirs = read.unwrap().0.iter().flat_map(|model| faces_of(&model.mesh)).collect();
            assert_same(&format!("style {style}"), fixture.name, ours(&path), theirs, fixture.corners());
        }
    }
}

fn faces_of(mesh: &tobj::Mesh) -> Vec<Face> {
    let points = mesh.positions.chunks_exact(3).map(|point| [point[0], point[1], point[2]]).collect();
    let mut rest = &mesh.indices[..];
    let mut faces = Vec::new();
    // Where all faces are triangles, nothing is told of their corners.
    let arities = mesh.face_arities.iter().map(|arity| *arity as usize);
    let arities: Vec<usize> =
        if mesh.face_arities.is_empty() { vec![3; mesh.indices.len() / 3] } else { arities.collect() };
    for arity in arities {
        let (face, after) = rest.split_at(arity);
        faces.push(face.to_vec());
        rest = after;
    }
    Fixture { name: "", points, faces }.corners()
}

#[test]
fn stl_io_reads_the_same_stl() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.stl");
    for fixture in fixtures().into_iter().filter(Fixture::is_of_triangles) {
        // Facets have single precision; what it makes of corners far away may be no facet any more.
        let is_facet = |face: &Face| face[0] != face[1] && face[1] != face[2] && face[2] != face[0];
        let facets: Vec<Face> = single(fixture.corners()).into_iter().filter(is_facet).collect();
        for bytes in [binary_stl(&facets), text_stl(&facets).into_bytes()] {
            std::fs::write(&path, &bytes).unwrap();
            let mut cursor = Cursor::new(&bytes);
            let read = stl_io::create_stl_reader(&mut cursor).unwrap().map(|facet| {
                let corner = |vertex: stl_io::Vertex| <[f32; 3]>::from(vertex).map(f64::from);
                facet.unwrap().vertices.map(corner).to_vec()
            });
            let theirs = read.collect();
            assert_same("STL", fixture.name, ours(&path), theirs, facets.clone());
        }
    }
}

fn binary_stl(facets: &[Face]) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend((facets.len() as u32).to_le_bytes());
    for facet in facets {
        bytes.extend([0; 12]);
        bytes.extend(facet.iter().flatten().flat_map(|x| (*x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn text_stl(facets: &[Face]) -> String {
    let mut text = "solid by hand\n".to_owned();
    for facet in facets {
        text += "facet normal 0 0 1\nouter loop\n";
        for [x, y, z] in facet {
            writeln!(text, "vertex {x} {y:e} {z}").unwrap();
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid by hand\n"
}
