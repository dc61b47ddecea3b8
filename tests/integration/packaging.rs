use super::harness::{Folder, root};
use std::collections::BTreeSet;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::process::Command;
use yaml_rust2::{Yaml, YamlLoader};

const VERSION: &str = env!("CARGO_PKG_VERSION");

fn yaml(text: &str) -> Yaml {
    YamlLoader::load_from_str(text).expect("YAML").swap_remove(0)
}

fn read(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Names of the archives that the release's workflow makes.
fn archives() -> BTreeSet<String> {
    let workflow = yaml(&read(".github/workflows/release.yml"));
    let programs = workflow["jobs"]["program"]["strategy"]["matrix"]["include"].as_vec().expect("a list");
    let name = |entry: &Yaml| {
        let target = entry["target"].as_str().expect("a target");
        let ending = if target.contains("windows") { "zip" } else { "tar.xz" };
        format!("chpm-{VERSION}-{target}.{ending}")
    };
    let source = format!("chpm-{VERSION}.tar.gz");
    assert!(
        read(".github/workflows/release.yml").contains("dist/chpm-${GITHUB_REF_NAME#v}.tar.gz"),
        "{source}"
    );
    programs.iter().map(name).chain([source]).collect()
}

/// Manifests name archives that a release has, with their checksums, and nothing in them is left to fill in.
#[test]
fn manifests_name_what_a_release_has() {
    let folder = Folder::new();
    fs::create_dir(folder.path("dist")).expect("a folder");
    let archives = archives();
    for name in &archives {
        folder.write(&format!("dist/{name}"), name);
    }

    let mut command = Command::new("python3");
    command.current_dir(folder.path("")).arg(root().join("packaging/manifests.py"));
    let output = command.args(["dist", "https://example.org/v1", "out"]).output().expect("python3");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let manifests = String::from_utf8(output.stdout).expect("names");
    assert_eq!(manifests.lines().count(), 5);

    for path in manifests.lines() {
        let text = fs::read_to_string(folder.path(path)).expect("a manifest");
        assert!(!text.contains('@') && text.contains(VERSION), "{path}: {text}");
        for (at, _) in text.match_indices("https://example.org/v1/") {
            let name = text[at..].split(['"', '\n']).next().and_then(|address| address.rsplit('/').next());
            assert!(archives.contains(name.expect("a name")), "{path}: {name:?}");
        }
        if path.ends_with(".yaml") {
            let read = yaml(&text);
            assert!(!read.as_hash().expect("keys").is_empty(), "{path}");
        }
    }
}

/// The installer's checksum is that of the archive: SHA-256 of its own name, here.
#[test]
fn a_manifest_has_the_checksum_of_its_archive() {
    let folder = Folder::new();
    fs::create_dir(folder.path("dist")).expect("a folder");
    for name in archives() {
        folder.write(&format!("dist/{name}"), "abc");
    }
    let mut command = Command::new("python3");
    command.current_dir(folder.path("")).arg(root().join("packaging/manifests.py"));
    assert!(command.args(["dist", "https://example.org", "out"]).status().expect("python3").success());

    // FIPS 180-2, appendix B.1.
    let of_abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    let winget =
        yaml(&fs::read_to_string(folder.path("out/winget/chpm.installer.yaml")).expect("a manifest"));
    assert_eq!(winget["Installers"][0]["InstallerSha256"].as_str(), Some(of_abc));
    let conda = yaml(&fs::read_to_string(folder.path("out/conda/recipe.yaml")).expect("a manifest"));
    assert_eq!(conda["source"]["sha256"].as_str(), Some(of_abc));
}

/// What Windows and macOS link is named in their archives: cargo is asked about the system that an archive is for.
#[test]
fn notices_are_of_the_system_that_an_archive_is_for() {
    let folder = Folder::new();
    folder.write("cargo", "#!/bin/sh\necho \"$@\" >&2\nexit 1\n");
    fs::set_permissions(folder.path("cargo"), Permissions::from_mode(0o755)).expect("a script");
    let asked = |target: &[&str]| {
        let mut command = Command::new("python3");
        let path = format!("{}:{}", folder.path("").display(), std::env::var("PATH").expect("a path"));
        command.env("PATH", path).arg(root().join("packaging/notices.py")).arg("Cargo.toml").args(target);
        String::from_utf8(command.output().expect("python3").stderr).expect("words")
    };
    assert!(asked(&["x86_64-pc-windows-msvc"]).contains("--filter-platform x86_64-pc-windows-msvc"));
    assert!(asked(&[]).contains("--filter-platform x86_64-unknown-linux-gnu"));
    assert!(read("packaging/archive.sh").contains("notices.py Cargo.toml \"$target\""));
    assert!(
        read(".github/workflows/release.yml").contains("notices.py python/Cargo.toml ${{ matrix.target }}")
    );
}

/// What workflows and the container run of this project is there.
#[test]
fn workflows_run_scripts_that_exist() {
    let mut found = 0;
    for name in [".github/workflows/release.yml", ".github/workflows/test.yml", "packaging/docker/Dockerfile"]
    {
        let text = read(name);
        if name.ends_with(".yml") {
            assert!(yaml(&text)["jobs"].as_hash().is_some_and(|jobs| !jobs.is_empty()), "{name}");
        }
        for word in text
            .split_whitespace()
            .filter(|word| ["packaging/", ".ci/", "tests/"].iter().any(|folder| word.starts_with(folder)))
        {
            assert!(root().join(word).exists(), "{name}: {word}");
            found += 1;
        }
    }
    assert!(found >= 5, "{found}");
}

/// cargo packages and publishes only what is committed: files that a release's jobs make before it in the checkout are ignored.
#[test]
fn what_a_release_makes_is_no_change_of_its_source() {
    let folder = Folder::new();
    folder.write(".gitignore", read(".gitignore"));
    let git =
        |words: &[&str]| Command::new("git").current_dir(folder.path("")).args(words).status().expect("git");
    assert!(git(&["init", "--quiet"]).success());
    let workflow = read(".github/workflows/release.yml");
    for (name, made) in [
        ("dist", "dist/chpm.deb"),
        ("manifests", "manifests/chpm.rb"),
        ("wheels", "wheels/chpm.whl"),
        ("sbom", "sbom.json"),
        ("cyclonedx", "crates/chpm-build/sbom.json"),
    ] {
        assert!(workflow.contains(name), "{name}");
        assert!(git(&["check-ignore", "--quiet", made]).success(), "{made}");
    }
    assert!(!git(&["check-ignore", "--quiet", "src/main.rs"]).success());
}

/// A crate alone has the texts of its licences, too: links here, files in what is published.
#[test]
fn every_crate_has_the_texts_of_its_licences() {
    for entry in fs::read_dir(root().join("crates")).expect("a folder") {
        let place = entry.expect("a crate").path();
        for name in ["LICENSE-APACHE", "LICENSE-MIT"] {
            let text =
                fs::read_to_string(place.join(name)).unwrap_or_else(|error| panic!("{place:?}: {error}"));
            assert_eq!(text, read(name), "{place:?}");
        }
    }
}
