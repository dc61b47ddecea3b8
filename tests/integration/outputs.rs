//! What is written, and where: what is never replaced, what streams, which names are refused, and what errors say. Devices, FIFOs and links
//! are the test's own.

use super::harness::{CHPM, Folder, send, skipped, text};
use nix::sys::signal::Signal;
use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use std::ffi::OsStr;
use std::fs::{self, FileType};
use std::io::{BufRead, BufReader};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A model, built, and a camera path for it.
fn ball() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 6000 -o ball.ply -q");
    folder.stdout("build ball.ply -q --cluster-triangles 512");
    folder.stdout("path orbit ball.chpm --frames 2 -o ball.path");
    folder
}

/// All that writes a file called `NAME`, and whether it can stream.
const WRITERS: [(&str, bool); 7] = [
    ("build ball.ply -q -f -o NAME", false),
    ("extract ball.chpm --level 0 -q -f -o NAME", true),
    ("synth sphere --triangles 3000 -q -f -o NAME", true),
    ("path orbit ball.chpm --frames 2 -f -o NAME", true),
    ("walk ball.chpm ball.path -q -f --csv NAME", true),
    ("bench ball.ply --runs 1 --samples 1 --only meshopt-simplify -q -f --csv NAME", true),
    ("section ball.chpm --plane 0,0,1:0 -q -f -o NAME", true),
];

fn writing(words: &str, name: &str) -> String {
    words.replace("NAME", name)
}

fn kind(folder: &Folder, name: &str) -> FileType {
    folder.path(name).symlink_metadata().expect("it is there").file_type()
}

#[test]
fn force_replaces_nothing_but_regular_files() {
    let folder = ball();
    mkfifo(&folder.path("fifo"), Mode::S_IRWXU).expect("a FIFO");
    let _socket = UnixListener::bind(folder.path("socket")).expect("a socket");
    fs::create_dir(folder.path("dir")).expect("a folder");
    symlink("fifo", folder.path("link")).expect("a link");
    symlink("nothing", folder.path("dangling")).expect("a link");
    let before = folder.names();
    let names = [
        ("fifo", "FIFO"),
        ("socket", "socket"),
        ("dir", "directory"),
        ("link", "FIFO"),
        ("dangling", "nothing"),
    ];
    for (words, _) in WRITERS {
        for (name, is) in names {
            let words = writing(words, name);
            let error = folder.stderr(&words, 2);
            assert!(error.contains(&format!("'{name}'")) && error.contains(is), "{words}: {error}");
            // Refused before any work, and not by the advice to force what was forced.
            assert!(!error.contains("took") && !error.contains("--force"), "{words}: {error}");
        }
        assert_eq!(folder.names(), before, "{words}");
        assert!(kind(&folder, "fifo").is_fifo() && kind(&folder, "socket").is_socket());
        assert!(kind(&folder, "link").is_symlink() && kind(&folder, "dangling").is_symlink());
    }
    for name in ["new/", "dir/", "ball.ply/", "ball.ply/x", "no/x", "."] {
        for (words, _) in WRITERS {
            let error = folder.stderr(&writing(words, name), 2);
            assert!(!error.contains("took") && !error.contains("partial"), "{words} {name}: {error}");
        }
    }
    assert_eq!(folder.names(), before);
}

#[test]
fn devices_are_not_replaced() {
    let folder = ball();
    // Only root makes nodes; elsewhere there is nothing of the test's own to try it on.
    let made = Command::new("mknod").arg(folder.path("null")).args(["c", "1", "3"]).output();
    if !made.is_ok_and(|output| output.status.success()) {
        return;
    }
    for (words, _) in WRITERS {
        let error = folder.stderr(&writing(words, "null"), 2);
        assert!(error.contains("'null' is a device"), "{words}: {error}");
        assert!(kind(&folder, "null").is_char_device(), "{words}");
    }
}

#[test]
fn a_link_stays_and_what_it_points_at_is_replaced() {
    let folder = ball();
    fs::create_dir(folder.path("far")).expect("a folder");
    symlink("far/file", folder.path("link")).expect("a link");
    for (words, _) in WRITERS {
        folder.write("far/file", "old");
        let plain = folder.stderr(&writing(words, "link").replace(" -f", ""), 2);
        assert!(plain.contains("--force") && folder.read("far/file") == b"old", "{words}: {plain}");
        folder.chpm(&writing(words, "link")).success();
        assert!(kind(&folder, "link").is_symlink() && folder.read("far/file") != b"old", "{words}");
        assert_eq!(fs::read_dir(folder.path("far")).expect("a folder").count(), 1, "{words}");
    }
}

