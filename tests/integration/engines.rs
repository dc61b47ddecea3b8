//! Meshes that engines load: glTF in two files, and quantized.

use super::gltf::{Gltf, Placed, decoded};
use super::harness::{CHPM, Folder, text};
use super::sheets::{BUILD, textured};
use nix::sys::signal::Signal;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::process::Command;

/// A turned surface with normals and colours, and its file.
fn sphere() -> Folder {
    let folder = Folder::new();
    let mut mesh = chpm_synth::Synth::new(chpm_synth::Shape::Sphere, 8000, 1).to_mesh();
    mesh.normals = mesh.positions.clone();
    mesh.colors = (0..mesh.positions.len()).map(|i| [(i % 256) as u8, (i / 256) as u8, 7, 255]).collect();
    folder.write_mesh("in.ply", &mesh);
    folder.stdout("build in.ply -q --cluster-triangles 256");
    folder
}

/// A GLB, and the same as JSON: the same document but for the name of the buffer, and the same bytes.
#[test]
fn a_gltf_is_the_glb_in_two_files() {
    let folder = sphere();
    for (ask, more) in [
        ("extract in.chpm --triangles 900", ""),
        ("extract in.chpm --triangles 900", "--meshopt"),
        ("extract in.chpm --level 0", "--order cache-oblivious"),
        ("simplify in.ply --triangles 500", ""),
        ("simplify in.ply --triangles 500", "--local-origin --no-colors"),
    ] {
        folder.stdout(&format!("{ask} -o one.glb -qf {more}"));
        folder.stdout(&format!("{ask} -o two.gltf -qf {more}"));
        let [one, mut two] = ["one.glb", "two.gltf"].map(|name| Gltf::open(&folder, name));
        assert_eq!(two.json["buffers"][0]["uri"], "two.bin", "{ask} {more}");
        two.json["buffers"][0].as_object_mut().expect("an object").remove("uri");
        assert_eq!(one.json, two.json, "{ask} {more}");
        assert!(folder.read("one.glb").ends_with(&folder.read("two.bin")));
        let [a, b] = [one, two].map(|gltf| gltf.mesh(0));
        assert_eq!((a.positions, a.triangles), (b.positions, b.triangles));
        assert!(a.colors == b.colors && a.normals == b.normals && a.normals.len() == a.stored.len());
    }
    // Whatever writes one.
    folder.stdout("compare in.chpm in.chpm -o far.gltf -q");
    let all = folder.read_mesh("in.ply").triangles.len();
    assert_eq!(Gltf::open(&folder, "far.gltf").mesh(0).triangles.len(), all);
    folder.stdout("extract in.chpm --triangles 500 -o new.v2 --format gltf -q");
    assert_eq!(Gltf::open(&folder, "new.v2").json["buffers"][0]["uri"], "new.bin");
    // It is read back.
    folder.stdout("extract in.chpm --level 0 -o all.gltf -q --up y");
    folder.stdout("build all.gltf -q -o back.chpm");
    folder.stdout("extract back.chpm --level 0 -o back.ply -q");
    folder.stdout("extract in.chpm --level 0 -o all.ply -q");
    let [back, all] = ["back.ply", "all.ply"].map(|name| super::harness::triangles(&folder.read_mesh(name)));
    assert_eq!(back, all);
}

