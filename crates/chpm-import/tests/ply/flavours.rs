//! Each committed specimen, and what exactly it holds.

use crate::forge::SPECIMENS;
use chpm_import::ply::{
    Batch, BatchKind, Coordinates, Encoding, Invalid, Options, PlyError, PlyReader, ScalarType,
    SourceLocation, Tally, Warning, read_mesh,
};
use chpm_mesh::{Attributes, TriMesh};

fn read(bytes: &[u8]) -> (TriMesh, Tally, Vec<Warning>) {
    read_mesh(bytes, Options::default()).unwrap()
}

#[test]
fn polygons_are_cut_after_the_triangles() {
    let (mesh, tally, warnings) = read(SPECIMENS[0]);
    assert_eq!(mesh.positions.len(), 7);
    assert_eq!(mesh.positions[3], [0.5, 1.5, 0.0]);
    assert_eq!(mesh.positions[6], [1.0, 0.0, -0.1]);
    // The wall crosses itself near vertex 6.
    assert_eq!(mesh.triangles, [[2, 1, 6], [0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 5, 1], [5, 6, 1]]);
    assert_eq!(tally, Tally { polygons_triangulated: 2, degenerate_faces: 2, ..Tally::default() });
    let dropped =
        Warning::FaceAttributesDropped { element: "face".into(), properties: vec!["quality".into()] };
    assert_eq!(warnings, [dropped]);
    assert!(warnings[0].to_string().contains("quality"));

    let reader = PlyReader::new(SPECIMENS[0], Options::default()).unwrap();
    assert_eq!(reader.header().comments, ["a prism with one wall missing", "the list is last"]);
    assert_eq!(reader.header().obj_info, ["made by hand"]);
    assert_eq!(reader.header().format, Encoding::Ascii);
    assert_eq!((reader.header().vertex_count, reader.header().face_count), (7, 5));
    assert_eq!(reader.bytes_read(), reader.header().len);
}

#[test]
fn colours_are_exact_and_opaque() {
    let (mesh, tally, warnings) = read(SPECIMENS[1]);
    assert_eq!(mesh.positions, [[0.0, 0.0, 0.1], [1.0, 0.0, 0.0], [10.0, 1.5, -2.0]]);
    assert_eq!(mesh.colors, [[10, 20, 30, 255], [255, 0, 1, 255], [13, 10, 13, 255]]);
    assert_eq!(mesh.triangles, [[2, 0, 1]]);
    assert_eq!(tally, Tally::default());
    assert_eq!(warnings.len(), 1);

    let options = Options { colors: false, ..Options::default() };
    let (plain, _, same) = read_mesh(SPECIMENS[1], options).unwrap();
    let mut mesh = mesh;
    mesh.colors.clear();
    assert_eq!(plain, mesh);
    assert_eq!(same, warnings, "what is not asked for is no loss");
}

#[test]
fn small_integers_make_single_coordinates() {
    let reader = PlyReader::new(SPECIMENS[2], Options::default()).unwrap();
    assert_eq!(reader.vertex_format().coordinates, Coordinates::Single);
    let (mesh, tally, warnings) = read(SPECIMENS[2]);
    assert_eq!(mesh.positions, [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, -4.0, 0.0], [0.0, 0.0, 5.0]]);
    assert_eq!(mesh.triangles, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    assert_eq!((tally, warnings), (Tally::default(), vec![]));
}

#[test]
fn strips_alternate_and_restart() {
    let (mesh, tally, warnings) = read(SPECIMENS[3]);
    assert_eq!(mesh.positions[3], [3.0, 9.0, -3.0]);
    // 0 1 2 3 | | 3 2 4 4 0 | 1 2, and 0 2 4.
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [3, 2, 4], [0, 2, 4]]);
    assert_eq!(tally, Tally { strips: 3, degenerate_faces: 2, ..Tally::default() });
    assert_eq!(warnings[0], Warning::ElementSkipped { element: "camera".into(), count: 2 });
    let properties = vec!["material".into(), "tags".into()];
    assert_eq!(warnings[1..], [Warning::FaceAttributesDropped { element: "tristrips".into(), properties }]);
}

