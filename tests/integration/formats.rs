//! `chpm extract` in every format that it writes, and `chpm simplify`, which is build and extract in one.

use super::glb::Glb;
use super::harness::{Folder, much, text, triangles};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::TriMesh;
use chpm_refine::Cut;
use chpm_synth::{Shape, Synth};
use nix::sys::signal::Signal;
use serde_json::Value;

/// A closed surface with normals and colours, and its file.
fn colored() -> (Folder, TriMesh) {
    let folder = Folder::new();
    let mut mesh = Synth::new(Shape::Sphere, 8000, 1).to_mesh();
    mesh.normals = mesh.positions.iter().map(|p| p.map(|x| 3.0 * x)).collect();
    mesh.colors = (0..mesh.positions.len()).map(|i| [(i % 256) as u8, (i / 256) as u8, 7, 255]).collect();
    folder.write_mesh("in.ply", &mesh);
    folder.stdout("build in.ply -q --cluster-triangles 256");
    (folder, mesh)
}

/// The mesh of a file of any format that is read.
fn read(folder: &Folder, name: &str) -> TriMesh {
    folder.stdout(&format!("build {name} -o back.chpm -qf"));
    folder.stdout("extract back.chpm --level 0 -o back.ply -qf");
    folder.read_mesh("back.ply")
}

#[test]
fn an_order_for_caches_changes_order_only() {
    let (folder, _) = colored();
    let spans = |mesh: &TriMesh| {
        let bits = mesh.triangles.iter().map(|[a, b, _]| f64::from(a.abs_diff(*b)).log2());
        bits.sum::<f64>() / mesh.triangles.len() as f64
    };
    for wanted in ["--level 0", "--triangles 900"] {
        folder.stdout(&format!("extract in.chpm {wanted} -o out.ply -qf"));
        let expected = folder.read_mesh("out.ply");
        folder.stdout(&format!("extract in.chpm {wanted} -o new.ply --order cache-oblivious -qf"));
        let ordered = folder.read_mesh("new.ply");
        assert_eq!(triangles(&ordered), triangles(&expected));
        assert!(spans(&ordered) < spans(&expected), "{} {}", spans(&ordered), spans(&expected));
        // What a vertex carries goes with it.
        let all = |mesh: &TriMesh| {
            let bits = |x: [f32; 3]| x.map(f32::to_bits);
            let data = mesh.positions.iter().zip(&mesh.normals).zip(&mesh.colors);
            let mut all: Vec<_> = data.map(|((p, n), c)| (bits(*p), bits(*n), *c)).collect();
            all.sort_unstable();
            all
        };
        assert_eq!(all(&ordered), all(&expected));
        for (name, more) in [("new.stl", ""), ("new.obj", "")] {
            folder.stdout(&format!("extract in.chpm {wanted} -o {name} {more} --order cache-oblivious -qf"));
            assert_eq!(triangles(&read(&folder, name)), triangles(&expected), "{name}");
        }
        for (name, more) in [("new.glb", ""), ("packed.glb", "--meshopt")] {
            folder.stdout(&format!("extract in.chpm {wanted} -o {name} {more} --order cache-oblivious -qf"));
            assert_eq!(triangles(&Glb::read(&folder.read(name)).mesh), triangles(&expected), "{name}");
        }
    }
    folder.stdout("simplify in.ply --triangles 900 -o simple.ply --order cache-oblivious -q");
    assert!(folder.read_mesh("simple.ply").triangles.len() > 800);
}

