//! Files that are damaged, or truncated or changed while they are read: an error that names the file, and nothing is written.

use super::harness::{Folder, text};
use chpm_extmem::{Cancel, MappedFile, Silent};
use chpm_format::page::PAGE_HEADER_LEN;
use chpm_format::{Chpm, SectionKind, checksum};
use chpm_mesh::{Bytes, ClusterId, Level};
use chpm_refine::{Cut, extract};
use chpm_verify::{Checks, VerifyError};
use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use serde_json::Value;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::process::Stdio;
use std::time::SystemTime;

fn built() -> Folder {
    built_with("raw")
}

fn built_with(pages: &str) -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 20k -o in.ply -q");
    folder.stdout(&format!("build in.ply -q --cluster-triangles 512 --pages {pages}"));
    folder
}

/// Leaves the tables and half of the pages.
fn truncate(path: &Path) {
    let file = File::options().write(true).open(path).expect("a file opened");
    file.set_len(file.metadata().expect("a length").len() / 2).expect("a file truncated");
}

#[test]
fn a_file_that_is_truncated_while_it_is_dumped_is_an_error() {
    for pages in ["raw", "chained"] {
        dumps_a_file_that_is_truncated(&built_with(pages));
    }
}

fn dumps_a_file_that_is_truncated(folder: &Folder) {
    let mut command = folder.command("dump in.chpm --pages");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("a process");
    // Far less than all: the rest waits in the process until this is read.
    let mut out = child.stdout.take().expect("a pipe");
    out.read_exact(&mut [0; 100]).expect("a beginning");
    truncate(&folder.path("in.chpm"));
    out.read_to_end(&mut Vec::new()).expect("the rest");
    let output = child.wait_with_output().expect("an end");
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{:?}: {error}", output.status);
    assert!(error.contains("'in.chpm' was cut short while it was read"), "{error}");
}

#[test]
fn a_file_that_is_truncated_before_it_is_walked_along_is_an_error() {
    let folder = built();
    folder.stdout("path orbit in.chpm --frames 3 -o in.path");
    mkfifo(&folder.path("slow.path"), Mode::S_IRWXU).expect("a FIFO");
    let mut command = folder.command("walk in.chpm slow.path --poe 0.1 --csv out.csv -q");
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("a process");
    // Opens as soon as the process does, which has mapped the file before.
    let fifo = File::options().write(true).open(folder.path("slow.path")).expect("a FIFO opened");
    truncate(&folder.path("in.chpm"));
    std::io::copy(&mut folder.read("in.path").as_slice(), &mut &fifo).expect("a path written");
    drop(fifo);
    let output = child.wait_with_output().expect("an end");
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{:?}: {error}", output.status);
    assert!(error.contains("'in.chpm' was cut short while it was read"), "{error}");
    assert!(!folder.path("out.csv").exists() && output.stdout.is_empty());
}

#[test]
fn verification_and_extraction_outlive_a_file_that_is_truncated() {
    for pages in ["raw", "chained"] {
        outlive_a_file_that_is_truncated(&built_with(pages));
    }
}

fn outlive_a_file_that_is_truncated(folder: &Folder) {
    let path = folder.path("in.chpm");
    let bytes = folder.read("in.chpm");
    let open = || Chpm::open(MappedFile::open(&path).expect("a map")).expect("a file");
    let file = open();
    let mut is_whole = true;
    let report = chpm_format::verify(&file, |_, _| {
        if std::mem::take(&mut is_whole) {
            truncate(&path);
        }
    });
    assert!(!report.is_ok());
    let told = file.get_ref().check_unchanged().expect_err("a change").to_string();
    assert!(told.contains("in.chpm' was cut short"), "{told}");

    fs::write(&path, &bytes).expect("a file written");
    let file = open();
    file.get_ref().check_unchanged().expect("nothing has happened");
    truncate(&path);
    let error = extract(&file, &Cut::at_level(&file, Level(0))).expect_err("half of the pages");
    assert!(error.to_string().starts_with("page of cluster"), "{error}");
    file.get_ref().check_unchanged().expect_err("a change");

    fs::write(&path, &bytes).expect("a file written");
    let file = open();
    let other = File::options().write(true).open(&path).expect("a file opened");
    other.set_modified(SystemTime::UNIX_EPOCH).expect("a time set");
    assert!(file.get_ref().check_unchanged().expect_err("a change").to_string().contains("was changed"));
}

