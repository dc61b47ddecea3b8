//! One mesh as a file of another program: which format, and how it is streamed.

mod format;
mod streamed;
mod textured;

use crate::cmd::check_unchanged;
use crate::companions::{Buffer, Written, container};
use crate::escape::in_line;
use crate::frame::Frame;
use crate::inputs;
use crate::json::{self, made, named};
use crate::number::AtMost;
use crate::output::{self, Output, Promise, Writes};
use crate::progress::Meter;
use crate::stop;
use crate::upright::Upright;
use crate::whole::{Order, Whole};
use anyhow::{Context, Result, bail, ensure};
use chpm_build::Cancel;
use chpm_export::{Grid, PIECE_VERTICES, Turn, coverage};
use chpm_extmem::{AtomicFile, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::{Counted, Scalar, geom};
use chpm_refine::{Extraction, Up};
use format::MeshFormat;
use std::path::{Path, PathBuf};
use streamed::{Steps, facts};
pub(crate) use textured::memory as textured_memory;

/// Bytes that choosing a cut takes for each cluster.
const SELECTION: u64 = 256;
/// Bytes of a piece of a mesh with as many vertices as indices of 16 bits tell apart.
const PIECE: u64 = 4 << 20;

/// Where a mesh goes, and as what.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct MeshArgs {
    /// The file to write. Its name says the format: .ply, .stl, .obj, .glb or .gltf; PLY where it says nothing; - for standard output
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// The format, where the name does not say it
    #[arg(long, value_name = "FORMAT", value_enum)]
    format: Option<MeshFormat>,
    /// Write PLY or STL as text instead of binary little endian
    #[arg(long)]
    ascii: bool,
    /// Compress a glTF: EXT_meshopt_compression, which three.js, Babylon.js and CesiumJS read. Named scalars are left out
    #[arg(long)]
    meshopt: bool,
    /// Round positions in a glTF to 16 bits an axis, normals and colours to 8 (KHR_mesh_quantization): vertices take a half to two thirds of the bytes. How far
    /// positions move is part of the error
    #[arg(long)]
    quantize: bool,
    /// In which order vertices and triangles are
    #[arg(long, value_name = "ORDER", value_enum, default_value = "file")]
    order: Order,
    /// What is up in the model, x, y, z, -x, -y or -z: the mesh is turned so that up is where its format has it, y in glTF and OBJ, z in PLY and STL. If
    /// not given, coordinates are as in the model, and the node of a glTF turns it from what `render` finds to be up
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Up>,
    /// Leave vertex normals out
    #[arg(long)]
    pub(crate) no_normals: bool,
    /// Leave vertex colours out
    #[arg(long)]
    pub(crate) no_colors: bool,
    /// Write coordinates relative to the middle of the model, in single precision; where that is goes into a file beside the output, FILE.origin.json, and into
    /// the extras of a glTF
    #[arg(long)]
    local_origin: bool,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
}

/// A mesh file that is being written.
pub(crate) struct MeshFile<'a> {
    args: &'a MeshArgs,
    /// Files that are read.
    inputs: Vec<PathBuf>,
    by: &'static str,
    format: MeshFormat,
    pub(crate) output: Output,
    /// The buffer of a glTF that is JSON.
    buffer: Option<Buffer>,
    /// Where it is told what coordinates are relative to.
    aside: Option<(PathBuf, AtomicFile)>,
}

/// A mesh file, and the mesh that goes into it; several are levels of detail.
pub(crate) struct Ready<'m, 'a> {
    target: MeshFile<'a>,
    /// The finest first; at least one.
    pub(crate) levels: Vec<ReadyMesh<'m>>,
    frame: Frame,
    grid: Option<Grid>,
    /// By a node.
    turn: Turn,
    /// Which way is up, and why, where that was found out.
    pub(crate) upright: Option<String>,
    pub(crate) warnings: Vec<String>,
}

/// A mesh that goes into a file.
#[derive(Clone, Copy)]
pub(crate) struct ReadyMesh<'m> {
    pub(crate) mesh: &'m Extraction<'m, MappedFile>,
    pub(crate) bounds: Bounds,
    /// Down to which share of an image's height it is to be drawn.
    pub(crate) coverage: f64,
}

