//! Sections and contours as files, and what is refused.

use super::harness::Folder;
use serde_json::Value;

/// A sphere of radius 1 and a terrain, in small clusters.
fn site() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 6000 -o ball.ply -q");
    folder.stdout("build ball.ply -q --cluster-triangles 256");
    folder.stdout("synth terrain --triangles 6000 -o land.ply -q");
    folder.stdout("build land.ply -q --cluster-triangles 256");
    folder
}

fn told(folder: &Folder, words: &str) -> Value {
    serde_json::from_str(&folder.stdout(words)).expect("JSON")
}

#[test]
fn a_sphere_has_a_circle_for_a_section() {
    let folder = site();
    for plane in ["0,0,1:0", "1,0,0:0.001", "3,-2,1:0", "0,0,-1:-0.5"] {
        let value = told(&folder, &format!("section ball.chpm --plane {plane} -q --json"));
        let section = &value["sections"][0];
        let offset = section["offset"].as_f64().unwrap();
        let number = |key: &str| section[key].as_f64().unwrap();
        assert!(number("lines") == 1.0 && number("open_ends") == 0.0, "{plane}: {value}");
        let area = std::f64::consts::PI * (1.0 - offset * offset);
        assert!((number("area") / area - 1.0).abs() < 0.01, "{plane}: {value}");
        let length = std::f64::consts::TAU * (1.0 - offset * offset).sqrt();
        assert!((number("length") / length - 1.0).abs() < 0.01, "{plane}: {value}");
        assert!(value["pages"].as_u64() < Some(30) && value["pages_crossed"].as_u64() > Some(3), "{value}");
        assert!(value["preview"].is_null() && value["output"].is_null());
    }
    let text = folder.stdout("section ball.chpm --plane 0,0,1:0.5 -q");
    assert!(text.contains("open ends") && text.contains("read") && !text.contains("preview"), "{text}");
    let open = folder.stdout("section land.chpm --every 0.1 -q");
    assert!(open.contains("ends are open: the surface has a boundary there"), "{open}");
}

/// Boxes that overlap, as they come from programs that join nothing.
#[test]
fn where_solids_overlap_no_area_is_told() {
    let folder = Folder::new();
    let corners = |low: [f64; 3], side: f64| {
        let at = |i: u32| [0, 1, 2].map(|axis| low[axis] + side * f64::from(i >> axis & 1));
        (0..8).map(at).map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect::<String>()
    };
    let faces = |first: u32| {
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let told = quads.map(|quad: [u32; 4]| quad.map(|corner| (corner + first).to_string()).join(" "));
        told.map(|quad| format!("f {quad}\n")).concat()
    };
    for x in [0.3, 0.5, 0.7, 0.9, 1.1] {
        let boxes = corners([0.0; 3], 1.0) + &corners([x, 0.11, 0.13], 0.9) + &faces(1) + &faces(9);
        folder.write("boxes.obj", boxes);
        folder.stdout("build boxes.obj -qf");
        let words = "section boxes.chpm --plane 0,0,1:0.5 -q";
        let value = told(&folder, &format!("{words} -o a.csv -f --json"));
        let section = &value["sections"][0];
        let csv = String::from_utf8(folder.read("a.csv")).unwrap();
        if x > 1.0 {
            assert!((section["area"].as_f64().unwrap() - 1.81).abs() < 1e-6, "{value}");
            assert!(section["crossing"] == 0 && value["warnings"].as_array().unwrap().is_empty(), "{value}");
            assert!(csv.contains("0.5,0,1,0,"), "{csv}");
            continue;
        }
        assert!(section["area"].is_null() && section["crossing"] == 2, "{value}");
        let warned = "2 closed lines cross others at 0.5: the area there is not told; solids overlap";
        assert_eq!(value["warnings"][0], warned);
        assert!(folder.stderr(words, 0).contains(warned));
        assert!(csv.contains("0.5,0,1,,"), "{csv}");
    }
}

