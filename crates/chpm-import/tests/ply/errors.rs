//! Errors name the element, its index, and the offset of the very value; or it is dropped and counted.

use crate::forge::{ENCODINGS, Random, SPECIMENS};
use chpm_import::Images;
use chpm_import::ply::{
    Batch, BatchKind, Encoding, Invalid, Keep, Options, PlyError, PlyReader, PlyWriter, SourceLocation,
    Tally, Warning, read_mesh, write_mesh,
};
use chpm_mesh::{Attributes, TriMesh, VertexSlices};

const DROP: Options = Options {
    invalid: Invalid::Drop,
    normals: true,
    colors: true,
    keep: Keep { all: false, names: Vec::new() },
    images: Images::Ignored,
    wide: false,
};

/// Four vertices and four triangles as text; line 10 is the first vertex.
const TEXT: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
    property float z\nelement face 4\nproperty list char int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n";

fn refuse(text: &str) -> PlyError {
    read_mesh(text.as_bytes(), Options::default()).unwrap_err()
}

fn drop(bytes: &[u8]) -> (TriMesh, Tally, Vec<Warning>) {
    read_mesh(bytes, DROP).unwrap()
}

fn place(error: &PlyError) -> &SourceLocation {
    match error {
        PlyError::IndexOutOfRange { place, .. }
        | PlyError::NotFinite { place, .. }
        | PlyError::BeyondSingle { place, .. }
        | PlyError::Truncated { place, .. }
        | PlyError::Number { place, .. }
        | PlyError::NegativeCount { place, .. }
        | PlyError::TooManyCorners { place, .. } => place,
        other => panic!("no place: {other}"),
    }
}

/// Replaces the one occurrence of `from`, and checks that the error is in `element` at the offset of `needle`.
fn wrong(from: &str, to: &str, needle: &str, element: &str, index: u64) -> PlyError {
    assert_eq!(TEXT.matches(from).count(), 1, "{from:?}");
    let text = TEXT.replace(from, to);
    let error = refuse(&text);
    let start = text.find(to).unwrap();
    let offset = start + to.rfind(needle).unwrap();
    let line = text[..offset].matches('\n').count() as u64 + 1;
    let expected =
        SourceLocation { element: element.to_owned(), index, offset: offset as u64, line: Some(line) };
    assert_eq!(*place(&error), expected, "{error}");
    error
}

#[test]
fn text_errors_point_at_the_word() {
    let error = wrong("\n3 1 2 3", "\n3 1 4 3", "4 3", "face", 2);
    assert!(matches!(error, PlyError::IndexOutOfRange { index: 4, vertices: 4, .. }));
    let error = wrong("\n3 1 2 3", "\n3 1 -1 3", "-1", "face", 2);
    assert!(matches!(error, PlyError::IndexOutOfRange { index: -1, .. }));
    let error = wrong("\n3 1 2 3", "\n3 1 9999999999 3", "9999999999", "face", 2);
    assert!(!matches!(error, PlyError::Number { .. }));
    let error = wrong("\n1 0 0", "\n1 nan 0", "nan", "vertex", 1);
    assert!(
        matches!(error, PlyError::NotFinite { ref property, value, .. } if property == "y" && value.is_nan())
    );
    wrong("\n1 0 0", "\n1 0 -1e39", "-1e39", "vertex", 1);
    wrong("\n1 0 0", "\n1 zero 0", "zero", "vertex", 1);
    wrong("\n3 1 2 3", "\n3 1 2.5 3", "2.5", "face", 2);
    wrong("\n3 1 2 3", "\n200 1 2 3", "200", "face", 2);
    let error = wrong("\n3 1 2 3", "\n-3 1 2 3", "-3", "face", 2);
    assert!(matches!(error, PlyError::NegativeCount { count: -3, .. }));
    assert!(error.to_string().starts_with("face 2, byte "), "{error}");
}

#[test]
fn absurd_polygons_are_refused_before_they_are_read() {
    let text = TEXT.replace("list char", "list uint").replace("\n3 1 2 3", "\n4000000000 1 2 3");
    for options in [Options::default(), DROP] {
        let error = read_mesh(text.as_bytes(), options).unwrap_err();
        assert!(matches!(error, PlyError::TooManyCorners { count: 4_000_000_000, .. }), "{error}");
    }
}

