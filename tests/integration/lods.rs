//! Levels of detail out of a file: in one glTF by `MSFT_lod`, or each in a file of its own.

use super::gltf::Gltf;
use super::harness::{Folder, shell, text, triangles};
use super::sheets::{BUILD, textured};
use chpm_mesh::TriMesh;
use nix::sys::signal::Signal;
use serde_json::Value;

/// A surface with normals and colours, and its file.
fn built() -> Folder {
    let folder = Folder::new();
    let mut mesh = chpm_synth::Synth::new(chpm_synth::Shape::Sphere, 20_000, 1).to_mesh();
    mesh.normals = mesh.positions.clone();
    mesh.colors = (0..mesh.positions.len()).map(|i| [(i % 256) as u8, (i / 256) as u8, 7, 255]).collect();
    folder.write_mesh("in.ply", &mesh);
    folder.stdout("build in.ply -q --cluster-triangles 512");
    folder
}

fn json(folder: &Folder, words: &str) -> Value {
    serde_json::from_str(&folder.stdout(words)).expect("JSON")
}

/// The mesh of a node, as it is stored.
fn stored(gltf: &Gltf, node: usize) -> TriMesh {
    let mesh = gltf.mesh(node);
    let positions = mesh.stored.iter().map(|p| p.map(|x| x as f32)).collect();
    TriMesh::new(positions, mesh.triangles.iter().map(|corners| corners.map(|v| v as u32)).collect())
}

#[test]
fn one_gltf_has_all_levels_and_shows_the_finest() {
    let folder = built();
    for (name, more) in [
        ("x.glb", ""),
        ("x.gltf", ""),
        ("packed.glb", "--meshopt"),
        ("ordered.glb", "--order cache-oblivious"),
        ("bare.glb", "--no-normals --no-colors --up z"),
    ] {
        let ask = format!("extract in.chpm --lods 6k,1500,300 {more}");
        let told = json(&folder, &format!("{ask} -o {name} -q --json"));
        assert_eq!((&told["schema"], &told["satisfied"]), (&"chpm-extract-lods/1".into(), &true.into()));
        let gltf = Gltf::open(&folder, name);
        assert_eq!(gltf.extension("MSFT_lod"), Some(false), "who does not know levels reads the file");
        assert_eq!(gltf.json["scenes"], serde_json::json!([{ "nodes": [0] }]));
        let nodes = gltf.json["nodes"].as_array().expect("nodes");
        let ids = nodes[0]["extensions"]["MSFT_lod"]["ids"].as_array().expect("levels");
        let ids: Vec<usize> = ids.iter().map(|id| id.as_u64().expect("a number") as usize).collect();
        assert_eq!((nodes.len(), ids), (3, vec![1, 2]));
        let shares = nodes[0]["extras"]["MSFT_screencoverage"].as_array().expect("shares");
        assert_eq!(shares.len(), 3);

        let levels = told["levels"].as_array().expect("levels");
        let mut before = (u64::MAX, -1.0, 1.0);
        for (number, most) in [6000, 1500, 300].into_iter().enumerate() {
            let level = &levels[number];
            let count = level["triangles"].as_u64().expect("a count");
            assert_eq!((level["asked"].as_u64(), level["output"].as_str()), (Some(most), Some(name)));
            // The same mesh as alone.
            folder.stdout(&format!("extract in.chpm --triangles {most} -o one.glb -qf {more}"));
            let one = Gltf::open(&folder, "one.glb");
            let (here, alone) = (stored(&gltf, number), stored(&one, 0));
            assert_eq!(triangles(&here), triangles(&alone), "{name} {number}");
            assert_eq!((here.triangles.len() as u64, count <= most), (count, true), "{name} {number}");
            assert_eq!(gltf.json["meshes"][number]["extras"], one.json["meshes"][0]["extras"]);
            let placed = &gltf.mesh(number);
            assert_eq!(placed.positions, one.mesh(0).positions, "every level stands where it is alone");
            let bare = if more.contains("--no-normals") { 0 } else { placed.positions.len() };
            assert_eq!((placed.normals.len(), placed.colors.len()), (bare, bare));

            let extras = &gltf.json["meshes"][number]["extras"];
            let error = extras["distance"].as_f64().or(extras["error"].as_f64()).expect("a bound");
            assert_eq!(level["distance"].as_f64().map(|x| x as f32), Some(error as f32));
            let share = shares[number].as_f64().expect("a share");
            assert!(count < before.0 && error > before.1 && share <= before.2, "{name} {number}");
            assert_eq!(level["coverage"].as_f64(), Some(share));
            // Down to there the next level is more than a pixel of 1080 off, if the model's sphere covers that share of the height.
            let diagonal = 2.0 * 3.0_f64.sqrt();
            let next = levels.get(number + 1).map(|next| next["error"].as_f64().expect("a bound"));
            let expected = next.map_or(0.0, |next| (diagonal / 1080.0 / next).min(1.0));
            assert!((share - expected).abs() <= 1e-3 * expected, "{name} {number}: {share} {expected}");
            before = (count, error, share);
        }
        assert_eq!(shares[2], 0.0);
        folder.stdout(&format!("{ask} -o again.glb -qf --memory 64M"));
        if name.ends_with("glb") {
            assert_eq!(folder.read("again.glb"), folder.read(name), "the same bytes for any memory");
        }
    }
    // Here, too: only the scene is read.
    folder.stdout("build x.glb -q -o back.chpm");
    let count = stored(&Gltf::open(&folder, "x.glb"), 0).triangles.len();
    assert!(json(&folder, "info back.chpm --json").to_string().contains(&count.to_string()));
    let told = folder.stdout("extract in.chpm --lods 6k,30% -o two.glb");
    assert!(told.lines().filter(|line| line.contains("two.glb, level ")).count() == 2, "{told}");
    assert!(told.contains("% of an image's height") && told.contains("however small"), "{told}");
    assert!(told.contains("up is "), "{told}");
    let streamed = folder.chpm("extract in.chpm --lods 6k,30% --format glb -q -o -").success();
    assert_eq!(streamed.get_output().stdout, folder.read("two.glb"));
    // One is no more than a mesh.
    folder.stdout("extract in.chpm --lods 900 -o only.glb -q");
    folder.stdout("extract in.chpm --triangles 900 -o alone.glb -q");
    assert_eq!(folder.read("only.glb"), folder.read("alone.glb"));
}