#[test]
fn a_batch_refuses_what_is_no_file() {
    let folder = ball();
    fs::create_dir(folder.path("out")).expect("a folder");
    mkfifo(&folder.path("out/summary.csv"), Mode::S_IRWXU).expect("a FIFO");
    let error = folder.stderr("batch ball.ply -o out -q", 2);
    assert!(error.contains("summary.csv' is a FIFO"), "{error}");
    fs::rename(folder.path("out/summary.csv"), folder.path("out/ball.chpm")).expect("a rename");
    let output = folder.chpm("batch ball.ply -o out -q").code(1);
    let told = text(&output.get_output().stdout);
    assert!(told.contains("ball.chpm' is a FIFO") && kind(&folder, "out/ball.chpm").is_fifo(), "{told}");
}

#[test]
fn results_stream_and_nothing_else_does() {
    let folder = ball();
    for (words, streams) in WRITERS {
        let words = words.replace(" -q", "");
        if !streams {
            for name in ["-", "/proc/self/fd/1"] {
                let error = folder.stderr(&writing(&words, name), 2);
                assert!(error.contains("standard output") && error.contains("name a file"), "{error}");
            }
            continue;
        }
        folder.chpm(&writing(&words, "file")).success();
        for name in ["-", "/proc/self/fd/1"] {
            let output = folder.chpm(&writing(&words, name)).success();
            let output = output.get_output();
            // Times differ from run to run.
            if words.contains("csv") {
                let (streamed, written) = (text(&output.stdout), text(&folder.read("file")));
                assert_eq!(streamed.lines().next(), written.lines().next(), "{words}");
                assert_eq!(streamed.lines().count(), written.lines().count(), "{words}");
            } else {
                assert_eq!(output.stdout, folder.read("file"), "{words}");
            }
            assert!(!output.stderr.is_empty(), "{words}: what was done is told");
        }
        if words.contains("synth") || words.contains("extract") {
            assert_eq!(folder.stderr(&format!("{} -q", writing(&words, "-")), 0), "", "{words}");
        }
    }
    let error = folder.stderr("walk ball.chpm ball.path --csv - --json", 2);
    assert!(error.contains("only one result"), "{error}");
    assert!(!folder.names().contains(&"-".to_owned()));
}

#[test]
fn whoever_closes_a_stream_has_read_enough() {
    let folder = ball();
    for words in ["synth sphere --triangles 300000 -o - -q", "extract ball.chpm --level 0 --ascii -o - -q"] {
        let mut command = folder.command(words);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("a process");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("an end");
        assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()), "{words}");
    }
}

#[test]
fn names_of_other_formats_are_refused() {
    let folder = ball();
    let before = folder.names();
    for (words, names) in [
        (WRITERS[0].0, "q.ply q.png q.OBJ q.chpm.gz q.v2"),
        (WRITERS[1].0, "q.chpm q.ply.gz q.fbx q.dae q.usdz q.none"),
        (WRITERS[2].0, "q.chpm q.stl q.jpg"),
        (WRITERS[3].0, "q.csv q.chpm"),
        (WRITERS[4].0, "q.json q.svg"),
        (WRITERS[5].0, "q.svg"),
        (WRITERS[6].0, "q.ply q.png q.shp"),
    ] {
        for name in names.split(' ') {
            let error = folder.stderr(&writing(words, name), 2);
            assert!(error.contains(" writes ") && error.contains(name), "{words}: {error}");
            assert!(!error.contains("took"), "{error}");
        }
        assert_eq!(folder.names(), before);
        folder.chpm(&writing(words, "free")).success();
        fs::remove_file(folder.path("free")).expect("it was made");
    }
}

