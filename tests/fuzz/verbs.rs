//! Verbs that make something else of a file, or ask how near two are: those that a case has drawn, and what must hold of their answers.

use crate::command::{chpm, names, said};
use crate::judge::Failure;
use chpm_format::{Chpm, ErrorKind};
use serde_json::Value;
use std::fs;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// What is written into the folder and has to be there afterwards, and the words that say so; `F` is the file.
const WRITERS: [(&str, &str); 14] = [
    ("tiles", "export F -q --memory=128M --3dtiles tiles"),
    ("tiles", "export F -q --memory=128M --3dtiles tiles --meshopt --up y"),
    ("tiles", "export F -q --memory=128M --3dtiles tiles --origin=-13.4,52.5,34"),
    ("near.glb", "extract F -q --error=1% -o near.glb"),
    ("near.glb", "extract F -q --error=0 -o near.glb --meshopt"),
    ("near.stl", "extract F -q --poe=3 -o near.stl"),
    ("near.obj", "extract F -q --level=0 -o near.obj"),
    ("near.ply", "extract F -q --triangles=100% --order=cache-oblivious --ascii -o near.ply"),
    ("packed.chpm", "relayout F -q --memory=128M --pages packed -o packed.chpm"),
    ("shared", "share F -q -o shared"),
    ("page.html", "report F -q -o page.html"),
    ("orbit.path", "path orbit F --frames 5 -o orbit.path"),
    ("plan.svg", "section F -q --memory=128M --every=3% -o plan.svg"),
    ("plan.dxf", "section F -q --memory=128M --plane=1,2,3:0.1 -o plan.dxf"),
];

/// What a file is asked with itself, and how it may end where the file is sound.
const QUESTIONS: [(&str, &[i32]); 14] = [
    ("thickness F -q --memory=128M --json", &[0]),
    ("visible F -q --memory=128M --from=0,0,0 --from=1e9,-1,2", &[0]),
    ("distance F F -q --memory=128M --json --error=0", &[0]),
    ("distance F F -q --memory=128M --json --pose=1e3,0,0,0,0,1,1", &[0]),
    ("distance F F -q --memory=128M --json --pose=0,0,0.01,0,1,0,3 --max-pages=3", &[0]),
    ("clearance F F -q --memory=128M --above=1%", &[1]),
    ("clearance F F -q --memory=128M --above=1% --pose=0.3,0.2,0.1", &[0, 1]),
    ("contacts F --self -q --memory=128M --json", &[0]),
    // More may be near than the memory has room for.
    ("contacts F F -q --memory=128M --within=1% --pose=0.1,0,0", &[0, 2]),
    ("contacts F F -q --memory=128M --error=1% --pose=0.1,0,0,0,0,1,2", &[0, 2]),
    ("compare F F -q --memory=128M --json", &[0]),
    ("compare F F -q --memory=128M --tolerance=0 --pose=0.1,0,0", &[0]),
    ("stats F", &[0]),
    ("info F --json", &[0]),
];

/// Has the command do some of it with a file of the folder; what it is to do follows from the file's bytes.
pub(crate) fn use_verbs(folder: &Path, file: &str, sound: bool) -> Result<(), Failure> {
    let bytes = fs::read(folder.join(file)).expect("a file read");
    let draw = xxh3_64(&bytes);
    let words = |line: &'static str| -> Vec<String> {
        line.split(' ').map(|word| if word == "F" { file.to_owned() } else { word.to_owned() }).collect()
    };
    let run = |line: &'static str, codes: &[i32]| {
        let words = words(line);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let codes: &[i32] = if sound { codes } else { &[0, 1, 2] };
        chpm(folder, &words, codes)
    };

    let (made, line) = WRITERS[draw as usize % WRITERS.len()];
    // A case is the same whatever the command was compiled with; what it has not is asked for in another way.
    let (made, line) = match made {
        "shared" if !cfg!(feature = "web") => ("near.glb", "extract F -q --error=1% -o near.glb"),
        _ => (made, line),
    };
    let before = names(folder);
    // Three percent of a model that is one point are no step.
    let is_point =
        made == "plan.svg" && Chpm::open(&bytes).is_ok_and(|file| file.header().aabb().diagonal() == 0.0);
    let code = run(line, if is_point { &[2] } else { &[0] })?;
    let mut expected = before;
    if code == 0 {
        expected.push(made.to_owned());
        expected.sort();
    }
    let after = names(folder);
    if after != expected {
        return Err(Failure::new("left behind", format!("{line}: {after:?}")));
    }
    if code == 0 && made == "packed.chpm" && sound {
        come_back(folder, file)?;
    }

    let (line, codes) = QUESTIONS[(draw >> 32) as usize % QUESTIONS.len()];
    // Where a source meets itself is asked of the source.
    let is_trimmed = || Chpm::open(&bytes).is_ok_and(|file| file.is_trimmed());
    // And nothing is proven with errors that are estimates, nor where nothing tells how far away is what has vanished.
    let proves = ["distance", "clearance", "contacts", "compare"].iter().any(|verb| line.starts_with(verb));
    let is_estimated = proves
        && Chpm::open(&bytes)
            .is_ok_and(|file| file.header().error_kind() == Some(ErrorKind::Quadric) || !file.has_gaps());
    let is_refused = is_estimated || line.contains("--self") && is_trimmed();
    run(line, if sound && is_refused { &[2] } else { codes })?;
    if sound && !is_estimated && line.starts_with("distance F F -q --memory=128M --json") {
        let told = said(folder, &words(line));
        let answer = serde_json::from_str::<Value>(&told).map(|told| told["answers"][0].clone());
        let [least, most] = ["least", "most"].map(|name| answer.as_ref().ok()?[name].as_f64());
        let is_interval = least.zip(most).is_some_and(|(least, most)| (0.0..=most).contains(&least));
        if !is_interval || line.ends_with("--error=0") && least != Some(0.0) {
            return Err(Failure::new("distance", told));
        }
    }
    Ok(())
}

/// What was packed is sound, and what is unpacked again is what it was.
fn come_back(folder: &Path, file: &str) -> Result<(), Failure> {
    chpm(folder, &["verify", "packed.chpm", "-q", "--memory=128M"], &[0])?;
    // A damaged file may be sound and have bytes that nobody writes.
    let [raw, again] = [file, "packed.chpm"].map(|from| {
        let to = "raw.chpm";
        chpm(folder, &["relayout", from, "-q", "--memory=128M", "--pages", "raw", "-o", to], &[0])?;
        let bytes = fs::read(folder.join(to)).expect("a file read");
        fs::remove_file(folder.join(to)).expect("a file removed");
        Ok(bytes)
    });
    if raw? == again? { Ok(()) } else { Err(Failure::new("bytes", "unpacked, it is another file")) }
}
