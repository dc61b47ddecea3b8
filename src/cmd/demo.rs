//! `chpm demo`: the whole way once, with a generated model.

use super::{Verdict, build, open, stdout, synth, temporary, word};
use crate::number;
use crate::output::{self, Output};
use crate::progress::Meter;
use crate::stop::Stop;
use anyhow::{Context, Result, ensure};
use chpm_build::{BuildConfig, Resources};
use chpm_extmem::{AtomicFile, Store};
use chpm_import::ply::Encoding;
use chpm_mesh::Counted;
use chpm_synth::{Shape, Synth};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm demo`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// Where to leave the model and the built file; a temporary folder that is removed if not given
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Triangles of the model to aim for
    #[arg(long, value_name = "N", default_value_t = 200_000,
          value_parser = number::count(1_000_u64..=100_000_000))]
    triangles: u64,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
}

const SEED: u64 = 1;

/// Generates, builds, verifies, and says what to try next.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    match &args.keep {
        Some(folder) => {
            output::check_folder("demo --keep", folder)?;
            fs::create_dir_all(folder).with_context(|| format!("cannot create '{}'", folder.display()))?;
            show(args, folder, stop)
        }
        None => {
            let folder = temporary()?;
            show(args, folder.path(), stop)
        }
    }
}

fn show(args: &Args, folder: &Path, stop: &Stop) -> Result<Verdict> {
    let (source, output) = (folder.join("demo.ply"), folder.join("demo.chpm"));
    let meter = Meter::new(args.quiet);
    let cancel = stop.heed();
    let config = BuildConfig::default();
    // Whatever is refused is refused before the work: the built file's name too.
    for path in [&source, &output] {
        ensure!(!path.exists(), "'{}' is there already: choose another folder for --keep", path.display());
    }
    drop(AtomicFile::create(&output, config.overwrite)?);
    let file = Output::File(AtomicFile::create(&source, false)?);
    let model = Synth::new(Shape::Isosurface, args.triangles, SEED);
    synth::write(&model, file, Encoding::BinaryLittleEndian, "chpm demo", &meter, &cancel)?;
    let report = build::build(&source, &output, &config, &meter, stop)?;

    let chpm = open(&output)?;
    let checked = chpm_format::verify(&chpm, |_, _| {});
    let store = Store::create(folder, Resources::default().memory.0)?;
    let compared = chpm_verify::against::compare(&chpm, &source, &store, &meter, &cancel)?;

    let mut out = stdout();
    build::print(&report, &output, false, &mut out)?;
    let sound = checked.is_ok() && compared.is_equal();
    if sound {
        let triangles = Counted(compared.leaf_triangles, "triangle");
        writeln!(out, "verified: every invariant holds, and the leaves are the source's {triangles}")?;
    } else {
        let faults = checked.faults.iter().map(chpm_verify::describe);
        for fault in faults.chain(compared.faults.iter().map(ToString::to_string)) {
            writeln!(out, "{fault}")?;
        }
        writeln!(out, "the verification found faults; please report this")?;
    }
    writeln!(out, "next:")?;
    if args.keep.is_none() {
        writeln!(out, "  chpm demo --keep demo          the same, and the files stay")?;
        writeln!(out, "  chpm build scan.ply            your own mesh")?;
    } else {
        let triangles = build::small(&output)?;
        let output = word(&output);
        writeln!(out, "  chpm info {output}")?;
        writeln!(out, "  chpm verify {output} --cuts 100")?;
        writeln!(out, "  chpm extract {output} --triangles {triangles} -o small.ply")?;
        writeln!(out, "  chpm dump {output} | less")?;
    }
    out.flush()?;
    Ok(if sound { Verdict::Good } else { Verdict::Faulty })
}
