//! Camera paths and walks along them.

use super::harness::Folder;
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, GroupId};
use chpm_refine::{ActiveList, CameraPath, Cut, Hierarchy, Member, View, extract};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

fn built() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 30000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 512");
    folder
}

/// The columns of a CSV file by name.
fn columns(folder: &Folder, name: &str) -> BTreeMap<String, Vec<f64>> {
    let text = String::from_utf8(folder.read(name)).expect("text");
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let names = lines.next().expect("a line of names");
    let mut columns: BTreeMap<String, Vec<f64>> =
        names.iter().map(|name| (name.clone(), Vec::new())).collect();
    for line in lines {
        assert_eq!(line.len(), names.len());
        for (name, value) in names.iter().zip(line) {
            columns.get_mut(name).expect("a column").push(value.parse().expect("a number"));
        }
    }
    columns
}

#[test]
fn every_way_is_a_path_that_can_be_walked() {
    let folder = built();
    for way in ["orbit", "dive", "random"] {
        folder.stdout(&format!("path {way} in.chpm --frames 20 --seed 3 -o {way}.path"));
        folder.stdout(&format!("path {way} in.chpm --frames 20 --seed 3 -o again.path -f"));
        assert_eq!(folder.read(&format!("{way}.path")), folder.read("again.path"));
        let out = folder.stdout(&format!("walk in.chpm {way}.path --csv {way}.csv -q"));
        assert!(out.contains("20 frames") && out.contains("pm steps"), "{out}");
        let columns = columns(&folder, &format!("{way}.csv"));
        assert_eq!(columns["frame"], (0..20).map(f64::from).collect::<Vec<_>>());
        assert!(columns["withheld"].iter().all(|n| *n == 0.0), "everything is there");
        assert!(columns["splits"][0] > 0.0 && columns["pm_steps"][0] > 0.0);
        assert!(columns["clusters"][0] > columns["splits"][0], "a split brings more than it takes");
        let (runs, splits) = (&columns["requested_runs"], &columns["splits"]);
        let sum = |numbers: &[f64]| numbers.iter().sum::<f64>();
        assert!(runs.iter().zip(splits).all(|(runs, splits)| *runs <= splits + 1.0), "a split is one read");
        assert!(sum(runs) > 0.0 && sum(runs) < 0.7 * sum(splits), "runs of several splits are one");
    }
    let dive = columns(&folder, "dive.csv");
    assert!(dive["triangles"][19] > dive["triangles"][0]);
    let error = folder.stderr("path orbit in.chpm -o orbit.path", 2);
    assert!(error.contains("--force"), "{error}");
}

#[test]
fn a_frame_has_the_triangles_that_extract_gives() {
    let folder = built();
    let cameras = ["0.5 0.5 2 0.5 0.5 0.5", "0.2 0.9 1.2 0.5 0.4 0.5", "9 0 0 0.5 0.5 0.5"];
    let lines: String = cameras.iter().map(|camera| format!("{camera} 0 1 0 45\n")).collect();
    folder.write("cam.path", format!("chpm-path 1\n{lines}"));
    folder.stdout("walk in.chpm cam.path --poe 2 --viewport 300x200 --csv out.csv -q");
    let walked = columns(&folder, "out.csv");
    for (frame, camera) in cameras.iter().enumerate() {
        let camera = camera.replace(' ', ",");
        folder.stdout(&format!("extract in.chpm --poe 2 --viewport 300x200 --camera {camera} -o x.ply -qf"));
        assert_eq!(
            walked["triangles"][frame] as usize,
            folder.read_mesh("x.ply").triangles.len(),
            "{camera}"
        );
    }
}

