//! OBJ and PLY of a mesh with images beside it. Corners of different charts have one vertex where they are at one place, so that the mesh has no seams.

use crate::error::ExportError;
use crate::textured::TexturedPart;
use std::io::{self, Write};

/// The vertices of parts, each place once.
struct Joined {
    places: Vec<[f32; 3]>,
    /// By part, the place of each of its vertices.
    of: Vec<Vec<u32>>,
}

impl Joined {
    fn new(parts: &[TexturedPart]) -> Self {
        // Both zeros are one place.
        let all = || parts.iter().flat_map(|part| &part.positions).map(|place| place.map(|x| x + 0.0));
        let key = |place: &[f32; 3]| place.map(f32::to_bits);
        let mut places: Vec<[f32; 3]> = all().collect();
        places.sort_unstable_by_key(key);
        places.dedup_by_key(|place| key(place));
        // In the order of the triangles, not of coordinates.
        let (mut numbers, mut ordered) = (vec![u32::MAX; places.len()], Vec::with_capacity(places.len()));
        let mut number = |place: &[f32; 3]| {
            let place = place.map(|x| x + 0.0);
            let Ok(at) = places.binary_search_by_key(&key(&place), key) else {
                unreachable!("all places are there")
            };
            if numbers[at] == u32::MAX {
                numbers[at] = ordered.len() as u32;
                ordered.push(place);
            }
            numbers[at]
        };
        let of = parts.iter().map(|part| part.positions.iter().map(&mut number).collect()).collect();
        Joined { places: ordered, of }
    }
}

/// Writes an OBJ of parts, each with the material of its number, as in [`textured_mtl`]; positions are moved by `origin`. Every number reads back as the same.
///
/// # Errors
/// [`ExportError::Write`].
pub fn write_textured_obj<W: Write>(
    writer: W,
    parts: &[TexturedPart],
    origin: [f64; 3],
    comment: &str,
    mtl: &str,
) -> Result<W, ExportError> {
    let mut writer = writer;
    obj(&mut writer, parts, origin, comment, mtl)
        .map_err(|source| ExportError::Write { format: "OBJ", source })?;
    Ok(writer)
}

fn obj(
    writer: &mut impl Write,
    parts: &[TexturedPart],
    origin: [f64; 3],
    comment: &str,
    mtl: &str,
) -> io::Result<()> {
    writeln!(writer, "# {comment}\nmtllib {mtl}")?;
    let joined = Joined::new(parts);
    for place in &joined.places {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| f64::from(place[axis]) + origin[axis]);
        writeln!(writer, "v {x:?} {y:?} {z:?}")?;
    }
    for part in parts {
        for [u, v] in &part.places {
            // From the lower left corner.
            writeln!(writer, "vt {u:?} {:?}", 1.0 - f64::from(*v))?;
        }
        for [x, y, z] in &part.normals {
            writeln!(writer, "vn {x:?} {y:?} {z:?}")?;
        }
    }
    let mut first = 1;
    for (number, (part, of)) in parts.iter().zip(&joined.of).enumerate() {
        writeln!(writer, "usemtl image{number}")?;
        for corners in &part.triangles {
            write!(writer, "f")?;
            for corner in corners {
                let (vertex, place) = (of[*corner as usize] + 1, first + u64::from(*corner));
                match part.normals.is_empty() {
                    true => write!(writer, " {vertex}/{place}")?,
                    false => write!(writer, " {vertex}/{place}/{place}")?,
                }
            }
            writeln!(writer)?;
        }
        first += part.positions.len() as u64;
    }
    writer.flush()
}

/// Materials of an OBJ, each with the image of its number. Those of PNGs say that alpha counts, since only what is not opaque is a PNG.
pub fn textured_mtl(images: &[String]) -> String {
    let one = |(number, name): (usize, &String)| {
        let alpha = if name.ends_with(".png") { format!("map_d {name}\n") } else { String::new() };
        format!("newmtl image{number}\nKd 1 1 1\nmap_Kd {name}\n{alpha}")
    };
    images.iter().enumerate().map(one).collect()
}

/// Writes a binary PLY of parts, with the images' names as comments `TextureFile` and, by face, `texcoord` and `texnumber`; positions are moved by `origin`, in doubles where
/// that is not zero.
///
/// # Errors
/// [`ExportError::Write`].
pub fn write_textured_ply<W: Write>(
    writer: W,
    parts: &[TexturedPart],
    origin: [f64; 3],
    comment: &str,
    images: &[String],
) -> Result<W, ExportError> {
    let mut writer = writer;
    ply(&mut writer, parts, origin, comment, images)
        .map_err(|source| ExportError::Write { format: "PLY", source })?;
    Ok(writer)
}