/// Bounds that a cut keeps, with the format's rounding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub(crate) error: f32,
    pub(crate) distance: f32,
}

impl MeshArgs {
    /// Format to write, unless nothing is that has such a name.
    fn format(&self, by: &str) -> Result<MeshFormat> {
        let format = match (self.format, output::promised(&self.output)) {
            (Some(format), _) => Some(format),
            (None, Promise::Nothing) => Some(MeshFormat::Ply),
            (None, Promise::Format(name)) => MeshFormat::named(name),
            (None, Promise::Unknown) => None,
        };
        format.with_context(|| {
            format!(
                "{by} writes PLY, STL, OBJ, GLB and glTF, and {}: choose another, say --format, or leave the extension out",
                output::otherwise(&self.output)
            )
        })
    }

    /// Whether one file of this format has room for levels of detail.
    pub(crate) fn has_levels(&self, by: &str) -> Result<bool> {
        Ok(self.format(by)?.is_gltf())
    }

    /// The same for a file of a level's own: `out.ply` becomes `out.lod2.ply`.
    pub(crate) fn of_level(&self, by: &str, level: usize) -> Result<MeshArgs> {
        let format = self.format(by)?;
        ensure!(
            !output::is_stdout(&self.output),
            "each level of detail is a file here: name one, or write a GLB without --lods-apart, which has all of them"
        );
        let mut name = self.output.file_stem().unwrap_or_default().to_owned();
        name.push(format!(".lod{level}."));
        name.push(self.output.extension().unwrap_or(format.extension().as_ref()));
        Ok(MeshArgs { output: self.output.with_file_name(name), format: Some(format), ..self.clone() })
    }

    /// Bytes that selecting and writing take besides the file's tables.
    pub(crate) fn memory(&self, by: &str, file: &Chpm<MappedFile>) -> Result<u64> {
        let header = file.header();
        let selection =
            4 * u64::from(header.shared_vertex_count) + SELECTION * u64::from(header.cluster_count);
        Ok(selection
            + match self.format(by)? {
                MeshFormat::Stl => PIECE,
                MeshFormat::Glb | MeshFormat::Gltf if self.meshopt => 3 * PIECE,
                _ => 0,
            })
    }

    /// Whether it is written as it is read.
    pub(crate) fn is_streamed(&self) -> bool {
        self.order == Order::File
    }

    /// Bytes of `free` ones for pages that were packed: what is put into another order is read twice in any case.
    pub(crate) fn to_keep(&self, free: u64) -> u64 {
        if self.is_streamed() { free } else { 0 }
    }

    /// Bytes that the order of this mesh takes besides.
    pub(crate) fn order_memory(&self, mesh: &Extraction<'_, MappedFile>) -> u64 {
        self.order.memory(mesh)
    }

    /// Refuses what cannot be written, and opens the output for the verb `by`, which reads `inputs`.
    pub(crate) fn create(&self, by: &'static str, inputs: &[&Path]) -> Result<MeshFile<'_>> {
        let format = self.format(by)?;
        let name = format.name();
        ensure!(!self.meshopt || format.is_gltf(), "--meshopt is for GLB and glTF, and this is {name}");
        ensure!(!self.quantize || format.is_gltf(), "--quantize is for GLB and glTF, and this is {name}");
        ensure!(!self.ascii || !format.is_gltf(), "--ascii is for PLY and STL: {name} is binary");
        let writes = Writes::mesh(by, name);
        let writes = if self.format.is_some() { writes.chosen() } else { writes };
        let output = writes.create(&self.output, self.force, inputs)?;
        let buffer = match format {
            MeshFormat::Gltf => Some(Buffer::create(&self.output, self.force, inputs)?),
            _ => None,
        };
        let aside = match (self.local_origin, output.is_stream()) {
            (false, _) => None,
            (true, true) if format == MeshFormat::Glb => None,
            (true, true) => bail!(
                "--local-origin tells in a file beside the output what coordinates are relative to: name a file, or write a GLB, which tells it itself"
            ),
            (true, false) => {
                let path = aside(&self.output);
                inputs::refuse(&path, inputs)?;
                let file = AtomicFile::create(&path, self.force)?;
                Some((path, file))
            }
        };
        let inputs = inputs.iter().map(|input| input.to_path_buf()).collect();
        Ok(MeshFile { args: self, inputs, by, format, output, buffer, aside })
    }
}

/// The file beside an output that tells what its coordinates are relative to.
fn aside(output: &Path) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(".origin.json");
    name.into()
}

