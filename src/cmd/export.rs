//! `chpm export`: the whole hierarchy for programs that stream it.

mod archive;
mod folder;
mod meshlets;

use super::{Verdict, check_unchanged, open, reading, stdout};
use crate::crs::CrsArgs;
use crate::georeference::{self, At, Georeference};
use crate::json::{self, made, named};
use crate::memory::{self, MemoryArgs};
use crate::mesh_file;
use crate::number;
use crate::output::{self, Promise};
use crate::progress::{Meter, line};
use crate::stop::Stop;
use crate::threads::ThreadArgs;
use crate::upright::Upright;
use anyhow::{Result, bail, ensure};
use chpm_build::Cancel;
use chpm_export::Turn;
use chpm_export::meshlets::MOST;
use chpm_export::tiles::{Options, SharedNormals, Tileset, Tree, tilesets};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, Bytes, ClusterId, Counted};
use chpm_refine::Up;
use clap::ValueEnum;
use rayon::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm export`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// Make a 3D Tiles 1.1 tileset in the folder DIR, for CesiumJS, 3d-tiles-renderer and others; or, where the name ends in .3tz, as one file, the 3D Tiles
    /// archive 1.3. Its geometric errors are the file's bounds. It takes about two triangles for each of the source; sheets, where the file has them, go in
    /// as they are
    #[arg(long = "3dtiles", value_name = "DIR")]
    tiles: Option<PathBuf>,
    /// Make a file of meshlets, for engines that draw with mesh shaders: meshes in all resolutions with bounds to choose and to cull by. docs/MESHLETS.md has its bytes
    #[arg(long, value_name = "FILE", conflicts_with_all = ["tiles", "meshopt", "up", "origin", "transform", "crs", "geoid", "span"])]
    meshlets: Option<PathBuf>,
    /// Triangles of a meshlet, at most, and vertices
    #[arg(long, value_name = "N", default_value_t = 128, conflicts_with = "tiles", value_parser = number::count(8_u32..=MOST))]
    meshlet_triangles: u32,
    /// Compress the tiles: EXT_meshopt_compression
    #[arg(long)]
    meshopt: bool,
    /// What is up in the model: x, y, z, -x, -y or -z. If not given, what `render` finds, and z with --origin or --transform
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Up>,
    /// Normals of vertices where the file has none
    #[arg(long, value_name = "WHICH", value_enum, default_value_t = Normals::Computed)]
    normals: Normals,
    /// Where on the earth the model's zero point is, or what --origin-at names: degrees of longitude and latitude, and metres above the ellipsoid. Then x
    /// points east and y north, or -z where y is up, and a unit has to be a metre
    #[arg(long, value_name = "LON,LAT,H", conflicts_with = "transform", allow_hyphen_values = true)]
    origin: Option<Georeference>,
    /// Which point of the model is at --origin
    #[arg(long, value_name = "WHERE", value_enum, default_value_t = At::Zero, requires = "origin")]
    origin_at: At,
    /// What takes the model's coordinates, z upward, to those of the world: 16 numbers, column by column
    #[arg(long, value_name = "M", value_parser = georeference::transform, allow_hyphen_values = true, conflicts_with = "crs")]
    transform: Option<Transform>,
    #[command(flatten)]
    crs: CrsArgs,
    /// Levels of the hierarchy in one file of the tileset
    #[arg(long, value_name = "N", default_value_t = Options::SPAN, hide = true, value_parser = number::count(1_u32..=32))]
    span: u32,
    /// Replace the folder if it is an earlier export, or the file
    #[arg(short, long)]
    force: bool,
    /// What was written as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    threads: ThreadArgs,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// So that the argument is one value.
type Transform = [f64; 16];

#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Normals {
    /// By the triangles about a vertex; the same in all meshes where they meet
    Computed,
    /// Left out: many viewers then draw facets, or no shading at all
    None,
}

/// Memory of a cluster besides the tables: its parent, twice, its group's list of them, error and place in an order, and its id.
const EACH: u64 = 20 + 40;
/// Memory of a thread, and what it takes for each vertex and two triangles of the mesh that it makes.
const THREAD: u64 = 1 << 20;
const VERTEX: u64 = 192;
/// Times that the bytes of a sheet are in memory: by themselves, and in its tile.
const COPIES: u64 = 2;

/// Clusters whose meshes are made before they are written into one file, for each thread: they come in their order, whoever is faster.
const AHEAD: usize = 4;

/// Exports into a folder, or a file.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    match (&args.meshlets, &args.tiles) {
        (Some(target), _) => meshlets::run(args, target, stop),
        (None, Some(target)) => tiles(args, target, stop),
        (None, None) => bail!("nothing to export: name --3dtiles or --meshlets"),
    }
}

fn tiles(args: &Args, target: &Path, stop: &Stop) -> Result<Verdict> {
    let is_archive = output::promised(target) == Promise::Format(output::EXPORT.format());
    if !is_archive {
        output::check_folder("export", target)?;
    }
    let cancel = stop.heed();
    let file = open(&args.file)?;
    let normals = if computes(&file, args) { SharedNormals::memory(&file) } else { 0 };
    let sheet = file.sheets().iter().map(|sheet| sheet.len()).max().unwrap_or(0);
    let (table, waiting) = if is_archive { (archive::EACH, waiting(&file)) } else { (folder::EACH, 0) };
    let own = (EACH + table) * u64::from(file.header().cluster_count) + normals;
    let each = work(&file) + COPIES * sheet + waiting;
    let (pool, _) = memory::workers(&args.threads, &file, args.memory.memory(), own, each)?;
    reading(&file, || pool.install(|| export(&file, args, target, is_archive, &cancel)))?;
    Ok(Verdict::Good)
}

/// Memory of a thread for one tile: of the largest cluster there is.
fn work(file: &Chpm<MappedFile>) -> u64 {
    let vertices =
        file.clusters().iter().map(|cluster| cluster.vertex_count.max(cluster.triangle_count.div_ceil(2)));
    THREAD + VERTEX * u64::from(vertices.max().unwrap_or(0))
}

/// Memory of the meshes of a thread that wait to be written, at most.
fn waiting(file: &Chpm<MappedFile>) -> u64 {
    // Vertices and triangles of the base mesh and the finest, with what stands before them.
    let heaviest = file.clusters().iter().map(|cluster| {
        4096 + 2 * (40 * u64::from(cluster.vertex_count) + 12 * u64::from(cluster.triangle_count))
    });
    let sheet = file.sheets().iter().map(|sheet| sheet.len()).max().unwrap_or(0);
    AHEAD as u64 * (heaviest.max().unwrap_or(0) + sheet)
}

fn export(
    file: &Chpm<MappedFile>,
    args: &Args,
    target: &Path,
    is_archive: bool,
    cancel: &Cancel,
) -> Result<()> {
    // Whoever gives a place has coordinates that go to the east, the north and up.
    let is_placed = args.origin.is_some() || args.transform.is_some();
    let crs = args.crs.of(file, is_placed)?;
    let z = Up::nearest([0.0, 0.0, 1.0].into());
    ensure!(crs.is_none() || args.up.is_none_or(|up| up == z), "z is upward in --crs; leave --up away");
    let told = args.up.or_else(|| (is_placed || crs.is_some()).then_some(z));
    let upright = Upright::of(file, told)?;
    let turn = upright.turn();
    let (placed, reprojection) = match (&crs, args.origin) {
        (Some(crs), _) => {
            let (placed, reprojection) = crs.place(corners(file, turn))?;
            (Some(placed), Some(reprojection))
        }
        (None, origin) => (origin.map(|place| place.place(args.origin_at, corners(file, turn))), None),
    };
    let far = placed.as_ref().and_then(|placed| placed.warning.clone());
    let warnings: Vec<String> = far.into_iter().chain(mesh_file::without(file.scalars())).collect();
    warnings.iter().for_each(|warning| line(&format!("warning: {warning}")));
    let options = Options {
        generator: format!("chpm {} export", env!("CARGO_PKG_VERSION")),
        turn,
        normals: computes(file, args),
        packed: args.meshopt,
        transform: args.transform.or(placed.map(|placed| placed.matrix)),
        reprojection,
        span: args.span,
    };
    let meter = Meter::new(args.quiet);
    let work = Work { file, normals: options.normals, meter: &meter, cancel };
    let write = if is_archive { archive::write } else { folder::write };
    let sums = write(&work, &options, target, args)?;
    meter.finish();

    let mut out = stdout();
    let Sums { sets, tiles, triangles, bytes, archive } = sums;
    if args.json {
        let export = made::Export {
            schema: "chpm-export/1",
            file: named(&args.file),
            output: named(target),
            tilesets: sets,
            tiles,
            triangles,
            tile_bytes: bytes,
            archive_bytes: archive,
            warnings,
        };
        json::print(&export, &mut out)?;
        return Ok(out.flush()?);
    }
    if !upright.why.is_empty() {
        writeln!(out, "{} (--up chooses otherwise)", upright.why)?;
    }
    let whole = archive.map(|bytes| format!("; the archive has {}", Bytes(bytes)));
    writeln!(
        out,
        "{}: {} of {}, {}, in {}{}",
        target.display(),
        Counted(tiles, "tile"),
        Counted(triangles, "triangle"),
        Bytes(bytes),
        Counted(sets, "tileset"),
        whole.unwrap_or_default(),
    )?;
    Ok(out.flush()?)
}

/// Two corners of the box of a model that stands upright.
fn corners(file: &Chpm<MappedFile>, turn: Turn) -> [[f64; 3]; 2] {
    let header = file.header();
    let Aabb { min, max } = header.aabb();
    // Turned upright, an axis may have its ends the other way round.
    let (a, b) = (there(min, &header.origin, turn), there(max, &header.origin, turn));
    [std::array::from_fn(|axis| a[axis].min(b[axis])), std::array::from_fn(|axis| a[axis].max(b[axis]))]
}

fn there(local: [f32; 3], origin: &[f64; 3], turn: Turn) -> [f64; 3] {
    chpm_export::tiles::upright(turn, std::array::from_fn(|axis| origin[axis] + f64::from(local[axis])))
}

/// Whether tiles get normals that the file does not have.
fn computes(file: &Chpm<MappedFile>, args: &Args) -> bool {
    args.normals == Normals::Computed && !file.header().attributes().decoded().normals
}

/// An export: of which file, and who is told.
struct Work<'a> {
    file: &'a Chpm<MappedFile>,
    /// Whether vertices get normals that the file does not have.
    normals: bool,
    meter: &'a Meter,
    cancel: &'a Cancel,
}

/// How much was written.
#[derive(Default)]
struct Sums {
    sets: u64,
    tiles: u64,
    triangles: u64,
    /// Of tiles and their images.
    bytes: u64,
    /// Of the archive, if it is one.
    archive: Option<u64>,
}

impl Work<'_> {
    /// All files that are no tiles; answers how many they are.
    fn tilesets(&self, options: &Options, mut sink: impl FnMut(Tileset) -> Result<()>) -> Result<u64> {
        self.meter.start("tree", self.file.groups().len() as u64);
        let tree = Tree::find(self.file, |_| self.step())?;
        let mut sets = 0;
        tilesets(self.file, &tree, options, |set| {
            sets += 1;
            sink(set)?;
            self.go_on()
        })?;
        self.meter.finish();
        Ok(sets)
    }

    /// Normals of vertices, where they get some.
    fn normals(&self) -> Result<Option<SharedNormals>> {
        if !self.normals {
            return Ok(None);
        }
        let leaves = self.file.clusters().iter().filter(|cluster| cluster.is_leaf()).count();
        self.meter.start("normals", leaves as u64);
        let normals = SharedNormals::find(self.file, |_| self.step())?;
        self.meter.finish();
        Ok(Some(normals))
    }

    /// Makes something of each cluster, on all threads, and takes it in the order of clusters.
    fn in_order<T: Send>(
        &self,
        label: &str,
        make: impl Fn(ClusterId) -> Result<T> + Sync,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let clusters: Vec<ClusterId> = (0..self.file.header().cluster_count).map(ClusterId).collect();
        self.meter.start(label, clusters.len() as u64);
        for batch in clusters.chunks(AHEAD * rayon::current_num_threads()) {
            let made = batch.par_iter().map(|id| {
                self.step()?;
                make(*id)
            });
            let made: Vec<T> = made.collect::<Result<_>>()?;
            made.into_iter().try_for_each(&mut take)?;
        }
        check_unchanged(self.file)?;
        Ok(())
    }

    /// One more piece is done, or begun.
    fn step(&self) -> Result<()> {
        self.meter.add(1);
        self.go_on()
    }

    fn go_on(&self) -> Result<()> {
        ensure!(!self.cancel.is_cancelled(), "stopped on request");
        Ok(())
    }
}