#[test]
fn memory_is_a_limit_and_latency_a_delay() {
    let folder = built();
    folder.stdout("path random in.chpm --frames 60 -o cam.path");
    let text = String::from_utf8(folder.read("cam.path")).expect("text");
    let last = text.lines().last().expect("a camera");
    folder.write("cam.path", format!("{text}{last}\n{last}\n"));
    folder.stdout("walk in.chpm cam.path --poe 0.5 --csv all.csv -q");
    folder.stdout("walk in.chpm cam.path --poe 0.5 --csv few.csv -q --memory 500K");
    folder.stdout("walk in.chpm cam.path --poe 0.5 --csv late.csv -q --latency 2");
    let [all, few, late] = ["all.csv", "few.csv", "late.csv"].map(|name| columns(&folder, name));
    let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    assert!(most(&all["resident_bytes"]) > 600.0 * 1024.0, "the limit matters");
    assert!(most(&few["resident_bytes"]) <= 500.0 * 1024.0);
    assert!(most(&few["withheld"]) > 0.0 && most(&few["triangles"]) < most(&all["triangles"]));
    assert_eq!(late["triangles"][..2], [0.0, 0.0], "the roots are on their way");
    assert!(late["triangles"].iter().zip(&all["triangles"]).all(|(late, all)| late <= all));
    assert_eq!(late["triangles"][61], all["triangles"][61], "nothing new for two frames");
}

#[test]
fn what_is_read_ahead_is_there_when_it_is_wanted() {
    let folder = built();
    // Ever nearer to one place, which a camera that goes on can foresee.
    folder.stdout("path dive in.chpm --frames 90 -o cam.path");
    let walk = |words: &str| {
        folder.stdout(&format!("walk in.chpm cam.path --poe 8 --latency 4 --csv out.csv -qf {words}"));
        columns(&folder, "out.csv")
    };
    let sum = |values: &[f64]| values.iter().sum::<f64>();
    let (late, ahead) = (walk(""), walk("--prefetch 100K"));
    assert_eq!(sum(&late["prefetched_bytes"]), 0.0);
    assert!(sum(&ahead["prefetched_bytes"]) > 0.0);
    assert!(ahead["prefetched_bytes"].iter().all(|bytes| *bytes <= 100.0 * 1024.0));
    // All must wait for the first pages; who reads ahead waits less from then on.
    let waits = |frames: &BTreeMap<String, Vec<f64>>| sum(&frames["withheld"][4..]);
    assert!(waits(&ahead) < 0.5 * waits(&late), "{} {}", waits(&ahead), waits(&late));
    assert_eq!(late["triangles"][89], ahead["triangles"][89], "in the end it is the same mesh");
    let tight = walk("--prefetch 100K --memory 500K");
    assert!(tight["resident_bytes"].iter().all(|bytes| *bytes <= 500.0 * 1024.0));
    folder.chpm("walk in.chpm cam.path --prefetch much").code(2);
    for memory in ["0", "1K"] {
        let said = folder.stderr(&format!("walk in.chpm cam.path --memory {memory} --csv none.csv"), 2);
        assert!(said.contains("needed for the coarsest mesh") && said.contains("allow more"), "{said}");
        assert!(!folder.path("none.csv").exists());
    }
}

/// The triangles of a cut, each by the bits of its corners from the least one on.
fn triangles(file: &Chpm<Vec<u8>>, cut: &Cut) -> Vec<[[u32; 3]; 3]> {
    let mesh = extract(file, cut).expect("a mesh");
    let corner = |v: u32| mesh.positions[v as usize].map(f32::to_bits);
    let rotated = |[a, b, c]: [[u32; 3]; 3]| [a, b, c].min([b, c, a]).min([c, a, b]);
    let mut all: Vec<_> = mesh.triangles.iter().map(|t| rotated(t.map(corner))).collect();
    all.sort_unstable();
    all
}

/// The cut with some clusters in the place of others.
fn replaced(cut: &Cut, gone: &[u32], come: impl Iterator<Item = Member>) -> Cut {
    let stay = cut.members().iter().copied().filter(|member| !gone.contains(&member.cluster.0));
    Cut::new(stay.chain(come).collect())
}

