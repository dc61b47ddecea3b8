//! Meshes that engines load: glTF in two files.

use super::gltf::{Gltf, decoded};
use super::harness::{CHPM, Folder, text};
use super::sheets::{BUILD, textured};
use nix::sys::signal::Signal;
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
