//! Wavefront OBJ: what is read, what is left out, what is refused.

use chpm_import::ply::{Batch, BatchKind, Invalid, Options, Tally};
use chpm_import::{ImportError, ObjReader};

/// Everything of an OBJ.
#[derive(Debug, PartialEq)]
pub(crate) struct Obj {
    pub(crate) positions: Vec<[f64; 3]>,
    pub(crate) colors: Vec<[u8; 4]>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) polygons: Vec<Vec<u32>>,
    /// Values, and of each corner its vertex and the number of its normal.
    pub(crate) normals: (Vec<[f32; 3]>, Vec<[u32; 2]>),
    pub(crate) tally: Tally,
    pub(crate) warnings: Vec<String>,
}

pub(crate) fn read(text: &[u8], options: Options) -> Result<Obj, ImportError> {
    let mut reader = ObjReader::new(text, options)?;
    let (mut positions, mut colors, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    let (mut polygons, mut normals) = (Vec::new(), (Vec::new(), Vec::new()));
    let mut batch = Batch::default();
    loop {
        let kind = reader.next_batch(&mut batch)?;
        normals.0.append(&mut batch.listed_normals);
        normals.1.append(&mut batch.corner_normals);
        match kind {
            BatchKind::Vertices => {
                assert_eq!(batch.first, positions.len() as u64);
                positions.append(&mut batch.positions_f64);
                colors.append(&mut batch.vertices.colors);
            }
            BatchKind::Triangles => {
                assert_eq!(batch.first as usize, triangles.len() + polygons.len());
                triangles.append(&mut batch.triangles);
                polygons.extend(batch.polygons.iter().map(<[u32]>::to_vec));
            }
            BatchKind::End => break,
        }
    }
    assert_eq!(reader.vertex_format().attributes.colors, !colors.is_empty());
    assert_eq!(reader.vertices(), positions.len() as u64);
    Ok(Obj {
        positions,
        colors,
        triangles,
        polygons,
        normals,
        tally: reader.tally(),
        warnings: reader.warnings(),
    })
}

fn ok(text: &str) -> Obj {
    read(text.as_bytes(), Options::default()).unwrap()
}

fn error(text: &str) -> String {
    read(text.as_bytes(), Options::default()).unwrap_err().to_string()
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn polygons_are_read_whatever_their_corners_look_like() {
    for face in [
        "f 1 2 3 4",
        "f 1/1 2/2 3/3 4/4",
        "f 1//9 2//9 3//9 4//9",
        "f 1/1/1 2/2/1 3/3/1 4/4/1",
        "f -4 -3 -2 -1",
    ] {
        let obj = ok(&format!("{SQUARE}{face}\n"));
        assert_eq!(obj.polygons, [[0, 1, 2, 3]], "{face}");
        assert_eq!(obj.tally.polygons_triangulated, 1);
        assert_eq!(obj.positions[2], [1.0, 1.0, 0.0]);
    }
}

#[test]
fn negative_indices_count_from_where_they_stand() {
    let obj = ok("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -4 -3 -1\n");
    assert_eq!(obj.triangles, [[0, 1, 2], [0, 1, 3]]);
}

#[test]
fn faces_may_come_first_and_lines_may_go_on() {
    let obj = ok("f 1 2 \\\n 3\\\r\n\nv 0 0 0\nv 1 0 0\nv 0 \\\n1 0");
    assert_eq!((obj.triangles, obj.positions[2]), (vec![[0, 1, 2]], [0.0, 1.0, 0.0]));
}

#[test]
fn colours_are_fractions_or_bytes() {
    let obj = ok("v 0 0 0 1 0.5 0\nv 1 0 0 255 128 0\nv 0 1 0\nf 1 2 3\n");
    assert_eq!(obj.colors, [[255, 128, 0, 255], [255, 128, 0, 255], [255; 4]]);
    let plain = ok("v 0 0 0\nv 1 0 0 1 1 1\nv 0 1 0 1\nf 1 2 3\n");
    assert!(plain.colors.is_empty());
    assert_eq!(plain.warnings, ["dropped colours of 1 vertices, since the first one has none"]);
    let options = Options { colors: false, ..Options::default() };
    let bare = read(b"v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nf 1 2 3\n", options).unwrap();
    assert!(bare.colors.is_empty() && bare.warnings.is_empty(), "{bare:?}");
}

#[test]
fn dark_bytes_are_no_fractions() {
    let obj = ok("v 0 0 0 1 0 1\nv 1 0 0 9 0 0\nv 0 1 0 1 1 1\nf 1 2 3\n");
    assert_eq!(obj.colors, [[1, 0, 1, 255], [9, 0, 0, 255], [1, 1, 1, 255]]);
}

#[test]
fn comments_end_lines_and_no_line_goes_on_in_them() {
    let text =
        "# C:\\\nv 0 0 0 # first\nv 1 0 0#1 1 1\nv 0 1 0 # C:\\\nf 1 \\\n2 3 # 4\\\n# f 9 9 9\nf 3 2 1";
    for mark in ["", "\u{feff}"] {
        let obj = ok(&format!("{mark}{text}"));
        assert_eq!(obj.positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!((obj.triangles, obj.warnings), (vec![[0, 1, 2], [2, 1, 0]], vec![]));
    }
    assert_eq!(ok("\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3").triangles, [[0, 1, 2]]);
}

#[test]
fn what_is_left_out_is_told() {
    let obj = ok(&format!(
        "# x\nmtllib a.mtl\no thing\n{SQUARE}vt 0 0\nvn 0 0 1\ng a\nusemtl b\ns off\nl 1 2\nf 1 2 3\ncurv 0 1\ncurv 2\n"
    ));
    let expected = [
        "dropped 1 texture coordinates",
        "dropped 2 references to materials",
        "skipped 1 lines and points",
        "skipped 2 statements that are no mesh: curv",
    ];
    assert_eq!(obj.warnings, expected);
}

#[test]
fn normals_are_those_of_corners() {
    let text = format!(
        "{SQUARE}vn 0 0 1\nf 1//1 2//-1 3/4/2\nvn 1 0 -0.5\nf 1 3//2 4//2\nf 1 3 4\nf 1//1 1//1 1//2\n"
    );
    let obj = ok(&text);
    assert_eq!(obj.normals.0, [[0.0, 0.0, 1.0], [1.0, 0.0, -0.5]]);
    let bare = u32::MAX;
    assert_eq!(
        obj.normals.1,
        [[0, 0], [1, 0], [2, 1], [0, bare], [2, 1], [3, 1]],
        "bare corners are told once"
    );
    let without = Options { normals: false, ..Options::default() };
    assert_eq!(read(text.as_bytes(), without).unwrap().normals, (vec![], vec![]));

    let odd = ok(&format!(
        "{SQUARE}vn 0 0\nvn 0 nan 1\nvn a b c\nvn 1e99 0 0\nf 1//1 2//2 3//3\nf 1//9 2//0 3//-9\n"
    ));
    assert_eq!((odd.normals.0, odd.tally.zeroed_normals), (vec![[0.0; 3]; 4], 4));
    assert_eq!(odd.normals.1[3..], [[0, 8], [1, bare]]);
    assert_eq!(odd.warnings, ["replaced by zero 4 normals without finite numbers"]);
}

/// Normals that come in one block, as they mostly do, are handed over bit by bit like all else.
#[test]
fn normals_do_not_pile_up() {
    let text =
        format!("{}{SQUARE}f 1//1 2//2 3//3\n{}", "vn 0 0 1\n".repeat(50_000), "vn 0 1 0\n".repeat(50_000));
    let mut reader = ObjReader::new(text.as_bytes(), Options::default()).unwrap();
    let (mut batch, mut count) = (Batch::default(), 0);
    while reader.next_batch(&mut batch).unwrap() != BatchKind::End {
        assert!(batch.listed_normals.len() <= 1 << 14, "{}", batch.listed_normals.len());
        count += batch.listed_normals.len();
    }
    assert_eq!(count, 100_000);
}

#[test]
fn degenerate_faces_are_counted() {
    let obj = ok(&format!("{SQUARE}f 1 1 2\nf 1 2\nf 1 2 3\n"));
    assert_eq!((obj.triangles, obj.tally.degenerate_faces), (vec![[0, 1, 2]], 2));
}

#[test]
fn errors_name_place_and_reason() {
    for (text, words) in [
        ("v 0 0\n", "vertex 0, byte 0, line 1: expected three coordinates, got 'the end of the line'"),
        ("v 0 0 0\nv 1 x 0\n", "vertex 1, byte 8, line 2: expected three coordinates, got 'x'"),
        ("v 0 0 0\nv 1 nan 0\n", "vertex 1, byte 8, line 2: a coordinate is NaN"),
        ("v 1e999 0 0\n", "a coordinate is inf"),
        ("v 0 0 0\nf 1 1 0\n", "face 0, byte 8, line 2: vertex index 0 is out of range"),
        ("v 0 0 0\nf 1 1 -2\n", "vertex index -2 is out of range; there are 1 vertices"),
        (
            "v 0 0 0\nf 1 1 3\nv 0 0 0\n",
            "face 0, byte 8, line 2: vertex index 3 is out of range; there are 2 vertices",
        ),
        ("v 0 0 0\nf 1 a 1\n", "expected the number of a vertex, got 'a'"),
        ("v 0 0 0\nf 1 99999999999999999999 1\n", "expected the number of a vertex"),
        ("v 0 0 0\nf 1 5000000000 1\n", "vertex index 5000000000 is out of range"),
    ] {
        let error = error(text);
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn invalid_data_is_dropped_and_counted_on_request() {
    let options = Options { invalid: Invalid::Drop, ..Options::default() };
    let text = format!("{SQUARE}v nan 0 0\nf 1 2 3\nf 1 2 5\nf 1 2 9\nf 0 1 2\nf 1 3 4\n");
    let obj = read(text.as_bytes(), options).unwrap();
    assert_eq!(obj.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!((obj.tally.dropped_vertices, obj.tally.dropped_faces), (1, 3));
    assert_eq!(obj.positions[4], [0.0; 3]);
}

#[test]
fn many_batches_keep_everything() {
    let side = 200u32;
    let mut text = String::new();
    for i in 0..side * side {
        text += &format!("v {} {} 0\n", i % side, i / side);
        if i % side > 0 && i >= side {
            text += "f -1 -2 -1\n";
            text += &format!("f {} {} {}\n", i - side, i - side + 1, i + 1);
        }
    }
    let obj = ok(&text);
    assert_eq!(obj.positions.len() as u32, side * side);
    assert_eq!(obj.triangles.len() as u32, (side - 1) * (side - 1));
    assert_eq!(obj.tally.degenerate_faces as u32, (side - 1) * (side - 1));
    for triangle in &obj.triangles {
        let [a, b, c] = triangle.map(|v| obj.positions[v as usize]);
        assert!(b[0] - a[0] == 1.0 && c[1] - b[1] == 1.0, "{triangle:?}");
    }
}
