//! How near two models are, and what is refused.

use super::harness::Folder;
use serde_json::Value;

/// A sphere of radius 1, as a file, packed, and as a mesh.
fn site() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 3000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 256");
    folder.stdout("relayout in.chpm -o packed.chpm --pages packed -q");
    folder
}

fn answer(folder: &Folder, words: &str, code: i32) -> Value {
    let output = folder.chpm(words).code(code);
    serde_json::from_slice(&output.get_output().stdout).expect("JSON")
}

#[test]
fn a_distance_is_an_interval_whatever_the_files_are() {
    let folder = site();
    for second in ["in.chpm", "packed.chpm", "in.ply"] {
        let value =
            answer(&folder, &format!("distance in.chpm {second} --pose 0,0,3 --error 0 -q --json"), 0);
        let found = &value["answers"][0];
        let (least, most) = (found["least"].as_f64().unwrap(), found["most"].as_f64().unwrap());
        // Both have a vertex at the pole.
        assert!(least <= 1.0 && most >= 1.0 && most - least < 1e-6, "{second}: {found}");
        assert_eq!(found["levels"], serde_json::json!([0, 0]));
    }
    // The other way about, and with the first one moved away.
    for poses in ["--pose 0,0,-3", "--pose-a 0,0,3", "--pose-a 0,0,1.5 --pose-b 0,0,-1.5,0,0,0,2"] {
        let text = folder.stdout(&format!("distance in.chpm packed.chpm {poses} --error 0.5%"));
        assert!(text.contains("units apart") && text.contains("as narrow as was asked for"), "{text}");
    }
    let note = folder.stderr("distance in.chpm in.ply --pose 0,0,3", 0);
    assert!(note.contains("'in.ply' is built into a temporary .chpm first"), "{note}");
    assert_eq!(folder.names(), ["in.chpm", "in.ply", "packed.chpm"]);
}

#[test]
fn a_limit_leaves_what_is_proven() {
    let folder = site();
    let words = "distance in.chpm in.chpm --pose 0.2,0.1,3 --error 0 --max-pages 0 -q";
    let found = &answer(&folder, &format!("{words} --json"), 0)["answers"][0];
    assert_eq!(found["ended"], "stopped");
    assert!(found["least"].as_f64().unwrap() <= 1.0 + 0.05 && found["most"].is_null(), "{found}");
    assert!(folder.stdout(words).contains("undecided"), "it says so");
}

/// What is refused names what was given, and what it says suffices does.
#[test]
fn too_little_memory_is_told_with_enough() {
    let folder = site();
    let words = "distance in.chpm packed.chpm --pose 0,0,3 -q --memory";
    let told = folder.stderr(&format!("{words} 20M"), 2);
    let enough = told.split_once("give it ").and_then(|(_, rest)| rest.split_whitespace().next());
    let enough = enough.expect("what suffices");
    assert!(told.contains("--memory 20M is less"), "{told}");
    folder.stdout(&format!("{words} {enough}"));
}

#[test]
fn clearance_is_a_proof_or_a_fault() {
    let folder = site();
    let clear = folder.stdout("clearance in.chpm packed.chpm --above 0.9 --pose 0,0,3");
    assert!(clear.starts_with("clear:"), "{clear}");
    let words = "clearance in.chpm packed.chpm --above 1.1 --pose 0,0,3";
    let output = folder.chpm(words).code(1);
    let text = super::harness::text(&output.get_output().stdout);
    assert!(text.starts_with("not clear:") && text.contains("within"), "{text}");
    let value = answer(&folder, "clearance in.chpm in.chpm --above 0.5 --pose 1.8,1.8,0 --time 0 --json", 1);
    assert!(value["answers"][0]["clear"].is_null(), "{value}");
}

