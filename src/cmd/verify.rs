//! `chpm verify`: every byte and invariant of a file, with `--against` its leaves and the source, with `--cuts` random cuts.

use super::{Verdict, stdout};
use crate::against::{self, Comparison};
use crate::args::StorageArgs;
use crate::cuts::{self, Cuts};
use crate::progress::Meter;
use crate::report::count;
use crate::stop::Stop;
use anyhow::Result;
use chpm_extmem::{Access, MappedFile, Store};
use chpm_format::verify::Fault;
use chpm_format::{Chpm, Report};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

/// What `chpm verify` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The PLY that it was built from: its triangles must be those of the leaves, unless detail was left out of them
    #[arg(long, value_name = "PLY")]
    against: Option<PathBuf>,
    /// Draw N cuts and look for cracks, I7. Half of them are random legal cuts of every depth, half what random cameras
    /// select. All triangles of every cut are looked at, cluster by cluster and on all processors; one cut of 64, and any in which
    /// something is found, is extracted and looked at as one mesh too
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    cuts: Option<u32>,
    /// Seed of the first cut; the others follow
    #[arg(long, value_name = "S", requires = "cuts", default_value_t = 0)]
    seed: u64,
    /// The result as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    storage: StorageArgs,
}

/// What was found.
struct Findings {
    /// Every fault that is told in full, one a line.
    faults: Vec<String>,
    fault_count: u64,
    checked: Option<Report>,
    /// Whether detail of the source was left out, so that the leaves are not it.
    trimmed: bool,
    compared: Option<Comparison>,
    cuts: Option<Cuts>,
}

/// Verifies, and prints faults one a line.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let findings = verify(args, stop)?;
    let mut out = stdout();
    if args.json {
        writeln!(out, "{:#}", as_json(args, &findings))?;
    } else {
        print(args, &findings, &mut out)?;
    }
    out.flush()?;
    Ok(if findings.fault_count == 0 { Verdict::Good } else { Verdict::Faulty })
}

fn verify(args: &Args, stop: &Stop) -> Result<Findings> {
    let map = MappedFile::open(&args.file)?;
    map.advise(Access::Sequential);
    let file = match Chpm::open(map) {
        Ok(file) => file,
        // A file that does not even open is what a verification is there to find, not a failure to verify.
        Err(error) => {
            let faults = vec![format!("I10 bytes: {error}")];
            return Ok(Findings {
                faults,
                fault_count: 1,
                checked: None,
                trimmed: false,
                compared: None,
                cuts: None,
            });
        }
    };
    let meter = Meter::new(args.quiet);
    meter.start("verify", file.clusters().len() as u64);
    let mut before = 0;
    let checked = chpm_format::verify(&file, |done, _| {
        meter.add(done - before);
        before = done;
    });
    meter.finish();
    let mut faults: Vec<String> = checked.faults.iter().map(told).collect();
    let mut fault_count = checked.fault_count;
    // Pages that cannot be read have been told; what their triangles were cannot be.
    let readable = checked.good_pages == file.clusters().len() as u64;
    let trimmed = file.is_trimmed();
    let compared = match &args.against {
        Some(source) if readable && !trimmed => {
            // From here on there is a work directory to remove.
            let cancel = stop.heed();
            let scratch = args.storage.work_dir.clone().unwrap_or_else(std::env::temp_dir);
            let store = Store::create(&scratch, args.storage.memory().0)?;
            let compared = against::compare(&file, source, &store, &meter, &cancel)?;
            faults.extend(compared.faults.iter().map(|fault| format!("I1 coverage: {fault}")));
            fault_count += compared.fault_count;
            if compared.copies != compared.copies_told {
                let (told, copies) = (count(compared.copies_told), count(compared.copies));
                faults.push(format!(
                    "I1 coverage: the file tells of {told} copies of triangles left out, and {copies} are"
                ));
                fault_count += 1;
            }
            Some(compared)
        }
        _ => None,
    };
    let cuts = match args.cuts {
        Some(count) if readable => {
            let cuts = cuts::check(&file, count, args.seed, &meter, &stop.heed())?;
            faults.extend_from_slice(&cuts.faults);
            fault_count += cuts.fault_count;
            Some(cuts)
        }
        _ => None,
    };
    Ok(Findings { faults, fault_count, checked: Some(checked), trimmed, compared, cuts })
}

/// A fault as it is printed. Where its message names the place already, it is not named twice.
pub(super) fn told(fault: &Fault) -> String {
    let names_place = fault.message.starts_with(&fault.place.to_string());
    if names_place { format!("{}: {}", fault.invariant, fault.message) } else { fault.to_string() }
}

fn print(args: &Args, findings: &Findings, out: &mut impl Write) -> std::io::Result<()> {
    let path = args.file.display();
    for fault in &findings.faults {
        writeln!(out, "{path}: {fault}")?;
    }
    if findings.fault_count > findings.faults.len() as u64 {
        writeln!(out, "{path}: and {} more", count(findings.fault_count - findings.faults.len() as u64))?;
    }
    if findings.fault_count > 0 {
        let noun = if findings.fault_count == 1 { "fault" } else { "faults" };
        return writeln!(out, "{path}: {} {noun}", count(findings.fault_count));
    }
    if let Some(report) = &findings.checked {
        let (pages, triangles) = (count(report.good_pages), count(report.triangles));
        writeln!(out, "{path}: sound; {pages} clusters with {triangles} triangles checked")?;
    }
    if let (Some(compared), Some(source)) = (&findings.compared, &args.against) {
        let triangles = count(compared.leaf_triangles);
        write!(out, "{path}: the leaves are the {triangles} triangles of {}", source.display())?;
        match compared.copies {
            0 => writeln!(out)?,
            copies => writeln!(out, ", without {} copies", count(copies))?,
        }
    }
    if let (true, Some(source)) = (findings.trimmed, &args.against) {
        let source = source.display();
        writeln!(
            out,
            "{path}: not compared with {source}: detail below an error was left out of the leaves"
        )?;
    }
    if let Some(cuts) = &findings.cuts {
        let (n, triangles) = (count(cuts.count.into()), count(cuts.triangles));
        writeln!(out, "{path}: no crack in {n} random cuts of {triangles} triangles together")?;
    }
    Ok(())
}

fn as_json(args: &Args, findings: &Findings) -> Value {
    let display = |path: &Path| path.display().to_string();
    json!({
        "file": display(&args.file),
        "sound": findings.fault_count == 0,
        "fault_count": findings.fault_count,
        "faults": findings.faults,
        "clusters": findings.checked.as_ref().map(|report| report.good_pages),
        "triangles": findings.checked.as_ref().map(|report| report.triangles),
        "trimmed": findings.trimmed,
        "against": findings.compared.as_ref().map(|compared| json!({
            "source": args.against.as_deref().map(display),
            "equal": compared.is_equal(),
            "leaf_triangles": compared.leaf_triangles,
            "source_triangles": compared.source_triangles,
            "copies_left_out": compared.copies,
        })),
        "cuts": findings.cuts.as_ref().map(|cuts| json!({
            "count": cuts.count,
            "seed": cuts.seed,
            "triangles": cuts.triangles,
            "fault_count": cuts.fault_count,
        })),
    })
}
