//! Sections as a table of points. A closed line ends where it began.

use super::Sheet;
use anyhow::Result;
use chpm_section::Section;
use std::io::Write;

pub(super) fn begin(out: &mut impl Write) -> Result<()> {
    Ok(writeln!(out, "offset,line,closed,depth,x,y,z")?)
}

pub(super) fn add(sheet: &Sheet, section: &Section, out: &mut impl Write) -> Result<()> {
    let offset = sheet.height(section.offset);
    for (number, line) in section.lines.iter().enumerate() {
        let closed = u8::from(line.is_closed);
        let depth = if line.crosses { String::new() } else { line.depth.to_string() };
        let again = line.points.first().filter(|_| line.is_closed);
        for point in line.points.iter().chain(again) {
            let [x, y, z] = sheet.world(point).map(|x| sheet.number(x));
            writeln!(out, "{offset},{number},{closed},{depth},{x},{y},{z}")?;
        }
    }
    Ok(())
}
