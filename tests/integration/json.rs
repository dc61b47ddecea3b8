//! What `--json` prints, held against the page that documents it: no key is missing there, and none is there for nothing.

use super::harness::{Folder, root};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;

type Keys = BTreeMap<String, BTreeSet<String>>;

/// Keys of the page, by schema. A key in quotes is one in a row of a table.
fn documented() -> Keys {
    let page = fs::read_to_string(root().join("JSON.md")).expect("the page");
    let mut keys = Keys::new();
    let mut schema = None;
    for line in page.lines() {
        if let Some(name) = line.strip_prefix("## ") {
            schema = Some(name.to_owned());
        } else if let (Some(schema), Some(row)) = (&schema, line.strip_prefix("| `")) {
            let (key, _) = row.split_once('`').expect("a key");
            assert!(keys.entry(schema.clone()).or_default().insert(key.to_owned()), "{schema}: {key} twice");
        }
    }
    keys
}

/// The keys of a document, as the page writes them; those of objects that the page has as `NAME.*` are not told apart.
fn collect(value: &Value, at: &str, known: &BTreeSet<String>, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(entries) if known.contains(&format!("{at}.*")) => {
            assert!(entries.values().all(|value| !value.is_object() && !value.is_array()), "{at}");
            entries.keys().for_each(|key| assert_snake_case(key));
            found.insert(format!("{at}.*"));
        }
        Value::Object(entries) if known.iter().any(|key| key.starts_with(&format!("{at}.*."))) => {
            found.extend(known.get(at).cloned());
            for (key, value) in entries {
                assert_snake_case(key);
                collect(value, &format!("{at}.*"), known, found);
            }
        }
        Value::Object(entries) => {
            // An object that may be absent has a row of its own.
            found.extend(known.get(at).cloned());
            for (key, value) in entries {
                assert_snake_case(key);
                let key = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
                collect(value, &key, known, found);
            }
        }
        // A list without entries is there, too.
        Value::Array(entries) if entries.is_empty() && known.contains(&format!("{at}[]")) => {
            found.insert(format!("{at}[]"));
        }
        Value::Array(entries) if !known.contains(at) => {
            entries.iter().for_each(|entry| collect(entry, &format!("{at}[]"), known, found));
        }
        // What may be absent is documented as what it is where it is there.
        Value::Null if !known.contains(at) && known.iter().any(|key| key.starts_with(at)) => {}
        _ => {
            found.insert(at.to_owned());
        }
    }
}

fn assert_snake_case(key: &str) {
    let is_snake = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_';
    assert!(key.bytes().all(is_snake), "{key}");
}

