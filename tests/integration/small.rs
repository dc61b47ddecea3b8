//! `--min-component`: dust is left out of what is built of any source, and everyone who looks at the source again knows of it.

use super::harness::{Folder, text};
use chpm_mesh::TriMesh;
use chpm_synth::hand;
use serde_json::Value;

/// Appends a copy of `part`, scaled and moved.
fn add(mesh: &mut TriMesh, part: &TriMesh, scale: f32, to: [f32; 3]) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(part.positions.iter().map(|p| [0, 1, 2].map(|axis| scale * p[axis] + to[axis])));
    mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|v| first + v)));
}

/// Two balls of radius 1 and 0.9, and 60 specks of dust that measure at most 0.3, some of them far away.
fn dusty() -> TriMesh {
    let mut mesh = TriMesh::default();
    add(&mut mesh, &hand::icosphere(4), 1.0, [0.0; 3]);
    for i in 0..60u8 {
        let [i, turn] = [f32::from(i), f32::from(i % 7)];
        add(&mut mesh, &hand::cube(), 0.001 + 0.0028 * i, [2.0 + 0.25 * i, turn, 0.5 * turn]);
        if i == 20.0 {
            add(&mut mesh, &hand::icosphere(3), 0.9, [0.5, 4.0, 0.0]);
        }
    }
    mesh
}

/// The two balls.
const KEPT: usize = 20 * (256 + 64);

fn number(x: f32) -> String {
    format!("{}", f64::from(x))
}

fn obj(mesh: &TriMesh) -> String {
    let vertices = mesh.positions.iter().map(|p| format!("v {}\n", p.map(number).join(" ")));
    vertices
        .chain(mesh.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1)))
        .collect()
}

fn stl_text(mesh: &TriMesh) -> String {
    let vertex = |v: &u32| format!("vertex {}\n", mesh.positions[*v as usize].map(number).join(" "));
    let facet = |t: &[u32; 3]| {
        format!("facet\nouter loop\n{}endloop\nendfacet\n", t.iter().map(vertex).collect::<String>())
    };
    format!("solid\n{}endsolid\n", mesh.triangles.iter().map(facet).collect::<String>())
}