/// All formats have all points of all lines.
#[test]
fn formats_have_the_same_lines() {
    let folder = site();
    let words = "section land.chpm --every 0.05 -q";
    let value = told(&folder, &format!("{words} -o land.csv --json"));
    let sections = value["sections"].as_array().unwrap();
    let sum = |key: &str| sections.iter().map(|section| section[key].as_u64().unwrap()).sum::<u64>();
    let (points, lines, closed) = (sum("points"), sum("lines"), sum("closed"));
    assert!(lines > closed && closed > 0 && sections.len() > 2, "{value}");

    let csv = String::from_utf8(folder.read("land.csv")).unwrap();
    assert!(csv.starts_with("offset,line,closed,depth,x,y,z\n"), "{csv}");
    assert_eq!(csv.lines().count() as u64, 1 + points + closed);
    for row in csv.lines().skip(1) {
        let numbers: Vec<f64> = row.split(',').map(|number| number.parse().unwrap()).collect();
        // A point is on its plane, to the last digit.
        assert!((numbers[0] - numbers[6]).abs() < 1e-8, "{row}");
    }

    folder.stdout(&format!("{words} -o land.dxf"));
    let dxf = String::from_utf8(folder.read("land.dxf")).unwrap();
    let count = |word: &str| dxf.lines().filter(|line| *line == word).count() as u64;
    assert_eq!((count("POLYLINE"), count("VERTEX"), count("SEQEND")), (lines, points, lines));
    assert!(count("LAYER") > 2 && count("Z_-0_05") > 1 && dxf.ends_with("0\nEOF\n"), "{dxf}");
    // Groups of a code and a value: an even number of lines.
    assert_eq!(dxf.lines().count() % 2, 0);

    folder.stdout(&format!("{words} -o land.svg --unit km --scale 1:10000"));
    let svg = String::from_utf8(folder.read("land.svg")).unwrap();
    assert_eq!(svg.matches('M').count() as u64, lines);
    assert_eq!(svg.matches('Z').count() as u64, closed);
    assert!(svg.contains(">-0.05</text>") && svg.contains("1:10000") && svg.contains("km</text>"), "{svg}");
    // A kilometre is 100 mm, and the terrain is one by one; with the margins.
    let width = svg.split_once("width=\"").and_then(|(_, rest)| rest.split_once("mm")).unwrap().0;
    assert!((110.0..=116.5).contains(&width.parse::<f64>().unwrap()), "{width}");

    folder.stdout(&format!("{words} -o land.geojson --origin 13.4,52.5,34"));
    let json: Value = serde_json::from_slice(&folder.read("land.geojson")).unwrap();
    let features = json["features"].as_array().unwrap();
    assert_eq!(features.len() as u64, lines);
    let coordinates = |feature: &Value| feature["geometry"]["coordinates"].as_array().unwrap().clone();
    assert_eq!(features.iter().map(|f| coordinates(f).len() as u64).sum::<u64>(), points + closed);
    for feature in features {
        let elevation = feature["properties"]["elevation"].as_f64().unwrap();
        for point in coordinates(feature) {
            let [x, y, z] = [0, 1, 2].map(|i| point[i].as_f64().unwrap());
            // A unit is a metre: within two of the place, and as high above it as the plane is.
            let is_near = (x - 13.4).abs() < 3e-5 && (y - 52.5).abs() < 2e-5;
            assert!(is_near && (z - 34.0 - elevation).abs() < 1e-3, "{point} {elevation}");
        }
    }
}

#[test]
fn lines_of_the_smallest_models_have_all_digits() {
    let folder = Folder::new();
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 4\nproperty list uchar int vertex_indices\nend_header\n";
    let corners = "0 0 0\n4e-20 0 0\n0 4e-20 0\n0 0 4e-20\n";
    folder.write("dot.ply", format!("{header}{corners}3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"));
    folder.stdout("build dot.ply -q");
    folder.stdout("section dot.chpm --plane 0,0,1:1e-20 -o dot.csv -q");
    let rows = String::from_utf8(folder.read("dot.csv")).expect("text");
    let farthest = rows.lines().skip(1).filter_map(|row| row.split(',').nth(4)?.parse().ok());
    let farthest = farthest.fold(0.0, f64::max);
    assert!((farthest - 3e-20).abs() < 1e-26, "{rows}");
}

