//! `chpm stats`: every number is found anew in the bytes of the file, and by plainer means.

use super::harness::{Folder, root, text};
use super::raw::{Cluster, Group, Raw};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;

fn parse(text: &str) -> Value {
    serde_json::from_str(text).expect("valid JSON")
}

fn model(words: &str) -> Folder {
    let folder = Folder::new();
    folder.stdout(&format!("synth {} -o in.ply -q", words.split('|').next().expect("a shape")));
    folder.stdout(&format!("build in.ply -q {}", words.split('|').nth(1).expect("settings")));
    folder
}

/// The least of the values that so many percent of them do not exceed.
fn percentile(values: &[f64], percent: usize) -> f64 {
    let enough =
        |value: &&f64| 100 * values.iter().filter(|other| *other <= *value).count() >= percent * values.len();
    values.iter().filter(enough).copied().fold(f64::INFINITY, f64::min)
}

fn spread(values: Vec<f64>) -> Value {
    if values.is_empty() {
        return Value::Null;
    }
    let at = |percent| percentile(&values, percent);
    let (min, max) = values.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    json!({ "min": min, "p25": at(25), "median": at(50), "p75": at(75), "p95": at(95), "max": max })
}

/// Equal but for rounding of sums.
fn same(a: &Value, b: &Value, at: &str) {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) => {
            let names = |o: &serde_json::Map<String, Value>| o.keys().cloned().collect::<Vec<_>>();
            assert_eq!(names(a), names(b), "{at}");
            a.iter().for_each(|(name, value)| same(value, &b[name], &format!("{at}.{name}")));
        }
        (Value::Number(_), Value::Number(_)) => {
            let (a, b) = (a.as_f64().expect("a number"), b.as_f64().expect("a number"));
            assert!((a - b).abs() <= 1e-12 * b.abs(), "{at}: {a} is not {b}");
        }
        _ => assert_eq!(a, b, "{at}"),
    }
}

/// Misses of a first-in first-out cache.
fn misses(triangles: &[[u16; 3]], size: usize) -> u64 {
    let (mut held, mut misses) = (Vec::new(), 0);
    for vertex in triangles.iter().flatten() {
        if !held.contains(vertex) {
            held.push(*vertex);
            misses += 1;
            if held.len() > size {
                held.remove(0);
            }
        }
    }
    misses
}

/// Faces whose vertices one before them has.
fn coincident(triangles: &[[u16; 3]]) -> u64 {
    let same = |a: &[u16; 3], b: &[u16; 3]| a.iter().all(|v| b.contains(v));
    (0..triangles.len()).filter(|i| triangles[..*i].iter().any(|t| same(t, &triangles[*i]))).count() as u64
}

fn span(triangles: &[[u16; 3]]) -> u64 {
    let edges = triangles.iter().flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)]);
    edges.map(|(a, b)| (i64::from(*a) - i64::from(*b)).unsigned_abs()).sum()
}

fn sides(c: &Cluster) -> [f64; 3] {
    [0, 1, 2].map(|axis| f64::from(c.high[axis]) - f64::from(c.low[axis]))
}

fn aspect(c: &Cluster) -> Option<f64> {
    let mut sides = sides(c);
    sides.sort_by(|a, b| b.total_cmp(a));
    (sides[1] > 0.0).then(|| sides[0] / sides[1])
}

fn overlap(id: u32, clusters: &[Cluster], groups: &[Group]) -> Option<f64> {
    let siblings = &groups.iter().find(|group| group.fine.contains(&id))?.fine;
    let own = &clusters[id as usize];
    let surface = |[x, y, z]: [f64; 3]| x * y + y * z + x * z;
    let common = |other: &Cluster| {
        let side = |axis: usize| {
            f64::from(own.high[axis].min(other.high[axis])) - f64::from(own.low[axis].max(other.low[axis]))
        };
        let sides = [0, 1, 2].map(side);
        if sides.iter().any(|s| *s < 0.0) { 0.0 } else { surface(sides) }
    };
    let others =
        siblings.iter().filter(|other| **other != id).map(|other| common(&clusters[*other as usize]));
    others.reduce(f64::max).map(|most| most / surface(sides(own)))
}

