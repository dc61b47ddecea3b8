//! `chpm stage`: a build in steps, each a command; `chpm work`: processes that share them.

use super::{Verdict, stdout};
use crate::args::{MemorySize, SettingsArgs, StorageArgs, build_memory};
use crate::cli::{Cli, Command};
use crate::config::{self, ConfigArgs};
use crate::number;
use crate::output;
use crate::progress::{Meter, line};
use crate::stop::Stop;
use crate::tile_list::SourceArgs;
use crate::workflow::{Engine, Workflow};
use anyhow::{Context, Result, bail};
use chpm_build::stage::{self, Condition, Division, MOST_PARTS, Share, Step, StepReport};
use chpm_build::{FailPoints, Resources};
use chpm_mesh::Bytes;
use clap::Parser;
use std::ffi::OsString;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm stage`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(subcommand)]
    step: StepArgs,
}

/// Steps, in their order. Each leaves a file in the folder of the plan.
#[derive(clap::Subcommand, Debug)]
enum StepArgs {
    /// Read a mesh, and divide its vertices into regions
    Plan(Box<PlanArgs>),
    /// Send some triangles to their regions
    Scatter(PartArgs),
    /// Number the vertices that several regions have
    Borders(CommonArgs),
    /// Cut some regions into leaves
    Regions(PartArgs),
    /// Put a tree over all leaves
    Hierarchy(CommonArgs),
    /// Form the groups of a level
    Group(GroupArgs),
    /// Simplify some groups of a level, or all levels that are left
    Simplify(SimplifyArgs),
    /// Find the order of pages
    Layout(CommonArgs),
    /// Make some pages as the file has them
    Emit(PartArgs),
    /// Write the file
    Finish(FinishArgs),
    /// Look at what all steps have left, to the last byte
    Check(CheckArgs),
    /// Print a workflow of all steps for an engine
    Workflow(WorkflowArgs),
}

#[derive(clap::Args, Debug)]
struct CheckArgs {
    /// The folder of the plan
    folder: PathBuf,
    /// Delete what is damaged, or made of something else, so that it is made again
    #[arg(long)]
    remove: bool,
}

#[derive(clap::Args, Debug)]
struct WorkflowArgs {
    #[command(flatten)]
    sources: SourceArgs,
    /// The file to build; the folder of the steps lies beside it, as scan.stages for scan.chpm
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Parts that triangles, regions, levels and pages are divided into
    #[arg(long, value_name = "N", value_parser = number::count(1_u32..=MOST_PARTS))]
    parts: u32,
    /// Levels that are simplified in parts; as many as suit the length of the mesh if not given
    #[arg(long, value_name = "N", value_parser = number::count(0_u32..=31))]
    levels: Option<u32>,
    /// The engine
    #[arg(long = "for", value_name = "ENGINE", value_enum, default_value_t = Engine::Snakemake)]
    engine: Engine,
    /// Threads of each command
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = number::count(1_u32..=1024))]
    threads: u32,
    /// Memory that each command stays below
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    memory: MemorySize,
    /// Settings of the build, as `chpm stage plan` takes them
    #[arg(last = true, value_name = "SETTINGS")]
    settings: Vec<String>,
}

#[derive(clap::Args, Debug)]
struct PlanArgs {
    #[command(flatten)]
    sources: SourceArgs,
    /// The folder for all that steps leave, which all machines see
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Parts that triangles, regions, levels and pages are divided into
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = number::count(1_u32..=MOST_PARTS))]
    parts: u32,
    /// Levels that are simplified in parts; those of many clusters if not given
    #[arg(long, value_name = "N", value_parser = number::count(0_u32..=31))]
    levels: Option<u32>,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    #[command(flatten)]
    resources: ResourceArgs,
}

#[derive(clap::Args, Debug)]
struct CommonArgs {
    /// The folder of the plan
    folder: PathBuf,
    #[command(flatten)]
    resources: ResourceArgs,
}

#[derive(clap::Args, Debug)]
struct PartArgs {
    /// Which part, as in 2/4
    #[arg(long, value_name = "I/N")]
    part: Share,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(clap::Args, Debug)]
struct GroupArgs {
    /// Which level; 0 is that of the leaves
    #[arg(long, value_name = "LEVEL")]
    level: u32,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(clap::Args, Debug)]
struct SimplifyArgs {
    /// Which level; 0 is that of the leaves
    #[arg(long, value_name = "LEVEL", requires = "part", required_unless_present = "from_level")]
    level: Option<u32>,
    /// Which part, as in 2/4
    #[arg(long, value_name = "I/N", requires = "level")]
    part: Option<Share>,
    /// All levels from this one on, which is the first that the plan has no parts for
    #[arg(long, value_name = "LEVEL", conflicts_with = "level")]
    from_level: Option<u32>,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(clap::Args, Debug)]
struct FinishArgs {
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(clap::Args, Debug)]
struct OutputArgs {
    /// The file to build; that of the folder's name if not given, as in scan.chpm for scan.stages
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
}

/// Arguments of `chpm work`.
#[derive(clap::Args, Debug)]
pub(crate) struct WorkArgs {
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    common: CommonArgs,
}

/// Resources; none of them shows in what a step leaves.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "Resources (none of them shows in what a step leaves)")]
struct ResourceArgs {
    /// Worker threads; one per processor if not given
    #[arg(long, value_name = "N", value_parser = number::count(1_u32..=1024))]
    threads: Option<u32>,
    #[command(flatten)]
    storage: StorageArgs,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    /// End without warning at the access to a file of this number: for tests of what is left then
    #[arg(long, value_name = "N", hide = true)]
    kill_at: Option<u64>,
}

impl ResourceArgs {
    fn resources(&self) -> Result<Resources> {
        let memory = build_memory(self.storage.memory())?;
        Ok(Resources {
            threads: self.threads.unwrap_or(0) as usize,
            memory,
            work_dir: self.storage.work_dir.clone(),
            checkpoint: None,
            fail_points: self.kill_at.map_or_else(FailPoints::default, FailPoints::kill_at),
            ..Resources::default()
        })
    }
}

impl OutputArgs {
    /// The model, if it is named, and whether it may be replaced.
    fn of(&self, folder: &Path) -> Result<(PathBuf, bool)> {
        let output = self.output.clone().unwrap_or_else(|| stage::output_of(folder));
        output::BUILD.check(&output)?;
        Ok((output, self.force))
    }
}

/// Does one step.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let (step, common) = match &args.step {
        StepArgs::Plan(args) => return plan(args, stop),
        StepArgs::Workflow(args) => return workflow(args),
        StepArgs::Check(args) => return check(args, stop),
        StepArgs::Scatter(args) => (Step::Scatter(args.part), &args.common),
        StepArgs::Borders(common) => (Step::Borders, common),
        StepArgs::Regions(args) => (Step::Regions(args.part), &args.common),
        StepArgs::Hierarchy(common) => (Step::Hierarchy, common),
        StepArgs::Group(args) => (Step::Group(args.level), &args.common),
        StepArgs::Simplify(args) => {
            let one = args.level.zip(args.part).map(|(level, part)| Step::Simplify(level, part));
            (one.unwrap_or(Step::Top(args.from_level.unwrap_or(0))), &args.common)
        }
        StepArgs::Layout(common) => (Step::Layout, common),
        StepArgs::Emit(args) => (Step::Emit(args.part), &args.common),
        StepArgs::Finish(args) => {
            let output = args.output.of(&args.common.folder)?;
            return one(Step::Finish, &args.common, Some((&output.0, output.1)), stop);
        }
    };
    one(step, common, None, stop)
}

impl PlanArgs {
    /// These, with the settings of a preset and a `chpm.toml` as `build` has them; `words` are what was typed.
    fn completed(&self, words: &[OsString]) -> Result<Option<Box<PlanArgs>>> {
        let source = Some(self.sources.first()).filter(|source| *source != Path::new("-"));
        let layers = config::layers(&self.config, source)?;
        if layers.is_empty() {
            return Ok(None);
        }
        if !self.resources.quiet {
            line(&format!("settings from {}", config::origins(&layers)));
        }
        let (words, _) = config::merged(words, &layers)?;
        planned(&words).map(Some)
    }
}

/// The arguments that a command line has for `stage plan`.
fn planned(words: &[OsString]) -> Result<Box<PlanArgs>> {
    if let Command::Stage(args) = Cli::try_parse_from(words).map_err(config::flat)?.command
        && let StepArgs::Plan(plan) = args.step
    {
        return Ok(plan);
    }
    bail!("the settings: not understood")
}

fn plan(args: &PlanArgs, stop: &Stop) -> Result<Verdict> {
    let completed = args.completed(&std::env::args_os().collect::<Vec<_>>())?;
    let args = completed.as_deref().unwrap_or(args);
    output::check_folder("stage plan", &args.output)?;
    let division = Division { parts: args.parts, levels: args.levels };
    let source = args.sources.source(&args.output, false)?;
    let report = stage::plan(
        super::source(&source),
        &args.output,
        &args.settings.settings()?,
        division,
        &args.resources.resources()?,
        &Meter::new(args.resources.quiet),
        &stop.heed(),
    );
    tell(&report.map_err(|error| super::build::of(&source, error))?)
}

fn check(args: &CheckArgs, stop: &Stop) -> Result<Verdict> {
    let (mut out, mut verdict, mut missing) = (stdout(), Verdict::Good, 0);
    let found = stage::check(&args.folder, &stop.heed())?;
    for (step, path, condition) in &found {
        match condition {
            Condition::Whole => {}
            Condition::Missing => missing += 1,
            // Without a plan nothing else is of use, and it takes the source to make it again.
            Condition::Wrong(reason) if args.remove && *step != Step::Plan => {
                fs::remove_file(path).with_context(|| format!("cannot delete '{}'", path.display()))?;
                writeln!(out, "deleted: {reason}")?;
                missing += 1;
            }
            Condition::Wrong(reason) => {
                writeln!(out, "{reason}")?;
                verdict = Verdict::Faulty;
            }
        }
    }
    writeln!(out, "{} of {} steps are to be done", missing, found.len())?;
    out.flush()?;
    Ok(verdict)
}

/// Bytes of a binary mesh for each triangle, by which those of a source are guessed.
const BYTES_PER_TRIANGLE: u64 = 19;

fn workflow(args: &WorkflowArgs) -> Result<Verdict> {
    let WorkflowArgs { sources, output, parts, levels, threads, memory, settings, .. } = args;
    output::BUILD.check(output)?;
    if sources.all().iter().any(|source| source == Path::new("-")) {
        bail!(
            "each command of a workflow reads the source, so that it must be a file and not standard input"
        );
    }
    // Settings that nobody would understand are refused now.
    let folder = output.with_extension("stages");
    let mut words: Vec<OsString> = ["chpm", "stage", "plan", "--quiet", "-o"].map(OsString::from).to_vec();
    words.push(folder.clone().into());
    words.extend(settings.iter().map(OsString::from));
    words.push("--".into());
    words.extend(sources.all().iter().map(OsString::from));
    let plan = planned(&words)?;
    let completed = plan.completed(&words)?;
    let own = completed.as_deref().unwrap_or(&plan).settings.settings()?;
    let lens = sources.all().iter().map(|source| {
        Ok(source.metadata().with_context(|| format!("cannot read '{}'", source.display()))?.len())
    });
    let len: u64 = lens.sum::<Result<u64>>()?;
    let triangles = len / BYTES_PER_TRIANGLE;
    let leaves = (triangles / u64::from(own.cluster_triangles.max(1))).min(u64::from(u32::MAX)) as u32;
    let workflow = Workflow {
        sources: sources.all().to_vec(),
        weld: sources.weld()?,
        folder,
        output: output.clone(),
        parts: *parts,
        levels: Division { parts: *parts, levels: *levels }.levels_of(leaves),
        threads: *threads,
        memory: memory.0,
        settings: settings.clone(),
        triangles,
    };
    let mut out = stdout();
    write!(out, "{}", workflow.text(args.engine)?)?;
    out.flush()?;
    Ok(Verdict::Good)
}

fn one(step: Step, common: &CommonArgs, output: Option<(&Path, bool)>, stop: &Stop) -> Result<Verdict> {
    let (resources, meter) = (common.resources.resources()?, Meter::new(common.resources.quiet));
    let report = stage::run(step, &common.folder, output, &resources, &meter, &stop.heed())?;
    tell(&report)
}

/// Does whatever nobody else does.
pub(crate) fn work(args: &WorkArgs, stop: &Stop) -> Result<Verdict> {
    let (folder, ResourceArgs { quiet, .. }) = (&args.common.folder, &args.common.resources);
    let output = args.output.of(folder)?;
    let mut failed = None;
    stage::work(
        folder,
        Some((&output.0, output.1)),
        &args.common.resources.resources()?,
        &Meter::new(*quiet),
        &stop.heed(),
        |report| {
            failed = failed.take().or(tell(report).err());
            Ok(())
        },
    )?;
    failed.map_or(Ok(Verdict::Good), Err)
}

/// Prints what a step did.
fn tell(report: &StepReport) -> Result<Verdict> {
    let StepReport { path, len, seconds, processor_seconds, peak_resident, was_there, notes, .. } = report;
    let mut out = stdout();
    if *was_there {
        writeln!(out, "{}: there already, {}", path.display(), Bytes(*len))?;
    } else {
        let used = processor_seconds.map_or(String::new(), |used| format!(", {used:.2} s of processors"));
        let memory = peak_resident.map_or(String::new(), |bytes| format!(", {} of memory", Bytes(bytes)));
        writeln!(out, "{}: {} in {seconds:.2} s{used}{memory}", path.display(), Bytes(*len))?;
    }
    notes.iter().try_for_each(|note| writeln!(out, "{note}"))?;
    out.flush()?;
    Ok(Verdict::Good)
}