/// A model of one cluster that no verb can do without, and a copy of it that nothing but the checksum of its page tells apart: a coordinate is moved, or a bit of
/// what was packed is another one.
fn with_a_damaged_page(pages: &str) -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 300 -o in.ply -q");
    folder.stdout(&format!("build in.ply -q --pages {pages}"));
    folder.stdout("path orbit in.chpm --frames 2 -o in.path");
    let file = Chpm::open(folder.read("in.chpm")).expect("a file");
    let record = file.clusters()[0];
    assert!(file.clusters().len() == 1 && file.is_packed(ClusterId(0)) == (pages == "packed"));
    let (start, len) = (record.page_offset as usize, record.page_len as usize);
    let mut bytes = file.into_inner();
    match pages {
        "packed" => bytes[start + len - 1] ^= 0x10,
        _ => {
            let x = &mut bytes[start + PAGE_HEADER_LEN..][..4];
            let moved = f32::from_le_bytes(x.try_into().expect("four bytes")) + 0.25;
            x.copy_from_slice(&moved.to_le_bytes());
        }
    }
    folder.write("bad.chpm", bytes);
    folder.write("in.rays", "0,0,9,0,0,-1\n");
    folder
}

fn refuses_the_damaged_page(folder: &Folder, verb: &str) {
    let before = folder.names();
    let output = folder.chpm(verb);
    let output = output.get_output();
    let [told, error] = [&output.stdout, &output.stderr].map(|bytes| text(bytes));
    let is_verified = verb.starts_with("verify bad");
    assert_eq!(output.status.code(), Some(if is_verified { 1 } else { 2 }), "{verb}: {told}{error}");
    let damage = if is_verified { &told } else { &error };
    assert!(damage.contains("bad.chpm") && !damage.contains("in.chpm"), "{verb}: {damage}");
    assert!(damage.contains("page of cluster 0: checksum "), "{verb}: {damage}");
    assert!(told.is_empty() || is_verified || verb.starts_with("dump"), "{verb}: {told}");
    assert_eq!(folder.names(), before, "{verb}");
}

#[test]
fn every_verb_refuses_a_page_of_which_only_the_checksum_tells() {
    let folder = with_a_damaged_page("raw");
    for verb in [
        "extract bad.chpm --level 0 -o out.ply -q",
        "extract bad.chpm --triangles 200 -o out.ply -q",
        "extract bad.chpm --error 0 -o out.ply -q",
        "extract bad.chpm --poe 1 -o - -q",
        "export bad.chpm --3dtiles out -q",
        "export bad.chpm --3dtiles out.3tz -q",
        "export bad.chpm --meshlets out.meshlets -q",
        "relayout bad.chpm -o out.chpm --pages packed -q",
        "info bad.chpm --cache",
        "info bad.chpm --parts",
        "stats bad.chpm",
        "report bad.chpm -o out.html -q",
        "dump bad.chpm --pages",
        "dump bad.chpm --cluster 0",
        "distance bad.chpm in.chpm --pose 3,0,0",
        "distance in.chpm bad.chpm --pose 3,0,0",
        "clearance in.chpm bad.chpm --above 1.05 --pose 3,0,0",
        "contacts bad.chpm in.chpm --pose 1,0,0",
        "contacts bad.chpm --self",
        "section bad.chpm --every 0.01 -o out.svg -q",
        "section bad.chpm --every 0.01 -q --preview 1%",
        "rays bad.chpm in.rays -o out.csv -q",
        "rays bad.chpm in.rays --any -q --error 1e-9",
        "thickness bad.chpm -o out.ply -q",
        "visible bad.chpm --from 0,0,9 --svg out.svg -q",
        "compare bad.chpm in.ply -o out.ply -q",
        "compare in.chpm bad.chpm -q",
        "walk bad.chpm in.path --csv out.csv -q",
        "path dive bad.chpm -o out.path",
        "measure bad.chpm --against in.ply -q",
        "verify bad.chpm -q",
        "verify in.chpm --same-as bad.chpm -q",
    ] {
        refuses_the_damaged_page(&folder, verb);
    }
    if cfg!(feature = "viewer") {
        refuses_the_damaged_page(&folder, "render bad.chpm --viewport 40x30 -o out.png -q");
    }
    if cfg!(feature = "web") {
        refuses_the_damaged_page(&folder, "share bad.chpm -o out -q");
    }
}

#[test]
fn a_bit_of_a_packed_page_is_refused_before_it_is_unpacked() {
    let folder = with_a_damaged_page("packed");
    for verb in [
        "extract bad.chpm --level 0 -o out.ply -q",
        "relayout bad.chpm -o out.chpm --pages raw -q",
        "export bad.chpm --3dtiles out -q",
        "stats bad.chpm",
        "contacts bad.chpm --self",
        "walk bad.chpm in.path -q",
        "measure bad.chpm --against in.ply -q",
        "verify bad.chpm -q",
    ] {
        refuses_the_damaged_page(&folder, verb);
    }
}

