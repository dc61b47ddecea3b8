//! `build --trace`: what each thread did when.

use super::harness::{Folder, root, skipped, text};
use serde_json::Value;
use std::fs;
use std::process::Command;

const BUILD: &str = "build in.ply -q --no-resume --threads";

#[test]
fn a_trace_has_the_stages_and_their_tasks_and_changes_nothing() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 60000 -o in.ply -q");
    folder.stdout(&format!("{BUILD} 2 -o plain.chpm"));
    folder.stdout(&format!("{BUILD} 2 -o traced.chpm --trace trace.json"));
    let read = |name: &str| fs::read(folder.path(name)).expect("a file");
    assert!(read("plain.chpm") == read("traced.chpm"));

    let events: Vec<Value> = serde_json::from_slice(&read("trace.json")).expect("an array");
    let named = |name: &str| events.iter().filter(|event| event["name"] == name).collect::<Vec<_>>();
    let within = |event: &Value| {
        let [start, length] = ["ts", "dur"].map(|key| event[key].as_f64().expect("microseconds"));
        (start, start + length)
    };
    for (stage, task) in [("decompose", "region"), ("simplify", "group"), ("layout", "page")] {
        let (stage, tasks) = (named(stage), named(task));
        assert_eq!((stage.len(), stage[0]["cat"].as_str()), (1, Some("stage")));
        let (start, end) = within(stage[0]);
        assert!(
            !tasks.is_empty() && tasks.iter().all(|task| within(task).0 >= start && within(task).1 <= end)
        );
        assert!(tasks.iter().all(|task| task["ph"] == "X" && task["args"]["phase"].is_u64()));
        assert!(tasks.iter().all(|task| (1..=2).contains(&task["tid"].as_u64().expect("a thread"))));
    }
    let pages = named("page").len();
    assert!(folder.stdout("info traced.chpm --json").contains(&format!("\"clusters\": {pages}")), "{pages}");
}

#[test]
fn a_trace_that_exists_is_refused_and_none_is_left_half_written() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 2000 -o in.ply -q");
    fs::write(folder.path("old.json"), "mine").expect("a file");
    let told = folder.stderr(&format!("{BUILD} 1 --trace old.json"), 2);
    assert!(told.contains("old.json") && told.contains("exists"), "{told}");
    assert!(folder.stderr(&format!("{BUILD} 1 --trace trace.csv"), 2).contains("JSON"));
    fs::write(folder.path("bad.ply"), "ply\nnonsense\n").expect("a file");
    folder.chpm("build bad.ply -q --trace trace.json").failure();
    assert_eq!(folder.names(), ["bad.ply", "in.ply", "old.json"]);
    assert_eq!(fs::read(folder.path("old.json")).expect("a file"), b"mine");
}

/// One worker takes what was recorded; the serial rest bounds what many gain.
#[test]
fn a_trace_is_replayed_for_any_number_of_workers() {
    let folder = Folder::new();
    let event = |name: &str, cat: &str, ts: u32, dur: u32, phase: u32| {
        format!(
            r#"{{"name":"{name}","cat":"{cat}","ph":"X","ts":{ts}e6,"dur":{dur}e6,"tdur":{dur}e6,"pid":1,"tid":0,"args":{{"phase":{phase}}}}}"#
        )
    };
    // 20 of 100 are serial; then 40 in four tasks, and 40 in one.
    let mut events = vec![event("simplify", "stage", 0, 100, 0), event("group", "task", 60, 40, 1)];
    events.extend((0..4).map(|task| event("group", "task", 10 * task, 10, 0)));
    fs::write(folder.path("trace.json"), format!("[{}]", events.join(","))).expect("a file");
    let mut replay = Command::new("python3");
    replay.arg(root().join("benches/replay.py")).arg(folder.path("trace.json"));
    match replay.output() {
        Ok(output) => {
            let told = text(&output.stdout);
            let total = told.lines().find(|line| line.starts_with("all")).unwrap_or_default().to_owned();
            let numbers: Vec<&str> = total.split_whitespace().collect();
            // 100, then 80 on two workers, 70 on four and more.
            assert_eq!(
                numbers,
                ["all", "100.000", "20.000", "1.25", "1.43", "1.43", "1.43", "1.43"],
                "{told}"
            );
        }
        Err(_) => skipped("the replay of traces: no python3 (sudo apt-get install python3)"),
    }
}
