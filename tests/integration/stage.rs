//! Builds in steps: the file is that of one process, however the work is divided and whatever is lost on the way.

use super::harness::{CHPM, Folder, skipped, text, was_killed};
use std::fs;
use std::process::{Command, Stdio};

/// All steps of a plan behind it, as `chpm stage` takes them.
fn steps(parts: u32, levels: u32) -> Vec<String> {
    let all =
        |words: &str| (1..=parts).map(|part| format!("{words} --part {part}/{parts}")).collect::<Vec<_>>();
    let mut steps = all("scatter w.stages");
    steps.push("borders w.stages".to_owned());
    steps.extend(all("regions w.stages"));
    steps.push("hierarchy w.stages".to_owned());
    for level in 0..levels {
        steps.push(format!("group w.stages --level {level}"));
        steps.extend(all(&format!("simplify w.stages --level {level}")));
    }
    steps.push(format!("simplify w.stages --from-level {levels}"));
    steps.push("layout w.stages".to_owned());
    steps.extend(all("emit w.stages"));
    steps.push("finish w.stages -f".to_owned());
    steps
}

/// A model that has several regions, and what one process makes of it.
fn model(settings: &str) -> (Folder, Vec<u8>) {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 15000 --seed 3 -o model.ply -q");
    folder.stdout(&format!("build model.ply -o one.chpm -q {settings}"));
    let whole = folder.read("one.chpm");
    (folder, whole)
}

fn plan(folder: &Folder, parts: u32, levels: u32, settings: &str) {
    folder.stdout(&format!(
        "stage plan model.ply -o w.stages --parts {parts} --levels {levels} -q --threads 2 {settings}"
    ));
}

const SMALL: &str = "--cluster-triangles 64";

#[test]
fn a_plan_says_what_it_chose() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 2000 -o model.ply -q");
    let words = "--positions lattice:auto -q";
    let told = folder.stdout(&format!("build model.ply -o one.chpm {words}"));
    let note = told.lines().find(|line| line.starts_with("coordinates are multiples of")).expect("the step");
    let plan = folder.stdout(&format!("stage plan model.ply -o w.stages {words}"));
    assert!(plan.lines().any(|line| line == note), "{plan}");
}

#[test]
fn a_plan_has_the_settings_of_a_build() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 8000 -o model.ply -q");
    folder.write(
        "chpm.toml",
        "preset = \"terrain\"\n[settings]\ncluster-triangles = 64\nseed = 5\nno-resume = true\n",
    );
    folder.write("other.toml", "[settings]\ncluster-triangles = 128\n");
    for words in ["", "--config other.toml", "--no-config --preset preview", "--seed 7"] {
        folder.stdout(&format!("build model.ply -o one.chpm -qf {words}"));
        folder.stdout(&format!("stage plan model.ply -o w.stages -q {words}"));
        folder.stdout("work w.stages -o w.chpm -q --threads 2");
        assert!(folder.read("w.chpm") == folder.read("one.chpm"), "{words}");
        fs::remove_dir_all(folder.path("w.stages")).expect("the folder");
        fs::remove_file(folder.path("w.chpm")).expect("the model");
    }
    let told = folder.chpm("stage plan model.ply -o w.stages").success();
    assert!(text(&told.get_output().stderr).contains("settings from chpm.toml, preset terrain"));
    // More leaves, more levels in parts.
    folder.stdout("synth isosurface --triangles 40000 -o large.ply -q");
    let levels = |words: &str| {
        let words = format!("stage workflow large.ply -o w.chpm --parts 2 {words}");
        folder.stdout(&words).matches("rule simplify_").count()
    };
    assert!(levels("") > levels("-- --cluster-triangles 4096"));
    assert_eq!(levels(""), levels("-- --no-config --cluster-triangles 64"));
    let refused = folder.stderr("stage workflow - -o w.chpm --parts 2", 2);
    assert!(refused.contains("standard input"), "{refused}");
}

#[test]
fn any_number_of_parts_in_any_order_gives_the_bytes_of_one_process() {
    for settings in [
        SMALL,
        "--cluster-triangles 64 --pages packed --normals computed --finest-error 0.02%",
        "--cluster-triangles 64 --pages chained --positions lattice:14",
        "--cluster-triangles 128 --boundary lock --order cache-oblivious --target-error 1% --positions lattice:14",
    ] {
        let (folder, whole) = model(settings);
        for (parts, levels) in [(1, 0), (2, 2), (5, 3), (1, 30)] {
            plan(&folder, parts, levels, settings);
            let mut turn = 0;
            // Parts of a phase in another order each time, with other threads.
            for phase in
                steps(parts, levels).chunk_by(|a, b| a.split("--part").next() == b.split("--part").next())
            {
                turn += 1;
                let mut phase = phase.to_vec();
                let first = turn % phase.len();
                phase.rotate_left(first);
                if turn % 2 == 0 {
                    phase.reverse();
                }
                for step in phase {
                    folder.stdout(&format!("stage {step} -q --threads {}", 1 + turn % 3));
                }
            }
            assert!(folder.read("w.chpm") == whole, "{settings}: {parts} parts, {levels} levels");
            fs::remove_dir_all(folder.path("w.stages")).expect("the folder");
            fs::remove_file(folder.path("w.chpm")).expect("the model");
        }
    }
}