/// A camera goes near and away again. Whenever a group splits, all its clusters at their finest meshes look like what replaces them, in
/// the midst of the mesh of that frame; whenever one collapses, likewise.
#[test]
fn no_split_pops() {
    let folder = Folder::new();
    for shape in ["isosurface", "terrain"] {
        folder.stdout(&format!("synth {shape} --triangles 12000 -o in.ply -qf"));
        folder.stdout("build in.ply -qf --cluster-triangles 128");
        folder.stdout("path dive in.chpm --frames 24 -o cam.path -f");
        let file = Chpm::open(folder.read("in.chpm")).expect("a file");
        let text = String::from_utf8(folder.read("cam.path")).expect("text");
        let path: CameraPath = text.parse().expect("a path");
        let hierarchy = Hierarchy::new(&file);
        let record = |id: &u32| &file.clusters()[*id as usize];
        let mut list = ActiveList::new(&file);
        let mut cut = Cut::at_error(&file, f32::INFINITY).expect("the roots");
        let (mut split, mut events, mut joint) = (BTreeSet::new(), 0, 0);
        for camera in path.cameras.iter().chain(path.cameras.iter().rev()) {
            let camera = camera.relative_to(file.header().origin);
            let view = View::new(&camera, [512, 512], 1.0).expect("a view");
            list.update(&file, &hierarchy, &view, |_| true).expect("sound pages");
            let now: BTreeSet<GroupId> = list.front().split_groups().iter().copied().collect();
            let order = hierarchy.top_down();
            let collapses = order.iter().rev().filter(|id| split.contains(*id) && !now.contains(*id));
            let splits = order.iter().filter(|id| !split.contains(*id) && now.contains(*id));
            for group in collapses.chain(splits) {
                let (coarse, fine) = (file.coarse(*group), file.fine(*group));
                let gone = [coarse, fine].concat();
                let finest = coarse.iter().map(|id| (*id, record(id).vertex_count));
                let base = fine.iter().map(|id| (*id, record(id).base_vertex_count));
                let member = |(id, vertices)| Member { cluster: ClusterId(id), vertices };
                let before = replaced(&cut, &gone, finest.map(member));
                let after = replaced(&cut, &gone, base.map(member));
                assert!(triangles(&file, &before) == triangles(&file, &after), "{shape}: {group} pops");
                cut = if split.contains(group) { before } else { after };
                events += 1;
                joint += u32::from(coarse.len() > 1);
            }
            (cut, split) = (list.cut(), now);
        }
        assert!(events > 40 && joint > 10, "{shape}: {events} splits and collapses, {joint} of groups");
    }
}

#[test]
fn summaries_are_json_and_agree() {
    let folder = built();
    folder.stdout("path orbit in.chpm --frames 9 -o cam.path");
    let out = folder.stdout("walk in.chpm cam.path --csv out.csv -q --json");
    let summary: Value = serde_json::from_str(&out).expect("valid JSON");
    let mut triangles = columns(&folder, "out.csv")["triangles"].clone();
    triangles.sort_by(f64::total_cmp);
    assert_eq!(summary["frames"], 9);
    assert_eq!(summary["summary"]["triangles"]["median"], triangles[4]);
    assert_eq!(summary["summary"]["triangles"]["most"], triangles[8]);
}

#[test]
fn paths_that_are_none_are_refused_with_their_line() {
    let folder = built();
    for (text, told) in [
        ("", "line 1"),
        ("chpm-path 1\n", "no camera"),
        ("chpm-path 1\n1 2 3\n", "line 2"),
        ("chpm-path 1\n1 2 3 1 2 3 0 1 0 45\n", "frame 0"),
        ("chpm-path 1\n1 2 3 1 2 4 0 1 0 180\n", "field of view"),
    ] {
        folder.write("bad.path", text);
        let error = folder.stderr("walk in.chpm bad.path -q --csv out.csv", 2);
        assert!(error.contains(told) && error.contains("bad.path"), "{text}: {error}");
    }
    assert!(folder.stderr("walk in.chpm no.path", 2).contains("no.path"));
    let endless = folder.stderr("walk in.chpm /dev/zero", 2);
    assert!(endless.contains("/dev/zero") && endless.contains("longer than 64.0 MiB"), "{endless}");
    assert_eq!(folder.names(), ["bad.path", "in.chpm", "in.ply"]);
}