/// All else that writes, each word by word, and whether it is a folder: the name of one may end in anything but a format.
const OTHERS: [(&str, bool); 26] = [
    ("rays ball.chpm ball.ply -o NAME", false),
    ("thickness ball.chpm -o NAME", false),
    ("visible ball.chpm --from 0,0,9 --svg NAME", false),
    ("section ball.chpm --plane 0,0,1:0 -o NAME", false),
    ("relayout ball.chpm --pages packed -o NAME", false),
    ("simplify ball.ply --triangles 100 -o NAME", false),
    ("stats ball.chpm --csv NAME", false),
    ("report ball.chpm -o NAME", false),
    ("compare ball.ply ball.chpm -o NAME", false),
    ("compare ball.ply ball.chpm --svg NAME", false),
    ("distance ball.chpm ball.chpm --csv NAME", false),
    ("clearance ball.chpm ball.chpm --above 1 --csv NAME", false),
    ("contacts ball.chpm ball.chpm --within 1 --csv NAME", false),
    ("bench ball.ply --svg NAME", false),
    ("build ball.ply -f -o NAME", false),
    ("extract ball.chpm --level 0 -o NAME", false),
    ("synth sphere --triangles 3000 -o NAME", false),
    ("path orbit ball.chpm --frames 2 -o NAME", false),
    ("walk ball.chpm ball.path --csv NAME", false),
    ("bench ball.ply --csv NAME", false),
    ("export ball.chpm --3dtiles NAME", true),
    ("export ball.chpm --meshlets NAME", false),
    ("batch ball.ply -o NAME", true),
    ("batch --merge ball.ply -o NAME", true),
    ("man NAME", true),
    ("demo --keep NAME", true),
];

#[cfg(feature = "viewer")]
const PICTURES: [&str; 3] = [
    "render ball.chpm -o NAME",
    "walk ball.chpm ball.path --render --plot NAME",
    "view ball.chpm --frames 1 --screenshot NAME",
];
#[cfg(not(feature = "viewer"))]
const PICTURES: [&str; 0] = [];

#[test]
fn what_is_not_written_is_no_name_for_what_is() {
    let folder = ball();
    let before = folder.names();
    let writers = OTHERS.iter().copied().chain(PICTURES.map(|words| (words, false)));
    for (words, is_folder) in
        writers.chain(cfg!(feature = "web").then_some(("share ball.chpm -o NAME", true)))
    {
        let names = if is_folder { &["q.fbx", "q.usdz"][..] } else { &["q.fbx", "Q.DAE", "q.none"] };
        for name in names {
            let error = folder.stderr(&writing(words, name), 2);
            assert!(error.contains(name), "{words}: {error}");
            assert!(error.contains(" writes ") || error.contains(" makes a folder"), "{words}: {error}");
        }
        assert_eq!(folder.names(), before, "{words}");
    }
}

#[test]
fn the_longest_names_are_written() {
    let folder = ball();
    for len in [232, 240, 255] {
        for (words, _) in WRITERS {
            let name = "n".repeat(len);
            folder.chpm(&writing(words, &name)).success();
            fs::remove_file(folder.path(&name)).expect("it was made");
        }
    }
    assert_eq!(folder.names(), ["ball.chpm", "ball.path", "ball.ply"]);
}

#[test]
fn work_for_long_names_goes_on_and_is_not_mixed_up() {
    let folder = ball();
    let [one, other] = ["a", "b"].map(|last| "n".repeat(254) + last);
    let build = |name: &str, more: &str| format!("build ball.ply --cluster-triangles 512 -o {name} {more}");
    let has_work = || {
        let is_work = |name: &String| name.ends_with(".work") && folder.path(name).join("manifest").exists();
        folder.names().iter().any(is_work)
    };
    for at in (20..).step_by(10).take_while(|_| !has_work()) {
        let words = build(&one, &format!("-q --checkpoint 0 --kill-at {at}"));
        assert!(!folder.command(&words).status().expect("it ran").success(), "it ended before a checkpoint");
    }
    let left = folder.names();
    assert!(left.iter().all(|name| name.len() <= 255));
    folder.stdout(&build(&other, "-q"));
    assert!(left.iter().all(|name| folder.names().contains(name)), "another name's leftovers stay");
    assert!(folder.stdout(&build(&one, "-q")).contains("going on after"));
    assert_eq!(folder.read(&one), folder.read(&other));
    assert_eq!(folder.names().len(), 5, "{:?}", folder.names());
}

/// Runs under a limit on the size of files, in blocks of 1024 bytes.
fn limited(folder: &Folder, blocks: u32, words: &str) -> Output {
    let script = format!("ulimit -f {blocks}; exec {CHPM} {words}");
    Command::new("bash").args(["-c", &script]).current_dir(folder.path("")).output().expect("bash")
}