#[test]
fn formats_without_levels_have_a_file_for_each() {
    let folder = built();
    for (name, more, first) in [
        ("x.ply", "", "x.lod0.ply"),
        ("text.stl", "--ascii", "text.lod0.stl"),
        ("x.obj", "", "x.lod0.obj"),
        ("plain", "", "plain.lod0.ply"),
        ("x.v2", "--format ply", "x.lod0.v2"),
        ("x.glb", "--lods-apart", "x.lod0.glb"),
        ("x.gltf", "--lods-apart --meshopt", "x.lod0.gltf"),
        ("my.scan.ply", "--local-origin", "my.scan.lod0.ply"),
    ] {
        let told = json(&folder, &format!("extract in.chpm --lods 5000,10%,200 -o {name} -q --json {more}"));
        let more = more.replace("--lods-apart", "");
        for (number, ask) in ["5000", "10%", "200"].into_iter().enumerate() {
            let own = first.replace("lod0", &format!("lod{number}"));
            assert_eq!(told["levels"][number]["output"], own.as_str());
            let alone = own.replace("lod", "alone");
            folder.stdout(&format!("extract in.chpm --triangles {ask} -o {alone} -q {more}"));
            let same = |name: &str| String::from_utf8_lossy(&folder.read(name)).replace("alone", "lod");
            assert_eq!(same(&own), same(&alone), "{own}");
            if name == "x.gltf" {
                assert_eq!(
                    folder.read(&own.replace("gltf", "bin")),
                    folder.read(&alone.replace("gltf", "bin"))
                );
            }
            if more.contains("--local-origin") {
                assert!(told["levels"][number]["origin_file"] == format!("{own}.origin.json"));
            }
        }
        assert!(!folder.names().contains(&name.to_owned()), "{name}");
    }
}

