//! `chpm build`: from a PLY to a file, and the tables at the end.

use super::{Verdict, open, stdout, word};
use crate::args::{ResourceArgs, SettingsArgs, build_config};
use crate::cli::{Cli, Command};
use crate::config::{self, ConfigArgs};
use crate::json;
use crate::number::Short;
use crate::output;
use crate::progress::{Meter, line};
use crate::report::{self, LevelRow, count, per_triangle};
use crate::shown::ShownArgs;
use crate::stop::Stop;
use crate::tile_list::SourceArgs;
use anyhow::{Error, Result, bail, ensure};
use chpm_build::{BuildConfig, BuildError, BuildReport, Trace};
use chpm_extmem::platform::{self, Kind};
use chpm_extmem::same_file;
use chpm_mesh::{Bytes, Counted};
use clap::Parser;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Arguments of `chpm build`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    sources: SourceArgs,
    /// The file to build; SOURCE.chpm if not given
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    /// Also print stages, levels and refused collapses
    #[arg(short, long)]
    verbose: bool,
    /// The report as JSON on stdout
    #[arg(long)]
    json: bool,
    /// Write which thread did what when, as JSON for Perfetto
    ///
    /// Stages and tasks in Chrome's trace event format.
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    trace: Option<PathBuf>,
    /// Keep what becomes of each part beside the output, in OUTPUT.memo, for --update
    ///
    /// Parts of the model are then cubes, each built by what lies in it and near it. Such a build is not gone on with if it is stopped.
    #[arg(long, hide_short_help = true, conflicts_with = "keep_work")]
    updatable: bool,
    /// Take over from this model what has not changed
    ///
    /// It was built with --updatable, or updated, by this version from an earlier state of the source. The result is what --updatable makes of the source.
    #[arg(long, value_name = "OLD.chpm", hide_short_help = true, conflicts_with = "keep_work")]
    update: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    #[command(flatten)]
    resources: ResourceArgs,
    #[command(flatten)]
    shown: ShownArgs,
}

/// Builds, with the settings of a file and a preset where there are any.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let source = Some(args.sources.first()).filter(|source| *source != Path::new("-"));
    let layers = config::layers(&args.config, source)?;
    if layers.is_empty() {
        return run_with(args, stop);
    }
    if !args.quiet {
        line(&format!("settings from {}", config::origins(&layers)));
    }
    let words: Vec<_> = std::env::args_os().collect();
    let (words, _) = config::merged(&words, &layers)?;
    match Cli::try_parse_from(words).map_err(config::flat)?.command {
        Command::Build(args) => run_with(&args, stop),
        _ => bail!("settings from a file: not understood"),
    }
}

