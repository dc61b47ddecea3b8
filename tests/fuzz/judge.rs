//! What must hold whatever comes in: no panic, errors that leave nothing, files that their own verifier accepts, and stored errors that it proves.

use crate::command::{chpm, names};
use crate::container;
use crate::dialect::{self, Source};
use crate::draw::Draw;
use crate::model::Model;
use crate::settings::Told;
use crate::spoil::spoil;
use crate::verbs::use_verbs;
use chpm_build::{Cancel, Silent, build};
use chpm_format::{Chpm, FormatError, RemoteChpm, dump, verify};
use chpm_mesh::{Level, TriMesh};
use chpm_refine::{Camera, Cut, Hierarchy, RefineError, View, extract, random_cut, select};
use chpm_synth::{Shape, Synth};
use std::fs;
use std::io;
use std::path::Path;
use tempfile::TempDir;

/// What did not hold.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    /// What kind it is: a simpler case must fail likewise.
    pub(crate) kind: &'static str,
    pub(crate) told: String,
}

impl Failure {
    pub(crate) fn new(kind: &'static str, told: impl Into<String>) -> Self {
        Failure { kind, told: told.into() }
    }
}

/// How far a case goes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Depth {
    /// By the command as well as by the libraries.
    pub(crate) process: bool,
    /// Random cuts in which the command looks for cracks, and whose errors it proves.
    pub(crate) cuts: u32,
}

/// What became of a case.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Ended {
    /// The source was built, or the file is sound.
    Accepted,
    /// There was an error, as there should be.
    Refused,
}