#[test]
fn a_path_has_an_answer_for_each_pose() {
    let folder = site();
    folder.write("a.poses", "# along z\n0,0,3\n\n0 0 2.5\n0,0,0,0,0,0,1\n");
    let text = folder.stdout("distance in.chpm in.chpm --path a.poses --error 0.01 --csv - -q");
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines.len() == 4 && lines[0].starts_with("step,least,most,ended,ax"), "{text}");
    for (line, truth) in lines[1..].iter().zip([1.0, 0.5, 0.0]) {
        let numbers: Vec<f64> = line.split(',').skip(1).take(2).map(|n| n.parse().unwrap()).collect();
        assert!(numbers[0] <= truth && truth <= numbers[1] && numbers[1] - numbers[0] <= 0.01, "{line}");
    }
    let table = folder.stdout("distance in.chpm in.chpm --poses a.poses");
    assert!(table.contains("step") && table.lines().count() >= 4, "{table}");
    // As other systems write it.
    folder.write("b.poses", "\u{feff}0,0,3\r\n0 0 2.5\r\n");
    let marked = folder.stdout("distance in.chpm in.chpm --path b.poses --error 0.01 --csv - -q");
    assert_eq!(marked.lines().collect::<Vec<_>>(), &lines[..3]);
    folder.write("bad.poses", "3,0,0\n1,2\n");
    assert!(folder.stderr("distance in.chpm in.chpm --path bad.poses", 2).contains("'bad.poses', line 2"));
}

#[test]
fn what_is_not_rigid_or_not_proven_is_refused() {
    let folder = site();
    let scaled = folder.stderr("distance in.chpm in.chpm --pose 2,0,0,0,0,2,0,0,0,0,2,0", 2);
    assert!(scaled.contains("changes lengths"), "{scaled}");
    assert!(folder.stderr("distance in.chpm missing.chpm", 2).contains("missing.chpm"));
    assert!(folder.stderr("distance in.chpm in.chpm --memory 1M", 2).contains("--memory"));
    assert!(folder.stderr("distance in.chpm in.chpm --error=-1", 2).contains("--error"));
}

#[test]
fn contacts_are_told_by_region() {
    let folder = site();
    let value = answer(&folder, "contacts in.chpm packed.chpm --pose 0,0,2.1 --within 0.1001 --json -q", 0);
    assert_eq!(value["regions"].as_array().map(Vec::len), Some(1), "{value}");
    let least = value["regions"][0]["least"].as_f64().unwrap();
    assert!((0.0999..=0.1).contains(&least) && value["complete"] == true, "{value}");
    // With a tolerance, from coarser meshes.
    let value =
        answer(&folder, "contacts in.chpm packed.chpm --pose 0,0,2.1 --within 0.2 --error 0.5 --json -q", 0);
    assert!(value["regions"][0]["levels"][0].as_u64().unwrap() > 0, "{value}");
    let none = folder.stdout("contacts in.chpm packed.chpm --pose 0,0,2.1 --within 0.09");
    assert!(none.contains("0 regions within 0.0900 units"), "{none}");
    // Through each other, a ring of crossing triangles.
    let csv = folder.stdout("contacts in.chpm packed.chpm --pose 1,0.01,0.02 --csv - -q");
    assert_eq!(csv.lines().count(), 2, "{csv}");
    let depth: f64 = csv.lines().nth(1).unwrap().split(',').nth(13).unwrap().parse().unwrap();
    assert!(depth > 0.0, "{csv}");
}

#[test]
fn contacts_are_told_along_a_path() {
    let folder = site();
    folder.write("a.poses", "0,0,2.1\n0,0,2.3\n0 0 1.9\n");
    let words = "contacts in.chpm packed.chpm --within 0.1001 -q";
    let value = answer(&folder, &format!("{words} --path a.poses --json"), 0);
    assert_eq!(value["schema"], "chpm-contacts-path/1");
    let csv = folder.stdout(&format!("{words} --path a.poses --csv -"));
    let mut rows = csv.lines().skip(1);
    // Each step is what the pose alone gives, in pages that were read before or not.
    for (step, pose) in ["0,0,2.1", "0,0,2.3", "0,0,1.9"].into_iter().enumerate() {
        let alone = answer(&folder, &format!("{words} --pose {pose} --json"), 0);
        let told = &value["steps"][step];
        assert_eq!((&told["regions"], &told["pairs"]), (&alone["regions"], &alone["pairs"]), "{pose}");
        assert_eq!(told["regions"].as_array().map(Vec::len), Some(usize::from(step != 1)), "{pose}");
        let alone = folder.stdout(&format!("{words} --pose {pose} --csv -"));
        for row in alone.lines().skip(1) {
            assert_eq!(rows.next(), Some(format!("{step},{row}").as_str()));
        }
    }
    assert_eq!(
        (rows.next(), csv.lines().next().map(|line| line.starts_with("step,region,"))),
        (None, Some(true))
    );
    let reread = value["steps"][2]["pages"].as_array().unwrap().iter().filter_map(Value::as_u64).sum::<u64>();
    let alone = answer(&folder, &format!("{words} --pose 0,0,1.9 --json"), 0);
    assert!(alone["pages"].as_array().unwrap().iter().filter_map(Value::as_u64).sum::<u64>() > reread);
    let table = folder.stdout(&format!("{words} --path a.poses"));
    assert_eq!(table.lines().count(), 4, "{table}");
    assert!(folder.stderr("contacts in.chpm --self --path a.poses", 2).contains("--path"));
    // A path of one pose is a path.
    folder.write("one.poses", "0,0,2.1\n");
    assert_eq!(answer(&folder, &format!("{words} --path one.poses --json"), 0)["steps"][0]["complete"], true);
    // What would not fit is refused by name.
    folder.write("many.poses", "0.3,0.1,0\n".repeat(3));
    let stopped = answer(&folder, &format!("{words} --path many.poses --max-pages 0 --json"), 0);
    assert_eq!(stopped["steps"][2]["complete"], false, "{stopped}");
}

