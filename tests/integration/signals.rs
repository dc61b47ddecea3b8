//! A build that is told to stop leaves nothing.

use super::harness::Folder;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Stdio};

fn send(child: &Child, signal: Signal) {
    let id = i32::try_from(child.id()).expect("a process id");
    // A child that was not waited for keeps its id, so this reaches no other process.
    kill(Pid::from_raw(id), signal).expect("a signal sent");
}

#[test]
fn a_stopped_build_leaves_nothing() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 200000 -o in.ply -q");
    for (signal, expected) in [(Signal::SIGINT, 130), (Signal::SIGTERM, 143)] {
        for stage in ["ingest", "decompose", "simplify"] {
            let mut child = folder
                .command("build in.ply --threads 1")
                .stdout(Stdio::null())
                .stderr(Stdio::piped())
                .spawn()
                .expect("a process");
            let mut lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
            let begun = |line: &String| line.starts_with(stage);
            lines.by_ref().map_while(Result::ok).find(begun).expect("the stage begins");
            send(&child, signal);
            let rest: Vec<String> = lines.map_while(Result::ok).collect();
            match child.wait().expect("an end").code() {
                Some(code) if code == expected => assert_eq!(folder.names(), ["in.ply"], "{stage}: {rest:?}"),
                // The build may have been faster than the signal.
                Some(0) => std::fs::remove_file(folder.path("in.chpm")).expect("the output"),
                code => panic!("{signal} in {stage}: {code:?}: {rest:?}"),
            }
        }
    }
}

#[test]
fn a_verb_that_writes_nothing_ends_at_once() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 10000 -o in.ply -q");
    folder.stdout("build in.ply -q");
    for (signal, expected) in [(Signal::SIGINT, 130), (Signal::SIGTERM, 143)] {
        let mut child =
            folder.command("dump in.chpm --pages").stdout(Stdio::piped()).spawn().expect("a process");
        // It writes more than a pipe holds and is read no further: it cannot have ended.
        let mut first = [0; 1];
        child.stdout.as_mut().expect("a pipe").read_exact(&mut first).expect("a byte");
        send(&child, signal);
        assert_eq!(child.wait().expect("an end").code(), Some(expected));
    }
}