#[test]
fn neither_threads_nor_orders_nor_packing_nor_memory_show() {
    let folder = site();
    folder.stdout("relayout land.chpm -o levels.chpm --order levels -q");
    folder.stdout("relayout levels.chpm -o packed.chpm --pages packed --order splits -q");
    let cut = |file: &str, more: &str| {
        folder.stdout(&format!("section {file} --every 0.002 -o - -q --threads {more}"))
    };
    for format in ["csv", "dxf"] {
        let cut = |file: &str, more: &str| {
            let name = format!("out.{format}");
            folder.stdout(&format!("section {file} --every 0.002 -o {name} -qf --threads {more}"));
            folder.read(&name)
        };
        let expected = cut("land.chpm", "1");
        assert!(expected.len() > 10_000);
        for (file, more) in
            [("land.chpm", "3"), ("land.chpm", "1 --memory 80M"), ("levels.chpm", "2"), ("packed.chpm", "1")]
        {
            assert!(cut(file, more) == expected, "{file} {more} {format}");
        }
    }
    let svg = cut("land.chpm", "2");
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"), "to standard output: {svg}");
}

#[test]
fn a_preview_says_that_it_is_one() {
    let folder = site();
    let words = "section ball.chpm --plane 0,0,1:0.1 --preview 0.05 -q";
    let value = told(&folder, &format!("{words} --json"));
    let within = value["preview"].as_f64().unwrap();
    assert!(within > 0.0 && within <= 0.05, "{value}");
    assert_eq!(value["open_ends"], 0);
    let whole = told(&folder, "section ball.chpm --plane 0,0,1:0.1 -q --json");
    assert!(value["sections"][0]["points"].as_u64() < whole["sections"][0]["points"].as_u64());
    let text = folder.stdout(&format!("{words} -o a.svg"));
    assert!(text.contains("nothing bounds how far the source's own lines are"), "{text}");
    assert!(String::from_utf8(folder.read("a.svg")).unwrap().contains("preview, not exact"));
}

#[test]
fn what_makes_no_sense_is_refused_with_a_remedy() {
    let folder = site();
    let before = folder.names();
    for (words, told) in [
        ("", "--plane"),
        ("--plane 0,0,1:0 --every 1", "--every"),
        ("--plane 0,0,0:1", "no direction"),
        ("--plane 0,0,1", "as in 0,0,1:2.5"),
        ("--plane 0,0,1:1m", "--unit m"),
        ("--every 1m", "--unit m"),
        ("--every 0", "all planes"),
        ("--every 1e-9", "take a larger step"),
        ("--every 0.1 --axis w", "--axis"),
        ("--plane 0,0,1:0 -o a.geojson", "--origin LON,LAT,H"),
        ("--plane 0,0,1:0 -o a.shp", "section writes SVG, DXF, GeoJSON and CSV"),
        ("--plane 0,0,1:0 -o a.png", "PNG"),
        ("--plane 0,0,1:0 -o a.csv --scale 1:5 --unit m", "--scale is that of an SVG"),
        ("--plane 0,0,1:0 -o a.svg --scale 1:5", "--unit"),
        ("--plane 0,0,1:0 -o a.geojson --origin 13,52,0 --unit km", "--unit is another"),
        ("--plane 0,0,1:0 -o a.geojson --crs EPSG:32633 --unit ft", "--unit is another"),
        ("--plane 0,0,1:0 -o a.csv --origin 13,52,0", "are for GeoJSON"),
        ("--plane 0,0,1:0 -o a.dxf --crs EPSG:32633", "are for GeoJSON"),
        ("--plane 0,0,1:0 --memory 1M", "--memory"),
    ] {
        let error = folder.stderr(&format!("section ball.chpm -q {words}"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    assert_eq!(folder.names(), before);
    let feet = folder.stdout("section ball.chpm --every 0.3048 -q");
    assert!(feet.contains(" 0.9144 ") && feet.contains(" -0.3048 "), "{feet}");
    let tenths = folder.stdout("section ball.chpm --every 0.1 -q");
    assert!(tenths.contains(" 0.3 ") && !tenths.contains("00000"), "{tenths}");
    let beside = folder.stderr("section ball.chpm --plane 0,0,1:5 -q -o a.svg", 0);
    assert!(beside.contains("no plane cuts the model"), "{beside}");
    let nothing = folder.stdout("section ball.chpm --plane 0,0,1:5 -q --json");
    assert!(!nothing.contains("-0"), "{nothing}");
}
