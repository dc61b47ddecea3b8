//! Named scalars: kept, told, written, compared with the source, and shown.

use super::glb::Glb;
use super::harness::Folder;
use chpm_import::ply::{Batch, BatchKind, Encoding, Keep, Options, PlyReader, PlyWriter};
use chpm_mesh::{Scalar, ScalarKind, TriMesh};
use chpm_synth::{Shape, Synth};
use std::collections::BTreeMap;

/// What each place has.
type Values = BTreeMap<[u32; 3], Vec<u32>>;

fn of(folder: &Folder, name: &str) -> (Vec<Scalar>, Values) {
    let options = Options { keep: Keep { all: true, names: Vec::new() }, ..Options::default() };
    let bytes = folder.read(name);
    let mut reader = PlyReader::new(&bytes[..], options).expect("a PLY");
    let scalars = reader.scalars().to_vec();
    let (mut batch, mut values) = (Batch::default(), Values::new());
    while reader.next_batch(&mut batch).expect("a batch") == BatchKind::Vertices {
        let vertices = batch.vertices.view();
        for (vertex, place) in vertices.positions.iter().enumerate() {
            values.insert(place.map(f32::to_bits), vertices.scalars_of(vertex).to_vec());
        }
    }
    (scalars, values)
}

/// A model whose vertices have a quality, a time and a class.
fn source(folder: &Folder, name: &str) -> TriMesh {
    let mut mesh = Synth::new(Shape::Terrain, 3_000, 2).to_mesh();
    let kinds =
        [("quality", ScalarKind::Float32), ("time", ScalarKind::Float64), ("class", ScalarKind::Uint16)];
    for vertex in 0..mesh.positions.len() as u32 {
        let number = f64::from(vertex);
        let quality = if vertex % 7 == 0 { f64::NAN } else { number / 4.0 };
        for ((_, kind), value) in kinds.iter().zip([quality, number.sqrt(), f64::from(vertex % 300)]) {
            kind.put(value, &mut mesh.vertices.scalars);
        }
    }
    let scalars = kinds.map(|(name, kind)| Scalar::new(name, kind));
    let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let (encoding, attributes) = (Encoding::BinaryLittleEndian, mesh.attributes());
    let mut ply =
        PlyWriter::with_scalars(Vec::new(), encoding, vertices, triangles, attributes, &scalars, false, &[])
            .expect("a header");
    ply.vertices(mesh.view()).expect("vertices");
    ply.triangles(&mesh.triangles).expect("triangles");
    folder.write(name, ply.finish().expect("a PLY"));
    mesh
}

#[test]
fn what_is_kept_is_told_extracted_and_compared() {
    let folder = Folder::new();
    let mesh = source(&folder, "in.ply");
    let (scalars, expected) = of(&folder, "in.ply");
    for pages in ["raw", "packed"] {
        folder.stdout(&format!(
            "build in.ply -o out.chpm -qf --keep all --pages {pages} --cluster-triangles 256"
        ));
        let told = folder.stdout("verify out.chpm --against in.ply -q");
        assert!(!told.contains("fault"), "{told}");
        let info = folder.stdout("info out.chpm");
        assert!(info.contains("scalar     class: uint16, 0 to 299\n"), "{info}");
        assert!(info.contains("scalar     quality: float32, 0.25 to"), "{info}");
        let json: serde_json::Value =
            serde_json::from_str(&folder.stdout("info out.chpm --json")).expect("JSON");
        let count = mesh.positions.len();
        assert_eq!(json["scalars"][1]["name"], "time");
        assert_eq!((&json["scalars"][1]["low"], &json["scalars"][1]["count"]), (&0.0.into(), &count.into()));

        for (level, flags) in [(0, ""), (0, "--ascii"), (0, "--order cache-oblivious"), (2, "")] {
            folder.stdout(&format!("extract out.chpm -o got.ply -f --level {level} {flags}"));
            let (own, got) = of(&folder, "got.ply");
            assert_eq!(own, scalars, "{flags}");
            if flags == "--ascii" {
                // Text is read as doubles, whose places are told apart no better.
                assert_eq!(own.len(), 3);
                continue;
            }
            assert!(level > 0 || got.len() == expected.len());
            assert!(got.iter().all(|(place, words)| expected[place] == *words), "level {level} {flags}");
        }
    }

    folder.stdout("extract out.chpm -o got.glb -f --level 0");
    let glb = Glb::read(&folder.read("got.glb"));
    let attributes = &glb.json["meshes"][0]["primitives"][0]["attributes"];
    for name in ["_QUALITY", "_TIME", "_CLASS"] {
        let accessor = &glb.json["accessors"][attributes[name].as_u64().expect("an accessor") as usize];
        assert_eq!((&accessor["type"], &accessor["count"]), (&"SCALAR".into(), &mesh.positions.len().into()));
    }
    folder.stdout("relayout out.chpm -o raw.chpm --pages raw -q");
    folder.stdout("verify raw.chpm --against in.ply -q");
}

