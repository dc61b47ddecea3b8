//! A mesh as a file, in every format that is read and in the odder ways of writing each.

use crate::draw::Draw;
use crate::gltf;
use crate::model::Model;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::fmt::Write as _;
use std::io::Write as _;

/// A source: what is to be built, and files that it names.
#[derive(Clone)]
pub(crate) struct Source {
    pub(crate) name: String,
    pub(crate) bytes: Vec<u8>,
    /// Meshes of a list.
    pub(crate) beside: Vec<(String, Vec<u8>)>,
}

pub(crate) fn write(model: &Model, draw: &mut Draw<'_>) -> Source {
    let (name, bytes) = match draw.below(16) {
        0..=4 => ("mesh.ply", ply(model, draw)),
        5 => ("mesh.stl", stl_binary(model, draw)),
        6 => ("mesh.stl", stl_text(model, draw)),
        7 | 8 => ("mesh.obj", obj(model, draw)),
        9 | 10 => ("mesh.off", off(model, draw)),
        11 | 12 => return gltf::write(model, draw),
        13 => return scans(model, draw),
        _ => return tiles(model, draw),
    };
    Source { name: name.to_owned(), bytes, beside: vec![] }
}

/// Packs a source, so that what was changed in it before is met behind the decoder.
pub(crate) fn pack(mut source: Source, draw: &mut Draw<'_>) -> Source {
    match draw.below(10) {
        8 => {
            let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
            encoder.write_all(&source.bytes).expect("compressed");
            source.bytes = encoder.finish().expect("compressed");
            source.name += ".gz";
        }
        9 => {
            source.bytes = zstd::stream::encode_all(&source.bytes[..], 1).expect("compressed");
            source.name += ".zst";
        }
        _ => {}
    }
    source
}

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Little,
    Big,
    Text,
}

fn put(out: &mut Vec<u8>, encoding: Encoding, ty: &str, value: f64) {
    let mut raw = match (encoding, ty) {
        (Encoding::Text, "float") => format!("{} ", value as f32).into_bytes(),
        (Encoding::Text, "double") => format!("{value:?} ").into_bytes(),
        (Encoding::Text, _) => format!("{} ", value as i64).into_bytes(),
        (_, "float") => (value as f32).to_le_bytes().to_vec(),
        (_, "double") => value.to_le_bytes().to_vec(),
        (_, "uchar" | "char") => vec![value as i64 as u8],
        (_, "ushort" | "short") => (value as i64 as u16).to_le_bytes().to_vec(),
        _ => (value as i64 as u32).to_le_bytes().to_vec(),
    };
    if encoding == Encoding::Big {
        raw.reverse();
    }
    out.extend(raw);
}

