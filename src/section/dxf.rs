//! Sections as DXF of release 12, which every program reads: polylines in the model's coordinates, a layer for each plane.

use super::Sheet;
use anyhow::Result;
use chpm_section::Section;
use std::io::Write;

/// The layer of a plane. Release 12 has letters, digits, dashes and underscores in names.
fn layer(sheet: &Sheet, offset: f64) -> String {
    match sheet.contours {
        Some((axis, _)) => {
            format!("{}_{}", axis.name().to_uppercase(), sheet.height(offset).replace('.', "_"))
        }
        None => "SECTION".to_owned(),
    }
}

pub(super) fn begin(sheet: &Sheet, out: &mut impl Write) -> Result<()> {
    write!(out, "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n0\nENDSEC\n")?;
    let count = sheet.offsets.len();
    write!(out, "0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nLAYER\n70\n{count}\n")?;
    for offset in &sheet.offsets {
        write!(out, "0\nLAYER\n2\n{}\n70\n0\n62\n7\n6\nCONTINUOUS\n", layer(sheet, *offset))?;
    }
    Ok(write!(out, "0\nENDTAB\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n")?)
}

pub(super) fn add(sheet: &Sheet, section: &Section, out: &mut impl Write) -> Result<()> {
    let layer = layer(sheet, section.offset);
    for line in &section.lines {
        // 8 for points in space, 1 for closed.
        let flags = 8 + i32::from(line.is_closed);
        write!(out, "0\nPOLYLINE\n8\n{layer}\n66\n1\n10\n0\n20\n0\n30\n0\n70\n{flags}\n")?;
        for point in &line.points {
            let [x, y, z] = sheet.world(point).map(|x| sheet.number(x));
            write!(out, "0\nVERTEX\n8\n{layer}\n10\n{x}\n20\n{y}\n30\n{z}\n70\n32\n")?;
        }
        write!(out, "0\nSEQEND\n8\n{layer}\n")?;
    }
    Ok(())
}

pub(super) fn end(out: &mut impl Write) -> Result<()> {
    Ok(write!(out, "0\nENDSEC\n0\nEOF\n")?)
}