/// The file with a change in its metadata, and checksums that fit.
fn with_metadata(bytes: &[u8], change: impl Fn(&mut [u8])) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let word =
        |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    let sections = word(&bytes, 32) as usize;
    let is_metadata = |entry: &usize| word(&bytes, *entry) == SectionKind::Metadata as u32;
    let entry = (256..).step_by(40).take(sections).find(is_metadata).expect("metadata");
    // Offset and length are 64 bits; the upper halves are zero in a small file.
    let (start, len) = (word(&bytes, entry + 8) as usize, word(&bytes, entry + 16) as usize);
    change(&mut bytes[start..start + len]);
    for (range, at) in [(start..start + len, entry + 32), (256..256 + 40 * sections, 240), (0..248, 248)] {
        let sum = checksum(&bytes[range]).to_le_bytes();
        bytes[at..at + 8].copy_from_slice(&sum);
    }
    bytes
}

#[test]
fn geometry_is_told_where_the_metadata_is_damaged() {
    let folder = built();
    let good = folder.stdout("info in.chpm");
    let bytes = folder.read("in.chpm");
    for (change, told) in [
        (&(|metadata: &mut [u8]| metadata[0] = 9) as &dyn Fn(&mut [u8]), "version 1 expected, got 9"),
        (&|metadata| metadata[2..].fill(0xff), "it is not encoded as it must be"),
        (&|metadata| metadata[3] = 0xff, "a text in it is not UTF-8"),
        (&|metadata| metadata[2..5].copy_from_slice(&[251, 0xff, 0xff]), "it ends early"),
    ] {
        folder.write("bad.chpm", with_metadata(&bytes, change));
        let output = folder.chpm("info bad.chpm").success();
        let [out, error] =
            [&output.get_output().stdout, &output.get_output().stderr].map(|bytes| text(bytes));
        assert!(error.contains("warning: 'bad.chpm'") && error.contains(told), "{told}: {error}");
        assert!(!error.contains(['{', '}']), "no debug text: {error}");
        let line = |text: &str, start: &str| text.lines().find(|l| l.starts_with(start)).map(str::to_owned);
        for part in ["model", "box", "hierarchy", "error"] {
            assert_eq!(line(&out, part), line(&good, part), "{out}");
        }
        let json: Value = serde_json::from_str(&folder.stdout("info bad.chpm --json")).expect("JSON");
        assert!(json["source"].is_null() && json["triangles"].is_u64(), "{json}");
        folder.stdout("extract bad.chpm --level 0 -o out.ply -qf");
    }
}

#[test]
fn what_is_no_file_is_refused_by_its_name() {
    let folder = Folder::new();
    fs::create_dir(folder.path("dir.chpm")).expect("a folder");
    mkfifo(&folder.path("fifo.chpm"), Mode::S_IRWXU).expect("a FIFO");
    folder.write("empty.chpm", "");
    folder.write("in.path", "chpm-path 1\n");
    for (name, told) in [
        ("dir", "not name a file"),
        ("fifo", "not name a file"),
        ("empty", "the file is cut short"),
        ("none", "cannot open"),
    ] {
        for verb in [
            "info X",
            "verify X -q",
            "dump X",
            "extract X --level 0 -o out.ply",
            "walk X in.path",
            "path orbit X -o out.path",
        ] {
            let words = verb.replace('X', &format!("{name}.chpm"));
            let output = folder.chpm(&words);
            let output = output.get_output();
            // To verify, a file that does not open is a fault like any other.
            let expected = if name == "empty" && verb.starts_with("verify") { 1 } else { 2 };
            let error = text(&output.stderr) + &text(&output.stdout);
            assert_eq!(output.status.code(), Some(expected), "{words}: {error}");
            assert!(error.contains(&format!("{name}.chpm")) && error.contains(told), "{words}: {error}");
        }
    }
    assert!(!folder.path("out.ply").exists());
}

#[test]
fn a_cancelled_verification_ends() {
    let folder = built();
    let file = Chpm::open(MappedFile::open(&folder.path("in.chpm")).expect("a map")).expect("a file");
    let cancel = Cancel::default();
    let verify = || {
        chpm_verify::verify(&file, &Checks::default(), Bytes(1 << 28), &folder.path("."), &Silent, &cancel)
    };
    assert!(verify().expect("findings").is_sound());
    cancel.cancel();
    assert!(matches!(verify(), Err(VerifyError::Cancelled(_))));
}
