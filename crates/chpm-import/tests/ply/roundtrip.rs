//! The three encodings say the same, in any layout; the writer is read back bit by bit; another reader agrees.

use crate::forge::{ENCODINGS, Random, TYPES, Table, Trickle, forge};
use chpm_import::ply::{
    Batch, BatchKind, Coordinates, Encoding, Options, PlyReader, PlyWriter, PropertyType, ScalarType, Tally,
    read_mesh, write_mesh,
};
use chpm_mesh::{Attributes, TriMesh, VertexSlices, Vertices};
use proptest::prelude::*;
use serde::Deserialize;

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// Everything that the batches say, with f64 positions whatever their type.
#[derive(PartialEq, Debug, Default)]
struct Whole {
    positions: Vec<[f64; 3]>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[u8; 4]>,
    triangles: Vec<[u32; 3]>,
    polygons: Vec<Vec<u32>>,
    tally: Tally,
}

fn read_whole(bytes: &[u8], step: usize) -> Whole {
    let mut reader = PlyReader::new(Trickle { bytes, step }, Options::default()).unwrap();
    let mut whole = Whole::default();
    let mut batch = Batch::default();
    while reader.next_batch(&mut batch).unwrap() != BatchKind::End {
        whole.positions.extend(batch.vertices.positions.iter().map(|position| position.map(f64::from)));
        // Text of singles says what its digits say.
        let are_singles = reader.vertex_format().coordinates == Coordinates::TextOfSingles;
        let meant = |x: f64| if are_singles { f64::from(x as f32) } else { x };
        whole.positions.extend(batch.positions_f64.drain(..).map(|position| position.map(meant)));
        whole.normals.append(&mut batch.vertices.normals);
        whole.colors.append(&mut batch.vertices.colors);
        whole.triangles.append(&mut batch.triangles);
        whole.polygons.extend(batch.polygons.iter().map(<[u32]>::to_vec));
    }
    whole.tally = reader.tally();
    whole
}

fn list(count: ScalarType, item: ScalarType) -> PropertyType {
    PropertyType::List { count, item }
}

/// Up to three columns of any type, anywhere, that mean nothing.
fn add_junk(random: &mut Random, table: &mut Table) {
    for number in 0..random.below(4) {
        let at = random.below(table.columns.len() + 1);
        let item = TYPES[random.below(8)];
        let is_list = random.below(3) == 0;
        let ty = if is_list { list(TYPES[random.below(6)], item) } else { PropertyType::Scalar(item) };
        table.columns.insert(at, (format!("junk{number}"), ty));
        for row in &mut table.rows {
            let length = if is_list { random.below(5) } else { 1 };
            row.insert(at, (0..length).map(|_| random.value(item)).collect());
        }
    }
}

