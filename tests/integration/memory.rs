//! Verbs that read a file stay below the memory they are given, whatever the file's size.

use super::harness::Folder;
use std::fs;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

/// Runs a verb, and answers the most kilobytes that it had resident: as the system told last before it ended.
fn peak(folder: &Folder, words: &str) -> u64 {
    let mut child =
        folder.command(words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("a process");
    let status = format!("/proc/{}/status", child.id());
    let mut most = 0;
    while child.try_wait().expect("a state").is_none() {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let peak = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse().ok());
        most = most.max(peak.unwrap_or(0));
        sleep(Duration::from_millis(1));
    }
    let output = child.wait_with_output().expect("an end");
    assert!(output.status.success(), "{words}: {}", String::from_utf8_lossy(&output.stderr));
    most
}

#[test]
fn reading_takes_no_more_memory_than_is_given() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 1700000 -o in.ply -q");
    folder.stdout("build in.ply -q --partitioner greedy");
    let len = folder.path("in.chpm").metadata().expect("a length").len();
    let given = 38 << 10;
    // What the program itself takes, and the finest half of the file on top of that, is more than is given.
    // It ends so soon that its end may fall between two looks: the most of several runs counts.
    let bare = (0..5).map(|_| peak(&folder, "info in.chpm")).max().expect("a run");
    assert!(bare < 26 << 10, "{bare}");
    assert!(bare + (len >> 11) > given, "the file is large enough to show: {bare} and {len}");
    for words in [
        "verify in.chpm -q",
        "verify in.chpm --cuts 6 -q",
        "verify in.chpm --against in.ply -q",
        "dump in.chpm --pages",
        "stats in.chpm",
        "extract in.chpm --level 0 -o out.ply -qf",
        "extract in.chpm --triangles 300000 -o out.ply -qf",
        "extract in.chpm --error 0 -o out.ply -qf",
        "extract in.chpm --level 0 -o out.glb -qf",
        "extract in.chpm --level 0 -o out.obj -qf",
    ] {
        let peak = peak(&folder, &format!("{words} --memory 38M"));
        assert!(peak <= given, "{words}: {peak} kB");
    }
    // Pages above are kept unpacked. A program of a development build takes some MiB more than a release for itself.
    let given = 42 << 10;
    folder.stdout("relayout in.chpm -o chained.chpm --pages chained -q");
    for words in [
        "verify chained.chpm -q",
        "verify chained.chpm --cuts 6 -q",
        "dump chained.chpm --pages",
        "extract chained.chpm --level 0 -o out.ply -qf",
    ] {
        let peak = peak(&folder, &format!("{words} --memory 42M"));
        assert!(peak <= given, "{words}: {peak} kB");
    }
    // This holds the mesh, and says how much that takes.
    let words = "extract in.chpm --level 0 --order cache-oblivious -o ordered.ply -qf --memory";
    let told = folder.stderr(&format!("{words} 64M"), 2);
    let least = told.split("give it ").nth(1).and_then(|rest| rest.split(' ').next()).expect("a size");
    let most: u64 = least.strip_suffix('M').and_then(|number| number.parse().ok()).expect("MiB");
    let peak_of_order = peak(&folder, &format!("{words} {least}"));
    assert!(peak_of_order <= most << 10, "{peak_of_order} kB of {least}");
    // These hold a piece of the mesh.
    for words in [
        "extract in.chpm --level 0 -o out.stl -qf --memory 40M",
        "extract in.chpm --level 0 -o out.glb -qf --meshopt --memory 48M",
    ] {
        let peak = peak(&folder, words);
        let given: u64 = words[words.len() - 3..words.len() - 1].parse().expect("MiB");
        assert!(peak <= given << 10, "{words}: {peak} kB");
    }
}