#[test]
fn a_model_that_meets_itself_is_told() {
    let folder = site();
    assert!(folder.stdout("contacts in.chpm --self").contains(": 0 pairs of triangles that meet"));
    folder
        .write("cross.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv .2 .2 -1\nv .2 .2 1\nv 3 3 1\nf 1 2 3\nf 4 5 6\n");
    let text = folder.stdout("contacts cross.obj --self --csv - -q");
    assert_eq!(text.lines().count(), 2, "{text}");
    assert!(folder.stderr("contacts in.chpm", 2).contains("SECOND"));
    assert!(folder.stderr("contacts in.chpm --self --within 1", 2).contains("--within"));
}

#[test]
fn a_header_that_claims_any_number_of_vertices_is_not_believed() {
    let folder = site();
    let words = "compare in.chpm packed.chpm --json -q";
    let expected = folder.stdout(words);
    let mut bytes = folder.read("in.chpm");
    bytes[48..56].fill(0xff);
    let sum = xxhash_rust::xxh3::xxh3_64(&bytes[..248]);
    bytes[248..256].copy_from_slice(&sum.to_le_bytes());
    folder.write("in.chpm", &bytes);
    assert_eq!(folder.stdout(words), expected);
}

#[test]
fn poses_that_are_too_long_to_be_poses_are_refused() {
    let folder = site();
    let file = std::fs::File::create(folder.path("long.poses")).expect("a file");
    file.set_len((64 << 20) + 1).expect("a hole");
    let error = folder.stderr("distance in.chpm in.chpm --path long.poses", 2);
    assert!(error.contains("long.poses") && error.contains("longer than 64.0 MiB"), "{error}");
}

/// A vertex that is a saddle: no single triangle about it tells the side of a point that it is nearest to.
#[test]
fn what_is_outside_is_told_so_where_a_vertex_is_nearest() {
    let folder = Folder::new();
    let around = "3 0 2 1\n3 0 3 2\n3 0 4 3\n3 0 1 4\n3 5 1 2\n3 5 2 3\n3 5 3 4\n3 5 4 1\n";
    folder.write("r.off", format!("OFF\n6 8 0\n0 0 0\n6 7 5\n1 4 -3\n2 5 4\n-1 7 7\n4 6 -2\n{around}"));
    folder.write("s.off", "OFF\n3 1 0\n7 -14 4\n14 -28 8\n28 -56 16\n3 0 1 2\n");
    let told = answer(&folder, "compare s.off r.off -q --json", 0);
    assert_eq!(told["signed"], true);
    let [least, most] = ["min", "max"].map(|key| told[key].as_f64().expect("a distance"));
    assert!((least - 16.155).abs() < 0.01 && (most - 64.62).abs() < 0.02, "{least} {most}");
    folder.stdout("synth sphere --triangles 500 -o ball.ply -q");
    let same = folder.stdout("compare ball.ply ball.ply -q");
    assert!(!same.contains("-0"), "{same}");
}

