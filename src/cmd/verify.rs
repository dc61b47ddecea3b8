//! `chpm verify`: every byte and invariant of a file, with `--against` its leaves and the source, with `--errors` what it says of distances, with `--cuts` random cuts.

use super::{Verdict, open, reading, stdout};
use crate::against::{self, Comparison};
use crate::args::StorageArgs;
use crate::certify::{self, Certified, Wanted};
use crate::cuts::{self, Checked, Cuts};
use crate::memory;
use crate::number;
use crate::progress::Meter;
use crate::report::count;
use crate::stop::Stop;
use crate::threads::ThreadArgs;
use anyhow::{Result, bail, ensure};
use chpm_extmem::{Access, ExtmemError, MappedFile, Store};
use chpm_format::same::{self, Differences};
use chpm_format::verify::Fault;
use chpm_format::{Chpm, Report};
use chpm_mesh::Counted;
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm verify`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The mesh that it was built from ({meshes}): its triangles must be those of the leaves, but for small components that the build left out; not compared if detail was left out
    #[arg(long, value_name = "MESH")]
    against: Option<PathBuf>,
    /// Another .chpm file that must hold the same: the same clusters, errors and groups, bit for bit, and with them the same cuts. In which order they
    /// are, and how pages are stored, may differ
    #[arg(long, value_name = "FILE")]
    same_as: Option<PathBuf>,
    /// Draw N cuts and look for cracks, I7. Half of them are random legal cuts of every depth, half what random cameras
    /// select. All seams of every cut are looked at, cluster by cluster and on all processors: both sides must have the same
    /// vertices and edges. What is open, or lies at the same place, in the source is no crack
    #[arg(long, value_name = "N", value_parser = number::count(1..=u32::MAX))]
    cuts: Option<u32>,
    /// Prove that the stored errors and distances hold, I5: of every level with all its collapses done, and of the cuts of --cuts. Triangles are
    /// cut until each piece is near enough to one triangle of the other surface, with rounding on the safe side; nothing is sampled. What is neither
    /// proven nor refuted is a fault, too. The largest true distance is told as an interval. (Without its collapses a level is what the
    /// level below is with them; level 0 is the source.)
    #[arg(long, requires = "against")]
    errors: bool,
    /// Of the levels only this one; may be given several times
    #[arg(long, value_name = "N", requires = "errors")]
    level: Vec<u32>,
    /// Positions of each level's progressive meshes for --errors
    #[arg(long, value_name = "N", requires = "errors", default_value_t = 1, value_parser = number::count(1_u32..=1000))]
    positions: u32,
    /// Pieces that --errors may cut a triangle into for each triangle of the other surface that lies under it, about, before it leaves it undecided
    #[arg(long, value_name = "N", requires = "errors", default_value_t = 256, value_parser = number::count(1_u32..=1_000_000))]
    effort: u32,
    #[command(flatten)]
    threads: ThreadArgs,
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

/// Findings of all checks.
struct Findings {
    /// Every fault that is told in full, one a line.
    faults: Vec<String>,
    fault_count: u64,
    checked: Option<Report>,
    /// Whether detail of the source was left out, so that the leaves are not it.
    trimmed: bool,
    compared: Option<Comparison>,
    errors: Option<Certified>,
    cuts: Option<Cuts>,
    origin: [f64; 3],
}

/// Verifies, and prints faults one a line.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let pool = args.threads.pool()?;
    let findings = pool.install(|| verify(args, stop))?;
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
        Ok(file) => file.watched(MappedFile::note_read),
        // A file that does not even open is what a verification is there to find, not a failure to verify.
        Err(error) => {
            let faults = vec![format!("I10 bytes: {error}")];
            return Ok(Findings {
                faults,
                fault_count: 1,
                checked: None,
                trimmed: false,
                compared: None,
                errors: None,
                cuts: None,
                origin: [0.0; 3],
            });
        }
    };
    reading(&file, || look(&file, args, stop))
}

fn look(file: &Chpm<MappedFile>, args: &Args, stop: &Stop) -> Result<Findings> {
    let meter = Meter::new(args.quiet);
    let trimmed = file.is_trimmed();
    ensure!(
        !(args.errors && trimmed),
        "'{}' was built without detail below an error, so its leaves are not the source that --errors could be held against",
        args.file.display()
    );
    let levels = file.levels().len();
    if let Some(level) = args.level.iter().find(|level| **level as usize >= levels) {
        bail!("'{}' has no level {level}: its levels are 0 to {}", args.file.display(), levels - 1);
    }
    let mut own = if args.errors { certify::FOUND * file.clusters().len() as u64 } else { 0 };
    if args.cuts.is_some() {
        own += cuts::least(file);
    }
    let memory = memory::divide(file, args.storage.memory(), own)?;
    let (mut before, mut is_told) = (0, false);
    let checked = chpm_format::verify_within(file, memory, |done, all| {
        if !std::mem::replace(&mut is_told, true) {
            meter.start("verify", all);
        }
        meter.add(done - before);
        before = done;
    });
    meter.finish();
    let mut faults: Vec<String> = checked.faults.iter().map(told).collect();
    let mut fault_count = checked.fault_count;
    // Pages that cannot be read have been told; what their triangles were cannot be.
    let readable = checked.good_pages == file.clusters().len() as u64;
    // From here on there is a work directory to remove.
    let begin = |memory: u64| {
        let cancel = stop.heed();
        let scratch = args.storage.work_dir.clone().unwrap_or_else(std::env::temp_dir);
        Ok::<_, ExtmemError>((cancel, Store::create(&scratch, memory)?))
    };
    if let Some(other) = args.same_as.as_deref().filter(|_| readable) {
        let differences = same(file, other, &meter)?;
        let other = other.display();
        faults.extend(differences.told.iter().map(|told| format!("I9 not the same as '{other}': {told}")));
        fault_count += differences.count;
    }
    let compared = match &args.against {
        Some(source) if readable && !trimmed => {
            let (cancel, store) = begin(memory.saturating_sub(against::OWN))?;
            let compared = against::compare(file, source, &store, &meter, &cancel)?;
            faults.extend_from_slice(&compared.faults);
            fault_count += compared.fault_count;
            Some(compared)
        }
        _ => None,
    };
    let origin = file.header().origin;
    let errors = match &compared {
        Some(compared) if args.errors && compared.is_equal() => {
            let wanted = Wanted {
                levels: args.level.clone(),
                positions: args.positions,
                cuts: (args.seed, args.cuts.unwrap_or(0)),
                effort: args.effort,
            };
            let certified = certify::certify(file, &wanted, memory, &meter, &stop.heed())?;
            let (told, triangles) = certify::faults(&certified, origin);
            faults.extend(told);
            fault_count += triangles;
            Some(certified)
        }
        _ => None,
    };
    let cuts = match args.cuts {
        Some(count) if readable => {
            let (cancel, store) = begin(memory)?;
            let sound = Checked { file, is_even: checked.is_ok() };
            let cuts = cuts::check(sound, count, args.seed, &store, memory, &meter, &cancel)?;
            faults.extend_from_slice(&cuts.faults);
            fault_count += cuts.fault_count;
            Some(cuts)
        }
        _ => None,
    };
    Ok(Findings { faults, fault_count, checked: Some(checked), trimmed, compared, errors, cuts, origin })
}

/// Differences from another file.
fn same(file: &Chpm<MappedFile>, other: &Path, meter: &Meter) -> Result<Differences> {
    let other = open(other)?;
    let clusters = file.clusters().len() + other.clusters().len();
    meter.start("compare", clusters as u64);
    let differences = reading(&other, || Ok(same::compare(file, &other, || meter.add(1))?));
    meter.finish();
    differences
}

/// A fault as it is printed. Where its message names the place already, it is not named twice.
pub(super) fn told(fault: &Fault) -> String {
    let names_place = fault.message.starts_with(&fault.place.to_string());
    if names_place { format!("{}: {}", fault.invariant, fault.message) } else { fault.to_string() }
}

fn print(args: &Args, findings: &Findings, out: &mut impl Write) -> std::io::Result<()> {
    let path = args.file.display();
    if let Some(errors) = &findings.errors {
        certify::print(errors, out)?;
    }
    for fault in &findings.faults {
        writeln!(out, "{path}: {fault}")?;
    }
    if findings.fault_count > findings.faults.len() as u64 {
        writeln!(out, "{path}: and {} more", count(findings.fault_count - findings.faults.len() as u64))?;
    }
    if findings.fault_count > 0 {
        return writeln!(out, "{path}: {}", Counted(findings.fault_count, "fault"));
    }
    if let Some(report) = &findings.checked {
        let (pages, triangles) =
            (Counted(report.good_pages, "cluster"), Counted(report.triangles, "triangle"));
        writeln!(out, "{path}: sound; {pages} with {triangles} checked")?;
    }
    if let Some(other) = &args.same_as {
        writeln!(out, "{path}: holds the same as {}", other.display())?;
    }
    if let (Some(compared), Some(source)) = (&findings.compared, &args.against) {
        let triangles = Counted(compared.leaf_triangles, "triangle");
        write!(out, "{path}: the leaves are the {triangles} of {}", source.display())?;
        let mut without = Vec::new();
        if compared.copies > 0 {
            without.push(Counted(compared.copies, "copy").to_string());
        }
        if compared.small_components > 0 {
            without.push(compared.told_small());
        }
        match without.is_empty() {
            true => writeln!(out)?,
            false => writeln!(out, ", without {}", without.join(" and "))?,
        }
    }
    if findings.errors.is_some() {
        writeln!(out, "{path}: every stored distance holds, proven")?;
    }
    if let (true, Some(source)) = (findings.trimmed, &args.against) {
        let source = source.display();
        writeln!(
            out,
            "{path}: not compared with {source}: detail below an error was left out of the leaves"
        )?;
    }
    if let Some(cuts) = &findings.cuts {
        let (cuts, triangles) =
            (Counted(cuts.count.into(), "random cut"), Counted(cuts.triangles, "triangle"));
        writeln!(out, "{path}: no crack in {cuts} of {triangles} together")?;
    }
    Ok(())
}

fn as_json(args: &Args, findings: &Findings) -> Value {
    let display = |path: &Path| path.display().to_string();
    json!({
        "schema": "chpm-verify/1",
        "file": display(&args.file),
        "sound": findings.fault_count == 0,
        "fault_count": findings.fault_count,
        "faults": findings.faults,
        "clusters": findings.checked.as_ref().map(|report| report.good_pages),
        "triangles": findings.checked.as_ref().map(|report| report.triangles),
        "trimmed": findings.trimmed,
        "same_as": args.same_as.as_deref().map(display),
        "against": findings.compared.as_ref().map(|compared| json!({
            "source": args.against.as_deref().map(display),
            "equal": compared.is_equal(),
            "leaf_triangles": compared.leaf_triangles,
            "source_triangles": compared.source_triangles,
            "copies_left_out": compared.copies,
            "small_components_left_out": compared.small_components,
            "small_component_triangles_left_out": compared.small_component_triangles,
        })),
        "errors": findings.errors.as_ref().map(|errors| certify::as_json(errors, findings.origin)),
        "cuts": findings.cuts.as_ref().map(|cuts| json!({
            "count": cuts.count,
            "seed": cuts.seed,
            "triangles": cuts.triangles,
            "fault_count": cuts.fault_count,
        })),
    })
}