/// A file of random layout, and what must come out of it.
fn scenario(seed: u64) -> (Vec<Table>, Whole) {
    let random = &mut Random(seed);
    let mut expected = Whole::default();
    let vertex_count = 1 + random.below(40);
    let coordinate = TYPES[random.below(8)];
    let (has_normals, has_colors, has_alpha) =
        (random.below(2) == 0, random.below(2) == 0, random.below(2) == 0);
    let scalar = |name: &str, ty| (name.to_owned(), PropertyType::Scalar(ty));
    let mut vertices = Table {
        name: "vertex",
        columns: ["x", "y", "z"].map(|name| scalar(name, coordinate)).to_vec(),
        rows: Vec::new(),
    };
    if has_normals {
        vertices.columns.extend(["nx", "ny", "nz"].map(|name| scalar(name, ScalarType::Float)));
    }
    if has_colors {
        vertices.columns.extend(["red", "green", "blue"].map(|name| scalar(name, ScalarType::UChar)));
        if has_alpha {
            vertices.columns.push(scalar("alpha", ScalarType::UChar));
        }
    }
    for _ in 0..vertex_count {
        let position = [0; 3].map(|_| random.value(coordinate));
        expected.positions.push(position);
        let mut row = position.to_vec();
        if has_normals {
            let normal = [0; 3].map(|_| random.value(ScalarType::Float) as f32);
            expected.normals.push(normal);
            row.extend(normal.map(f64::from));
        }
        if has_colors {
            let mut color = [0; 4].map(|_| random.next() as u8);
            if !has_alpha {
                color[3] = 255;
            }
            expected.colors.push(color);
            row.extend(color[..if has_alpha { 4 } else { 3 }].iter().map(|x| f64::from(*x)));
        }
        vertices.rows.push(row.into_iter().map(|x| vec![x]).collect());
    }
    // Any order of columns.
    for at in (1..vertices.columns.len()).rev() {
        let other = random.below(at + 1);
        vertices.columns.swap(at, other);
        vertices.rows.iter_mut().for_each(|row| row.swap(at, other));
    }
    add_junk(random, &mut vertices);

    let name = ["vertex_indices", "vertex_index"][random.below(2)].to_owned();
    let ty = list(TYPES[random.below(6)], TYPES[random.below(6)]);
    let mut faces = Table { name: "face", columns: vec![(name, ty)], rows: Vec::new() };
    let only_triangles = random.below(2) == 0;
    for _ in 0..1 + random.below(60) {
        let corners = if only_triangles { 3 } else { random.below(7) };
        let face: Vec<u32> = (0..corners).map(|_| random.below(vertex_count) as u32).collect();
        faces.rows.push(vec![face.iter().map(|v| f64::from(*v)).collect()]);
        expected.tally.polygons_triangulated += u64::from(corners > 3);
        match face[..] {
            [a, b, c] if a != b && b != c && c != a => expected.triangles.push([a, b, c]),
            [_, _, _, _, ..] => expected.polygons.push(face),
            _ => expected.tally.degenerate_faces += 1,
        }
    }
    add_junk(random, &mut faces);

    let mut other = Table { name: "edge", columns: Vec::new(), rows: vec![Vec::new(); random.below(5)] };
    add_junk(random, &mut other);
    let mut tables = vec![vertices, faces];
    tables.insert(random.below(3), other);
    if random.below(3) == 0 {
        tables.reverse();
    }
    (tables, expected)
}

proptest! {
    #![proptest_config(config(600))]

    #[test]
    fn encodings_and_layouts_say_the_same(seed in any::<u64>(), step in 1usize..5000) {
        let (tables, expected) = scenario(seed);
        for encoding in ENCODINGS {
            let whole = read_whole(&forge(encoding, &tables), step);
            prop_assert_eq!(&whole, &expected, "{}", encoding);
        }
    }

    #[test]
    fn what_is_written_is_read_back(
        positions in prop::collection::vec(prop::array::uniform3(prop::num::f32::NORMAL | prop::num::f32::SUBNORMAL | prop::num::f32::ZERO), 3..50),
        picks in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 1..50),
        attributes in any::<(bool, bool)>(),
    ) {
        let count = positions.len();
        let corners = picks.iter().map(|pick| pick.map(|index| index.index(count) as u32));
        let triangles: Vec<_> = corners.filter(|[a, b, c]| a != b && b != c && c != a).collect();
        prop_assume!(!triangles.is_empty());
        let normals = if attributes.0 { positions.iter().rev().copied().collect() } else { Vec::new() };
        let color = |p: &[f32; 3]| p[0].to_bits().to_le_bytes();
        let colors = if attributes.1 { positions.iter().map(color).collect() } else { Vec::new() };
        let mesh = TriMesh { vertices: Vertices { positions, normals, colors, ..Vertices::default() }, triangles };
        for encoding in ENCODINGS {
            let mut bytes = Vec::new();
            write_mesh(&mut bytes, &mesh, encoding).unwrap();
            let (back, tally, warnings) = read_mesh(&bytes[..], Options::default()).unwrap();
            prop_assert_eq!((tally, warnings.len()), (Tally::default(), 0));
            // Bits, so that -0 differs from 0.
            let bits = |mesh: &TriMesh| -> Vec<u32> {
                mesh.positions.iter().chain(&mesh.normals).flatten().map(|x| x.to_bits()).collect()
            };
            prop_assert_eq!(bits(&back), bits(&mesh));
            prop_assert_eq!(back, mesh.clone());
        }
    }
}

