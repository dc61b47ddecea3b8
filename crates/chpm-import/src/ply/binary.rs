//! Numbers of binary bodies: one by one, and whole blocks of records at once.

use super::{error::Fault, header::ScalarType, schema::Field, source::Source};
use std::io::Read;

impl<R: Read> Source<R> {
    pub(super) fn binary_scalar<const BIG: bool>(&mut self, ty: ScalarType) -> Result<f64, Fault> {
        let size = ty.size();
        if !self.need(size)? {
            return Err(Fault::End);
        }
        self.mark = self.offset();
        let value = load::<BIG>(self.bytes(), ty);
        self.consume(size);
        Ok(value)
    }
}

/// The first `N` bytes, in the order of this machine. The callers see to it that they are there.
fn bytes<const BIG: bool, const N: usize>(record: &[u8]) -> [u8; N] {
    let mut bytes = [0; N];
    bytes.copy_from_slice(&record[..N]);
    if BIG {
        bytes.reverse();
    }
    bytes
}

/// The bits that `record` begins with.
pub(super) fn word<const BIG: bool>(record: &[u8]) -> u32 {
    u32::from_le_bytes(bytes::<BIG, 4>(record))
}

/// The number that `record` begins with; every type fits an `f64`.
pub(super) fn load<const BIG: bool>(record: &[u8], ty: ScalarType) -> f64 {
    match ty {
        ScalarType::Char => i8::from_le_bytes(bytes::<BIG, 1>(record)).into(),
        ScalarType::UChar => record[0].into(),
        ScalarType::Short => i16::from_le_bytes(bytes::<BIG, 2>(record)).into(),
        ScalarType::UShort => u16::from_le_bytes(bytes::<BIG, 2>(record)).into(),
        ScalarType::Int => i32::from_le_bytes(bytes::<BIG, 4>(record)).into(),
        ScalarType::UInt => u32::from_le_bytes(bytes::<BIG, 4>(record)).into(),
        ScalarType::Float => f32::from_le_bytes(bytes::<BIG, 4>(record)).into(),
        ScalarType::Double => f64::from_le_bytes(bytes::<BIG, 8>(record)),
    }
}

/// Three numbers of each record, as f32: exact for all types that f32 holds, else rounded.
pub(super) fn singles<const BIG: bool>(
    records: &[u8],
    stride: usize,
    fields: &[Field; 3],
    out: &mut Vec<[f32; 3]>,
) {
    let at = fields[0].offset;
    let adjacent = (0..3).all(|i| fields[i].ty == ScalarType::Float && fields[i].offset == at + 4 * i);
    if adjacent {
        out.extend(records.chunks_exact(stride).map(|record| {
            let record = &record[at..at + 12];
            [0, 4, 8].map(|i| f32::from_le_bytes(bytes::<BIG, 4>(&record[i..])))
        }));
    } else {
        out.extend(records.chunks_exact(stride).map(|record| {
            fields.each_ref().map(|field| load::<BIG>(&record[field.offset..], field.ty) as f32)
        }));
    }
}

/// Three numbers of each record, as f64: exact.
pub(super) fn doubles<const BIG: bool>(
    records: &[u8],
    stride: usize,
    fields: &[Field; 3],
    out: &mut Vec<[f64; 3]>,
) {
    out.extend(
        records
            .chunks_exact(stride)
            .map(|record| fields.each_ref().map(|field| load::<BIG>(&record[field.offset..], field.ty))),
    );
}

/// Two numbers of each record, as f32.
pub(super) fn pairs<const BIG: bool>(
    records: &[u8],
    stride: usize,
    fields: &[Field; 2],
    out: &mut Vec<[f32; 2]>,
) {
    out.extend(
        records
            .chunks_exact(stride)
            .map(|record| fields.map(|field| load::<BIG>(&record[field.offset..], field.ty) as f32)),
    );
}

/// A colour of each record; opaque if there is no alpha.
pub(super) fn colors<const BIG: bool>(
    records: &[u8],
    stride: usize,
    fields: &[Field; 3],
    alpha: Option<Field>,
    out: &mut Vec<[u8; 4]>,
) {
    out.extend(records.chunks_exact(stride).map(|record| {
        let get = |field: &Field| channel(load::<BIG>(&record[field.offset..], field.ty), field.ty);
        let [red, green, blue] = fields.each_ref().map(get);
        [red, green, blue, alpha.as_ref().map_or(255, get)]
    }));
}