/// Names of the parts and when they were made.
fn made(folder: &Folder) -> Vec<(String, std::time::SystemTime)> {
    let mut made = Vec::new();
    for entry in fs::read_dir(folder.path("w.stages")).expect("the folder") {
        let entry = entry.expect("an entry");
        let time = entry.metadata().and_then(|found| found.modified()).expect("a time");
        made.push((entry.file_name().into_string().expect("a name"), time));
    }
    made.sort();
    made
}

#[test]
fn what_is_lost_or_damaged_is_made_again_and_nothing_else() {
    let (folder, whole) = model(SMALL);
    plan(&folder, 3, 2, SMALL);
    folder.stdout("work w.stages -q");
    assert!(folder.read("w.chpm") == whole);
    let first = made(&folder);
    let names: Vec<String> =
        first.iter().map(|(name, _)| name.clone()).filter(|name| name != "plan.part").collect();
    assert!(names.iter().all(|name| name.ends_with(".part")), "{names:?}");

    for (turn, name) in names.iter().enumerate() {
        let path = folder.path("w.stages").join(name);
        let bytes = fs::read(&path).expect("a part");
        if turn % 2 == 0 {
            fs::remove_file(&path).expect("a part");
        } else {
            // What stands at the end is looked at whenever the part is opened.
            let mut damaged = bytes.clone();
            let last = damaged.len() - 20;
            damaged[last] ^= 1;
            fs::write(&path, damaged).expect("a part");
        }
        let before = made(&folder);
        folder.stdout("work w.stages -q -f");
        assert!(fs::read(&path).expect("a part") == bytes, "{name} is as it was");
        let changed: Vec<String> =
            made(&folder).into_iter().filter(|now| !before.contains(now)).map(|(name, _)| name).collect();
        assert_eq!(
            changed,
            std::slice::from_ref(name),
            "the same bytes: nothing that was made of it has to be made again"
        );
        assert!(folder.read("w.chpm") == whole);
    }
}

#[test]
fn a_blob_that_is_damaged_is_named_by_who_reads_it_and_made_again_by_workers() {
    let (folder, whole) = model(SMALL);
    plan(&folder, 2, 1, SMALL);
    for step in steps(2, 1).iter().take_while(|step| !step.starts_with("layout")) {
        folder.stdout(&format!("stage {step} -q"));
    }
    // A page in the middle of what a level left: its record is whole.
    let path = folder.path("w.stages/simplify-0-2-of-2.part");
    let mut bytes = fs::read(&path).expect("a part");
    bytes[1000] ^= 16;
    fs::write(&path, &bytes).expect("a part");
    folder.stdout("stage layout w.stages -q");
    // Whichever half of the pages has some that lie there.
    let halves = ["1/2", "2/2"].map(|part| {
        folder.command(&format!("stage emit w.stages --part {part} -q")).output().expect("a process")
    });
    let told = halves.each_ref().map(|half| text(&half.stderr)).concat();
    assert!(halves.iter().all(|half| half.status.success() || half.status.code() == Some(2)), "{halves:?}");
    assert!(told.contains("simplify-0-2-of-2.part' is not what was written"), "{told}");
    assert!(told.contains("chpm stage simplify w.stages --level 0 --part 2/2"), "{told}");
    folder.stdout("work w.stages -q");
    assert!(folder.read("w.chpm") == whole);
}

#[test]
fn a_step_that_is_killed_at_any_access_is_done_again() {
    let (folder, whole) = model(SMALL);
    plan(&folder, 2, 1, SMALL);
    let mut kills = 0;
    for step in steps(2, 1) {
        for access in [0, 3, 20, 60] {
            let mut command = folder.command(&format!("stage {step} -q --threads 2 --kill-at {access}"));
            let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status().expect("a process");
            kills += u32::from(was_killed(status));
            assert!(was_killed(status) || status.success(), "{step}: {status}");
        }
        folder.stdout(&format!("stage {step} -q"));
    }
    assert!(kills > 10, "{kills}");
    assert!(folder.read("w.chpm") == whole);
}