#[test]
fn every_format_holds_the_same_triangles() {
    let (folder, _) = colored();
    for wanted in ["--level 0", "--triangles 900", "--error 2%"] {
        folder.stdout(&format!("extract in.chpm {wanted} -o out.ply -qf"));
        let expected = folder.read_mesh("out.ply");
        for (name, more) in [("out.stl", ""), ("text.stl", "--ascii"), ("out.obj", "")] {
            folder.stdout(&format!("extract in.chpm {wanted} -o {name} {more} -qf"));
            assert_eq!(triangles(&read(&folder, name)), triangles(&expected), "{wanted} {name}");
        }
        for (name, more) in [("out.glb", ""), ("packed.GLB", "--meshopt")] {
            folder.stdout(&format!("extract in.chpm {wanted} -o {name} {more} -qf"));
            let glb = Glb::read(&folder.read(name));
            assert_eq!(triangles(&glb.mesh), triangles(&expected), "{wanted} {name}");
            assert_eq!(
                (glb.mesh.normals.len(), glb.colors.len()),
                (glb.mesh.positions.len(), glb.mesh.positions.len())
            );
            if name == "out.glb" {
                assert_eq!(glb.mesh.positions, expected.positions);
                let unit = |n: &[f32; 3]| n.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
                for (got, given) in glb.mesh.normals.iter().zip(&expected.normals) {
                    let cosine: f64 = got.iter().zip(given).map(|(a, b)| f64::from(a * b)).sum();
                    assert!((unit(got) - 1.0).abs() < 1e-6 && cosine > 0.999_99 * unit(given));
                }
                // Colours come back to the bit, by the curve of sRGB.
                let back = |linear: u16| {
                    let light = f64::from(linear) / 65535.0;
                    let value = if light <= 0.003_130_8 {
                        12.92 * light
                    } else {
                        1.055 * light.powf(1.0 / 2.4) - 0.055
                    };
                    (255.0 * value).round() as u8
                };
                let colors =
                    glb.colors.iter().map(|[r, g, b, a]| [back(*r), back(*g), back(*b), (a / 257) as u8]);
                assert!(colors.eq(expected.colors.iter().copied()));
            }
            let extras = glb.extras();
            assert_eq!(extras["certified"], true);
            assert!(extras["error"].as_f64() <= extras["distance"].as_f64(), "{extras}");
            assert_eq!(extras["error"].as_f64() == Some(0.0), wanted == "--level 0");
        }
    }
    folder.stdout("extract in.chpm --triangles 900 -o colors.obj -q");
    folder.stdout("extract in.chpm --triangles 900 -o colors.ply -q");
    assert_eq!(read(&folder, "colors.obj").colors.len(), folder.read_mesh("colors.ply").colors.len());
}

#[test]
fn every_mesh_file_that_is_written_is_read_back() {
    let (folder, _) = colored();
    let sorted = |mesh: &TriMesh| {
        let vertices = mesh.positions.iter().zip(&mesh.colors);
        let mut all: Vec<_> = vertices.map(|(p, color)| (p.map(f32::to_bits), *color)).collect();
        all.sort_unstable();
        all
    };
    for wanted in ["--level 0", "--triangles 900"] {
        folder.stdout(&format!("extract in.chpm {wanted} -o out.ply -qf"));
        let expected = folder.read_mesh("out.ply");
        for (name, more) in [
            ("a.ply", ""),
            ("text.ply", "--ascii"),
            ("a.stl", ""),
            ("text.stl", "--ascii"),
            ("a.obj", ""),
            ("a.glb", "--up y"),
            ("packed.glb", "--meshopt --up y"),
        ] {
            folder.stdout(&format!("extract in.chpm {wanted} -o {name} {more} -qf"));
            let mesh = read(&folder, name);
            assert_eq!(triangles(&mesh), triangles(&expected), "{wanted} {name}");
            if !name.ends_with("stl") {
                assert_eq!(sorted(&mesh), sorted(&expected), "{wanted} {name}");
                assert_eq!(mesh.normals.len(), mesh.positions.len(), "{name}");
            }
        }
    }
}