#[test]
fn levels_that_make_no_sense_are_refused_before_anything_is_written() {
    let folder = built();
    folder.write("taken.lod1.ply", "mine");
    let expected = folder.names();
    for (words, told) in [
        ("--lods 300,1500 -o no.glb", "from fine to coarse"),
        ("--lods 300,300 -o no.glb", "from fine to coarse"),
        ("--lods 20,000 -o no.glb", "at least 1"),
        ("--lods 20,500,10,250 -o no.glb", "a comma is between two levels"),
        ("--lods many -o no.glb", "many"),
        ("--lods 500k,400k,300 -o no.glb", "leave one of them out"),
        ("--lods 6k,1 -o no.glb", "ask for at least"),
        ("--lods 6k,300 --error 1 -o no.glb", "cannot be used with"),
        ("--lods 6k,300 --triangles 5 -o no.glb", "cannot be used with"),
        ("--lods 6k,300 --level 0 -o no.glb", "cannot be used with"),
        ("--lods 6k,300 --camera 0,0,9,0,0,0 -o no.glb", "cannot be used with"),
        ("--lods 6k,300 --viewport 64x64 -o no.glb", "cannot be used with"),
        ("--lods 6k,300 --cull -o no.glb", "cannot be used with"),
        ("--lods 6k,300 --tight -o no.glb", "cannot be used with"),
        ("--lods 6k,300 --effort 2 -o no.glb", "cannot be used with"),
        ("--triangles 6k --lods-apart -o no.glb", "cannot be used with"),
        ("--lods 6k,300 -o -", "each level of detail is a file"),
        ("--lods 6k,300 --lods-apart --format glb -o -", "each level of detail is a file"),
        ("--lods 6k,300 -o taken.ply", "taken.lod1.ply"),
        ("--lods 6k,300 --texture-size 512 -o no.glb", "no sheets"),
        ("--lods 6k,300 -o no.png", "PNG"),
    ] {
        let error = folder.stderr(&format!("extract in.chpm {words} -q"), 2);
        assert!(error.contains(told), "{words}: {error}");
        assert_eq!(folder.names(), expected, "{words}");
    }
    // Less than was asked for is told, as of one mesh.
    let words = "extract in.chpm --lods 500k,6k -o less.glb -f";
    let warned = text(&folder.chpm(words).success().get_output().stderr);
    assert!(warned.contains("fewer than 500,000"), "{warned}");
    folder.chpm(&format!("{words} --strict -q")).code(1);
    assert_eq!(json(&folder, &format!("{words} -q --json"))["satisfied"], false);
    folder.stdout("extract in.chpm --lods 6k,300 -o taken.ply -qf");
    assert!(folder.read("taken.lod1.ply").starts_with(b"ply"));
}

#[test]
fn levels_appear_together_or_not_at_all() {
    let folder = built();
    let expected = folder.names();
    // The file size limit stands for a full disk. The coarse level would fit.
    for name in ["x.ply", "x.glb", "x.gltf", "x.gltf --lods-apart"] {
        let output =
            shell(&folder, &format!("ulimit -f 60; chpm extract in.chpm --lods 6k,300 -q -o {name}"));
        assert!(!output.status.success(), "{name}: {output:?}");
        assert_eq!(folder.names(), expected, "{name}");
    }
    folder.stdout("synth isosurface --triangles 200k -o large.ply -q");
    folder.stdout("build large.ply -q --cluster-triangles 512");
    let expected = folder.names();
    for name in ["x.ply", "x.glb"] {
        let words = format!("extract large.chpm --lods 190k,100k,50k -o {name}");
        let (status, told) = folder.signalled(&words, "extract", Signal::SIGINT);
        assert!(!status.success(), "{name}: {told:?}");
        assert_eq!(folder.names(), expected, "{name}: {told:?}");
    }
}

#[test]
fn every_level_has_images_of_its_own() {
    let folder = textured();
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    let ask = "extract a.chpm --texture-size 512 -q";
    for (name, more) in [("x.glb", ""), ("x.gltf", ""), ("packed.glb", "--meshopt")] {
        folder.stdout(&format!("{ask} --lods 1500,200 -o {name} {more}"));
        let gltf = Gltf::open(&folder, name);
        let mut images = 0;
        for (number, triangles) in [1500, 200].into_iter().enumerate() {
            folder.stdout(&format!("{ask} --triangles {triangles} -o one.glb -f {more}"));
            let one = Gltf::open(&folder, "one.glb");
            let (here, alone) = (gltf.mesh(number), one.mesh(0));
            assert_eq!((here.positions, here.triangles), (alone.positions, alone.triangles), "{name}");
            assert_eq!(here.places, alone.places);
            for primitive in gltf.json["meshes"][number]["primitives"].as_array().expect("primitives") {
                assert_eq!(primitive["material"], images, "a material for each image");
                let material = &gltf.json["materials"][images];
                assert_eq!(material["pbrMetallicRoughness"]["baseColorTexture"]["index"], images);
                images += 1;
            }
        }
        assert_eq!(gltf.json["images"].as_array().map(Vec::len), Some(images));
        assert_eq!(gltf.json["textures"].as_array().map(Vec::len), Some(images));
    }
    for name in ["x.0.jpg", "x.1.jpg"] {
        assert!(folder.read(name).starts_with(&[0xff, 0xd8]), "{name}");
    }
    folder.stdout(&format!("{ask} --lods 1500,200 -o x.obj"));
    for name in ["x.lod0.obj", "x.lod0.mtl", "x.lod0.0.jpg", "x.lod1.obj", "x.lod1.mtl", "x.lod1.0.jpg"] {
        assert!(folder.names().contains(&name.to_owned()), "{name}");
    }
    let told = folder.stderr(&format!("{ask} --lods 1500,200 -o no.glb --memory 32M"), 2);
    assert!(told.contains("--memory"), "{told}");
}
