//! `chpm bench --threads`: the same build on several numbers of threads, each in a process of its own.

use super::{Args, machine, output_of};
use crate::bench::median;
use crate::cmd::{Verdict, stdout, temporary};
use crate::json::{self, made, named};
use crate::progress::Meter;
use crate::report::{count, table};
use crate::stop::{self, Stop};
use anyhow::{Context, Result, bail};
use chpm_extmem::Cancel;
use chpm_mesh::{Bytes, Counted};
use serde_json::Value;
use std::io::Write;
use std::path::Path;
use std::process::Command;

/// Figures that one build tells of itself.
struct Run {
    triangles: u64,
    seconds: f64,
    processor_seconds: Option<f64>,
    peak: Option<u64>,
    /// Names and seconds.
    stages: Vec<(String, f64)>,
}

impl Run {
    /// Reads what `chpm build --json` prints.
    fn of_json(told: &Value) -> Option<Run> {
        let stages = told["stages"].as_array()?;
        let processor = |stage: &Value| stage["processor_seconds"].as_f64();
        let stage = |stage: &Value| Some((stage["stage"].as_str()?.to_owned(), stage["seconds"].as_f64()?));
        Some(Run {
            triangles: told["triangles"].as_u64()?,
            seconds: told["seconds"].as_f64()?,
            processor_seconds: stages.iter().map(processor).sum(),
            peak: told["peak_resident_bytes"].as_u64(),
            stages: stages.iter().map(stage).collect::<Option<_>>()?,
        })
    }
}

/// Builds in turn, so that what else the machine does falls on all numbers of threads, and prints the medians.
pub(super) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let folder = temporary()?;
    let output = folder.path().join("scaling.chpm");
    let meter = Meter::new(args.quiet);
    meter.start("run", u64::from(args.runs) * args.threads.len() as u64);
    let mut runs: Vec<Vec<Run>> = args.threads.iter().map(|_| Vec::new()).collect();
    for _ in 0..args.runs {
        for (threads, runs) in args.threads.iter().zip(&mut runs) {
            stop::check(&cancel)?;
            runs.push(build(args, *threads, &output, &cancel)?);
            meter.add(1);
        }
    }
    meter.finish();

    let mut builds: Vec<made::ScalingBuild> = Vec::new();
    for (threads, runs) in args.threads.iter().zip(&runs) {
        let first = builds.first().map(|build| build.seconds);
        builds.push(medians(*threads, runs, first).context("a build told nothing of itself")?);
    }
    let result = made::Scaling {
        schema: "chpm-bench-threads/1",
        source: named(&args.source),
        triangles: runs[0].first().map_or(0, |run| run.triangles),
        machine: machine(),
        runs: args.runs,
        builds,
    };
    let mut out = stdout();
    if args.json {
        json::print(&result, &mut out)?;
    } else {
        print(&result, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

/// One build by a process of this same program.
fn build(args: &Args, threads: u32, output: &Path, cancel: &Cancel) -> Result<Run> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let mut command = Command::new(program);
    command.arg("build").arg(&args.source).arg("-o").arg(output);
    command.args(["--threads", &threads.to_string(), "--memory", &args.memory.to_string()]);
    // What an earlier run has done would be passed over, and work that is saved takes time.
    command.args(["--force", "--no-resume", "--json", "--quiet"]);
    let folder = output.parent().unwrap_or(output);
    let done = output_of(command, folder, cancel)?;
    if !done.status.success() {
        bail!("a build with {threads} threads failed: {}", String::from_utf8_lossy(&done.stderr).trim());
    }
    let told = serde_json::from_slice(&done.stdout).context("a build's JSON")?;
    Run::of_json(&told).context("a build told too little of itself")
}

/// The builds of one number of threads; `first` are the seconds of the first one.
fn medians(threads: u32, runs: &[Run], first: Option<f64>) -> Option<made::ScalingBuild> {
    fn middle<T: Copy + PartialOrd>(runs: &[Run], of: impl Fn(&Run) -> Option<T>) -> Option<T> {
        median(&runs.iter().map(of).collect::<Option<Vec<T>>>()?)
    }
    let seconds = middle(runs, |run| Some(run.seconds))?;
    let stages = runs.first()?.stages.iter().enumerate().map(|(at, (stage, _))| {
        let seconds = middle(runs, |run| run.stages.get(at).map(|(_, seconds)| *seconds))?;
        Some(made::ScalingStage { stage: stage.clone(), seconds })
    });
    Some(made::ScalingBuild {
        threads,
        seconds,
        triangles_per_second: runs.first()?.triangles as f64 / seconds,
        speedup: first.unwrap_or(seconds) / seconds,
        processor_seconds: middle(runs, |run| run.processor_seconds),
        peak_resident_bytes: middle(runs, |run| run.peak),
        stages: stages.collect::<Option<_>>()?,
    })
}

fn print(result: &made::Scaling, out: &mut impl Write) -> Result<()> {
    writeln!(out, "{}: {}", result.source, Counted(result.triangles, "triangle"))?;
    writeln!(out, "{}; median of {}\n", result.machine, Counted(result.runs.into(), "run"))?;
    let unknown = || "-".to_owned();
    let rows = result.builds.iter().map(|build| {
        vec![
            build.threads.to_string(),
            format!("{:.3}", build.seconds),
            count(build.triangles_per_second as u64),
            format!("{:.2}", build.speedup),
            build.processor_seconds.map_or_else(unknown, |seconds| format!("{seconds:.3}")),
            build.peak_resident_bytes.map_or_else(unknown, |bytes| Bytes(bytes).to_string()),
        ]
    });
    let header = ["threads", "seconds", "triangles/s", "times as fast", "processor seconds", "peak memory"];
    writeln!(out, "{}\n", table(&header, rows))?;

    let stages = result.builds.first().map_or(&[][..], |build| &build.stages);
    let mut header = vec!["threads"];
    header.extend(stages.iter().map(|stage| stage.stage.as_str()));
    let rows = result.builds.iter().map(|build| {
        let mut row = vec![build.threads.to_string()];
        row.extend(build.stages.iter().map(|stage| format!("{:.3}", stage.seconds)));
        row
    });
    writeln!(out, "seconds of each stage\n{}", table(&header, rows))?;
    Ok(())
}
