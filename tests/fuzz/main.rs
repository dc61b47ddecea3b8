//! Sources and files that nobody would make on purpose: generated, damaged, built, verified, and used by every verb that takes a file.
//!
//! As a test it runs a fixed number of cases of fixed seeds. For longer, or to repeat a case:
//!
//! ```text
//! cargo test --release --test fuzz -- --seconds 3600 --seed 1 --keep found
//! cargo test --test fuzz -- --seed 1 --case 4711
//! ```
//!
//! A worker process does the cases, so that a crash is a finding like any other; with `--hang` it is also ended when a case takes
//! longer. What fails is told with its seed and number, made simpler, and with `--keep` its files are kept.

mod command;
mod container;
mod dialect;
mod draw;
mod gltf;
mod judge;
mod model;
mod settings;
mod spoil;
mod verbs;
mod watch;
mod worker;

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Cases of a plain test run, by worker.
const CASES: u64 = 1500;

#[derive(Parser, Clone, Debug)]
struct Args {
    /// Seed of all cases
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of cases
    #[arg(long)]
    cases: Option<u64>,
    /// Go on for so long
    #[arg(long)]
    seconds: Option<u64>,
    /// First case
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// This case alone
    #[arg(long)]
    case: Option<u64>,
    /// Only `sources` or only `files`
    #[arg(long)]
    only: Option<String>,
    /// One source, and one file, in so many goes through the command as well
    #[arg(long, default_value_t = 8)]
    process: u64,
    /// Random cuts of what the command has built, in which to look for cracks, and whose errors are proven, as those of all levels are
    #[arg(long, default_value_t = 5)]
    cuts: u32,
    /// A case that takes more seconds is ended and told; 0 waits for ever
    #[arg(long)]
    hang: Option<u64>,
    /// Where to leave the files of what fails
    #[arg(long)]
    keep: Option<PathBuf>,
    /// Do cases here, telling of each
    #[arg(long, hide = true)]
    worker: bool,
    /// What a test run filters by; this is one test
    #[arg(hide = true)]
    filter: Option<String>,
    /// Tests of other programs that are left out
    #[arg(long, hide = true)]
    skip: Vec<String>,
    #[arg(long, hide = true)]
    nocapture: bool,
    #[arg(short, long, hide = true)]
    quiet: bool,
}

impl Args {
    /// Whether this is no plain test run.
    fn is_long(&self) -> bool {
        self.seconds.is_some() || self.cases.is_some() || self.case.is_some()
    }

    fn cases(&self) -> std::ops::Range<u64> {
        match (self.case, self.cases, self.seconds) {
            (Some(case), ..) => case..case + 1,
            (_, Some(cases), _) => self.first..self.first + cases,
            (_, _, Some(_)) => self.first..u64::MAX,
            _ => 0..CASES,
        }
    }
}

fn main() -> ExitCode {
    let args = Args::parse();
    if args.filter.as_ref().is_some_and(|filter| !"fuzz".contains(filter.as_str())) {
        return ExitCode::SUCCESS;
    }
    if args.worker {
        worker::run(&args);
        return ExitCode::SUCCESS;
    }
    watch::run(&args)
}