#[test]
fn coordinates_far_from_zero_come_back_by_every_format() {
    let folder = Folder::new();
    folder.write(
        "far.obj",
        "v 500000.25 5800000.125 0\nv 500001.5 5800000 0\nv 500000 5800001.75 1\nf 1 2 3\n",
    );
    folder.stdout("build far.obj -q");
    for (name, more) in [
        ("a.ply", ""),
        ("a.stl", "--ascii"),
        ("a.obj", ""),
        ("a.glb", "--up y"),
        ("b.glb", "--meshopt --up y"),
    ] {
        folder.stdout(&format!("extract far.chpm --level 0 -q {more} -f -o {name}"));
        folder.stdout(&format!("build {name} -o back.chpm -qf"));
        folder.stdout("extract back.chpm --level 0 -qf --ascii -o back.stl");
        let text = text(&folder.read("back.stl"));
        for corner in ["500000.25 5800000.125 0.0", "500001.5 5800000.0 0.0", "500000.0 5800001.75 1.0"] {
            assert!(text.contains(corner), "{name}: {text}");
        }
    }
}

#[test]
fn names_and_options_choose_the_format() {
    let (folder, _) = colored();
    let begins = |words: &str, name: &str, magic: &[u8]| {
        folder.stdout(&format!("extract in.chpm --triangles 500 -qf -o {name} {words}"));
        assert!(folder.read(name).starts_with(magic), "{words} {name}");
    };
    begins("", "plain", b"ply\n");
    begins("--format ply", "a.v2", b"ply\n");
    begins("--format glb", "plain", b"glTF");
    begins("--format obj", "plain", b"# chpm extract, error ");
    begins("--ascii", "a.stl", b"solid chpm extract, error ");
    begins("", "a.STL", b"chpm extract, error ");
    for format in ["ply", "stl", "obj", "glb"] {
        let words = format!("extract in.chpm --triangles 500 --format {format} -q");
        folder.stdout(&format!("{words} -f -o file"));
        let streamed = folder.chpm(&format!("{words} -o -")).success().get_output().stdout.clone();
        assert_eq!(streamed, folder.read("file"), "{format}");
    }
    for (words, told) in [
        ("-o a.png", "PLY, STL, OBJ, GLB and glTF"),
        ("-o a.glb --format gltf", "GLB"),
        ("-o a.v2", "--format"),
        ("-o a.fbx --format ply", "FBX"),
        ("-o a.stl --format ply", "STL"),
        ("-o new.ply --meshopt", "--meshopt is for GLB"),
        ("-o new.glb --ascii", "GLB is binary"),
        ("-o new --format fbx", "glb"),
    ] {
        let error = folder.stderr(&format!("extract in.chpm --level 0 {words} -q"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    assert!(!folder.names().iter().any(|name| name.starts_with("new")));
}

#[test]
fn far_from_the_zero_point_nothing_moves_unless_it_is_told() {
    let folder = Folder::new();
    let at =
        |x: f64, y: f64, z: f64| format!("v {} {} {}\n", 500_000.25 + 0.001 * x, 4_649_776.125 + y, 0.1 + z);
    let corners: String = (0..4).map(|i| at(f64::from(i % 2), f64::from(i / 2), f64::from(i))).collect();
    folder.write("far.obj", format!("{corners}f 1 2 3\nf 2 4 3\nf 1 3 2\nf 2 3 4\n"));
    folder.stdout("build far.obj -q");
    folder.stdout("extract far.chpm --level 0 -q -o far.glb --up y");
    let glb = Glb::read(&folder.read("far.glb"));
    let origin = &glb.json["nodes"][0]["translation"];
    let header = [96, 104, 112]
        .map(|at| f64::from_le_bytes(folder.read("far.chpm")[at..at + 8].try_into().expect("eight bytes")));
    assert_eq!([0, 1, 2].map(|axis| origin[axis].as_f64()), header.map(Some), "{origin}");
    assert!(glb.mesh.positions.as_flattened().iter().all(|x| x.abs() <= 2.0));

    folder.stdout("extract far.chpm --level 0 -qf -o text.stl --ascii");
    folder.stdout("extract far.chpm --level 0 -qf -o out.obj");
    let exact = folder.read("far.chpm");
    for name in ["text.stl", "out.obj"] {
        folder.stdout(&format!("build {name} -o back.chpm -qf"));
        let [a, b] = [&exact, &folder.read("back.chpm")].map(|bytes| bytes[96..144].to_vec());
        assert_eq!(a, b, "{name}: the same origin and box");
    }
    // Single precision would make points of these triangles: they are written about their middle, and nothing is lost.
    let output = folder.chpm("extract far.chpm --level 0 -f -o far.stl").success();
    let warned = text(&output.get_output().stderr);
    assert!(warned.contains("relative to") && warned.contains("--ascii"), "{warned}");
    let origin: Vec<f64> = header.to_vec();
    assert!(warned.contains(&format!("relative to {} {} {};", origin[0], origin[1], origin[2])), "{warned}");
    assert_eq!(read(&folder, "far.stl").triangles.len(), 4);
    assert!(read(&folder, "far.stl").positions.as_flattened().iter().all(|x| x.abs() <= 2.0));
    // Where the zero point is near, rounding is in the figure, and no warning.
    folder.write("near.obj", "v 0.1 0.2 0.3\nv 1.1 0.2 0.3\nv 0.1 1.2 0.3\nf 1 2 3\n");
    folder.stdout("build near.obj -q");
    let output = folder.chpm("extract near.chpm --level 0 -f -o near.stl").success();
    assert!(!text(&output.get_output().stderr).contains("warning"));
}

/// A large square with a speck on it: rounding is nothing beside the model, and everything to the speck.
#[test]
fn facets_that_single_precision_would_make_points_of_are_kept() {
    let folder = Folder::new();
    let at = |x: f64, y: f64, z: f64| {
        format!("v {} {} {}\n", 50_000.123_456_7 + x, 50_000.234_567_8 + y, 100.345_678_9 + z)
    };
    let corners = [
        [0.0, 0.0, 0.0],
        [700.0, 0.0, 1.0],
        [0.0, 700.0, 0.0],
        [5.0, 5.0, 5.0],
        [5.001, 5.0, 5.0],
        [5.0, 5.001, 5.0],
    ];
    let text_of: String = corners.iter().map(|[x, y, z]| at(*x, *y, *z)).collect();
    folder.write("speck.obj", format!("{text_of}f 1 2 3\nf 4 5 6\n"));
    folder.stdout("build speck.obj -q");
    let value: Value =
        serde_json::from_str(&folder.stdout("extract speck.chpm --level 0 -o speck.stl -q --json"))
            .expect("JSON");
    assert!(
        value["origin"].is_array() && value["warnings"][0].as_str().unwrap().contains("relative"),
        "{value}"
    );
    // Without the speck, coordinates stay.
    folder.write("square.obj", format!("{text_of}f 1 2 3\n"));
    folder.stdout("build square.obj -q");
    let value: Value =
        serde_json::from_str(&folder.stdout("extract square.chpm --level 0 -o square.stl -q --json"))
            .expect("JSON");
    assert!(value["origin"].is_null() && value["warnings"] == serde_json::json!([]), "{value}");
}

/// Other programs shade a mesh without normals flat, however smooth its source was.
#[test]
fn a_smaller_mesh_has_the_normals_of_all_of_its_source() {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 20000 -o in.ply -q");
    let bare = {
        let mesh = folder.read_mesh("in.ply");
        TriMesh::new(mesh.positions.clone(), mesh.triangles.clone())
    };
    folder.write_mesh("bare.ply", &bare);
    for (ask, has) in [("", false), ("--normals computed", true), ("--normals none", false)] {
        for name in ["out.ply", "out.glb"] {
            folder.stdout(&format!("simplify bare.ply --triangles 400 -o {name} -qf {ask}"));
            let normals = match name {
                "out.ply" => folder.read_mesh("out.ply").normals.clone(),
                _ => Glb::read(&folder.read("out.glb")).mesh.normals.clone(),
            };
            assert_eq!(!normals.is_empty(), has, "{name} {ask}");
        }
    }
    // Those of the source, which a mesh of 400 triangles would give by some degrees only.
    folder.stdout("simplify bare.ply --triangles 400 -o out.ply -qf --normals computed");
    let (mesh, out) = (folder.read_mesh("in.ply"), folder.read_mesh("out.ply"));
    let middle: [f64; 3] = [0, 1, 2]
        .map(|i| mesh.positions.iter().map(|p| f64::from(p[i])).sum::<f64>() / mesh.positions.len() as f64);
    for (position, normal) in out.positions.iter().zip(&out.normals) {
        let outward = [0, 1, 2].map(|i| f64::from(position[i]) - middle[i]);
        let length = outward.iter().map(|x| x * x).sum::<f64>().sqrt();
        let cosine: f64 = outward.iter().zip(normal).map(|(x, n)| x / length * f64::from(*n)).sum();
        assert!(cosine > 0.999, "{position:?} {normal:?}: {cosine}");
    }
    folder.stderr("simplify bare.ply --triangles 400 -o out.ply -qf --normals source --no-normals", 2);
}

#[test]
fn a_mesh_is_turned_moved_and_stripped_as_asked_for() {
    let (folder, mesh) = colored();
    let header = |name: &str| String::from_utf8_lossy(&folder.read(name)[..400]).into_owned();
    folder.stdout("extract in.chpm --level 0 -o all.ply -q");
    let all = folder.read_mesh("all.ply");
    folder.stdout("extract in.chpm --level 0 -o bare.ply -q --no-normals --no-colors");
    assert!(header("all.ply").contains("red") && header("all.ply").contains("property float nx"));
    assert!(!header("bare.ply").contains("red") && !header("bare.ply").contains("nx"));
    assert_eq!(folder.read_mesh("bare.ply").positions, all.positions);

    // y is up in a GLB: what was z is y there, and what was y is -z.
    let turned = |[x, y, z]: [f32; 3]| [x, z, -y];
    for more in ["", "--meshopt"] {
        folder.stdout(&format!("extract in.chpm --level 0 -o turned.glb -qf --up z {more}"));
        let glb = Glb::read(&folder.read("turned.glb"));
        let expected =
            TriMesh::new(all.positions.iter().map(|p| turned(*p)).collect(), all.triangles.clone());
        assert_eq!(triangles(&glb.mesh), triangles(&expected));
    }
    folder.stdout("extract in.chpm --level 0 -o same.ply -q --up z");
    assert_eq!(folder.read_mesh("same.ply").positions, all.positions);
    folder.stdout("extract in.chpm --level 0 -o turned.ply -q --up y");
    let back: Vec<[f32; 3]> = folder.read_mesh("turned.ply").positions.iter().map(|p| turned(*p)).collect();
    assert_eq!(back, all.positions);

    // Far away, and back again.
    let far: Vec<[f64; 3]> = mesh
        .positions
        .iter()
        .map(|[x, y, z]| [4.5e6 + f64::from(*x), f64::from(*y) - 3e6, 0.1 + f64::from(*z)])
        .collect();
    let lines: String = far.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let faces: String =
        mesh.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1)).collect();
    folder.write("far.obj", lines + &faces);
    folder.stdout("build far.obj -q");
    for name in ["near.ply", "near.stl", "near.glb"] {
        folder.stdout(&format!("extract far.chpm --level 0 -o {name} -q --local-origin"));
        let aside: Value =
            serde_json::from_slice(&folder.read(&format!("{name}.origin.json"))).expect("JSON");
        let origin: Vec<f64> =
            aside["origin"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        let near = match name {
            "near.glb" => {
                let glb = Glb::read(&folder.read(name));
                assert_eq!(glb.json["meshes"][0]["extras"]["origin"], aside["origin"]);
                assert_eq!(glb.json["nodes"][0].get("translation"), None);
                glb.mesh
            }
            _ => read(&folder, name),
        };
        assert_eq!(near.triangles.len(), mesh.triangles.len());
        let reach = far.iter().map(|p| p[0] - origin[0]).fold(0.0, f64::max);
        let most = near.positions.iter().map(|p| f64::from(p[0])).fold(0.0, f64::max);
        assert!((reach - most).abs() < 1e-6 && most < 2.0, "{name}: {reach} {most}");
    }
    assert!(
        folder
            .stderr("extract far.chpm --level 0 -o - --format ply -q --local-origin", 2)
            .contains("name a file")
    );
    let again = folder.stderr("extract far.chpm --level 0 -o near.stl -q --local-origin", 2);
    assert!(again.contains("--force"), "{again}");
}

/// glTF has y upward: what stands otherwise is turned by a node, and no position changes a bit.
#[test]
fn a_glb_stands_upright_wherever_up_is_in_the_source() {
    let folder = Folder::new();
    folder.stdout("synth terrain --triangles 5000 -o in.ply -q");
    folder.stdout("build in.ply -q");
    folder.stdout("extract in.chpm --level 0 -o all.ply -q");
    let all = folder.read_mesh("all.ply");
    for more in ["", "--meshopt"] {
        let told = folder.stdout(&format!("extract in.chpm --level 0 -o out.glb -f {more}"));
        assert!(told.contains("up is z") && told.contains("--up"), "{told}");
        let glb = Glb::read(&folder.read("out.glb"));
        assert_eq!(triangles(&glb.mesh), triangles(&all));
        let matrix = &glb.json["nodes"][0]["matrix"];
        assert_eq!(*matrix, serde_json::json!([1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]));
        // A reader that heeds nodes has the same as where positions themselves are turned.
        folder.stdout(&format!("extract in.chpm --level 0 -o turned.glb -qf --up z {more}"));
        assert_eq!(Glb::read(&folder.read("turned.glb")).json["nodes"][0].get("matrix"), None);
        let [found, turned] = ["out.glb", "turned.glb"].map(|name| {
            let mut mesh = read(&folder, name);
            // Products with 0 make 0 of -0.
            mesh.positions.iter_mut().for_each(|p| *p = p.map(|x| x + 0.0));
            triangles(&mesh)
        });
        assert_eq!(found, turned);
    }
    // A source that is a glTF has y upward, whatever its shape says.
    folder.stdout("build out.glb -q -o again.chpm");
    let told = folder.stdout("extract again.chpm --level 0 -o again.glb");
    assert!(told.contains("up is y"), "{told}");
    assert_eq!(Glb::read(&folder.read("again.glb")).json["nodes"][0].get("matrix"), None);
}

#[test]
fn one_triangle_goes_into_every_format() {
    let folder = Folder::new();
    folder.write("one.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    folder.stdout("build one.obj -q");
    for name in ["a.ply", "a.stl", "a.obj", "a.glb"] {
        folder.stdout(&format!("extract one.chpm --level 0 -q -o {name}"));
    }
    assert_eq!((read(&folder, "a.stl").triangles.len(), read(&folder, "a.obj").triangles.len()), (1, 1));
    folder.stdout("extract one.chpm --level 0 -q -o packed.glb --meshopt");
    for name in ["a.glb", "packed.glb"] {
        let glb = Glb::read(&folder.read(name));
        assert_eq!((glb.mesh.triangles.len(), glb.json["nodes"][0].get("translation")), (1, None));
    }
}

#[test]
fn simplify_keeps_to_what_is_asked_and_leaves_nothing_else() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 20000 -o in.ply -q");
    let told = folder.stdout("simplify in.ply --within 0.02 --effort 0 -o out.ply -q");
    assert!(
        told.contains("out.ply: ") && told.contains("of 19,768 triangles") && told.contains("proven: "),
        "{told}"
    );
    let line = told.lines().find(|line| line.starts_with("proven")).expect("a bound");
    let bound: f64 = line
        .split("than ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .expect("a number")
        .parse()
        .expect("one");
    assert!(0.0 < bound && bound <= 0.02, "{line}");
    // The same as by hand.
    folder.stdout("build in.ply -q");
    folder.stdout("extract in.chpm --error 0.02 -o hand.ply -q");
    assert_eq!(triangles(&folder.read_mesh("out.ply")), triangles(&folder.read_mesh("hand.ply")));
    assert!(folder.read_mesh("out.ply").triangles.len() < 10_000);

    // A millimetre of a model in centimetres.
    folder.stdout("simplify in.ply --within 0.2mm --unit cm --effort 0 -o unit.ply -q");
    assert_eq!(triangles(&folder.read_mesh("unit.ply")), triangles(&folder.read_mesh("out.ply")));
    let told = folder.stdout("simplify in.ply --triangles 10% -o small.glb -q");
    assert!(
        told.contains(" triangles, ") && Glb::read(&folder.read("small.glb")).mesh.triangles.len() <= 1976,
        "{told}"
    );
    let expected = ["hand.ply", "in.chpm", "in.ply", "out.ply", "small.glb", "unit.ply"];
    assert_eq!(folder.names(), expected);

    for (words, told) in [
        ("in.ply --within 1mm -o no.ply", "--unit mm"),
        ("in.ply --within 1parsec -o no.ply", "1mm with --unit"),
        ("in.ply --within 1mm --triangles 5 --unit mm -o no.ply", "cannot be used"),
        ("in.ply -o no.ply", "--within"),
        ("in.ply --triangles 1 -o no.ply", "ask for at least"),
        ("no.ply --within 1 -o none.ply", "no.ply"),
        ("in.ply --within 1 -o in.ply -f", "the input itself"),
        ("in.ply --within 1 -o out.ply", "--force"),
        ("in.ply --within 1 -o no.chpm", "CHPM"),
        ("in.ply --within 1 -o no.ply --memory 1M", "--memory"),
    ] {
        let error = folder.stderr(&format!("simplify {words} -q"), 2);
        assert!(error.contains(told), "{words}: {error}");
        assert_eq!(folder.names(), expected, "{words}");
    }
    // Nothing but what single precision rounds is between 0 and what can be reached.
    folder.write("far.obj", "v 500000.1 0.1 0\nv 500001.1 0.1 0.3\nv 500000.1 1.1 0\nf 1 2 3\n");
    let error = folder.stderr("simplify far.obj --within 1e-12 -o no.ply -q", 2);
    assert!(error.contains("rounds"), "{error}");
}

/// The single that is nearest to what is asked for is above it, and is what a mesh keeps to: another one has to be taken.
#[test]
fn a_bound_is_never_rounded_up() {
    let folder = Folder::new();
    folder.stdout(&format!("synth isosurface --triangles {} -o in.ply -q", much(4000, 20_000)));
    folder.stdout("build in.ply -q");
    let file = Chpm::open(MappedFile::open(&folder.path("in.chpm")).expect("a file")).expect("a CHPM");
    let some = (0.002 * file.header().aabb().diagonal()) as f32;
    let distance = Cut::at_distance(&file, some).expect("a cut").distance(&file).expect("a distance");
    let asked = f64::from(distance) * (1.0 - 2.0_f64.powi(-27));
    assert!(asked as f32 == distance && asked < f64::from(distance));
    for words in [format!("extract in.chpm --error {asked}"), format!("simplify in.ply --within {asked}")] {
        folder.stdout(&format!("{words} -o out.ply -qf"));
        let ply = folder.read("out.ply");
        let text = String::from_utf8_lossy(&ply[..400]).into_owned();
        let said = text.split("distance ").nth(1).or(text.split("error ").nth(1)).expect("a bound");
        let kept: f64 =
            said.split_whitespace().next().and_then(|number| number.parse().ok()).expect("a number");
        assert!(kept <= asked, "{words}: {kept}");
    }
}

#[test]
fn simplify_that_is_stopped_leaves_nothing() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 60000 -o in.ply -q");
    let (status, told) =
        folder.signalled("simplify in.ply --within 0.1 -o out.glb", "simplify", Signal::SIGINT);
    assert!(!status.success(), "{told:?}");
    assert_eq!(folder.names(), ["in.ply"], "{told:?}");
}
