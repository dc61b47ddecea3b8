//! STL: both kinds, whole and damaged.

use chpm_import::ply::{Invalid, Tally};
use chpm_import::{Corners, ImportError, StlReader};

pub(crate) fn read(
    bytes: &[u8],
    is_text: bool,
    invalid: Invalid,
) -> Result<(Vec<Corners>, Tally, Vec<String>), ImportError> {
    let mut reader = StlReader::new(bytes, is_text, invalid)?;
    let (mut all, mut batch) = (Vec::new(), Vec::new());
    while reader.next_batch(&mut batch)? {
        all.append(&mut batch);
    }
    Ok((all, reader.tally(), reader.warnings().to_vec()))
}

pub(crate) fn binary(facets: &[Corners]) -> Vec<u8> {
    let mut bytes = vec![b'x'; 80];
    bytes.extend((facets.len() as u32).to_le_bytes());
    for facet in facets {
        bytes.extend([0; 12]);
        bytes.extend(facet.as_flattened().iter().flat_map(|x| (*x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ascii(facets: &[Corners]) -> String {
    let mut text = "solid by hand\n".to_owned();
    for facet in facets {
        text += "  facet normal 0 0 1\n    outer loop\n";
        facet.iter().for_each(|[x, y, z]| text += &format!("      vertex {x} {y:e} {z}\r\n"));
        text += "    endloop\n  endfacet\n";
    }
    text + "endsolid by hand\n"
}

fn soup(count: usize) -> Vec<Corners> {
    // Singles, so that both kinds can hold them.
    let at = |i: usize, k: usize| [i as f32, k as f32 * 0.1, (i * k) as f32].map(f64::from);
    (0..count).map(|i| std::array::from_fn(|k| at(i, k))).collect()
}

#[test]
fn both_kinds_tell_the_same_facets() {
    for count in [0, 1, 7, 20_000] {
        let soup = soup(count);
        let (b, _, warnings) = read(&binary(&soup), false, Invalid::Refuse).unwrap();
        let (a, _, _) = read(ascii(&soup).as_bytes(), true, Invalid::Refuse).unwrap();
        assert!(a == soup && b == soup && warnings.is_empty(), "{count}");
    }
}

#[test]
fn minus_zero_is_zero() {
    let soup = [[[-0.0f64; 3]; 3]];
    let (b, ..) = read(&binary(&soup), false, Invalid::Refuse).unwrap();
    let (a, ..) = read(ascii(&soup).as_bytes(), true, Invalid::Refuse).unwrap();
    for facets in [a, b] {
        assert!(facets.as_flattened().as_flattened().iter().all(|x| x.to_bits() == 0));
    }
}

#[test]
fn text_may_be_written_otherwise() {
    let text = "SOLID\nFACET NORMAL 0 0 0 OUTER LOOP\nVERTEX 0 0 0 VERTEX 1 0 0 VERTEX 0 1 0\nENDLOOP ENDFACET\nEndSolid\n\
                solid second facet vertex\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendfacet\nfacet\nendfacet\nendsolid";
    let (facets, tally, _) = read(text.as_bytes(), true, Invalid::Refuse).unwrap();
    assert_eq!(facets.len(), 3);
    assert_eq!((tally.polygons_triangulated, tally.degenerate_faces), (1, 1));
    assert_eq!(facets[2], [[0.0; 3], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
}

#[test]
fn a_facet_may_be_one_line() {
    let facet =
        "facet normal 0 -nan(ind) 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet";
    for (text, count) in [
        (format!("solid a\n{facet}\n{facet}\nendsolid a"), 2),
        (format!("solid\n{facet} {facet} endsolid"), 2),
        ("solid\nFacet Normal 0 0 1 Vertex 0 0 0\nvertex 1 0 0 vertex 0 1 0\nendfacet\nfacet normal 0 0 1 endfacet\nendsolid".to_owned(), 1),
    ] {
        let (facets, ..) = read(text.as_bytes(), true, Invalid::Refuse).unwrap();
        assert_eq!(facets, vec![[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]; count], "{text}");
    }
}

#[test]
fn attributes_and_trailing_bytes_are_told() {
    let mut bytes = binary(&soup(3));
    bytes[84 + 50 + 48] = 1;
    bytes.extend(b"more");
    let (facets, _, warnings) = read(&bytes, false, Invalid::Refuse).unwrap();
    assert_eq!(facets, soup(3));
    assert_eq!(
        warnings,
        [
            "ignored data after the last facet, from byte 234 on",
            "dropped the attribute bytes (colours) of 1 facets"
        ]
    );
}

#[test]
fn errors_name_place_and_reason() {
    let mut bad = soup(2);
    bad[1][2][0] = f64::NAN;
    let (whole, text) = (binary(&soup(2)), ascii(&soup(2)));
    let cases: [(&[u8], bool, &str); 9] = [
        (&whole[..50], false, "header 0, byte 50: the file ends here; expected a header of 84 bytes"),
        (&whole[..140], false, "facet 1, byte 140: the file ends here; expected 1 facets more"),
        (&binary(&bad), false, "facet 1, byte 134: a coordinate is NaN"),
        (&ascii(&bad).into_bytes(), true, "facet 1, byte"),
        (&text.as_bytes()[..text.find("endsolid").unwrap()], true, "the file ends here; expected 'endsolid'"),
        (&text.as_bytes()[..100], true, "expected"),
        (b"solid\nfacet\nvertex 0 0\n", true, "line 3: expected three numbers after 'vertex'"),
        (
            b"solid\nvertex 0 0 0\n",
            true,
            "facet 0, byte 6, line 2: expected 'facet' or 'endsolid', got 'vertex'",
        ),
        (b"solid\nfacet\nfacet\n", true, "expected 'vertex' or 'endfacet', got 'facet'"),
    ];
    for (bytes, format, words) in cases {
        let error = read(bytes, format, Invalid::Refuse).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
}

#[test]
fn invalid_data_is_dropped_and_counted_on_request() {
    let mut bad = soup(3);
    bad[1][0][0] = f64::INFINITY;
    let bytes = binary(&bad);
    let (facets, tally, _) = read(&bytes[..bytes.len() - 10], false, Invalid::Drop).unwrap();
    assert_eq!(facets, soup(1));
    assert_eq!((tally.dropped_faces, tally.missing_faces), (1, 1));
    let text = ascii(&bad);
    let cut = text.rfind("    endloop").unwrap();
    let (facets, tally, _) = read(&text.as_bytes()[..cut], true, Invalid::Drop).unwrap();
    assert_eq!(facets, soup(1));
    assert_eq!((tally.dropped_faces, tally.missing_faces), (1, 1));
}