#[test]
fn every_key_is_documented_and_appears() {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 3000 -o in.ply -q");
    let ply = String::from_utf8_lossy(&folder.read("in.ply")).into_owned();
    assert!(ply.contains("comment"), "comments appear, too");
    // What is left out is a warning, and a list of range scans has notes of its own.
    folder.write("odd.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n");
    folder.write("bad.ply", "ply\nformat ascii 1.0\n");
    let named = ["x", "y", "z", "quality"].map(|name| format!("property float {name}\n")).concat();
    let head = "ply\nformat ascii 1.0\nelement vertex 3\n";
    let rest = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    folder.write("named.ply", format!("{head}{named}{rest}0 0 0 1\n1 0 0 2\n0 1 0 nan\n3 0 1 2\n"));
    folder.stdout("build named.ply -q --keep quality");
    folder.write("bad.chpm", "no file");
    folder.stdout("build in.ply -q --cluster-triangles 256");
    // Small pieces of it vanish.
    folder.stdout("synth isosurface --triangles 20000 -o dusty.ply -q");
    folder.stdout("build dusty.ply -q --cluster-triangles 512");
    folder.stdout("path orbit in.chpm --frames 2 -o in.path");
    folder.stdout("extract in.chpm --triangles 500 -o small.ply -q");
    folder.stdout("relayout in.chpm -o apart.chpm --volume-size 1M -q");
    folder.write("one.poses", "0,0,0\n");
    folder.write("some.rays", "0,0,9,0,0,-1\n0,0,9,0,0,1\n");

    super::sheets::add_textured(&folder);
    folder.stdout("build a.obj -q --texture sheets --cluster-triangles 512");

    let measured = folder.stdout("measure in.chpm --against in.ply --samples 1 -q --json");
    folder.write("measured.json", measured);

    let documented = documented();
    let mut found = Keys::new();
    #[allow(unused_mut)]
    let mut runs = vec![
        ("build", "build in.ply -qf --json --cluster-triangles 256 --keep-work", 0),
        ("build", "build in.ply -qf --json --cluster-triangles 256", 0),
        ("build", "build odd.obj -qf --json", 0),
        ("info", "info in.chpm --json", 0),
        ("info", "info odd.chpm --cache --parts --json", 0),
        ("info", "info named.chpm --json", 0),
        ("info", "info apart.chpm --json", 0),
        ("stats", "stats in.chpm --json --measured measured.json", 0),
        ("stats", "stats odd.chpm --json", 0),
        ("stats", "stats a.chpm --json", 0),
        ("config", "config in.ply --json", 0),
        ("verify", "verify in.chpm --against in.ply --cuts 2 -q --json", 0),
        ("verify", "verify in.chpm --against in.ply --errors --cuts 1 -q --json", 0),
        ("verify", "verify dusty.chpm --against dusty.ply --errors --level 2 -q --json", 0),
        ("verify", "verify bad.chpm -q --json", 1),
        ("measure", "measure in.chpm --against in.ply --levels --cuts 1 --samples 1 -q --json", 0),
        ("measure-meshes", "measure in.ply small.ply --samples 1 -q --json", 0),
        ("measure-texture", "measure a.chpm --against a.obj --texture --samples 1 -q --json", 0),
        ("distance", "distance in.chpm small.ply --pose 3,0,0 -q --json", 0),
        ("clearance", "clearance in.chpm small.ply --above 1% -q --json", 1),
        ("contacts", "contacts in.chpm small.ply --within 1% -q --json", 0),
        ("contacts-path", "contacts in.chpm small.ply --within 1% --path one.poses -q --json", 0),
        ("contacts-self", "contacts in.chpm --self -q --json", 0),
        ("compare", "compare in.chpm small.ply --tolerance 1% -q --json", 0),
        ("walk", "walk in.chpm in.path -q --json", 0),
        ("extract", "extract in.chpm --level 1 --local-origin -o local.ply -q --json", 0),
        ("extract", "extract in.chpm --triangles 9k --up z -o turned.obj -q --json", 0),
        ("extract-lods", "extract in.chpm --lods 900,200 -o lods.glb -q --json", 0),
        ("extract-lods", "extract in.chpm --lods 900,200 -o lods.ply --local-origin -q --json", 0),
        ("section", "section in.chpm --plane 0,0,1:0.1 --preview 5% -o a.svg -q --json", 0),
        ("section", "section in.chpm --every 0.5 -q --json", 0),
        ("rays", "rays in.chpm some.rays --error 1% -o a.csv -q --json", 0),
        ("rays", "rays in.chpm some.rays --any -q --json", 0),
        ("thickness", "thickness in.chpm --svg a.svg -fq --json", 0),
        ("visible", "visible in.chpm --from 0,0,9 --from 9,0,0 -q --json", 0),
        ("simplify", "simplify in.ply --within 1% -o simple.glb -q --json", 0),
        ("simplify", "simplify odd.obj --within 1% -o simple.stl -q --json", 0),
        ("export", "export in.chpm --3dtiles tiles -q --json", 0),
        ("export", "export in.chpm --3dtiles tiles.3tz -q --json", 0),
        ("export-meshlets", "export in.chpm --meshlets in.meshlets -q --json", 0),
        ("report", "report in.chpm -o page.html -q --json", 0),
        ("bench", "bench in.ply --runs 1 --samples 1 -q --json", 0),
        ("bench-threads", "bench in.ply --threads 1,2 --runs 1 -q --json", 0),
        ("batch", "batch in.ply odd.obj bad.ply -o out --shard 1/1 -q --json", 1),
    ];
    #[cfg(feature = "web")]
    runs.push(("share", "share in.chpm -o shared -q --json", 0));
    #[cfg(feature = "viewer")]
    runs.extend([
        ("render", "render in.chpm --viewport 40x30 -o drawn.png --json", 0),
        ("still", "render in.chpm --rays --viewport 40x30 -q -o r.png --json", 0),
        ("walk-render", "walk in.chpm in.path --render --viewport 40x30 -q --json", 0),
        ("walk-prove", "walk in.chpm in.path --render --prove --viewport 40x30 -q --json", 0),
    ]);
    for (name, words, code) in &runs {
        let output = folder.chpm(words).code(*code);
        let value: Value = serde_json::from_slice(&output.get_output().stdout).expect("JSON");
        let schema = value["schema"].as_str().expect("a schema").to_owned();
        assert!(schema.starts_with(&format!("chpm-{name}/")), "{words}: {schema}");
        let known = documented.get(&schema).unwrap_or_else(|| panic!("{schema} is not documented"));
        collect(&value, "", known, found.entry(schema).or_default());
    }
    let aside: Value = serde_json::from_slice(&folder.read("local.ply.origin.json")).expect("JSON");
    let schema = aside["schema"].as_str().expect("a schema").to_owned();
    collect(&aside, "", &documented[&schema], found.entry(schema).or_default());
    for (schema, found) in &found {
        let known = &documented[schema];
        let undocumented: Vec<&String> = found.difference(known).collect();
        let absent: Vec<&String> = known.difference(found).collect();
        assert!(undocumented.is_empty(), "{schema}: not documented: {undocumented:?}");
        assert!(absent.is_empty(), "{schema}: documented, but nowhere: {absent:?}");
    }
    let viewers = ["chpm-render/1", "chpm-still/1", "chpm-walk-render/1", "chpm-walk-prove/1"];
    let left_out = |schema: &str| {
        (!cfg!(feature = "viewer") && viewers.contains(&schema))
            || (!cfg!(feature = "web") && schema == "chpm-share/1")
    };
    let unused = documented.keys().filter(|schema| !found.contains_key(*schema)).map(String::as_str);
    let unused: Vec<&str> = unused.filter(|schema| !left_out(schema)).collect();
    assert!(unused.is_empty(), "documented, but nowhere: {unused:?}");
    let summary: Value = serde_json::from_slice(&folder.read("out/summary-1-of-1.json")).expect("JSON");
    assert_eq!(summary["schema"], "chpm-batch/1");
}
