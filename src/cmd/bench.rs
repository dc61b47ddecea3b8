//! `chpm bench`: speed against error, this project and others on one source, each in a process of its own.

mod scaling;

use super::{Verdict, stdout, temporary};
use crate::args::MemorySize;
use crate::bench::{
    Contender, DIVISORS, Figure, Point, REFERENCE_DIVISORS, contend, equal_deviation, median, svg,
};
use crate::json::{self, made, named};
use crate::number::{self, Units};
use crate::output::{self, Output, Writes};
use crate::progress::Meter;
use crate::report::{count, table};
use crate::stop::{self, Stop};
use anyhow::{Context, Result, bail, ensure};
use chpm_build::Cancel;
use chpm_extmem::process::peak_resident;
use chpm_measure::deviation_while;
use chpm_mesh::{Aabb, Bytes, Counted, TriMesh};
use std::fmt::Write as _;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output as Ended, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Arguments of `chpm bench`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The mesh ({meshes}); it is read into memory to be measured against
    source: PathBuf,
    /// Timed runs of each contender, in turn; medians are told
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = number::count(1_u32..=1000))]
    runs: u32,
    /// Who competes; all who can if not given
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_enum)]
    only: Vec<Contender>,
    /// Build with each of these numbers of threads instead, in turn, and tell how speed and stages scale
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = number::count(1_u32..=1024))]
    #[arg(conflicts_with_all = ["only", "samples", "csv", "svg"])]
    threads: Vec<u32>,
    /// Samples on each triangle of the source, and of each mesh
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = number::count(1_u32..=1_000_000))]
    samples: u32,
    /// Write the figures as CSV, a row for each contender and fraction; - for standard output
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write a plot of speed against error; - for standard output
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Replace files that exist
    #[arg(short, long)]
    force: bool,
    /// Memory that each build of this project stays below; all else is in core
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    memory: MemorySize,
    /// The figures as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
}

/// Arguments of a contender's process.
#[derive(clap::Args, Debug)]
pub(crate) struct ContendArgs {
    #[arg(value_enum)]
    contender: Contender,
    source: PathBuf,
    output: PathBuf,
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    memory: MemorySize,
    /// Write meshes of at most so many triangles, from what a run has left, instead of running
    #[arg(long, value_delimiter = ',')]
    meshes: Vec<u64>,
}

/// Does a contender's work and prints the most memory that the process had, bytes.
pub(crate) fn contend(args: &ContendArgs, stop: &Stop) -> Result<Verdict> {
    if args.meshes.is_empty() {
        contend::run(args.contender, &args.source, &args.output, args.memory.0, &stop.heed())?;
    } else {
        contend::meshes(args.contender, &args.source, &args.output, &args.meshes)?;
    }
    let mut out = stdout();
    writeln!(out, "{}", peak_resident().unwrap_or_default())?;
    out.flush()?;
    Ok(Verdict::Good)
}

