//! The verbs, and what they have in common.

pub(crate) mod batch;
pub(crate) mod bench;
pub(crate) mod build;
pub(crate) mod clearance;
pub(crate) mod compare;
pub(crate) mod completions;
pub(crate) mod config;
pub(crate) mod contacts;
pub(crate) mod demo;
pub(crate) mod distance;
pub(crate) mod dump;
pub(crate) mod export;
pub(crate) mod extract;
pub(crate) mod info;
pub(crate) mod measure;
pub(crate) mod path;
pub(crate) mod rays;
pub(crate) mod relayout;
#[cfg(feature = "viewer")]
pub(crate) mod render;
pub(crate) mod report;
pub(crate) mod section;
#[cfg(feature = "web")]
pub(crate) mod serve;
#[cfg(feature = "web")]
pub(crate) mod share;
pub(crate) mod simplify;
pub(crate) mod stage;
pub(crate) mod stats;
pub(crate) mod synth;
pub(crate) mod thickness;
pub(crate) mod verify;
#[cfg(feature = "viewer")]
pub(crate) mod view;
pub(crate) mod visible;
pub(crate) mod walk;

use crate::cli::Command;
pub(crate) use crate::output::stdout;
use crate::stop::Stop;
use anyhow::{Context, Result, anyhow};
use chpm_export::ExportError;
use chpm_extmem::platform::STDIN;
use chpm_extmem::{ExtmemError, MappedFile, WorkDir};
use chpm_format::{Chpm, FilePart, FormatError};
use chpm_proximity::ProximityError;
use chpm_rays::RayError;
use chpm_refine::RefineError;
use chpm_report::ReportError;
use chpm_section::SectionError;
use chpm_verify::VerifyError;
use std::error::Error;
use std::fmt;
use std::path::{Path, PathBuf};

/// How a command ended that met no error.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Verdict {
    /// Everything is as it should be.
    Good,
    /// A verification found a fault.
    Faulty,
}

/// The file that a source stands for: `-` is standard input.
pub(crate) fn source(path: &Path) -> &Path {
    if path == Path::new("-") { Path::new(STDIN) } else { path }
}

/// Does what was asked for.
pub(crate) fn run(command: Command, stop: &Stop) -> Result<Verdict> {
    match command {
        Command::Build(args) => build::run(&args, stop),
        Command::Batch(args) => batch::run(&args, stop),
        Command::Stage(args) => stage::run(&args, stop),
        Command::Work(args) => stage::work(&args, stop),
        Command::Info(args) => info::run(&args),
        Command::Report(args) => report::run(&args, stop),
        Command::Config(args) => config::run(&args),
        Command::Completions(args) => completions::run(&args),
        Command::Man(args) => completions::man(&args),
        Command::Stats(args) => stats::run(&args, stop),
        Command::Verify(args) => verify::run(&args, stop),
        Command::Measure(args) => measure::run(&args, stop),
        Command::Distance(args) => distance::run(&args, stop),
        Command::Clearance(args) => clearance::run(&args, stop),
        Command::Contacts(args) => contacts::run(&args, stop),
        Command::Section(args) => section::run(&args, stop),
        Command::Rays(args) => rays::run(&args, stop),
        Command::Thickness(args) => thickness::run(&args, stop),
        Command::Visible(args) => visible::run(&args, stop),
        Command::Compare(args) => compare::run(&args, stop),
        Command::Bench(args) => bench::run(&args, stop),
        Command::Contend(args) => bench::contend(&args, stop),
        Command::Relayout(args) => relayout::run(&args, stop),
        Command::Dump(args) => dump::run(&args),
        Command::Extract(args) => extract::run(&args, stop),
        Command::Export(args) => export::run(&args, stop),
        Command::Simplify(args) => simplify::run(&args, stop),
        Command::Path(args) => path::run(&args, stop),
        #[cfg(feature = "viewer")]
        Command::Render(args) => render::run(&args, stop),
        #[cfg(feature = "viewer")]
        Command::View(args) => view::run(&args, stop),
        #[cfg(feature = "web")]
        Command::Serve(args) => serve::run(&args),
        #[cfg(feature = "web")]
        Command::Share(args) => share::run(&args, stop),
        Command::Walk(args) => walk::run(&args, stop),
        Command::Synth(args) => synth::run(&args, stop),
        Command::Demo(args) => demo::run(&args, stop),
    }
}

