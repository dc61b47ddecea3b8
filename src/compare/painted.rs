//! A scan in the colours of its distances, as a file.

use super::{Parts, leaves};
use crate::cmd::build;
use crate::companions::{self, Buffer, container};
use crate::output::{self, Output, Promise, Writes};
use crate::progress::Meter;
use crate::stop::{self, Stop};
use crate::upright::Upright;
use anyhow::{Result, bail, ensure};
use chpm_build::{BuildConfig, Cancel, Resources};
use chpm_export::{Container, Extent, Facts, GlbWriter, Grid, Level, Placement};
use chpm_extmem::{MappedFile, WorkDir};
use chpm_format::Chpm;
use chpm_import::ply::{Encoding, PlyWriter};
use chpm_mesh::{Aabb, Attributes, Bytes, VertexSlices};
use chpm_report::colors::Colors;
use serde_json::Map;
use std::path::{Path, PathBuf};

const COLORED: Attributes = Attributes { colors: true, ..Attributes::NONE };

/// Where the scan is written, and as what.
pub(crate) enum Painted {
    Ply(Output),
    /// With the buffer beside it, if it is JSON; and whether positions are rounded.
    Gltf(Output, Option<Buffer>, bool),
    /// Built from a PLY in a folder beside it.
    Chpm {
        path: PathBuf,
        force: bool,
        folder: WorkDir,
    },
}

/// A file that is there, or has yet to be built from a PLY.
pub(crate) struct Written(Option<(PathBuf, bool, WorkDir)>);

/// The PLY's name in its folder: what is built tells it as its source.
const SOURCE: &str = "compared.ply";

impl Painted {
    /// Refuses what cannot be written, before the work.
    pub(crate) fn create(
        by: &'static str,
        path: &Path,
        quantize: bool,
        force: bool,
        inputs: &[&Path],
    ) -> Result<Self> {
        let writes = |format: &'static str| Writes::mesh(by, format);
        let promised = output::promised(path);
        ensure!(
            !quantize || matches!(promised, Promise::Format("GLB" | "glTF")),
            "--quantize is for GLB and glTF: choose a name with .glb or .gltf"
        );
        Ok(match promised {
            Promise::Nothing | Promise::Format("PLY") => {
                Painted::Ply(writes("PLY").create(path, force, inputs)?)
            }
            Promise::Format(format @ ("GLB" | "glTF")) => {
                let output = writes(format).create(path, force, inputs)?;
                let is_json = format == "glTF";
                let buffer = is_json.then(|| Buffer::create(path, force, inputs)).transpose()?;
                Painted::Gltf(output, buffer, quantize)
            }
            Promise::Format("CHPM") => {
                // Opened to see whether it can be.
                drop(writes("CHPM").create(path, force, inputs)?);
                let place = path.parent().filter(|place| *place != Path::new("")).unwrap_or(Path::new("."));
                Painted::Chpm { path: path.to_owned(), force, folder: WorkDir::create(place)? }
            }
            _ => bail!(
                "{by} writes PLY, GLB, glTF and CHPM, and {}: choose another, or leave the extension out",
                output::otherwise(path)
            ),
        })
    }

    /// Output, if it is wanted; it may be standard output.
    pub(crate) fn output(&self) -> Option<&Output> {
        match self {
            Painted::Ply(output) | Painted::Gltf(output, ..) => Some(output),
            Painted::Chpm { .. } => None,
        }
    }

    /// Writes the leaves with their colours.
    pub(crate) fn write(
        self,
        by: &'static str,
        file: &Chpm<MappedFile>,
        parts: &Parts,
        colors: &Colors,
        cancel: &Cancel,
    ) -> Result<Written> {
        let mesh = Colored { by, file, parts, colors, cancel };
        let finished = match self {
            Painted::Ply(output) => companions::Written::alone(mesh.ply(output)?),
            Painted::Gltf(output, buffer, quantize) => mesh.gltf(container(output, buffer), quantize)?,
            Painted::Chpm { path, force, folder } => {
                let output = Writes::mesh(by, "PLY").create(&folder.path().join(SOURCE), false, &[])?;
                mesh.ply(output)?.publish()?;
                return Ok(Written(Some((path, force, folder))));
            }
        };
        finished.publish()?;
        Ok(Written(None))
    }
}