fn tetrahedron() -> TriMesh {
    read_mesh(TEXT.as_bytes(), Options::default()).unwrap().0
}

fn binary(double: bool, encoding: Encoding) -> (Vec<u8>, usize) {
    let mesh = tetrahedron();
    let mut writer = PlyWriter::new(Vec::new(), encoding, 4, 4, Attributes::NONE, double, &[]).unwrap();
    writer.vertices(mesh.view()).unwrap();
    writer.triangles(&mesh.triangles).unwrap();
    let bytes = writer.finish().unwrap();
    let body = PlyReader::new(&bytes[..], Options::default()).unwrap().header().len as usize;
    (bytes, body)
}

#[test]
fn binary_errors_point_at_the_bytes() {
    for (encoding, double) in [(Encoding::BinaryLittleEndian, false), (Encoding::BinaryBigEndian, true)] {
        let (bytes, body) = binary(double, encoding);
        let size = if double { 8 } else { 4 };
        for (bad, axis) in [(5, "z"), (9, "x")] {
            let mut bytes = bytes.clone();
            let offset = body + bad * size;
            bytes[offset..offset + size].fill(0xff);
            let error = read_mesh(&bytes[..], Options::default()).unwrap_err();
            let index = (bad / 3) as u64;
            let expected =
                SourceLocation { element: "vertex".into(), index, offset: offset as u64, line: None };
            assert_eq!(*place(&error), expected);
            assert!(matches!(error, PlyError::NotFinite { property, .. } if property == axis));
        }
        // Every corner of the third face, one beyond the last vertex.
        for corner in 0..3 {
            let mut bytes = bytes.clone();
            let offset = body + 12 * size + 2 * 13 + 1 + 4 * corner;
            bytes[offset..offset + 4].fill(0);
            bytes[if double { offset + 3 } else { offset }] = 4;
            let error = read_mesh(&bytes[..], Options::default()).unwrap_err();
            assert_eq!((place(&error).index, place(&error).offset), (2, offset as u64));
            assert!(matches!(error, PlyError::IndexOutOfRange { index: 4, .. }));
        }
        let mut bytes = bytes.clone();
        let offset = body + 12 * size + 2 * 13 + 5;
        bytes[offset..offset + 4].fill(0xff);
        let error = read_mesh(&bytes[..], Options::default()).unwrap_err();
        assert_eq!((place(&error).index, place(&error).offset), (2, offset as u64));
        assert!(matches!(error, PlyError::IndexOutOfRange { index: -1, .. }));
        let unsigned =
            String::from_utf8_lossy(&bytes[..body]).replace("uchar int", "uchar uint").into_bytes();
        let bytes = [&unsigned[..], &bytes[body..]].concat();
        let error = read_mesh(&bytes[..], Options::default()).unwrap_err();
        assert!(matches!(error, PlyError::IndexOutOfRange { index: 0xffff_ffff, .. }));
    }
}

#[test]
fn headers_that_lie_are_named() {
    let header = |from: &str, to: &str| refuse(&TEXT.replace(from, to));
    assert!(matches!(header("element vertex", "element vortex"), PlyError::NoVertexElement));
    assert!(matches!(header("float y", "float why"), PlyError::NoCoordinate { axis: "y" }));
    assert!(matches!(header("float y", "list char int y"), PlyError::NotScalar { .. }));
    for list in ["list char float vertex_indices", "int vertex_indices", "list char int corners"] {
        let error = header("list char int vertex_indices", list);
        assert!(matches!(error, PlyError::NoIndices { .. }), "{error}");
    }
    assert!(matches!(header("element face 4", "element face 0"), PlyError::PointCloud { vertices: 4 }));
    assert!(matches!(header("element face", "element facet"), PlyError::PointCloud { vertices: 4 }));
}

