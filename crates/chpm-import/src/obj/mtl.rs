//! Libraries of materials of an OBJ: MTL.

use crate::error::ImportError;
use crate::lines::{Lines, number, words};
use chpm_texture::Alpha;
use std::io::Read;

/// A material, as far as its colour goes.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Mtl {
    pub(super) name: Vec<u8>,
    /// Diffuse colour.
    pub(super) kd: Option<[f32; 3]>,
    pub(super) map: Option<Map>,
    /// The image whose alpha says how much is seen.
    pub(super) shown: Option<Map>,
}

/// An image on a material.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Map {
    pub(super) file: String,
    pub(super) scale: [f32; 2],
    pub(super) offset: [f32; 2],
    pub(super) is_clamped: bool,
}

impl Mtl {
    /// Factor of the image, or of all of it. Exporters that write black beside an image do not mean it.
    pub(super) fn factor(&self) -> [f32; 4] {
        let [r, g, b] = self.kd.filter(|kd| self.map.is_none() || *kd != [0.0; 3]).unwrap_or([1.0; 3]);
        [r, g, b, 1.0]
    }

    /// The meaning of the image's alpha: none, unless the material says that it is looked at.
    pub(super) fn alpha(&self) -> Alpha {
        let files = [&self.map, &self.shown].map(|map| map.as_ref().map(|map| &map.file));
        if files[0] == files[1] { Alpha::Kept } else { Alpha::Ignored }
    }
}

/// Hands the materials of a library to `take`, one by one.
pub(super) fn read(
    bytes: impl Read,
    take: &mut dyn FnMut(Mtl) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    let (mut lines, mut current) = (Lines::new(bytes), None::<Mtl>);
    while lines.advance()? {
        let Some((keyword, rest)) = statement(lines.current()) else { continue };
        match (keyword.to_ascii_lowercase().as_slice(), &mut current) {
            (b"newmtl", _) => {
                current.take().map_or(Ok(()), &mut *take)?;
                current = Some(Mtl { name: rest.to_owned(), kd: None, map: None, shown: None });
            }
            (b"kd", Some(mtl)) => mtl.kd = color(rest),
            (b"map_kd", Some(mtl)) => mtl.map = map(uncommented(rest)),
            (b"map_d", Some(mtl)) => mtl.shown = map(uncommented(rest)),
            _ => {}
        }
    }
    current.map_or(Ok(()), take)
}

/// The first word of a line, and what follows it without blanks at its ends.
pub(super) fn statement(line: &[u8]) -> Option<(&[u8], &[u8])> {
    let keyword = words(line).next()?;
    let start = line.iter().position(|byte| !is_blank(byte))?;
    let rest = &line[start + keyword.len()..];
    let end = rest.iter().rposition(|byte| !is_blank(byte)).map_or(0, |at| at + 1);
    let start = rest[..end].iter().position(|byte| !is_blank(byte)).unwrap_or(0);
    Some((keyword, &rest[start..end]))
}

/// A statement that names a file, without the comment behind it. The `#` of a name, as in `brick #2.png`, has its extension behind it.
pub(super) fn uncommented(rest: &[u8]) -> &[u8] {
    let mut behind = rest;
    while let Some((word, others)) = statement(behind) {
        if word == b"#" || (word.starts_with(b"#") && !behind.contains(&b'.')) {
            let end = rest.len() - behind.len();
            let end = rest[..end].iter().rposition(|byte| !is_blank(byte)).map_or(0, |at| at + 1);
            return &rest[..end];
        }
        behind = others;
    }
    rest
}

