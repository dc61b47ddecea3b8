//! Settings that are not typed: those of a preset, and of a `chpm.toml`. What is typed wins over the file, the file over the preset.

use crate::args::{ResourceArgs, SettingsArgs, build_config};
use crate::batch::manifest::{self, Settings};
use crate::cli::Cli;
use crate::presets::Preset;
use anyhow::{Context, Result, anyhow, ensure};
use chpm_mesh::Bytes;
use clap::parser::ValueSource;
use clap::{ArgMatches, CommandFactory, Parser, ValueEnum};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

/// The name of a file beside the models.
const NAME: &str = "chpm.toml";
/// More than settings take.
const MOST: Bytes = Bytes::mib(1);
/// Options of which one takes the other's place.
const RIVALS: [[&str; 2]; 4] = [
    ["finest-error", "prune-exact"],
    ["order", "no-layout"],
    ["no-resume", "keep-work"],
    ["normals", "no-normals"],
];

/// Where settings may come from besides.
#[derive(clap::Args, Debug)]
pub(crate) struct ConfigArgs {
    /// Settings for a kind of model
    ///
    /// What is typed besides wins.
    #[arg(long, value_name = "KIND", value_enum)]
    preset: Option<Preset>,
    /// A TOML file of settings, instead of chpm.toml
    ///
    /// It has a table `settings` of options, and a preset or none; chpm.toml beside the source if not given.
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Leave a chpm.toml beside the source alone
    #[arg(long, hide_short_help = true, conflicts_with = "config")]
    no_config: bool,
}

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    preset: Option<String>,
    #[serde(default)]
    settings: Settings,
}

/// Settings of one origin: names of options with what is typed for them, once or several times.
#[derive(Debug, PartialEq)]
pub(crate) struct Layer {
    pub(crate) from: String,
    settings: BTreeMap<String, Vec<String>>,
}

/// Nothing but settings and resources.
#[derive(Parser)]
#[command(no_binary_name = true)]
struct Own {
    #[command(flatten)]
    settings: SettingsArgs,
    #[command(flatten)]
    resources: ResourceArgs,
}

/// Settings for a source besides those on the command line; the first wins.
pub(crate) fn layers(args: &ConfigArgs, source: Option<&Path>) -> Result<Vec<Layer>> {
    let mut layers = Vec::new();
    let mut preset = args.preset;
    // Whatever has the name is meant, and is told of where it cannot be read.
    let beside = source
        .map(|source| source.with_file_name(NAME))
        .filter(|path| !args.no_config && path.symlink_metadata().is_ok());
    if let Some(path) = args.config.clone().or(beside) {
        let told = || format!("'{}' is no valid configuration", path.display());
        let text = text(&path, MOST)?;
        let file: File = toml::from_str(&text).with_context(told)?;
        if let Some(name) = &file.preset {
            let named = Preset::from_str(name, false).map_err(|error| anyhow!("preset: {error}"));
            preset = preset.or(Some(named.with_context(told)?));
        }
        let words = manifest::arguments(&file.settings);
        let own = Own::try_parse_from(&words).map_err(flat).with_context(told)?;
        build_config(&own.settings, &own.resources, false).with_context(told)?;
        layers.push(Layer { from: path.display().to_string(), settings: split(&words) });
    }
    if let Some(preset) = preset {
        let settings =
            preset.settings().iter().map(|(name, value)| ((*name).to_owned(), vec![(*value).to_owned()]));
        layers.push(Layer { from: format!("preset {}", preset.name()), settings: settings.collect() });
    }
    Ok(layers)
}

/// Where settings come from, in words.
pub(crate) fn origins(layers: &[Layer]) -> String {
    layers.iter().map(|layer| layer.from.as_str()).collect::<Vec<_>>().join(", ")
}

/// The text of a file that people write, of so many bytes at most. What is no regular file may have no end.
pub(crate) fn text(path: &Path, most: Bytes) -> Result<String> {
    let (name, told) = (path.display(), || format!("cannot read '{}'", path.display()));
    ensure!(
        fs::metadata(path).with_context(told)?.is_file(),
        "'{name}' is no regular file; save what it holds as one"
    );
    chpm_extmem::read_text(path, most.0).with_context(told)
}

/// `--name=value` and `--name` as names and values.
fn split(words: &[String]) -> BTreeMap<String, Vec<String>> {
    let mut settings: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for word in words {
        let word = word.trim_start_matches('-');
        let (name, value) = word.split_once('=').unwrap_or((word, ""));
        settings.entry(name.to_owned()).or_default().push(value.to_owned());
    }
    settings
}

/// A command line with what the layers add to it, and from where each of these options comes.
pub(crate) fn merged(
    words: &[OsString],
    layers: &[Layer],
) -> Result<(Vec<OsString>, BTreeMap<String, String>)> {
    let mut command = Cli::command();
    let matches = command.try_get_matches_from_mut(words)?;
    // The verb, or the step of one, and the words up to there.
    let (mut verb, mut own, mut depth) = (&matches, &command, 1);
    while let Some((name, inner)) = verb.subcommand() {
        (verb, own, depth) = (inner, own.find_subcommand(name).unwrap_or(own), depth + 1);
    }
    let known: BTreeSet<&str> = own.get_arguments().filter_map(clap::Arg::get_long).collect();
    let mut taken = typed(verb);
    let value = |of: &str| verb.get_raw(of)?.next()?.to_str();
    if taken.contains("texture") && value("texture") != Some("none") {
        taken.insert("no-colors".to_owned());
    }
    let (mut added, mut origins) = (Vec::new(), BTreeMap::new());
    for layer in layers {
        // A step has all settings, and fewer resources.
        let is_meant = |name: &str| is_free(name, &taken) && (depth < 3 || known.contains(name));
        let free: Vec<_> = layer.settings.iter().filter(|(name, _)| is_meant(name)).collect();
        for (name, values) in free {
            added.extend(values.iter().map(|value| {
                let equals = if value.is_empty() { "" } else { "=" };
                OsString::from(format!("--{name}{equals}{value}"))
            }));
            origins.insert(name.clone(), layer.from.clone());
            taken.insert(name.clone());
        }
    }
    let mut words = words.to_vec();
    // Behind the verb.
    words.splice(depth..depth, added);
    Ok((words, origins))
}

