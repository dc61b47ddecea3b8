//! `chpm export --3dtiles`: a viewer that knows nothing of this project, as the specification has it, walks the tileset for many cameras.

use super::glb::Glb;
use super::harness::{CHPM, Folder, Triangles, skipped, text, triangles};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_measure::crack::{cracks, weld};
use chpm_mesh::{Aabb, Level, TriMesh};
use chpm_refine::{Cut, Hierarchy, extract, select_by};
use chpm_synth::{Shape, Synth};
use nix::sys::signal::Signal;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// An eye, and the error in a pixel at distance 1 times the pixels that are allowed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View {
    pub(crate) eye: [f64; 3],
    pub(crate) allowed: f64,
}

impl View {
    /// Whether an error in a box, from its middle so far along each axis, is too much.
    pub(crate) fn refines(&self, center: [f64; 3], half: [f64; 3], error: f64) -> bool {
        let outside = [0, 1, 2].map(|axis| ((self.eye[axis] - center[axis]).abs() - half[axis]).max(0.0));
        error > self.allowed * outside.iter().map(|x| x * x).sum::<f64>().sqrt()
    }
}

/// Views from near and far, with more error and less.
pub(crate) fn views(file: &Chpm<MappedFile>, count: u32) -> Vec<View> {
    let bounds = file.header().aabb();
    let (center, size) = (bounds.center(), bounds.diagonal());
    let view = |i: u32| {
        let (turn, rise) = (2.399_963 * f64::from(i), 2.0 * f64::from(i * 37 % 101) / 101.0 - 1.0);
        let away = size * [0.6, 1.0, 2.0, 4.0][i as usize % 4];
        let flat = (1.0 - rise * rise).sqrt();
        let way = [flat * turn.cos(), flat * turn.sin(), rise];
        let eye = std::array::from_fn(|axis| center[axis] + away * way[axis]);
        // Two pixels to eighteen, of a thousand rows.
        View { eye, allowed: [2.0, 6.0, 18.0][i as usize % 3] * 2.0 * 22.5_f64.to_radians().tan() / 1000.0 }
    };
    (0..count).map(view).collect()
}

/// A tileset in a folder, read as a viewer reads it.
struct Viewer {
    root: Value,
    /// By where a tile's content lies.
    meshes: BTreeMap<String, TriMesh>,
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).expect("a tileset")).expect("JSON")
}

impl Viewer {
    /// External tilesets take the place of the tiles that refer to them.
    fn open(folder: &Path) -> Viewer {
        let top = json(&folder.join("tileset.json"));
        assert_eq!(top["asset"]["version"], "1.1");
        let mut viewer = Viewer { root: top["root"].clone(), meshes: BTreeMap::new() };
        let mut root = viewer.root.take();
        assert_eq!(root["refine"], "REPLACE");
        viewer.load(&mut root, folder);
        viewer.root = root;
        viewer
    }

    fn load(&mut self, tile: &mut Value, place: &Path) {
        // A viewer may pass over a tile whose error is not below its parent's.
        for child in tile["children"].as_array().into_iter().flatten() {
            assert!(
                child["geometricError"].as_f64() < tile["geometricError"].as_f64(),
                "{}",
                child["geometricError"]
            );
        }
        let Some(uri) = tile["content"]["uri"].as_str().map(str::to_owned) else {
            tile["children"].as_array_mut().into_iter().flatten().for_each(|child| self.load(child, place));
            return;
        };
        let path = place.join(&uri);
        if uri.ends_with(".json") {
            assert!(tile["children"].is_null(), "what refers to another tileset has no tiles of its own");
            let outside = json(&path);
            assert_eq!(outside["root"]["refine"], "REPLACE");
            for name in ["boundingVolume", "geometricError"] {
                assert_eq!(outside["root"][name], tile[name]);
            }
            *tile = outside["root"].clone();
            self.load(tile, path.parent().expect("a folder"));
            return;
        }
        let glb = Glb::read(&fs::read(&path).expect("a tile"));
        self.meshes.insert(path.display().to_string(), glb.mesh);
        tile["path"] = path.display().to_string().into();
        let place = place.to_owned();
        tile["children"].as_array_mut().into_iter().flatten().for_each(|child| self.load(child, &place));
    }

