//! OFF as it comes, and as it must not.

use super::*;

/// Positions, triangles and warnings of a file whose faces are triangles.
fn read(bytes: &[u8], options: Options) -> Result<(Batch, Vec<String>, Tally), ImportError> {
    let head = &bytes[..bytes.len().min(Format::HEAD)];
    let mut reader = OffReader::new(bytes, head, options)?;
    let (mut all, mut batch) = (Batch::default(), Batch::default());
    loop {
        batch.clear();
        let kind = reader.fill(&mut batch)?;
        all.vertices.positions.append(&mut batch.vertices.positions);
        all.positions_f64.append(&mut batch.positions_f64);
        all.vertices.normals.append(&mut batch.vertices.normals);
        all.vertices.colors.append(&mut batch.vertices.colors);
        all.triangles.append(&mut batch.triangles);
        batch.polygons.iter().for_each(|corners| all.polygons.push(corners));
        if kind == BatchKind::End {
            return Ok((all, reader.warnings(), reader.tally));
        }
    }
}

fn refused(text: &str) -> String {
    read(text.as_bytes(), Options::default()).expect_err("not read").to_string()
}

const CORNERS: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.5, 0.0]];

#[test]
fn spacing_and_comments_do_not_matter() {
    for text in [
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1.5 0\n3 0 1 2\n",
        "OFF 3 1 3\r\n0 0 0\r\n1 0 0\r\n0 1.5 0\r\n3 0 1 2",
        "# made by hand\nOFF # a triangle\n\n3 1\n0 0 0 # first\n\n1 0 0\n0 1.5 0\n# faces\n3 0 1 2\n",
        "3 1 0\n0 0 0\n1 0 0\n0 1.5 0\n3 0 1 2\n",
        "\u{feff}OFF\r3\r1 0\r0 0 0\r1 0 0\r0 1.5 0\r3 0 1 2\r",
    ] {
        let (mesh, warnings, _) = read(text.as_bytes(), Options::default()).expect("a mesh");
        assert_eq!(
            (&mesh.positions_f64[..], &mesh.triangles[..]),
            (&CORNERS[..], &[[0, 1, 2]][..]),
            "{text}"
        );
        assert!(warnings.is_empty(), "{warnings:?}");
    }
}

#[test]
fn prefixes_say_what_vertices_have() {
    let text = "STCNOFF\n3 1 0\n0 0 0 0 0 1 255 0 0 128 0.5 0.5\n1 0 0 0 nan 1 1 0.5 0 1 0 0\n\
                0 1.5 0 0 1 0 1 0 0 255 1 1\n3 0 1 2 9 9 9\n";
    let (mesh, warnings, tally) = read(text.as_bytes(), Options::default()).expect("a mesh");
    assert_eq!(mesh.vertices.normals, [[0.0, 0.0, 1.0], [0.0; 3], [0.0, 1.0, 0.0]]);
    assert_eq!(mesh.vertices.colors, [[255, 0, 0, 128], [255, 128, 0, 255], [1, 0, 0, 255]]);
    assert_eq!(tally.zeroed_normals, 1);
    let told = warnings.join("\n");
    for words in ["dropped 3 texture coordinates", "dropped colours of 1 faces", "normal"] {
        assert!(told.contains(words), "{told}");
    }
    let bare = Options { normals: false, colors: false, ..Options::default() };
    let (mesh, ..) = read(text.as_bytes(), bare).expect("a mesh");
    assert!(mesh.vertices.normals.is_empty() && mesh.vertices.colors.is_empty());
}

#[test]
fn binary_files_are_big_endian() {
    let mut bytes = b"# by a program\nNOFF BINARY\r\n".to_vec();
    let integers =
        |out: &mut Vec<u8>, values: &[i32]| values.iter().for_each(|x| out.extend(x.to_be_bytes()));
    integers(&mut bytes, &[4, 1, 0]);
    for corner in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]] {
        corner.iter().chain(&[0.0, 0.0, 1.0]).for_each(|x| bytes.extend(x.to_be_bytes()));
    }
    integers(&mut bytes, &[4, 0, 1, 2, 3, 1]);
    bytes.extend(0.5f32.to_be_bytes());
    let (mesh, warnings, _) = read(&bytes, Options::default()).expect("a mesh");
    assert_eq!((mesh.vertices.positions.len(), mesh.vertices.normals[3]), (4, [0.0, 0.0, 1.0]));
    assert_eq!(mesh.polygons.iter().collect::<Vec<_>>(), [[0, 1, 2, 3]]);
    assert_eq!(warnings, ["dropped colours of 1 faces"]);
    for cut in 0..bytes.len() {
        assert!(read(&bytes[..cut], Options::default()).is_err(), "{cut}");
    }
}

#[test]
fn what_is_wrong_names_its_place() {
    for (text, words) in [
        ("OFF\n", "the numbers of vertices and faces"),
        ("OFF\n3 x 0\n", "line 2: expected the numbers of vertices and faces, got 'x'"),
        ("OFF\n-3 1 0\n", "got '-3'"),
        ("OFF\n3 1 0\n0 0 0\n", "vertex 1, byte 16, line 4: the file ends here; expected 2 vertices more"),
        ("OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "expected 1 faces more"),
        ("OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "line 4: expected three coordinates"),
        ("OFF\n3 1 0\n0 0 0\n1 0 inf\n0 1 0\n3 0 1 2\n", "a coordinate is inf"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "vertex index 3 is out of range"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "vertex index -1 is out of range"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", "expected the number of corners"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n99999999 0 1 2\n", "expected the number of corners"),
        ("4OFF\n3 1 0\n", "other than three coordinates"),
        ("OFF\n9999999999 1 0\n", "more than"),
    ] {
        let told = refused(text);
        assert!(told.contains(words), "{text}: {told}");
    }
}

#[test]
fn invalid_data_is_left_out_on_request() {
    let drop = Options { invalid: Invalid::Drop, ..Options::default() };
    let text = "OFF\n4 5 0\n0 0 0\n1 0 0\n0 1 0\nnan 0 0\n3 0 1 2\n3 0 1 3\n3 0 1 7\n2 0 1\n";
    let (mesh, _, tally) = read(text.as_bytes(), drop).expect("a mesh");
    assert_eq!((mesh.triangles.len(), mesh.positions_f64[3]), (1, [0.0; 3]));
    let Tally { dropped_vertices, dropped_faces, missing_faces, degenerate_faces, .. } = tally;
    assert_eq!([dropped_vertices, dropped_faces, missing_faces, degenerate_faces], [1, 2, 1, 1]);
}

proptest::proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(tail: Vec<u8>, keyword in "(ST)?C?N?OFF( BINARY)?", counts in "[0-9 ]{0,9}", drop: bool) {
        let text = format!("{keyword}\n{counts}\n");
        let bytes = [text.as_bytes(), &tail].concat();
        let invalid = if drop { Invalid::Drop } else { Invalid::Refuse };
        if let Ok((mesh, ..)) = read(&bytes, Options { invalid, ..Options::default() }) {
            let vertices = mesh.positions_f64.len() + mesh.vertices.positions.len();
            assert!(mesh.triangles.as_flattened().iter().all(|v| (*v as usize) < vertices));
        }
    }
}