#[test]
fn a_limit_on_the_size_of_files_is_an_error() {
    let folder = ball();
    let before = folder.names();
    for words in [
        "build ball.ply -q --no-resume -o x",
        "extract ball.chpm --level 0 -q -o x",
        "synth sphere --triangles 6000 -q -o x",
    ] {
        let output = limited(&folder, 20, words);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{words}: {error}");
        assert!(error.contains("'x'") && error.contains("ulimit -f"), "{words}: {error}");
        assert_eq!(folder.names(), before, "{words}");
    }
    let output = limited(&folder, 20, "synth sphere --triangles 6000 -q -o - > x");
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("'standard output'") && error.contains("ulimit -f"), "{error}");
    // Enough for the work, but not for the file: what was done is kept.
    let blocks = (folder.read("ball.chpm").len() as u32 - 1) / 1024;
    let build = "build ball.ply -q --cluster-triangles 512 --checkpoint 0 -f -o x";
    let output = limited(&folder, blocks, build);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(
        error.contains("'x'") && error.contains("ulimit -f") && error.contains("is kept up to"),
        "{error}"
    );
    assert!(folder.stdout(build).contains("going on after"));
}

#[test]
fn work_that_was_removed_is_not_said_to_be_kept() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 60000 -o in.ply -q");
    for removed in ["work", "all"] {
        fs::create_dir(folder.path("out")).expect("a folder");
        let mut command = folder.command("build in.ply -o out/x.chpm --checkpoint 0");
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("a process");
        let mut lines = BufReader::new(child.stderr.take().expect("a pipe")).lines().map_while(Result::ok);
        lines.find(|line| line.starts_with("simplify")).expect("the stage begins");
        send(&child, Signal::SIGSTOP);
        for entry in fs::read_dir(folder.path("out")).expect("a folder").flatten() {
            if entry.path().is_dir() {
                fs::remove_dir_all(entry.path()).expect("it was there");
            } else if removed == "all" {
                fs::remove_file(entry.path()).expect("it was there");
            }
        }
        send(&child, Signal::SIGINT);
        send(&child, Signal::SIGCONT);
        let told = lines.collect::<Vec<String>>().join("\n");
        assert!(!child.wait().expect("an end").success(), "{told}");
        assert!(told.contains("was removed meanwhile") && !told.contains("what was done is kept"), "{told}");
        fs::remove_dir_all(folder.path("out")).expect("a folder");
    }
}

#[test]
fn an_output_is_never_an_input() {
    let folder = ball();
    fs::copy(folder.path("ball.ply"), folder.path("source")).expect("a copy");
    fs::copy(folder.path("ball.chpm"), folder.path("model")).expect("a copy");
    fs::hard_link(folder.path("source"), folder.path("source-hard")).expect("a link");
    fs::hard_link(folder.path("model"), folder.path("model-hard")).expect("a link");
    symlink("source", folder.path("source-soft")).expect("a link");
    symlink("model", folder.path("model-soft")).expect("a link");
    let (source, model) = (folder.read("source"), folder.read("model"));
    for by in ["", "-hard", "-soft"] {
        for words in [
            format!("build source -f -q -o source{by}"),
            format!("extract model --level 0 -f -q -o model{by}"),
            format!("path orbit model -f -o model{by}"),
            format!("walk model ball.path -f -q --csv model{by}"),
            format!("bench source -f -q --csv source{by}"),
        ] {
            let error = folder.stderr(&words, 2);
            assert!(error.contains("itself"), "{words}: {error}");
        }
    }
    assert_eq!((folder.read("source"), folder.read("model")), (source, model));
}

/// What a source is made of is an input, too: tiles, a buffer, materials, images.
#[test]
fn an_output_is_never_a_file_of_an_input() {
    let folder = ball();
    folder.stdout("synth torus --triangles 3000 -o ring.ply -q");
    folder.write("all.tiles", "tiles\nball.ply\nring.ply\n");
    folder.stdout("simplify ball.ply --triangles 500 -o own.gltf -q");
    fs::rename(folder.path("own.gltf"), folder.path("scan.gltf")).expect("another name");
    folder.write(
        "scan.obj",
        "mtllib own.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n",
    );
    folder.write("own.mtl", "newmtl a\nmap_Kd own.0.jpg\n");
    folder.write("own.0.jpg", super::sheets::png(4, |_, _| vec![90], png::ColorType::Grayscale));
    folder.stdout("build ball.ply -q --cluster-triangles 512 --volume-size 150k -o parts.chpm");
    let kept = ["ball.ply", "ring.ply", "own.bin", "own.mtl", "own.0.jpg", "parts.0001.pages"];
    let before = kept.map(|name| folder.read(name));
    for words in [
        "simplify all.tiles --within 1% -f -q -o ball.ply",
        "compare all.tiles ball.chpm -f -q -o ring.ply",
        "simplify scan.gltf --within 10% -f -q -o own.gltf",
        "simplify scan.obj --within 1% --texture-size 256 -f -q -o own.obj",
        "simplify scan.obj --within 1% --texture-size 256 -f -q -o own.ply",
        "extract parts.chpm --level 0 --format ply -f -q -o parts.0001.pages",
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.contains("is made of"), "{words}: {error}");
    }
    assert!(kept.map(|name| folder.read(name)) == before);
}