impl Written {
    /// Builds what is not there yet.
    pub(crate) fn build(self, memory: Bytes, quiet: bool, stop: &Stop) -> Result<()> {
        let Some((path, force, folder)) = self.0 else { return Ok(()) };
        let memory = Bytes(memory.0.max(chpm_build::MIN_MEMORY));
        let resources = Resources { memory, checkpoint: None, ..Resources::default() };
        let config = BuildConfig { resources, overwrite: force, ..BuildConfig::default() };
        build::build(&folder.path().join(SOURCE), &path, &config, &Meter::new(quiet), stop)?;
        Ok(())
    }
}

struct Colored<'a> {
    by: &'static str,
    file: &'a Chpm<MappedFile>,
    parts: &'a Parts,
    colors: &'a Colors,
    cancel: &'a Cancel,
}

impl Colored<'_> {
    fn counts(&self) -> (u64, u64) {
        (
            self.parts.values.len() as u64,
            leaves(self.file)
                .into_iter()
                .map(|leaf| u64::from(self.file.clusters()[leaf.index()].triangle_count))
                .sum(),
        )
    }

    fn vertices(&self, mut each: impl FnMut(VertexSlices<'_>) -> Result<()>) -> Result<()> {
        self.parts.vertices(self.file, |vertices, values| {
            stop::check(self.cancel)?;
            let colors: Vec<[u8; 4]> = values.iter().map(|value| self.colors.of(*value)).collect();
            each(VertexSlices { colors: &colors, ..vertices })
        })
    }

    fn triangles(&self, mut each: impl FnMut(&[[u32; 3]]) -> Result<()>) -> Result<()> {
        self.parts.triangles(self.file, |triangles| {
            stop::check(self.cancel)?;
            each(triangles)
        })
    }

    fn ply(&self, output: Output) -> Result<Output> {
        let origin = self.file.header().origin;
        let double = origin != [0.0; 3];
        let [low, high] = self.colors.range();
        let comment = format!("chpm {}, colours from {low} to {high}", self.by);
        let (encoding, (vertices, triangles)) = (Encoding::BinaryLittleEndian, self.counts());
        let mut ply = PlyWriter::new(output, encoding, vertices, triangles, COLORED, double, &[&comment])?;
        self.vertices(|batch| {
            if double {
                ply.vertices_f64(&batch.absolute(origin).collect::<Vec<_>>(), batch)?;
            } else {
                ply.vertices(batch)?;
            }
            Ok(())
        })?;
        self.triangles(|batch| Ok(ply.triangles(batch)?))?;
        Ok(ply.finish()?)
    }

    fn gltf(&self, container: Container<Output>, quantize: bool) -> Result<companions::Written> {
        let origin = self.file.header().origin;
        let placement = Placement { origin, turn: Upright::of(self.file, None)?.turn() };
        let range = self.colors.range().to_vec();
        let extras = Map::from_iter([("range".to_owned(), range.into())]);
        let facts = Facts {
            generator: format!("chpm {} {}", env!("CARGO_PKG_VERSION"), self.by),
            placement,
            levels: vec![Level { extras, coverage: 0.0 }],
            scalars: Vec::new(),
            grid: quantize.then(|| Grid::over(&self.file.header().aabb())),
        };
        let mut bounds = Aabb::EMPTY;
        self.parts.vertices(self.file, |vertices, _| {
            bounds.merge(&Aabb::of_points(vertices.positions));
            Ok(())
        })?;
        let (vertices, triangles) = self.counts();
        let mut glb = GlbWriter::new(container, &facts, COLORED, &[Extent { vertices, triangles, bounds }])?;
        self.vertices(|batch| Ok(glb.vertices(batch)?))?;
        self.triangles(|batch| Ok(glb.triangles(batch)?))?;
        Ok(companions::Written::gltf(glb.finish()?, triangles > 0))
    }
}
