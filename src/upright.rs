//! Which way is up in a model, where nobody says.

use anyhow::Result;
use chpm_export::Turn;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::{Portrait, Up};

/// A direction, and why it is that.
pub(crate) struct Upright {
    pub(crate) up: Up,
    /// In words; empty where it is what somebody said.
    pub(crate) why: String,
}

impl Upright {
    /// The direction that is told; else y where the source is a glTF, which has it so, else the direction in which a file's model stands best, as in pictures.
    pub(crate) fn of(file: &Chpm<MappedFile>, told: Option<Up>) -> Result<Self> {
        if let Some(up) = told {
            return Ok(Upright { up, why: String::new() });
        }
        let is_gltf = file.metadata().is_ok_and(|metadata| metadata.source.encoding.starts_with("gltf"));
        if is_gltf {
            let up = Up::nearest([0.0, 1.0, 0.0].into());
            return Ok(Upright { up, why: "up is y: the source is a glTF".to_owned() });
        }
        let portrait = Portrait::of_file(file)?;
        let stance = portrait.stance();
        // What comes after that is about the side that a picture shows.
        let why = stance.why().split("; ").next().unwrap_or_default().to_owned();
        Ok(Upright { up: stance.up(), why })
    }

    /// The turn that makes y point up.
    pub(crate) fn turn(&self) -> Turn {
        Turn::to_y(self.up.axis(), self.up.is_negative())
    }
}
