//! `chpm measure`: how far two meshes are from each other, or a file's levels and cuts from its source, or its colours from those of the source's images.

mod texture;

use super::{Verdict, open, reading, stdout};
use crate::args::StorageArgs;
use crate::json::{self, judged, named};
use crate::number::{self, Units};
use crate::progress::Meter;
use crate::report::{count, table};
use crate::stop::Stop;
use crate::threads::ThreadArgs;
use anyhow::{Result, bail, ensure};
use chpm_extmem::{Cancel, MappedFile, Store};
use chpm_format::Chpm;
use chpm_measure::{Deviation, Side, deviation_while};
use chpm_mesh::{Aabb, Counted, TriMesh};
use chpm_verify::deviation::{LevelDeviation, Spread};
use chpm_verify::measure::Which;
use chpm_verify::{Measured, Measures, Points};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm measure`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// A mesh ({meshes}); with --against, a .chpm file
    first: PathBuf,
    /// The mesh to measure it against, and that against it; both are read into memory
    #[arg(required_unless_present = "against", conflicts_with = "against")]
    second: Option<PathBuf>,
    /// The mesh that the .chpm file was built from ({meshes}). Its triangles must be those of the leaves, which are then read cluster by
    /// cluster, so that the source need not fit into memory
    #[arg(long, value_name = "MESH")]
    against: Option<PathBuf>,
    /// Measure all clusters of every level, the default with --against: at the base meshes, and between them and the
    /// finest, which are the base meshes of the level below
    #[arg(long, requires = "against", conflicts_with = "second")]
    levels: bool,
    /// Positions of each level's progressive meshes
    #[arg(long, value_name = "N", default_value_t = 2, conflicts_with = "second",
          value_parser = number::count(1_u32..=1000))]
    positions: u32,
    /// Measure N cuts: half of them random legal cuts, half what random cameras select
    #[arg(long, value_name = "N", requires = "against", conflicts_with = "second",
          value_parser = number::count(1..=u32::MAX))]
    cuts: Option<u32>,
    /// Seed of the first cut; the others follow
    #[arg(long, value_name = "S", requires = "cuts", default_value_t = 0)]
    seed: u64,
    /// Measure colours of a file with sheets: how far they are from those of the source's images, and how far they have
    /// slid on the surface. The source is read into memory
    #[arg(long, requires = "against", conflicts_with_all = ["second", "levels", "cuts"])]
    texture: bool,
    /// Samples on each triangle of the finer mesh at least, and as many as that by area; vertices and edges have their own.
    /// With --texture, samples for each triangle that is drawn, spread by area
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = number::count(1_u32..=1_000_000))]
    samples: u32,
    #[command(flatten)]
    threads: ThreadArgs,
    /// The result as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    storage: StorageArgs,
}

/// Measures; a stored distance that does not hold is a fault.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let pool = args.threads.pool()?;
    pool.install(|| match (&args.second, &args.against) {
        (Some(second), _) => meshes(args, second),
        (_, Some(source)) => {
            let file = open(&args.first)?;
            reading(&file, || match args.texture {
                true => texture::run(&file, args, source, stop),
                false => judge(&file, args, source, stop),
            })
        }
        _ => bail!("a second mesh or --against is needed"),
    })
}

fn meshes(args: &Args, second: &Path) -> Result<Verdict> {
    let meter = Meter::new(args.quiet);
    let scratch = args.storage.work_dir.clone().unwrap_or_else(std::env::temp_dir);
    let store = Store::create(&scratch, args.storage.memory().0)?;
    // The first signal ends the process.
    let read = |path: &Path| Points::read(path, &store, &meter, &Cancel::default());
    let (a, b) = (read(&args.first)?, read(second)?);
    for (mesh, path) in [(&a, &args.first), (&b, &second.to_path_buf())] {
        ensure!(!mesh.triangles.is_empty(), "'{}' has no triangles to measure", path.display());
    }
    let origin = common_origin(&a, &b);
    let (a, b) = (a.relative(origin), b.relative(origin));
    let mut bounds = Aabb::of_points(&a.positions);
    bounds.merge(&Aabb::of_points(&b.positions));
    let diagonal = bounds.diagonal();
    // The number of parts is known with the first that is done.
    let started = std::sync::Once::new();
    let progress = |done, all| {
        started.call_once(|| meter.start("measure", all));
        meter.add(done);
    };
    // The first signal ends the process, as before.
    let found = deviation_while(&a, &b, args.samples as usize, &progress, &|| true).unwrap_or_default();
    meter.finish();
    let mut out = stdout();
    if args.json {
        json::print(&meshes_json(args, second, [&a, &b], &found, origin, diagonal), &mut out)?;
    } else {
        print_meshes(args, second, [&a, &b], &found, origin, diagonal, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

/// Zero where singles hold all coordinates, else the first vertex: what is far from zero would lose its detail.
fn common_origin(a: &Points, b: &Points) -> [f64; 3] {
    let first = a.positions.first().copied().unwrap_or_default();
    if a.is_single() && b.is_single() { [0.0; 3] } else { first }
}

fn absolute(at: Option<[f64; 3]>, origin: [f64; 3]) -> Option<[f64; 3]> {
    at.map(|at| std::array::from_fn(|axis| at[axis] + origin[axis]))
}

fn percent(part: f64, whole: f64) -> String {
    if whole > 0.0 { format!("{:.4} %", 100.0 * part / whole) } else { "-".to_owned() }
}

fn print_meshes(
    args: &Args,
    second: &Path,
    meshes: [&TriMesh; 2],
    found: &Deviation,
    origin: [f64; 3],
    diagonal: f64,
    out: &mut impl Write,
) -> Result<()> {
    let [a, b] = [args.first.as_path(), second].map(|path| path.display().to_string());
    for (path, mesh) in [&a, &b].into_iter().zip(meshes) {
        writeln!(out, "{path}: {}", Counted(mesh.triangles.len() as u64, "triangle"))?;
    }
    writeln!(out, "diagonal of both: {} units\n", Units(diagonal))?;
    fn side(name: &str, side: &Side, diagonal: f64) -> Vec<String> {
        row(name, [side.max, side.mean, side.rms], side.samples, diagonal)
    }
    let both = [found.max(), found.mean(), found.rms()];
    let header = ["from", "max", "of diagonal", "mean", "of diagonal", "rms", "of diagonal", "samples"];
    let rows = [
        side("the first to the second", &found.forward, diagonal),
        side("the second to the first", &found.backward, diagonal),
        row("the larger of both", both, found.forward.samples + found.backward.samples, diagonal),
    ];
    writeln!(out, "{}", table(&header, rows))?;
    if let Some([x, y, z]) = absolute(found.at(), origin) {
        let on = if found.backward.max > found.forward.max { &b } else { &a };
        writeln!(out, "\nthe maximum is at {x} {y} {z}, on {on}")?;
    }
    Ok(())
}

fn row(name: &str, [max, mean, rms]: [f64; 3], samples: u64, diagonal: f64) -> Vec<String> {
    let mut cells = vec![name.to_owned()];
    for value in [max, mean, rms] {
        cells.extend([Units(value).to_string(), percent(value, diagonal)]);
    }
    cells.push(count(samples));
    cells
}

fn meshes_json(
    args: &Args,
    second: &Path,
    [a, b]: [&TriMesh; 2],
    found: &Deviation,
    origin: [f64; 3],
    diagonal: f64,
) -> judged::MeasureMeshes {
    fn mesh(path: &Path, mesh: &TriMesh) -> judged::Mesh {
        judged::Mesh { path: named(path), triangles: mesh.triangles.len() }
    }
    judged::MeasureMeshes {
        schema: "chpm-measure-meshes/1",
        first: mesh(&args.first, a),
        second: mesh(second, b),
        diagonal,
        samples_per_triangle: args.samples,
        forward: side_json(&found.forward, origin),
        backward: side_json(&found.backward, origin),
        max: found.max(),
        mean: found.mean(),
        rms: found.rms(),
        at: absolute(found.at(), origin),
    }
}

fn side_json(side: &Side, origin: [f64; 3]) -> judged::Side {
    judged::Side {
        max: side.max,
        at: absolute(side.at, origin),
        mean: side.mean,
        rms: side.rms,
        samples: side.samples,
    }
}

fn judge(file: &Chpm<MappedFile>, args: &Args, source: &Path, stop: &Stop) -> Result<Verdict> {
    let measures = Measures {
        levels: args.levels || args.cuts.is_none(),
        positions: args.positions,
        cuts: args.cuts.unwrap_or(0),
        seed: args.seed,
        samples: args.samples,
    };
    let scratch = args.storage.work_dir.clone().unwrap_or_else(std::env::temp_dir);
    let (memory, meter, cancel) = (args.storage.memory(), Meter::new(args.quiet), stop.heed());
    let measured = chpm_verify::measure(file, source, &measures, memory, &scratch, &meter, &cancel)?;
    let Measured { rows, compared, slack, .. } = &measured;

    let violations = measured.violations();
    let origin = file.header().origin;
    let diagonal = file.header().aabb().diagonal();
    let mut out = stdout();
    if args.json {
        let levels = rows.iter().filter_map(|(which, found)| match *which {
            Which::Level { level, collapsed } => {
                Some(judged::OfLevel { level, collapsed, found: to_json(found, origin) })
            }
            _ => None,
        });
        let cuts = rows.iter().filter_map(|(which, found)| match *which {
            Which::Cut { seed } => Some(judged::OfCut { seed, found: to_json(found, origin) }),
            _ => None,
        });
        let measure = judged::Measure {
            schema: "chpm-measure/2",
            file: named(&args.first),
            source: named(source),
            diagonal,
            samples_per_triangle: args.samples,
            slack: *slack,
            small_components_left_out: compared.small_components,
            small_component_triangles_left_out: compared.small_component_triangles,
            levels: levels.collect(),
            cuts: cuts.collect(),
            violations,
        };
        json::print(&measure, &mut out)?;
    } else {
        print_rows(args, rows, origin, diagonal, violations, &mut out)?;
        if compared.small_components > 0 {
            let (path, source) = (args.first.display(), source.display());
            writeln!(
                out,
                "{path}: measured against what it has of {source}, without {}",
                compared.small_components_message()
            )?;
        }
    }

    out.flush()?;
    Ok(if violations == 0 { Verdict::Good } else { Verdict::Faulty })
}

/// A level or cut, and what was found about it.
type Row = (Which, LevelDeviation);

fn to_json(found: &LevelDeviation, origin: [f64; 3]) -> judged::Measured {
    fn ratios(Spread { count, min, median, p95, max }: Spread) -> judged::Ratios {
        judged::Ratios { clusters: count, min, median, p95, max }
    }
    judged::Measured {
        clusters: found.clusters,
        triangles: found.triangles,
        stored_error: found.stored,
        stored_distance: found.distance,
        max: found.max(),
        mean: found.mean(),
        rms: found.rms(),
        of_source: side_json(&found.of_source, origin),
        of_mesh: side_json(&found.of_mesh, origin),
        stored_by_measured: found.ratio.map(ratios),
        vanished: judged::Vanished { samples: found.vanished.samples, max: found.vanished.max },
        violations: judged::Violations {
            clusters: found.violating,
            samples: found.violations.samples,
            worst: found.violations.worst.map(|(distance, _)| distance),
            at: absolute(found.violations.worst.map(|(_, at)| at), origin),
        },
    }
}

fn cells((which, found): &Row, diagonal: f64) -> Vec<String> {
    let mut cells = vec![
        which.to_string(),
        count(found.clusters),
        count(found.triangles),
        Units(found.stored.into()).to_string(),
        Units(found.distance.into()).to_string(),
        Units(found.max()).to_string(),
        percent(found.max(), diagonal),
        Units(found.mean()).to_string(),
        Units(found.rms()).to_string(),
    ];
    match found.ratio {
        Some(s) => cells.extend([s.min, s.median, s.p95, s.max].map(|r| format!("{r:.2}"))),
        None => cells.extend(["-"; 4].map(str::to_owned)),
    }
    let faults = [found.violating, found.violations.samples, found.vanished.samples];
    cells.extend(faults.map(count));
    cells
}

fn print_rows(
    args: &Args,
    rows: &[Row],
    origin: [f64; 3],
    diagonal: f64,
    violations: u64,
    out: &mut impl Write,
) -> Result<()> {
    let header = [
        "",
        "clusters",
        "triangles",
        "error",
        "distance",
        "max",
        "of diagonal",
        "mean",
        "rms",
        "least",
        "median",
        "p95",
        "most",
        "violating",
        "samples",
        "vanished",
    ];
    writeln!(out, "{}\n", table(&header, rows.iter().map(|row| cells(row, diagonal))))?;
    writeln!(
        out,
        "error and distance: as stored; max: as measured; least to most: stored distance by measured one, over clusters; \
         diagonal {} units",
        Units(diagonal)
    )?;
    let vanished = rows.iter().map(|(_, found)| found.vanished).max_by(|a, b| a.max.total_cmp(&b.max));
    if let Some(vanished) = vanished.filter(|v| v.samples > 0) {
        writeln!(
            out,
            "vanished: samples that are farther than the error, and within the distance; the farthest: {}",
            Units(vanished.max)
        )?;
    }
    let path = args.first.display();
    for (which, found) in rows {
        if let Some((distance, at)) = found.violations.worst {
            let [x, y, z] = absolute(Some(at), origin).unwrap_or(at);
            let clusters = Counted(found.violating, "cluster");
            let samples = Counted(found.violations.samples, "sample");
            writeln!(
                out,
                "{path}: I5 error: {}: beyond the stored distance are {samples} of {clusters}; the worst, \
                 at {x} {y} {z}, by a distance of {} units",
                which,
                Units(distance)
            )?;
        }
    }
    if violations == 0 {
        writeln!(out, "{path}: every stored distance holds, in all samples")?;
    }
    Ok(())
}
