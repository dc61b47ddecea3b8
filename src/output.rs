//! Where a verb's result goes: into a file that appears complete or not at all, or to standard output.

use crate::escape::Escaped;
use crate::inputs;
use anyhow::{Result, bail, ensure};
use chpm_extmem::{AtomicFile, ExtmemError};
use std::io::{self, BufWriter, StdoutLock, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Names that stand for standard output.
const STDOUT: [&str; 4] = ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"];

/// Formats that a verb, or one of its options, writes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Writes {
    by: &'static str,
    format: &'static str,
    /// Whether it can be written front to back.
    streams: bool,
    /// Whether somebody said that it is this format.
    is_chosen: bool,
}

const fn writes(by: &'static str, format: &'static str) -> Writes {
    Writes { by, format, streams: true, is_chosen: false }
}

pub(crate) const BUILD: Writes = Writes { streams: false, ..writes("build", "CHPM") };
pub(crate) const RELAYOUT: Writes = Writes { streams: false, ..writes("relayout", "CHPM") };
pub(crate) const BUILD_TRACE: Writes = Writes { streams: false, ..writes("build --trace", "JSON") };
pub(crate) const TILES: Writes =
    Writes { streams: false, ..writes("a build of several sources", "a list of tiles") };
pub(crate) const EXPORT: Writes =
    Writes { streams: false, ..writes("export --3dtiles", "a 3D Tiles archive") };
pub(crate) const EXPORT_MESHLETS: Writes =
    Writes { streams: false, ..writes("export --meshlets", "meshlets") };
pub(crate) const SYNTH: Writes = writes("synth", "PLY");
pub(crate) const PATH: Writes = writes("path", "a camera path");
pub(crate) const COMPARE_SVG: Writes = writes("compare --svg", "SVG");
pub(crate) const COMPARE_HTML: Writes = writes("compare --html", "HTML");
pub(crate) const CONTACTS_CSV: Writes = writes("contacts --csv", "CSV");
pub(crate) const CLEARANCE_CSV: Writes = writes("clearance --csv", "CSV");
pub(crate) const DISTANCE_CSV: Writes = writes("distance --csv", "CSV");
pub(crate) const WALK_CSV: Writes = writes("walk --csv", "CSV");
pub(crate) const REPORT: Writes = writes("report", "HTML");
pub(crate) const THICKNESS_SVG: Writes = writes("thickness --svg", "SVG");
pub(crate) const VISIBLE_SVG: Writes = writes("visible --svg", "SVG");
pub(crate) const RAYS: [Writes; 2] = [writes("rays", "CSV"), writes("rays", "NumPy")];
pub(crate) const SECTION: [Writes; 4] = [
    writes("section", "SVG"),
    writes("section", "DXF"),
    writes("section", "GeoJSON"),
    writes("section", "CSV"),
];
pub(crate) const STATS_CSV: Writes = writes("stats --csv", "CSV");
pub(crate) const BENCH_CSV: Writes = writes("bench --csv", "CSV");
pub(crate) const BENCH_SVG: Writes = writes("bench --svg", "SVG");
#[cfg(feature = "viewer")]
pub(crate) const WALK_PLOT: Writes = writes("walk --plot", "SVG");
#[cfg(feature = "viewer")]
pub(crate) const RENDER: Writes = writes("render", "PNG");
#[cfg(feature = "viewer")]
pub(crate) const SCREENSHOT: Writes = Writes { streams: false, ..writes("view --screenshot", "PNG") };

