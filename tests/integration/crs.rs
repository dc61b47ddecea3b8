//! Models in projected coordinates, put where these say on the earth.

use super::glb::Glb;
use super::harness::Folder;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

/// Half of the equator's diameter in metres, and the flattening (WGS 84).
const A: f64 = 6_378_137.0;
const F: f64 = 1.0 / 298.257_223_563;

/// Easting and northing in zone 33 of UTM, by Krüger's series (Karney 2011, equations 35 and 36, to the fourth order).
fn utm33([longitude, latitude]: [f64; 2]) -> [f64; 2] {
    let n = F / (2.0 - F);
    let (n2, n3, n4) = (n * n, n * n * n, n * n * n * n);
    let radius = A / (1.0 + n) * (1.0 + n2 / 4.0 + n4 / 64.0);
    let alpha = [
        n / 2.0 - 2.0 / 3.0 * n2 + 5.0 / 16.0 * n3 + 41.0 / 180.0 * n4,
        13.0 / 48.0 * n2 - 3.0 / 5.0 * n3 + 557.0 / 1440.0 * n4,
        61.0 / 240.0 * n3 - 103.0 / 140.0 * n4,
        49_561.0 / 161_280.0 * n4,
    ];
    let e = (F * (2.0 - F)).sqrt();
    let (tau, lambda) = (latitude.to_radians().tan(), (longitude - 15.0).to_radians());
    let sigma = (e * (e * tau / tau.hypot(1.0)).atanh()).sinh();
    let conformal = tau * sigma.hypot(1.0) - sigma * tau.hypot(1.0);
    let xi = conformal.atan2(lambda.cos());
    let eta = (lambda.sin() / conformal.hypot(lambda.cos())).asinh();
    let (mut x, mut y) = (eta, xi);
    for (j, alpha) in (1..).zip(alpha) {
        let twice = 2.0 * f64::from(j);
        x += alpha * (twice * xi).cos() * (twice * eta).sinh();
        y += alpha * (twice * xi).sin() * (twice * eta).cosh();
    }
    [500_000.0 + 0.9996 * radius * x, 0.9996 * radius * y]
}

/// Coordinates about the middle of the earth.
fn earth([longitude, latitude, height]: [f64; 3]) -> [f64; 3] {
    let [(so, co), (sa, ca)] = [longitude, latitude].map(|degrees: f64| degrees.to_radians().sin_cos());
    let squared = F * (2.0 - F);
    let across = A / (1.0 - squared * sa * sa).sqrt();
    [(across + height) * ca * co, (across + height) * ca * so, (across * (1.0 - squared) + height) * sa]
}

const SIDE: usize = 48;

/// Hills of twenty kilometres by twenty, and where their vertices are on the earth.
pub(crate) fn hills(folder: &Folder) -> Vec<[f64; 3]> {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        SIDE * SIDE,
        2 * (SIDE - 1) * (SIDE - 1),
    );
    let mut places = Vec::new();
    for (i, j) in (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (i, j))) {
        let [s, t] = [i, j].map(|at| at as f64 / (SIDE - 1) as f64);
        let (longitude, latitude) = (13.2 + 0.3 * s, 52.4 + 0.18 * t);
        let height = 300.0 * (9.0 * s).sin() * (7.0 * t).cos();
        let [x, y] = utm33([longitude, latitude]);
        writeln!(text, "{x:.6} {y:.6} {height:.6}").expect("text");
        places.push(earth([longitude, latitude, height]));
    }
    for (i, j) in (0..SIDE - 1).flat_map(|j| (0..SIDE - 1).map(move |i| (i, j))) {
        let [a, b] = [j, j + 1].map(|j| j * SIDE + i);
        writeln!(text, "3 {a} {} {}\n3 {a} {} {b}", a + 1, b + 1, b + 1).expect("text");
    }
    folder.write("hills.ply", text);
    places
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("numbers").iter().map(|x| x.as_f64().expect("a number")).collect()
}

/// Whether a point is in a tile's box, and how far outside if not.
fn outside(tile: &Value, point: [f64; 3]) -> f64 {
    let volume = numbers(&tile["box"]);
    let way: [f64; 3] = std::array::from_fn(|axis| point[axis] - volume[axis]);
    let along = |axis: &[f64]| {
        let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
        (0..3).map(|k| way[k] * axis[k]).sum::<f64>().abs() / length - length
    };
    volume[3..].chunks(3).map(along).fold(0.0, f64::max)
}

/// Checks the boxes of a tile and of what is below it, and takes the positions of its leaves, which are meshes of the source.
fn walk(folder: &Folder, tile: &Value, leaves: &mut Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    let uri = tile["content"]["uri"].as_str().expect("a tile");
    let mut below = Vec::new();
    let children = tile["children"].as_array().cloned().unwrap_or_default();
    for child in &children {
        assert!(child["geometricError"].as_f64() < tile["geometricError"].as_f64());
        below.extend(walk(folder, child, leaves));
    }
    let mesh = Glb::read(&folder.read(&format!("tiles/{uri}"))).mesh;
    for position in &mesh.positions {
        let point = position.map(f64::from);
        assert!(outside(&tile["content"]["boundingVolume"], point) < 1e-3, "{uri}");
    }
    below.extend(&mesh.positions);
    assert!(below.iter().all(|point| outside(&tile["boundingVolume"], point.map(f64::from)) < 1e-3), "{uri}");
    if children.is_empty() {
        leaves.extend(&mesh.positions);
    }
    below
}