/// For each shared vertex the levels at which it is.
fn lives(clusters: &[Cluster]) -> BTreeMap<u32, (u32, u32)> {
    let mut lives = BTreeMap::new();
    for cluster in clusters {
        for id in &cluster.shared_ids {
            let (first, last) = lives.entry(*id).or_insert((cluster.level, cluster.level));
            (*first, *last) = ((*first).min(cluster.level), (*last).max(cluster.level));
        }
    }
    lives
}

fn parts(clusters: &[&Cluster], attributes: u32) -> Value {
    let sum = |of: &dyn Fn(&Cluster) -> u32| clusters.iter().map(|c| f64::from(of(c))).sum::<f64>();
    let own = 12 * (attributes & 1) + 4 * (attributes >> 1 & 1);
    let steps = |c: &Cluster| 2 * (c.vertices - c.base_vertices);
    let values = [
        sum(&|c| 12 * c.vertices),
        sum(&|c| 6 * c.triangle_count),
        0.0,
        sum(&steps),
        sum(&steps),
        sum(&|c| 4 * c.shared + c.vertices.div_ceil(8)),
        sum(&|c| own * c.vertices),
        sum(&|_| 64),
    ];
    let names = chpm_format::packed::PARTS.map(|name| name.replace(' ', "_"));
    names.into_iter().zip(values).map(|(name, value)| (name, Value::from(value))).collect()
}

fn ratio(a: f64, b: f64) -> f64 {
    if b == 0.0 { 0.0 } else { a / b }
}

#[test]
fn every_number_is_in_the_bytes() {
    for words in [
        "isosurface --triangles 30k|--cluster-triangles 256",
        "terrain --triangles 20k|--cluster-triangles 512 --boundary lock",
        "hard:tiny --triangles 20k|--cluster-triangles 256 --target-error 1%",
        "plates --triangles 5k|--cluster-triangles 128 --topology keep",
        "sphere --triangles 20|",
        "odd:coincident --triangles 2k|--cluster-triangles 256",
    ] {
        let folder = model(words);
        let stats = parse(&folder.stdout("stats in.chpm --json"));
        let raw = Raw(folder.read("in.chpm"));
        let (clusters, groups, levels) = (raw.clusters(), raw.groups(), raw.levels());
        let attributes = raw.u32(44);
        let lives = lives(&clusters);
        let f = |of: &dyn Fn(&Cluster) -> f64, own: &[&Cluster]| spread(own.iter().map(|c| of(c)).collect());
        for (level, at) in (0_u32..).zip(&levels) {
            let ids: Vec<u32> =
                (0..clusters.len() as u32).filter(|id| clusters[*id as usize].level == level).collect();
            let own: Vec<&Cluster> = ids.iter().map(|id| &clusters[*id as usize]).collect();
            let total = |of: &dyn Fn(&Cluster) -> u64| own.iter().map(|c| of(c)).sum::<u64>() as f64;
            let triangles = total(&|c| c.triangle_count.into());
            let acmr = |size| ratio(total(&|c| misses(&c.triangles, size)), triangles);
            let grouped: Vec<&Group> = groups.iter().filter(|group| group.level == level).collect();
            let living = lives.values().filter(|(first, last)| (*first..=*last).contains(&level));
            let expected = json!({
                "level": level,
                "clusters": own.len(),
                "triangles": f(&|c| c.triangle_count.into(), &own),
                "base_triangles": f(&|c| c.base_triangles.into(), &own),
                "coincident": total(&|c| coincident(&c.triangles)),
                "shared": ratio(total(&|c| c.shared.into()), total(&|c| c.vertices.into())),
                "border_levels": spread(living.map(|(first, last)| f64::from(last - first + 1)).collect()),
                "min_error": f(&|c| c.errors[0].into(), &own),
                "max_error": f(&|c| c.errors[1].into(), &own),
                "aspect": spread(own.iter().filter_map(|c| aspect(c)).collect()),
                "overlap": spread(ids.iter().filter_map(|id| overlap(*id, &clusters, &groups)).collect()),
                "groups": grouped.len(),
                "group_size": spread(grouped.iter().map(|group| group.coarse.into()).collect()),
                "collapses": f(&|c| (c.vertices - c.base_vertices).into(), &own),
                "page_bytes": total(&|c| c.page_len.into()),
                "parts": parts(&own, attributes),
                "acmr16": acmr(16),
                "acmr24": acmr(24),
                "acmr32": acmr(32),
                "edge_span": ratio(total(&|c| span(&c.triangles)), 3.0 * triangles),
                "sheets": null,
                "tightness": null,
            });
            assert_eq!(u64::from(raw.u32(at + 4)), own.len() as u64);
            same(&stats["levels"][level as usize], &expected, &format!("{words}: level {level}"));
        }
        assert_eq!(stats["levels"].as_array().map(Vec::len), Some(levels.len()));
        whole(&stats, &raw, words);
        worst(&stats, &clusters, &groups, words);
    }
}