/// How many colours have a real channel that is clearly beyond 0 to 1.
pub(super) fn clamped<const BIG: bool>(records: &[u8], stride: usize, fields: &[Field; 3]) -> u64 {
    let reals: Vec<&Field> = fields.iter().filter(|field| !field.ty.is_integer()).collect();
    if reals.is_empty() {
        return 0;
    }
    let is = |record: &&[u8]| {
        reals.iter().any(|field| is_clamped(load::<BIG>(&record[field.offset..], field.ty), field.ty))
    };
    records.chunks_exact(stride).filter(is).count() as u64
}

/// Whether a channel is clearly beyond what its type goes to: what is only rounded is no news.
pub(super) fn is_clamped(value: f64, ty: ScalarType) -> bool {
    !ty.is_integer() && !(-0.01..=1.01).contains(&value)
}

/// A colour channel in eight bits. Reals run from 0 to 1, `ushort` from 0 to 65535, and all other types from 0 to 255.
pub(super) fn channel(value: f64, ty: ScalarType) -> u8 {
    let scaled = match ty {
        ScalarType::UChar => return value as u8,
        ScalarType::Float | ScalarType::Double => value * 255.0,
        ScalarType::UShort => value / 257.0,
        _ => value,
    };
    // The cast saturates, and makes NaN zero.
    scaled.round() as u8
}

/// Copies triangles until the first face that is not three valid corners, and says how many faces that were and
/// how many of them had equal corners.
///
/// A face is `before` bytes, a length of one byte, indices of four bytes, and `after` bytes.
pub(super) fn triangles<const BIG: bool>(
    faces: &[u8],
    (before, after): (usize, usize),
    vertex_count: u32,
    out: &mut Vec<[u32; 3]>,
) -> (usize, usize) {
    let stride = before + 13 + after;
    let (mut read, mut degenerate) = (0, 0);
    for face in faces.chunks_exact(stride) {
        let face = &face[before..before + 13];
        let [a, b, c] = [1, 5, 9].map(|i| u32::from_le_bytes(bytes::<BIG, 4>(&face[i..])));
        if face[0] != 3 || a.max(b).max(c) >= vertex_count {
            break;
        }
        if a == b || b == c || c == a {
            degenerate += 1;
        } else {
            out.push([a, b, c]);
        }
        read += 1;
    }
    (read, degenerate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_loads_from_both_ends() {
        let cases: [(ScalarType, &[u8], f64); 8] = [
            (ScalarType::Char, &(-5i8).to_be_bytes(), -5.0),
            (ScalarType::UChar, &250u8.to_be_bytes(), 250.0),
            (ScalarType::Short, &(-3000i16).to_be_bytes(), -3000.0),
            (ScalarType::UShort, &60000u16.to_be_bytes(), 60000.0),
            (ScalarType::Int, &(-2_000_000_001i32).to_be_bytes(), -2_000_000_001.0),
            (ScalarType::UInt, &4_000_000_001u32.to_be_bytes(), 4_000_000_001.0),
            (ScalarType::Float, &0.1f32.to_be_bytes(), f64::from(0.1f32)),
            (ScalarType::Double, &0.1f64.to_be_bytes(), 0.1),
        ];
        for (ty, big, value) in cases {
            let little: Vec<u8> = big.iter().rev().copied().collect();
            assert_eq!((load::<true>(big, ty), load::<false>(&little, ty)), (value, value), "{ty}");
        }
    }

    #[test]
    fn channels_reach_both_ends() {
        let cases = [
            (
                ScalarType::Float,
                &[(0.0, 0), (1.0, 255), (0.5, 128), (2.0, 255), (-1.0, 0), (f64::NAN, 0)][..],
            ),
            (ScalarType::UShort, &[(0.0, 0), (65535.0, 255), (257.0, 1), (128.0, 0), (129.0, 1)]),
            (ScalarType::Int, &[(-3.0, 0), (77.0, 77), (300.0, 255)]),
            (ScalarType::UChar, &[(0.0, 0), (77.0, 77), (255.0, 255)]),
        ];
        for (ty, pairs) in cases {
            for &(value, byte) in pairs {
                assert_eq!(channel(value, ty), byte, "{ty} {value}");
            }
        }
    }
}
