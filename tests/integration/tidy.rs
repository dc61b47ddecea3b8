//! The house rules: which crate may use which, where unsafe code may be, how long a file gets.

use super::harness::{root, skipped, text};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Crates of this workspace that each may depend on; tests may use more.
const EDGES: [(&str, &[&str]); 21] = [
    ("chpm-mesh", &[]),
    ("chpm-extmem", &[]),
    ("chpm-image", &[]),
    ("chpm-texture", &["chpm-extmem", "chpm-image", "chpm-mesh"]),
    ("chpm-partition", &["chpm-extmem"]),
    ("chpm-import", &["chpm-mesh", "chpm-extmem", "chpm-texture"]),
    ("chpm-synth", &["chpm-mesh"]),
    ("chpm-qem", &["chpm-mesh"]),
    ("chpm-format", &["chpm-mesh"]),
    ("chpm-measure", &["chpm-mesh"]),
    ("chpm-reduce", &["chpm-mesh", "chpm-measure", "chpm-qem"]),
    ("chpm-export", &["chpm-mesh", "chpm-format", "chpm-refine", "chpm-image", "chpm-texture"]),
    ("chpm-refine", &["chpm-mesh", "chpm-format"]),
    ("chpm-space", &["chpm-mesh", "chpm-format", "chpm-refine"]),
    ("chpm-proximity", &["chpm-mesh", "chpm-format", "chpm-refine", "chpm-space"]),
    ("chpm-section", &["chpm-mesh", "chpm-format", "chpm-refine"]),
    ("chpm-rays", &["chpm-mesh", "chpm-format", "chpm-refine", "chpm-space", "chpm-texture"]),
    (
        "chpm-build",
        &[
            "chpm-mesh",
            "chpm-import",
            "chpm-extmem",
            "chpm-partition",
            "chpm-qem",
            "chpm-format",
            "chpm-image",
            "chpm-texture",
        ],
    ),
    (
        "chpm-report",
        &["chpm-mesh", "chpm-extmem", "chpm-format", "chpm-measure", "chpm-refine", "chpm-texture"],
    ),
    (
        "chpm-verify",
        &[
            "chpm-mesh",
            "chpm-import",
            "chpm-extmem",
            "chpm-format",
            "chpm-refine",
            "chpm-measure",
            "chpm-image",
            "chpm-texture",
        ],
    ),
    ("chpm-viewer", &["chpm-mesh", "chpm-format", "chpm-refine", "chpm-extmem", "chpm-texture"]),
];

/// The modules of chpm-build: each may use those before it.
const LAYERS: [&str; 31] = [
    "ids",
    "trace",
    "progress",
    "report",
    "error",
    "config",
    "allowance",
    "range",
    "clock",
    "memo",
    "context",
    "vertex_columns",
    "pairs",
    "in_order",
    "per_thread",
    "join",
    "ingest",
    "fingerprint",
    "decompose",
    "hierarchy",
    "triangle_order",
    "simplify",
    "trim",
    "sheets",
    "layout",
    "output",
    "chain",
    "emit",
    "checkpoint",
    "pipeline",
    "stage",
];

/// What only the command may use; but chpm-export and chpm-report write JSON, and chpm-import reads some.
const COMMAND_ONLY: [&str; 5] = ["anyhow", "clap", "comfy-table", "indicatif", "serde_json"];

const LONGEST: usize = 600;

/// Names in `[dependencies]` of a manifest.
fn dependencies(manifest: &Path) -> Vec<String> {
    let text = fs::read_to_string(manifest).expect("a manifest");
    let lines = text.lines().skip_while(|line| *line != "[dependencies]").skip(1);
    let lines = lines.take_while(|line| !line.starts_with('[')).filter(|line| !line.trim().is_empty());
    lines.map(|line| line.split(['.', ' ', '=']).next().unwrap_or_default().to_owned()).collect()
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

fn all_sources() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in ["src", "tests", "benches", "crates", "python/src"] {
        sources(&root().join(folder), &mut found);
    }
    assert!(found.len() > 50, "the sources are here");
    found
}

