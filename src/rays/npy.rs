//! Arrays of NumPy: the header of a table of numbers.

use anyhow::{Context, Result, bail, ensure};
use std::io::{Read, Write};

pub(super) const MAGIC: &[u8; 6] = b"\x93NUMPY";

/// Numbers of a table.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Kind {
    F32,
    F64,
}

/// A table, row by row.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Shape {
    pub(super) kind: Kind,
    pub(super) rows: u64,
    pub(super) columns: usize,
}

/// Bytes of a header, at most.
const MOST: u32 = 1 << 16;

/// Reads a header that begins behind the magic.
pub(super) fn read(from: &mut impl Read) -> Result<Shape> {
    let short = "the header of the array ends too soon; save it again with numpy.save";
    let mut version = [0; 2];
    from.read_exact(&mut version).context(short)?;
    let length = match version[0] {
        1 => {
            let mut length = [0; 2];
            from.read_exact(&mut length).context(short)?;
            u32::from(u16::from_le_bytes(length))
        }
        2 | 3 => {
            let mut length = [0; 4];
            from.read_exact(&mut length).context(short)?;
            u32::from_le_bytes(length)
        }
        got => bail!("arrays of version 1 to 3 expected, got {got}; save it again with numpy.save"),
    };
    ensure!(
        length <= MOST,
        "a header of at most {MOST} bytes expected, got {length}; save it again with numpy.save"
    );
    let mut header = vec![0; length as usize];
    from.read_exact(&mut header).context(short)?;
    parse(&String::from_utf8_lossy(&header))
}

fn value<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let quoted = [format!("'{key}'"), format!("\"{key}\"")];
    let place = quoted.iter().find_map(|key| header.find(key.as_str()).map(|at| at + key.len()))?;
    header[place..].trim_start().strip_prefix(':').map(str::trim_start)
}

fn parse(header: &str) -> Result<Shape> {
    let told = |key: &str| {
        value(header, key)
            .with_context(|| format!("the array does not tell its '{key}'; save it again with numpy.save"))
    };
    let descr = told("descr")?;
    let name = descr.get(1..).and_then(|rest| rest.split(['\'', '"']).next()).unwrap_or_default();
    let kind = match name {
        "<f8" => Kind::F64,
        "<f4" => Kind::F32,
        got => bail!("numbers '<f8' or '<f4' expected, got '{got}'; save it with .astype('<f8')"),
    };
    ensure!(
        told("fortran_order")?.starts_with("False"),
        "rows one after the other expected; save it with numpy.ascontiguousarray"
    );
    let shape = told("shape")?;
    let inner = shape.strip_prefix('(').and_then(|rest| rest.split_once(')')).map_or("", |(inner, _)| inner);
    let sizes: Option<Vec<u64>> = inner
        .split(',')
        .map(str::trim)
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().ok())
        .collect();
    match sizes.as_deref() {
        Some([rows, columns @ (6 | 7)]) => Ok(Shape { kind, rows: *rows, columns: *columns as usize }),
        _ => bail!(
            "an array of the shape (n, 6), or (n, 7) with the reach of each ray, expected, got ({inner})"
        ),
    }
}

/// Begins a table of f64.
pub(super) fn write(rows: u64, columns: usize, out: &mut impl Write) -> Result<()> {
    let dict = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    // Numbers begin at a multiple of 64 bytes.
    let length = (10 + dict.len() + 1).next_multiple_of(64) - 10;
    out.write_all(MAGIC)?;
    out.write_all(&[1, 0])?;
    out.write_all(&(length as u16).to_le_bytes())?;
    Ok(writeln!(out, "{dict:<width$}", width = length - 1)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_read_as_numpy_writes_them() {
        let good = "{'descr': '<f4', 'fortran_order': False, 'shape': (12, 7), }   \n";
        assert_eq!(parse(good).unwrap(), Shape { kind: Kind::F32, rows: 12, columns: 7 });
        for (header, told) in [
            ("{'descr': '>f8', 'fortran_order': False, 'shape': (12, 7), }", "astype"),
            ("{'descr': '<f8', 'fortran_order': True, 'shape': (12, 7), }", "ascontiguousarray"),
            ("{'descr': '<f8', 'fortran_order': False, 'shape': (12, 5), }", "(12, 5)"),
            ("{'descr': '<f8', 'fortran_order': False, 'shape': (12,), }", "(n, 6)"),
            ("{'descr': [('x', '<f8')], 'fortran_order': False, 'shape': (12, 6), }", "astype"),
            ("{'fortran_order': False, 'shape': (12, 6), }", "'descr'"),
            ("", "'descr'"),
        ] {
            let error = parse(header).unwrap_err().to_string();
            assert!(error.contains(told), "{header}: {error}");
        }
    }

    #[test]
    fn a_header_that_is_written_is_64_bytes_long_or_a_multiple() {
        for rows in [0, 7, 123_456_789] {
            let mut out = Vec::new();
            write(rows, 11, &mut out).unwrap();
            assert!(out.len() % 64 == 0 && out.ends_with(b"\n"));
            let header = String::from_utf8_lossy(&out[10..]).into_owned();
            assert!(header.contains(&format!("({rows}, 11)")));
        }
    }
}