/// As between [`words`].
fn is_blank(byte: &u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// Three numbers, or one for all; none for what is no number, as a spectrum.
fn color(text: &[u8]) -> Option<[f32; 3]> {
    let values = words(text).take_while(|word| !word.starts_with(b"#"));
    let mut numbers = values.map(|word| number::<f32>(Some(word)).ok().filter(|x| x.is_finite()));
    let first = numbers.next()??;
    let color = match numbers.next() {
        None => [first; 3],
        Some(second) => [first, second?, numbers.next()??],
    };
    Some(color.map(|x| x.clamp(0.0, 1.0)))
}

/// Options and the name of a file, which may have blanks.
fn map(mut rest: &[u8]) -> Option<Map> {
    let mut map = Map { file: String::new(), scale: [1.0; 2], offset: [0.0; 2], is_clamped: false };
    while let Some((option, behind)) = statement(rest).filter(|(word, _)| word.starts_with(b"-")) {
        let numbers = |default: [f32; 2]| numbers(behind, default);
        rest = match option {
            b"-o" | b"-s" | b"-t" => {
                let (found, behind) = numbers(if option == b"-s" { [1.0; 2] } else { [0.0; 2] });
                match option {
                    b"-o" => map.offset = found,
                    b"-s" => map.scale = found,
                    _ => {}
                }
                behind
            }
            b"-mm" => statement(statement(behind)?.1)?.1,
            b"-clamp" => {
                let (value, behind) = statement(behind)?;
                map.is_clamped = value.eq_ignore_ascii_case(b"on");
                behind
            }
            b"-blendu" | b"-blendv" | b"-cc" | b"-bm" | b"-boost" | b"-texres" | b"-imfchan" | b"-type" => {
                statement(behind)?.1
            }
            // A name may begin so.
            _ => break,
        };
    }
    map.file = String::from_utf8_lossy(rest).into_owned();
    (!map.file.is_empty()).then_some(map)
}

/// Up to three numbers, of which two count, and what follows them.
fn numbers(mut rest: &[u8], default: [f32; 2]) -> ([f32; 2], &[u8]) {
    let mut found = default;
    for at in 0..3 {
        let next = statement(rest).and_then(|(word, behind)| Some((number::<f32>(Some(word)).ok()?, behind)));
        // The last word is a name, whatever it looks like.
        let Some((value, behind)) = next.filter(|(value, behind)| value.is_finite() && !behind.is_empty())
        else {
            break;
        };
        if let Some(place) = found.get_mut(at) {
            *place = value;
        }
        rest = behind;
    }
    (found, rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str) -> Vec<Mtl> {
        let mut found = Vec::new();
        read(text.as_bytes(), &mut |mtl| {
            found.push(mtl);
            Ok(())
        })
        .unwrap();
        found
    }

    #[test]
    fn options_stand_before_a_name_with_blanks() {
        let plain = Map { file: String::new(), scale: [1.0; 2], offset: [0.0; 2], is_clamped: false };
        for (text, file, other) in [
            ("a.png", "a.png", plain.clone()),
            ("  my wall 2.png \t", "my wall 2.png", plain.clone()),
            ("maps\\a b.jpg", "maps\\a b.jpg", plain.clone()),
            ("-o 0.5 a.png", "a.png", Map { offset: [0.5, 0.0], ..plain.clone() }),
            ("-o 0.5 -.25 7 a.png", "a.png", Map { offset: [0.5, -0.25], ..plain.clone() }),
            (
                "-s 2 3 1 -o 1 1 1 -clamp on 4",
                "4",
                Map { scale: [2.0, 3.0], offset: [1.0; 2], is_clamped: true, ..plain.clone() },
            ),
            ("-clamp off -mm 0 1 -bm 2 -blendu on -texres 512 -imfchan l a.png", "a.png", plain.clone()),
            ("-t 1 1 1 a.png", "a.png", plain.clone()),
            ("-odd.png", "-odd.png", plain.clone()),
        ] {
            let mtl = &all(&format!("newmtl m\nmap_Kd {text}\n"))[0];
            assert_eq!(mtl.map, Some(Map { file: file.to_owned(), ..other }), "{text}");
        }
        for none in ["", "-o", "-clamp", "-mm 1"] {
            assert_eq!(all(&format!("newmtl m\nmap_Kd {none}\n"))[0].map, None, "{none}");
        }
    }

    #[test]
    fn colours_multiply_but_for_black_beside_an_image() {
        for (text, factor) in [
            ("Kd 0.5 0.25 1", [0.5, 0.25, 1.0, 1.0]),
            ("Kd 0.5", [0.5, 0.5, 0.5, 1.0]),
            ("Kd 0 0 0", [0.0, 0.0, 0.0, 1.0]),
            ("Kd 0 0 0\nmap_Kd a.png", [1.0; 4]),
            ("Kd 0 0 0.5\nmap_kd a.png", [0.0, 0.0, 0.5, 1.0]),
            ("Kd spectral a.rfl", [1.0; 4]),
            ("Kd 3 nan 1", [1.0; 4]),
            ("Kd 3 -1 1", [1.0, 0.0, 1.0, 1.0]),
            ("Ka 0 0 0", [1.0; 4]),
        ] {
            assert_eq!(all(&format!("newmtl m\n{text}\n"))[0].factor(), factor, "{text}");
        }
    }

    #[test]
    fn alpha_counts_where_a_material_looks_at_it() {
        for (text, alpha) in [
            ("map_Kd a.png", Alpha::Ignored),
            ("map_Kd a.png\nmap_d b.png", Alpha::Ignored),
            ("map_Kd a.png\nmap_d -imfchan m a.png", Alpha::Kept),
            ("map_d my leaf.png\nmap_Kd -s 2 2 my leaf.png", Alpha::Kept),
        ] {
            assert_eq!(all(&format!("newmtl m\n{text}\n"))[0].alpha(), alpha, "{text}");
        }
    }

    #[test]
    fn comments_may_follow_statements() {
        let file = |line: &str| all(&format!("newmtl a #1\n{line}"))[0].map.clone().map(|map| map.file);
        for (line, expected) in [
            ("map_Kd a.png # of the front", "a.png"),
            ("map_Kd -clamp on a b.png \t#front", "a b.png"),
            ("map_Kd brick #2.png", "brick #2.png"),
            ("map_Kd a#b.png #", "a#b.png"),
        ] {
            assert_eq!(file(line).as_deref(), Some(expected), "{line}");
        }
        assert_eq!(file("map_Kd # none"), None);
        let found = all("newmtl a #1\nKd 0.5 # grey\nnewmtl b\nKd 0 1 0#green\nnewmtl c\nKd 0 1 0 #green");
        assert_eq!(found[0].name, b"a #1", "a name may have one");
        assert_eq!(
            found.iter().map(|mtl| mtl.kd).collect::<Vec<_>>()[..],
            [Some([0.5; 3]), None, Some([0.0, 1.0, 0.0])]
        );
    }

    #[test]
    fn materials_begin_at_their_names() {
        let found = all("# made\nKd 1 0 0\nnewmtl a b \r\n\tKd 0 1 0\nnewmtl c\nnewmtl c\nKd 0 0 1");
        let expected = [("a b", Some([0.0, 1.0, 0.0])), ("c", None), ("c", Some([0.0, 0.0, 1.0]))];
        let found: Vec<_> =
            found.iter().map(|mtl| (std::str::from_utf8(&mtl.name).unwrap(), mtl.kd)).collect();
        assert_eq!(found, expected);
    }
}