/// What is built in the root folder, without naming a package, is the command alone; and without its features, without the viewer.
/// What a package has to tell of libraries of C and of fonts is told, and the package has it.
#[test]
fn packages_name_what_others_wrote() {
    let mut command = Command::new("python3");
    command.current_dir(root()).env("CARGO_NET_OFFLINE", "true").args(["packaging/notices.py", "Cargo.toml"]);
    match command.output() {
        Ok(output) => {
            assert!(output.status.success(), "{}", text(&output.stderr));
            let told = text(&output.stdout);
            for part in [
                "metis-sys 0.",
                "vendor/metis/LICENSE",
                "zstd/LICENSE",
                "Meta Platforms",
                "Arseny Kapoulkine",
                "SIL OPEN FONT LICENSE",
                "UBUNTU FONT LICENCE",
            ] {
                assert!(told.contains(part), "{part}");
            }
            let is_named = |name: &str| told.lines().any(|line| line.starts_with(&format!("{name} ")));
            let others = dependencies(&root().join("Cargo.toml"));
            let unnamed: Vec<&String> =
                others.iter().filter(|name| !name.starts_with("chpm") && !is_named(name)).collect();
            assert!(unnamed.is_empty(), "{unnamed:?}");
        }
        Err(_) => skipped("the notices of packages: no python3 (sudo apt-get install python3)"),
    }
    let read = |path: &str| fs::read_to_string(root().join(path)).expect("a file");
    assert!(read("Cargo.toml").contains("target/package/THIRD-PARTY-NOTICES.gz"));
    assert!(read("packaging/deb.sh").contains("packaging/notices.py Cargo.toml"));
    assert!(read("python/pyproject.toml").contains("THIRD-PARTY-NOTICES"));
    let wheel = read("python/THIRD-PARTY-NOTICES");
    assert!(wheel.contains("Meta Platforms") && wheel.contains("pyo3 0."));
}

#[test]
fn who_leaves_the_viewer_out_does_not_compile_it() {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let crates = |words: &str| {
        let mut tree = Command::new(&cargo);
        tree.args(["tree", "--locked", "--offline", "--edges", "normal", "--prefix", "none"]);
        let out = tree.args(words.split_whitespace()).current_dir(root()).output().expect("cargo runs");
        assert!(out.status.success(), "{}", text(&out.stderr));
        text(&out.stdout)
    };
    let draws = |crates: &str| crates.lines().any(|line| line.starts_with("wgpu "));
    assert!(draws(&crates("")) && !draws(&crates("--no-default-features")));
}

#[test]
fn crates_use_only_what_lies_below_them() {
    let mut seen = 0;
    for entry in fs::read_dir(root().join("crates")).expect("crates").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let (_, allowed) =
            EDGES.iter().find(|(from, _)| *from == name).unwrap_or_else(|| panic!("{name} is new"));
        for used in dependencies(&entry.path().join("Cargo.toml")) {
            let is_ours = used.starts_with("chpm-");
            assert!(!is_ours || allowed.contains(&used.as_str()), "{name} must not use {used}");
            let is_content = ["chpm-export", "chpm-import", "chpm-report"].contains(&name.as_str())
                && used == "serde_json";
            assert!(is_content || !COMMAND_ONLY.contains(&used.as_str()), "{name} must not use {used}");
        }
        seen += 1;
    }
    assert_eq!(seen, EDGES.len());
}

/// The Python package has no viewer. It is a workspace of its own, with the versions of this one where both use a crate.
#[test]
fn the_python_package_has_the_same_crates() {
    let folder = root().join("python");
    let allowed = [
        "chpm-build",
        "chpm-export",
        "chpm-extmem",
        "chpm-format",
        "chpm-import",
        "chpm-measure",
        "chpm-mesh",
        "chpm-rays",
        "chpm-reduce",
        "chpm-refine",
        "chpm-section",
        "chpm-verify",
    ];
    for used in dependencies(&folder.join("Cargo.toml")).iter().filter(|used| used.starts_with("chpm-")) {
        assert!(allowed.contains(&used.as_str()), "the Python package must not use {used}");
    }
    let library = fs::read_to_string(folder.join("src/lib.rs")).expect("a root module");
    assert!(library.contains(concat!("#![forbid(un", "safe_code)]")));
    let locked = |path: PathBuf| {
        let text = fs::read_to_string(path).expect("a lock file");
        let value = |block: &str, key: &str| {
            let line = block.lines().find_map(|line| line.strip_prefix(key));
            line.unwrap_or_default().trim_matches('"').to_owned()
        };
        let blocks = text.split("[[package]]").skip(1);
        blocks.map(|block| (value(block, "name = "), value(block, "version = "))).collect::<Vec<_>>()
    };
    let (ours, theirs) = (locked(root().join("Cargo.lock")), locked(folder.join("Cargo.lock")));
    let mut shared = 0;
    for package in theirs {
        let known = ours.iter().filter(|(name, _)| *name == package.0).collect::<Vec<_>>();
        shared += usize::from(!known.is_empty());
        let fix = "cp Cargo.lock python/, then cargo metadata --manifest-path python/Cargo.toml";
        assert!(known.is_empty() || known.contains(&&package), "{package:?} and {known:?}: {fix}");
    }
    assert!(shared > 30, "{shared} crates are used by both");
}