#[test]
fn names_with_blanks_and_letters_of_any_language_are_found_by_readers() {
    let folder = textured();
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    let name = "gr\u{fc}ne Vase 50%.gltf";
    let made = Command::new(CHPM)
        .current_dir(folder.path(""))
        .args(["extract", "a.chpm", "--triangles", "500", "--texture-size", "1024", "-q", "-o", name])
        .output()
        .expect("a process");
    assert!(made.status.success(), "{}", text(&made.stderr));
    let gltf = Gltf::open(&folder, name);
    assert_eq!(gltf.json["buffers"][0]["uri"], "gr%C3%BCne%20Vase%2050%25.bin");
    let image = decoded(gltf.json["images"][0]["uri"].as_str().expect("an address"));
    assert_eq!(image, "gr\u{fc}ne Vase 50%.0.jpg");
    assert!(folder.read(&image).starts_with(&[0xff, 0xd8]));
    assert_eq!(gltf.json["images"][0].get("bufferView"), None);
    let mesh = gltf.mesh(0);
    assert!(!mesh.triangles.is_empty() && mesh.places.len() == mesh.positions.len());

    // The same triangles, places and image as in a GLB.
    folder.stdout("extract a.chpm --triangles 500 --texture-size 1024 -q -o a.glb");
    let glb = Gltf::open(&folder, "a.glb");
    let inside = glb.mesh(0);
    assert_eq!((inside.positions, inside.places), (mesh.positions, mesh.places));
    let bytes = folder.read("a.glb");
    let image = folder.read(&image);
    assert!(bytes.windows(image.len()).any(|window| window == image));
}