#[test]
fn doubles_stay_doubles_and_faces_may_come_first() {
    let mut reader = PlyReader::new(SPECIMENS[4], Options::default()).unwrap();
    assert!(reader.vertex_format().coordinates.are_double());
    let mut batch = Batch::default();
    assert_eq!(reader.next_batch(&mut batch).unwrap(), BatchKind::Triangles);
    assert_eq!(batch.triangles, [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(reader.next_batch(&mut batch).unwrap(), BatchKind::Vertices);
    let expected = [[0.1, 1e300, 0.5], [4e5 + 1e-9, 2.0, 3.0], [-1.0, -2.0, -3.0], [7.0, 8.0, 9.0]];
    assert_eq!(batch.positions_f64, expected);
    assert!(batch.vertices.positions.is_empty() && batch.triangles.is_empty());
    assert_eq!(reader.next_batch(&mut batch).unwrap(), BatchKind::End);
    assert_eq!(reader.next_batch(&mut batch).unwrap(), BatchKind::End);
    assert_eq!(reader.bytes_read(), SPECIMENS[4].len() as u64);

    let error = read_mesh(SPECIMENS[4], Options::default()).unwrap_err();
    assert!(
        matches!(error, PlyError::BeyondSingle { place: SourceLocation { index: 0, .. }, .. }),
        "{error}"
    );
    let options = Options { invalid: Invalid::Drop, ..Options::default() };
    assert!(matches!(PlyReader::new(SPECIMENS[4], options), Err(PlyError::FacesFirst { .. })));
}

#[test]
fn extras_are_converted_or_named() {
    let reader = PlyReader::new(SPECIMENS[5], Options::default()).unwrap();
    assert_eq!(reader.vertex_format().attributes, Attributes::ALL);
    let (mesh, tally, warnings) = read(SPECIMENS[5]);
    assert_eq!(mesh.positions, [[1.0, 2.0, 3.0], [1.0, 3.0, 3.0], [2.0, 2.0, 3.0]]);
    assert_eq!(mesh.normals, [[0.0, 0.0, 1.0], [0.0; 3], [1.0, 0.0, 0.0]]);
    assert_eq!(mesh.colors, [[0, 128, 255, 255], [64, 255, 0, 1], [255, 255, 255, 0]]);
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(tally, Tally { zeroed_normals: 1, ..Tally::default() });
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let (vertex, face) = (|| "vertex".to_owned(), || "face".to_owned());
    let expected = [
        Warning::TextureDropped { element: vertex(), properties: names(&["s", "t"]) },
        Warning::VertexPropertiesDropped { element: vertex(), properties: names(&["confidence", "weights"]) },
        Warning::NormalsRounded { from: ScalarType::Double },
        Warning::ColorsQuantised { from: ScalarType::Float },
        Warning::ElementSkipped { element: "edge".into(), count: 1 },
        Warning::TextureDropped { element: face(), properties: names(&["texcoord"]) },
        Warning::FaceAttributesDropped { element: face(), properties: names(&["red"]) },
        Warning::NormalsZeroed { count: 1 },
        Warning::ColorsClamped { count: 1 },
    ];
    assert_eq!(warnings, expected);
    assert!(warnings[3].to_string().contains("quantised"));
}

#[test]
fn data_after_the_body_is_a_warning() {
    for (at, specimen) in SPECIMENS.iter().enumerate().filter(|(at, _)| *at != 4) {
        let clean = read(specimen);
        let longer = [specimen, &b"17"[..]].concat();
        let (mesh, tally, mut warnings) = read(&longer);
        let trailing = Warning::TrailingData { offset: specimen.len() as u64 };
        assert_eq!(warnings.pop(), Some(trailing), "specimen {at}");
        assert_eq!(warnings.contains(&Warning::NormalsZeroed { count: 1 }), at == 5);
        assert_eq!((mesh, tally, warnings), clean, "specimen {at}");
    }
    let blanks = [SPECIMENS[0], b" \r\n\t\n"].concat();
    assert_eq!(read(&blanks).2.len(), 1, "white space after text is nothing");
}

#[test]
fn a_mesh_of_nothing_is_a_mesh() {
    let text = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n\
        element face 0\nproperty list uchar int vertex_indices\nend_header\n";
    assert_eq!(read(text.as_bytes()), (TriMesh::default(), Tally::default(), vec![]));
}
