//! The command line as people meet it: examples, completions, manual pages, a terminal's width, colours, slips of the finger.

use super::harness::{Folder, root, shell, text};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::process::Command;

/// The verbs that the command itself names.
fn verbs(folder: &Folder) -> Vec<String> {
    let help = folder.stdout("--help");
    let listed = help.lines().take_while(|line| *line != "Options:");
    let listed = listed.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    listed
        .filter_map(|line| line.split_whitespace().next())
        .filter(|verb| *verb != "help")
        .map(str::to_owned)
        .collect()
}

/// What the examples are about.
fn scan() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth terrain --triangles 6000 -o scan.ply -q");
    folder.stdout("build scan.ply -q --cluster-triangles 512");
    folder.stdout("extract scan.chpm --triangles 50% -o small.ply -q");
    folder.write("moves.poses", "0,0,0\n0,0,0.1\n");
    folder.write("rays.csv", "0.5,0.5,9,0,0,-1\n");
    folder.stdout("path dive scan.chpm --frames 3 -o dive.path");
    fs::create_dir(folder.path("scans")).expect("a folder");
    for seed in [1, 2] {
        folder.stdout(&format!("synth terrain --triangles 2000 --seed {seed} -o scans/{seed}.ply -q"));
    }
    let packed = shell(&folder, "gzip -k scan.ply");
    assert!(packed.status.success(), "{packed:?}");
    folder
}

#[test]
fn every_example_of_the_help_runs() {
    let folder = scan();
    let verbs = verbs(&folder);
    assert!(verbs.len() >= 17, "{verbs:?}");
    for verb in &verbs {
        let help = folder.stdout(&format!("help {verb}"));
        let (_, examples) = help.split_once("Examples:\n").unwrap_or_else(|| panic!("{verb}: {help}"));
        let commands = examples.lines().filter(|line| !line.starts_with("  # "));
        let commands: Vec<&str> = commands.collect();
        assert!(
            !commands.is_empty()
                && commands.iter().all(|line| line.starts_with("  chpm ") || line.starts_with("  zcat ")),
            "{help}"
        );
        if verb == "build" {
            fs::remove_file(folder.path("scan.chpm")).expect("a file");
        }
        // A window is opened by the tests of the viewer, and a host does not end by itself.
        for example in commands.into_iter().filter(|_| !matches!(&verb[..], "view" | "serve")) {
            let run = shell(&folder, example);
            let told = text(&run.stderr);
            assert!(
                run.status.success() && !told.lines().any(|line| line.starts_with("error")),
                "{example}: {told}"
            );
        }
        if verb == "build" {
            folder.stdout("build scan.ply -q -f --cluster-triangles 512");
        }
    }
    let made = [
        "piped.chpm",
        "clean.chpm",
        "packed.chpm",
        "level.ply",
        "clusters.csv",
        "chpm.bash",
        "report.html",
        "built/index.html",
    ];
    for name in made {
        assert!(!folder.read(name).is_empty(), "{name}");
    }
}

#[test]
fn shells_complete_every_verb() {
    let folder = Folder::new();
    for (name, word) in [("bash", "complete -F"), ("zsh", "#compdef chpm"), ("fish", "complete -c chpm")] {
        let script = folder.stdout(&format!("completions {name}"));
        assert!(script.contains(word), "{name}");
        for verb in verbs(&folder) {
            assert!(script.contains(&verb), "{name}: {verb}");
        }
        // What only the command itself calls is not typed.
        let mut words = script.split(|c: char| !c.is_ascii_alphanumeric());
        assert!(!words.any(|word| word == "contend"), "{name}");
        assert!(script.contains("version"), "{name}");
    }
    folder.write("chpm.bash", folder.stdout("completions bash"));
    let typed = "source ./chpm.bash && COMP_WORDS=(chpm ver) && COMP_CWORD=1 && _chpm chpm ver chpm && echo ${COMPREPLY[@]}";
    let run = Command::new("bash").current_dir(folder.path("")).args(["-c", typed]).output().expect("bash");
    assert_eq!(text(&run.stdout).trim(), "verify", "{}", text(&run.stderr));
    assert!(folder.stderr("completions tcsh", 2).contains("zsh"));
}