/// Runs all and prints the figures.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    if !args.threads.is_empty() {
        return scaling::run(args, stop);
    }

    let create = |path: &Option<PathBuf>, writes: Writes| -> Result<Option<Output>> {
        path.as_ref().map(|path| writes.create(path, args.force, &[&args.source])).transpose()
    };
    let csv = create(&args.csv, output::BENCH_CSV)?;
    let plot = create(&args.svg, output::BENCH_SVG)?;
    let mut out = output::messages(csv.iter().chain(&plot), args.json, args.quiet)?;
    let mesh = contend::read(&args.source)?;
    let triangles = mesh.triangles.len() as u64;
    let coarsest = DIVISORS[DIVISORS.len() - 1];
    ensure!(triangles >= coarsest, "'{}' has fewer than {coarsest} triangles", args.source.display());

    let cancel = stop.heed();
    let folder = temporary()?;
    let (mut contenders, mut declined) = (Vec::new(), Vec::new());
    for contender in Contender::ALL.into_iter().filter(|c| args.only.is_empty() || args.only.contains(c)) {
        match contender.declines(mesh.positions.len(), mesh.triangles.len()) {
            None => contenders.push(contender),
            Some(why) => declined.push((contender, why)),
        }
    }
    ensure!(!contenders.is_empty(), "none of those who were asked for competes on this mesh");
    let bench = Bench { args, mesh, folder: folder.path(), cancel };
    let times = bench.time(&contenders)?;
    let reference = [Contender::Kernel, Contender::Plain, Contender::MeshoptSimplify]
        .into_iter()
        .find(|c| contenders.contains(c));
    let figures = bench.measure(&contenders, &times, reference)?;
    let result = Outcome { declined, reference, figures, diagonal: bench.diagonal(), triangles };

    if let Some(mut csv) = csv {
        csv.write_all(result.csv(args).as_bytes())?;
        csv.publish()?;
    }
    if let Some(mut plot) = plot {
        let name = args.source.file_stem().unwrap_or_default().to_string_lossy();
        let title = format!("Speed against error: {name}, {} triangles", count(triangles));
        plot.write_all(svg(&result.figures, result.diagonal, &title, &machine())?.as_bytes())?;
        plot.publish()?;
    }

    if args.json {
        json::print(&result.json(args), &mut out)?;
    } else {
        result.print(args, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

/// How often a process that runs is looked at, and the request to stop.
const LOOK: Duration = Duration::from_millis(1);

/// Runs a process whose temporary files lie in `folder`, or ends it when a stop is asked for: code of others cannot be asked to.
fn output_of(mut command: Command, folder: &Path, cancel: &Cancel) -> Result<Ended> {
    let [out, err] = ["stdout", "stderr"].map(|name| folder.join(name));
    // A folder of its own goes with ours, whatever is left in it.
    for name in ["TMPDIR", "TMP", "TEMP"] {
        command.env(name, folder);
    }
    let mut child = command
        .stdin(Stdio::null())
        .stdout(fs::File::create(&out)?)
        .stderr(fs::File::create(&err)?)
        .spawn()
        .context("cannot start this program again")?;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if cancel.is_cancelled() {
            child.kill()?;
            break child.wait()?;
        }
        thread::sleep(LOOK);
    };
    stop::check(cancel)?;
    Ok(Ended { status, stdout: fs::read(out)?, stderr: fs::read(err)? })
}

struct Bench<'a> {
    args: &'a Args,
    mesh: TriMesh,
    folder: &'a Path,
    cancel: Cancel,
}

/// Seconds and peak bytes of every run of a contender.
type Times = Vec<(f64, u64)>;

impl Bench<'_> {
    fn output(&self, contender: Contender) -> PathBuf {
        self.folder.join(format!("{}.out", contender.name()))
    }

    /// All contenders in turn, so that what else the machine does falls on all. The source has just been read, so that it is in
    /// the page cache.
    fn time(&self, contenders: &[Contender]) -> Result<Vec<Times>> {
        let meter = Meter::new(self.args.quiet);
        meter.start("run", u64::from(self.args.runs) * contenders.len() as u64);
        let mut times = vec![Vec::new(); contenders.len()];
        for _ in 0..self.args.runs {
            for (contender, times) in contenders.iter().zip(&mut times) {
                stop::check(&self.cancel)?;
                let start = Instant::now();
                let peak = self.child(*contender, &[])?;
                times.push((start.elapsed().as_secs_f64(), peak));
                meter.add(1);
            }
        }
        meter.finish();
        Ok(times)
    }

    /// Runs a contender in a process of this same program; answers its peak resident bytes.
    fn child(&self, contender: Contender, meshes: &[u64]) -> Result<u64> {
        let program = std::env::current_exe().context("cannot find this program")?;
        let mut command = Command::new(program);
        command.args(["contend", contender.name()]).arg(&self.args.source).arg(self.output(contender));
        command.args(["--memory", &self.args.memory.to_string()]);
        if !meshes.is_empty() {
            let list: Vec<String> = meshes.iter().map(u64::to_string).collect();
            command.arg("--meshes").arg(list.join(","));
        }
        let output = output_of(command, self.folder, &self.cancel)?;
        if !output.status.success() {
            bail!("{} failed: {}", contender.name(), String::from_utf8_lossy(&output.stderr).trim());
        }
        let text = String::from_utf8_lossy(&output.stdout);
        text.trim().parse().with_context(|| format!("{} answered '{text}'", contender.name()))
    }

    fn measure(
        &self,
        contenders: &[Contender],
        times: &[Times],
        reference: Option<Contender>,
    ) -> Result<Vec<Figure>> {
        let meter = Meter::new(self.args.quiet);
        meter.start("measure", contenders.iter().map(|c| divisors(*c, &reference).len() as u64).sum());
        let mut figures = Vec::new();
        for (contender, times) in contenders.iter().zip(times) {
            let (seconds, peaks): (Vec<f64>, Vec<u64>) = times.iter().copied().unzip();
            let output = self.output(*contender);
            let len = fs::metadata(&output)?.len();
            let limits: Vec<u64> = divisors(*contender, &reference)
                .iter()
                .map(|d| (self.mesh.triangles.len() as u64 / d).max(1))
                .collect();
            self.child(*contender, &limits)?;
            let mut points = Vec::new();
            for (divisor, limit) in divisors(*contender, &reference).into_iter().zip(&limits) {
                stop::check(&self.cancel)?;
                let path = contend::mesh_path(&output, *limit);
                let lod = contend::read(&path)?;
                fs::remove_file(&path)?;
                let go_on = || !self.cancel.is_cancelled();
                let found = deviation_while(&self.mesh, &lod, self.args.samples as usize, &|_, _| {}, &go_on);
                let Some(found) = found else { bail!(stop::TOLD) };
                let triangles = lod.triangles.len() as u64;
                points.push(Point { divisor, triangles, rms: found.rms(), max: found.max() });
                meter.add(1);
            }
            fs::remove_file(&output)?;
            let seconds = median(&seconds).unwrap_or(0.0);
            figures.push(Figure {
                contender: *contender,
                seconds,
                rate: self.mesh.triangles.len() as f64 / seconds,
                peak: median(&peaks).unwrap_or(0),
                output: len,
                points,
            });
        }
        meter.finish();
        Ok(figures)
    }

    fn diagonal(&self) -> f64 {
        Aabb::of_points(&self.mesh.positions).diagonal()
    }
}

