//! Files made to order, without the writer under test.

use chpm_import::ply::{Encoding, PropertyType, ScalarType};
use std::{fmt::Write, io::Read};

pub(crate) const ENCODINGS: [Encoding; 3] =
    [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian];

pub(crate) const TYPES: [ScalarType; 8] = [
    ScalarType::Char,
    ScalarType::UChar,
    ScalarType::Short,
    ScalarType::UShort,
    ScalarType::Int,
    ScalarType::UInt,
    ScalarType::Float,
    ScalarType::Double,
];

/// The committed specimens.
pub(crate) const SPECIMENS: [&[u8]; 6] = [
    include_bytes!("../../../../data/ply/polygons_ascii.ply"),
    include_bytes!("../../../../data/ply/colors_crlf_be.ply"),
    include_bytes!("../../../../data/ply/tetrahedron_cr_ascii.ply"),
    include_bytes!("../../../../data/ply/strips_le.ply"),
    include_bytes!("../../../../data/ply/faces_first_le.ply"),
    include_bytes!("../../../../data/ply/extras_ascii.ply"),
];

/// An element with all its values: a row is one element, and a cell the values of one property.
pub(crate) struct Table {
    pub(crate) name: &'static str,
    pub(crate) columns: Vec<(String, PropertyType)>,
    pub(crate) rows: Vec<Vec<Vec<f64>>>,
}

pub(crate) fn forge(encoding: Encoding, tables: &[Table]) -> Vec<u8> {
    let mut header = format!("ply\nformat {encoding} 1.0\n");
    for table in tables {
        writeln!(header, "element {} {}", table.name, table.rows.len()).unwrap();
        for (name, ty) in &table.columns {
            match ty {
                PropertyType::Scalar(ty) => writeln!(header, "property {ty} {name}").unwrap(),
                PropertyType::List { count, item } => {
                    writeln!(header, "property list {count} {item} {name}").unwrap();
                }
            }
        }
    }
    header += "end_header\n";
    let mut bytes = header.into_bytes();
    for table in tables {
        for row in &table.rows {
            for (cell, (_, ty)) in row.iter().zip(&table.columns) {
                let item = match *ty {
                    PropertyType::Scalar(ty) => ty,
                    PropertyType::List { count, item } => {
                        put(&mut bytes, encoding, count, cell.len() as f64);
                        item
                    }
                };
                cell.iter().for_each(|value| put(&mut bytes, encoding, item, *value));
            }
            if encoding == Encoding::Ascii {
                bytes.push(b'\n');
            }
        }
    }
    bytes
}

fn put(bytes: &mut Vec<u8>, encoding: Encoding, ty: ScalarType, value: f64) {
    if encoding == Encoding::Ascii {
        let text = match ty {
            ScalarType::Float => format!("{:?} ", value as f32),
            ScalarType::Double => format!("{value:?} "),
            _ => format!("{} ", value as i64),
        };
        bytes.extend(text.bytes());
        return;
    }
    let mut raw = match ty {
        ScalarType::Char => (value as i8).to_le_bytes().to_vec(),
        ScalarType::UChar => (value as u8).to_le_bytes().to_vec(),
        ScalarType::Short => (value as i16).to_le_bytes().to_vec(),
        ScalarType::UShort => (value as u16).to_le_bytes().to_vec(),
        ScalarType::Int => (value as i32).to_le_bytes().to_vec(),
        ScalarType::UInt => (value as u32).to_le_bytes().to_vec(),
        ScalarType::Float => (value as f32).to_le_bytes().to_vec(),
        ScalarType::Double => value.to_le_bytes().to_vec(),
    };
    if encoding == Encoding::BinaryBigEndian {
        raw.reverse();
    }
    bytes.extend(raw);
}

/// SplitMix64: a seed is a test case.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }

    /// A finite number that `ty` holds exactly.
    pub(crate) fn value(&mut self, ty: ScalarType) -> f64 {
        let bits = self.next();
        match ty {
            ScalarType::Char => (bits as i8).into(),
            ScalarType::UChar => (bits as u8).into(),
            ScalarType::Short => (bits as i16).into(),
            ScalarType::UShort => (bits as u16).into(),
            ScalarType::Int => (bits as i32).into(),
            ScalarType::UInt => (bits as u32).into(),
            ScalarType::Float => {
                let value = f32::from_bits(bits as u32);
                if value.is_finite() { value.into() } else { 1.0 }
            }
            ScalarType::Double => {
                let value = f64::from_bits(bits);
                if value.is_finite() { value } else { 1.0 }
            }
        }
    }
}

/// An input that hands out at most `step` bytes at a time.
pub(crate) struct Trickle<'a> {
    pub(crate) bytes: &'a [u8],
    pub(crate) step: usize,
}

impl Read for Trickle<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let count = self.step.min(out.len()).min(self.bytes.len());
        out[..count].copy_from_slice(&self.bytes[..count]);
        self.bytes = &self.bytes[count..];
        Ok(count)
    }
}
