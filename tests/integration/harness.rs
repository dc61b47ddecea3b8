//! A fresh folder and the command in it.

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use chpm_import::ply::{Encoding, Options, read_mesh, write_mesh};
use chpm_mesh::TriMesh;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::env;
use std::fmt::Display;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{self, Child, ExitStatus, Stdio};
use tempfile::TempDir;

/// The command's executable; or that of another system, when `tests/targets.sh` compiles these tests.
pub(crate) const CHPM: &str = match option_env!("CHPM_PROGRAM") {
    Some(program) => program,
    None => env!("CARGO_BIN_EXE_chpm"),
};

/// Whether a process was killed; a program for Windows tells so by its code.
pub(crate) fn was_killed(status: ExitStatus) -> bool {
    let by_code = option_env!("CHPM_PROGRAM").is_some() && status.code() == Some(1);
    status.signal() == Some(Signal::SIGKILL as i32) || by_code
}

/// Says that a test does less than it could, and why: at once, and in the list that `tests/all.sh` ends with.
pub(crate) fn skipped(why: impl Display) {
    println!("skipped: {why}");
    if let Some(list) = env::var_os("CHPM_SKIPPED") {
        let mut list =
            File::options().append(true).create(true).open(list).expect("the list of what is skipped");
        writeln!(list, "{why}").expect("the list of what is skipped");
    }
}

/// How much of something that finds more the longer it goes on: the second with `tests/soak.sh`.
pub(crate) fn much<T>(usual: T, long: T) -> T {
    if env::var_os("CHPM_SOAK").is_some() { long } else { usual }
}

/// A shell in the folder that finds `chpm`.
pub(crate) fn shell(folder: &Folder, line: &str) -> process::Output {
    let path = format!(
        "{}:{}",
        Path::new(CHPM).parent().expect("a folder").display(),
        std::env::var("PATH").unwrap_or_default()
    );
    let mut command = process::Command::new("sh");
    // Where none is named, a terminal shows no bars.
    command.current_dir(folder.path("")).env("PATH", path).env("TERM", "xterm").args(["-c", line]);
    command.output().expect("a shell")
}

/// A folder that is removed at the end, and the command run in it.
pub(crate) struct Folder(TempDir);

/// Corner positions by their bits, the smallest corner first; ordered.
pub(crate) type Triangles = Vec<[[u32; 3]; 3]>;

impl Folder {
    pub(crate) fn new() -> Self {
        Folder(tempfile::tempdir().expect("a temporary folder"))
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs `chpm` with words separated by blanks.
    pub(crate) fn chpm(&self, words: &str) -> Assert {
        Command::new(CHPM).current_dir(self.0.path()).args(words.split_whitespace()).assert()
    }

    /// Runs `chpm`, which must succeed, and answers what it wrote to stdout.
    pub(crate) fn stdout(&self, words: &str) -> String {
        text(&self.chpm(words).success().get_output().stdout)
    }

    /// Runs `chpm`, which must end with `code`, and answers what it wrote to stderr.
    pub(crate) fn stderr(&self, words: &str, code: i32) -> String {
        text(&self.chpm(words).code(code).get_output().stderr)
    }

    /// The command to be spawned, for tests that talk to it while it runs.
    pub(crate) fn command(&self, words: &str) -> process::Command {
        let mut command = process::Command::new(CHPM);
        command.current_dir(self.0.path()).args(words.split_whitespace());
        command
    }

    /// Runs `chpm`, sends it a signal when it tells that a stage begins, and answers how it ended and what it told after that.
    pub(crate) fn signalled(&self, words: &str, stage: &str, signal: Signal) -> (ExitStatus, Vec<String>) {
        // Under `nohup` the tests ignore what this process is to hear.
        let mut command = process::Command::new("env");
        command.arg("--default-signal=HUP").arg(CHPM).args(words.split_whitespace());
        command.current_dir(self.0.path()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("a process");
        let mut lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
        let begun = |line: &String| line.starts_with(stage);
        lines.by_ref().map_while(Result::ok).find(begun).expect("the stage begins");
        send(&child, signal);
        let rest = lines.map_while(Result::ok).collect();
        (child.wait().expect("an end"), rest)
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).expect("a file written");
    }

    pub(crate) fn write_mesh(&self, name: &str, mesh: &TriMesh) {
        let file = File::create(self.path(name)).expect("a file created");
        write_mesh(file, mesh, Encoding::BinaryLittleEndian).expect("a mesh written");
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).expect("a file read")
    }

    pub(crate) fn read_mesh(&self, name: &str) -> TriMesh {
        let file = File::open(self.path(name)).expect("a file opened");
        read_mesh(file, Options::default()).expect("a mesh read").0
    }

    /// Names of everything in the folder, hidden or not.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).expect("a folder read");
        let name = |entry: std::io::Result<fs::DirEntry>| {
            entry.expect("an entry read").file_name().to_string_lossy().into_owned()
        };
        let mut names: Vec<String> = entries.map(name).collect();
        names.sort();
        names
    }
}

/// The root of the repository.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A mesh as a multiset of triangles, whatever its numbering.
pub(crate) fn triangles(mesh: &TriMesh) -> Triangles {
    let canonical = |corners: &[u32; 3]| {
        let [a, b, c] = mesh.corners(*corners).map(|corner| corner.map(f32::to_bits));
        [a, b, c].min([b, c, a]).min([c, a, b])
    };
    let mut triangles: Triangles = mesh.triangles.iter().map(canonical).collect();
    triangles.sort_unstable();
    triangles
}

/// Sends a signal to a process that was not waited for.
pub(crate) fn send(child: &Child, signal: Signal) {
    // It keeps its id until then, so this reaches no other process.
    let id = i32::try_from(child.id()).expect("a process id");
    kill(Pid::from_raw(id), signal).expect("a signal sent");
}