    /// What is drawn: of each tile that is fine enough its content, of others their children.
    fn drawn(&self, view: &View) -> Vec<&str> {
        let (mut drawn, mut waiting) = (Vec::new(), vec![&self.root]);
        while let Some(tile) = waiting.pop() {
            let number = |at: usize| tile["boundingVolume"]["box"][at].as_f64().expect("a box");
            let half = [3, 7, 11].map(number);
            let error = tile["geometricError"].as_f64().expect("an error");
            let children = tile["children"].as_array();
            match children {
                Some(children) if view.refines([0, 1, 2].map(number), half, error) => {
                    waiting.extend(children)
                }
                _ => drawn.extend(tile["path"].as_str()),
            }
        }
        drawn
    }

    /// All of it as one mesh.
    fn mesh(&self, view: &View) -> TriMesh {
        let mut all = TriMesh::default();
        for path in self.drawn(view) {
            let (mesh, first) = (&self.meshes[path], all.positions.len() as u32);
            all.positions.extend(&mesh.positions);
            all.triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|v| v + first)));
        }
        all
    }

    /// Changes every tile, from the root down.
    fn change(tile: &mut Value, how: &mut impl FnMut(&mut Value)) {
        how(tile);
        tile["children"].as_array_mut().into_iter().flatten().for_each(|child| Self::change(child, how));
    }
}

/// The cut at the base meshes, and of leaves that are too coarse the finest, as selection by the file's own tables has it.
pub(crate) fn cut(file: &Chpm<MappedFile>, view: &View) -> Cut {
    let boxes = boxes(file);
    let bound = |group: chpm_mesh::GroupId| {
        let (record, bounds) = (&file.groups()[group.index()], &boxes[group.index()]);
        let half = [0, 1, 2].map(|axis| (f64::from(bounds.max[axis]) - f64::from(bounds.min[axis])) / 2.0);
        let too_much = view.refines(bounds.center().into(), half, record.max_error.into());
        if too_much { -1.0 } else { f32::INFINITY }
    };
    select_by(file, &Hierarchy::new(file), bound).expect("a cut")
}

/// Boxes of groups and all that is below them.
fn boxes(file: &Chpm<MappedFile>) -> Vec<Aabb> {
    let mut boxes = vec![Aabb::EMPTY; file.groups().len()];
    for level in 0..file.header().level_count {
        for (at, group) in file.groups().iter().enumerate().filter(|(_, group)| group.level == level) {
            let id = chpm_mesh::GroupId(at as u32);
            for record in file.coarse(id).iter().map(|coarse| &file.clusters()[*coarse as usize]) {
                boxes[at].merge(&Aabb { min: record.aabb_min, max: record.aabb_max });
            }
            for fine in file.fine(id) {
                let below = boxes[file.clusters()[*fine as usize].group().index()];
                boxes[at].merge(&below);
            }
            assert_eq!(level, group.level);
        }
    }
    boxes
}

pub(crate) fn bits(mesh: &TriMesh) -> Triangles {
    triangles(mesh)
}

pub(crate) fn open(folder: &Folder, name: &str) -> Chpm<MappedFile> {
    Chpm::open(MappedFile::open(&folder.path(name)).expect("a file")).expect("a CHPM")
}

/// A closed surface, one with open borders, and one of several roots.
pub(crate) fn models() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 40000 -o closed.ply -q");
    folder.stdout("synth terrain --triangles 30000 -o open.ply -q");
    folder.stdout("build closed.ply --cluster-triangles 256 -q");
    folder.stdout("build open.ply --cluster-triangles 256 -q");
    folder.stdout("build closed.ply --cluster-triangles 256 --target-error 0.1% -q -o roots.chpm");
    folder
}

/// All files below a folder, by name.
pub(crate) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut waiting = vec![folder.to_owned()];
    while let Some(place) = waiting.pop() {
        for entry in fs::read_dir(place).expect("a folder").flatten() {
            if entry.path().is_dir() {
                waiting.push(entry.path());
            } else {
                let name = entry.path().strip_prefix(folder).expect("below").display().to_string();
                found.insert(name, fs::read(entry.path()).expect("a file"));
            }
        }
    }
    found
}