/// Five promised and four there: the fifth eats a part of the first face and its line goes on; and the other way round.
#[test]
fn counts_that_lie_break_lines() {
    for (promised, element, index, line) in [(5, "vertex", 4, 14), (3, "face", 0, 13)] {
        let error = refuse(&TEXT.replace("element vertex 4", &format!("element vertex {promised}")));
        let place = place(&error);
        assert_eq!(
            (place.element.as_str(), place.index, place.line),
            (element, index, Some(line)),
            "{error}"
        );
    }
    let error = refuse(&TEXT.replace("element face 4", "element face 5"));
    assert!(matches!(error, PlyError::Truncated { read: 4, count: 5, .. }), "{error}");
    wrong("\n1 0 0", "\n1 0 0 7", "7", "vertex", 1);
    let broken = TEXT.replace("\n3 1 2 3", "\n3\n1 2\r\n 3");
    assert_eq!(read_mesh(broken.as_bytes(), DROP).unwrap().0, tetrahedron(), "an element may be broken");
}

#[test]
fn a_failed_stream_stays_failed() {
    let text = TEXT.replace("\n1 0 0", "\n1 x 0");
    let mut reader = PlyReader::new(text.as_bytes(), Options::default()).unwrap();
    let mut batch = Batch::default();
    assert!(matches!(reader.next_batch(&mut batch), Err(PlyError::Number { .. })));
    assert!(matches!(reader.next_batch(&mut batch), Err(PlyError::Ended)));
}