pub(crate) fn ply(model: &Model, draw: &mut Draw<'_>) -> Vec<u8> {
    let encoding = draw.pick(&[Encoding::Little, Encoding::Big, Encoding::Text]);
    let format = match encoding {
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
        Encoding::Text => "ascii",
    };
    let end = draw.pick(&["\n", "\n", "\r\n", "\r"]);
    let coordinate = draw.pick(&["float", "float", "double", "int"]);
    let (count, index) =
        (draw.pick(&["uchar", "int", "ushort", "uint"]), draw.pick(&["int", "uint", "short"]));
    let strips = draw.once_in(6);
    let (extra, extra_element, faces_first) = (draw.once_in(4), draw.once_in(8), draw.once_in(10));
    let lie = if draw.once_in(12) { draw.odd_integer() } else { 0 };

    let mut vertex = vec![(coordinate, "x"), (coordinate, "y"), (coordinate, "z")];
    let quality = draw.pick(&["short", "float", "double", "uint", "uchar"]);
    if extra {
        vertex.insert(draw.below(4), (quality, "quality"));
    }
    if !model.normals.is_empty() {
        let ty = draw.pick(&["float", "float", "double"]);
        vertex.extend(["nx", "ny", "nz"].map(|name| (ty, name)));
    }
    if !model.colors.is_empty() {
        vertex.extend(
            ["red", "green", "blue", "alpha"].map(|name| ("uchar", name)).iter().take(draw.pick(&[4, 3])),
        );
    }
    let mut vertices = Vec::new();
    for (i, p) in model.positions.iter().enumerate() {
        for (ty, name) in &vertex {
            let value = match *name {
                "x" => p[0],
                "y" => p[1],
                "z" => p[2],
                "nx" => model.normals[i][0].into(),
                "ny" => model.normals[i][1].into(),
                "nz" => model.normals[i][2].into(),
                "red" => model.colors[i][0].into(),
                "green" => model.colors[i][1].into(),
                "blue" => model.colors[i][2].into(),
                // Some of them are no number, where there is such a one.
                _ if i % 5 == 4 => f64::NAN,
                _ => i as f64 / 3.0,
            };
            put(&mut vertices, encoding, ty, value);
        }
        if encoding == Encoding::Text {
            vertices.extend(end.as_bytes());
        }
    }
    let mut lists: Vec<Vec<i64>> = model.faces.clone();
    if strips {
        lists = lists.chunks(50).map(|faces| faces.join(&-1)).collect();
    }
    let count = if strips { "int" } else { count };
    let mut faces = Vec::new();
    for list in &lists {
        put(&mut faces, encoding, count, list.len() as f64);
        list.iter().for_each(|v| put(&mut faces, encoding, index, *v as f64));
        if encoding == Encoding::Text {
            faces.extend(end.as_bytes());
        }
    }

    let mut header = format!("ply{end}format {format} 1.0{end}comment made to be odd{end}");
    let list_name = draw.pick(&["vertex_indices", "vertex_index"]);
    let element = if strips { "tristrips" } else { "face" };
    let of_vertices = {
        let mut text = format!("element vertex {}{end}", (model.positions.len() as u64).wrapping_add(lie));
        vertex.iter().for_each(|(ty, name)| write!(text, "property {ty} {name}{end}").expect("text"));
        text
    };
    let of_faces = format!(
        "element {element} {}{end}property list {count} {index} {list_name}{end}",
        (lists.len() as u64).wrapping_add(lie >> 1)
    );
    let mut unknown = Vec::new();
    let mut parts = [(of_vertices, vertices), (of_faces, faces)];
    if faces_first {
        parts.reverse();
    }
    let mut body = Vec::new();
    for (text, bytes) in parts {
        if extra_element && body.is_empty() {
            write!(header, "element stuff 3{end}property list uchar float what{end}").expect("text");
            for n in 0..3 {
                put(&mut unknown, encoding, "uchar", f64::from(n));
                (0..n).for_each(|_| put(&mut unknown, encoding, "float", 0.5));
                if encoding == Encoding::Text {
                    unknown.extend(end.as_bytes());
                }
            }
            body.append(&mut unknown);
        }
        header += &text;
        body.extend(bytes);
    }
    header += "end_header";
    header += end;
    [header.into_bytes(), body].concat()
}

/// The corners of every triangle of fans about first corners; faces with an index out of range are left out.
fn corners(model: &Model) -> Vec<[[f64; 3]; 3]> {
    let place = |v: &i64| usize::try_from(*v).ok().and_then(|v| model.positions.get(v)).copied();
    let mut triangles = Vec::new();
    for face in &model.faces {
        let Some(corners) = face.iter().map(place).collect::<Option<Vec<_>>>() else { continue };
        triangles.extend((2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]]));
    }
    triangles
}