#[test]
fn another_value_in_the_source_is_a_fault() {
    let folder = Folder::new();
    source(&folder, "in.ply");
    folder.stdout("build in.ply -o out.chpm -q --keep time --keep class");
    let mut bytes = folder.read("in.ply");
    let end = bytes.windows(11).position(|window| window == b"end_header\n").expect("a header") + 11;
    // The quality is not kept, and may be another.
    bytes[end + 12] ^= 1;
    folder.write("in.ply", &bytes);
    assert!(!folder.stdout("verify out.chpm --against in.ply -q").contains("fault"));
    bytes[end + 12 + 4] ^= 1;
    folder.write("in.ply", &bytes);
    let told = folder.chpm("verify out.chpm --against in.ply -q").code(1);
    let told = String::from_utf8_lossy(&told.get_output().stdout).into_owned();
    assert!(told.contains("is not in the source"), "{told}");
    let refused = folder.stderr("build in.ply -o no.chpm -q --keep rainbow", 2);
    assert!(
        refused.contains("no scalar 'rainbow' to keep; vertices of this file have quality, time, class"),
        "{refused}"
    );
    assert!(!folder.names().contains(&"no.chpm".to_owned()));
}

#[cfg(feature = "viewer")]
#[test]
fn a_picture_shows_one_with_its_range() {
    let folder = Folder::new();
    source(&folder, "in.ply");
    folder.stdout("build in.ply -o out.chpm -q --keep quality");
    let draw = |flags: &str| {
        folder
            .stdout(&format!("render out.chpm -o out.png -f --viewport 160x120 --adapter software {flags}"));
        folder.read("out.png")
    };
    assert_ne!(draw("--color-by quality"), draw(""));
    let refused = folder.stderr("render out.chpm -o out.png -f --color-by time --adapter software", 2);
    assert!(refused.contains("has no scalar 'time'; it has quality"), "{refused}");
    // A mesh is built with what is to be seen.
    folder.stdout("render in.ply -o mesh.png -q --viewport 160x120 --adapter software --color-by class");
}

#[test]
fn outputs_without_scalars_say_so() {
    let folder = Folder::new();
    source(&folder, "in.ply");
    folder.stdout("build in.ply -o out.chpm -q --keep all");
    let told = "warning: the output leaves out quality, time, class: extract to PLY or to glTF without --meshopt keeps named scalars";
    for (line, is_told) in [
        ("extract out.chpm --level 0 -qf -o got.ply", false),
        ("extract out.chpm --level 0 -qf -o got.glb", false),
        ("extract out.chpm --level 0 -qf -o got.glb --meshopt", true),
        ("extract out.chpm --level 0 -qf -o got.stl", true),
        ("extract out.chpm --level 0 -qf -o got.obj", true),
        ("export out.chpm -qf --3dtiles tiles", true),
    ] {
        let said = folder.stderr(line, 0);
        assert_eq!(said.matches(told).count(), usize::from(is_told), "{line}: {said}");
        let json: serde_json::Value =
            serde_json::from_str(&folder.stdout(&format!("{line} --json"))).expect("JSON");
        let warnings = json["warnings"].as_array().expect("warnings");
        assert_eq!(warnings.len(), usize::from(is_told), "{line}: {warnings:?}");
    }
}
