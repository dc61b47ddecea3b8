//! The documents: how long they are, where their links lead, and that what they say to type works.

use super::harness::{Folder, root, shell, text};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Documents that are generated, the normative ones, and the history.
const APART: [&str; 5] =
    ["JSON.md", "docs/VERBS.md", "crates/chpm-format/FORMAT.md", "docs/MESHLETS.md", "CHANGELOG.md"];
/// Words of all other documents together, and of the first one.
const MOST_WORDS: usize = 18_000;
const MOST_WORDS_OF_README: usize = 900;

/// Every document of the repository, as git knows them.
fn documents() -> Vec<PathBuf> {
    let output = Command::new("git").current_dir(root()).args(["ls-files", "*.md"]).output().expect("git");
    text(&output.stdout).lines().map(PathBuf::from).collect()
}

fn read(path: impl AsRef<Path>) -> String {
    fs::read_to_string(root().join(path)).expect("a document")
}

/// Blocks of code in a language.
fn blocks<'a>(page: &'a str, language: &str) -> Vec<&'a str> {
    let start = format!("```{language}\n");
    let opened = page.split(&*start).skip(1);
    opened.map(|rest| rest.split("```").next().unwrap_or_default()).collect()
}

/// Words of a document without the tables that are generated.
fn words(path: &Path) -> usize {
    let page = read(path);
    let written = page.split("| case | what it is |").next().unwrap_or_default();
    let generated = written.split("<!-- verbs").nth(1).and_then(|rest| rest.split("<!-- end").next());
    written.split_whitespace().count() - generated.map_or(0, |table| table.split_whitespace().count())
}

#[test]
fn documents_stay_short() {
    let written = documents().into_iter().filter(|path| !APART.iter().any(|apart| path == Path::new(apart)));
    let counts: Vec<_> = written.map(|path| (words(&path), path)).collect();
    let all: usize = counts.iter().map(|(words, _)| words).sum();
    assert!(all <= MOST_WORDS, "{all} words: {counts:?}");

    let readme = read("README.md");
    assert!(words(Path::new("README.md")) <= MOST_WORDS_OF_README);
    let tables = readme.lines().filter(|line| line.starts_with("|--")).count();
    assert_eq!(tables, 1, "one table");
}

/// Names that a link into a page may have: its headings as they are written in addresses, and what it names itself.
fn anchors(page: &str) -> Vec<String> {
    let headings = page.lines().filter(|line| line.starts_with('#'));
    let slug = |line: &str| {
        let text = line.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
        text.chars().filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect()
    };
    let named = page.split("<a name=\"").skip(1).filter_map(|rest| rest.split('"').next());
    headings.map(slug).chain(named.map(str::to_owned)).collect()
}

#[test]
fn links_lead_somewhere() {
    for document in documents() {
        let page = read(&document);
        let links = page.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for link in links.filter(|link| !link.contains("://") && !link.contains(' ')) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let path = match file {
                "" => document.clone(),
                file => document.parent().expect("a folder").join(file),
            };
            assert!(root().join(&path).exists(), "{}: {link}", document.display());
            let is_there = anchor.is_empty() || anchors(&read(&path)).iter().any(|name| name == anchor);
            assert!(is_there, "{}: {link}", document.display());
        }
    }
}

#[test]
fn the_readme_shows_the_example() {
    let readme = read("README.md");
    let example = read("crates/chpm-build/examples/build_and_select.rs");
    let lines: Vec<&str> = example.lines().map(str::trim).collect();
    let [shown] = blocks(&readme, "rust")[..] else { panic!("one block of Rust") };
    for line in shown.lines().map(str::trim).filter(|line| !line.is_empty()) {
        assert!(lines.contains(&line), "not in the example, which is compiled and runs: {line}");
    }
}

/// A folder with what the pages speak of.
fn scans() -> Folder {
    let folder = Folder::new();
    for (name, seed) in [("scan", 1), ("second", 2), ("small", 3)] {
        folder.stdout(&format!("synth terrain --triangles 4000 --seed {seed} -o {name}.ply -q"));
    }
    folder
}

/// Runs each block of shell commands of a page, but for what opens a window, serves without end or compiles.
fn run_commands(page: &str, folder: &Folder) {
    let is_run = |line: &&str| {
        !["chpm view", "chpm serve", "cargo", "pip", "bash"].iter().any(|word| line.starts_with(word))
    };
    for block in blocks(&read(page), "sh") {
        let lines: Vec<&str> = block.lines().filter(is_run).collect();
        // A demo of the usual size is a minute's work for what follows.
        let lines = lines.join("\n").replace("chpm demo", "chpm demo --triangles 30000");
        let run = shell(folder, &format!("set -e\n{lines}"));
        assert!(run.status.success(), "{page}: {block}{}", text(&run.stderr));
    }
}

#[test]
#[cfg_attr(not(all(feature = "viewer", feature = "web")), ignore = "the pages use every verb")]
fn every_command_of_the_pages_runs() {
    run_commands("README.md", &Folder::new());
    run_commands("docs/HOW_DO_I.md", &scans());
}
