//! Any bytes at all: an answer, never a panic, and nothing that is not in range.

use crate::{obj, stl};
use chpm_import::ply::{Invalid, Options};
use chpm_import::{Format, RangeScans, Start};
use proptest::prelude::*;

fn options(drop: bool) -> Options {
    Options { invalid: if drop { Invalid::Drop } else { Invalid::Refuse }, ..Options::default() }
}

fn survive(bytes: &[u8]) -> Result<(), TestCaseError> {
    for drop in [false, true] {
        let options = options(drop);
        if let Ok(obj) = obj::read(bytes, options.clone()) {
            let vertices = obj.positions.len() as u32;
            prop_assert!(obj.positions.as_flattened().iter().all(|x| x.is_finite()));
            prop_assert!(
                obj.triangles
                    .iter()
                    .all(|[a, b, c]| a.max(b).max(c) < &vertices && a != b && b != c && c != a)
            );
            prop_assert!(obj.colors.is_empty() || obj.colors.len() == obj.positions.len());
        }
        for is_text in [false, true] {
            if let Ok((facets, ..)) = stl::read(bytes, is_text, options.invalid) {
                let numbers = facets.as_flattened().as_flattened();
                prop_assert!(numbers.iter().all(|x| x.is_finite() && x.to_bits() != 1 << 31));
            }
        }
    }
    let _ = RangeScans::read(bytes);
    let _ = Format::detect(&Start { head: bytes, len: Some(bytes.len() as u64), extension: None });
    Ok(())
}

/// Text that is nearly a mesh.
fn words() -> impl Strategy<Value = String> {
    let word = prop::sample::select(vec![
        "v",
        "f",
        "vt",
        "vn",
        "l",
        "#",
        "solid",
        "facet",
        "normal",
        "outer loop",
        "vertex",
        "endloop",
        "endfacet",
        "endsolid",
        "bmesh",
        "camera",
        "a.ply",
        "0",
        "1",
        "2",
        "3",
        "-1",
        "-2",
        "1/2/3",
        "2//1",
        "4/",
        "/",
        "1e9",
        "nan",
        "-0.0",
        "\\",
        "\n",
        "\n",
        "\n",
        "\r",
        "\r\n",
    ]);
    prop::collection::vec((word, prop::sample::select(vec![" ", " ", "", "\t"])), 0..120)
        .prop_map(|words| words.into_iter().map(|(word, gap)| format!("{word}{gap}")).collect())
}

proptest! {
    #[test]
    fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        survive(&bytes)?;
    }

    #[test]
    fn near_misses_are_survived(text in words()) {
        survive(text.as_bytes())?;
    }

    #[test]
    fn damaged_stl_is_survived(cut in 0usize..300, at in 0usize..300, byte in any::<u8>()) {
        let mut bytes = stl::binary(&[[[1.0, 2.0, 3.0]; 3], [[0.5; 3]; 3], [[9.0; 3]; 3]]);
        let len = bytes.len();
        bytes[at % len] = byte;
        bytes.truncate(cut.min(len));
        survive(&bytes)?;
    }
}
