//! Damage to a source, byte by byte and, in what is text, word by word and line by line.

use crate::draw::Draw;

/// Does a few of these.
pub(crate) fn spoil(bytes: &mut Vec<u8>, draw: &mut Draw<'_>) {
    for _ in 0..draw.pick(&[0, 0, 0, 0, 1, 5]) {
        if bytes.is_empty() {
            return;
        }
        once(bytes, draw);
    }
}

fn once(bytes: &mut Vec<u8>, draw: &mut Draw<'_>) {
    let len = bytes.len();
    // Half of the damage is near the beginning, where headers are.
    let reach = if draw.once_in(2) { len } else { len.min(400) };
    let at = draw.below(reach);
    let span = draw.between(1, 64).min(len - at);
    match draw.below(10) {
        0 => bytes[at] ^= 1 << draw.below(8),
        1 => bytes[at] = draw.word() as u8,
        2 => drop(bytes.drain(at..at + span)),
        3 => bytes.truncate(at),
        4 => {
            let copy = bytes[at..at + span].to_vec();
            bytes.splice(at..at, copy);
        }
        5 => {
            let value = draw.odd_integer().to_le_bytes();
            let width = draw.pick(&[1, 2, 4, 8]).min(len - at);
            bytes[at..at + width].copy_from_slice(&value[..width]);
        }
        6 => {
            let value = (draw.odd_float() as f32).to_le_bytes();
            let width = 4.min(len - at);
            bytes[at..at + width].copy_from_slice(&value[..width]);
        }
        7 => word(bytes, at, draw),
        8 => line(bytes, at, draw),
        _ => {
            let more = (0..draw.between(1, 40)).map(|_| draw.word() as u8).collect::<Vec<_>>();
            bytes.splice(at..at, more);
        }
    }
}

/// Another word in place of the one at `at`.
fn word(bytes: &mut Vec<u8>, at: usize, draw: &mut Draw<'_>) {
    let blank = |b: &u8| b.is_ascii_whitespace();
    let start = bytes[..at].iter().rposition(blank).map_or(0, |i| i + 1);
    let end = bytes[at..].iter().position(blank).map_or(bytes.len(), |i| at + i);
    let other = match draw.below(4) {
        0 => draw
            .pick(&["0", "-1", "nan", "inf", "1e999", "1e-999", "+5", "0x10", "1.", ".5", "-", "1/2/3", "//"])
            .to_owned(),
        1 => draw.odd_integer().to_string(),
        2 => format!("{:e}", draw.odd_float()),
        _ => {
            let names = [
                "vertex",
                "face",
                "list",
                "property",
                "float",
                "double",
                "uchar",
                "x",
                "end_header",
                "facet",
            ];
            draw.pick(&names).to_owned()
        }
    };
    bytes.splice(start..end.max(start), other.into_bytes());
}

/// A line less, one more, or in another place.
fn line(bytes: &mut Vec<u8>, at: usize, draw: &mut Draw<'_>) {
    let is_end = |b: &u8| *b == b'\n';
    let start = bytes[..at].iter().rposition(is_end).map_or(0, |i| i + 1);
    let end = bytes[at..].iter().position(is_end).map_or(bytes.len(), |i| at + i + 1);
    let taken: Vec<u8> = bytes[start..end].to_vec();
    match draw.below(3) {
        0 => drop(bytes.drain(start..end)),
        1 => drop(bytes.splice(start..start, taken)),
        _ => {
            bytes.drain(start..end);
            let to = draw.below(bytes.len() + 1);
            bytes.splice(to..to, taken);
        }
    }
}
