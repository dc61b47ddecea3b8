//! No bytes make the reader panic, hang or ask for memory that the file does not justify.

use crate::forge::{Random, SPECIMENS};
use chpm_import::ply::{Batch, BatchKind, Invalid, Options, PlyError, PlyReader};
use proptest::prelude::*;

/// Reads all, in both modes, and checks what holds for any input whatever.
fn digest(bytes: &[u8]) {
    for invalid in [Invalid::Refuse, Invalid::Drop] {
        let Ok(mut reader) = PlyReader::new(bytes, Options { invalid, ..Options::default() }) else {
            continue;
        };
        let mut batch = Batch::default();
        let (mut vertices, mut faces) = (0, 0);
        loop {
            match reader.next_batch(&mut batch) {
                Ok(BatchKind::End) => {
                    assert_eq!(vertices + reader.tally().missing_vertices, reader.header().vertex_count);
                    break;
                }
                Ok(BatchKind::Vertices) => {
                    assert_eq!(batch.first, vertices);
                    let count = batch.vertices.positions.len() + batch.positions_f64.len();
                    assert!(count > 0 && batch.triangles.is_empty());
                    vertices += count as u64;
                    let attributes = reader.vertex_format().attributes;
                    assert_eq!(batch.vertices.normals.len(), if attributes.normals { count } else { 0 });
                    assert_eq!(batch.vertices.colors.len(), if attributes.colors { count } else { 0 });
                    let (singles, doubles) =
                        (batch.vertices.positions.as_flattened(), batch.positions_f64.as_flattened());
                    assert!(singles.iter().all(|x| x.is_finite()) && doubles.iter().all(|x| x.is_finite()));
                    assert!(batch.vertices.normals.as_flattened().iter().all(|x| x.is_finite()));
                }
                Ok(BatchKind::Triangles) => {
                    assert_eq!(batch.first, faces);
                    let count = batch.triangles.len() + batch.polygons.iter().count();
                    assert!(count > 0 && batch.vertices.positions.is_empty());
                    faces += count as u64;
                    let mut corners = batch.polygons.iter().flatten();
                    assert!(corners.all(|v| u64::from(*v) < reader.header().vertex_count));
                    assert!(batch.polygons.iter().all(|polygon| polygon.len() > 3));
                    for [a, b, c] in &batch.triangles {
                        assert!(a != b && b != c && c != a);
                        assert!(u64::from(*a.max(b).max(c)) < reader.header().vertex_count);
                    }
                }
                Err(error) => {
                    assert!(!error.to_string().is_empty());
                    break;
                }
            }
            assert!(reader.bytes_read() <= bytes.len() as u64);
        }
    }
}

#[test]
fn every_cut_is_survived_and_seen() {
    for specimen in SPECIMENS {
        let whole = PlyReader::new(specimen, Options::default()).unwrap().header().clone();
        for length in 0..specimen.len() {
            let cut = &specimen[..length];
            digest(cut);
            let mut batch = Batch::default();
            let read = || -> Result<(), PlyError> {
                let mut reader = PlyReader::new(cut, Options::default())?;
                while reader.next_batch(&mut batch)? != BatchKind::End {}
                Ok(())
            };
            // The last word of a text may lose digits or its line end unseen.
            let binary = whole.format != chpm_import::ply::Encoding::Ascii;
            if binary || length + 4 < specimen.len() {
                assert!({ read }().is_err(), "cut at {length} of {}", specimen.len());
            }
        }
    }
}

#[test]
fn every_flipped_byte_is_survived() {
    for specimen in SPECIMENS {
        for at in 0..specimen.len() {
            for flip in [0x01, 0x20, 0x80, 0xff] {
                let mut bytes = specimen.to_vec();
                bytes[at] ^= flip;
                digest(&bytes);
            }
        }
    }
}

