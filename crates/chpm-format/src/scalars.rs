//! The list of the named scalars that vertices have.

use crate::error::{FilePart, FormatError, invalid, require, require_eq};
use crate::section_kind::SectionKind;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::{MOST_SCALAR_WORDS, Scalar, ScalarKind, ScalarRange, scalar_words};
use std::mem;

/// Most bytes of a name.
const MOST_NAME: usize = 1024;
/// Names end at a multiple of this.
const NAME_ALIGN: usize = 8;
const PLACE: FilePart = FilePart::Section(SectionKind::Scalars);

/// Most bytes of a list.
pub(crate) const MOST_LEN: u64 = (MOST_SCALAR_WORDS * (mem::size_of::<Entry>() + MOST_NAME)) as u64;

/// Record in front of a name.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Entry {
    kind: u16,
    name_len: u16,
    reserved: u32,
    low: f64,
    high: f64,
    count: u64,
}

/// Bytes of the section.
pub(crate) fn section_len(scalars: &[Scalar]) -> u64 {
    let one = |scalar: &Scalar| mem::size_of::<Entry>() + scalar.name.len().next_multiple_of(NAME_ALIGN);
    scalars.iter().map(one).sum::<usize>() as u64
}

/// The section of these scalars.
pub(crate) fn encode(scalars: &[Scalar]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(section_len(scalars) as usize);
    for Scalar { name, kind, range } in scalars {
        let ScalarRange { low, high, count } = *range;
        let (kind, name_len) = (*kind as u16, name.len() as u16);
        bytes.extend_from_slice(bytemuck::bytes_of(&Entry { kind, name_len, reserved: 0, low, high, count }));
        bytes.extend_from_slice(name.as_bytes());
        bytes.resize(bytes.len().next_multiple_of(NAME_ALIGN), 0);
    }
    bytes
}

/// The scalars that a section lists, of which there are `count`; their words must be those of a vertex.
pub(crate) fn decode(mut bytes: &[u8], count: u64, words: u8) -> Result<Vec<Scalar>, FormatError> {
    // No vertex has more scalars than words.
    require(count <= words.into(), PLACE, "count", format_args!("at most {words}"), count)?;
    let scalars = (0..count).map(|_| one(&mut bytes)).collect::<Result<Vec<_>, _>>()?;
    require(bytes.is_empty(), PLACE, "len", "the end behind the last scalar", "more")?;
    check(&scalars, words)?;
    Ok(scalars)
}

fn one(bytes: &mut &[u8]) -> Result<Scalar, FormatError> {
    let short = || invalid(PLACE, "len", "room for all scalars", "less");
    let head = bytes.split_off(..mem::size_of::<Entry>()).ok_or_else(short)?;
    let Entry { kind, name_len, low, high, count, .. } = bytemuck::pod_read_unaligned(head);
    let name_len = usize::from(name_len);
    let name = bytes.split_off(..name_len.next_multiple_of(NAME_ALIGN)).ok_or_else(short)?;
    let (name, padding) = name.split_at(name_len);
    require(padding.iter().all(|byte| *byte == 0), PLACE, "padding behind a name", "zeros", "other bytes")?;
    let name = std::str::from_utf8(name).map_err(|error| invalid(PLACE, "name", "UTF-8", error))?;
    let known = ScalarKind::of_code(kind).ok_or_else(|| invalid(PLACE, "type", "1 to 8", kind))?;
    let range = ScalarRange { low, high, count };
    Ok(Scalar { name: name.to_owned(), kind: known, range })
}

/// Refuses lists of scalars that no file may have.
pub(crate) fn check(scalars: &[Scalar], words: u8) -> Result<(), FormatError> {
    let all = scalar_words(scalars);
    require(
        all <= MOST_SCALAR_WORDS,
        PLACE,
        "words of a vertex",
        format_args!("at most {MOST_SCALAR_WORDS}"),
        all,
    )?;
    require_eq(PLACE, "words of a vertex", usize::from(words), all)?;
    for (at, Scalar { name, range, .. }) in scalars.iter().enumerate() {
        let len = name.len();
        require(
            (1..=MOST_NAME).contains(&len),
            PLACE,
            "length of a name",
            format_args!("1 to {MOST_NAME}"),
            len,
        )?;
        let is_new = scalars[..at].iter().all(|before| before.name != *name);
        require(is_new, PLACE, "name", "one that is not taken", format_args!("{name:?} again"))?;
        let ScalarRange { low, high, count } = *range;
        let legal = if count == 0 { low == 0.0 && high == 0.0 } else { low <= high };
        require(legal, PLACE, "range", "low <= high, or 0 without values", format_args!("{low:?} {high:?}"))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Vec<Scalar> {
        let mut scalars = vec![
            Scalar::new("quality", ScalarKind::Float32),
            Scalar::new("zeit \u{1b}[31m", ScalarKind::Float64),
            Scalar::new("12345678", ScalarKind::Uint8),
        ];
        scalars[0].range = ScalarRange { low: -1.5, high: f64::INFINITY, count: 9 };
        scalars
    }

    #[test]
    fn a_list_comes_back() {
        let bytes = encode(&some());
        assert_eq!(bytes.len() as u64, section_len(&some()));
        assert_eq!(decode(&bytes, 3, 4).unwrap(), some());
    }

    #[test]
    fn a_wrong_list_is_refused() {
        let bytes = encode(&some());
        for (count, words) in [(2, 4), (4, 4), (3, 3), (3, 5), (u64::MAX, 4)] {
            assert!(decode(&bytes, count, words).is_err(), "{count} {words}");
        }
        for len in 0..bytes.len() {
            assert!(decode(&bytes[..len], 3, 4).is_err(), "{len}");
        }
        // An unknown type, a name that is no text, one that is padding, a range upside down.
        for (at, byte) in [(0, 9), (32, 0xff), (39, 1), (15, 0x7f)] {
            let mut bytes = bytes.clone();
            bytes[at] = byte;
            assert!(decode(&bytes, 3, 4).is_err(), "{at}");
        }
        let mut twice = some();
        twice[2].name = "quality".to_owned();
        assert!(decode(&encode(&twice), 3, 4).is_err());
    }
}