#[test]
fn every_verb_has_a_manual_page_that_is_not_replaced() {
    let folder = Folder::new();
    folder.stdout("man pages");
    let expected: BTreeSet<String> =
        verbs(&folder).iter().map(|verb| format!("chpm-{verb}.1")).chain(["chpm.1".to_owned()]).collect();
    let names: BTreeSet<String> = fs::read_dir(folder.path("pages"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    assert_eq!(names, expected);
    let page = text(&folder.read("pages/chpm-stats.1"));
    assert!(page.contains(".SH NAME") && page.contains("assert") && page.contains("Examples"), "{page}");
    // What an option takes is in the synopsis, too.
    let page = text(&folder.read("pages/chpm-extract.1")).replace("\\-", "-");
    let (_, synopsis) = page.split_once(".SH SYNOPSIS").expect("a synopsis");
    let synopsis = synopsis.split(".SH").next().unwrap_or_default();
    for part in [
        "[--format FORMAT]",
        "[-f|--force]",
        "-o|--output FILE",
        "<--triangles N|--error E|--level L|--poe P|--lods N,N>",
        " FILE",
    ] {
        assert!(synopsis.contains(part), "{part}: {synopsis}");
    }
    assert!(folder.stderr("man pages", 2).contains("--force"));
    folder.stdout("man pages --force");
}

#[test]
fn a_table_fits_a_narrow_terminal_and_a_pipe_gets_all_of_it() {
    let folder = scan();
    let lines = |columns: u32| {
        let line = format!(
            "script -qec 'stty rows 24 cols {columns}; chpm info scan.chpm --levels --refusals; chpm stats scan.chpm' /dev/null"
        );
        let run = shell(&folder, &line);
        assert!(run.status.success(), "{}", text(&run.stderr));
        text(&run.stdout).lines().map(|line| line.trim_end().to_owned()).collect::<Vec<_>>()
    };
    let is_table = |line: &&String| line.starts_with(' ');
    for columns in [60, 80] {
        let widest = lines(columns).iter().filter(is_table).map(|line| line.chars().count()).max();
        assert!(widest.is_some_and(|widest| widest <= columns as usize), "{widest:?} of {columns}");
    }
    let wide = lines(400);
    let piped = folder.stdout("info scan.chpm --levels --refusals") + &folder.stdout("stats scan.chpm");
    let piped: Vec<&str> = piped.lines().map(str::trim_end).collect();
    assert_eq!(wide, piped);
}

#[test]
fn colours_are_for_terminals_that_want_them() {
    let folder = Folder::new();
    let run = |before: &str| {
        let run = shell(&folder, &format!("script -qec '{before} chpm info; true' /dev/null"));
        text(&run.stdout)
    };
    assert!(run("env -u NO_COLOR TERM=xterm").contains('\u{1b}'), "{}", run(""));
    assert!(!run("NO_COLOR=1 TERM=xterm").contains('\u{1b}'));
    assert!(!folder.stderr("info", 2).contains('\u{1b}'), "a pipe has none");
}

#[test]
fn a_slip_of_the_finger_is_answered() {
    let folder = Folder::new();
    for (typed, meant) in [
        ("biuld x.ply", "'build'"),
        ("stat x.chpm", "'stats'"),
        ("build x.ply --cluster-triangle 3", "'--cluster-triangles'"),
        ("build x.ply --partitioner mettis", "metis"),
        ("completions bsh", "bash"),
    ] {
        let error = folder.stderr(typed, 2);
        assert!(error.contains(meant), "{typed}: {error}");
    }
}

#[test]
fn a_build_tells_how_far_it_is_on_a_terminal() {
    let folder = Folder::new();
    // A bar is drawn twenty times a second: it takes a while until it has told all.
    folder.stdout("synth terrain --triangles 100000 -o scan.ply -q");
    let run =
        shell(&folder, "script -qec 'stty rows 24 cols 100; chpm build scan.ply --threads 1' /dev/null");
    let told = text(&run.stdout);
    assert!(run.status.success() && told.contains("simplify") && told.contains(" left"), "{told}");
    assert!(told.contains("triangles/s, "), "{told}");
}

#[test]
fn the_readme_gets_to_a_picture_in_two_commands() {
    let readme = fs::read_to_string(root().join("README.md")).expect("the page");
    let (start, _) = readme.split_once("## What it does").expect("the beginning");
    let commands = start.lines().filter(|line| line.starts_with("cargo run --profile quick -- "));
    assert_eq!(commands.count(), 2, "{start}");
    assert!(start.contains("-- build scan.ply") && start.contains("-- view scan.chpm"));
}

#[test]
fn names_and_comments_of_files_are_no_commands_to_a_terminal() {
    // Title, colours in both spellings, a bell, a line of its own, the other direction.
    let (name, comment) = ("a\u{1b}]0;b\u{7}\u{202e}c", "by \u{1b}[31mhand\u{9b}2J\u{8}\u{2066}");
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 100 -o in.ply -q");
    let mesh = folder.read("in.ply");
    let end = mesh.iter().position(|byte| *byte == b'\n').expect("a line") + 1;
    let header = format!("ply\nformat binary_little_endian 1.0\ncomment {comment}\n");
    let rest = mesh[end..].iter().position(|byte| *byte == b'\n').expect("a line") + end + 1;
    folder.write(&format!("{name}.ply"), [header.as_bytes(), &mesh[rest..]].concat());
    let mut said = Vec::new();
    let mut say = |words: &str, code: i32| {
        let output = folder.chpm(words).code(code);
        let told = text(&output.get_output().stdout) + &text(&output.get_output().stderr);
        said.push((words.to_owned(), told));
    };
    say(&format!("build {name}.ply --verbose"), 0);
    let file = format!("{name}.chpm");
    for words in
        ["info X", "info X --settings", "verify X", "stats X", "extract X --level 0 -o X.ply", "dump X"]
    {
        say(&words.replace('X', &file), 0);
    }
    for words in ["info none-X", "info X --no\u{202e}", "extract X --level 99 -o out.ply", "build X"] {
        say(&words.replace('X', &file), 2);
    }
    folder.write("in.txt", "no mesh \u{1b}[2J");
    say("build in.txt", 2);
    for (words, told) in said {
        let command = |c: char| c.is_control() && c != '\n' || matches!(c, '\u{202e}' | '\u{2066}');
        assert!(!told.contains(command), "{words:?}: {told:?}");
        // These have no name to tell.
        let is_nameless = words.contains("in.txt") || words.starts_with("stats");
        assert!(is_nameless || told.contains("\\u"), "{words:?}: {told}");
    }
    let info: Value = serde_json::from_str(&folder.stdout(&format!("info {file} --json"))).expect("JSON");
    assert_eq!((&info["file"], &info["source"]["name"]), (&json!(file), &json!(format!("{name}.ply"))));
    assert_eq!(info["source"]["comments"][0], comment);
}
