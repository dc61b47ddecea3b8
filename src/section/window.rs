//! Outlines of the viewer's clipping plane.

use super::{Drawing, Sheet};
use crate::cmd::{open, reading};
use crate::threads::ThreadArgs;
use anyhow::{Context, Result};
use chpm_extmem::MappedFile;
use chpm_mesh::{Bytes, Level};
use chpm_refine::Cut;
use chpm_section::{Fill, Planes, Section, Slicer};
use chpm_viewer::Clip;
use chpm_viewer::window::section::{Face, Slice};
use std::path::Path;

/// Cuts what the window shows.
pub(crate) struct Slicing {
    /// For lines, beside the pages that are drawn.
    pub(crate) memory: Bytes,
}

impl Slice for Slicing {
    fn slice(&self, model: &Path, plane: &Clip, go_on: &(dyn Fn() -> bool + Sync)) -> Result<Face, String> {
        self.cut(model, plane, go_on, |slicer, planes, section| {
            let Some(section) = section else { return Ok(Face { area: Some(0.0), ..Face::default() }) };
            let origin = slicer.file().header().origin;
            let place = |point: &[f64; 3]| [0, 1, 2].map(|axis| point[axis] + origin[axis]);
            let fill = Fill::of(section, planes.axes());
            let lines = section.lines.iter();
            Ok(Face {
                lines: lines.map(|line| (line.points.iter().map(place).collect(), line.is_closed)).collect(),
                points: fill.points.iter().map(place).collect(),
                triangles: fill.triangles,
                length: section.length(),
                area: section.area(),
                open_ends: section.open_ends(),
            })
        })
    }

    fn draw(&self, model: &Path, plane: &Clip) -> Result<Vec<u8>, String> {
        self.cut(model, plane, &|| true, |slicer, planes, section| {
            let section = section.context("the plane does not cut the model: there is no outline")?;
            let sheet = Sheet::new(model, slicer, planes, None, (None, None), "");
            let mut bytes = Vec::new();
            let mut drawing = Drawing::begin("SVG", &sheet, &mut bytes)?;
            drawing.add(&sheet, section, &mut bytes)?;
            drawing.end(&sheet, &mut bytes)?;
            Ok(bytes)
        })
    }
}

impl Slicing {
    /// Hands the lines of a plane to somebody, if there are any.
    fn cut<T>(
        &self,
        model: &Path,
        plane: &Clip,
        go_on: &(dyn Fn() -> bool + Sync),
        take: impl FnOnce(&Slicer<'_, MappedFile>, &Planes, Option<&Section>) -> Result<T>,
    ) -> Result<T, String> {
        let told = || -> Result<T> {
            let file = open(model)?;
            let planes = Planes::new(plane.normal(), vec![plane.offset_from([0.0; 3])])?;
            reading(&file, || {
                let mut slicer = Slicer::new(&file, &Cut::at_level(&file, Level(0)), &planes);
                let pool = ThreadArgs::default().pool()?;
                let sections = pool.install(|| slicer.next_sections(self.memory, go_on))?;
                let section = sections.first().filter(|section| !section.lines.is_empty());
                take(&slicer, &planes, section)
            })
        };
        told().map_err(|error| format!("{error:#}"))
    }
}