#[test]
fn what_does_not_belong_together_is_refused_by_name() {
    let (folder, _) = model(SMALL);
    plan(&folder, 2, 1, SMALL);
    let told = folder.stderr("stage regions w.stages --part 2/2 -q", 2);
    assert!(told.contains("borders.part' is not there") && told.contains("stage borders w.stages"), "{told}");
    let told = folder.stderr("stage borders w.stages -q", 2);
    assert!(told.contains("scatter-1-of-2.part' is not there") && told.contains("--part 1/2"), "{told}");
    for step in ["scatter w.stages --part 1/2", "scatter w.stages --part 2/2", "borders w.stages"] {
        folder.stdout(&format!("stage {step} -q"));
    }
    let told = folder.stderr("stage hierarchy w.stages -q", 2);
    assert!(told.contains("regions-1-of-2.part' is not there") && told.contains("--part 1/2"), "{told}");
    let told = folder.stderr("stage regions w.stages --part 1/3 -q", 2);
    assert!(told.contains("has parts: 2, levels in parts: 1"), "{told}");
    let told = folder.stderr("stage simplify w.stages --from-level 3 -q", 2);
    assert!(told.contains("levels in parts: 1"), "{told}");
    // A plan that fails leaves no folder behind, but one that was there.
    folder.write("cut.ply", "ply\n");
    folder.stderr("stage plan cut.ply -o none.stages --parts 2 -q", 2);
    assert!(!folder.path("none.stages").exists());
    std::fs::create_dir(folder.path("mine")).expect("a folder");
    folder.stderr("stage plan cut.ply -o mine --parts 2 -q", 2);
    assert!(folder.path("mine").is_dir());
    let told = folder.stderr("stage regions elsewhere --part 1/3 -q", 2);
    assert!(told.contains("plan.part' is not there"), "{told}");

    // A part of other settings, and one under another's name.
    folder.stdout("stage regions w.stages --part 1/2 -q");
    folder.stdout("stage regions w.stages --part 2/2 -q");
    let first = folder.read("w.stages/regions-1-of-2.part");
    folder.write("w.stages/regions-2-of-2.part", &first);
    let told = folder.stderr("stage hierarchy w.stages -q", 2);
    assert!(told.contains("regions-2-of-2.part' holds what belongs into 'regions-1-of-2.part'"), "{told}");
    plan(&folder, 2, 1, "--cluster-triangles 96");
    let told = folder.stderr("stage hierarchy w.stages -q", 2);
    assert!(told.contains("borders.part' is of another plan"), "{told}");
    assert!(told.contains("chpm stage borders w.stages"), "{told}");
    let told = folder.stderr("stage borders w.stages -q", 2);
    assert!(told.contains("scatter-1-of-2.part' is of another plan"), "{told}");
    assert!(told.contains("chpm stage scatter w.stages --part 1/2"), "{told}");
    assert!(!folder.path("w.chpm").exists());
}

#[test]
fn any_number_of_workers_share_the_steps() {
    let (folder, whole) = model(SMALL);
    plan(&folder, 5, 3, SMALL);
    let worker = || {
        let mut command = folder.command("work w.stages -q --threads 1");
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("a process")
    };
    // One is killed on its way: what it had in hand is free for the others.
    let mut workers: Vec<_> = (0..4).map(|_| worker()).collect();
    std::thread::sleep(std::time::Duration::from_millis(300));
    workers[0].kill().expect("a process");
    let mut done = 0;
    for (index, worker) in workers.into_iter().enumerate() {
        let output = worker.wait_with_output().expect("a process");
        assert!(index == 0 || output.status.success(), "{}", text(&output.stderr));
        done += text(&output.stdout).lines().count();
    }
    assert!(folder.read("w.chpm") == whole);
    assert!(done <= steps(5, 3).len(), "no step is done twice: {done}");
}

#[test]
fn snakemake_runs_the_steps() {
    let folder = Folder::new();
    folder.stdout("synth terrain --triangles 30000 --seed 4 -o model.ply -q");
    folder.stdout(&format!("build model.ply -o one.chpm -q {SMALL}"));
    // Two tiles, of which a name has a blank.
    folder.stdout("synth isosurface --triangles 9000 -o other.ply -q");
    fs::rename(folder.path("other.ply"), folder.path("the other.ply")).expect("a name");
    fs::write(folder.path("w.tiles"), "tiles weld 0.0001\nmodel.ply\nthe other.ply\n").expect("a list");
    folder.stdout(&format!("build w.tiles -o both.chpm -q {SMALL}"));
    for (parts, sources, whole) in [
        (1, &[][..], "one.chpm"),
        (2, &[], "one.chpm"),
        (4, &["the other.ply", "--weld=0.0001"], "both.chpm"),
    ] {
        let words = format!(
            "stage workflow -o w.chpm --parts {parts} --levels 2 --threads 1 --memory 128M model.ply"
        );
        let settings = std::iter::once("--").chain(SMALL.split_whitespace());
        let file = folder.command(&words).args(sources).args(settings).output().expect("a workflow");
        assert!(file.status.success(), "{}", text(&file.stderr));
        folder.write("Snakefile", file.stdout);
        let run = Command::new("snakemake")
            .current_dir(folder.path(""))
            .env("HOME", folder.path(""))
            .env("XDG_CACHE_HOME", folder.path("cache"))
            .args(["--cores", "2", "-s", "Snakefile", "--config", &format!("chpm={CHPM}")])
            .output();
        let output = match run {
            Ok(output) => output,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return skipped("steps by Snakemake: it is not installed (pip install snakemake)");
            }
            Err(error) => panic!("snakemake: {error}"),
        };
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert!(folder.read("w.chpm") == folder.read(whole), "{parts} parts");
        fs::remove_dir_all(folder.path("w.stages")).expect("the folder");
        fs::remove_file(folder.path("w.chpm")).expect("the model");
    }
}