/// What is of the whole file.
fn whole(stats: &Value, raw: &Raw, words: &str) {
    let (clusters, groups, levels) = (raw.clusters(), raw.groups(), raw.levels());
    let all: Vec<&Cluster> = clusters.iter().collect();
    let lives: Vec<f64> =
        lives(&clusters).values().map(|(first, last)| f64::from(last - first + 1)).collect();
    let (_, padded, _) = raw.section(6);
    let pages: u64 = clusters.iter().map(|c| u64::from(c.page_len)).sum();
    let (len, source) = (raw.0.len() as u64, raw.u64(56));
    // The longest path by trying all.
    fn below(group: &Group, groups: &[Group], clusters: &[Cluster]) -> u32 {
        let next = group
            .fine
            .iter()
            .map(|id| below(&groups[clusters[*id as usize].group as usize], groups, clusters));
        1 + next.max().unwrap_or(0)
    }
    let longest = groups.iter().map(|group| below(group, &groups, &clusters)).max().expect("a group");
    let largest = groups.iter().map(|group| group.coarse).max().expect("a group");
    same(&stats["border_levels"], &spread(lives.clone()), words);
    let expected = json!({
        "count": groups.len(),
        "size": spread(groups.iter().map(|group| group.coarse.into()).collect()),
        "largest": groups.iter().position(|group| group.coarse == largest),
        "longest_path": longest,
    });
    same(&stats["groups"], &expected, words);
    let expected = json!({
        "file": len,
        "tables": len - padded,
        "pages": pages,
        "padding": padded - pages,
        "sheets": 0,
        "per_triangle": len as f64 / source as f64,
        "parts": parts(&all, raw.u32(44)),
    });
    same(&stats["bytes"], &expected, words);

    let total = |of: &dyn Fn(&Cluster) -> u64| clusters.iter().map(of).sum::<u64>() as f64;
    let roots = || clusters.iter().filter(|c| c.parent == u32::MAX);
    let leaves = clusters.iter().filter(|c| c.level == 0).count();
    let least_height = (0..).find(|height| 1_usize << height >= leaves).expect("a height");
    let of_levels = |field: usize| levels.iter().map(|at| f64::from(raw.u32(at + field))).sum::<f64>();
    let triangles: Vec<f64> = levels.iter().map(|at| raw.u64(at + 24) as f64).collect();
    let shared = levels.iter().map(|at| raw.u64(at + 40) as f64 / raw.u64(at + 8) as f64).fold(0.0, f64::max);
    let diagonal: f64 =
        (0..3).map(|a| (f64::from(raw.f32(132 + 4 * a)) - f64::from(raw.f32(120 + 4 * a))).powi(2)).sum();
    let max_error = f64::from(raw.f32(144));
    let mut expected = json!({
        "triangles": source,
        "clusters": clusters.len(),
        "levels": levels.len(),
        "height": levels.len() - 1,
        "least_height": least_height,
        "roots": roots().count(),
        "top_triangles": roots().map(|c| f64::from(c.base_triangles)).sum::<f64>(),
        "stalled": of_levels(56),
        "coincident": total(&|c| coincident(&c.triangles)),
        "forced": of_levels(60),
        "max_error": max_error,
        "max_error_percent": 100.0 * max_error / diagonal.sqrt(),
        "shared": shared,
        "groups": groups.len(),
        "largest_group": largest,
        "longest_path": longest,
        "bytes": len,
        "bytes_per_triangle": len as f64 / source as f64,
        "edge_span": total(&|c| span(&c.triangles)) / (3.0 * total(&|c| c.triangle_count.into())),
    });
    let mut put = |name: &str, values: Vec<f64>| {
        if !values.is_empty() {
            expected[name] = percentile(&values, 50).into();
        }
    };
    put("border_levels", lives);
    put("aspect", clusters.iter().filter_map(aspect).collect());
    put("overlap", (0..clusters.len() as u32).filter_map(|id| overlap(id, &clusters, &groups)).collect());
    put(
        "worst_ratio",
        triangles.windows(2).map(|pair| pair[1] / pair[0]).reduce(f64::max).into_iter().collect(),
    );
    for size in [16, 24, 32] {
        let all = total(&|c| misses(&c.triangles, size)) / total(&|c| c.triangle_count.into());
        put(&format!("acmr{size}"), vec![all]);
    }
    let sorted =
        |value: &Value| value.as_object().expect("measures").clone().into_iter().collect::<BTreeMap<_, _>>();
    same(&json!(sorted(&stats["measures"])), &json!(sorted(&expected)), words);
}