/// Extensions that promise a format, whether it is written or not.
#[rustfmt::skip]
const EXTENSIONS: &[(&str, &str)] = &[
    ("chpm", "CHPM"), ("ply", "PLY"), ("stl", "STL"), ("obj", "OBJ"), ("glb", "GLB"), ("gltf", "glTF"),
    ("path", "a camera path"), ("csv", "CSV"), ("html", "HTML"), ("htm", "HTML"), ("svg", "SVG"), ("png", "PNG"),
    ("3dm", "Rhino"), ("3ds", "3DS"), ("3mf", "3MF"), ("3tz", "a 3D Tiles archive"), ("abc", "Alembic"), ("amf", "AMF"), ("blend", "Blender"), ("bmp", "BMP"),
    ("conf", "a list of range scans"), ("ctm", "OpenCTM"), ("dae", "COLLADA"), ("drc", "Draco"), ("dxf", "DXF"), ("e57", "E57"),
    ("exr", "OpenEXR"), ("fbx", "FBX"), ("geojson", "GeoJSON"), ("gif", "GIF"), ("gz", "gzip"), ("iges", "IGES"), ("igs", "IGES"),
    ("npy", "NumPy"), ("jpeg", "JPEG"), ("jpg", "JPEG"), ("json", "JSON"), ("las", "LAS"), ("laz", "LAZ"), ("meshlets", "meshlets"), ("mp4", "MP4"), ("nii", "NIfTI"), ("off", "OFF"),
    ("pcd", "PCD"), ("pdf", "PDF"), ("pts", "points"), ("step", "STEP"), ("stp", "STEP"), ("tar", "tar"), ("tif", "TIFF"),
    ("tiff", "TIFF"), ("tiles", "a list of tiles"), ("toml", "TOML"), ("tsv", "TSV"), ("txt", TEXT), ("usd", "USD"), ("usda", "USD"), ("usdc", "USD"), ("usdz", "USD"),
    ("vtk", "VTK"), ("vtp", "VTK"), ("vtu", "VTK"), ("webm", "WebM"), ("webp", "WebP"), ("wrl", "VRML"), ("x3d", "X3D"), ("xml", "XML"),
    ("xyz", "points"), ("zip", "zip"), ("zst", "zstd"),
];
/// Format of text, whatever its name.
const TEXT: &str = "text";

/// Format that a name promises.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Promise {
    /// Nothing: it has no extension.
    Nothing,
    /// This one.
    Format(&'static str),
    /// One that nobody here has heard of.
    Unknown,
}

/// The format that a name promises.
pub(crate) fn promised(path: &Path) -> Promise {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if is_stdout(path) || extension.is_empty() {
        return Promise::Nothing;
    }
    let known = EXTENSIONS.iter().find(|(known, _)| *known == extension);
    known.map_or(Promise::Unknown, |(_, format)| Promise::Format(format))
}

/// Refuses to call a folder as a file of some format is called. What has another extension may be one.
pub(crate) fn check_folder(by: &str, path: &Path) -> Result<()> {
    ensure!(
        !is_stdout(path),
        "{by} makes a folder, which cannot go to standard output ('{}'): name one",
        path.display()
    );
    if let Promise::Format(format) = promised(path)
        && !path.is_dir()
    {
        bail!("{by} makes a folder, and '{}' is a name for {format}: choose another", path.display());
    }
    Ok(())
}

/// Reason against a name, for an error that says what is written: `is a name for FBX`.
pub(crate) fn otherwise(path: &Path) -> String {
    match promised(path) {
        Promise::Format(name) => format!("'{}' is a name for {name}", path.display()),
        _ => format!("'{}' is a name for something else", path.display()),
    }
}

impl Writes {
    /// A mesh in a format that may be chosen.
    pub(crate) fn mesh(by: &'static str, format: &'static str) -> Self {
        // A glTF has its buffer beside it.
        Writes { streams: ![BUILD.format, "glTF"].contains(&format), ..writes(by, format) }
    }