/// Beyond this share of the diagonal, rounding shows.
const VISIBLE: f64 = 1e-5;

impl MeshFile<'_> {
    /// By how much the format's single precision would move vertices of this file at most.
    fn lost(&self, file: &Chpm<MappedFile>) -> f64 {
        let header = file.header();
        let rounds = self.format == MeshFormat::Stl && !self.args.ascii;
        if rounds { chpm_export::rounding(&header.aabb(), header.origin) } else { 0.0 }
    }

    /// Where vertices go: to the model's coordinates, or relative to its middle where that was asked for or the others would be lost.
    fn frame(&self, file: &Chpm<MappedFile>, is_lost: bool) -> Frame {
        let (lost, diagonal) = (self.lost(file), file.header().aabb().diagonal());
        let frame = Frame::new(file).without(self.args.no_normals, self.args.no_colors);
        let frame = match self.args.local_origin || is_lost || lost > VISIBLE * diagonal {
            true => frame.about_middle(file),
            false => frame.rounded(lost),
        };
        let frame = match self.args.up {
            Some(up) => frame.turned(self.format.turn(up)),
            None => frame,
        };
        match self.grid(file, &frame) {
            Some(grid) => frame.rounded(grid.rounding()),
            None => frame,
        }
    }

    /// The lattice that written positions are rounded to, over all of the model, so that every mesh of it has the same.
    fn grid(&self, file: &Chpm<MappedFile>, frame: &Frame) -> Option<Grid> {
        self.args.quantize.then(|| Grid::over(&frame.bounds(&file.header().aabb())))
    }

    /// Whether named scalars are in a file of so many triangles.
    fn keeps_scalars(&self, triangles: u64) -> bool {
        match self.format {
            MeshFormat::Ply => true,
            // As in `write`: without triangles there is nothing to pack.
            MeshFormat::Glb | MeshFormat::Gltf => !self.args.meshopt || triangles == 0,
            MeshFormat::Stl | MeshFormat::Obj => false,
        }
    }

    /// Refuses what cannot have images.
    pub(crate) fn check_textured(&self) -> Result<()> {
        ensure!(
            self.format != MeshFormat::Stl && !self.args.ascii,
            "--texture-size is for GLB, glTF, OBJ and binary PLY: choose a name with .glb, .gltf, .obj or .ply"
        );
        let is_alone = self.output.is_stream() && self.format != MeshFormat::Glb;
        ensure!(!is_alone, "images lie beside the output: name a file, or write a GLB, which has them in it");
        Ok(())
    }

    /// By how much writing moves vertices of this file at most.
    pub(crate) fn rounding(&self, file: &Chpm<MappedFile>) -> f64 {
        self.frame(file, false).rounding()
    }
}