fn divisors(contender: Contender, reference: &Option<Contender>) -> Vec<u64> {
    let more: &[u64] = if Some(contender) == *reference { &REFERENCE_DIVISORS } else { &[] };
    let mut divisors = [&DIVISORS, more].concat();
    divisors.sort_unstable();
    divisors
}

struct Outcome {
    declined: Vec<(Contender, &'static str)>,
    /// Whom the others are compared with at equal deviation.
    reference: Option<Contender>,
    figures: Vec<Figure>,
    diagonal: f64,
    triangles: u64,
}

impl Outcome {
    fn print(&self, args: &Args, out: &mut impl Write) -> Result<()> {
        writeln!(
            out,
            "{}: {}, diagonal {} units",
            args.source.display(),
            Counted(self.triangles, "triangle"),
            Units(self.diagonal)
        )?;
        writeln!(
            out,
            "{}; median of {}, {} a triangle\n",
            machine(),
            Counted(args.runs.into(), "run"),
            Counted(args.samples.into(), "sample")
        )?;
        let header = ["", "seconds", "triangles/s", "peak memory", "output"];
        let rows = self.figures.iter().map(|f| {
            vec![
                f.contender.name().to_owned(),
                format!("{:.3}", f.seconds),
                count(f.rate as u64),
                Bytes(f.peak).to_string(),
                Bytes(f.output).to_string(),
            ]
        });
        writeln!(out, "{}\n", table(&header, rows))?;
        for (name, value) in [("rms", (|p: &Point| p.rms) as fn(&Point) -> f64), ("max", |p| p.max)] {
            let mut header = vec![format!("{name}, % of diagonal")];

            for divisor in DIVISORS {
                header.extend([format!("1/{divisor}"), "triangles".to_owned()]);
            }
            let header: Vec<&str> = header.iter().map(String::as_str).collect();
            let rows = self.figures.iter().map(|f| {
                let mut row = vec![f.contender.name().to_owned()];
                for p in f.points.iter().filter(|p| DIVISORS.contains(&p.divisor)) {
                    row.extend([format!("{:.4}", 100.0 * value(p) / self.diagonal), count(p.triangles)]);
                }
                row
            });
            writeln!(out, "{}\n", table(&header, rows))?;
        }
        self.print_ratios(out)?;
        writeln!(out, "settings:")?;

        for figure in &self.figures {
            writeln!(out, "  {:<17} {}", figure.contender.name(), figure.contender.settings())?;
        }
        for (contender, why) in &self.declined {
            writeln!(out, "  {:<17} does not compete: {why}", contender.name())?;
        }
        Ok(())
    }