fn stl(mesh: &TriMesh) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in &mesh.triangles {
        bytes.extend([0; 12]);
        let corners = mesh.corners(*triangle);
        bytes.extend(corners.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// Squares in place of every two triangles of a cube, among the triangles.
fn ply_of_polygons(mesh: &TriMesh, shift: f64) -> String {
    let mut text = String::new();
    let mut faces = 0;
    let mut triangles = mesh.triangles.iter().peekable();
    while let Some([a, b, c]) = triangles.next() {
        faces += 1;
        match triangles.peek() {
            Some([d, e, f]) if d == a && e == c => {
                text += &format!("4 {a} {b} {c} {f}\n");
                triangles.next();
            }
            _ => text += &format!("3 {a} {b} {c}\n"),
        }
    }
    let place = |x: f32| format!("{}", f64::from(x) + shift);
    let vertices: String = mesh.positions.iter().map(|p| p.map(place).join(" ") + "\n").collect();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nelement face {faces}\n\
         property list uchar int vertex_indices\nend_header\n{vertices}{text}",
        mesh.positions.len()
    )
}

fn json(folder: &Folder, words: &str) -> Value {
    serde_json::from_str(&folder.stdout(words)).expect("JSON")
}

/// Builds, and asks everyone who looks at the source.
fn check(folder: &Folder, source: &str, size: &str, [components, triangles, left]: [usize; 3]) {
    let built = json(
        folder,
        &format!("build {source} -o out.chpm -qf --json --cluster-triangles 512 --min-component {size}"),
    );
    let repairs = &built["repairs"];
    assert_eq!(repairs["small_components"], components, "{source}");
    assert_eq!(repairs["small_component_triangles"], triangles, "{source}");
    assert_eq!(
        (&built["triangles"], &repairs["unreferenced_vertices"]),
        (&left.into(), &0.into()),
        "{source}"
    );
    for memory in ["1G", "36M"] {
        let told = folder
            .stdout(&format!("verify out.chpm --against {source} -q --memory {memory}"))
            .replace(',', "");
        let expected = format!(" without {components} components of {triangles} triangles that are smaller");
        assert!(told.contains("the leaves are the") && told.contains(&expected), "{source}: {told}");
    }
    let verified = json(folder, &format!("verify out.chpm --against {source} -q --json"));
    let against = &verified["against"];
    assert_eq!((&verified["sound"], &against["equal"]), (&true.into(), &true.into()), "{source}");
    assert_eq!((&against["source_triangles"], &against["leaf_triangles"]), (&left.into(), &left.into()));
    assert_eq!(against["small_component_triangles_left_out"], triangles);
    let measured = json(folder, &format!("measure out.chpm --against {source} -q --json --samples 2"));
    assert_eq!(measured["violations"], 0, "{source}");
    assert_eq!(measured["small_components_left_out"], components);
    let info = folder.stdout("info out.chpm --settings");
    let told = info.replace(',', "");
    let lines: Vec<&str> = told.lines().map(str::trim).collect();
    let line = |name: &str, n: usize| {
        lines.iter().any(|line| line.split("  ").next() == Some(name) && line.ends_with(&format!(" {n}")))
    };
    assert!(line("small components", components) && line("small component triangles", triangles), "{info}");
    assert!(info.contains(&format!("min-component {size}")), "{info}");
}

#[test]
fn every_kind_of_source_is_built_and_checked_without_its_dust() {
    let folder = Folder::new();
    let mesh = dusty();
    let half = [60, 60 * 12, KEPT];
    folder.write_mesh("in.ply", &mesh);
    folder.write("in.stl", stl(&mesh));
    folder.write("text.stl", stl_text(&mesh));
    folder.write("in.obj", obj(&mesh));
    folder.write("polygons.ply", ply_of_polygons(&mesh, 0.0));
    folder.write("far.ply", ply_of_polygons(&mesh, 4_123_456.75));
    for source in ["in.ply", "in.stl", "text.stl", "in.obj", "polygons.ply", "far.ply"] {
        check(&folder, source, "0.5", half);
    }
    // Of cubes from 0.001 on, in steps of 0.0028, by the root of three.
    let below = (0..60).filter(|i| f64::from(0.001 + 0.0028 * *i as f32) * 3f64.sqrt() < 0.1).count();
    assert!((10..50).contains(&below));
    check(&folder, "in.ply", "0.1", [below, 12 * below, KEPT + 12 * (60 - below)]);
    // Nor are errors held against what is not there.
    let told = folder.stdout("verify out.chpm --against in.ply --errors -q --json");
    let told: Value = serde_json::from_str(&told).expect("JSON");
    assert_eq!((&told["sound"], told["errors"]["levels"].is_array()), (&true.into(), true), "{told}");
    check(&folder, "in.stl", "0.1", [below, 12 * below, KEPT + 12 * (60 - below)]);
    // A percent of the box of all, dust included, which is some 18 long.
    check(&folder, "in.obj", "5%", half);
    // Scans are apart, whatever lies in the same place.
    folder.write(
        "two.conf",
        "bmesh in.ply 0 0 0 0 0 0 1\nbmesh in.stl 0 0 0 0 0 0.1 0.9\nbmesh in.ply 0 0 0 0 0 0 1\n",
    );
    check(&folder, "two.conf", "0.5", half.map(|n| 3 * n));
}

#[test]
fn a_checker_knows_which_components_are_small() {
    let folder = Folder::new();
    let mesh = dusty();
    // The first speck hangs on the first ball by one triangle.
    let mut bridged = mesh.clone();
    let first = (hand::icosphere(4).positions.len()) as u32;
    bridged.triangles.push([0, first, first + 1]);
    let mut more = mesh.clone();
    add(&mut more, &hand::icosphere(1), 0.4, [0.0, 0.0, 9.0]);
    let mut fewer = mesh.clone();
    fewer.triangles.truncate(mesh.triangles.len() - 12);
    for (name, mesh) in
        [("in.ply", &mesh), ("bridged.ply", &bridged), ("more.ply", &more), ("fewer.ply", &fewer)]
    {
        folder.write_mesh(name, mesh);
    }
    folder.stdout("build in.ply -q --min-component 0.5");
    folder.stdout("build bridged.ply -q --min-component 0.5");
    let faults = |file: &str, source: &str| {
        text(&folder.chpm(&format!("verify {file} --against {source} -q")).code(1).get_output().stdout)
    };
    // A large component of the source that the leaves lack.
    assert!(faults("in.chpm", "more.ply").contains("of the source is in no leaf"));
    // A speck of the source that the leaves have, since it once hung on a ball.
    let told = faults("bridged.chpm", "in.ply");
    assert!(
        told.contains("is not in the source")
            && told.contains("counts 59 small-components, and the source has 60"),
        "{told}"
    );
    // The other way round.
    assert!(faults("in.chpm", "bridged.ply").contains("of the source is in no leaf"));
    // Dust that the file does not count.
    let told = faults("in.chpm", "fewer.ply");
    assert!(
        told.contains("counts 720 small-component-triangles, and the source has 708 of that size"),
        "{told}"
    );
    // What asks for nothing must have all.
    folder.stdout("build more.ply -q");
    assert!(
        folder
            .stdout("verify more.chpm --against more.ply -q")
            .contains("the leaves are the 7,200 triangles")
    );
    assert!(faults("more.chpm", "in.ply").contains("is not in the source"));
}

#[test]
fn sizes_are_lengths_and_something_must_be_left() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &dusty());
    for size in ["-1", "nan", "inf", "1,5", "%", "-1%", "1e400"] {
        let told = folder.stderr(&format!("build in.ply -q --min-component={size}"), 2);
        assert!(told.contains("is no length"), "{size}: {told}");
    }
    let built = json(&folder, "build in.ply -q --json --min-component 0");
    assert_eq!(
        (&built["repairs"]["small_components"], &built["triangles"]),
        (&0.into(), &(KEPT + 720).into())
    );
    folder.stdout("verify in.chpm --against in.ply -q");
    let told = folder.stderr("build in.ply -q -o no.chpm --min-component 100%", 2);
    assert!(told.contains("in.ply: all 62 components are smaller") && told.contains("or less"), "{told}");
    let least =
        told.rsplit("--min-component ").next().and_then(|rest| rest.split(' ').next()).expect("a size");
    check(&folder, "in.ply", least, [61, 720 + 1280, 5120]);
    assert!(!folder.names().contains(&"no.chpm".to_owned()));
}

#[test]
fn a_batch_takes_the_same_setting() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &dusty());
    let ran = |size: &str| folder.stdout(&format!("batch in.ply -o out -q{size}"));
    ran(" --min-component 0.5");
    let info: Value = json(&folder, "info out/in.chpm --json");
    assert_eq!((&info["repairs"]["small_components"], &info["triangles"]), (&60.into(), &KEPT.into()));
    let first = folder.read("out/in.chpm");
    ran(" --min-component 0.5");
    assert!(folder.read("out/in.chpm") == first);
    ran("");
    let info: Value = json(&folder, "info out/in.chpm --json");
    assert_eq!(
        (&info["repairs"]["small_components"], &info["triangles"]),
        (&Value::Null, &(KEPT + 720).into())
    );
}