#[test]
fn a_scan_is_compared_with_a_reference() {
    let folder = site();
    // Moved along z by a tenth: the sphere's ends are a tenth outside and inside.
    let words =
        "compare in.chpm packed.chpm --pose-a 0,0,0.1 --tolerance 0.001 -o out.ply --svg out.svg -q --json";
    let value = answer(&folder, words, 0);
    assert_eq!(value["signed"], true, "{value}");
    let number = |key: &str| value[key].as_f64().unwrap();
    assert!((number("max") - 0.1).abs() < 0.005 && (number("min") + 0.1).abs() < 0.005, "{value}");
    assert!(number("mean").abs() < 0.01);
    let (scan, source) = (folder.read_mesh("out.ply"), folder.read_mesh("in.ply"));
    assert_eq!(super::harness::triangles(&scan), super::harness::triangles(&source));
    assert_eq!(value["vertices"].as_u64(), Some(scan.positions.len() as u64));
    let extreme = |least: bool| {
        let ends = scan.positions.iter().zip(&scan.colors);
        let end =
            ends.max_by(|a, b| if least { b.0[2].total_cmp(&a.0[2]) } else { a.0[2].total_cmp(&b.0[2]) });
        *end.unwrap().1
    };
    let ([r, _, b, _], [s, _, c, _]) = (extreme(false), extreme(true));
    assert!(r > b && s < c, "outside is red, inside blue");
    // Bars in the colours of their distances, from blue to red.
    let svg = super::harness::text(&folder.read("out.svg"));
    let fills: std::collections::BTreeSet<&str> =
        svg.split("fill=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert!(fills.len() > 20, "{fills:?}");
    // The same whatever the threads and the memory; against itself, nothing.
    let colored = folder.read("out.ply");
    folder.stdout(&words.replace("-q --json", "-qf --threads 1 --memory 100M"));
    assert!(folder.read("out.ply") == colored);
    let own = answer(&folder, "compare in.ply in.chpm --tolerance 0 --unsigned -q --json", 0);
    assert!(own["signed"] == false && own["max"].as_f64().unwrap() < 1e-6, "{own}");
    assert!(folder.stderr("compare in.chpm in.chpm -o out.stl", 2).contains("PLY, GLB, glTF and CHPM"));
}

#[test]
fn a_tolerance_has_a_share_a_verdict_and_a_page() {
    let folder = site();
    // Moved by a tenth along z: by area, half of a sphere is within a twentieth.
    let words = "compare in.chpm packed.chpm --pose-a 0,0,0.1 -q";
    let value = answer(&folder, &format!("{words} --tolerance 0.05 --json"), 0);
    let pass = &value["pass"];
    let number = |key: &str| pass[key].as_u64().unwrap();
    assert!(pass["share"].as_f64().is_some_and(|share| (share - 0.5).abs() < 0.05), "{pass}");
    assert_eq!(
        number("within") + number("beyond") + number("undecided"),
        value["vertices"].as_u64().unwrap()
    );
    assert!(number("undecided") < 3, "what is near the tolerance is measured exactly: {pass}");
    // What has no bin is told, and makes no bar higher.
    let bins: Vec<u64> = value["histogram"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
    let outside = value["below"].as_u64().unwrap() + value["above"].as_u64().unwrap();
    assert!(outside > 0 && bins.iter().sum::<u64>() + outside == value["vertices"].as_u64().unwrap());
    assert!(answer(&folder, &format!("{words} --json"), 0)["pass"].is_null());

    let verdict = |more: &str, code: i32| {
        super::harness::text(&folder.chpm(&format!("{words} {more}")).code(code).get_output().stdout)
    };
    assert!(verdict("--tolerance 0.05", 0).contains("fails: "));
    assert!(verdict("--tolerance 0.05 --strict", 1).contains("100 % are needed"));
    assert!(verdict("--tolerance 0.05 --strict=30%", 0).contains("passes: "));
    assert!(
        verdict("--tolerance 50um --unit mm --strict=30%", 0).contains("within 50 um"),
        "microns of a millimetre"
    );
    assert!(verdict("--tolerance 0.2 --strict", 0).contains("passes: 100 %"));
    for (more, told) in [
        ("--strict", "--tolerance"),
        ("--tolerance 0.2mm", "--unit"),
        ("--tolerance 1 --strict=120%", "percent"),
    ] {
        assert!(folder.stderr(&format!("{words} {more}"), 2).contains(told), "{more}");
    }

    folder.stdout(&format!("{words} --tolerance 0.05 --html page.html"));
    let html = super::harness::text(&folder.read("page.html"));
    for word in ["fails: ", "linear-gradient", "<main>", "role=\"img\"", "data:image/png;base64,", "99.9 %"] {
        assert!(html.contains(word), "{word}");
    }
    assert!(
        !html.contains("src=\"http") && html.matches("<th").count() == html.matches("<th scope=").count()
    );
    assert!(folder.stderr(&format!("{words} --html page.png"), 2).contains("HTML"));
}

/// Triangles that all have a part of the z axis in common and no vertex.
fn star(count: u32) -> String {
    let corner = |x: f64, y: f64, z: f64| format!("v {x} {y} {z}\n");
    let mut text = String::new();
    for i in 0..count {
        let (sin, cos) = (0.01 * f64::from(i)).sin_cos();
        text += &[
            corner(cos, sin, -1.0),
            corner(-cos, -sin, -1.0),
            corner(0.0, 0.0, 1.0 + 1e-3 * f64::from(i)),
            format!("f {} {} {}\n", 3 * i + 1, 3 * i + 2, 3 * i + 3),
        ]
        .concat();
    }
    text
}

#[test]
fn answers_are_the_same_for_any_number_of_threads() {
    let folder = site();
    // More poses than are asked for in one go.
    let pose = |i: u32| format!("0.{i:02},0.1,3,0,0,0.{i:02},1\n");
    folder.write("a.poses", (10..99).map(pose).collect::<String>());
    // More triangles that meet than are kept.
    folder.write("star.obj", star(200));
    for (words, code, told) in [
        ("distance in.chpm packed.chpm --path a.poses --error 0.001", 0, ""),
        ("clearance in.chpm packed.chpm --path a.poses --above 1.1", 1, ""),
        ("contacts in.chpm packed.chpm --pose 0.5,0.1,0 --within 0.05 --error 0.01", 0, ""),
        ("contacts star.obj star.obj --within 0.5", 0, "\"pairs\": 40000,"),
        ("contacts star.obj --self", 0, "\"pairs\": 19900,"),
    ] {
        let run = |threads: &str| {
            let output = folder.chpm(&format!("{words} --json -q --threads {threads}")).code(code);
            super::harness::text(&output.get_output().stdout)
        };
        let one = run("1");
        assert!(one.contains("schema") && one.contains(told), "{words}: {one}");
        assert!(["2", "5"].iter().all(|threads| run(threads) == one), "{words}");
    }
    let csv = |threads| folder.stdout(&format!("contacts star.obj --self --csv - -q --threads {threads}"));
    assert!(csv(1) == csv(3) && csv(1).lines().count() == 19_901);
}

#[test]
fn clearances_are_written_line_by_line() {
    let folder = site();
    folder.write("a.poses", "0,0,3\n0,0,2.5\n");
    folder.chpm("clearance in.chpm in.chpm --above 0.7 --path a.poses --csv out.csv -q").code(1);
    let text = super::harness::text(&folder.read("out.csv"));
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines.len() == 3 && lines[0].starts_with("step,least,most,ended"), "{text}");
    let least = |line: &str| line.split(',').nth(1).unwrap().parse::<f64>().unwrap();
    assert!(least(lines[1]) > 0.7 && least(lines[2]) <= 0.5, "{text}");
    assert!(folder.stderr("clearance in.chpm in.chpm --above 1 --csv out.csv", 2).contains("out.csv"));
}

#[test]
fn a_comparison_is_the_same_in_every_format() {
    let folder = site();
    // Far away, where positions need doubles.
    let far = "v 7000000.25 0 0\nv 7000001.25 0 0\nv 7000000.25 1 0\nv 7000000.25 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
    folder.write("far.obj", far);
    folder.stdout("build far.obj -q");
    for (scan, pose) in [("in.chpm", "--pose-a 0,0,0.1"), ("far.chpm", "--pose-a -7000000,0,0")] {
        let compare = |name: &str| {
            let words = format!("compare {scan} in.chpm {pose} --tolerance 0.001 -qf -o {name}");
            folder.stdout(&words);
        };
        ["out.ply", "out.glb", "out.chpm"].into_iter().for_each(compare);
        let ply = folder.read_mesh("out.ply");
        // Built again, it has the same triangles in the same colours.
        folder.stdout("extract out.chpm --error 0 -o back.ply -qf");
        let back = folder.read_mesh("back.ply");
        assert_eq!(super::harness::triangles(&back), super::harness::triangles(&ply), "{scan}");
        let painted = |mesh: &chpm_mesh::TriMesh| {
            let all = mesh.positions.iter().map(|p| p.map(f32::to_bits)).zip(mesh.colors.iter().copied());
            all.collect::<std::collections::BTreeSet<_>>()
        };
        assert!(painted(&back) == painted(&ply) && painted(&ply).len() == ply.positions.len(), "{scan}");
        let glb = super::glb::Glb::read(&folder.read("out.glb"));
        assert_eq!(glb.mesh.triangles, ply.triangles, "{scan}");
        assert_eq!(glb.colors.len(), ply.positions.len());
        assert_eq!(glb.extras()["range"].as_array().map(Vec::len), Some(2));
    }
    let names = folder.names();
    assert!(names.iter().all(|name| !name.starts_with(".chpm-")), "{names:?}");
    assert!(folder.stderr("compare in.chpm in.chpm -o out.chpm", 2).contains("out.chpm"));
    assert!(folder.stderr("compare in.chpm packed.chpm -f -o in.chpm", 2).contains("the input itself"));
}

/// Vertices above a square, so far away that no single tells them apart, and a square so far from zero that a single has steps of half a unit there.
#[test]
fn comparing_keeps_to_what_it_tells_far_from_zero() {
    let folder = Folder::new();
    let ply = |points: &[[f64; 3]]| {
        let mut text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                        element face 2\nproperty list uchar int vertex_indices\nend_header\n"
            .to_owned();
        points.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
        text + "3 0 1 2\n3 0 2 3\n"
    };
    let (ground, corners) = (4.5e6 + 0.1, [[-9.3, -9.1], [9.7, -9.9], [9.1, 9.3], [-9.7, 9.1]]);
    let reference: Vec<[f64; 3]> = corners.iter().map(|[x, y]| [7e6 + x, y - 3e6, ground]).collect();
    let heights: Vec<f64> = (0..4).map(|i| 4.6e6 + 0.123_457 * f64::from(i)).collect();
    let scan = |(c, z): (&[f64; 2], &f64)| [7e6 + c[0] / 3.0, c[1] / 3.0 - 3e6, *z];
    folder.write("reference.ply", ply(&reference));
    folder.write("scan.ply", ply(&corners.iter().zip(&heights).map(scan).collect::<Vec<_>>()));
    // Differences of doubles that are so near are exact.
    let truth: Vec<f64> = heights.iter().map(|z| z - ground).collect();
    let mean = truth.iter().sum::<f64>() / 4.0;
    for tolerance in ["0", "0.0005", "1%"] {
        let words = format!("compare scan.ply reference.ply --tolerance {tolerance} -q");
        let value = answer(&folder, &format!("{words} --json"), 0);
        let told = |key: &str| value[key].as_f64().unwrap();
        let within = told("tolerance");
        assert!(told("rounding") <= within && within < 0.5, "{value}");
        let near = |told: f64, truth: f64| assert!((told - truth).abs() <= within, "{told} {truth} {value}");
        near(told("min"), truth[0]);
        near(told("max"), truth[3]);
        near(told("mean"), mean);
        near(value["percentiles"]["p50"].as_f64().unwrap(), truth[1]);

        // The digits of the table are as many as what is told with them.
        let text = folder.stdout(&words);
        let (_, rest) = text.split_once("each within ").unwrap();
        let within: f64 = rest.split(' ').next().unwrap().parse().unwrap();
        let row = text.lines().find(|line| line.contains("units") && line.contains("100000.")).unwrap();
        let numbers: Vec<f64> = row.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        assert!((numbers[0] - truth[0]).abs() <= within && (numbers[1] - truth[3]).abs() <= within, "{text}");
    }
}

#[test]
fn an_exact_distance_tells_what_the_leaves_round() {
    let folder = Folder::new();
    let triangle = |z: f64| {
        format!(
            "v 4500000.1 -3000000.7 {z}\nv 4500900.3 -3000000.1 {z}\nv 4500000.7 -3000900.9 {z}\nf 1 2 3\n"
        )
    };
    folder.write("a.obj", triangle(1e6 + 0.3));
    folder.write("b.obj", triangle(1e6 + 7.4));
    let found = &answer(&folder, "distance a.obj b.obj --error 0 -q --json", 0)["answers"][0];
    let [least, most, rounding] = ["least", "most", "rounding"].map(|key| found[key].as_f64().unwrap());
    let truth = (1e6 + 7.4) - (1e6 + 0.3);
    assert!(least <= truth && truth <= most && found["ended"] == "exact", "{found}");
    assert!(most - least <= 2.0 * rounding * (1.0 + 1e-9) && rounding > 1e-6, "{found}");
}