/// The five worst by each measure.
fn worst(stats: &Value, clusters: &[Cluster], groups: &[Group], words: &str) {
    let error = |c: &Cluster| {
        let own: Vec<f64> =
            clusters.iter().filter(|o| o.level == c.level).map(|o| o.errors[1].into()).collect();
        f64::from(c.errors[1]) / percentile(&own, 50)
    };
    let rated = |name: &str, id: u32| {
        let c = &clusters[id as usize];
        let triangles = f64::from(c.triangle_count);
        match name {
            "error" => Some(error(c)),
            "kept" => (c.parent != u32::MAX).then(|| f64::from(c.base_triangles) / triangles),
            "triangles" => Some(triangles),
            "shared" => Some(f64::from(c.shared) / f64::from(c.vertices)),
            "aspect" => aspect(c),
            "overlap" => overlap(id, clusters, groups),
            "acmr24" => Some(misses(&c.triangles, 24) as f64 / triangles),
            "edge_span" => Some(span(&c.triangles) as f64 / (3.0 * triangles)),
            "bytes_per_triangle" => Some(f64::from(c.page_len) / triangles),
            "deviation" => Some(c.normal_deviation.into()),
            _ => panic!("{name} is new"),
        }
    };
    let told = stats["worst"].as_array().expect("measures");
    assert!(told.len() >= 5, "{words}");
    for worst in told {
        let name = worst["measure"].as_str().expect("a name");
        let value = |id: u32| rated(name, id).filter(|value| *value > 0.0 && value.is_finite());
        let mut all: Vec<(f64, u32)> =
            (0..clusters.len() as u32).filter_map(|id| Some((value(id)?, id))).collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let expected: Vec<Value> = all
            .iter()
            .take(5)
            .map(
                |(value, id)| json!({ "cluster": id, "level": clusters[*id as usize].level, "value": value }),
            )
            .collect();
        assert_eq!(worst["clusters"], json!(expected), "{words}: {name}");
    }
}

#[test]
fn level_0_is_what_is_extracted() {
    let folder = model("terrain --triangles 20k|--cluster-triangles 512");
    let stats = parse(&folder.stdout("stats in.chpm --json"));
    folder.stdout("extract in.chpm --level 0 -o out.ply -q");
    assert_eq!(
        stats["measures"]["triangles"].as_f64(),
        Some(folder.read_mesh("out.ply").triangles.len() as f64)
    );
}