/// Names after `crate::` in a source, of modules and of what the crate's root has.
fn used_modules(text: &str) -> impl Iterator<Item = &str> {
    let code = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    let uses = code.flat_map(|line| line.split("crate::").skip(1));
    uses.map(|rest| rest.split(|c: char| c != '_' && !c.is_ascii_lowercase()).next().unwrap_or_default())
}

#[test]
fn modules_of_the_build_use_only_those_before_them() {
    let source = root().join("crates/chpm-build/src");
    let layer = |name: &str| LAYERS.iter().position(|layer| *layer == name);
    let mut seen = BTreeSet::new();
    let mut files = Vec::new();
    sources(&source, &mut files);
    for path in files.iter().filter(|path| **path != source.join("lib.rs")) {
        let inside = path.strip_prefix(&source).expect("a file below it").with_extension("");
        let name = inside.iter().next().expect("a name").to_string_lossy().into_owned();
        let own = layer(&name).unwrap_or_else(|| panic!("{name} is new: give it a place among the layers"));
        seen.insert(name);
        let text = fs::read_to_string(path).expect("a source");
        for used in used_modules(&text) {
            let below = layer(used).is_none_or(|used| used <= own);
            assert!(below, "{} must not use {used}", path.display());
        }
    }
    assert_eq!(seen.len(), LAYERS.len(), "{seen:?}");
}

/// Names that a source takes from its crate's root, its tests apart: of modules, and what the root re-exports.
fn used_names(text: &str) -> Vec<String> {
    let text = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let code: String =
        text.lines().flat_map(|line| [line.split("//").next().unwrap_or_default(), " "]).collect();
    let mut names = Vec::new();
    for rest in code.split("crate::").skip(1) {
        let Some(list) = rest.strip_prefix('{') else {
            names.extend(rest.split(|c: char| c != '_' && !c.is_alphanumeric()).next().map(str::to_owned));
            continue;
        };
        // Of a list only what stands before the inner lists, and before the end.
        let mut depth = 1;
        let outer: String = list
            .chars()
            .take_while(|c| {
                depth += i32::from(*c == '{') - i32::from(*c == '}');
                depth > 0
            })
            .collect();
        let mut depth = 0;
        for item in outer.split_inclusive([',', '{', '}']) {
            if depth == 0 {
                names.push(item.trim().split([':', ',', ' ']).next().unwrap_or_default().to_owned());
            }
            depth += i32::from(item.ends_with('{')) - i32::from(item.ends_with('}'));
        }
    }
    names
}

#[test]
fn modules_of_the_format_have_no_circle() {
    let source = root().join("crates/chpm-format/src");
    let library = fs::read_to_string(source.join("lib.rs")).expect("the library");
    let mut home = BTreeMap::new();
    for line in library.lines().filter_map(|line| line.strip_prefix("pub use ")) {
        let (module, names) = line.trim_end_matches(';').split_once("::").expect("a name of a module");
        let names = names.trim_matches(['{', '}']).split(',');
        home.extend(names.map(|name| (name.trim().to_owned(), module.to_owned())));
    }

    let (mut files, mut uses) = (Vec::new(), BTreeMap::<String, BTreeSet<String>>::new());
    sources(&source, &mut files);
    for path in files.iter().filter(|path| **path != source.join("lib.rs")) {
        let inside = path.strip_prefix(&source).expect("a file below it").with_extension("");
        let name = inside.iter().next().expect("a name").to_string_lossy().into_owned();
        let text = fs::read_to_string(path).expect("a source");
        let used = used_names(&text).into_iter().map(|name| home.get(&name).cloned().unwrap_or(name));
        uses.entry(name).or_default().extend(used);
    }
    let known: BTreeSet<String> = uses.keys().cloned().collect();
    for (name, used) in &mut uses {
        used.retain(|used| used != name && known.contains(used));
    }
    assert!(uses["packed"].contains("page") && uses["records"].contains("header"), "{uses:?}");

    // Whoever uses nothing that is left goes; of a circle nobody does.
    while !uses.is_empty() {
        let free: Vec<String> =
            uses.iter().filter(|(_, used)| used.is_empty()).map(|(name, _)| name.clone()).collect();
        assert!(!free.is_empty(), "a circle among {uses:?}");
        uses.retain(|name, _| !free.contains(name));
        uses.values_mut().for_each(|used| used.retain(|used| !free.contains(used)));
    }
}

