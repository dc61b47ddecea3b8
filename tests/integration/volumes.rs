//! Pages in files of their own, as the command makes, reads, joins and serves them.

use super::harness::{Folder, text};
use super::sheets;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use nix::sys::signal::Signal;
use serde_json::Value;
use std::fs::{self, File};
use std::io::Read;
use std::process::Stdio;

/// A model of seven volumes or so, and the same in one file.
fn built(pages: &str) -> Folder {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 20000 -o in.ply -q");
    folder.stdout(&format!("build in.ply -o one.chpm -q --cluster-triangles 256 --pages {pages}"));
    let size = if pages == "raw" { "300K" } else { "60K" };
    folder.stdout(&format!(
        "build in.ply -o in.chpm -q --cluster-triangles 256 --pages {pages} --volume-size {size} --threads 2"
    ));
    folder
}

/// Names of a model's volumes, in their order.
fn volumes(folder: &Folder, stem: &str) -> Vec<String> {
    let is_one = |name: &String| name.starts_with(&format!("{stem}.")) && name.ends_with(".pages");
    folder.names().into_iter().filter(is_one).collect()
}

fn assert_equal(folder: &Folder, a: &str, b: &str) {
    assert_eq!(folder.read(&format!("{a}.chpm")), folder.read(&format!("{b}.chpm")), "{a} and {b}");
    let (of_a, of_b) = (volumes(folder, a), volumes(folder, b));
    assert_eq!(of_a.len(), of_b.len(), "{a} and {b}");
    for (a, b) in of_a.iter().zip(&of_b) {
        assert!(folder.read(a) == folder.read(b), "{a} and {b}");
    }
}

#[test]
fn splitting_and_joining_come_back() {
    for pages in ["raw", "packed", "chained"] {
        let folder = built(pages);
        let count = volumes(&folder, "in").len();
        assert!((3..20).contains(&count), "{pages}: {count}");
        let size = if pages == "raw" { "300K" } else { "60K" };
        folder.stdout(&format!("relayout one.chpm -o split.chpm --volume-size {size} -q"));
        assert_equal(&folder, "in", "split");
        folder.stdout(&format!("build in.ply -o other.chpm -q --cluster-triangles 256 --pages {pages} --volume-size {size} --threads 1"));
        assert_equal(&folder, "in", "other");
        folder.stdout("relayout in.chpm -o joined.chpm --volume-size one -q");
        assert_equal(&folder, "joined", "one");
        folder.stdout("relayout in.chpm -o again.chpm --volume-size 100000 -q");
        folder.stdout("relayout again.chpm -o whole.chpm --volume-size 0 -q");
        assert_equal(&folder, "whole", "one");
        let told = folder.stdout("verify in.chpm --same-as one.chpm --against in.ply");
        assert!(told.contains("sound;") && told.contains("the leaves are"), "{told}");
        for (name, mesh) in [("in", "a"), ("one", "b")] {
            folder.stdout(&format!("extract {name}.chpm --triangles 1000 -o {mesh}.ply"));
        }
        assert!(folder.read("a.ply") == folder.read("b.ply"), "{pages}");
    }
}

#[test]
fn sheets_go_to_volumes_too() {
    let folder = sheets::textured();
    for pages in ["raw", "packed"] {
        let build = format!("{} --pages {pages} -f", sheets::BUILD);
        folder.stdout(&format!("build a.obj -o one.chpm {build}"));
        folder.stdout(&format!("build a.obj -o in.chpm {build} --volume-size 150K"));
        folder.stdout("relayout one.chpm -o split.chpm --volume-size 150K -q -f");
        assert_equal(&folder, "in", "split");
        assert!(volumes(&folder, "in").len() > 1);
        folder.stdout("verify in.chpm --same-as one.chpm");
        folder.stdout("relayout in.chpm -o joined.chpm --volume-size one -q -f");
        assert_equal(&folder, "joined", "one");
    }
}

#[test]
fn a_build_in_steps_makes_the_same_volumes() {
    let folder = built("packed");
    folder.stdout("stage plan in.ply -o w.stages --parts 1 --levels 0 -q --cluster-triangles 256 --pages packed --volume-size 60K");
    folder.stdout("work w.stages -o steps.chpm -q");
    assert_equal(&folder, "in", "steps");
}