impl<'m, 'a> Ready<'m, 'a> {
    /// Decides in which coordinates a mesh is written, or several, the finest first. Where they are `proven` to be nearer to the source than is stored, that
    /// is told.
    pub(crate) fn new(
        target: MeshFile<'a>,
        file: &Chpm<MappedFile>,
        meshes: &[&'m Extraction<'m, MappedFile>],
        proven: Option<f32>,
        cancel: &Cancel,
    ) -> Result<Self> {
        let lost = target.lost(file);
        let mut frame = target.frame(file, false);
        if lost > 0.0 && frame.offset().is_none() {
            for mesh in meshes {
                if collapses(mesh, file.header().origin, cancel)? {
                    frame = target.frame(file, true);
                }
            }
        }
        let finds_up = target.format.is_gltf() && target.args.up.is_none();
        let found = finds_up.then(|| Upright::of(file, None)).transpose()?;
        let turn = found.as_ref().map_or(Turn::NONE, Upright::turn);
        let upright = found.map(|found| format!("{} (--up chooses otherwise)", found.why));
        let rounding = frame.rounding();
        fn with(bound: f32, rounding: f64) -> f32 {
            if rounding > 0.0 { geom::round_up(f64::from(bound) + rounding) } else { bound }
        }
        let nearest = |stored: f32| with(proven.map_or(stored, |proven| proven.min(stored)), rounding);
        let of = |mesh: &Extraction<'_, MappedFile>| Bounds {
            error: nearest(mesh.error()),
            distance: nearest(mesh.distance()),
        };
        let errors: Vec<f32> = meshes.iter().map(|mesh| of(mesh).error).collect();
        let shares = coverage(&errors, file.header().aabb().diagonal());
        let levels: Vec<_> = meshes
            .iter()
            .zip(shares)
            .map(|(mesh, coverage)| ReadyMesh { mesh, bounds: of(mesh), coverage })
            .collect();
        let moved = frame.offset().filter(|_| !target.args.local_origin).map(|[x, y, z]| {
            format!(
                "so far from the zero point, the single precision of binary STL would move vertices by up to {} units: coordinates are written relative to {x} {y} {z}; --local-origin tells that in a file beside it, --ascii and other formats keep the coordinates",
                AtMost(lost)
            )
        });
        let triangles = meshes.iter().map(|mesh| mesh.triangle_count()).sum();
        let left_out = if target.keeps_scalars(triangles) { None } else { without(file.scalars()) };
        let warnings = moved.into_iter().chain(left_out).collect();
        let grid = target.grid(file, &frame);
        Ok(Ready { target, levels, frame, grid, turn, upright, warnings })
    }

    /// The mesh, or the finest level.
    pub(crate) fn finest(&self) -> ReadyMesh<'m> {
        self.levels[0]
    }

    /// Facts about a mesh of the written file, for programs.
    pub(crate) fn json(&self, of: ReadyMesh<'m>) -> made::Mesh {
        let ReadyMesh { mesh, bounds, .. } = of;
        let (MeshArgs { output, up, .. }, format) = (self.target.args, self.target.format);
        made::Mesh {
            output: named(output),
            format: format.name(),
            triangles: mesh.triangle_count(),
            coincident: mesh.coincident_count(),
            vertices: mesh.vertex_count(),
            error: bounds.error,
            distance: bounds.distance,
            origin: self.offset(),
            origin_file: self.target.aside.as_ref().map(|(path, _)| named(path)),
            up: up.is_some().then_some(format.up()).or(self.upright.as_ref().map(|_| format.up())),
        }
    }

    /// Origin of coordinates as whoever loads the file has them.
    fn offset(&self) -> Option<[f64; 3]> {
        self.frame.offset().map(|offset| self.turn.apply(offset))
    }

    /// Streams the mesh. The file has no name yet.
    pub(crate) fn write(self, file: &Chpm<MappedFile>, meter: &Meter, cancel: &Cancel) -> Result<Written> {
        let (offset, Bounds { error, distance }) = (self.offset(), self.finest().bounds);
        let Ready { target, levels, frame, grid, turn, .. } = self;
        let (by, ascii) = (target.by, target.args.ascii);
        // In front, since a binary STL has room for 80 bytes.
        let place = offset.map_or(String::new(), |[x, y, z]| format!(", origin {x} {y} {z}"));
        let comment = match file.has_gaps() {
            true => format!("chpm {by}{place}, error {error:e}, distance {distance:e}"),
            false => format!("chpm {by}{place}, error {error:e}"),
        };
        let steps = Steps { meter, cancel };
        let meshes: Vec<Whole<'_>> = levels
            .iter()
            .map(|level| Whole::new(level.mesh, frame, target.args.order, cancel))
            .collect::<Result<_>>()?;
        let mesh = &meshes[0];
        stop::check(cancel)?;
        let output = target.output;
        let mut written = match target.format {
            MeshFormat::Ply => Written::alone(streamed::ply(mesh, output, ascii, &comment, &steps)?),
            MeshFormat::Stl => Written::alone(streamed::stl(mesh, output, ascii, &comment, &steps)?),
            MeshFormat::Obj => Written::alone(streamed::obj(mesh, output, &comment, &steps)?),
            MeshFormat::Glb | MeshFormat::Gltf => {
                let mut facts = facts(file, (&levels, mesh.origin()), by, offset, turn);
                facts.grid = grid;
                let has_mesh = meshes.iter().any(|mesh| mesh.triangle_count() > 0);
                let container = container(output, target.buffer);
                let container = match target.args.meshopt && has_mesh {
                    true => streamed::packed_gltf(&meshes, container, facts, &steps)?,
                    false => streamed::gltf(&meshes, container, &facts, &steps)?,
                };
                Written::gltf(container, has_mesh)
            }
        };
        if let Some((_, mut aside)) = target.aside {
            let name = target.args.output.file_name().unwrap_or_default();
            let origin = made::Origin {
                schema: "chpm-origin/1",
                file: name.to_string_lossy().into_owned(),
                origin: offset,
            };
            json::print(&origin, &mut aside)?;
            written.beside.push(aside);
        }
        check_unchanged(file)?;
        meter.finish();
        Ok(written)
    }
}

