//! `chpm export`: the whole hierarchy for programs that stream it.

use super::{Verdict, open, reading, stdout};
use crate::crs::CrsArgs;
use crate::folder::{OutputFolder, above};
use crate::georeference::{self, At, Georeference};
use crate::json::{self, made, named};
use crate::memory::{self, MemoryArgs};
use crate::mesh_file;
use crate::number;
use crate::output;
use crate::progress::{Meter, line};
use crate::stop::Stop;
use crate::upright::Upright;
use anyhow::{Result, ensure};
use chpm_build::Cancel;
use chpm_export::Turn;
use chpm_export::tiles::{Mesh, Options, SharedNormals, Tree, tile, tile_image, tile_path, tilesets};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, Bytes, ClusterId, Counted};
use chpm_refine::Up;
use clap::ValueEnum;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use xxhash_rust::xxh3::xxh3_64;

/// Arguments of `chpm export`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// Make a 3D Tiles 1.1 tileset in the folder DIR, for CesiumJS, 3d-tiles-renderer and others. Its geometric errors are the file's bounds. It
    /// takes about two triangles for each of the source; sheets, where the file has them, go in as they are
    #[arg(long = "3dtiles", value_name = "DIR", required = true)]
    tiles: PathBuf,
    /// Compress the tiles: EXT_meshopt_compression
    #[arg(long)]
    meshopt: bool,
    /// What is up in the model: x, y, z, -x, -y or -z. If not given, what `render` finds, and z with --origin or --transform
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Up>,
    /// Normals of tiles where the file has none
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
    /// Replace the folder if it is an earlier export
    #[arg(short, long)]
    force: bool,
    /// What was written as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// So that the argument is one value.
type Transform = [f64; 16];

#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Normals {
    /// By the triangles about a vertex; the same in all tiles where tiles meet
    Computed,
    /// Left out: many viewers then draw facets, or no shading at all
    None,
}

/// Names in an export's folder.
const NAMES: [&str; 3] = ["tileset.json", "tiles", "subtrees"];

/// Memory of a cluster besides the tables: its parent, twice, its group's list of them, error and place in an order, its id, and a stopped run's
/// record of its tiles.
const EACH: u64 = 20 + 40 + 2 * 2 * 32;
/// Memory of a thread for one tile, at most: 65,535 vertices and twice as many triangles.
const WORK: u64 = 12 << 20;
/// Times that the bytes of a sheet are in memory: by themselves, and in its tile.
const COPIES: u64 = 2;

/// Exports into a folder.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    output::check_folder("export", &args.tiles)?;
    let cancel = stop.heed();
    let file = open(&args.file)?;
    let threads = rayon::current_num_threads() as u64;
    let normals = if computes(&file, args) { SharedNormals::memory(&file) } else { 0 };
    let sheet = file.sheets().iter().map(|sheet| sheet.len()).max().unwrap_or(0);
    let own = EACH * u64::from(file.header().cluster_count) + (WORK + COPIES * sheet) * threads + normals;
    memory::divide(&file, args.memory.memory(), own)?;
    reading(&file, || export(&file, args, &cancel))?;
    Ok(Verdict::Good)
}