#[test]
fn mutants_are_survived() {
    const WORDS: [&[u8]; 14] = [
        b"4294967295",
        b"18446744073709551615",
        b"-1",
        b"nan",
        b"list",
        b"\xff\xff\xff\xff",
        b"\x00\x00\xc0\x7f",
        b"\r",
        b"\n",
        b"element face 9\n",
        b"property list int int vertex_indices\n",
        b"binary_big_endian",
        b"ascii",
        b"double",
    ];
    let mut random = Random(20);
    for round in 0..6000 {
        let mut bytes = SPECIMENS[round % SPECIMENS.len()].to_vec();
        for _ in 0..=random.below(4) {
            let at = random.below(bytes.len());
            match random.below(5) {
                0 => bytes[at] = random.next() as u8,
                1 => {
                    let end = (at + random.below(9)).min(bytes.len());
                    bytes.drain(at..end);
                }
                2 => {
                    let word = WORDS[random.below(WORDS.len())];
                    bytes.splice(at..at, word.iter().copied());
                }
                3 => {
                    let word = WORDS[random.below(WORDS.len())];
                    let end = (at + word.len()).min(bytes.len());
                    bytes.splice(at..end, word.iter().copied());
                }
                _ => {
                    let from = random.below(bytes.len());
                    let end = (from + random.below(40)).min(bytes.len());
                    let copy = bytes[from..end].to_vec();
                    bytes.splice(at..at, copy);
                }
            }
            if bytes.is_empty() {
                break;
            }
        }
        digest(&bytes);
    }
}

#[test]
fn a_promise_costs_nothing() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for (extra, element) in
            [("", "vertex"), ("element junk 18446744073709551615\nproperty double d\n", "junk")]
        {
            let text = format!(
                "ply\nformat {format} 1.0\n{extra}element vertex 4000000000\nproperty float x\nproperty float y\n\
                 property float z\nelement face 18446744073709551615\nproperty list uchar int vertex_indices\n\
                 end_header\n1\n2\n3\n4\n5\n6\n7"
            );
            let mut batch = Batch::default();
            let mut reader = PlyReader::new(text.as_bytes(), Options::default()).unwrap();
            match reader.next_batch(&mut batch) {
                Err(PlyError::Truncated { place, read, .. }) => {
                    assert_eq!(place.element, element);
                    // 13 bytes and 7 words; a vertex takes 12 bytes or 3 words, junk 8 bytes or 1 word.
                    let whole = match (element, format) {
                        ("vertex", "ascii") => 2,
                        ("junk", "ascii") => 7,
                        _ => 1,
                    };
                    assert_eq!((place.index, read), (whole, whole));
                }
                other => panic!("{other:?}"),
            }
            assert!(batch.vertices.positions.capacity() <= 1 << 14);
            digest(text.as_bytes());
        }
    }
    // Elements of nothing are nothing, however many.
    let text = "ply\nformat ascii 1.0\nelement junk 18446744073709551615\nelement vertex 0\nproperty float x\n\
        property float y\nproperty float z\nend_header\n";
    digest(text.as_bytes());
}

#[test]
fn a_strip_is_as_long_as_its_data() {
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty char x\nproperty char y\n\
        property char z\nelement tristrips 1\nproperty list uint int vertex_indices\nend_header\n";
    let mut bytes = [header.as_bytes(), &[0; 9], &u32::MAX.to_le_bytes()].concat();
    bytes.extend((0..40_000u32).flat_map(|i| (i % 3).to_le_bytes()));
    digest(&bytes);
    let drop = Options { invalid: Invalid::Drop, ..Options::default() };
    let (mesh, tally, _) = chpm_import::ply::read_mesh(&bytes[..], drop).unwrap();
    assert_eq!((mesh.triangles.len(), tally.missing_faces, tally.strips), (39_998, 1, 1));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn noise_is_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        digest(&bytes);
        digest(&[&b"ply\n"[..], &bytes].concat());
    }

    #[test]
    fn a_noisy_body_is_survived(
        which in 0..SPECIMENS.len(),
        bytes in prop::collection::vec(any::<u8>(), 0..400),
    ) {
        let specimen = SPECIMENS[which];
        let body = PlyReader::new(specimen, Options::default()).unwrap().header().len as usize;
        digest(&[&specimen[..body], &bytes].concat());
    }

    #[test]
    fn a_wordy_header_is_survived(
        words in prop::collection::vec(
            prop::sample::select(vec![
                "element ", "property ", "list ", "vertex ", "face ", "tristrips ", "float ", "uchar ", "int ", "x\n",
                "y\n", "z\n", "3\n", "vertex_indices\n", "end_header\n", "comment ", "4294967295\n", "\r", "\n", "0 ",
            ]),
            0..60,
        ),
    ) {
        digest(format!("ply\nformat ascii 1.0\n{}", words.concat()).as_bytes());
    }
}