#[test]
fn tiles_of_projected_coordinates_stand_where_these_say() {
    let folder = Folder::new();
    let places = hills(&folder);
    folder.stdout("build hills.ply --cluster-triangles 512 --crs epsg:32633 -q");
    assert!(folder.stdout("info hills.chpm --settings").contains("EPSG:32633"));
    // The file says it, or whoever exports; and both are the same.
    folder.stdout("export hills.chpm --3dtiles tiles -q");
    folder.stdout("export hills.chpm --3dtiles told --crs 32633 -q");
    assert!(folder.read("tiles/tileset.json") == folder.read("told/tileset.json"));

    let set = json(&folder.path("tiles/tileset.json"));
    let matrix = numbers(&set["root"]["transform"]);
    let mut leaves = Vec::new();
    walk(&folder, &set["root"], &mut leaves);
    let mut farthest = 0.0_f64;
    for [x, y, z] in leaves.iter().map(|point| point.map(f64::from)) {
        let there: [f64; 3] = std::array::from_fn(|row| {
            matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row]
        });
        let squared = |place: &[f64; 3]| (0..3).map(|axis| (place[axis] - there[axis]).powi(2)).sum::<f64>();
        farthest = farthest.max(places.iter().map(squared).fold(f64::INFINITY, f64::min).sqrt());
    }
    // Singles of ten kilometres have steps of a millimetre.
    assert!(farthest < 0.01, "{farthest} m");
    // Where tiles meet, they have the same bits.
    let distinct: BTreeSet<[u32; 3]> = leaves.iter().map(|point| point.map(f32::to_bits)).collect();
    assert_eq!(distinct.len(), SIDE * SIDE);

    // Heights above the sea.
    folder.stdout("export hills.chpm --3dtiles sea --geoid 40 -q");
    let sea = numbers(&json(&folder.path("sea/tileset.json"))["root"]["transform"]);
    let lifted = (12..15).map(|at| (sea[at] - matrix[at]).powi(2)).sum::<f64>().sqrt();
    assert!((lifted - 40.0).abs() < 1e-6, "{lifted}");
    // A place that is given wins.
    folder.stdout("export hills.chpm --3dtiles placed --origin 0,0,0 --origin-at centre -q");
    let placed = numbers(&json(&folder.path("placed/tileset.json"))["root"]["transform"]);
    assert!((placed[12] - matrix[12]).abs() > 1e6);
}

#[test]
fn sections_are_in_longitude_and_latitude() {
    let folder = Folder::new();
    hills(&folder);
    folder.stdout("build hills.ply -q");
    let error = folder.stderr("section hills.chpm --every 100 -o lines.geojson -q", 2);
    assert!(error.contains("--crs"), "{error}");
    let error =
        folder.stderr("section hills.chpm --every 100 --origin 1,2,3 --geoid 40 -o lines.geojson -q", 2);
    assert!(error.contains("cannot be used"), "{error}");
    folder.stdout("section hills.chpm --every 100 --crs EPSG:32633 -o lines.geojson -q");
    let lines = json(&folder.path("lines.geojson"));
    let mut count = 0;
    for feature in lines["features"].as_array().expect("features") {
        for point in feature["geometry"]["coordinates"].as_array().expect("points") {
            let [longitude, latitude, height] = numbers(point)[..] else { panic!("{point}") };
            assert!((13.199..13.501).contains(&longitude) && (52.399..52.581).contains(&latitude), "{point}");
            assert!((height / 100.0 - (height / 100.0).round()).abs() < 1e-3, "{point}");
            count += 1;
        }
    }
    assert!(count > 100, "{count}");
}

#[test]
fn what_is_no_system_is_refused() {
    let folder = Folder::new();
    hills(&folder);
    folder.stdout("build hills.ply -q");
    for (words, told) in [
        ("--crs EPSG:4326", "no lengths on a map"),
        ("--crs EPSG:4978", "no lengths on a map"),
        ("--crs EPSG:2", "not known"),
        ("--crs utm33", "EPSG:32633"),
        ("--crs EPSG:32633 --origin 1,2,3", "cannot be used"),
        ("--crs EPSG:32633 --transform 1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1", "cannot be used"),
        ("--crs EPSG:32633 --up y", "--up"),
        ("--geoid 40", "--crs"),
        ("--geoid 40 --origin 1,2,3", "cannot be used"),
        ("--crs EPSG:32633 --geoid nan", "no number"),
    ] {
        let error = folder.stderr(&format!("export hills.chpm --3dtiles new -q {words}"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    assert!(!folder.path("new").exists());
}
