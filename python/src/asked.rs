//! What is asked for, as Python says it.

use crate::camera::{Camera, From as Point};
use crate::error::Failure;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Length, Triangles};
use chpm_refine::{Request, View};
use pyo3::prelude::*;

/// A number, or a text as the command takes it: `"0.1%"`, `"20k"`.
#[derive(FromPyObject)]
pub(crate) enum Amount {
    Number(f64),
    Text(String),
}

impl Amount {
    pub(crate) fn length(&self) -> Result<Length, Failure> {
        match self {
            Amount::Number(units) if *units >= 0.0 => Ok(Length::Units(*units)),
            Amount::Number(units) => Err(Failure::Asked(format!(
                "error: a number that is at least 0 expected, or a share of the diagonal as in '0.1%', got {units}"
            ))),
            Amount::Text(text) => text.parse().map_err(|error| Failure::Asked(format!("error: {error}"))),
        }
    }

    fn triangles(&self) -> Result<Triangles, Failure> {
        match self {
            // Above 2^53 a float is no count that anybody counted; more than a model has is all of it in any case.
            Amount::Number(count) if *count >= 1.0 && count.fract() == 0.0 => {
                Ok(Triangles::Count(*count as u64))
            }
            Amount::Number(count) => Err(Failure::Asked(format!(
                "triangles: a whole number that is at least 1 expected, or a share of the model's as in '1%', got {count}"
            ))),
            Amount::Text(text) => text.parse().map_err(|error| Failure::Asked(format!("triangles: {error}"))),
        }
    }
}

/// The arguments of `File.select`.
#[derive(Default)]
pub(crate) struct Asked {
    pub(crate) error: Option<Amount>,
    pub(crate) triangles: Option<Amount>,
    pub(crate) level: Option<u32>,
    pub(crate) pixels: Option<f64>,
    pub(crate) camera: Option<Point>,
    pub(crate) viewport: Option<[u32; 2]>,
    pub(crate) cull: bool,
    pub(crate) texture_size: Option<u32>,
}

impl Asked {
    /// One request, or what is wrong.
    pub(crate) fn request(&self, file: &Chpm<MappedFile>) -> Result<Request, Failure> {
        let given = [
            ("error", self.error.is_some()),
            ("triangles", self.triangles.is_some()),
            ("level", self.level.is_some()),
            ("pixels", self.pixels.is_some()),
        ];
        let given: Vec<&str> = given.into_iter().filter(|(_, is)| *is).map(|(name, _)| name).collect();
        let refused = |told: String| Err(Failure::Asked(told));

        if let [first, second, ..] = given[..] {
            return refused(format!("{first} and {second} cannot both be given: each selects by itself"));
        }
        if given.is_empty() && self.camera.is_none() {
            return refused(
                "nothing is asked for: give one of error, triangles, level, pixels or camera".to_owned(),
            );
        }
        if let (Some(_), ["error" | "level"]) = (&self.camera, &given[..]) {
            return refused(format!("{} is the same from everywhere: leave camera out", given[0]));
        }

        let is_seen = self.camera.is_some() || self.pixels.is_some();
        if !is_seen && (self.viewport.is_some() || self.cull) {
            return refused("viewport and cull are of a picture: give camera or pixels, too".to_owned());
        }

        if let Some(bound) = &self.error {
            return Ok(Request::Within(bound.length()?));
        }
        if let Some(level) = self.level {
            return Ok(Request::Level(level));
        }
        let view = is_seen.then(|| self.view(file)).transpose()?;
        match (&self.triangles, view) {
            (Some(triangles), view) => Ok(Request::Triangles(triangles.triangles()?, view)),
            (None, Some(view)) => Ok(Request::View(view)),
            (None, None) => refused("nothing is asked for".to_owned()),
        }
    }

    fn view(&self, file: &Chpm<MappedFile>) -> Result<View, Failure> {
        let whole = || Camera::whole(file);
        let camera = self.camera.as_ref().map_or_else(|| Ok(whole()), Point::camera)?;
        let camera = camera.0.relative_to(file.header().origin);
        // Where triangles are asked for, the pixels of the view do not count.
        let pixels = self.pixels.unwrap_or(1.0);
        let view = View::new(&camera, self.viewport.unwrap_or([512, 512]), pixels)?;
        Ok(view.with_culling(self.cull))
    }
}