/// Builds, and reports on stdout.
fn run_with(args: &Args, stop: &Stop) -> Result<Verdict> {
    let mut config = build_config(&args.settings, &args.resources, args.force)?;
    config.settings.shown = args.shown.settings();
    if args.updatable || args.update.is_some() {
        config.make_updatable(args.update.clone());
    }
    let first = super::source(args.sources.first());
    let is_pipe = platform::kind_at(first).is_ok_and(|kind| kind == Kind::Pipe);
    let is_file = !is_pipe && first == args.sources.first();
    ensure!(
        args.output.is_some() || args.sources.only().is_some(),
        "several sources give the output no name; name it with -o"
    );
    ensure!(
        args.output.is_some() || is_file,
        "'{}' gives the output no name; name it with -o",
        args.sources.first().display()
    );

    let output = args.output.clone().unwrap_or_else(|| first.with_extension("chpm"));
    if args.sources.only().is_none() {
        // Before there is a list.
        output::BUILD.check(&output)?;
    }
    let given = args.sources.source(&output, args.force)?;
    let source = super::source(&given);
    let trace = args.trace.as_ref().map(|path| output::BUILD_TRACE.create(path, args.force, &[source]));
    let trace = trace.transpose()?;
    if trace.is_some() {
        config.resources.trace = Trace::recording();
    }
    let report = build(source, &output, &config, &Meter::new(args.quiet), stop);
    let report =
        report.map_err(|error| if args.output.is_none() { unwritable(error, &output) } else { error })?;
    output::finish(&output);
    if let Some(mut file) = trace {
        config.resources.trace.write(&mut file)?;
        file.publish()?;
    }

    let mut out = stdout();
    if args.json {
        json::print(&report::build_json(&report, json::named(&given), json::named(&output)), &mut out)?;
    } else {
        print(&report, &output, args.verbose, &mut out)?;
        print_next((!is_pipe).then_some(source), &output, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

/// Where the source's folder takes no file, another one may.
fn unwritable(error: anyhow::Error, output: &Path) -> anyhow::Error {
    let refused = error.chain().filter_map(|cause| cause.downcast_ref::<io::Error>()).any(|error| {
        matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem)
    });
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match refused && tempfile::tempfile_in(folder).is_err() {
        true => {
            error.context(format!("'{}' cannot be written; name another place with -o", folder.display()))
        }
        false => error,
    }
}

/// Builds, unless the output's name is that of something else.
pub(crate) fn build(
    source: &Path,
    output: &Path,
    config: &BuildConfig,
    meter: &Meter,
    stop: &Stop,
) -> Result<BuildReport> {
    ensure!(!same_file(source, output), BuildError::OutputIsSource { path: output.to_owned() });
    output::BUILD.check(output)?;
    let report = chpm_build::build(source, output, config, meter, &stop.heed());
    report.map_err(|error| of(source, error))
}

/// An error with the source that it is about, where it does not name it itself.
pub(super) fn of(source: &Path, error: BuildError) -> Error {
    match error.is_about_memory() {
        true => Error::new(error).context(format!("cannot build '{}'", source.display())),
        false => error.into(),
    }
}

/// Prints the result, its time, warnings and repairs; tables, if they are wanted.
pub(super) fn print(
    report: &BuildReport,
    output: &Path,
    verbose: bool,
    out: &mut impl Write,
) -> io::Result<()> {
    let levels: Vec<LevelRow> = report.levels.iter().map(report::level_row).collect();
    if verbose {
        writeln!(out, "{}\n\n{}", report::stages_table(report), report::levels_table(&levels))?;
        if let Some(refusals) = report::refusals_table(&levels) {
            writeln!(out, "\n{refusals}")?;
        }
        writeln!(out)?;
    }

    writeln!(
        out,
        "{}: {}, {:.1} bytes for each of {}; {} in {}, {} at the top",
        output.display(),
        Bytes(report.output_len),
        per_triangle(report.output_len, report.triangles),
        Short(report.triangles).of("triangle"),
        Short(report.clusters.into()).of("cluster"),
        Counted(levels.len() as u64, "level"),
        count(report.roots.into()),
    )?;
    let (seconds, rate) = (report.seconds(), report::rate(report.triangles, report.seconds()));
    let memory = report.peak_resident.map_or(String::new(), |bytes| format!(", {} of memory", Bytes(bytes)));
    writeln!(out, "built in {seconds:.2} s, {rate} triangles/s{memory}")?;

    for note in &report.notes {
        writeln!(out, "{note}")?;
    }
    for warning in &report.warnings {
        writeln!(out, "warning: {warning}")?;
    }
    let repairs = report::repair_lines(&report.repairs.describe());
    if !repairs.is_empty() {
        writeln!(out, "found in the source:\n{}", repairs.join("\n"))?;
    }
    Ok(())
}

/// A source that came through a pipe is gone.
fn print_next(source: Option<&Path>, output: &Path, out: &mut impl Write) -> Result<()> {
    let triangles = small(output)?;
    let against = source.map_or_else(String::new, |source| format!(" --against {}", word(source)));
    let output = word(output);
    writeln!(out, "next:")?;
    if cfg!(feature = "viewer") {
        writeln!(out, "  chpm view {output}")?;
    }
    writeln!(out, "  chpm info {output}")?;
    writeln!(out, "  chpm verify {output}{against}")?;
    writeln!(out, "  chpm extract {output} --triangles {triangles} -o small.ply")?;
    Ok(())
}

/// Triangles to suggest for a first look: a tenth of the source, unless the coarsest mesh is near that.
pub(super) fn small(output: &Path) -> Result<u64> {
    let file = open(output)?;
    let coarsest: u64 =
        file.roots().map(|root| u64::from(file.clusters()[root.index()].base_triangle_count)).sum();
    let source = file.header().source_triangle_count;
    Ok((source / 10).max(2 * coarsest).clamp(1, source.max(1)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_extmem::ExtmemError;

    #[test]
    fn too_little_memory_is_told_of_the_source() {
        let budget =
            || ExtmemError::Budget { what: "a region", asked: 9, used: 0, limit: 1, work: 0, enough: 9 };
        let told = of(Path::new("scan.ply"), BuildError::Extmem(budget()));
        assert_eq!(told.to_string(), "cannot build 'scan.ply'");
        assert!(format!("{told:#}").contains("no memory for a region"), "{told:#}");
        assert!(of(Path::new("scan.ply"), BuildError::Cancelled).downcast_ref::<BuildError>().is_some());
    }
}
