//! `chpm batch`: many models into one folder, again and again, on one machine or on many.

use super::{Verdict, stdout};
use crate::args::{ResourceArgs, SettingsArgs, build_config};
use crate::batch::inputs::{self, Model};
use crate::batch::page;
use crate::batch::run;
use crate::batch::shard::Shard;
use crate::batch::summary::{self, Status, Summary};
use crate::cli::{Cli, Command};
use crate::config::{self, ConfigArgs};
use crate::number;
use crate::output;
use crate::progress::line;
use crate::stop::Stop;
use anyhow::{Context, Result, bail, ensure};
use chpm_build::{BuildConfig, Cancel, MIN_MEMORY};
use chpm_extmem::{AtomicFile, Lock};
use chpm_mesh::{Bytes, Counted};
use clap::Parser;
use std::ffi::OsString;
use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

/// Arguments of `chpm batch`.
#[derive(clap::Args, Debug)]
#[command(args_override_self = true)]
pub(crate) struct Args {
    /// Meshes: files, folders with all below them, patterns in quotes, lists of models in TOML or JSON, or - for a list of
    /// these on standard input. With --merge: summary.json files
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// The folder of the results; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Models to build side by side; they share --memory and --threads evenly. Fewer if each would have less than 128M
    #[arg(short, long, value_name = "N", default_value_t = 1, value_parser = number::count(1_u16..=1024))]
    jobs: u16,
    /// Only part I of N; who is in it depends on a model's name alone
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Merge the summaries of all parts into one
    #[arg(long, conflicts_with_all = ["shard", "dry_run", "force"])]
    merge: bool,
    /// Also write index.html into the folder: a picture of each model, failures first
    #[arg(long, conflicts_with = "dry_run")]
    report: bool,
    /// Say what would be built, and why
    #[arg(long)]
    dry_run: bool,
    /// Build everything, also what is up to date
    #[arg(short, long)]
    force: bool,
    /// Keep what becomes of each part of a model beside it: one whose source changes is then built anew where it has changed
    ///
    /// As `build --updatable` and `--update` do, model by model. What is kept is two to three times as long as the models.
    #[arg(long, conflicts_with_all = ["keep_work", "merge"])]
    updatable: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    /// The summary as JSON on stdout
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    #[command(flatten)]
    resources: ResourceArgs,
}

/// Builds what is missing, changed or failed before; faulty if a model fails.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    output::check_folder("batch", &args.output)?;
    if args.merge {
        return merge(args);
    }
    let config = config_of(args)?;
    let models = inputs::collect(&args.inputs, io::stdin().lock())?;
    let mine = models.into_iter().filter(|model| args.shard.is_none_or(|shard| shard.has(&model.name)));
    let models = mine.map(|model| own_config(args, &model, &config).map(|config| (model, config)));
    let models = models.collect::<Result<Vec<(Model, BuildConfig)>>>()?;

    let path = Summary::path(&args.output, args.shard);
    check_outputs(args)?;
    let earlier = run::earlier(&path);
    if args.dry_run {
        let tasks = run::plan(models, &args.output, &earlier, args.force, &Cancel::default());
        return print(args, &Summary::new(args.shard, run::planned(tasks)));
    }
    fs::create_dir_all(&args.output)
        .with_context(|| format!("cannot make the folder '{}'", args.output.display()))?;
    // From here on there is something to clean up.
    let cancel = stop.heed();
    let _lock = Lock::acquire(&path)?;
    let tasks = run::plan(models, &args.output, &earlier, args.force, &cancel);
    let summary = Summary::new(args.shard, run::run(tasks, jobs(args, &config), args.quiet, &cancel));
    summary.write(&args.output)?;
    write_index(args, &summary)?;
    let verdict = print(args, &summary)?;
    let stopped = summary.count(Status::Stopped);
    ensure!(
        stopped == 0,
        "stopped on request with {} left: run the same command again",
        Counted(stopped as u64, "model")
    );
    Ok(verdict)
}