#[test]
fn packing_changes_bytes_alone() {
    let folder = model("isosurface --triangles 20k|--cluster-triangles 512");
    folder.stdout("relayout in.chpm -o packed.chpm --pages packed -q");
    let [mut raw, mut packed] =
        ["in", "packed"].map(|name| parse(&folder.stdout(&format!("stats {name}.chpm --json"))));
    let sum: f64 =
        packed["bytes"]["parts"].as_object().expect("parts").values().filter_map(Value::as_f64).sum();
    let pages = packed["bytes"]["pages"].as_f64().expect("bytes");
    assert!((sum / pages - 1.0).abs() < 0.05 && pages < 0.7 * raw["bytes"]["pages"].as_f64().expect("bytes"));
    for stats in [&mut raw, &mut packed] {
        stats["file"].take();
        stats["bytes"].take();
        ["bytes", "bytes_per_triangle"].iter().for_each(|name| drop(stats["measures"][name].take()));
        for level in stats["levels"].as_array_mut().expect("levels") {
            ["page_bytes", "parts"].iter().for_each(|name| drop(level[name].take()));
        }
        stats["worst"]
            .as_array_mut()
            .expect("worst")
            .retain(|worst| worst["measure"] != "bytes_per_triangle");
    }
    assert_eq!(raw, packed);
}

/// Records of TEXTURES: 64 bytes, in the order of the clusters.
#[test]
fn sheets_are_in_the_bytes() {
    let folder = Folder::new();
    super::sheets::add_textured(&folder);
    folder.stdout("build a.obj --texture sheets --cluster-triangles 512 -q");
    let stats = parse(&folder.stdout("stats a.chpm --json"));
    let raw = Raw(folder.read("a.chpm"));
    let (first, ..) = raw.section(8);
    let clusters = raw.clusters();
    let (mut all_texels, mut all_bytes) = (0, 0);
    for level in 0..raw.levels().len() as u32 {
        let own = (0..clusters.len()).filter(|id| clusters[*id].level == level).map(|id| first + 64 * id);
        let own: Vec<usize> = own.collect();
        let each = |of: &dyn Fn(usize) -> f64| -> Vec<f64> { own.iter().map(|at| of(*at)).collect() };
        let texels: u64 =
            own.iter().map(|at| u64::from(raw.u16(at + 24)) * u64::from(raw.u16(at + 26))).sum();
        let images: u64 = own.iter().map(|at| u64::from(raw.u32(at + 20))).sum();
        let bytes = images + own.iter().map(|at| u64::from(raw.u32(at + 16))).sum::<u64>();
        let expected = json!({
            "texels": texels,
            "bytes": bytes,
            "bits_per_texel": 8.0 * images as f64 / texels as f64,
            "charts": spread(each(&|at| raw.u32(at + 4).into())),
            "texel": spread(each(&|at| raw.f32(at + 32).into())),
        });
        same(&stats["levels"][level as usize]["sheets"], &expected, &format!("level {level}"));
        (all_texels, all_bytes) = (all_texels + texels, all_bytes + bytes);
    }
    assert_eq!(stats["measures"]["texels"].as_f64(), Some(all_texels as f64));
    // Each begins at a multiple of eight or so.
    let told = stats["bytes"]["sheets"].as_u64().expect("a number");
    assert!((all_bytes..all_bytes + 16 * clusters.len() as u64).contains(&told), "{told}");
    let table = folder.stdout("stats a.chpm");
    assert!(table.contains("bits a texel") && table.contains(", sheets "), "{table}");
    folder.stdout("stats a.chpm -q --assert texels>1000");
}

#[test]
fn the_schema_holds_and_refuses() {
    let schema =
        parse(&fs::read_to_string(root().join("docs/chpm-stats-1.schema.json")).expect("the schema"));
    let validator = jsonschema::validator_for(&schema).expect("a valid schema");
    for words in ["isosurface --triangles 20k|--cluster-triangles 512", "sphere --triangles 20|"] {
        let folder = model(words);
        folder
            .write("measured.json", folder.stdout("measure in.chpm --against in.ply --samples 2 -q --json"));
        for measured in ["", "--measured measured.json"] {
            let stats = parse(&folder.stdout(&format!("stats in.chpm --json {measured}")));
            let faults: Vec<String> = validator.iter_errors(&stats).map(|error| error.to_string()).collect();
            assert!(faults.is_empty(), "{faults:?}");
            for (pointer, wrong) in [
                ("/schema", json!("chpm-stats/2")),
                ("/levels/0/triangles/median", json!("many")),
                ("/measures/acmr24", json!(-1)),
                ("/worst", json!({})),
            ] {
                let mut bad = stats.clone();
                *bad.pointer_mut(pointer).expect("a value") = wrong;
                assert!(!validator.is_valid(&bad), "{pointer}");
            }
        }
    }
}

