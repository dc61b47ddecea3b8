//! `chpm verify`: every byte and invariant of a file, with `--against` its leaves and the source, with `--errors` what it says of distances, with `--cuts` random cuts.

use super::{Verdict, open, opened, reading, stdout};
use crate::args::StorageArgs;
use crate::certified;
use crate::json::{self, judged, named};
use crate::number;
use crate::progress::Meter;
use crate::report::count;
use crate::stop::Stop;
use crate::threads::ThreadArgs;
use anyhow::Result;
use chpm_extmem::{Access, MappedFile};
use chpm_format::Chpm;
use chpm_format::same::{self, Differences, Extent};
use chpm_mesh::Counted;
use chpm_verify::{Checks, Verification};
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
    /// Compare with --same-as positions, triangles, collapses, errors and groups alone, whatever vertices have besides and whatever images show
    #[arg(long, requires = "same_as")]
    geometry: bool,
    /// Draw N cuts and look for cracks, I7. Half of them are random legal cuts of every depth, half what random cameras
    /// select. All borders of every cut are looked at, cluster by cluster and on all processors: both sides must have the same
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

/// Verifies, and prints faults one a line.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let pool = args.threads.pool()?;
    let findings = pool.install(|| verify(args, stop))?;
    let mut out = stdout();
    if args.json {
        json::print(&as_json(args, &findings), &mut out)?;
    } else {
        print(args, &findings, &mut out)?;
    }
    out.flush()?;
    Ok(if findings.fault_count == 0 { Verdict::Good } else { Verdict::Faulty })
}

fn verify(args: &Args, stop: &Stop) -> Result<Verification> {
    match opened(MappedFile::open(&args.file)?) {
        Ok(file) => {
            file.parts().for_each(|part| part.advise(Access::Sequential));
            reading(&file, || look(&file, args, stop))
        }
        // A file that does not even open is what a verification is there to find, not a failure to verify.
        Err(error) => Ok(Verification::unopened(&error)),
    }
}

fn look(file: &Chpm<MappedFile>, args: &Args, stop: &Stop) -> Result<Verification> {
    let meter = Meter::new(args.quiet);
    let checks = Checks {
        against: args.against.clone(),
        errors: args.errors,
        levels: args.level.clone(),
        positions: args.positions,
        effort: args.effort,
        cuts: args.cuts,
        seed: args.seed,
    };
    let scratch = args.storage.work_dir.clone().unwrap_or_else(std::env::temp_dir);
    let mut found =
        chpm_verify::verify(file, &checks, args.storage.memory(), &scratch, &meter, &stop.heed())?;
    if let Some(other) = args.same_as.as_deref().filter(|_| found.is_readable(file)) {
        let extent = if args.geometry { Extent::Geometry } else { Extent::All };
        let differences = same(file, other, extent, &meter)?;
        let other = other.display();
        let told = differences.told.iter().map(|told| format!("I9 not the same as '{other}': {told}"));
        found.add(&told.collect::<Vec<_>>(), differences.count);
    }
    Ok(found)
}

/// Differences from another file.
fn same(file: &Chpm<MappedFile>, other: &Path, extent: Extent, meter: &Meter) -> Result<Differences> {
    let other = open(other)?;
    let clusters = file.clusters().len() + other.clusters().len();
    meter.start("compare", clusters as u64);
    let differences = reading(&other, || Ok(same::compare_to(extent, file, &other, || meter.add(1))?));
    meter.finish();
    differences
}

fn print(args: &Args, findings: &Verification, out: &mut impl Write) -> std::io::Result<()> {
    let path = args.file.display();
    if let Some(errors) = &findings.errors {
        certified::print(errors, out)?;
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
        let what = if args.geometry { "has the geometry of" } else { "holds the same as" };
        writeln!(out, "{path}: {what} {}", other.display())?;
    }
    if let (Some(compared), Some(source)) = (&findings.compared, &args.against) {
        let triangles = Counted(compared.leaf_triangles, "triangle");
        write!(out, "{path}: the leaves are the {triangles} of {}", source.display())?;
        let mut without = Vec::new();
        if compared.copies > 0 {
            without.push(Counted(compared.copies, "copy").to_string());
        }
        if compared.small_components > 0 {
            without.push(compared.small_components_message());
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

/// All of it, for programs.
fn as_json(args: &Args, findings: &Verification) -> judged::Verify {
    let against = findings.compared.as_ref().map(|compared| judged::Against {
        source: args.against.as_deref().map(named),
        equal: compared.is_equal(),
        leaf_triangles: compared.leaf_triangles,
        source_triangles: compared.source_triangles,
        copies_left_out: compared.copies,
        small_components_left_out: compared.small_components,
        small_component_triangles_left_out: compared.small_component_triangles,
    });
    let cuts = findings.cuts.as_ref().map(|cuts| judged::Cuts {
        count: cuts.count,
        seed: cuts.seed,
        triangles: cuts.triangles,
        fault_count: cuts.fault_count,
    });
    judged::Verify {
        schema: "chpm-verify/1",
        file: named(&args.file),
        sound: findings.fault_count == 0,
        fault_count: findings.fault_count,
        faults: findings.faults.clone(),
        clusters: findings.checked.as_ref().map(|report| report.good_pages),
        triangles: findings.checked.as_ref().map(|report| report.triangles),
        trimmed: findings.trimmed,
        same_as: args.same_as.as_deref().map(named),
        against,
        errors: findings.errors.as_ref().map(|errors| certified::as_json(errors, findings.origin)),
        cuts,
    }
}