#[test]
fn volumes_that_are_not_its_own_are_named_with_the_remedy() {
    let folder = built("raw");
    let error = |name: &str| {
        let told = folder.stderr(&format!("info {name}.chpm"), 2);
        let found = folder.stdout_of_faulty(&format!("verify {name}.chpm"));
        assert!(found.contains(".pages'"), "{found}");
        told
    };
    fs::copy(folder.path("in.chpm"), folder.path("renamed.chpm")).expect("a copy");
    let told = error("renamed");
    assert!(
        told.contains("'renamed.0001.pages' is not there") && told.contains("rename them together"),
        "{told}"
    );
    let swap = |a: &str, b: &str| {
        fs::rename(folder.path(a), folder.path("aside")).expect("a name");
        fs::rename(folder.path(b), folder.path(a)).expect("a name");
        fs::rename(folder.path("aside"), folder.path(b)).expect("a name");
    };
    swap("in.0001.pages", "in.0002.pages");
    let told = error("in");
    assert!(told.contains("'in.0001.pages' should be volume 1, and is volume 2"), "{told}");
    swap("in.0001.pages", "in.0002.pages");
    folder.stdout("info in.chpm");

    let whole = folder.read("in.0002.pages");
    folder.write("in.0002.pages", &whole[..whole.len() - 1]);
    let told = error("in");
    assert!(
        told.contains(&format!("should have {} bytes, and has {}", whole.len(), whole.len() - 1)),
        "{told}"
    );
    folder.stdout("build in.ply -o in2.chpm -q --cluster-triangles 128 --volume-size 300K");
    fs::copy(folder.path("in2.0002.pages"), folder.path("in.0002.pages")).expect("a copy");
    assert!(error("in").contains("'in.0002.pages' is a volume of another build"));
    folder.write("in.0002.pages", "notes");
    assert!(error("in").contains("'in.0002.pages' should be a volume of it, and is none"));
    // A page that is damaged is told by its cluster.
    let mut damaged = whole.clone();
    damaged[5000] ^= 1;
    folder.write("in.0002.pages", damaged);
    folder.stdout("info in.chpm");
    assert!(folder.stdout_of_faulty("verify in.chpm").contains("page of cluster"));
}

impl Folder {
    /// Output of a verb that finds faults.
    fn stdout_of_faulty(&self, words: &str) -> String {
        text(&self.chpm(words).code(1).get_output().stdout)
    }
}

#[test]
fn an_output_replaces_only_what_is_its_own() {
    let folder = built("raw");
    let before = volumes(&folder, "in").len();
    let told = folder.stderr("relayout one.chpm -o in.chpm --volume-size 1M -q", 2);
    assert!(told.contains("in.chpm' exists"), "{told}");
    let told = folder.stderr("relayout in.chpm -o in --volume-size 1M -q -f", 2);
    assert!(told.contains("is the input itself"), "{told}");
    folder.write("in.0999.pages", "mine");
    folder.stdout("relayout one.chpm -o in.chpm --volume-size 1M -q -f");
    let after = volumes(&folder, "in");
    assert!(after.len() < before && after.contains(&"in.0999.pages".to_owned()), "{after:?}");
    folder.stdout("verify in.chpm");
    folder.stdout("build in.ply -o in.chpm -q -f --cluster-triangles 256");
    assert_eq!(volumes(&folder, "in"), ["in.0999.pages"]);
    assert_eq!(folder.read("in.0999.pages"), b"mine");
    let told = folder.stderr("build in.ply -o small.chpm -q --volume-size 4K", 2);
    assert!(told.contains("size of a volume: expected at least"), "{told}");
    let told = folder.stderr("build in.ply -o small.chpm -q --volume-size huge", 2);
    assert!(told.contains("'huge' is no size of a volume"), "{told}");
    assert!(folder.names().iter().all(|name| !name.starts_with("small") && !name.contains("partial")));
}

#[test]
fn a_link_leads_to_the_volumes() {
    let folder = built("packed");
    std::os::unix::fs::symlink("in.chpm", folder.path("link.chpm")).expect("a link");
    folder.stdout("verify link.chpm --same-as one.chpm");
}

#[test]
fn info_tells_of_volumes_within_a_screen() {
    let folder = built("raw");
    let count = volumes(&folder, "in").len();
    let told = folder.stdout("info in.chpm");
    let expected = format!("{count} files of up to");
    assert!(told.contains(&expected) && told.contains("in.0001.pages to in.000"), "{told}");
    assert!(told.lines().count() <= 24 && told.contains("CHPM 1.9"), "{told}");
    let info: Value = serde_json::from_str(&folder.stdout("info in.chpm --json")).expect("JSON");
    let lens: u64 = info["volumes"]
        .as_array()
        .expect("volumes")
        .iter()
        .map(|v| v["bytes"].as_u64().expect("bytes"))
        .sum();
    let own = folder.read("in.chpm").len() as u64;
    assert_eq!(
        (info["volumes"].as_array().map(Vec::len), info["bytes"]["file"].as_u64()),
        (Some(count), Some(lens + own))
    );
    assert_eq!(info["volumes"][0]["file"], "in.0001.pages");
    let one: Value = serde_json::from_str(&folder.stdout("info one.chpm --json")).expect("JSON");
    assert_eq!(one["volumes"].as_array().map(Vec::len), Some(0));
    for verb in ["stats", "report", "dump"] {
        let output = if verb == "report" { " -o in.html" } else { "" };
        folder.stdout(&format!("{verb} in.chpm{output}"));
    }
}

