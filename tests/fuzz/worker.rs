//! Does one case after the other, and tells of each on stdout.

use crate::Args;
use crate::draw::bytes_of;
use crate::judge::{self, Depth, Ended, Failure};
use std::fs;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Attempts to make what fails simpler.
const ATTEMPTS: usize = 200;

static CORPUS: LazyLock<Vec<Vec<u8>>> = LazyLock::new(judge::corpus);

/// What the last panic said, and where.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// What a case is about. Files are quick, so there are more of them.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Kind {
    Source,
    File,
}

pub(crate) fn run(args: &Args) {
    panic::set_hook(Box::new(|info| {
        *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string().replace('\n', " ");
    }));
    let (begun, limit) = (Instant::now(), args.seconds.map_or(Duration::MAX, Duration::from_secs));
    for case in args.cases() {
        if begun.elapsed() >= limit {
            return;
        }
        let kind = if case.is_multiple_of(4) { Kind::Source } else { Kind::File };
        let is_asked = match args.only.as_deref() {
            Some("sources") => kind == Kind::Source,
            Some("files") => kind == Kind::File,
            _ => true,
        };
        if !is_asked {
            continue;
        }
        println!("case {case}");
        let process = args.case.is_some() || (case / 4).is_multiple_of(args.process) && case % 4 < 2;
        let depth = Depth { process, cuts: args.cuts };
        let bytes = bytes_of(args.seed, case);
        match judge(kind, &bytes, depth) {
            Ok(ended) => println!("end {kind:?} {ended:?} {}", u8::from(process)),
            Err(failure) => {
                println!("end {kind:?} Failed {}", u8::from(process));
                println!("fail {case} {}: {}", failure.kind, failure.told.replace('\n', " | "));
                if args.is_long() {
                    let small = simpler(kind, &bytes, depth, &failure);
                    println!(
                        "note with {} of {} bytes that differ from zero",
                        filled(&small),
                        filled(&bytes)
                    );
                    if let Some(folder) = &args.keep {
                        keep(&folder.join(format!("{}-{case}", args.seed)), kind, &bytes, &failure);
                        keep(&folder.join(format!("{}-{case}-simpler", args.seed)), kind, &small, &failure);
                    }
                }
            }
        }
    }
}

fn judge(kind: Kind, bytes: &[u8], depth: Depth) -> Result<Ended, Failure> {
    let work = || match kind {
        Kind::Source => judge::judge_source(bytes, depth),
        Kind::File => judge::judge_file(bytes, &CORPUS, depth),
    };
    panic::catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
        Err(Failure::new("panic", PANIC.lock().unwrap_or_else(PoisonError::into_inner).clone()))
    })
}

fn filled(bytes: &[u8]) -> usize {
    bytes.iter().filter(|byte| **byte != 0).count()
}

/// Fewer bytes, and more of them zero, with a failure of the same kind: zeros draw what is first and smallest.
fn simpler(kind: Kind, bytes: &[u8], depth: Depth, failure: &Failure) -> Vec<u8> {
    let mut best = bytes.to_vec();
    let mut attempts = 0;
    let mut attempt = |candidate: Vec<u8>, best: &mut Vec<u8>| {
        attempts += 1;
        let worse = attempts > ATTEMPTS || candidate == *best;
        if !worse && judge(kind, &candidate, depth).is_err_and(|other| other.kind == failure.kind) {
            *best = candidate;
        }
    };
    for share in 1..8 {
        let len = best.len() >> share;
        attempt(best[..len].to_vec(), &mut best);
    }
    for block in [64, 16, 4, 1] {
        for start in (0..best.len()).step_by(block) {
            let mut candidate = best.clone();
            let end = candidate.len().min(start + block);
            candidate[start..end].fill(0);
            attempt(candidate, &mut best);
        }
    }
    best
}

/// The files of a case, and what is wrong with them.
fn keep(folder: &Path, kind: Kind, bytes: &[u8], failure: &Failure) {
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes).expect("a file written");
    fs::create_dir_all(folder).expect("a folder");
    let mut told = format!("{}: {}\n", failure.kind, failure.told);
    match kind {
        Kind::Source => {
            let (source, settings) = judge::source(bytes);
            write(&source.name, &source.bytes);
            source.beside.iter().for_each(|(name, bytes)| write(name, bytes));
            told += &format!("chpm build {} {}\n", source.name, settings.words.join(" "));
        }
        Kind::File => write("bad.chpm", &judge::file(bytes, &CORPUS)),
    }
    write("failure.txt", told.as_bytes());
}