fn ply(
    writer: &mut impl Write,
    parts: &[TexturedPart],
    origin: [f64; 3],
    comment: &str,
    images: &[String],
) -> io::Result<()> {
    let joined = Joined::new(parts);
    let is_moved = origin != [0.0; 3];
    let has_normals = parts.iter().any(|part| !part.normals.is_empty());
    let mut normals = vec![[0.0_f32; 3]; if has_normals { joined.places.len() } else { 0 }];
    for (part, of) in parts.iter().zip(&joined.of) {
        part.normals.iter().zip(of).for_each(|(normal, vertex)| normals[*vertex as usize] = *normal);
    }

    writeln!(writer, "ply\nformat binary_little_endian 1.0\ncomment {comment}")?;
    images.iter().try_for_each(|name| writeln!(writer, "comment TextureFile {name}"))?;
    writeln!(writer, "element vertex {}", joined.places.len())?;
    let kind = if is_moved { "double" } else { "float" };
    ["x", "y", "z"].iter().try_for_each(|axis| writeln!(writer, "property {kind} {axis}"))?;
    if has_normals {
        ["nx", "ny", "nz"].iter().try_for_each(|axis| writeln!(writer, "property float {axis}"))?;
    }
    let triangles: usize = parts.iter().map(|part| part.triangles.len()).sum();
    writeln!(writer, "element face {triangles}\nproperty list uchar int vertex_indices")?;
    writeln!(writer, "property list uchar float texcoord\nproperty int texnumber\nend_header")?;

    for (vertex, place) in joined.places.iter().enumerate() {
        for axis in 0..3 {
            match is_moved {
                true => writer.write_all(&(f64::from(place[axis]) + origin[axis]).to_le_bytes())?,
                false => writer.write_all(&place[axis].to_le_bytes())?,
            }
        }
        for x in normals.get(vertex).into_iter().flatten() {
            writer.write_all(&x.to_le_bytes())?;
        }
    }
    for (number, (part, of)) in parts.iter().zip(&joined.of).enumerate() {
        for corners in &part.triangles {
            writer.write_all(&[3])?;
            for corner in corners {
                writer.write_all(&of[*corner as usize].to_le_bytes())?;
            }
            writer.write_all(&[6])?;
            for corner in corners {
                let [u, v] = part.places[*corner as usize];
                writer.write_all(&u.to_le_bytes())?;
                writer.write_all(&(1.0 - v).to_le_bytes())?;
            }
            writer.write_all(&(number as i32).to_le_bytes())?;
        }
    }
    writer.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts() -> Vec<TexturedPart> {
        let part = |x: f32| TexturedPart {
            positions: vec![[x, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, -0.0]],
            places: vec![[0.0, 0.25], [1.0, 0.5], [x, 1.0]],
            triangles: vec![[0, 1, 2]],
            ..TexturedPart::default()
        };
        vec![part(0.0), part(2.0)]
    }

    #[test]
    fn places_are_there_once() {
        let obj = write_textured_obj(Vec::new(), &parts(), [10.0, 0.0, 0.0], "two", "a.mtl").unwrap();
        let text = String::from_utf8(obj).unwrap();
        let lines = |begin: &str| text.lines().filter(|line| line.starts_with(begin)).collect::<Vec<_>>();
        assert_eq!(lines("v "), ["v 10.0 0.0 0.0", "v 11.0 0.0 0.0", "v 11.0 1.0 0.0", "v 12.0 0.0 0.0"]);
        assert_eq!(lines("f "), ["f 1/1 2/2 3/3", "f 4/4 2/5 3/6"]);
        assert_eq!(lines("vt ")[..2], ["vt 0.0 0.75", "vt 1.0 0.5"]);
        assert_eq!(lines("usemtl "), ["usemtl image0", "usemtl image1"]);
        let images = ["a.jpg".to_owned(), "b.png".to_owned()];
        assert!(textured_mtl(&images).contains("newmtl image1\nKd 1 1 1\nmap_Kd b.png\n"));

        for (origin, len) in [([0.0; 3], 12), ([0.0, 5e6, 0.0], 24)] {
            let ply = write_textured_ply(Vec::new(), &parts(), origin, "two", &images).unwrap();
            let head = ply.windows(11).position(|some| some == b"end_header\n").unwrap() + 11;
            let text = String::from_utf8(ply[..head].to_vec()).unwrap();
            assert!(text.contains("element vertex 4\n") && text.contains("comment TextureFile b.png\n"));
            assert_eq!(ply.len() - head, 4 * len + 2 * (1 + 12 + 1 + 24 + 4));
        }
    }
}