#[test]
fn assertions_end_pipelines() {
    let folder = model("isosurface --triangles 20k|--cluster-triangles 512");
    let stats = parse(&folder.stdout("stats in.chpm --json"));
    let acmr = stats["measures"]["acmr24"].as_f64().expect("a number");
    assert!((0.5..0.8).contains(&acmr), "{acmr}");
    for (claims, code) in [
        ("--assert acmr24<0.8", 0),
        ("--assert acmr24<0.8 --assert roots==1 --assert levels>2", 0),
        ("--assert acmr24<0.8 --assert roots!=1", 1),
        ("--assert acmr24>=0.8", 1),
        ("--assert acmr25<1", 2),
        ("--assert tightness<2", 2),
        ("--assert acmr24", 2),
    ] {
        let run = folder.chpm(&format!("stats in.chpm -q {claims}")).code(code);
        let (out, err) = (text(&run.get_output().stdout), text(&run.get_output().stderr));
        assert_eq!((out.as_str(), err.is_empty()), ("", code == 0), "{claims}: {err}");
        assert_eq!(err.contains("does not hold"), code == 1, "{claims}: {err}");
    }
    folder.write("measured.json", folder.stdout("measure in.chpm --against in.ply --samples 2 -q --json"));
    folder.stdout("stats in.chpm -q --measured measured.json --assert tightness>=1");
    let measured = parse(&text(&folder.read("measured.json")));
    let told = parse(&folder.stdout("stats in.chpm --json --measured measured.json"));
    let rows = measured["levels"].as_array().expect("levels");
    for row in rows.iter().filter(|row| row["collapsed"] == 1.0) {
        let level = row["level"].as_u64().expect("a level") as usize;
        assert_eq!(told["levels"][level]["tightness"], row["stored_by_measured"]);
    }
    assert!(folder.stdout("stats in.chpm --measured measured.json").contains("stored by measured"));
    let error = folder.stderr("stats in.chpm -q --measured in.ply", 2);
    assert!(error.contains("in.ply") && error.contains("chpm measure"), "{error}");
}

#[test]
fn clusters_are_rows_of_csv_and_can_be_dumped() {
    let folder = model("isosurface --triangles 20k|--cluster-triangles 512");
    let csv = folder.stdout("stats in.chpm --csv - -q");
    let clusters = Raw(folder.read("in.chpm")).clusters();
    let mut lines = csv.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().expect("a head");
    let column = |name: &str| head.iter().position(|n| *n == name).unwrap_or_else(|| panic!("{name}"));
    let [triangles, acmr, error] = ["triangles", "acmr24", "max_error"].map(column);
    let rows: Vec<_> = lines.collect();
    assert_eq!(rows.len(), clusters.len());
    for (row, c) in rows.iter().zip(&clusters) {
        assert_eq!((row.len(), row[triangles].parse()), (head.len(), Ok(c.triangle_count)));
        assert_eq!(row[error].parse(), Ok(c.errors[1]));
        let own = misses(&c.triangles, 24) as f64 / f64::from(c.triangle_count);
        assert_eq!(row[acmr].parse(), Ok(own));
    }
    let whole = folder.stdout("dump in.chpm --pages");
    let one = folder.stdout("dump in.chpm --cluster 3");
    assert!(one.starts_with("cluster 3 ") && whole.contains(&one), "{one}");
    assert_eq!(one.matches("\n  triangle ").count(), clusters[3].triangle_count as usize);
    let error = folder.stderr(&format!("dump in.chpm --cluster {}", clusters.len()), 2);
    assert!(
        error.contains("has no cluster") && error.contains(&format!("the last is {}", clusters.len() - 1)),
        "{error}"
    );
}