#[test]
fn unsafe_code_has_three_addresses() {
    let homes =
        ["map.rs", "metis.rs", "platform"].map(|file| root().join("crates/chpm-extmem/src").join(file));
    for path in all_sources() {
        let text = fs::read_to_string(&path).expect("a source");
        let code = text.lines().map(|line| line.split("//").next().unwrap_or_default());
        // In two parts, or this line would be found.
        let word = concat!("un", "safe ");
        let found = code.filter(|line| line.contains(word)).count();
        let is_home = homes.iter().any(|home| path.starts_with(home));
        assert!(is_home || found == 0, "{}", path.display());
    }
    for (name, _) in EDGES {
        let text =
            fs::read_to_string(root().join("crates").join(name).join("src/lib.rs")).expect("a root module");
        let lint = if name == "chpm-extmem" { "#![deny(" } else { "#![forbid(" };
        assert!(text.contains(&format!("{lint}{}_code)]", concat!("un", "safe"))), "{name}");
    }
}

/// Words of code that one system understands, or that ask which one it is.
const OF_A_SYSTEM: [&str; 6] = ["cfg(unix)", "cfg(windows)", "target_os", "std::os::", "nix::", "rustix::"];

#[test]
fn systems_differ_in_one_folder() {
    let homes = ["crates/chpm-extmem/src/platform", "src/stop"].map(|home| root().join(home));
    for path in library_sources() {
        let text = fs::read_to_string(&path).expect("a source");
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        let found = OF_A_SYSTEM.iter().find(|word| code.contains(**word));
        let is_home = homes.iter().any(|home| path.starts_with(home)) || path.ends_with("tests.rs");
        assert!(is_home || found.is_none(), "{}: {found:?}", path.display());
    }
}

/// Functions that every system's library rounds in its own way; those of the crate `libm` are the same everywhere.
const OF_A_MATH_LIBRARY: [&str; 16] = [
    ".sin()",
    ".cos()",
    ".tan()",
    ".sin_cos()",
    ".asin()",
    ".acos()",
    ".atan()",
    ".atan2(",
    ".log2()",
    ".log10()",
    ".ln()",
    ".exp()",
    ".exp2()",
    ".powf(",
    ".cbrt()",
    ".mul_add(",
];

#[test]
fn no_byte_depends_on_the_math_library_of_a_system() {
    let homes = [
        "build",
        "export",
        "extmem",
        "format",
        "image",
        "import",
        "mesh",
        "partition",
        "qem",
        "synth",
        "texture",
    ]
    .map(|name| root().join("crates").join(format!("chpm-{name}")));
    for path in library_sources() {
        let text = fs::read_to_string(&path).expect("a source");
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        let found = OF_A_MATH_LIBRARY.iter().find(|word| code.contains(**word));
        // The second one is an oracle for tests.
        let is_test = path.ends_with("tests.rs") || path.ends_with("overlay/exact.rs");
        let is_written = homes.iter().any(|home| path.starts_with(home)) && !is_test;
        assert!(!is_written || found.is_none(), "{}: {found:?}", path.display());
    }
}

#[test]
fn files_stay_short() {
    for path in all_sources() {
        let lines = fs::read_to_string(&path).expect("a source").lines().count();
        assert!(lines <= LONGEST, "{}: {lines} lines", path.display());
    }
}

/// Documentation comments in `src` folders that may open with "What": helps of options, which keep their wording. To be lowered, not raised.
const OPEN_WITH_WHAT: usize = 29;

/// Documented examples that there are at least. To be raised, not lowered.
const EXAMPLES: usize = 30;

/// Files in `src` folders of the workspace.
fn library_sources() -> Vec<PathBuf> {
    let mut found = all_sources();
    found.retain(|path| {
        let inside = path.strip_prefix(root()).expect("a file of the project");
        !inside.starts_with("python") && inside.iter().any(|part| part == "src")
    });
    found
}

fn is_doc(line: &str) -> bool {
    line.starts_with("///") || line.starts_with("//!")
}

/// First lines of documentation comments.
fn doc_openings(text: &str) -> impl Iterator<Item = &str> {
    let before = std::iter::once("").chain(text.lines());
    let pairs = text.lines().zip(before).map(|(line, before)| (line.trim_start(), before.trim_start()));
    pairs.filter(|(line, before)| is_doc(line) && !is_doc(before)).map(|(line, _)| line)
}

#[test]
fn docs_open_with_a_noun() {
    let mut found = Vec::new();
    for path in library_sources() {
        let text = fs::read_to_string(&path).expect("a source");
        let openings = doc_openings(&text).filter(|line| line[3..].trim_start().starts_with("What "));
        found.extend(openings.map(|line| format!("{}: {line}", path.display())));
    }
    assert!(found.len() <= OPEN_WITH_WHAT, "{}", found.join("\n"));
}

#[test]
fn main_items_have_examples() {
    let fences = |text: &str| text.lines().filter(|line| line.trim_start().starts_with("/// ```")).count();
    let mut found = 0;
    for path in library_sources() {
        found += fences(&fs::read_to_string(&path).expect("a source")) / 2;
    }
    assert!(found >= EXAMPLES, "{found} examples");
}
