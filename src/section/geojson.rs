//! Sections as GeoJSON (RFC 7946): lines in longitude, latitude and height on WGS 84.

use super::{Sheet, trimmed};
use anyhow::Result;
use chpm_section::{Line, Section};
use serde_json::json;
use std::io::Write;

#[derive(Debug)]
pub(crate) struct GeoJson {
    is_first: bool,
}

impl GeoJson {
    pub(super) fn begin(out: &mut impl Write) -> Result<Self> {
        write!(out, "{{\"type\": \"FeatureCollection\", \"features\": [")?;
        Ok(GeoJson { is_first: true })
    }

    pub(super) fn add(&mut self, sheet: &Sheet, section: &Section, out: &mut impl Write) -> Result<()> {
        let is_level = sheet.contours.is_some_and(|(axis, _)| axis == super::Axis::Z);
        let name = if is_level { "elevation" } else { "offset" };
        for (number, line) in section.lines.iter().enumerate() {
            let Line { is_closed, length, area, .. } = line;
            // In what a line lies that crosses others hangs on the point.
            let depth = (!line.crosses).then_some(line.depth);
            let offset: f64 = sheet.height(section.offset).parse()?;
            let told = json!({ name: offset, "line": number, "closed": is_closed, "length": length, "area": area, "depth": depth });
            let comma = if self.is_first { "" } else { "," };
            self.is_first = false;
            write!(out, "{comma}\n{{\"type\": \"Feature\", \"properties\": {told}, ")?;
            write!(out, "\"geometry\": {{\"type\": \"LineString\", \"coordinates\": [")?;
            coordinates(sheet, line, out)?;
            write!(out, "]}}}}")?;
        }
        Ok(())
    }
}

/// Of a line; a closed one ends where it began.
fn coordinates(sheet: &Sheet, line: &Line, out: &mut impl Write) -> Result<()> {
    let again = line.points.first().filter(|_| line.is_closed);
    for (number, point) in line.points.iter().chain(again).enumerate() {
        let world = sheet.world(point);
        let at = sheet.placed.as_ref().map_or(world, |placed| placed.geodetic(world));
        // A ten-thousandth of a millimetre on the ground, and of a metre upward.
        let [longitude, latitude, height] =
            [(at[0], 9), (at[1], 9), (at[2], 4)].map(|(x, decimals)| trimmed(x, decimals));
        let comma = if number == 0 { "" } else { "," };
        write!(out, "{comma}[{longitude},{latitude},{height}]")?;
    }
    Ok(())
}