#[test]
fn odd_names_are_written_as_they_are() {
    let folder = ball();
    for name in [&b"new\nline"[..], b"\xff\xfe invalid", b"-dash", b"~tilde\t"] {
        let name = OsStr::from_bytes(name);
        for words in
            ["build ball.ply -q", "extract ball.chpm --level 0 -q", "synth sphere --triangles 3000 -q"]
        {
            let path = Path::new(".").join(name);
            let status = folder.command(words).arg("-o").arg(path).stdout(Stdio::null()).status();
            assert!(status.expect("it ran").success(), "{name:?} {words}");
            fs::remove_file(folder.path("").join(name)).expect("it was made");
        }
    }
    assert_eq!(folder.names(), ["ball.chpm", "ball.path", "ball.ply"]);
}

#[test]
fn errors_name_the_place_and_nothing_hidden() {
    let folder = ball();
    fs::create_dir(folder.path("shut")).expect("a folder");
    fs::set_permissions(folder.path("shut"), fs::Permissions::from_mode(0o555)).expect("permissions");
    // Root may write anywhere.
    let is_shut = fs::write(folder.path("shut/try"), "").is_err();
    let mut all: Vec<(String, String)> = Vec::new();
    for (words, _) in WRITERS {
        for name in ["no/x", "ball.ply/x", "shut/x"] {
            let words = writing(words, name);
            if name != "shut/x" || is_shut {
                all.push((name.to_owned(), folder.stderr(&words, 2)));
            }
        }
    }
    let verify = "verify ball.chpm --against ball.ply -q --work-dir no";
    all.push(("no".to_owned(), folder.stderr(verify, 2)));
    all.push(("no".to_owned(), folder.stderr("build ball.ply -q -o x --work-dir no", 2)));
    let demo = folder.command("demo -q").env("TMPDIR", "no").output().expect("it ran");
    all.push(("no".to_owned(), text(&demo.stderr)));
    for name in ["no/x", "no/no/x"] {
        for (words, _) in WRITERS {
            let error = folder.stderr(&writing(words, name), 2);
            assert!(error.contains("there is no folder 'no") && error.contains("make it first"), "{error}");
        }
    }
    for (place, error) in all {
        assert!(error.starts_with("error: ") && error.contains(&format!("'{place}'")), "{error}");
        for hidden in ["partial", ".lock", ".work", ".tmp", "chpm-", ".cargo"] {
            assert!(!error.contains(hidden), "{hidden}: {error}");
        }
    }
}

#[test]
fn a_full_standard_output_is_called_that() {
    let folder = ball();
    for (words, complete) in [
        ("info ball.chpm", None),
        ("extract ball.chpm --level 0 -q -o -", None),
        ("dump ball.chpm --pages", None),
        ("dump ball.chpm --cluster 0", None),
        ("--help", None),
        ("--version", None),
        ("help build", None),
        ("extract ball.chpm --level 0 -q -o out.ply", Some("out.ply")),
        ("build ball.ply -q -o out.chpm", Some("out.chpm")),
        ("relayout ball.chpm -q --pages packed -o packed.chpm", Some("packed.chpm")),
        ("path orbit ball.chpm --frames 2 -o out.path", Some("out.path")),
        ("export ball.chpm -q --3dtiles tiles", Some("tiles")),
        ("export ball.chpm -q --3dtiles tiles.3tz", Some("tiles.3tz")),
        ("export ball.chpm -q --meshlets out.meshlets", Some("out.meshlets")),
    ] {
        let Ok(full) = fs::File::options().write(true).open("/dev/full") else {
            skipped("a full standard output: no /dev/full");
            return;
        };
        let out = folder.command(words).stdout(full).output().expect("a process");
        let said = text(&out.stderr);
        assert!(out.status.code() == Some(2) && said.contains("standard output"), "{words}: {said}");
        // Not the file that was read, nor what was reached in spite of it.
        assert!(!said.contains("cannot read"), "{words}: {said}");
        let told = |name: &str| said.contains(&format!("'{name}' is written and complete"));
        assert!(complete.map_or(!said.contains("complete"), told), "{words}: {said}");
    }
}