/// Maps and opens a file.
pub(crate) fn open(path: &Path) -> Result<Chpm<MappedFile>> {
    opened(MappedFile::open(path)?).with_context(|| format!("cannot open '{}'", path.display()))
}

/// Opens a file that is mapped, and its volumes beside it.
pub(crate) fn opened(map: MappedFile) -> Result<Chpm<MappedFile>, FormatError> {
    let path = map.real_path();
    Ok(Chpm::open_at(map, &path, MappedFile::open)?.watched(MappedFile::note_read))
}

/// Whether all that was read of a file up to now is as it was when it was opened.
pub(crate) fn check_unchanged(file: &Chpm<MappedFile>) -> Result<(), ExtmemError> {
    file.parts().try_for_each(MappedFile::check_unchanged)
}

/// Does what reads a file. Where the file was changed meanwhile, that is the error, whatever came of it; an error in what the
/// file holds names it.
pub(crate) fn reading<T>(file: &Chpm<MappedFile>, work: impl FnOnce() -> Result<T>) -> Result<T> {
    let result = work();
    check_unchanged(file)?;
    result.map_err(|error| {
        let is_of_file = error.chain().any(|cause| is_about(file, cause));
        match is_of_file && !error.is::<Unreadable>() {
            true => error.context(Unreadable(file.get_ref().path().to_owned())),
            false => error,
        }
    })
}

/// Whether a cause is that this file is damaged.
fn is_about(file: &Chpm<MappedFile>, cause: &(dyn Error + 'static)) -> bool {
    let own = |damage: &FormatError| is_found_in(file, damage);
    cause.downcast_ref().is_some_and(own)
        || matches!(cause.downcast_ref(), Some(RefineError::Format(damage)) if own(damage))
        || matches!(cause.downcast_ref(), Some(ExportError::Format(damage)) if own(damage))
        || matches!(cause.downcast_ref(), Some(ExportError::Orphan { .. }))
        || matches!(cause.downcast_ref(), Some(ProximityError::Format(damage)) if own(damage))
        || matches!(cause.downcast_ref(), Some(SectionError::Format(damage)) if own(damage))
        || matches!(cause.downcast_ref(), Some(RayError::Format(damage)) if own(damage))
        || cause.downcast_ref().and_then(VerifyError::damage).is_some_and(own)
        || cause.downcast_ref().and_then(ReportError::damage).is_some_and(own)
}

/// Whether what is wrong is so in this file. A page knows nothing of its file: where two are read, it is of the one that has it damaged still.
fn is_found_in(file: &Chpm<MappedFile>, damage: &FormatError) -> bool {
    match damage {
        FormatError::Checksum { place: FilePart::Page(id), .. }
        | FormatError::Value { place: FilePart::Page(id), .. }
        | FormatError::Truncated { place: FilePart::Page(id), .. }
        | FormatError::Version { place: FilePart::Page(id), .. } => {
            id.index() < file.clusters().len() && file.page(*id).is_err()
        }
        _ => true,
    }
}

/// The file that an error is about. Whoever reads another file meanwhile adds no name of its own.
#[derive(Debug)]
struct Unreadable(PathBuf);

impl fmt::Display for Unreadable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot read '{}'", self.0.display())
    }
}

/// A path as a word for the shell, to be copied into a command.
pub(crate) fn word(path: &Path) -> String {
    let text = path.display().to_string();
    // What begins with a dash would be taken for an option.
    let here = if text.starts_with('-') { "./" } else { "" };
    format!("'{here}{}'", text.replace('\'', "'\\''"))
}

/// A folder that is removed at the end.
pub(crate) fn temporary() -> Result<WorkDir> {
    let place = std::env::temp_dir();
    WorkDir::create(&place).map_err(|error| match error {
        ExtmemError::Io { source, .. } => {
            anyhow!("cannot make a temporary folder in '{}' ({}); set TMPDIR", place.display(), source.kind())
        }
        error => error.into(),
    })
}
