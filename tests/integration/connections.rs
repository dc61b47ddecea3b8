//! `chpm serve` beyond its limits: too many who ask, who ask nothing, who ask too much, who do not take what they asked for. And what `chpm share` leaves alone.

use super::harness::{CHPM, Folder};
use super::web::{Host, built};
use std::fs::{self, File};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Command;

/// A folder with a file that no pair of sockets holds.
fn large() -> Folder {
    let folder = Folder::new();
    let file = File::create(folder.path("large.chpm")).expect("a file created");
    file.set_len(64 << 20).expect("a length");
    folder
}

/// A server that may have so many files open.
fn limited(folder: &Folder, files: u32, words: &str) -> Host {
    let mut shell = Command::new("sh");
    let line = format!("ulimit -n {files} && exec '{CHPM}' serve . --port 0 {words}");
    shell.current_dir(folder.path("")).args(["-c", &line]);
    Host::begin(shell)
}

/// What comes until the other side closes.
fn rest(stream: &mut TcpStream) -> String {
    let mut said = Vec::new();
    // A connection that is reset is closed, too.
    let _ = stream.read_to_end(&mut said);
    String::from_utf8_lossy(&said).into_owned()
}

fn connect(host: &Host, said: &str) -> TcpStream {
    let mut stream = TcpStream::connect(&host.address).expect("a connection");
    // Who is refused may be told so before he has said all.
    let _ = stream.write_all(said.as_bytes());
    stream
}

#[test]
fn a_flood_is_refused_and_served_after() {
    let folder = large();
    let host = limited(&folder, 64, "--idle 1");
    // Some say nothing, some begin, some keep what they have.
    let begun = ["", "GET / HTTP/1.1\r\nHost: local", "GET /view.html HTTP/1.1\r\nHost: localhost\r\n\r\n"];
    let mut crowd: Vec<TcpStream> = (0..100).map(|i| connect(&host, begun[i % 3])).collect();
    let told: Vec<String> = crowd.iter_mut().map(rest).collect();
    let count = |word: &str| told.iter().filter(|told| told.starts_with(word)).count();
    assert!(count("HTTP/1.1 503") > 50, "{} refused", count("HTTP/1.1 503"));
    assert!(count("HTTP/1.1 200") > 0 && count("") > count("HTTP"), "some were let in");
    // All that were let in are out again, although nobody here has gone.
    assert_eq!(host.get("/view.html", "").0, 200);
    assert_eq!(host.get("/large.chpm", "Range: bytes=0-9\r\n").0, 206);
}

#[test]
fn a_server_without_descriptors_waits_for_some() {
    let folder = large();
    let host = Host::start(&folder, ".");
    let limit = |files: &str| {
        let id = host.child.id().to_string();
        let done = Command::new("prlimit").args(["--pid", &id, &format!("--nofile={files}:")]).status();
        assert!(done.expect("prlimit").success());
    };
    limit("4");
    let ask = "GET /view.html HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    let mut streams = [ask; 3].map(|ask| connect(&host, ask));
    limit("256");
    for stream in &mut streams {
        assert!(rest(stream).starts_with("HTTP/1.1 200"));
    }
    let said = folder_says(&folder, 17);
    assert!(said.contains("17 files") && said.contains("ulimit -n"), "{said}");
}

/// The error of a server that may have so many files open.
fn folder_says(folder: &Folder, files: u32) -> String {
    let line = format!("ulimit -n {files} && exec '{CHPM}' serve . --port 0");
    let out =
        Command::new("sh").current_dir(folder.path("")).args(["-c", &line]).output().expect("a process");
    assert_eq!(out.status.code(), Some(2));
    String::from_utf8_lossy(&out.stderr).into_owned()
}

#[test]
fn requests_have_an_end() {
    let folder = large();
    let host = Host::start(&folder, ".");
    let ask = |bytes: usize| host.get("/view.html", &format!("Cookie: {}\r\n", "x".repeat(bytes))).0;
    assert_eq!([ask(8_000), ask(60_000), ask(8_000)], [200, 431, 200]);
    assert_eq!(host.get(&format!("/{}", "x".repeat(60_000)), "").0, 431);
}

#[test]
fn who_does_not_take_what_was_asked_for_loses_the_place() {
    let folder = large();
    let host = Host::start(&folder, ". --connections 1 --idle 1");
    let mut idler = connect(&host, "GET /large.chpm HTTP/1.1\r\nHost: localhost\r\n\r\n");
    let mut first = [0];
    idler.read_exact(&mut first).expect("an answer that begins");
    assert_eq!(host.get("/view.html", "").0, 503);
    while host.get("/view.html", "").0 != 200 {}
    assert!(rest(&mut idler).len() < 64 << 20);
}

#[test]
fn what_cannot_be_shared_leaves_nothing() {
    let folder = built();
    let said = folder.stderr("share a.chpm -o new -q --memory 1M", 2);
    assert!(said.contains("--memory"), "{said}");
    assert!(!folder.path("new").exists(), "{said}");
    let said = folder.stderr("share a.chpm -o no/such -q", 2);
    assert!(said.contains("cannot make a folder in 'no'"), "{said}");
    // What is somebody else's is as it was.
    fs::create_dir(folder.path("old")).expect("a folder");
    folder.write("old/index.html", "mine");
    let said = folder.stderr("share a.chpm -o old -q --force", 2);
    assert!(said.contains("'old' has no 'model.chpm'"), "{said}");
    fs::create_dir(folder.path("old/view")).expect("a folder");
    let said = folder.stderr("share a.chpm -o old -q --force", 2);
    assert!(said.contains("'old' holds 'view'"), "{said}");
    assert_eq!(folder.read("old/index.html"), b"mine");
    // Nor what lies below a folder of the same name.
    folder.stdout("share a.chpm -o site -q --split");
    folder.write("site/model/mine.txt", "mine");
    let said = folder.stderr("share a.chpm -o site -q --split --force", 2);
    assert!(said.contains("mine.txt', which this command did not write"), "{said}");
    assert_eq!(folder.read("site/model/mine.txt"), b"mine");
    // A build takes more memory than reading does.
    let said = folder.stderr("share in.ply -o new -q --memory 16M", 2);
    assert!(said.contains("give it 128M or more"), "{said}");
}