#[test]
fn a_viewer_draws_the_cuts_of_the_file_and_they_have_no_cracks() {
    let folder = models();
    for (name, more) in [("closed", ""), ("open", "--span 2 --meshopt"), ("roots", "--span 1")] {
        let words = format!("export {name}.chpm --3dtiles {name} -q --up z {more}");
        let told = folder.stdout(&words);
        let file = open(&folder, &format!("{name}.chpm"));
        assert!(name != "roots" || file.roots().count() > 1, "several roots");
        let viewer = Viewer::open(&folder.path(name));
        assert!(told.contains(&format!("{} tiles", viewer.meshes.len())), "{told}");
        let several = file.groups().iter().filter(|group| group.coarse_count > 1).count();
        assert!(several > 3, "{several} groups of several members");
        let source = extract(&file, &Cut::at_level(&file, Level(0))).expect("the source");
        let mut mixed = 0;
        for view in views(&file, 34) {
            let (drawn, cut) = (viewer.mesh(&view), cut(&file, &view));
            cut.check(&file).expect("a legal cut");
            assert_eq!(bits(&drawn), bits(&extract(&file, &cut).expect("a mesh")), "{name} {view:?}");
            assert!(cracks(&weld(&drawn), &weld(&source)).is_empty(), "{name} {view:?}");
            let levels: BTreeSet<u32> =
                cut.members().iter().map(|m| file.clusters()[m.cluster.index()].level).collect();
            mixed += u32::from(levels.len() > 1);
        }
        // What has several roots has few levels.
        assert!(mixed > 10 || name == "roots", "{name}: {mixed} views of several levels");
        // Nearest of all is the source itself.
        let all = View { eye: [0.0; 3], allowed: 0.0 };
        assert_eq!(bits(&viewer.mesh(&all)), bits(&source), "{name}");
        let boxes = files(&folder.path(name));
        folder.stdout(&format!("{words} -f --memory 200M"));
        assert!(boxes == files(&folder.path(name)), "{name}: the same bytes");
    }
    assert!(files(&folder.path("open")).keys().any(|name| name.starts_with("subtrees/")));
}

/// Spheres about spheres grow by each level, and draw what nobody sees; boxes do not. In a file of few levels that is little.
#[test]
fn boxes_draw_less_than_spheres() {
    let folder = models();
    folder.stdout("export closed.chpm --3dtiles out -q --up z");
    let (file, viewer) = (open(&folder, "closed.chpm"), Viewer::open(&folder.path("out")));
    let mut sums = [0, 0];
    for view in views(&file, 34) {
        let bound = |group: chpm_mesh::GroupId| {
            let record = &file.groups()[group.index()];
            let away =
                record.center.map(f64::from).iter().zip(view.eye).map(|(c, e)| (c - e).powi(2)).sum::<f64>();
            let near = (away.sqrt() - f64::from(record.radius)).max(0.0);
            if f64::from(record.max_error) > view.allowed * near { -1.0 } else { f32::INFINITY }
        };
        let spheres = select_by(&file, &Hierarchy::new(&file), bound).expect("a cut");
        sums[0] += viewer.mesh(&view).triangles.len();
        sums[1] += extract(&file, &spheres).expect("a mesh").triangles.len();
    }
    let share = sums[0] as f64 / sums[1] as f64;
    println!("boxes draw {} triangles, spheres {}: {share:.3}", sums[0], sums[1]);
    assert!(share < 1.0, "{share}");
}

/// The test above can fail: a tile that decides otherwise than the other members of its group leaves a crack.
#[test]
fn a_falsified_box_cracks() {
    let folder = models();
    folder.stdout("export closed.chpm --3dtiles out -q --up z");
    let file = open(&folder, "closed.chpm");
    let source = weld(&extract(&file, &Cut::at_level(&file, Level(0))).expect("the source"));
    let cluster = |tile: &Value| -> Option<usize> {
        Path::new(tile["path"].as_str()?).file_stem()?.to_str()?.parse().ok()
    };
    let mut viewer = Viewer::open(&folder.path("out"));
    // Each tile goes by its own cluster, as one would think.
    let mut root = viewer.root.take();
    Viewer::change(&mut root, &mut |tile| {
        let Some(record) = cluster(tile).map(|id| file.clusters()[id]) else { return };
        assert!(record.triangle_count > 0);
        tile["boundingVolume"] = tile["content"]["boundingVolume"].clone();
    });
    viewer.root = root;
    let cracked =
        views(&file, 34).iter().filter(|view| !cracks(&weld(&viewer.mesh(view)), &source).is_empty()).count();
    assert!(cracked > 5, "{cracked}");
}

