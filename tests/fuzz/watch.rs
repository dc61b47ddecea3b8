//! Starts workers, hears what they tell, and goes on behind a case that ends one.

use crate::Args;
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

/// Seconds for a case in a long run, unless others are given.
const HANG: u64 = 20;

#[derive(Default)]
struct Tally {
    /// Cases, by what became of them.
    ends: BTreeMap<String, u64>,
    processes: u64,
    failures: u64,
    slowest: (Duration, u64),
}

pub(crate) fn run(args: &Args) -> ExitCode {
    let begun = Instant::now();
    let hang = match args.hang.unwrap_or(if args.is_long() { HANG } else { 0 }) {
        0 => None,
        seconds => Some(Duration::from_secs(seconds)),
    };
    let mut tally = Tally::default();
    let cases = args.cases();
    let mut next = cases.start;
    while next < cases.end {
        let left = args.seconds.map(|seconds| seconds.saturating_sub(begun.elapsed().as_secs()));
        if left == Some(0) {
            break;
        }
        match worker(args, next, left, hang, &mut tally) {
            Some(ended_in) => next = ended_in + 1,
            None => break,
        }
    }
    let peak = getrusage(UsageWho::RUSAGE_CHILDREN).map_or(0, |usage| usage.max_rss() >> 10);
    println!(
        "seed {}, {:.0} s: {:?}, {} of them by the command, too; slowest: case {} with {:.1} s; at most {peak} MiB in a process; {} failed",
        args.seed,
        begun.elapsed().as_secs_f64(),
        tally.ends,
        tally.processes,
        tally.slowest.1,
        tally.slowest.0.as_secs_f64(),
        tally.failures,
    );
    if tally.failures == 0 && !tally.ends.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs a worker to its end; answers the case that ended it early.
fn worker(
    args: &Args,
    first: u64,
    left: Option<u64>,
    hang: Option<Duration>,
    tally: &mut Tally,
) -> Option<u64> {
    let mut child = start(args, first, left);
    let lines = lines_of(&mut child);
    let (mut running, mut last, mut since) = (None, None, Instant::now());
    let why = loop {
        let line = match hang {
            Some(hang) if running.is_some() => lines.recv_timeout(hang),
            _ => lines.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        match line {
            Ok(line) => {
                let (word, rest) = line.split_once(' ').unwrap_or((&line, ""));
                match word {
                    "case" => {
                        running = rest.parse::<u64>().ok();
                        (last, since) = (running, Instant::now());
                    }
                    "end" => {
                        let (end, process) = rest.rsplit_once(' ').unwrap_or((rest, "0"));
                        *tally.ends.entry(end.to_owned()).or_default() += 1;
                        tally.processes += u64::from(process == "1");
                        tally.slowest = tally.slowest.max((since.elapsed(), running.unwrap_or(0)));
                        running = None;
                    }
                    "fail" => {
                        tally.failures += 1;
                        let case = rest.split(' ').next().unwrap_or_default();
                        println!(
                            "{rest}\n    again: cargo test --test fuzz -- --seed {} --case {case}",
                            args.seed
                        );
                    }
                    _ => println!("    {rest}"),
                }
            }
            Err(RecvTimeoutError::Timeout) => {
                // The worker and whatever it has started.
                let group = Pid::from_raw(i32::try_from(child.id()).expect("a process id"));
                let _ = killpg(group, Signal::SIGKILL);
                break format!("takes more than {:?}", hang.unwrap_or_default());
            }
            Err(RecvTimeoutError::Disconnected) => break "ended the worker".to_owned(),
        }
    };
    let status = child.wait().expect("an end");
    // One that ends well has done all of its cases.
    if status.success() {
        return None;
    }
    tally.failures += 1;
    let Some(case) = last else {
        println!("before the first case: {why}, {status}");
        return None;
    };
    println!(
        "{case} {why}, {status}\n    again: cargo test --test fuzz -- --seed {} --case {case}",
        args.seed
    );
    Some(case)
}

fn start(args: &Args, first: u64, left: Option<u64>) -> Child {
    let mut words = vec!["--worker".to_owned(), format!("--seed={}", args.seed)];
    words.extend([format!("--process={}", args.process), format!("--cuts={}", args.cuts)]);
    match (args.case, args.cases().end) {
        (Some(case), _) => words.push(format!("--case={case}")),
        (_, u64::MAX) => words.push(format!("--first={first}")),
        (_, end) if args.is_long() => {
            words.extend([format!("--first={first}"), format!("--cases={}", end - first)])
        }
        // A plain run that goes on behind a crash is told so many cases, too.
        (_, end) if first > 0 => {
            words.extend([format!("--first={first}"), format!("--cases={}", end - first)])
        }
        _ => {}
    }
    words.extend(left.map(|left| format!("--seconds={left}")));
    words.extend(args.only.as_ref().map(|only| format!("--only={only}")));
    words.extend(args.keep.as_ref().map(|folder| format!("--keep={}", folder.display())));
    let program = std::env::current_exe().expect("this program");
    let mut command = Command::new(program);
    command.args(words).stdout(Stdio::piped()).process_group(0).spawn().expect("a worker")
}

fn lines_of(child: &mut Child) -> Receiver<String> {
    let (sender, receiver) = channel();
    let lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    thread::spawn(move || lines.map_while(Result::ok).try_for_each(|line| sender.send(line)));
    receiver
}