#[test]
fn dropping_keeps_indices_and_counts() {
    let text = TEXT.replace("\n1 0 0", "\n1 inf 0").replace("3 2 0 3", "3 2 0 4").into_bytes();
    let (mut forged, body) = binary(false, Encoding::BinaryLittleEndian);
    forged[body + 16..body + 20].copy_from_slice(&f32::INFINITY.to_le_bytes());
    forged[body + 48 + 3 * 13 + 9..][..4].copy_from_slice(&4u32.to_le_bytes());
    for bytes in [text, forged] {
        let (mesh, tally, warnings) = drop(&bytes);
        assert_eq!(mesh.positions, [[0.0; 3], [0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(mesh.triangles, [[0u32; 3]; 0]);
        assert_eq!(tally, Tally { dropped_vertices: 1, dropped_faces: 4, ..Tally::default() });
        assert_eq!(warnings, []);
        let mut batch = Batch::default();
        let mut reader = PlyReader::new(&bytes[..], DROP).unwrap();
        assert_eq!(reader.next_batch(&mut batch).unwrap(), BatchKind::Vertices);
        assert_eq!(batch.invalid_vertices, [1]);
    }
    let (mesh, tally, _) = drop(TEXT.replace("3 0 1 3", "5 0 1 2 3 7").as_bytes());
    assert_eq!(mesh.triangles, [[0, 2, 1], [1, 2, 3], [2, 0, 3]], "a polygon is dropped whole");
    assert_eq!(tally, Tally { dropped_faces: 1, ..Tally::default() });
}

#[test]
fn dropping_is_a_filter() {
    let random = &mut Random(11);
    let count = 500;
    let mut positions: Vec<[f32; 3]> = (0..count).map(|i| [i as f32, 0.5, -1.0]).collect();
    let triangles: Vec<[u32; 3]> = (2..count as u32).map(|i| [i, i - 1, i - 2]).collect();
    let mut bad: Vec<usize> = (0..25).map(|_| random.below(count)).collect();
    bad.sort_unstable();
    bad.dedup();
    for &vertex in &bad {
        positions[vertex][random.below(3)] = [f32::NAN, f32::INFINITY][random.below(2)];
    }
    let mesh = TriMesh::new(positions, triangles);
    let good = |triangle: &&[u32; 3]| !triangle.iter().any(|v| bad.contains(&(*v as usize)));
    let expected: Vec<[u32; 3]> = mesh.triangles.iter().filter(good).copied().collect();
    for encoding in ENCODINGS {
        let mut bytes = Vec::new();
        write_mesh(&mut bytes, &mesh, encoding).unwrap();
        let (dropped, tally, _) = drop(&bytes);
        assert_eq!(dropped.triangles, expected);
        for (vertex, position) in dropped.positions.iter().enumerate() {
            assert_eq!(*position, if bad.contains(&vertex) { [0.0; 3] } else { mesh.positions[vertex] });
        }
        let dropped_faces = (mesh.triangles.len() - expected.len()) as u64;
        let dropped_vertices = bad.len() as u64;
        assert_eq!(tally, Tally { dropped_vertices, dropped_faces, ..Tally::default() });
    }
}

#[test]
fn strips_drop_what_touches_a_bad_corner() {
    let text = TEXT
        .replace("face 4", "tristrips 2")
        .replace("3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n", "8 0 1 2 9 3 0 1 2\n4 -2 0 1 2\n");
    let (mesh, tally, _) = drop(text.as_bytes());
    assert_eq!(mesh.triangles, [[0, 1, 2], [3, 0, 1], [1, 0, 2], [1, 0, 2]]);
    assert_eq!(tally, Tally { dropped_faces: 4, strips: 2, ..Tally::default() });
    assert!(matches!(refuse(&text), PlyError::IndexOutOfRange { index: 9, .. }));
}

#[test]
fn a_cut_file_ends_early_when_dropping() {
    let (bytes, body) = binary(false, Encoding::BinaryLittleEndian);
    let whole = tetrahedron();
    for length in body..bytes.len() {
        let vertices = ((length - body) / 12).min(4);
        let faces = length.saturating_sub(body + 48) / 13;
        let (mesh, tally, _) = drop(&bytes[..length]);
        assert_eq!(mesh.positions, whole.positions[..vertices]);
        assert_eq!(mesh.triangles, whole.triangles[..faces]);
        let missing = (4 - vertices as u64, 4 - faces as u64);
        assert_eq!((tally.missing_vertices, tally.missing_faces), missing, "cut at {length}");

        let error = read_mesh(&bytes[..length], Options::default()).unwrap_err();
        let (element, read) = if vertices < 4 { ("vertex", vertices) } else { ("face", faces) };
        let index = read as u64;
        let expected = SourceLocation { element: element.into(), index, offset: length as u64, line: None };
        assert_eq!(*place(&error), expected);
        assert!(matches!(error, PlyError::Truncated { read, count: 4, .. } if read == index));
    }
}

#[test]
fn a_broken_input_is_not_a_cut_file() {
    struct Broken;
    impl std::io::Read for Broken {
        fn read(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
            Err(std::io::Error::other("unplugged"))
        }
    }
    let (bytes, body) = binary(false, Encoding::BinaryLittleEndian);
    let input = std::io::Read::chain(&bytes[..body + 50], Broken);
    let error = read_mesh(input, DROP).unwrap_err();
    assert!(matches!(error, PlyError::Read { offset, .. } if offset == body as u64 + 50), "{error}");
}

#[test]
fn the_writer_keeps_count() {
    let new = |vertices, triangles| {
        PlyWriter::new(Vec::new(), Encoding::Ascii, vertices, triangles, Attributes::NONE, false, &["a\nb"])
            .unwrap()
    };
    let mut writer = new(2, 1);
    assert!(matches!(writer.triangles(&[[0, 0, 0]]), Err(PlyError::WriteCount { what: "vertices", .. })));
    assert!(
        writer.vertices(VertexSlices { normals: &[[0.0; 3]], ..VertexSlices::new(&[[0.0; 3]]) }).is_err()
    );
    writer.vertices(VertexSlices::new(&[[0.0; 3], [1.0; 3]])).unwrap();
    assert!(matches!(
        writer.triangles(&[[0, 1, 2]]),
        Err(PlyError::WriteIndex { triangle: 0, index: 2, vertices: 2 })
    ));
    assert!(matches!(writer.finish(), Err(PlyError::WriteCount { what: "triangles", expected: 1, got: 0 })));
    assert!(new(0, 0).vertices(VertexSlices::new(&[[0.0; 3]])).is_err());
    let text = String::from_utf8(new(0, 0).finish().unwrap()).unwrap();
    assert!(text.contains("\ncomment a b\n"));
    assert!(PlyWriter::new(Vec::new(), Encoding::Ascii, 1 << 32, 0, Attributes::NONE, false, &[]).is_err());
}

#[test]
fn specimens_say_the_same_when_dropping() {
    for specimen in SPECIMENS.iter().enumerate().filter(|(at, _)| *at != 4).map(|(_, specimen)| *specimen) {
        assert_eq!(drop(specimen), read_mesh(specimen, Options::default()).unwrap());
    }
}