/// While finer tiles load, a coarse one is drawn: so what replaces it has to cover the same.
#[test]
fn children_are_the_parts_of_their_parent() {
    let folder = models();
    folder.stdout("export closed.chpm --3dtiles out -q --up z");
    let file = open(&folder, "closed.chpm");
    let viewer = Viewer::open(&folder.path("out"));
    let mut seen = 0;
    let mut root = viewer.root.clone();
    Viewer::change(&mut root, &mut |tile| {
        let path = tile["path"].as_str().expect("a tile").to_owned();
        let id = Path::new(&path).file_stem().and_then(|stem| stem.to_str()?.parse::<u32>().ok());
        let (Some(id), Some(children)) = (id, tile["children"].as_array()) else { return };
        let page = file.page(chpm_mesh::ClusterId(id)).expect("a page");
        let page = page.view();
        let mut finest = TriMesh::default();
        finest.extend_from_slices(page.vertices);
        finest.triangles = page.triangles.iter().map(|t| t.map(u32::from)).collect();
        let mut below = TriMesh::default();
        for child in children {
            let (mesh, first) =
                (&viewer.meshes[child["path"].as_str().expect("a tile")], below.positions.len() as u32);
            below.positions.extend(&mesh.positions);
            below.triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|v| v + first)));
        }
        assert_eq!(bits(&below), bits(&finest), "{path}");
        seen += 1;
    });
    assert!(seen > 100, "{seen}");
}

/// Two sheets in the same place, as where a scan was stored twice: their clusters have the same triangles.
#[test]
fn what_lies_in_one_place_twice_is_exported() {
    let folder = Folder::new();
    let mut mesh = Synth::new(Shape::Torus, 3000, 1).to_mesh();
    let (count, again) = (mesh.positions.len() as u32, mesh.clone());
    mesh.positions.extend_from_slice(&again.positions);
    mesh.triangles.extend(again.triangles.iter().map(|corners| corners.map(|corner| corner + count)));
    folder.write_mesh("in.ply", &mesh);
    folder.stdout("build in.ply -q --cluster-triangles 16");
    folder.stdout("export in.chpm --3dtiles tiles -q");
}

