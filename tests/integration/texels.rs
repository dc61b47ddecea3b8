//! Colours of sheets, beside those of the source: how near they are, and how large texels are.

use super::harness::Folder;
use super::sheets::{BUILD, DARK, HEAD, LIGHT, SQUARES, board, centers, hills, png, textured};
use serde_json::Value;
use std::fmt::Write;

#[test]
fn colours_are_measured_beside_the_source() {
    let folder = textured();
    folder.stdout(&format!("build a.obj {BUILD}"));
    let words = "measure a.chpm --against a.obj --texture --samples 4 -q";
    let told: Value = serde_json::from_str(&folder.stdout(&format!("{words} --json"))).expect("JSON");
    let levels = told["levels"].as_array().expect("levels");
    let at = |row: &Value, key: &str| row[key].as_f64().expect("a number");
    // The finest mesh is the source's: nothing slides, and but for squares' sides colours are the source's.
    let finest = &levels[0];
    assert_eq!((at(finest, "level"), at(finest, "collapsed"), at(finest, "triangles")), (0.0, 0.0, 4608.0));
    assert!(at(finest, "median") < 4.0 && at(finest, "psnr") > 25.0, "{finest}");
    let slide = &finest["slide"];
    assert!(at(slide, "max") < 1e-4 && at(slide, "beyond") == 0.0, "{finest}");
    assert!(at(slide, "outside") < 0.001 * at(slide, "samples"), "{finest}");
    for row in levels {
        let slide = &row["slide"];
        assert!(at(slide, "samples") > 9.0 * at(slide, "outside"), "{row}");
        assert!(at(slide, "of_bound") < 1.0 && at(slide, "beyond") == 0.0, "{row}");
        assert!(at(row, "median") <= at(row, "p95") && at(row, "p95") <= at(row, "p99"), "{row}");
    }
    let coarsest = levels.last().expect("a level");
    assert!(at(&coarsest["slide"], "max") > 0.0 && at(coarsest, "psnr") < at(finest, "psnr"), "{coarsest}");
    let table = folder.stdout(words);
    assert!(table.contains("PSNR") && table.contains("level 0, 50 %"), "{table}");

    // A source of other colours is told from it.
    folder.write(
        "a.png",
        png(512, |u, v| board(u + 1.0 / f64::from(SQUARES), v).to_vec(), png::ColorType::Rgb),
    );
    let other: Value = serde_json::from_str(&folder.stdout(&format!("{words} --json"))).expect("JSON");
    assert!(at(&other["levels"][0], "median") > 100.0, "{other}");

    // What cannot be measured is refused by name.
    folder.stdout("build a.obj --texture vertices -o v.chpm -q");
    let error = folder.stderr("measure v.chpm --against a.obj --texture -q", 2);
    assert!(error.contains("no sheets"), "{error}");
    folder.stdout("synth sphere --triangles 500 -o s.ply -q");
    let error = folder.stderr("measure a.chpm --against s.ply --texture -q", 2);
    assert!(error.contains("no image"), "{error}");
    std::fs::remove_file(folder.path("a.png")).expect("an image");
    let error = folder.stderr("measure a.chpm --against a.obj --texture -q", 2);
    assert!(error.contains("no image"), "{error}");
    let error = folder.stderr("measure a.chpm --against a.obj --texture --memory 1M -q", 2);
    assert!(error.contains("--memory"), "{error}");
}

/// Each triangle shows one pixel of an image, and the next another: texels are as small as triangles ask for, not as large as pixels.
#[test]
fn palettes_keep_their_colours() {
    const CELLS: u32 = 8;
    let folder = Folder::new();
    // Of one hue: JPEG has colours more coarsely than light.
    let color = |cell: u32| [20 + 3 * cell as u8; 3];
    let at = |u: f64, v: f64| color((u * 8.0) as u32 + 8 * ((1.0 - v) * 8.0) as u32).to_vec();
    folder.write("a.png", png(CELLS, at, png::ColorType::Rgb));
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\n");
    let mut text = HEAD.to_owned();
    for cell in 0..CELLS * CELLS {
        let [u, v] = [cell % CELLS, cell / CELLS].map(|x| (f64::from(x) + 0.5) / f64::from(CELLS));
        writeln!(text, "vt {u} {}", 1.0 - v).expect("text");
    }
    let mut number = 0;
    for line in hills(24, "", |x, y| [x, y]).lines().filter(|line| !line.starts_with("vt")) {
        let Some(corners) = line.strip_prefix("f ") else {
            writeln!(text, "{line}").expect("text");
            continue;
        };
        let vertices: Vec<&str> = corners.split(' ').filter_map(|corner| corner.split('/').next()).collect();
        for [b, c] in [[1, 2], [2, 3]] {
            number += 1;
            let cell = number * 37 % (CELLS * CELLS) + 1;
            let [a, b, c] = [0, b, c].map(|corner: usize| vertices[corner]);
            writeln!(text, "f {a}/{cell} {b}/{cell} {c}/{cell}").expect("text");
        }
    }
    folder.write("a.obj", text);
    folder.stdout(&format!("build a.obj {BUILD}"));
    let told: Value = serde_json::from_str(
        &folder.stdout("measure a.chpm --against a.obj --texture --samples 8 -q --json"),
    )
    .expect("JSON");
    let finest = &told["levels"][0];
    assert!(finest["median"].as_f64() < Some(12.0), "{finest}");
}

/// An image that repeats a million times has no million times its texels.
#[test]
fn what_repeats_too_often_is_coarser() {
    let folder = Folder::new();
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\n");
    folder.write("a.png", png(64, |u, v| board(u, v).to_vec(), png::ColorType::Rgb));
    folder.write("a.obj", hills(24, HEAD, |x, y| [1000.0 * x, 1000.0 * y]));
    let told = folder.stdout(&format!("build a.obj {}", BUILD.replace("-q", "")));
    assert!(told.contains("1397.5 times coarser"), "{told}");
    let stats: Value = serde_json::from_str(&folder.stdout("stats a.chpm --json")).expect("JSON");
    let texels = stats["levels"][0]["sheets"]["texels"].as_f64().expect("a number");
    assert!(texels < 64.0 * 4096.0, "{texels}");
    folder.stdout("verify a.chpm --against a.obj -q");
    // As seen from afar: the mean of both colours.
    let mean = |i: usize| {
        let light = |x: u8| (f64::from(x) / 255.0).powf(2.2);
        (255.0 * ((light(LIGHT[i]) + light(DARK[i])) / 2.0).powf(1.0 / 2.2)) as u8
    };
    folder.stdout("extract a.chpm --triangles 500 --texture-size 1024 -o a.glb -q");
    let centers = centers(&folder, "a.glb");
    for i in 0..3 {
        let sum: u32 = centers.iter().map(|(_, color)| u32::from(color[i])).sum();
        let found = sum / centers.len() as u32;
        assert!(found.abs_diff(mean(i).into()) < 16, "{i}: {found}, not {}", mean(i));
    }
}