/// Whether neither an option nor one that it excludes is there.
fn is_free(name: &str, taken: &BTreeSet<String>) -> bool {
    let rivals = RIVALS.iter().filter(|rivals| rivals.contains(&name)).flatten();
    // Images give vertices colours.
    let is_held = name == "texture" && taken.contains("no-colors");
    !taken.contains(name) && !is_held && !rivals.into_iter().any(|rival| taken.contains(*rival))
}

/// Names of options that were typed.
fn typed(matches: &ArgMatches) -> BTreeSet<String> {
    let ids = matches.ids().map(clap::Id::as_str);
    let typed = ids.filter(|id| matches.value_source(id) == Some(ValueSource::CommandLine));
    typed.map(|id| id.replace('_', "-")).collect()
}

/// A setting as it is, and from where.
pub(crate) struct Effective {
    pub(crate) name: String,
    pub(crate) value: String,
    pub(crate) from: String,
}

/// All settings and resources of a command line.
pub(crate) fn effective(words: &[OsString], layers: &[Layer]) -> Result<Vec<Effective>> {
    let (words, origins) = merged(words, layers)?;
    let matches = Cli::command().try_get_matches_from(words)?;
    let (_, verb) = matches.subcommand().context("a verb is missing")?;
    let own = Own::command();
    let shown = own
        .get_arguments()
        .filter(|arg| !arg.is_hide_set() && arg.get_long().is_some_and(|long| long != "help"));
    let all = shown.map(|arg| {
        let (id, name) = (arg.get_id().as_str(), arg.get_long().unwrap_or_default());
        let value = match arg.get_action() {
            clap::ArgAction::SetTrue => verb.get_flag(id).to_string(),
            _ => verb.get_raw(id).map_or("none".to_owned(), |all| {
                all.map(|raw| raw.to_string_lossy()).collect::<Vec<_>>().join(", ")
            }),
        };
        let from = match (origins.get(name), verb.value_source(id)) {
            (Some(origin), _) => origin.clone(),
            (None, Some(ValueSource::CommandLine)) => "command line".to_owned(),
            _ => "default".to_owned(),
        };
        Effective { name: name.to_owned(), value, from }
    });
    Ok(all.collect())
}

/// The first line of what clap says; the rest is about a command line that nobody typed.
pub(crate) fn flat(error: clap::Error) -> anyhow::Error {
    let text = error.to_string();
    let line = text.lines().next().unwrap_or_default();
    anyhow!("{}", line.strip_prefix("error: ").unwrap_or(line))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<OsString> {
        text.split(' ').map(OsString::from).collect()
    }

    fn layer(from: &str, settings: &[(&str, &str)]) -> Layer {
        let settings =
            settings.iter().map(|(name, value)| ((*name).to_owned(), vec![(*value).to_owned()])).collect();
        Layer { from: from.to_owned(), settings }
    }

    #[test]
    fn what_is_typed_wins_over_the_file_and_that_over_the_preset() {
        let layers = [
            layer("file", &[("seed", "3"), ("prune-exact", "")]),
            layer("preset", &[("seed", "4"), ("pages", "packed"), ("topology", "keep")]),
        ];
        let of =
            |text: &str| merged(&words(text), &layers).unwrap().0.join(" ".as_ref()).into_string().unwrap();
        assert_eq!(
            of("chpm build x.ply --topology change"),
            "chpm build --prune-exact --seed=3 --pages=packed x.ply --topology change"
        );
        // A step of `stage` has no checkpoint.
        let step = [layer("file", &[("seed", "3"), ("no-resume", ""), ("threads", "2")])];
        let (typed, _) = merged(&words("chpm stage plan x.ply -o x --threads 4"), &step).unwrap();
        assert_eq!(typed.join(" ".as_ref()), "chpm stage plan --seed=3 x.ply -o x --threads 4");
        let colors = [layer("file", &[("no-colors", "")]), layer("preset", &[("texture", "sheets")])];
        for (typed, expected) in [
            ("chpm build x.ply", "chpm build --no-colors x.ply"),
            ("chpm build x.ply --texture none", "chpm build --no-colors x.ply --texture none"),
            ("chpm build x.ply --texture sheets", "chpm build x.ply --texture sheets"),
        ] {
            let (words, _) = merged(&words(typed), &colors).unwrap();
            assert_eq!(words.join(" ".as_ref()), expected);
        }
        let (typed, _) = merged(&words("chpm build x.ply --no-colors"), &colors).unwrap();
        assert_eq!(typed.join(" ".as_ref()), "chpm build x.ply --no-colors");
        assert_eq!(
            of("chpm build x.ply --finest-error 1% --seed 9 --pages raw"),
            "chpm build --topology=keep x.ply --finest-error 1% --seed 9 --pages raw"
        );
    }

    #[test]
    fn presets_are_settings_that_there_are() {
        for preset in Preset::value_variants() {
            let layers = [layer("preset", preset.settings())];
            let (words, _) = merged(&words("chpm build x.ply"), &layers).unwrap();
            assert!(Cli::try_parse_from(words).is_ok(), "{preset:?}");
            assert_eq!(Preset::from_str(preset.name(), false), Ok(*preset));
        }
    }
}