#[test]
fn a_volume_that_changes_meanwhile_is_an_error() {
    let folder = built("raw");
    let mut command = folder.command("dump in.chpm --pages");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("a process");
    let mut out = child.stdout.take().expect("a pipe");
    out.read_exact(&mut [0; 100]).expect("a beginning");
    let last = volumes(&folder, "in").pop().expect("a volume");
    File::options().write(true).open(folder.path(&last)).expect("a file").set_len(5000).expect("a length");
    out.read_to_end(&mut Vec::new()).expect("the rest");
    let output = child.wait_with_output().expect("an end");
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains(&format!("{last}' was cut short while it was read")), "{error}");

    let folder = built("raw");
    let path = folder.path("in.chpm");
    let file =
        Chpm::open_at(MappedFile::open(&path).expect("a map"), &path, MappedFile::open).expect("a file");
    let unchanged = || file.parts().try_for_each(MappedFile::check_unchanged);
    unchanged().expect("nothing has happened");
    let second = File::options().write(true).open(folder.path("in.0002.pages")).expect("a file");
    second.set_modified(std::time::SystemTime::UNIX_EPOCH).expect("a time");
    assert!(unchanged().expect_err("a change").to_string().contains("in.0002.pages' was changed"));
}

#[test]
fn a_batch_builds_again_where_volumes_are_other_ones() {
    let folder = Folder::new();
    fs::create_dir(folder.path("in")).expect("a folder");
    folder.stdout("synth sphere --triangles 5000 -o in/a.ply -q");
    let batch = |more: &str, status: &str| {
        folder.stdout(&format!("batch in -o out -q --cluster-triangles 256 {more}"));
        let summary: Value = serde_json::from_slice(&folder.read("out/summary.json")).expect("a summary");
        assert_eq!(summary["models"][0]["status"], status, "{more}: {summary}");
    };
    batch("--volume-size 100K", "built");
    batch("--volume-size 100K", "current");
    batch("--volume-size 200K", "built");
    batch("", "built");
    assert!(!folder.path("out/a.0001.pages").exists());
    batch("", "current");
}

#[test]
fn a_build_in_volumes_that_is_stopped_leaves_nothing() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 200000 -o in.ply -q");
    for stage in ["simplify", "layout"] {
        let words = "build in.ply --volume-size 1M --pages chained --threads 1 --checkpoint 1000000";
        let (status, rest) = folder.signalled(words, stage, Signal::SIGINT);
        match status.code() {
            Some(130) => assert_eq!(folder.names(), ["in.ply"], "{stage}: {rest:?}"),
            // The build may have been faster than the signal.
            Some(0) => folder.names().iter().filter(|name| *name != "in.ply").for_each(|name| {
                fs::remove_file(folder.path(name)).expect("an output");
            }),
            code => panic!("{stage}: {code:?}: {rest:?}"),
        }
    }
}

#[cfg(feature = "web")]
#[test]
fn volumes_are_served_and_shared() {
    use super::web::Host;
    let folder = built("packed");
    folder.write("other.0001.pages", "mine");
    let host = Host::start(&folder, "in.chpm");
    let (status, _, body) = host.get("/in.0002.pages", "Range: bytes=4096-4195\r\n");
    assert_eq!((status, body), (206, folder.read("in.0002.pages")[4096..4196].to_vec()));
    for path in ["/other.0001.pages", "/in.9999.pages", "/in.1.pages", "/in.pages", "/one.chpm"] {
        assert_eq!(host.get(path, "").0, 404, "{path}");
    }
    assert_eq!(host.get("/view.html?file=in%2Echpm", "").0, 200);
    // Volumes are named after what the model is called.
    folder.stdout("relayout in.chpm -o plain --volume-size 60K -q");
    fs::copy(folder.path("one.chpm"), folder.path("UP.CHPM")).expect("a copy");
    folder.write("UP.CHPM.0001.pages", "up");
    let plain = Host::start(&folder, "plain");
    assert_eq!(plain.get("/plain.0002.pages", "").2, folder.read("plain.0002.pages"));
    assert_eq!(plain.get("/in.0002.pages", "").0, 404);
    let all = Host::start(&folder, ".");
    let answers = ["/in.0002.pages", "/UP.CHPM.0001.pages", "/plain.0002.pages", "/other.0001.pages"]
        .map(|path| all.get(path, "").0);
    assert_eq!(answers, [200, 200, 404, 404]);
    // One file, or pieces of one.
    folder.stdout("share in.chpm -o site -q");
    folder.stdout("share one.chpm -o site1 -q");
    assert!(folder.read("site/model.chpm") == folder.read("site1/model.chpm"));
    assert!(!folder.path("site/model.0001.pages").exists());
}