    /// Name of the format.
    pub(crate) fn format(self) -> &'static str {
        self.format
    }

    /// The same where the format was told beside the name, which then may be any that promises no other.
    pub(crate) fn chosen(self) -> Self {
        Writes { is_chosen: true, ..self }
    }

    /// Whether a name promises nothing else.
    fn suits(self, path: &Path) -> bool {
        match promised(path) {
            Promise::Nothing => true,
            Promise::Format(TEXT) => [PATH.format, WALK_CSV.format].contains(&self.format),
            Promise::Format(format) => format == self.format,
            Promise::Unknown => self.is_chosen,
        }
    }

    /// Refuses a name that promises another format, and standard output where the file cannot be streamed.
    pub(crate) fn check(self, path: &Path) -> Result<()> {
        let Writes { by, format, streams, .. } = self;
        if is_stdout(path) {
            ensure!(streams, "{by} cannot write to standard output ('{}'): name a file", path.display());
            return Ok(());
        }
        let own = EXTENSIONS.iter().find(|(_, known)| *known == format).map_or("", |(own, _)| *own);
        ensure!(
            self.suits(path),
            "{by} writes {format}, and {}: call it .{own}, or leave the extension out",
            otherwise(path)
        );
        Ok(())
    }

    /// Opens `path` to write it, before the work starts. It must be none of the `inputs`.
    pub(crate) fn create(self, path: &Path, force: bool, inputs: &[&Path]) -> Result<Output> {
        self.check(path)?;
        if is_stdout(path) {
            return Ok(Output::Stdout(stdout_of_bytes()));
        }
        Ok(Output::File(self.create_file(path, force, inputs)?))
    }

    /// The same of what is not streamed, and so is a file.
    pub(crate) fn create_file(self, path: &Path, force: bool, inputs: &[&Path]) -> Result<AtomicFile> {
        self.check(path)?;
        inputs::refuse(path, inputs)?;
        Ok(AtomicFile::create(path, force)?)
    }
}

pub(crate) fn is_stdout(path: &Path) -> bool {
    STDOUT.iter().any(|name| path.as_os_str() == *name)
}

/// How a verb of many answers tells them.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct TellArgs {
    /// Write a line of numbers for each of what was asked for (poses, contacts, frames); - for standard output
    #[arg(long, value_name = "FILE")]
    pub(crate) csv: Option<PathBuf>,
    /// Replace files that exist
    #[arg(short, long)]
    pub(crate) force: bool,
    /// The result as JSON on stdout
    #[arg(long)]
    pub(crate) json: bool,
    /// No progress, no notes
    #[arg(short, long)]
    pub(crate) quiet: bool,
}

impl TellArgs {
    /// The CSV that is to be written, if one is, and where the rest is told.
    pub(crate) fn open(&self, writes: Writes, inputs: &[&Path]) -> Result<(Option<Output>, Box<dyn Write>)> {
        let csv = self.csv.as_ref().map(|path| writes.create(path, self.force, inputs)).transpose()?;
        let out = messages(&csv, self.json, self.quiet)?;
        Ok((csv, out))
    }
}

/// A result that is being written.
pub(crate) enum Output {
    File(AtomicFile),
    Stdout(BufWriter<Stdout>),
}

impl Output {
    /// All is written: a file gets its name.
    pub(crate) fn publish(self) -> Result<()> {
        match self {
            Output::File(file) => {
                let path = file.path().to_owned();
                file.publish()?;
                finish(&path);
            }
            mut stdout @ Output::Stdout(_) => stdout.flush()?,
        }
        Ok(())
    }

    /// Whether it is standard output.
    pub(crate) fn is_stream(&self) -> bool {
        matches!(self, Output::Stdout(_))
    }
}

/// Where a verb with these outputs says what it did: on standard output, or on standard error if a result goes there. With `quiet`
/// it then says nothing; with `json` what it says is a result, too.
pub(crate) fn messages<'a>(
    outputs: impl IntoIterator<Item = &'a Output>,
    json: bool,
    quiet: bool,
) -> Result<Box<dyn Write>> {
    match outputs.into_iter().filter(|output| output.is_stream()).count() {
        0 => Ok(Box::new(stdout())),
        1 if !json && quiet => Ok(Box::new(io::sink())),
        1 if !json => Ok(Box::new(Escaped(io::stderr()))),
        _ => {
            bail!("only one result can go to standard output; name files for the others, or leave out --json")
        }
    }
}