#[test]
fn what_lies_beside_a_gltf_is_kept_as_the_gltf_is() {
    let folder = sphere();
    let ask = "extract in.chpm --triangles 500 -q -o";
    for (words, told) in [
        ("-", "--format gltf", "cannot write to standard output"),
        ("new.gltf", "--ascii", "binary"),
        ("new.gltf", "--format glb", "glTF"),
        ("missing/new.gltf", "", "missing"),
        ("new.bin", "--format gltf", "beside it"),
        ("new.BIN", "--format gltf -f", "beside it"),
    ]
    .map(|(name, more, told)| (format!("{name} {more}"), told))
    {
        let error = folder.stderr(&format!("{ask} {words}"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    // A buffer that is somebody else's is not replaced, and neither is there afterwards.
    folder.write("taken.bin", "mine");
    let error = folder.stderr(&format!("{ask} taken.gltf"), 2);
    assert!(error.contains("taken.bin") && error.contains("--force"), "{error}");
    assert_eq!(folder.read("taken.bin"), b"mine");
    folder.stdout(&format!("{ask} taken.gltf -f"));
    assert_eq!(Gltf::open(&folder, "taken.gltf").mesh(0).triangles.len(), 500);
    // Nor is the source, even by force.
    fs::copy(folder.path("in.chpm"), folder.path("model.bin")).expect("a copy");
    let error = folder.stderr("extract model.bin --triangles 500 -qf -o model.gltf", 2);
    assert!(error.contains("model.bin") && error.contains("input"), "{error}");
    assert_eq!(folder.read("model.bin"), folder.read("in.chpm"));
    let expected = ["in.chpm", "in.ply", "model.bin", "taken.bin", "taken.gltf"];
    assert_eq!(folder.names(), expected);

    // A full disk leaves nothing; the file size limit stands for it.
    let limited = format!("ulimit -f 8; chpm {ask} full.gltf");
    let output = super::harness::shell(&folder, &limited);
    assert!(!output.status.success(), "{output:?}");
    assert_eq!(folder.names(), expected);
}

#[test]
fn a_gltf_that_is_stopped_leaves_nothing() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 60000 -o in.ply -q");
    let (status, told) =
        folder.signalled("simplify in.ply --within 0.1 -o out.gltf", "simplify", Signal::SIGINT);
    assert!(!status.success(), "{told:?}");
    assert_eq!(folder.names(), ["in.ply"], "{told:?}");
}

/// How far a written mesh may be from its source, and how much of that is not in the exact one.
fn bound(folder: &Folder, words: &str) -> (f64, Value) {
    let told: Value = serde_json::from_str(&folder.stdout(words)).expect("JSON");
    let levels = told["levels"].as_array();
    let first = levels.and_then(|levels| levels.first()).unwrap_or(&told);
    (first["error"].as_f64().expect("a bound"), told.clone())
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Positions, normals and colours of a quantized mesh are those of the exact one, as near as is told; equal ones stay equal.
fn check_quantized(exact: &Placed, small: &Placed, told: f64, diagonal: f64) {
    assert_eq!(
        (exact.triangles.len(), exact.positions.len()),
        (small.triangles.len(), small.positions.len())
    );
    let mut at: BTreeMap<[u64; 3], [f64; 3]> = BTreeMap::new();
    let mut worst: f64 = 0.0;
    for ((place, stored), (found, own)) in
        exact.positions.iter().zip(&exact.stored).zip(small.positions.iter().zip(&small.stored))
    {
        worst = worst.max(length([0, 1, 2].map(|axis| place[axis] - found[axis])));
        assert!(own.iter().all(|x| x.fract() == 0.0 && (0.0..=65_535.0).contains(x)), "{own:?}");
        let known = *at.entry(stored.map(f64::to_bits)).or_insert(*own);
        assert_eq!(known, *own, "a vertex of two primitives");
    }
    assert!(worst <= told, "{worst} {told}");
    // It is not told larger than a cell, either: the box has a side of its diagonal's third root at least.
    assert!(told <= 0.9 * diagonal / 65_535.0 && worst > 0.2 * told, "{worst} {told}");
    assert_eq!((exact.normals.len(), exact.colors.len()), (small.normals.len(), small.colors.len()));
    for (a, b) in exact.normals.iter().zip(&small.normals) {
        let cosine = (0..3).map(|axis| a[axis] * b[axis]).sum::<f64>() / length(*a) / length(*b);
        assert!(cosine > 0.5_f64.to_radians().cos(), "{a:?} {b:?}");
        assert!((length(*b) - 1.0).abs() < 0.01, "{b:?}");
    }
    for (a, b) in exact.colors.iter().zip(&small.colors) {
        assert!((0..4).all(|channel| (a[channel] - b[channel]).abs() <= 0.5 / 255.0 + 1e-6), "{a:?} {b:?}");
    }
}

#[test]
fn a_quantized_mesh_is_as_near_as_is_told() {
    let folder = sphere();
    folder.stdout("synth terrain --triangles 9000 -o land.ply -q");
    folder.stdout("build land.ply -q --cluster-triangles 256");
    let far: String = folder
        .read_mesh("in.ply")
        .positions
        .iter()
        .map(|[x, y, z]| {
            let [x, y, z] = [4.5e6 + f64::from(*x), f64::from(*y) - 3e6, 0.1 + f64::from(*z)];
            format!("v {x} {y} {z}\n")
        })
        .collect();
    let faces = folder.read_mesh("in.ply").triangles.clone();
    let faces: String = faces.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1)).collect();
    folder.write("far.obj", far + &faces);
    folder.stdout("build far.obj -q --cluster-triangles 256");
    for (name, ask, diagonal) in [
        ("a.glb", "extract in.chpm --level 0", 3.5),
        ("a.gltf", "extract in.chpm --triangles 900", 3.5),
        ("a.glb", "extract in.chpm --triangles 900 --meshopt", 3.5),
        ("a.glb", "extract in.chpm --triangles 900 --no-colors --meshopt", 3.5),
        ("a.glb", "extract in.chpm --triangles 900 --no-normals --no-colors --meshopt", 3.5),
        ("a.glb", "extract in.chpm --triangles 900 --no-normals", 3.5),
        ("a.glb", "extract in.chpm --triangles 900 --up z --order cache-oblivious", 3.5),
        ("a.glb", "extract in.chpm --lods 4k,900,200 --meshopt", 3.5),
        ("a.gltf", "extract land.chpm --triangles 2000", 1.5),
        ("a.glb", "extract land.chpm --triangles 2000 --up x", 1.5),
        ("a.glb", "extract far.chpm --triangles 900", 3.5),
        ("a.glb", "extract far.chpm --triangles 900 --local-origin --up z", 3.5),
        ("a.glb", "simplify in.ply --triangles 900", 3.5),
    ] {
        let (exact, _) = bound(&folder, &format!("{ask} -o {name} -qf --json"));
        let before = Gltf::open(&folder, name);
        let (error, json) = bound(&folder, &format!("{ask} -o small.glb -qf --json --quantize"));
        let small = Gltf::open(&folder, "small.glb");
        assert_eq!(small.extension("KHR_mesh_quantization"), Some(true), "{ask}");
        assert_eq!(before.extension("KHR_mesh_quantization"), None);
        assert_eq!(small.kind(0, "POSITION"), 5123);
        if !ask.contains("--no-normals") && ask.contains("in.") {
            assert_eq!(small.kind(0, "NORMAL"), 5120);
        }
        for node in 0..small.json["nodes"].as_array().map_or(0, Vec::len) {
            check_quantized(&before.mesh(node), &small.mesh(node), error - exact, diagonal);
        }
        let extras = &small.json["meshes"][0]["extras"]["error"];
        assert_eq!(extras.as_f64().map(|x| x as f32), Some(error as f32), "{ask}: {json}");
    }
    // Vertices of half the bytes, and fewer where they are compressed.
    let len = |more: &str| {
        folder.stdout(&format!("extract in.chpm --level 0 -o len.glb -qf {more}"));
        folder.read("len.glb").len()
    };
    let [plain, quantized, packed, both] = ["", "--quantize", "--meshopt", "--meshopt --quantize"].map(len);
    let saved = 16 * folder.read_mesh("in.ply").positions.len();
    assert!(plain.abs_diff(quantized + saved) < 500, "{plain} {quantized}");
    assert!(3 * both < 2 * packed, "{packed} {both}");
    // It is read back, each position where it was placed.
    folder.stdout("extract in.chpm --level 0 -o q.glb -qf --quantize --up y");
    folder.stdout("build q.glb -q -o back.chpm");
    folder.stdout("extract back.chpm --level 0 -q -o back.ply");
    assert_eq!(folder.read_mesh("back.ply").triangles.len(), folder.read_mesh("in.ply").triangles.len());
}

#[test]
fn a_distance_that_is_asked_for_has_room_for_rounding() {
    let folder = sphere();
    let (_, told) = bound(&folder, "extract in.chpm --error 0.01 -o a.glb -q --json --quantize");
    assert!(told["distance"].as_f64().expect("a bound") <= 0.01 && told["satisfied"] == true, "{told}");
    // Less than a cell is told, or refused.
    let (error, told) = bound(&folder, "extract in.chpm --error 1e-6 -o b.glb -q --json --quantize");
    assert!(told["satisfied"] == false && error > 1e-6 && error < 4e-5, "{told}");
    folder.chpm("extract in.chpm --error 1e-6 -o b.glb -qf --quantize --strict").code(1);
    let error = folder.stderr("simplify in.ply --within 1e-6 -o c.glb -q --quantize", 2);
    assert!(error.contains("rounds"), "{error}");
    let within = "simplify in.ply --within 0.01 -o c.glb -q --json --quantize --effort 1";
    let (_, told) = bound(&folder, within);
    assert!(told["distance"].as_f64().expect("a bound") <= 0.01, "{told}");
    for (words, told) in
        [("-o no.ply", "this is PLY"), ("-o no.obj", "this is OBJ"), ("-o - --format stl", "this is STL")]
    {
        let error = folder.stderr(&format!("extract in.chpm --level 0 --quantize -q {words}"), 2);
        assert!(error.contains("--quantize is for GLB and glTF") && error.contains(told), "{words}: {error}");
    }
}

#[test]
fn a_quantized_mesh_keeps_its_images() {
    let folder = textured();
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD} --normals computed"));
    let ask = "extract a.chpm --triangles 500 --texture-size 1024";
    for (name, more) in [("a.glb", ""), ("packed.glb", "--meshopt"), ("a.gltf", "")] {
        let (exact, _) = bound(&folder, &format!("{ask} -o exact.glb -qf --json {more}"));
        let (error, _) = bound(&folder, &format!("{ask} -o {name} -qf --json --quantize {more}"));
        let small = Gltf::open(&folder, name);
        let (before, after) = (Gltf::open(&folder, "exact.glb").mesh(0), small.mesh(0));
        check_quantized(&before, &after, error - exact, 1.5);
        assert_eq!((before.places, after.normals.is_empty()), (after.places, false));
        assert_eq!([small.kind(0, "POSITION"), small.kind(0, "NORMAL")], [5123, 5120]);
        assert_eq!(small.kind(0, "TEXCOORD_0"), 5126);
    }
}
