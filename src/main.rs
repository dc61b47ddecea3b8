//! `chpm`: turns a triangle mesh of any size into one memory-mapped clustered hierarchy of progressive meshes, and looks
//! into the result.
//!
//! Exit codes: 0 for success, 1 if a verification found a fault, 2 for errors, 129, 130 and 143 after SIGHUP, SIGINT and SIGTERM.
#![forbid(unsafe_code)]

mod args;
mod batch;
mod bench;
#[cfg(feature = "viewer")]
mod beside;
mod caches;
mod certified;
mod claim;
mod cli;
mod cmd;
mod companions;
mod compare;
mod config;
#[cfg(feature = "web")]
mod connections;
mod crs;
mod digest;
mod escape;
mod examples;
mod folder;
mod forecast;
mod formats;
mod frame;
mod further;
mod georeference;
mod help;
mod inputs;
mod json;
mod memory;
mod mesh_file;
mod number;
mod output;
#[cfg(feature = "viewer")]
mod picture;
mod presets;
mod progress;
mod proximity;
mod rays;
mod report;
mod section;
#[cfg(feature = "viewer")]
mod session;
mod shown;
mod stats_tables;
mod stop;
mod threads;
mod tight;
mod tile_list;
mod tolerance;
mod upright;
mod view;
#[cfg(feature = "web")]
mod web;
mod whole;
mod workflow;

use chpm_extmem::platform::is_closed_pipe;
use clap::FromArgMatches;
use cli::Cli;
use cmd::Verdict;
use std::borrow::Cow;
use std::io::{self, Write};
use std::iter;
use std::process::ExitCode;
use stop::Stop;

fn main() -> ExitCode {
    let typed = examples::command().try_get_matches();
    let cli = match typed.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => misused(&error),
        Err(help) => return shown(&help),
    };
    #[cfg(feature = "viewer")]
    session::ensure_folder(&cli.command);
    let stop = match Stop::listen() {
        Ok(stop) => stop,
        Err(error) => return failed(&error, 2),
    };
    match cmd::run(cli.command, &stop) {
        Ok(Verdict::Good) => ExitCode::SUCCESS,
        Ok(Verdict::Faulty) => ExitCode::from(1),
        // Whoever closed the pipe has read enough.
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => failed(&error, stop.exit_code().unwrap_or(2)),
    }
}

/// Prints what was asked for instead of a verb: help, or the version.
fn shown(help: &clap::Error) -> ExitCode {
    match help.print().and_then(|()| io::stdout().flush()).map_err(output::placed) {
        Err(error) if !is_closed_pipe(&error) => failed(&error.into(), 2),
        _ => ExitCode::SUCCESS,
    }
}

/// Says what is wrong with the words of the command. It tells them, and they may be names of files.
fn misused(error: &clap::Error) -> ! {
    let text = error.to_string();
    if let Cow::Owned(told) = escape::escaped(&text) {
        progress::line(told.trim_end());
        std::process::exit(error.exit_code());
    }
    error.exit()
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.downcast_ref().is_some_and(is_closed_pipe))
}

/// Prints the error and its causes, one a line.
fn failed(error: &anyhow::Error, code: u8) -> ExitCode {
    let leads = iter::once("error").chain(iter::repeat("  because"));
    for (lead, cause) in leads.zip(report::causes(error)) {
        progress::line(&format!("{lead}: {cause}"));
    }
    // Without that, whoever reads of a full standard output would think that all was in vain.
    for path in output::finished() {
        progress::line(&format!("  but '{}' is written and complete", path.display()));
    }
    ExitCode::from(code)
}
