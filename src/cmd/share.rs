//! `chpm share`: a model, and the page that shows it, as a folder for any host of static files.

use super::{Verdict, build, open, relayout, stdout, word};
use crate::args::{Pages, build_memory};
use crate::batch::inputs;
use crate::folder::OutputFolder;
use crate::json::{self, made, named};
use crate::memory::MemoryArgs;
use crate::output;
use crate::progress::Meter;
use crate::shown::ShownArgs;
use crate::stop::Stop;
use crate::web::{Given, whole_page};
use anyhow::{Context, Result, ensure};
use chpm_build::config::Positions;
use chpm_build::{BuildConfig, Resources, Settings};
use chpm_extmem::{MappedFile, read_text};
use chpm_format::Chpm;
use chpm_mesh::{Bytes, Counted};
use serde_json::json;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Arguments of `chpm share`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file, or a mesh ({meshes}), which is built into the folder
    file: PathBuf,
    /// The folder to write; one that is there has to be empty
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// How the model's pages are stored [default: packed, or chained as a .chpm file has them]
    #[arg(long, value_name = "HOW", value_enum)]
    pages: Option<Pages>,
    /// Of a mesh: exact, lattice:auto or lattice:BITS, as in build [default: lattice:auto]
    #[arg(long, value_name = "HOW")]
    positions: Option<Positions>,
    /// The model in pieces, for hosts that send whole files only
    ///
    /// Such as python -m http.server. A page asks for those that it needs.
    #[arg(long)]
    split: bool,
    /// Notes at points of the model: a JSON list of {"at": [x, y, z], "title": "...", "text": "..."}, in the model's coordinates
    #[arg(long, value_name = "FILE")]
    notes: Option<PathBuf>,
    /// Replace the folder if it is an earlier one
    #[arg(short, long)]
    force: bool,
    /// What was written as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    shown: ShownArgs,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// The name that the model has in the folder.
const MODEL: &str = "model.chpm";
/// The folder of its pieces, where it is in pieces.
const PIECES: &str = "model";
/// The first of them.
const FIRST_PIECE: &str = "model/00000.bin";
/// The page's name there, which hosts show for the folder.
const INDEX: &str = "index.html";
/// Files in the folder, one of each kind.
const NAMES: [&str; 4] = [MODEL, FIRST_PIECE, INDEX, NOTES];
/// The name of its notes.
const NOTES: &str = "notes.json";
/// Most bytes of them.
const MOST_NOTES: u64 = 1 << 20;

/// Least bytes of a piece: fewer would be a request for every page.
const LEAST_PIECE: u64 = 128 << 10;
/// Most pieces of a file; larger files have larger ones.
const MOST_PIECES: u64 = 4096;

/// Writes the folder, which is whole or not there.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    output::check_folder("share", &args.output)?;
    let built = (!inputs::is_mesh(&args.file)).then(|| open(&args.file)).transpose()?;
    ensure!(
        built.is_none() || args.positions.is_none(),
        "'{}' is built, and keeps its positions: build its source with --positions, or share that",
        args.file.display()
    );
    let notes = args.notes.as_deref().map(read_notes).transpose()?;
    // What tells that a folder is one of these comes first.
    let mut names = NAMES.to_vec();
    if args.output.join(FIRST_PIECE).is_file() {
        names.insert(0, FIRST_PIECE);
    }
    let folder = OutputFolder::create(&args.output, args.force, &names, None)?;
    let model = folder.path(MODEL);
    let bytes = write_model(args, built.as_ref(), &model, stop)?;
    let mut given = Given {
        title: title(&args.file),
        name: Some(MODEL.to_owned()),
        notes: notes.as_ref().map(|_| NOTES),
        pieces: None,
    };
    let pieces = args.split.then(|| split(&folder, &model, bytes, stop)).transpose()?;
    given.pieces = pieces.map(|(piece, _)| json!({ "folder": PIECES, "length": piece, "size": bytes }));
    folder.write(INDEX, whole_page(&open(&model)?, &given)?.as_bytes())?;
    if let Some(notes) = notes {
        folder.write(NOTES, notes.as_bytes())?;
    }
    if args.split {
        fs::remove_file(&model).with_context(|| format!("cannot remove '{}'", model.display()))?;
    }
    folder.publish()?;
    output::finish(&args.output);
    tell(args, bytes, pieces.map(|(_, count)| count))
}

