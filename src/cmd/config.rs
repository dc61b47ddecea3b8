//! `chpm config`: which settings a build would have, and from where.

use super::{Verdict, stdout};
use crate::args::{ResourceArgs, SettingsArgs, build_config};
use crate::cli::{Cli, Command};
use crate::config::{self, ConfigArgs};
use crate::json::{
    self,
    file::{Config, Setting},
};
use crate::report;
use anyhow::Result;
use clap::Parser;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `chpm config`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The mesh that would be built, for the chpm.toml beside it
    source: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    #[command(flatten)]
    resources: ResourceArgs,
}

/// Prints each setting with its origin.
pub(crate) fn run(args: &Args) -> Result<Verdict> {
    let layers = config::layers(&args.config, args.source.as_deref())?;
    let words: Vec<_> = std::env::args_os().collect();
    let mut all = config::effective(&words, &layers)?;
    // What a build would refuse is no setting that it would have.
    let (words, _) = config::merged(&words, &layers)?;
    if let Command::Config(merged) = Cli::try_parse_from(words).map_err(config::flat)?.command {
        let settings = build_config(&merged.settings, &merged.resources, false)?.settings;
        // Where nothing is set, others decide.
        for setting in all.iter_mut().filter(|setting| setting.from == "default") {
            match setting.name.as_str() {
                "texture" => {
                    setting.value = if settings.makes_sheets() { "sheets" } else { "vertices" }.to_owned()
                }
                "cluster-triangles" => setting.value = settings.cluster_triangles.to_string(),
                _ => {}
            }
        }
    }
    let mut out = stdout();
    if args.json {
        let settings = all.into_iter().map(|s| Setting { name: s.name, value: s.value, from: s.from });
        json::print(&Config { schema: "chpm-config/1", settings: settings.collect() }, &mut out)?;
    } else {
        let rows = all.into_iter().map(|setting| vec![setting.name, setting.value, setting.from]);
        writeln!(out, "{}", report::table(&["setting", "value", "from"], rows))?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}