#[test]
fn the_frame_of_the_world_is_what_was_asked_for() {
    let folder = Folder::new();
    folder.write("far.obj", "v 1000.1 2000 3000\nv 1001.1 2000 3000\nv 1000.1 2001 3000\nf 1 2 3\n");
    folder.stdout("build far.obj -q");
    let origin = open(&folder, "far.chpm").header().origin;
    let top = |more: &str| {
        let up = if more.contains("--up") { "" } else { "--up z" };
        folder.stdout(&format!("export far.chpm --3dtiles out -qf {more} {up}"));
        json(&folder.path("out/tileset.json"))["root"].take()
    };
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().expect("numbers").iter().map(|x| x.as_f64().expect("a number")).collect()
    };
    let near = |got: &[f64], expected: [f64; 3]| {
        assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{got:?} {expected:?}");
    };
    near(&numbers(&top("")["transform"])[12..15], origin);
    let turned = [origin[0], -origin[2], origin[1]];
    near(&numbers(&top("--up y")["transform"])[12..15], turned);
    // East is y, north z and up x where the equator meets Greenwich.
    near(
        &numbers(&top("--origin 0,0,0")["transform"])[12..15],
        [6_378_137.0 + origin[2], origin[0], origin[1]],
    );
    near(
        &numbers(&top("--origin 0,0,0 --origin-at zero")["transform"])[12..15],
        [6_378_137.0 + origin[2], origin[0], origin[1]],
    );
    // The middle of the box, which is stored in singles, is not quite where the origin is.
    let [x, y, z] = open(&folder, "far.chpm").header().aabb().center().into();
    let middle = |more: &str| numbers(&top(&format!("--origin 0,0,5 {more}"))["transform"])[12..15].to_vec();
    near(&middle("--origin-at centre"), [6_378_142.0 - z, -x, -y]);
    near(&middle("--origin-at center --up y"), [6_378_142.0 - y, -x, z]);
    let moved = top("--transform 0,1,0,0,-1,0,0,0,0,0,1,0,5,6,7,1");
    near(&numbers(&moved["transform"])[12..15], [5.0 - origin[1], 6.0 + origin[0], 7.0 + origin[2]]);
    let glb = Glb::read(&folder.read("out/tiles/000/0.glb"));
    assert_eq!(
        glb.json["nodes"][0]["matrix"],
        serde_json::json!([1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1])
    );
    // The box around a tile, with axes of some length though it is flat.
    let flat = numbers(&top("")["content"]["boundingVolume"]["box"]);
    assert!(flat.len() == 12 && [3, 7, 11].iter().all(|at| flat[*at] > 0.0), "{flat:?}");
    for (words, told) in [
        ("--3dtiles new --origin 1,2", "13.4,52.5,34"),
        ("--3dtiles new --transform 1,2,3", "16 numbers"),
        ("--3dtiles new --origin 1,2,3 --transform 1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1", "cannot be used"),
        ("--3dtiles new --transform 1e306,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1", "smaller numbers"),
        ("--3dtiles new --origin-at centre", "--origin <LON,LAT,H>"),
        ("", "--3dtiles"),
        ("--3dtiles out", "--force"),
        ("--3dtiles far.obj -f", "export makes a folder"),
        ("--3dtiles . -f", "no name"),
        ("--3dtiles no/such", "cannot make a folder"),
        ("--3dtiles new --memory 1M", "--memory"),
    ] {
        let error = folder.stderr(&format!("export far.chpm -q {words}"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    assert_eq!(folder.names(), ["far.chpm", "far.obj", "out"]);
}

#[test]
fn a_model_that_is_not_where_it_was_put_is_told() {
    let folder = Folder::new();
    folder.write("utm.obj", "v 390000.5 5820000 30\nv 390001.5 5820000 30\nv 390000.5 5820001 31\nf 1 2 3\n");
    folder.stdout("build utm.obj -q");
    let said = |more: &str| {
        let run =
            folder.chpm(&format!("export utm.chpm --3dtiles out -qf --origin 13.4,52.5,34 {more}")).success();
        text(&run.get_output().stderr)
    };
    let told = said("");
    assert!(told.contains("begins 5,833 km") && told.contains(" km above"), "{told}");
    assert!(told.contains("--origin-at centre"), "{told}");
    assert_eq!(said("--origin-at centre"), "");
    // North is -z there, so that the same numbers lead upward.
    let told = said("--up y");
    assert!(told.contains("begins 390 km") && told.contains("5,8"), "{told}");
}

/// A model of some thousand tiles.
fn many_tiles() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 40000 -o in.ply -q");
    folder.stdout("build in.ply --cluster-triangles 16 -q");
    folder.stdout("export in.chpm --3dtiles expected -q");
    folder
}

/// The hidden folder of an export that is not whole, if there is one.
fn partial(folder: &Folder) -> Option<String> {
    let mut hidden = folder.names().into_iter().filter(|name| name.ends_with(".partial"));
    hidden.next().inspect(|_| assert_eq!(hidden.next(), None, "one at most"))
}

/// Runs an export and kills it once its journal has so many bytes; how many it had then, or none where it ended before.
fn kill_at(folder: &Folder, words: &str, bytes: u64) -> Option<u64> {
    let mut child =
        folder.command(words).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a process");
    loop {
        let journal = partial(folder).map(|name| folder.path(&name).join("journal"));
        let len = journal.and_then(|path| fs::metadata(path).ok()).map_or(0, |journal| journal.len());
        if child.try_wait().expect("a process").is_some() {
            return None;
        }
        if len > bytes {
            child.kill().expect("a process to kill");
            child.wait().expect("an end");
            return Some(len);
        }
        std::thread::yield_now();
    }
}

#[test]
fn an_export_that_was_killed_goes_on_to_the_same_bytes() {
    let folder = many_tiles();
    let words = "export in.chpm --3dtiles out -q";
    let expected = files(&folder.path("expected"));
    let records = 32 * expected.keys().filter(|name| name.ends_with(".glb")).count() as u64;
    assert!(records > 32 * 2000, "{records}");
    let (mut random, mut killed) = (0x2545_f491_u64, Vec::new());
    for round in 0..2 {
        // At its beginning, in between, and near its end; the next goes on from there.
        for share in [0, 20, 45, 70, 90] {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = records * (share + (random >> 33) % 9) / 100;
            if folder.path("out").exists() {
                break;
            }
            killed.extend(kill_at(&folder, words, at));
        }
        // What a crash of the system may leave: files that are shorter, and others with something else in them.
        if let Some(left) = partial(&folder).filter(|_| round > 0) {
            for name in ["tiles/000/3.glb", "tiles/001/1111.glb"].map(|name| folder.path(&left).join(name)) {
                if let Ok(bytes) = fs::read(&name) {
                    fs::write(
                        &name,
                        if name.ends_with("3.glb") { bytes[..40].to_vec() } else { vec![0; bytes.len()] },
                    )
                    .expect("a file");
                }
            }
        }
        if !folder.path("out").exists() {
            let told = folder.stderr(&words.replace("-q", ""), 0);
            assert!(told.contains("going on"), "{told}");
        }
        assert!(files(&folder.path("out")) == expected, "round {round}");
        assert_eq!(folder.names(), ["expected", "in.chpm", "in.ply", "out"]);
        fs::remove_dir_all(folder.path("out")).expect("a folder");
    }
    assert!(killed.len() > 3, "{killed:?}");

    // Other settings begin anew.
    if kill_at(&folder, words, records / 2).is_some() {
        folder.stdout(&format!("{words} --up y"));
        folder.stdout("export in.chpm --3dtiles turned --up y -q");
        assert!(files(&folder.path("out")) == files(&folder.path("turned")));
        assert_eq!(folder.names(), ["expected", "in.chpm", "in.ply", "out", "turned"]);
    }
}

#[test]
fn what_a_signal_or_a_full_disk_stopped_goes_on_and_damage_leaves_nothing() {
    let folder = many_tiles();
    let expected = files(&folder.path("expected"));
    let (status, told) = folder.signalled("export in.chpm --3dtiles out", "tiles", Signal::SIGINT);
    if !status.success() {
        let told = told.join(" ");
        assert!(!folder.path("out").exists() && told.contains("the same command goes on"), "{told}");
        folder.stdout("export in.chpm --3dtiles out -q");
    }
    assert!(files(&folder.path("out")) == expected);
    // A file may not be longer than 60 KB, which the journal is at some time.
    let words = "export in.chpm --3dtiles full -q --span 3";
    let limited = format!("ulimit -f 120; exec {CHPM} {words}");
    let out =
        Command::new("sh").current_dir(folder.path("")).args(["-c", &limited]).output().expect("a process");
    let told = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.code() == Some(2) && told.contains("the same command goes on"), "{told}");
    assert!(!folder.path("full").exists());
    folder.stdout(words);
    folder.stdout("export in.chpm --3dtiles other -q --span 3");
    assert!(files(&folder.path("full")) == files(&folder.path("other")));

    let mut bytes = folder.read("in.chpm");
    let at = bytes.len() / 2;
    bytes[at..].iter_mut().for_each(|byte| *byte = 0x55);
    folder.write("bad.chpm", bytes);
    let error = folder.stderr("export bad.chpm --3dtiles new -q", 2);
    assert!(error.contains("bad.chpm"), "{error}");
    assert_eq!(folder.names(), ["bad.chpm", "expected", "full", "in.chpm", "in.ply", "other", "out"]);
}