/// More than a block and many batches, in steps that split every record somewhere.
#[test]
fn blocks_and_batches_leave_no_seams() {
    let mut random = Random(7);
    let count = 70_001;
    let positions: Vec<[f64; 3]> = (0..count).map(|i| [f64::from(i), 0.1, -f64::from(i) / 3.0]).collect();
    let colors: Vec<[u8; 4]> = (0..count).map(|_| (random.next() as u32).to_le_bytes()).collect();
    let triangles: Vec<[u32; 3]> =
        (2..count as u32).map(|i| [i, i - 1, random.below(i as usize - 1) as u32]).collect();
    let attributes = Attributes { colors: true, ..Attributes::NONE };
    for encoding in ENCODINGS {
        let (vertices, faces) = (positions.len() as u64, triangles.len() as u64);
        let mut writer =
            PlyWriter::new(Vec::new(), encoding, vertices, faces, attributes, true, &["seams"]).unwrap();
        for (positions, colors) in positions.chunks(999).zip(colors.chunks(999)) {
            writer.vertices_f64(positions, VertexSlices { colors, ..VertexSlices::default() }).unwrap();
        }
        triangles.chunks(1001).for_each(|triangles| writer.triangles(triangles).unwrap());
        let bytes = writer.finish().unwrap();
        assert!(bytes.len() > 2 << 20);
        for step in [1_009, 65_536, usize::MAX] {
            let whole = read_whole(&bytes, step);
            assert_eq!(whole.positions, positions);
            assert_eq!(whole.colors, colors);
            assert_eq!(whole.triangles, triangles);
            assert_eq!(whole.tally, Tally::default());
        }
    }
}

#[derive(Deserialize)]
struct OracleVertex {
    x: f32,
    y: f32,
    z: f32,
    nx: f32,
    ny: f32,
    nz: f32,
    red: u8,
    green: u8,
    blue: u8,
    alpha: u8,
}

#[derive(Deserialize)]
struct OracleFace {
    vertex_indices: Vec<u32>,
}

#[derive(Deserialize)]
struct OracleMesh {
    vertex: Vec<OracleVertex>,
    face: Vec<OracleFace>,
}

#[test]
fn another_reader_agrees() {
    let random = &mut Random(3);
    let mut three = || [0; 3].map(|_| random.value(ScalarType::Float) as f32);
    let positions: Vec<_> = (0..200).map(|_| three()).collect();
    let normals: Vec<_> = (0..200).map(|_| three()).collect();
    let colors = (0..200u32).map(|i| (i * 0x0101_0713).to_le_bytes()).collect();
    let triangles = (0..198).map(|i| [i, i + 2, i + 1]).collect();
    let mesh =
        TriMesh { vertices: Vertices { positions, normals, colors, ..Vertices::default() }, triangles };
    for encoding in [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian] {
        let mut bytes = Vec::new();
        write_mesh(&mut bytes, &mesh, encoding).unwrap();
        let oracle: OracleMesh = serde_ply::from_bytes(&bytes).unwrap();
        let (ours, ..) = read_mesh(&bytes[..], Options::default()).unwrap();
        let theirs = TriMesh {
            vertices: Vertices {
                positions: oracle.vertex.iter().map(|v| [v.x, v.y, v.z]).collect(),
                normals: oracle.vertex.iter().map(|v| [v.nx, v.ny, v.nz]).collect(),
                colors: oracle.vertex.iter().map(|v| [v.red, v.green, v.blue, v.alpha]).collect(),
                ..Vertices::default()
            },
            triangles: oracle
                .face
                .iter()
                .map(|face| <[u32; 3]>::try_from(&face.vertex_indices[..]).unwrap())
                .collect(),
        };
        assert_eq!(ours, theirs, "{encoding}");
        assert_eq!(ours, mesh, "{encoding}");
    }
}