/// How models are built that have no settings of their own.
fn config_of(args: &Args) -> Result<BuildConfig> {
    let mut config = build_config(&args.settings, &args.resources, true)?;
    if args.updatable {
        config.make_updatable(None);
    }
    Ok(config)
}

/// As many models side by side as were asked for, and as have the least memory each.
fn jobs(args: &Args, config: &BuildConfig) -> usize {
    let wanted = usize::from(args.jobs);
    let fitting = (config.resources.memory.0 / MIN_MEMORY).max(1) as usize;
    if fitting >= wanted || args.resources.any_memory {
        return wanted;
    }
    if !args.quiet {
        let each = Bytes(MIN_MEMORY);
        line(&format!(
            "{fitting} side by side instead of {wanted}, since each needs {each}; raise --memory for more"
        ));
    }
    fitting
}

fn merge(args: &Args) -> Result<Verdict> {
    check_outputs(args)?;
    let inputs = args.inputs.iter().map(|path| Ok((path.clone(), Summary::read(path)?)));
    let summary = summary::merge(inputs.collect::<Result<_>>()?)?;
    fs::create_dir_all(&args.output)
        .with_context(|| format!("cannot make the folder '{}'", args.output.display()))?;
    summary.write(&args.output)?;
    write_index(args, &summary)?;
    print(args, &summary)
}

/// Refuses to replace what is not of a batch.
fn check_outputs(args: &Args) -> Result<()> {
    Summary::check(&args.output, args.shard, args.force, &args.inputs)?;
    if args.report && !args.force {
        page::check(&args.output.join(INDEX))?;
    }
    Ok(())
}

/// The page's name.
const INDEX: &str = "index.html";

/// The page, if it is wanted.
fn write_index(args: &Args, summary: &Summary) -> Result<()> {
    if args.report {
        let mut file = AtomicFile::create(&args.output.join(INDEX), true)?;
        let text = page::index(summary, &args.output)?;
        file.write_all(text.as_bytes()).map_err(|error| file.error(error))?;
        file.publish()?;
    }
    Ok(())
}

fn print(args: &Args, summary: &Summary) -> Result<Verdict> {
    let mut out = stdout();
    if args.json {
        writeln!(out, "{}", serde_json::to_string_pretty(summary)?)?;
    } else {
        writeln!(out, "{}\n", summary.table())?;
        for error in summary.errors() {
            writeln!(out, "error: {error}")?;
        }
        writeln!(out, "{}", summary.line())?;
    }
    out.flush()?;
    Ok(if summary.count(Status::Failed) == 0 { Verdict::Good } else { Verdict::Faulty })
}

/// The command line's configuration with the model's own settings in place of what they name, and with those of a preset and of a file
/// beside the model where nothing else names them.
fn own_config(args: &Args, model: &Model, common: &BuildConfig) -> Result<BuildConfig> {
    let layers = config::layers(&args.config, Some(&model.source))?;
    if model.settings.is_empty() && layers.is_empty() {
        return Ok(common.clone());
    }
    /// Nothing but what decides the bytes of an output.
    #[derive(Parser)]
    #[command(no_binary_name = true)]
    struct Own {
        #[command(flatten)]
        _settings: SettingsArgs,
    }
    let told = || format!("settings of model '{}'", model.name);
    Own::try_parse_from(&model.settings).map_err(config::flat).with_context(told)?;
    // Read once more with these at its end, where they win.
    let mut words: Vec<OsString> = std::env::args_os().collect();
    let end = words.iter().position(|word| word == "--").unwrap_or(words.len());
    words.splice(end..end, model.settings.iter().map(OsString::from));
    let (words, _) = config::merged(&words, &layers).with_context(told)?;
    match Cli::try_parse_from(words).map_err(config::flat).with_context(told)?.command {
        Command::Batch(args) => {
            ensure!(!args.merge, "settings cannot merge");
            config_of(&args)
        }
        _ => bail!("{}: not understood", told()),
    }
}