/// Another program with another idea of geometry: 3d-tiles-renderer in a browser, and gltf-validator.
#[test]
fn a_browser_draws_the_same_tiles_without_cracks() {
    let has = |program: &str| Command::new(program).arg("--version").output().is_ok();
    let tests = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/tiles");
    let missing = ["node", "chromium"].into_iter().find(|program| !has(program));
    let packages = Path::new(tests).join("node_modules").exists();
    if let Some(missing) = missing.or((!packages).then_some("package that `npm ci` installs in tests/tiles"))
    {
        skipped(format_args!("tilesets in a browser: no {missing}"));
        return;
    }
    let folder = models();
    let mut colored = Synth::new(Shape::Torus, 30_000, 1).to_mesh();
    colored.colors =
        (0..colored.positions.len()).map(|i| [(i % 256) as u8, (i / 256) as u8, 7, 255]).collect();
    folder.write_mesh("colored.ply", &colored);
    let mut run = Command::new("bash");
    run.arg(Path::new(tests).join("run.sh")).env("CHPM", CHPM).env("VIEWS", "9");
    run.args(["closed.ply", "open.ply", "colored.ply"].map(|name| folder.path(name)));
    let out = run.output().expect("a process");
    let [said, problems] = [out.stdout, out.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(out.status.success(), "{said}{problems}");
    // Six sets without a crack, and one that has to have some.
    let lines: Vec<_> = said.lines().filter(|line| line.contains(" crack edges;")).collect();
    let clean = lines.iter().filter(|line| line.contains("9 views") && line.contains(" 0 crack edges;"));
    assert_eq!((lines.len(), clean.count()), (7, 6), "{said}");
}
