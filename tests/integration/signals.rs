//! A build that is told to stop leaves nothing.

use super::harness::{CHPM, Folder, send};
use nix::sys::signal::Signal;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};

#[test]
fn a_stopped_build_leaves_nothing() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 200000 -o in.ply -q");
    for (signal, expected) in [(Signal::SIGINT, 130), (Signal::SIGTERM, 143), (Signal::SIGHUP, 129)] {
        for stage in ["ingest", "decompose", "simplify"] {
            // No checkpoint is due, however slow the machine is.
            let words = "build in.ply --threads 1 --checkpoint 1000000";
            let (status, rest) = folder.signalled(words, stage, signal);
            match status.code() {
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

#[test]
fn a_simplification_whose_terminal_is_closed_leaves_nothing() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 200000 -o in.ply -q");
    let (status, rest) =
        folder.signalled("simplify in.ply --triangles 1% -o out.ply", "simplify", Signal::SIGHUP);
    match status.code() {
        Some(129) => assert_eq!(folder.names(), ["in.ply"], "{rest:?}"),
        // It may have been faster than the signal.
        code => assert_eq!(code, Some(0), "{rest:?}"),
    }
}

#[test]
fn a_report_that_is_stopped_leaves_nothing() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 200000 -o in.ply -q");
    folder.stdout("build in.ply -q");
    let before = folder.names();
    for words in ["report in.chpm -o out.html -q", "stats in.chpm --csv out.csv -q"] {
        let mut child = folder.command(words).stderr(Stdio::null()).spawn().expect("a process");
        // What it writes is there from the beginning.
        while folder.names() == before && child.try_wait().expect("a process").is_none() {}
        send(&child, Signal::SIGTERM);
        match child.wait().expect("an end").code() {
            Some(143) => assert_eq!(folder.names(), before, "{words}"),
            // It may have been faster than the signal.
            code => {
                assert_eq!(code, Some(0), "{words}");
                let output = words.split(' ').find(|word| word.starts_with("out.")).expect("a name");
                std::fs::remove_file(folder.path(output)).expect("the output");
            }
        }
    }
}

#[test]
fn who_is_told_to_outlive_its_terminal_does() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 100000 -o in.ply -q");
    let mut shell = Command::new("sh");
    shell.current_dir(folder.path("")).args(["-c", "trap '' HUP; exec \"$0\" build in.ply", CHPM]);
    let mut child = shell.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("a shell");
    let mut lines = BufReader::new(child.stderr.take().expect("a pipe")).lines().map_while(Result::ok);
    lines.find(|line| line.starts_with("ingest")).expect("the stage begins");
    send(&child, Signal::SIGHUP);
    lines.for_each(drop);
    assert_eq!(child.wait().expect("an end").code(), Some(0));
    assert_eq!(folder.names(), ["in.chpm", "in.ply"]);
}
