//! Named scalars: every type, in every encoding, comes back bit for bit.

use chpm_import::ply::{Batch, BatchKind, Encoding, Keep, Options, PlyError, PlyReader, PlyWriter, Warning};
use chpm_mesh::{Attributes, Scalar, ScalarKind, VertexSlices};

const ALL: Keep = Keep { all: true, names: Vec::new() };

fn keep(names: &[&str]) -> Keep {
    Keep { all: false, names: names.iter().map(|name| name.to_string()).collect() }
}

/// Values of each kind, some odd, in the order of the kinds.
fn rows() -> Vec<[f64; 8]> {
    vec![
        [-128.0, 0.0, -32768.0, 65535.0, -2147483648.0, 4294967295.0, -0.0, 0.1],
        [127.0, 255.0, 32767.0, 0.0, 2147483647.0, 16777217.0, f64::from(1e-45f32), f64::MAX],
        [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, f64::INFINITY, f64::NEG_INFINITY],
    ]
}

/// A triangle of vertices with these scalars, and what their words are.
fn written(encoding: Encoding, odd_bits: bool) -> (Vec<u8>, Vec<Scalar>, Vec<u32>) {
    let scalars = ScalarKind::ALL.map(|kind| Scalar::new(format!("of_{kind}"), kind)).to_vec();
    let mut words = Vec::new();
    for row in rows() {
        ScalarKind::ALL.iter().zip(row).for_each(|(kind, value)| kind.put(value, &mut words));
    }
    if odd_bits {
        // What is no number, each with bits of its own; the first is one that arithmetic would change.
        (words[8], words[9], words[10]) = (0x7f80_1234, 0x1234_5678, 0xfff8_0001);
    }
    let attributes = Attributes { scalar_words: 11, ..Attributes::NONE };
    let mut ply =
        PlyWriter::with_scalars(Vec::new(), encoding, 3, 1, attributes, &scalars, false, &[]).unwrap();
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    ply.vertices(VertexSlices { scalars: &words, ..VertexSlices::new(&positions) }).unwrap();
    ply.triangles(&[[0, 1, 2]]).unwrap();
    (ply.finish().unwrap(), scalars, words)
}

fn read(bytes: &[u8], keep: Keep) -> Result<(Vec<Scalar>, Batch, Vec<Warning>), PlyError> {
    let mut reader = PlyReader::new(bytes, Options { keep, ..Options::default() })?;
    let mut batch = Batch::default();
    assert_eq!(reader.next_batch(&mut batch)?, BatchKind::Vertices);
    Ok((reader.scalars().to_vec(), batch, reader.warnings().to_vec()))
}

#[test]
fn every_type_comes_back_from_every_encoding() {
    for encoding in [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian] {
        let (bytes, scalars, words) = written(encoding, encoding != Encoding::Ascii);
        let (read_scalars, batch, warnings) = read(&bytes, ALL).unwrap();
        assert_eq!((read_scalars, warnings), (scalars, vec![]), "{encoding}");
        assert_eq!(batch.vertices.scalars, words, "{encoding}");
    }
}

#[test]
fn records_of_no_fixed_length_give_the_same() {
    // A list in front, so that vertices are read number by number.
    let (bytes, _, words) = written(Encoding::BinaryBigEndian, true);
    let text = "property float x\n";
    let at = bytes.windows(text.len()).position(|window| window == text.as_bytes()).unwrap();
    let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let mut listed = [&bytes[..at], b"property list uchar uchar few\n", &bytes[at..end]].concat();
    let stride = 12 + 1 + 1 + 2 + 2 + 4 + 4 + 4 + 8;
    for record in bytes[end..end + 3 * stride].chunks(stride) {
        listed.extend_from_slice(&[2, 7, 7]);
        listed.extend_from_slice(record);
    }
    listed.extend_from_slice(&bytes[end + 3 * stride..]);
    assert_eq!(read(&listed, ALL).unwrap().1.vertices.scalars, words);
    let refused = read(&listed, keep(&["few"])).unwrap_err().to_string();
    assert!(refused.contains("'few' is a list and no scalar"), "{refused}");
}

#[test]
fn those_that_are_named_come_in_their_order() {
    let (bytes, scalars, words) = written(Encoding::BinaryLittleEndian, false);
    let (chosen, batch, warnings) = read(&bytes, keep(&["of_float64", "of_uint8"])).unwrap();
    assert_eq!(chosen, [scalars[7].clone(), scalars[1].clone()]);
    let expected: Vec<u32> = words.chunks(11).flat_map(|row| [row[9], row[10], row[1]]).collect();
    assert_eq!(batch.vertices.scalars, expected);
    assert!(
        matches!(&warnings[..], [Warning::VertexPropertiesDropped { properties, .. }] if properties.len() == 6)
    );

    for (name, told) in [
        ("x", "is a coordinate"),
        ("rainbow", "no scalar 'rainbow' to keep; vertices of this file have of_int8,"),
    ] {
        let refused = read(&bytes, keep(&[name])).unwrap_err().to_string();
        assert!(refused.contains(told), "{refused}");
    }
}

#[test]
fn colours_of_more_than_eight_bits_are_kept_beside_those() {
    let text =
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        property ushort red\nproperty float green\nproperty uchar blue\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0 65534 0.3 7\n3 0 0 0\n";
    let (scalars, batch, warnings) = read(text, ALL).unwrap();
    let names: Vec<&str> = scalars.iter().map(|scalar| &*scalar.name).collect();
    assert_eq!((names, warnings), (vec!["red", "green"], vec![]));
    assert_eq!(batch.vertices.scalars, [65534.0f32.to_bits(), 0.3f32.to_bits()]);
    assert_eq!(batch.vertices.colors, [[255, 77, 7, 255]]);
    let refused = read(text, keep(&["blue"])).unwrap_err().to_string();
    assert!(refused.contains("'blue' is part of the colour"), "{refused}");

    // Written, they come in the place of the eight bits, and both come back.
    let attributes = Attributes { colors: true, scalar_words: 2, ..Attributes::NONE };
    let mut ply =
        PlyWriter::with_scalars(Vec::new(), Encoding::Ascii, 1, 0, attributes, &scalars, false, &[]).unwrap();
    ply.vertices_f64(&batch.positions_f64, batch.vertices.view()).unwrap();
    let text = String::from_utf8(ply.finish().unwrap()).unwrap();
    assert!(
        text.contains(
            "property uchar blue\nproperty uchar alpha\nproperty ushort red\nproperty float green\n"
        )
    );
    assert!(text.ends_with("0.0 0.0 0.0 7 255 65534 0.3\n"), "{text}");
}

#[test]
fn foreign_names_do_not_end_a_header() {
    let scalars = [Scalar::new("a\nend_header", ScalarKind::Uint8), Scalar::new("x", ScalarKind::Uint8)];
    let attributes = Attributes { scalar_words: 2, ..Attributes::NONE };
    let ply =
        PlyWriter::with_scalars(Vec::new(), Encoding::Ascii, 0, 0, attributes, &scalars, false, &[]).unwrap();
    let text = String::from_utf8(ply.finish().unwrap()).unwrap();
    assert!(text.contains("property uchar a_end_header\nproperty uchar x_2\n"), "{text}");
}
