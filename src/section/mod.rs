//! Sections as files: drawings to scale, and lines for other programs.

mod csv;
mod dxf;
mod geojson;
mod plane;
mod scale;
mod svg;
#[cfg(feature = "viewer")]
mod window;

pub(crate) use plane::{Axis, Every, PlaneArg};
pub(crate) use scale::{Ratio, Scale};
#[cfg(feature = "viewer")]
pub(crate) use window::Slicing;

use crate::georeference::Placed;
use crate::tolerance::Unit;
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_section::{Planes, Section, Slicer};
use geojson::GeoJson;
use std::io::Write;
use std::path::Path;
use svg::Svg;

/// Facts that every format is told before the first line.
#[derive(Debug)]
pub(crate) struct Sheet {
    pub(crate) title: String,
    /// Point that lines are relative to.
    pub(crate) origin: [f64; 3],
    /// Directions to the right and upward in the drawing.
    pub(crate) axes: [[f64; 3]; 2],
    /// Corners of a box there that holds all lines, relative to the origin.
    pub(crate) bounds: [[f64; 2]; 2],
    /// Distances of the planes from the zero point.
    pub(crate) offsets: Vec<f64>,
    /// The axis and the step, where there are many planes.
    pub(crate) contours: Option<(Axis, f64)>,
    /// Digits behind the point with which coordinates are told: more than single precision has.
    pub(crate) decimals: usize,
    pub(crate) scale: Scale,
    /// The model on the earth.
    pub(crate) placed: Option<Placed>,
}

impl Sheet {
    /// Of planes that cut a file of this name; `note` follows the title.
    pub(crate) fn new(
        name: &Path,
        slicer: &Slicer<'_, MappedFile>,
        planes: &Planes,
        every: Option<Every>,
        scale: (Option<Unit>, Option<Ratio>),
        note: &str,
    ) -> Self {
        let (header, bounds) = (slicer.file().header(), slicer.bounds().unwrap_or([[0.0; 2]; 2]));
        let [low, high] = bounds;
        let name = name.file_stem().unwrap_or_default().to_string_lossy();
        let decimals = decimals(header.aabb().diagonal());
        let cut = match every {
            Some(Every { axis, step }) => {
                format!("{} every {}", axis.name(), trimmed(step, decimals_of(step, decimals)))
            }
            None => {
                let [x, y, z] = planes.normal().map(|x| (1e4 * x).round() / 1e4);
                format!("{x},{y},{z}:{}", planes.offsets().first().copied().unwrap_or(0.0))
            }
        };
        Sheet {
            title: format!("{name}, {cut}{note}"),
            origin: header.origin,
            axes: planes.axes(),
            bounds,
            offsets: planes.offsets().to_vec(),
            contours: every.map(|Every { axis, step }| (axis, step)),
            decimals,
            scale: Scale::of([high[0] - low[0], high[1] - low[1]], scale.0, scale.1),
            placed: None,
        }
    }

    /// A point of a line in the model's coordinates.
    fn world(&self, point: &[f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| point[axis] + self.origin[axis])
    }

    /// A coordinate without digits that it does not have, and without zeros at its end.
    fn number(&self, x: f64) -> String {
        trimmed(x, self.decimals)
    }

    /// The name of a plane's height or distance, by the step that they have.
    pub(crate) fn height(&self, offset: f64) -> String {
        trimmed(offset, self.contours.map_or(self.decimals, |(_, step)| decimals_of(step, self.decimals)))
    }
}

/// Digits behind the point of multiples of a step: so many that it has three in all, and more where it is only told by them.
fn decimals_of(step: f64, most: usize) -> usize {
    let least = (2.0 - step.log10().floor()).max(0.0) as usize;
    let tells = |decimals: &usize| {
        let told: f64 = format!("{step:.decimals$}").parse().unwrap_or(f64::NAN);
        (told - step).abs() <= 1e-9 * step
    };
    (least..=most).find(tells).unwrap_or(least.max(most))
}

/// A number without zeros at its end.
fn trimmed(x: f64, decimals: usize) -> String {
    let text = format!("{x:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Decimals of coordinates in a model of such a diagonal.
pub(crate) fn decimals(diagonal: f64) -> usize {
    if diagonal > 0.0 { (9.0 - diagonal.log10().floor()).max(0.0) as usize } else { 15 }
}

/// A file of sections that is being written.
pub(crate) enum Drawing {
    Svg(Svg),
    Dxf,
    GeoJson(GeoJson),
    Csv,
}

impl Drawing {
    /// Begins a file of a format that the verb writes.
    pub(crate) fn begin(format: &str, sheet: &Sheet, out: &mut impl Write) -> Result<Self> {
        Ok(match format {
            "DXF" => {
                dxf::begin(sheet, out)?;
                Drawing::Dxf
            }
            "GeoJSON" => Drawing::GeoJson(GeoJson::begin(out)?),
            "CSV" => {
                csv::begin(out)?;
                Drawing::Csv
            }
            _ => Drawing::Svg(Svg::begin(sheet, out)?),
        })
    }

    /// Adds the lines of a plane.
    pub(crate) fn add(&mut self, sheet: &Sheet, section: &Section, out: &mut impl Write) -> Result<()> {
        match self {
            Drawing::Svg(svg) => svg.add(sheet, section, out),
            Drawing::Dxf => dxf::add(sheet, section, out),
            Drawing::GeoJson(json) => json.add(sheet, section, out),
            Drawing::Csv => csv::add(sheet, section, out),
        }
    }

    pub(crate) fn end(self, sheet: &Sheet, out: &mut impl Write) -> Result<()> {
        match self {
            Drawing::Svg(svg) => svg.end(sheet, out),
            Drawing::Dxf => dxf::end(out),
            Drawing::GeoJson(_) => Ok(writeln!(out, "\n]}}")?),
            Drawing::Csv => Ok(()),
        }
    }
}