#[test]
fn too_little_memory_is_refused_with_a_figure_that_suffices() {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 6000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 64");
    folder.stdout("path orbit in.chpm -o in.path --frames 3");
    for words in [
        "verify in.chpm --against in.ply -q",
        "verify in.chpm --cuts 3 -q",
        "measure in.chpm --against in.ply -q --samples 1 --positions 1",
        "verify in.chpm --against in.ply --errors -q",
        "dump in.chpm",
        "info in.chpm",
        "stats in.chpm",
        "report in.chpm -o page.html -f",
        "extract in.chpm --level 0 -o out.ply -q",
        "path dive in.chpm -o out.path",
        "compare in.chpm in.chpm -q",
        "distance in.chpm in.chpm -q",
        // One thread is enough, however many there are.
        "thickness in.chpm -q --threads 64",
        "visible in.chpm --from 9,9,9 -q --threads 64",
        "section in.chpm --plane 0,0,1:0 -q --threads 64",
        "export in.chpm --3dtiles tiles -q --threads 64",
        "export in.chpm --meshlets out.meshlets -q --threads 64",
        #[cfg(feature = "viewer")]
        "render in.chpm --rays --viewport 16x16 -o out.png -q --threads 64",
    ] {
        let error = folder.stderr(&format!("{words} --memory 16M"), 2);
        let figure =
            error.split("give it ").nth(1).and_then(|rest| rest.split(' ').next()).expect("a figure");
        folder.stdout(&format!("{words} --memory {figure}"));
    }
}

/// A machine may have far more processors than there is memory for their work: then fewer are used, whatever is asked for.
#[test]
fn threads_beyond_the_memory_are_not_used() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 60000 -o in.ply -q");
    folder.stdout("build in.ply -q");
    folder.write("some.csv", b"-9,0,0,1,0,0\n0,-9,0,0,1,0\n");
    for words in [
        "section in.chpm --every 1% --axis z -o out.svg -qf",
        "export in.chpm --3dtiles tiles -f",
        "export in.chpm --3dtiles out.3tz -f",
        "export in.chpm --meshlets out.meshlets -f",
        "rays in.chpm some.csv -o out.csv -qf",
        #[cfg(feature = "viewer")]
        "render in.chpm --rays --ground --viewport 90x60 -o out.png -qf",
        "thickness in.chpm -o out.ply -qf",
        "visible in.chpm --from 0,0,9 -o out.ply -qf",
        "distance in.chpm in.chpm -q",
        "compare in.chpm in.chpm -q",
        "verify in.chpm --cuts 2 -q",
        "relayout in.chpm -o out.chpm --pages packed -qf",
    ] {
        let peak = peak(&folder, &format!("{words} --threads 300 --memory 80M"));
        assert!(peak <= 80 << 10, "{words}: {peak} kB");
    }
}

/// Points near many clusters, of which each thread has some in hand.
#[test]
fn threads_that_compare_with_many_clusters_stay_within_the_memory() {
    let folder = Folder::new();
    folder.stdout("synth hard:voxels --triangles 300000 -o in.ply -q");
    folder.stdout("build in.ply -q");
    for (threads, given) in [(1, 72), (64, 72), (64, 100)] {
        let words = format!("compare in.chpm in.chpm --error 1% -q --threads {threads} --memory {given}M");
        let peak = peak(&folder, &words);
        assert!(peak <= given << 10, "{words}: {peak} kB");
    }
}

/// Surfaces of which each thread has some tiles at hand.
#[test]
fn threads_that_hold_surfaces_together_stay_within_the_memory() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 60000 -o in.ply -q");
    folder.stdout("build in.ply -q");
    for words in [
        "extract in.chpm --error 1% --tight -o out.ply -qf",
        "verify in.chpm --against in.ply --errors --level 1 -q",
        "measure in.chpm --against in.ply --samples 1 --positions 1 -q",
    ] {
        let peak = peak(&folder, &format!("{words} --threads 64 --memory 48M"));
        assert!(peak <= 48 << 10, "{words}: {peak} kB");
    }
}