/// The title of a model that has none of its own: the name that somebody gave its file.
fn title(path: &Path) -> Option<String> {
    let stem =
        if inputs::is_mesh(path) { inputs::stem(path).ok()? } else { path.file_stem()?.to_str()?.to_owned() };
    (stem != "-").then_some(stem)
}

/// The notes of a file, if they are what they should be.
fn read_notes(path: &Path) -> Result<String> {
    /// A point of the model with text.
    #[derive(serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Note {
        at: [f64; 3],
        #[serde(rename = "title")]
        _title: String,
        #[serde(default, rename = "text")]
        _text: String,
    }
    let name = path.display();
    let text = read_text(path, MOST_NOTES).with_context(|| format!("cannot read '{name}'"))?;
    let notes: Vec<Note> = serde_json::from_str(&text).with_context(|| {
        format!("'{name}' has no notes: a list of {{\"at\": [x, y, z], \"title\": \"...\", \"text\": \"...\"}} is expected")
    })?;
    ensure!(
        notes.iter().flat_map(|note| note.at).all(f64::is_finite),
        "'{name}' has a point that is nowhere"
    );
    Ok(text)
}

/// The model in the folder: built, or stored anew; how long it is.
fn write_model(args: &Args, built: Option<&Chpm<MappedFile>>, model: &Path, stop: &Stop) -> Result<u64> {
    let shown = args.shown.settings();
    if let Some(file) = built {
        let found = if file.header().is_chained() { Pages::Chained } else { Pages::Packed };
        let how = (args.pages.unwrap_or(found), shown);
        return relayout::store_pages((file, &args.file), model, how, args.quiet, args.memory.clone(), stop);
    }
    let pages = args.pages.unwrap_or(Pages::Packed);
    let (packed, chained) = (pages != Pages::Raw, pages == Pages::Chained);
    // A page is looked at: digits finer than the model's detail need not be sent.
    let positions = args.positions.unwrap_or(Positions::Auto);
    let memory = build_memory(args.memory.memory())?;
    let config = BuildConfig {
        settings: Settings { packed, chained, shown, positions, ..Settings::default() },
        resources: Resources { memory, checkpoint: None, ..Resources::default() },
        ..BuildConfig::default()
    };
    Ok(build::build(&args.file, model, &config, &Meter::new(args.quiet), stop)?.output_len)
}

/// Writes the model in pieces; how long each is, and how many there are.
fn split(folder: &OutputFolder, model: &Path, bytes: u64, stop: &Stop) -> Result<(u64, u64)> {
    let piece = bytes.div_ceil(MOST_PIECES).next_power_of_two().max(LEAST_PIECE);
    let count = bytes.div_ceil(piece);
    folder.folder(PIECES)?;
    let failed = || format!("cannot read '{}'", model.display());
    let mut file = File::open(model).with_context(failed)?;
    let (cancel, mut buffer) = (stop.heed(), Vec::new());
    for number in 0..count {
        crate::stop::check(&cancel)?;
        buffer.clear();
        (&mut file).take(piece).read_to_end(&mut buffer).with_context(failed)?;
        folder.write(&format!("{PIECES}/{number:05}.bin"), &buffer)?;
    }
    Ok((piece, count))
}

/// Says what was written.
fn tell(args: &Args, bytes: u64, pieces: Option<u64>) -> Result<Verdict> {
    let (mut out, model) = (stdout(), args.output.join(MODEL));
    if args.json {
        let shared = made::Share {
            schema: "chpm-share/1",
            file: named(&args.file),
            output: named(&args.output),
            model: pieces.is_none().then(|| named(&model)),
            model_bytes: bytes,
            pieces: pieces.unwrap_or(1),
        };
        json::print(&shared, &mut out)?;
        out.flush()?;
        return Ok(Verdict::Good);
    }
    let folder = args.output.display();
    match pieces {
        Some(count) => {
            let count = Counted(count, "piece");
            writeln!(
                out,
                "{folder}: a model of {} in {count}; put this folder on any host of static files",
                Bytes(bytes)
            )?;
            writeln!(out, "to try it here: python3 -m http.server --directory {}", word(&args.output))?;
        }
        None => {
            writeln!(
                out,
                "{folder}: a model of {}; put this folder on any host of static files that answers range requests \
                 (--split is for those that do not)",
                Bytes(bytes)
            )?;
            writeln!(out, "to try it here: chpm serve {}", word(&model))?;
        }
    }
    out.flush()?;
    Ok(Verdict::Good)
}