fn require(holds: bool, kind: &'static str, told: impl FnOnce() -> String) -> Result<(), Failure> {
    if holds { Ok(()) } else { Err(Failure::new(kind, told())) }
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// The source of a case, and what it is to be built with.
pub(crate) fn source(bytes: &[u8]) -> (Source, Told) {
    let draw = &mut Draw::new(bytes);
    let told = Told::draw(draw);
    let model = Model::draw(draw);
    let mut source = dialect::write(&model, draw);
    spoil(&mut source.bytes, draw);
    source.beside.iter_mut().for_each(|(_, bytes)| spoil(bytes, draw));
    let mut source = dialect::pack(source, draw);
    if draw.once_in(8) {
        spoil(&mut source.bytes, draw);
    }
    (source, told)
}

fn put(source: &Source, folder: &Path) {
    fs::write(folder.join(&source.name), &source.bytes).expect("a file written");
    for (name, bytes) in &source.beside {
        fs::write(folder.join(name), bytes).expect("a file written");
    }
}

/// Builds a source and looks at the file.
pub(crate) fn judge_source(bytes: &[u8], depth: Depth) -> Result<Ended, Failure> {
    let (source, told) = source(bytes);
    let home = folder();
    let at = |name: &str| home.path().join(name);
    put(&source, home.path());
    let before = names(home.path());
    let built = build(&at(&source.name), &at("out.chpm"), &told.config, &Silent, &Cancel::default());
    let file = match built {
        Err(error) => {
            let after = names(home.path());
            require(before == after, "left behind", || format!("{after:?} after: {error}"))?;
            None
        }
        Ok(_) => {
            let file = fs::read(at("out.chpm")).expect("a file read");
            let after = names(home.path()).len();
            require(after == before.len() + 1, "left behind", || format!("{:?}", names(home.path())))?;
            let ended = use_file(file.clone())?;
            require(ended == Ended::Accepted, "own verify", || "a built file is refused".to_owned())?;
            Some(file)
        }
    };
    if depth.process {
        command_on_source(&source, &told, file.as_deref(), depth.cuts)?;
    }
    Ok(if file.is_some() { Ended::Accepted } else { Ended::Refused })
}

/// The command must come to the same file, or to an error where the library came to one.
fn command_on_source(
    source: &Source,
    told: &Told,
    expected: Option<&[u8]>,
    cuts: u32,
) -> Result<(), Failure> {
    let home = folder();
    let at = |name: &str| home.path().join(name);
    put(source, home.path());
    let before = names(home.path());
    let mut words = vec!["build", &source.name, "-o", "out.chpm", "-q", "--memory=128M"];
    words.extend(told.words.iter().map(String::as_str));
    let code = chpm(home.path(), &words, if expected.is_some() { &[0] } else { &[2] })?;
    // It has settings of its own, and may refuse what others accept.
    let simplify = ["simplify", &source.name, "--within=2%", "-o", "less.glb", "-q", "--memory=128M"];
    let is_there = chpm(home.path(), &simplify, &[0, 2])? == 0;
    require(at("less.glb").exists() == is_there, "left behind", || format!("{:?}", names(home.path())))?;
    let _ = fs::remove_file(at("less.glb"));
    if code != 0 {
        let after = names(home.path());
        return require(before == after, "left behind", || format!("{after:?}"));
    }
    let same = fs::read(at("out.chpm")).ok().as_deref() == expected;
    require(same, "bytes", || "another file than the library's".to_owned())?;
    let cuts = (cuts > 0).then(|| format!("--cuts={cuts}"));
    let mut verify = vec!["verify", "out.chpm", "-q", "--memory=128M", "--against", &source.name];
    verify.extend(cuts.as_deref());
    // Where detail was left out, there is nothing that errors could be held against.
    let is_trimmed = expected.is_some_and(|bytes| Chpm::open(bytes).is_ok_and(|file| file.is_trimmed()));
    if !is_trimmed {
        verify.extend(["--errors", "--positions=2"]);
    }
    chpm(home.path(), &verify, &[0])?;
    chpm(home.path(), &["extract", "out.chpm", "-q", "--level=0", "-o", "fine.ply"], &[0])?;
    chpm(home.path(), &["extract", "out.chpm", "-q", "--error=0.5", "-o", "near.ply"], &[0])?;
    let mut expected = before;
    expected.extend(["out.chpm", "fine.ply", "near.ply"].map(str::to_owned));
    expected.sort();
    let after = names(home.path());
    require(after == expected, "left behind", || format!("{after:?}"))?;
    fs::remove_file(at("near.ply")).expect("a file removed");
    use_verbs(home.path(), "out.chpm", true)
}

/// Opens, verifies, dumps and extracts; a file that is sound must give every mesh.
fn use_file(bytes: Vec<u8>) -> Result<Ended, Failure> {
    let from_afar = use_ranges(&bytes);
    let Ok(file) = Chpm::open(bytes) else { return Ok(Ended::Refused) };
    let report = verify(&file, |_, _| ());
    let sound = report.is_ok();
    if sound && !from_afar.as_ref().is_ok_and(|clusters| *clusters == file.clusters().len()) {
        return Err(Failure::new("sound and not to be read in ranges", format!("{from_afar:?}")));
    }
    let mut told = Vec::new();
    let all =
        [("dump", dump(&file, &mut told, true).map_err(|e| e.to_string()))].into_iter().chain(meshes(&file));
    for (what, result) in all {
        if let (true, Err(error)) = (sound, result) {
            return Err(Failure::new("sound and of no use", format!("{what}: {error}")));
        }
    }
    // A body of text that cannot be decoded is a fault that leaves the geometry as it is.
    let _ = file.metadata();
    Ok(if sound { Ended::Accepted } else { Ended::Refused })
}

/// Reads all pages that ranges of the file lead to from the roots; how many.
fn use_ranges(bytes: &[u8]) -> Result<usize, FormatError> {
    let mut file = RemoteChpm::open(bytes.len() as u64, |_, offset, out: &mut [u8]| {
        let range = offset as usize..offset as usize + out.len();
        out.copy_from_slice(bytes.get(range).ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    })?;
    let mut met = file.roots()?;
    let mut next = 0;
    while let Some(id) = met.get(next).copied() {
        next += 1;
        file.page(id)?;
        let group = file.cluster(id)?.group();
        if file.coarse(group)?.first() == Some(&id) {
            met.extend(file.fine(group)?);
        }
    }
    Ok(met.len())
}

/// Meshes of every way to choose one.
fn meshes(file: &Chpm<Vec<u8>>) -> Vec<(&'static str, Result<(), String>)> {
    let got = |cut: Result<Cut, RefineError>| -> Result<(), String> {
        let mesh: TriMesh = cut.and_then(|cut| extract(file, &cut)).map_err(|e| e.to_string())?;
        let in_range = mesh.triangles.as_flattened().iter().all(|v| (*v as usize) < mesh.positions.len());
        if in_range { Ok(()) } else { Err("an index out of range".to_owned()) }
    };
    let view = View::new(&Camera::framing(&file.header().aabb()), [640, 480], 2.0);
    let mut meshes = vec![
        ("level 0", got(Ok(Cut::at_level(file, Level(0))))),
        ("level 1", got(Ok(Cut::at_level(file, Level(1))))),
        ("roots", got(Ok(Cut::at_level(file, Level(99))))),
        ("error", got(Cut::at_error(file, file.header().max_error * 0.3))),
        ("distance", got(Cut::at_distance(file, file.header().max_error * 0.3))),
        ("triangles", got(Cut::at_triangles(file, 50))),
        ("random", got(random_cut(file, 7))),
    ];
    // A box that no camera can look at shows nothing.
    if let Ok(view) = view {
        meshes.push(("view", got(select(file, &Hierarchy::new(file), &view))));
    }
    meshes
}

/// Files that damage starts from: several levels, attributes, both modes, several roots, trimmed leaves.
pub(crate) fn corpus() -> Vec<Vec<u8>> {
    let built = |shape: Shape, triangles: u64, looks: bool, words: &dyn Fn(&mut Told)| {
        let home = folder();
        let mesh = Synth::new(shape, triangles, 3).to_mesh();
        let mut model = Model::of(&mesh);
        if looks {
            model.normals = mesh.positions.clone();
            model.colors = (0..mesh.positions.len() as u32).map(u32::to_le_bytes).collect();
        }
        let source =
            Source { name: "m.ply".into(), bytes: dialect::ply(&model, &mut Draw::new(&[])), beside: vec![] };
        put(&source, home.path());
        let mut told = Told::draw(&mut Draw::new(&[]));
        words(&mut told);
        let (from, to) = (home.path().join("m.ply"), home.path().join("m.chpm"));
        build(&from, &to, &told.config, &Silent, &Cancel::default()).expect("a build");
        fs::read(to).expect("a file read")
    };
    vec![
        built(Shape::Sphere, 100, false, &|_| ()),
        built(Shape::Torus, 900, false, &|_| ()),
        built(Shape::Terrain, 900, true, &|told| {
            told.config.settings.boundary = chpm_format::BoundaryMode::Lock
        }),
        built(Shape::Isosurface, 2500, false, &|told| {
            told.config.settings.target_error = Some(chpm_build::config::Length::OfDiagonal(1.0));
        }),
        built(Shape::Plates, 1500, true, &|told| {
            told.config.settings.finest_error = Some(chpm_build::config::Length::OfDiagonal(0.1));
        }),
    ]
}

/// The damaged file of a case.
pub(crate) fn file(bytes: &[u8], corpus: &[Vec<u8>]) -> Vec<u8> {
    let draw = &mut Draw::new(bytes);
    let mut file = corpus[draw.below(corpus.len())].clone();
    container::damage(&mut file, draw);
    file
}

/// Uses a damaged file.
pub(crate) fn judge_file(bytes: &[u8], corpus: &[Vec<u8>], depth: Depth) -> Result<Ended, Failure> {
    let file = file(bytes, corpus);
    let ended = use_file(file.clone())?;
    if depth.process {
        let home = folder();
        fs::write(home.path().join("bad.chpm"), &file).expect("a file written");
        let run =
            |words: &str, codes: &[i32]| chpm(home.path(), &words.split(' ').collect::<Vec<_>>(), codes);
        let sound = ended == Ended::Accepted;
        let cuts = if depth.cuts > 0 { format!(" --cuts={}", depth.cuts) } else { String::new() };
        run(&format!("verify bad.chpm -q --memory=128M{cuts}"), if sound { &[0] } else { &[1] })?;
        run("info bad.chpm", if sound { &[0] } else { &[0, 2] })?;
        run("info bad.chpm --json", if sound { &[0] } else { &[0, 2] })?;
        run("dump bad.chpm --pages", if sound { &[0] } else { &[0, 2] })?;
        let code = run("extract bad.chpm -q --level=0 -o out.ply", if sound { &[0] } else { &[0, 2] })?;
        let after = names(home.path());
        let left = after.iter().any(|name| name != "bad.chpm" && !(code == 0 && name == "out.ply"));
        require(!left, "left behind", || format!("{after:?}"))?;
        use_verbs(home.path(), "bad.chpm", sound)?;
    }
    Ok(ended)
}