fn stl_binary(model: &Model, draw: &mut Draw<'_>) -> Vec<u8> {
    let triangles = corners(model);
    let mut bytes = draw.pick(&[*b"made", *b"soli", [0x89; 4]]).to_vec();
    bytes.resize(80, b' ');
    let lie = if draw.once_in(8) { draw.odd_integer() as u32 } else { 0 };
    bytes.extend((triangles.len() as u32).wrapping_add(lie).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        triangle.as_flattened().iter().for_each(|x| bytes.extend((*x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn stl_text(model: &Model, draw: &mut Draw<'_>) -> Vec<u8> {
    let (end, indent) = (draw.pick(&["\n", "\r\n"]), draw.pick(&["  ", "", "\t"]));
    let single = draw.once_in(2);
    let mut text = format!("solid odd{end}");
    for triangle in corners(model) {
        write!(text, "{indent}facet normal 0 0 1{end}{indent}outer loop{end}").expect("text");
        for [x, y, z] in triangle {
            match single {
                true => write!(text, "vertex {} {} {}{end}", x as f32, y as f32, z as f32),
                false => write!(text, "{indent}vertex {x:?} {y:e} {z}{end}"),
            }
            .expect("text");
        }
        write!(text, "endloop{end}endfacet{end}").expect("text");
    }
    text += if draw.once_in(5) { "" } else { "endsolid odd" };
    text.into_bytes()
}

fn obj(model: &Model, draw: &mut Draw<'_>) -> Vec<u8> {
    let (end, from_end, normals) = (draw.pick(&["\n", "\r\n"]), draw.once_in(4), !model.normals.is_empty());
    let shared_normal = draw.once_in(3);
    let mut text = format!("# odd{end}mtllib none.mtl{end}o thing{end}");
    for (i, [x, y, z]) in model.positions.iter().enumerate() {
        match model.colors.get(i) {
            Some([r, ..]) => write!(text, "v {x} {y} {z} {} 0.5 1{end}", f32::from(*r) / 255.0),
            None => write!(text, "v {x:?} {y:?} {z:?}{end}"),
        }
        .expect("text");
    }
    for [x, y, z] in &model.normals {
        write!(text, "vn {x} {y} {z}{end}").expect("text");
    }
    for (i, face) in model.faces.iter().enumerate() {
        if i % 64 == 63 {
            write!(text, "g part{i}{end}usemtl m{end}").expect("text");
        }
        text += "f";
        for v in face {
            let v = if from_end { v.wrapping_sub(model.positions.len() as i64) } else { v.wrapping_add(1) };
            match (normals, shared_normal) {
                (true, true) => write!(text, " {v}//1"),
                (true, false) => write!(text, " {v}//{v}"),
                _ => write!(text, " {v}"),
            }
            .expect("text");
        }
        text += end;
    }
    text.into_bytes()
}

fn off(model: &Model, draw: &mut Draw<'_>) -> Vec<u8> {
    let (normals, colors, is_binary) = (!model.normals.is_empty(), !model.colors.is_empty(), draw.once_in(3));
    let texture = draw.once_in(8);
    let prefix = [(texture, "ST"), (colors, "C"), (normals, "N")];
    let prefix: String = prefix.iter().filter(|(is, _)| *is).map(|(_, name)| *name).collect();
    let end = draw.pick(&["\n", "\r\n", "\r"]);
    let lie = if draw.once_in(12) { draw.odd_integer() as usize } else { 0 };
    let counts = [model.positions.len().wrapping_add(lie), model.faces.len().wrapping_add(lie >> 1), 0];
    let encoding = if is_binary { Encoding::Big } else { Encoding::Text };
    let mut out = format!("{prefix}OFF{}{end}", if is_binary { " BINARY" } else { "" }).into_bytes();
    if !is_binary && draw.once_in(3) {
        out.extend(format!("# odd{end}{end}").bytes());
    }

    let row = |out: &mut Vec<u8>, ty: &str, numbers: &[f64]| {
        numbers.iter().for_each(|x| put(out, encoding, ty, *x));
        if !is_binary {
            out.extend(end.bytes());
        }
    };
    row(&mut out, "int", &counts.map(|count| count as f64));
    let share = f64::from(draw.pick(&[1_u8, 255]));
    let coordinate = if is_binary { "float" } else { "double" };
    for (i, position) in model.positions.iter().enumerate() {
        let mut numbers = position.to_vec();
        numbers.extend(model.normals.get(i).into_iter().flatten().map(|x| f64::from(*x)));
        numbers.extend(model.colors.get(i).into_iter().flatten().map(|x| f64::from(*x) / share));
        numbers.extend(texture.then_some([0.5, 2.0]).into_iter().flatten());
        row(&mut out, coordinate, &numbers);
    }
    for (i, face) in model.faces.iter().enumerate() {
        let mut numbers = vec![face.len() as f64];
        numbers.extend(face.iter().map(|v| *v as f64));
        numbers.extend(is_binary.then_some(0.0));
        numbers.extend((!is_binary && i % 9 == 8).then_some(7.0));
        row(&mut out, "int", &numbers);
    }
    out
}

/// A list that names one mesh several times, or a scan as a grid.
fn scans(model: &Model, draw: &mut Draw<'_>) -> Source {
    let mut list = "# odd\ncamera 0 0 0 0 0 0 1\n".to_owned();
    let mut beside = vec![("a.ply".to_owned(), ply(model, draw))];
    if draw.once_in(2) {
        beside.push(("b.ply".to_owned(), grid(draw)));
    }
    for i in 0..draw.between(1, 3) {
        let name = if i == 2 && draw.once_in(4) { "missing.ply" } else { &beside[i % beside.len()].0 };
        let turn = draw.pick(&["0 0 0 1", "0.5 0.5 0.5 0.5", "0 0 1e-30 1", "0 0 0 0"]);
        writeln!(list, "bmesh {name} {} {i} 0 {turn}", draw.pick(&["0", "1e6", "1e39"])).expect("text");
    }
    Source { name: "mesh.conf".to_owned(), bytes: list.into_bytes(), beside }
}

/// A list of tiles that are one model in several formats, so that all of it may be joined.
fn tiles(model: &Model, draw: &mut Draw<'_>) -> Source {
    let head = draw.pick(&["tiles", "# odd\n\ntiles", "tiles weld 0", "tiles weld 1e-3", "tiles weld 1e300"]);
    let mut list = format!("{head}\n");
    let mut beside = Vec::new();
    for i in 0..draw.between(1, 3) {
        let (kind, bytes) = match draw.below(4) {
            0 => ("obj", obj(model, draw)),
            1 => ("stl", stl_binary(model, draw)),
            2 => ("off", off(model, draw)),
            _ => ("ply", ply(model, draw)),
        };
        let name = format!("{i}.{kind}");
        writeln!(list, "{}", if i == 2 && draw.once_in(4) { "missing.ply" } else { &name }).expect("text");
        beside.push((name, bytes));
    }
    Source { name: "mesh.tiles".to_owned(), bytes: list.into_bytes(), beside }
}

/// A range grid with holes.
fn grid(draw: &mut Draw<'_>) -> Vec<u8> {
    let (columns, rows) = (draw.between(1, 12), draw.between(1, 12));
    let hole = draw.between(2, 9);
    let cells: Vec<bool> = (0..columns * rows).map(|i| i % hole != 1).collect();
    let filled = cells.iter().filter(|is| **is).count();
    let mut text = format!(
        "ply\nformat ascii 1.0\nobj_info num_cols {columns}\nobj_info num_rows {rows}\nelement vertex {filled}\n\
         property float x\nproperty float y\nproperty float z\nelement range_grid {}\n\
         property list uchar int vertex_indices\nend_header\n",
        columns * rows
    );
    let places = (0..columns * rows).filter(|i| cells[*i]);
    places.for_each(|i| writeln!(text, "{} {} 0", i % columns, i / columns).expect("text"));
    let mut next = 0;
    for cell in cells {
        match cell {
            true => writeln!(text, "1 {next}").expect("text"),
            false => text += "0\n",
        }
        next += usize::from(cell);
    }
    text.into_bytes()
}