fn export(file: &Chpm<MappedFile>, args: &Args, cancel: &Cancel) -> Result<()> {
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
    let folder = OutputFolder::create(&args.tiles, args.force, &NAMES, Some(key(file, &options)))?;
    if folder.found() > 0 && !args.quiet {
        line(&format!("going on: {} are there", Counted(folder.found() as u64, "tile")));
    }
    let meter = Meter::new(args.quiet);
    let sums = match fill(file, &options, &folder, &meter, cancel) {
        Ok(sums) => sums,
        // What is wrong with the source will be so next time.
        Err(error) if cancel.is_cancelled() || error.chain().any(|cause| cause.is::<io::Error>()) => {
            return Err(folder.keep(error));
        }
        Err(error) => return Err(error),
    };
    folder.publish()?;
    output::finish(&args.tiles);
    meter.finish();

    let mut out = stdout();
    let [sets, tiles, triangles, bytes] = sums;
    if args.json {
        let export = made::Export {
            schema: "chpm-export/1",
            file: named(&args.file),
            output: named(&args.tiles),
            tilesets: sets,
            tiles,
            triangles,
            tile_bytes: bytes,
            warnings,
        };
        json::print(&export, &mut out)?;
        return Ok(out.flush()?);
    }
    if !upright.why.is_empty() {
        writeln!(out, "{} (--up chooses otherwise)", upright.why)?;
    }
    writeln!(
        out,
        "{}: {} of {}, {}, in {}",
        args.tiles.display(),
        Counted(tiles, "tile"),
        Counted(triangles, "triangle"),
        Bytes(bytes),
        Counted(sets, "tileset"),
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

/// Hash of everything that decides the bytes: the options, and the file, whose header has a checksum of the checksums of all that is in it.
fn key(file: &Chpm<MappedFile>, options: &Options) -> u64 {
    xxh3_64(format!("{:016x} {options:?}", file.header().header_checksum).as_bytes())
}

/// Writes all of it; how many tilesets, tiles, triangles and bytes of tiles that are.
fn fill(
    file: &Chpm<MappedFile>,
    options: &Options,
    folder: &OutputFolder,
    meter: &Meter,
    cancel: &Cancel,
) -> Result<[u64; 4]> {
    meter.start("tree", file.groups().len() as u64);
    let tree = Tree::find(file, |_| {
        meter.add(1);
        go_on(cancel)
    })?;
    let mut sets = 0_u64;
    tilesets(file, &tree, options, |set| {
        sets += 1;
        folder.folder(above(&set.path))?;
        folder.write(&set.path, set.json.as_bytes())?;
        go_on(cancel)
    })?;
    meter.finish();

    let normals = if options.normals { Some(normals(file, meter, cancel)?) } else { None };
    let clusters: Vec<ClusterId> = (0..file.header().cluster_count).map(ClusterId).collect();
    let folders: BTreeSet<String> =
        clusters.iter().map(|id| above(&tile_path(*id, Mesh::Base)).to_owned()).collect();
    folders.iter().try_for_each(|name| folder.folder(name))?;
    meter.start("tiles", clusters.len() as u64);
    let [tiles, triangles, bytes] = [0, 0, 0].map(AtomicU64::new);
    clusters.par_iter().try_for_each(|id| {
        for mesh in Mesh::of(file, *id) {
            let path = tile_path(*id, *mesh);
            let (len, count) = match folder.whole(&path) {
                Some(found) => found,
                None => {
                    let (glb, count) = tile(file, *id, *mesh, options, normals.as_ref())?;
                    folder.write_to_keep(&path, &glb, count)?;
                    (glb.len() as u64, count)
                }
            };
            for (sum, more) in [(&tiles, 1), (&triangles, count), (&bytes, len)] {
                sum.fetch_add(more, Relaxed);
            }
        }
        if let Some((path, image)) = tile_image(file, *id)? {
            if folder.whole(&path).is_none() {
                folder.write_to_keep(&path, &image, 0)?;
            }
            bytes.fetch_add(image.len() as u64, Relaxed);
        }
        meter.add(1);
        go_on(cancel)
    })?;
    file.get_ref().check_unchanged()?;
    Ok([sets, tiles.into_inner(), triangles.into_inner(), bytes.into_inner()])
}

fn normals(file: &Chpm<MappedFile>, meter: &Meter, cancel: &Cancel) -> Result<SharedNormals> {
    let leaves = file.clusters().iter().filter(|cluster| cluster.is_leaf()).count();
    meter.start("normals", leaves as u64);
    let normals = SharedNormals::find(file, |_| {
        meter.add(1);
        go_on(cancel)
    })?;
    meter.finish();
    Ok(normals)
}

fn go_on(cancel: &Cancel) -> std::result::Result<(), anyhow::Error> {
    ensure!(!cancel.is_cancelled(), "stopped on request");
    Ok(())
}