/// Where results go that are text. To be flushed at the end: what is dropped cannot tell that writing failed.
pub(crate) fn stdout() -> Escaped<BufWriter<Stdout>> {
    Escaped(stdout_of_bytes())
}

/// The same for files, byte by byte.
fn stdout_of_bytes() -> BufWriter<Stdout> {
    BufWriter::new(Stdout(io::stdout().lock()))
}

/// Standard output, whose errors say so.
pub(crate) struct Stdout(StdoutLock<'static>);

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes).map_err(placed)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush().map_err(placed)
    }
}

/// Results that have their names, in this order.
static FINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A result of this process has its name: whatever goes wrong from now on, it is complete.
pub(crate) fn finish(path: &Path) {
    FINISHED.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_owned());
}

/// Outputs that are complete.
pub(crate) fn finished() -> Vec<PathBuf> {
    std::mem::take(&mut FINISHED.lock().unwrap_or_else(PoisonError::into_inner))
}

/// An error of standard output that says so.
pub(crate) fn placed(source: io::Error) -> io::Error {
    let kind = source.kind();
    io::Error::new(kind, ExtmemError::io("write", Path::new("standard output"), 0, source))
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Output::File(file) => file.write(bytes),
            Output::Stdout(stdout) => stdout.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Output::File(file) => file.flush(),
            Output::Stdout(stdout) => stdout.flush(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_promises_at_most_what_is_written() {
        for (writes, good, bad) in [
            (
                BUILD,
                "a.chpm a.CHPM a .ply a.",
                "a.ply a.obj a.stl a.glb a.png a.PLY a.chpm.gz a.v2 a.chpm.old a.txt",
            ),
            (
                Writes::mesh("extract", "PLY"),
                "a.ply a a.",
                "a.glb a.obj a.stl a.chpm a.png a.ply.gz a.ply.zst a.fbx a.dae a.usdz a.ply.1 a.txt a.xyz a.\u{fc}",
            ),
            (
                Writes::mesh("extract", "PLY").chosen(),
                "a.ply a.ply.1 a.mesh",
                "a.stl a.FBX a.dae a.usdz a.txt",
            ),
            (SYNTH, "a.ply a", "a.chpm a.stl a.mesh"),
            (PATH, "a.path a.txt", "a.csv a.chpm a.xml"),
            (WALK_CSV, "a.csv a.txt", "a.json a.ply a.tsv a.xlsx"),
            (REPORT, "a.html a.htm", "a.pdf a.txt a.xhtml"),
            (BENCH_SVG, "a.svg a", "a.png a.eps"),
        ] {
            for name in good.split(' ') {
                assert!(writes.check(Path::new(name)).is_ok(), "{writes:?} {name}");
            }
            for name in bad.split(' ') {
                let error = writes.check(Path::new(name)).unwrap_err().to_string();
                assert!(error.contains(writes.format) && error.contains(name), "{error}");
            }
        }
    }

    #[test]
    fn a_folder_is_not_called_as_a_file_is() {
        for good in ["out", "example.org", "site.v2", "."] {
            assert!(check_folder("share", Path::new(good)).is_ok(), "{good}");
        }
        for bad in ["index.html", "a.zip", "a/b.glb", "a.chpm", "-", "/dev/stdout"] {
            let error = check_folder("share", Path::new(bad)).unwrap_err().to_string();
            assert!(error.contains("folder") && error.contains(bad), "{error}");
        }
    }

    #[test]
    fn standard_output_has_four_names() {
        for name in STDOUT {
            assert!(SYNTH.check(Path::new(name)).is_ok() && is_stdout(Path::new(name)));
            assert!(BUILD.check(Path::new(name)).unwrap_err().to_string().contains("name a file"));
        }
        assert!(!["./-", "-.ply", "/dev/stderr", "/dev/null"].iter().any(|name| is_stdout(Path::new(name))));
    }
}