    /// Triangles by those of the reference at the same measured rms.
    fn ratio(&self, point: &Point) -> Option<f64> {
        let reference = self.figures.iter().find(|f| Some(f.contender) == self.reference)?;
        equal_deviation(&reference.points, point.rms).map(|n| point.triangles as f64 / n)
    }

    fn print_ratios(&self, out: &mut impl Write) -> Result<()> {
        let Some(reference) = self.reference else { return Ok(()) };
        let title = format!("triangles by {}'s at equal rms", reference.name());
        let mut header = vec![title];
        header.extend(DIVISORS.map(|d| format!("1/{d}")));
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        let others = self.figures.iter().filter(|f| f.contender != reference);
        let rows = others.map(|f| {
            let mut row = vec![f.contender.name().to_owned()];
            for p in f.points.iter().filter(|p| DIVISORS.contains(&p.divisor)) {
                row.push(self.ratio(p).map_or("-".to_owned(), |r| format!("{r:.3}")));
            }
            row
        });
        Ok(writeln!(out, "{}\n", table(&header, rows))?)
    }

    fn contender_json(&self, f: &Figure) -> made::Contender {
        let meshes = f.points.iter().map(|p| made::BenchMesh {
            divisor: p.divisor,
            triangles: p.triangles,
            rms: p.rms,
            max: p.max,
            triangles_by_reference: self.ratio(p),
        });
        made::Contender {
            name: f.contender.name(),
            settings: f.contender.settings(),
            seconds: f.seconds,
            triangles_per_second: f.rate,
            peak_resident_bytes: f.peak,
            output_bytes: f.output,
            meshes: meshes.collect(),
        }
    }

    fn json(&self, args: &Args) -> made::Bench {
        let declined = self.declined.iter().map(|(contender, why)| format!("{}: {why}", contender.name()));
        made::Bench {
            schema: "chpm-bench/1",
            source: named(&args.source),
            triangles: self.triangles,
            diagonal: self.diagonal,
            machine: machine(),
            runs: args.runs,
            samples_per_triangle: args.samples,
            reference: self.reference.map(Contender::name),
            contenders: self.figures.iter().map(|figure| self.contender_json(figure)).collect(),
            declined: declined.collect(),
        }
    }

    fn csv(&self, args: &Args) -> String {
        let mut text = String::from(
            "model,source_triangles,contender,wall_s,tri_per_s,peak_rss_mb,output_bytes,divisor,triangles,rms,max,\
             rms_percent,max_percent,triangles_by_reference\n",
        );
        let model = args.source.file_stem().unwrap_or_default().to_string_lossy().replace(',', "_");
        for f in &self.figures {
            for p in &f.points {
                let ratio = self.ratio(p).map_or(String::new(), |r| format!("{r:.4}"));
                fn percent(value: f64, diagonal: f64) -> f64 {
                    100.0 * value / diagonal
                }
                // Writing to a string does not fail.
                let _ = writeln!(
                    text,
                    "{model},{},{},{:.4},{:.0},{:.1},{},{},{},{:.6e},{:.6e},{:.6},{:.6},{ratio}",
                    self.triangles,
                    f.contender.name(),
                    f.seconds,
                    f.rate,
                    f.peak as f64 / f64::from(1 << 20),
                    f.output,
                    p.divisor,
                    p.triangles,
                    p.rms,
                    p.max,
                    percent(p.rms, self.diagonal),
                    percent(p.max, self.diagonal),
                );
            }
        }
        text
    }
}

/// Processors that this process may use, and their model where the system tells it.
fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": ").map(|m| m.1));
    format!("{cores} processors, {}", model.unwrap_or("of an unknown model"))
}

// Windows has no program that sleeps.
#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_stop_ends_a_process_that_would_not_end() {
        let folder = temporary().expect("a folder");
        let mut endless = Command::new("sleep");
        endless.arg("100000");
        let cancel = Cancel::default();
        cancel.cancel();
        let error = output_of(endless, folder.path(), &cancel).expect_err("a stop");
        assert_eq!(error.to_string(), stop::TOLD);
    }
}