/// Warning of an output that has colours of vertices where it could have images.
pub(crate) fn without_images(file: &Chpm<MappedFile>, args: &MeshArgs) -> Option<String> {
    (file.header().has_sheets() && !args.no_colors).then(|| {
        "images have become colours of vertices: --texture-size 4096 writes them, to glTF, OBJ or PLY"
            .to_owned()
    })
}

/// Warning of an output that has no room for named scalars, where there are some.
pub(crate) fn without(scalars: &[Scalar]) -> Option<String> {
    let names: Vec<_> = scalars.iter().map(|scalar| in_line(&scalar.name)).collect();
    (!names.is_empty()).then(|| {
        format!(
            "the output leaves out {}: extract to PLY or to glTF without --meshopt keeps named scalars",
            names.join(", ")
        )
    })
}

/// Whether single precision, far from the zero point, makes of a triangle one without area.
fn collapses(mesh: &Extraction<'_, MappedFile>, origin: [f64; 3], cancel: &Cancel) -> Result<bool> {
    let mut found = false;
    mesh.pieces(PIECE_VERTICES, |vertices, triangles| {
        stop::check(cancel)?;
        found = found
            || triangles.iter().any(|corners| {
                let near = corners.map(|v| vertices.positions[v as usize]);
                has_area(near)
                    && !has_area(
                        near.map(|p| [0, 1, 2].map(|axis| (f64::from(p[axis]) + origin[axis]) as f32)),
                    )
            });
        anyhow::Ok(())
    })?;
    Ok(found)
}

fn has_area([a, b, c]: [[f32; 3]; 3]) -> bool {
    fn less(p: [f32; 3], a: &[f32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(p[axis]) - f64::from(a[axis]))
    }
    let ([ux, uy, uz], [vx, vy, vz]) = (less(b, &a), less(c, &a));
    uy * vz != uz * vy || uz * vx != ux * vz || ux * vy != uy * vx
}

/// One line about a mesh that was written: `out.ply: 20,000 triangles, 10,002 vertices, error 0.02 units`.
pub(crate) fn summary(
    output: &Path,
    mesh: &Extraction<'_, MappedFile>,
    bounds: Bounds,
    unit: &str,
) -> String {
    format!("{}: {}", output.display(), outline(mesh, bounds, unit))
}

/// The same without its name.
pub(crate) fn outline(mesh: &Extraction<'_, MappedFile>, bounds: Bounds, unit: &str) -> String {
    let Bounds { error, distance } = bounds;
    // Only what has vanished is farther.
    let vanished = match distance > error {
        true => format!(" ({} to what has vanished)", AtMost(distance.into())),
        false => String::new(),
    };
    let coincident = match mesh.coincident_count() {
        0 => String::new(),
        count => format!(", {} of them on others", crate::report::count(count)),
    };
    format!(
        "{}{coincident}, {}, error {} {unit}{vanished}",
        Counted(mesh.triangle_count(), "triangle"),
        Counted(mesh.vertex_count().into(), "vertex"),
        AtMost(error.into()),
    )
}
