//! Pictures, and camera paths in pictures.

use super::harness::{Folder, text};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

fn built() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 20000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 128");
    folder
}

/// Width, height, and the pixels of a picture.
pub(super) fn picture(folder: &Folder, name: &str) -> (u32, u32, Vec<[u8; 4]>) {
    let mut reader = png::Decoder::new(Cursor::new(folder.read(name))).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a small PNG")];
    let info = reader.next_frame(&mut bytes).expect("a PNG");
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgba, png::BitDepth::Eight));
    (info.width, info.height, bytes.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect())
}

pub(super) fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("valid JSON")
}

#[test]
fn a_picture_shows_the_model_before_its_background() {
    let folder = built();
    let out = folder.stdout("render in.chpm --viewport 200x120 --background 102030 -o a.png");
    assert!(out.contains("a.png") && out.contains("triangles"), "{out}");
    let (width, height, pixels) = picture(&folder, "a.png");
    assert_eq!((width, height), (200, 120));
    for corner in [0, 199, 119 * 200, 119 * 200 + 199] {
        assert_eq!(pixels[corner], [0x10, 0x20, 0x30, 255]);
    }
    let model = pixels.iter().filter(|pixel| pixel[..3] != [0x10, 0x20, 0x30]).count();
    let shades: BTreeSet<&[u8; 4]> = pixels.iter().collect();
    assert!(model > 2000 && model < 200 * 120 * 2 / 3 && shades.len() > 50, "{model}, {}", shades.len());
    // The same from the other side of the command line.
    folder.stdout("render in.chpm --viewport 200x120 --background #102030 --no-occlusion -o b.png");
    assert_eq!(folder.read("a.png"), folder.read("b.png"), "what is hidden does not show");
    // What a studio darkens is seen on a light one.
    for (words, is_light) in [("--studio", true), ("--studio --background 102030", false), ("", false)] {
        folder.stdout(&format!("render in.chpm --viewport 200x120 {words} -o a.png -f"));
        let [red, ..] = picture(&folder, "a.png").2[0];
        assert_eq!(red > 200, is_light, "{words}: {red}");
    }
    let error = folder.stderr("render in.chpm -o a.png", 2);
    assert!(error.contains("--force"), "{error}");
}

/// Programs that are started by others often have none.
#[test]
fn a_folder_of_the_session_is_not_missed() {
    let folder = built();
    for (name, value) in [("a.png", None), ("b.png", Some(""))] {
        let mut command = folder.command(&format!("render in.chpm --viewport 64x64 -o {name} -q"));
        command.env_remove("XDG_RUNTIME_DIR").envs(value.map(|value| ("XDG_RUNTIME_DIR", value)));
        let out = command.output().expect("a process");
        assert!(out.status.success());
        assert_eq!(text(&out.stderr), "", "{name}");
    }
    assert_eq!(folder.read("a.png"), folder.read("b.png"));
}

/// Single precision puts points of a face on either side of the plane that it lies in: it is kept, and has no stripes.
#[test]
fn what_lies_in_a_clipping_plane_is_left() {
    let folder = Folder::new();
    folder.write("a.obj", "v -1.1 -0.7 0.25\nv 1.3 -0.9 0.25\nv 0.9 1.2 0.25\nv -0.8 1.1 0.25\nf 1 2 3 4\n");
    folder.stdout("build a.obj -o a.chpm -q");
    for eye in ["0.3,-5.1,3.7", "2.9,1.3,0.9", "-4.7,3.1,2.3"] {
        let draw = |clip: &str| {
            let words =
                format!("render a.chpm --camera {eye},0.1,0.2,0.25,45 --viewport 200x150 --samples 1 {clip}");
            folder.stdout(&format!("{words} -f -o a.png"));
            folder.read("a.png")
        };
        let whole = draw("");
        assert!(["--clip z:0.25", "--clip -z:0.25"].iter().all(|clip| draw(clip) == whole), "{eye}");
        assert!(draw("--clip z:0.2499") != whole, "{eye}");
    }
}

#[test]
fn packed_pages_draw_what_raw_ones_draw() {
    let folder = built();
    folder.stdout("relayout in.chpm -o packed.chpm --pages packed --order levels -q");
    for how in ["--poe 0.5", "--poe 8 --smooth", "--triangles 3000 --memory 1M"] {
        let draw = |name: &str| {
            folder.stdout(&format!("render {name} --viewport 200x120 {how} -o a.png -f"));
            folder.read("a.png")
        };
        assert!(draw("in.chpm") == draw("packed.chpm"), "{how}");
    }
}

/// Columns and rows of what is not background.
fn extent(folder: &Folder, name: &str) -> [u32; 4] {
    let (width, _, pixels) = picture(folder, name);
    let shown = (0..).zip(&pixels).filter(|(_, pixel)| pixel[..3] != [0x10, 0x20, 0x30]);
    shown.fold([u32::MAX, 0, u32::MAX, 0], |[left, right, top, bottom], (place, _): (u32, _)| {
        let (x, y) = (place % width, place / width);
        [left.min(x), right.max(x), top.min(y), bottom.max(y)]
    })
}

/// A roof on four walls that is open below: a house, `up` upward.
pub(super) fn house(folder: &Folder, up: usize, far: f64) {
    let corners = [
        [0, 0, 0],
        [4, 0, 0],
        [4, 6, 0],
        [0, 6, 0],
        [0, 0, 7],
        [4, 0, 7],
        [4, 6, 7],
        [0, 6, 7],
        [2, 0, 9],
        [2, 6, 9],
    ];
    let faces = [
        "4 0 1 5 4",
        "4 1 2 6 5",
        "4 2 3 7 6",
        "4 3 0 4 7",
        "3 4 5 8",
        "3 6 7 9",
        "4 5 6 9 8",
        "4 7 4 8 9",
        "4 3 2 1 0",
    ];
    let header = "ply\nformat ascii 1.0\nelement vertex 10\nproperty double x\nproperty double y\nproperty double z\n\
                  element face 9\nproperty list uchar int vertex_indices\nend_header\n";
    let vertex = |corner: &[i32; 3]| {
        let turned: Vec<String> =
            (0..3).map(|axis| (f64::from(corner[(axis + 5 - up) % 3]) + far).to_string()).collect();
        turned.join(" ")
    };
    let lines: Vec<String> = corners.iter().map(vertex).chain(faces.map(str::to_owned)).collect();
    folder.write("house.ply", format!("{header}{}\n", lines.join("\n")).as_bytes());
    folder.stdout("build house.ply -qf");
}

#[test]
fn a_model_stands_upright_and_fills_the_picture() {
    let folder = Folder::new();
    for (up, name) in [(1, "y"), (2, "z")] {
        house(&folder, up, [0.0, 3e6, -4e5][up]);
        for (viewport, sides) in [("200x120", [2, 3]), ("90x220", [0, 1])] {
            let words = format!("render house.chpm --viewport {viewport} --background 102030 -o a.png -f");
            let told = folder.stdout(&words);
            assert!(told.contains(&format!("up is {name}")) && told.contains("--up"), "{told}");
            let (width, height, _) = picture(&folder, "a.png");
            let [left, right, top, bottom] = extent(&folder, "a.png");
            let free = [left, width - 1 - right, top, height - 1 - bottom];
            // Nothing is cut off, and little is left over on the two sides that are near.
            assert!(free.iter().all(|pixels| *pixels > 0), "{viewport}: {free:?}");
            assert!(
                sides.iter().all(|side| free[*side] <= 1 + width.max(height) / 20),
                "{viewport}: {free:?}"
            );
            // The roof is above: the upper half is narrower.
            let (_, _, pixels) = picture(&folder, "a.png");
            let covered = |rows: std::ops::Range<u32>| {
                let row = |y: u32| &pixels[(y * width) as usize..((y + 1) * width) as usize];
                rows.flat_map(row).filter(|pixel| pixel[..3] != [0x10, 0x20, 0x30]).count()
            };
            let (rows, middle) = (bottom - top, top + (bottom - top) / 2);
            assert!(covered(top..top + rows / 5) < covered(middle..middle + rows / 5), "{viewport}, {name}");
        }
    }
    // The camera is told to programs; what was asked for is not explained.
    let camera = |words: &str| {
        let out =
            json(&folder.stdout(&format!("render house.chpm --viewport 60x60 --json -o a.png -f {words}")));
        (out["camera"]["up"].clone(), out["stance"].clone())
    };
    assert_eq!(camera("--up -y --view top"), (json("[0.0, -1.0, 0.0]"), "".into()));
    assert_eq!(camera("--camera 1,2,3,4,5,6 --up z"), (json("[0.0, 0.0, 1.0]"), Value::Null));
    folder.chpm("render house.chpm -o b.png --camera 1,2,3,4,5,6 --view top").code(2);
    assert!(folder.stderr("render house.chpm -o b.png --up w", 2).contains("-z"));
}

#[test]
fn samples_smooth_edges_and_nothing_lies_behind() {
    let folder = built();
    let alphas = |words: &str| {
        folder.stdout(&format!("render in.chpm --viewport 120x90 --transparent -o a.png -f {words}"));
        let pixels = picture(&folder, "a.png").2;
        // Where there is nothing, there is no colour; where there is a little, it is the model's and not black.
        assert!(pixels.iter().all(|pixel| pixel[3] > 0 || *pixel == [0; 4]));
        assert!(pixels.iter().all(|pixel| pixel[3] == 0 || pixel[..3].iter().all(|c| *c > 20)));
        pixels.into_iter().map(|pixel| pixel[3]).collect::<BTreeSet<u8>>()
    };
    assert_eq!(alphas("--samples 1"), BTreeSet::from([0, 255]));
    assert_eq!(alphas("--samples 4"), BTreeSet::from([0, 64, 128, 191, 255]));
    assert!(alphas("").len() > 5, "smooth if nothing else is told");
    let error = folder.stderr("render in.chpm -o b.png --transparent --background ffffff", 2);
    assert!(error.contains("--background"), "{error}");
    folder.chpm("render in.chpm -o b.png --samples 0").code(2);
}

#[test]
fn a_mesh_is_drawn_at_once_and_leaves_nothing() {
    let folder = built();
    std::fs::create_dir(folder.path("tmp")).expect("a folder");
    folder.stdout("synth torus --triangles 2000 -o torus.ply -q");
    let before = folder.names();
    let draw = |words: &str| {
        let mut command = folder.command(&format!("render torus.ply --viewport 60x60 {words}"));
        let out = command.env("TMPDIR", folder.path("tmp")).output().expect("an end");
        (out.status.code(), text(&out.stdout) + &text(&out.stderr))
    };
    let (code, told) = draw("-o a.png");
    assert!(code == Some(0) && told.contains("a.png") && told.contains("..."), "progress is shown: {told}");
    assert_eq!(draw("-o a.png").0, Some(2), "it is there already");
    let (code, told) = draw("-q -f -o a.png");
    assert!(code == Some(0) && !told.contains("..."), "{told}");
    folder.stdout("build torus.ply -q");
    folder.stdout("render torus.chpm --viewport 60x60 -o b.png");
    assert!(folder.read("a.png") == folder.read("b.png"), "the same as of its file");
    for name in ["a.png", "b.png", "torus.chpm"] {
        std::fs::remove_file(folder.path(name)).expect("removed");
    }
    assert_eq!(folder.names(), before);
    assert_eq!(std::fs::read_dir(folder.path("tmp")).expect("a folder").count(), 0);
    for name in ["a.jpg", "a.webp"] {
        let (code, told) = draw(&format!("-o {name}"));
        assert!(code == Some(2) && told.contains(".png") && told.contains(name), "{told}");
    }
}

#[test]
fn several_views_come_in_several_pictures_or_in_one() {
    let folder = built();
    let names = ["t-01.png", "t-02.png", "t-10.png"];
    let out = folder.stdout("render in.chpm --viewport 50x40 --turntable 10 -o t.png");
    assert!(out.contains("10 views"), "{out}");
    assert_eq!(folder.names().iter().filter(|name| name.starts_with("t-")).count(), 10);
    for name in names {
        let (width, height, _) = picture(&folder, name);
        assert_eq!((width, height), (50, 40));
    }
    // All of them, the first at the top left.
    folder.stdout("render in.chpm --viewport 50x40 --turntable 10 --contact-sheet -o sheet.png");
    let (width, height, pixels) = picture(&folder, "sheet.png");
    assert_eq!((width, height), (200, 120));
    let first = picture(&folder, "t-01.png").2;
    let same =
        |from: usize, to: usize| (from..to).all(|row| pixels[row * 200..][..50] == first[row * 50..][..50]);
    // But for its name, in the corner.
    assert!(same(0, 12) && !same(20, 40));
    // Six sides of a house, of which the right and the left one look the same, and the roof like no other.
    house(&folder, 2, 0.0);
    let out = json(&folder.stdout("render house.chpm --viewport 50x80 --contact-sheet -o six.png --json"));
    assert_eq!((&out["views"], &out["image"]["width"]), (&6.into(), &150.into()));
    let (_, _, pixels) = picture(&folder, "six.png");
    let rows = |x: usize, y: usize, from: usize, to: usize| -> Vec<[u8; 4]> {
        (from..to).flat_map(|row| pixels[(80 * y + row) * 150 + 50 * x..][..50].to_vec()).collect()
    };
    let background = rows(0, 0, 0, 1)[0];
    let covered = |x, y| rows(x, y, 0, 55).iter().filter(|pixel| **pixel != background).count();
    let sides = [(0, 0), (1, 0), (0, 1), (1, 1)];
    let [front, right, back, left] = sides.map(|(x, y)| covered(x, y));
    // Each has a name of its own below.
    let names: BTreeSet<Vec<[u8; 4]>> = sides.iter().map(|(x, y)| rows(*x, *y, 60, 80)).collect();
    assert_eq!(names.len(), 4);
    assert!(
        front.abs_diff(back) < 20 && right.abs_diff(left) < 20 && front != right,
        "{front} {right} {back} {left}"
    );
    for words in
        ["--turntable 3 -o -", "--turntable 0 -o x.png", "--turntable 3 --camera 0,0,0,1,1,1 -o x.png"]
    {
        folder.chpm(&format!("render in.chpm {words}")).code(2);
    }
}

#[test]
fn looks_look_different() {
    let folder = built();
    let looks =
        ["", "--shading flat", "--wireframe", "--color cluster", "--color level", "--color error", "--ids"];
    let pictures: BTreeSet<Vec<u8>> = looks
        .iter()
        .map(|look| {
            folder.stdout(&format!("render in.chpm --viewport 80x60 --poe 2 {look} -o a.png -f"));
            folder.read("a.png")
        })
        .collect();
    assert_eq!(pictures.len(), looks.len());
}

#[test]
fn one_side_shows_nothing_from_behind() {
    let folder = built();
    let shown = |words: &str| {
        folder.stdout(&format!(
            "render in.chpm --viewport 80x60 --samples 1 --background 102030 -o a.png -f {words}"
        ));
        picture(&folder, "a.png").2
    };
    // From outside, a closed surface hides its back.
    assert_eq!(shown(""), shown("--one-sided"));
    // From within, there is nothing else.
    let is_background = |pixel: &[u8; 4]| pixel[..3] == [0x10, 0x20, 0x30];
    let within = "--camera 0,0,0,0.1,0.2,1";
    assert!(!shown(within).iter().any(is_background));
    assert!(shown(&format!("{within} --one-sided")).iter().all(is_background));
}

#[test]
fn the_item_buffer_has_a_colour_for_each_triangle() {
    let folder = built();
    let render = |words: &str| {
        let out =
            folder.stdout(&format!("render in.chpm --viewport 200x150 --ids --json -o a.png -f {words}"));
        (picture(&folder, "a.png").2, json(&out)["frame"].clone())
    };
    let (culled, few) = render("--poe 0.1");
    let (all, many) = render("--poe 0.1 --no-occlusion");
    assert_eq!(culled, all);
    let number = |stats: &Value, name: &str| stats[name].as_u64().expect("a number");
    assert!(number(&few, "occluded") > 0 && number(&many, "occluded") == 0);
    assert!(number(&few, "triangles") < number(&many, "triangles"));
    let colors: BTreeSet<&[u8; 4]> = culled.iter().filter(|pixel| pixel[..3] != [0; 3]).collect();
    assert!(colors.len() > 200 && colors.len() as u64 <= number(&few, "triangles"), "{}", colors.len());
}

#[test]
fn accuracy_is_what_is_asked_for() {
    let folder = built();
    let triangles = |words: &str| {
        let out = folder.stdout(&format!("render in.chpm --no-occlusion --json -o a.png -f {words}"));
        json(&out)["frame"]["triangles"].as_u64().expect("a number")
    };
    let camera = "--camera 0.5,0.5,5,0,0,0 --viewport 300x200";
    for poe in ["1", "4"] {
        folder.stdout(&format!("extract in.chpm --poe {poe} {camera} -o x.ply -qf"));
        // All of the model is in the image, so nothing is culled.
        assert_eq!(
            triangles(&format!("--poe {poe} {camera}")),
            folder.read_mesh("x.ply").triangles.len() as u64
        );
    }
    let some = triangles("--triangles 3000");
    assert!((1500..=3150).contains(&some), "{some}");
}

#[test]
fn what_cannot_be_drawn_is_told_and_leaves_nothing() {
    let folder = built();
    folder.write("bad.chpm", "this is no model");
    let sound = folder.read("in.chpm");
    folder.write("short.chpm", &sound[..sound.len() / 2]);
    for (words, told) in [
        ("no.chpm", "no.chpm"),
        ("bad.chpm", "bad.chpm"),
        ("short.chpm", "short.chpm"),
        ("in.chpm --adapter nobody's", "nobody's"),
        ("in.chpm --viewport 0x10", "0x10"),
        ("in.chpm --camera 0,0,0,0,0,0", "camera"),
        ("in.chpm --poe -1", "-1"),
        ("in.chpm --color pink", "pink"),
        ("in.chpm --background pink", "pink"),
        ("in.chpm --ids --wireframe", "--wireframe"),
        ("in.chpm --ids --one-sided", "--one-sided"),
        ("in.chpm --gpu-memory 100", "GPU"),
    ] {
        let error = folder.stderr(&format!("render {words} -o out.png"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    assert_eq!(folder.names(), ["bad.chpm", "in.chpm", "in.ply", "short.chpm"]);
}

/// With environment variables set: what is told, by lines of both streams, and the exit code.
fn render_in(folder: &Folder, words: &str, environment: &[(&str, &str)]) -> (Option<i32>, String) {
    let mut command = folder.command(&format!("render in.chpm -f {words}"));
    let out = command.envs(environment.iter().copied()).output().expect("an end");
    (out.status.code(), text(&out.stdout) + &text(&out.stderr))
}

#[test]
fn every_interface_draws_the_same() {
    let folder = built();
    let camera = "--camera 0.3,0.2,1.4,0,0,0 --viewport 200x150 --poe 0.2 --adapter software";
    for (interface, name) in [("vulkan", ", vulkan,"), ("gl", ", gl,")] {
        for (culling, file) in [("", "culled"), ("--no-occlusion", "all")] {
            let words = format!("{camera} --ids {culling} -o {file}.png");
            let (code, told) = render_in(&folder, &words, &[("WGPU_BACKEND", interface)]);
            assert!(code == Some(0) && told.contains(name), "{interface} {culling}: {told}");
        }
        assert_eq!(folder.read("culled.png"), folder.read("all.png"), "{interface}");
        std::fs::rename(folder.path("all.png"), folder.path(&format!("{interface}.png"))).expect("renamed");
    }
    let (vulkan, gl) = (picture(&folder, "vulkan.png").2, picture(&folder, "gl.png").2);
    let differ = vulkan.iter().zip(&gl).filter(|(a, b)| a != b).count();
    // Only where an edge falls on the middle of a pixel.
    assert!(differ * 200 < vulkan.len(), "{differ} of {}", vulkan.len());
}

#[test]
fn no_adapter_is_told_with_a_remedy() {
    let folder = built();
    for environment in [
        &[("WGPU_BACKEND", "nothing")][..],
        &[("WGPU_BACKEND", "")],
        &[("WGPU_BACKEND", "metal")],
        &[("WGPU_BACKEND", "vulkan"), ("VK_ICD_FILENAMES", "/dev/null"), ("VK_DRIVER_FILES", "/dev/null")],
    ] {
        let (code, told) = render_in(&folder, "-o none.png", environment);
        assert!(code == Some(2) && told.contains("WGPU_BACKEND"), "{environment:?}: {told}");
        assert!(told.contains("mesa-vulkan-drivers") && !told.contains("panicked"), "{told}");
    }
    assert_eq!(folder.names(), ["in.chpm", "in.ply"]);
}

#[test]
fn an_adapter_is_looked_for_before_a_mesh_is_built() {
    let folder = built();
    let told = folder.stderr("render in.ply -o none.png --adapter nobody's", 2);
    assert!(told.contains("nobody's") && !told.contains("ingest"), "{told}");
}

/// Columns by name, for each of the two runs.
fn columns(folder: &Folder, name: &str) -> [BTreeMap<String, Vec<f64>>; 2] {
    let text = String::from_utf8(folder.read(name)).expect("text");
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let names = lines.next().expect("a line of names");
    assert_eq!(names[..2], ["culling", "frame"]);
    let mut runs = [BTreeMap::new(), BTreeMap::new()];
    for line in lines {
        assert_eq!(line.len(), names.len());
        let run = &mut runs[usize::from(line[0] == "0")];
        for (name, value) in names.iter().zip(&line) {
            let column: &mut Vec<f64> = run.entry(name.clone()).or_default();
            column.push(value.parse().expect("a number"));
        }
    }
    runs
}

#[test]
fn a_walk_in_pictures_has_numbers_for_every_frame() {
    let folder = built();
    folder.stdout("path orbit in.chpm --frames 6 -o cam.path");
    std::fs::create_dir(folder.path("frames")).expect("a folder");
    let words =
        "--render --wait --poe 0.1 --viewport 120x90 --csv out.csv --plot out.svg --images frames --json -q";
    let summary = json(&folder.stdout(&format!("walk in.chpm cam.path {words}")));
    let [on, off] = columns(&folder, "out.csv");
    for run in [&on, &off] {
        assert_eq!(run["frame"], (0..6).map(f64::from).collect::<Vec<_>>());
        let parts = ["refining_percent", "occlusion_percent", "rendering_percent", "stalling_percent"];
        for (frame, rate) in run["fps"].iter().enumerate() {
            assert!(*rate > 0.0 && run["triangles"][frame] > 0.0);
            let sum: f64 = parts.iter().map(|part| run[*part][frame]).sum();
            assert!((99.0..=150.0).contains(&sum), "{sum}");
        }
    }
    assert!(on["occluded"].iter().all(|n| *n > 0.0) && off["occluded"].iter().all(|n| *n == 0.0));
    assert!(on["triangles"].iter().zip(&off["triangles"]).all(|(on, off)| on < off));
    assert_eq!((&summary["frames"], &summary["runs"][1]["culling"]), (&6.into(), &false.into()));
    let mean = on["triangles"].iter().sum::<f64>() / 6.0;
    assert_eq!(summary["runs"][0]["mean"]["triangles"], mean);
    assert!(String::from_utf8(folder.read("out.svg")).expect("text").starts_with("<svg"));
    let frames: Vec<_> =
        (0..6).map(|frame| picture(&folder, &format!("frames/frame-{frame:05}.png"))).collect();
    assert!(frames.iter().all(|frame| (frame.0, frame.1) == (120, 90)) && frames[0] != frames[3]);
    // A frame of the walk is the picture of its camera.
    let cameras = String::from_utf8(folder.read("cam.path")).expect("text");
    let line = cameras.lines().last().expect("a camera");
    let six: Vec<&str> = line.split_whitespace().take(6).collect();
    folder.stdout(&format!(
        "render in.chpm --samples 1 --poe 0.1 --viewport 120x90 --camera {} -o a.png",
        six.join(",")
    ));
    assert_eq!(picture(&folder, "a.png"), frames[5]);
    assert!(folder.stderr(&format!("walk in.chpm cam.path {words}"), 2).contains("--force"));
}

#[test]
fn a_walk_in_pictures_tells_people_too() {
    let folder = built();
    folder.stdout("path dive in.chpm --frames 4 -o cam.path");
    let out = folder.stdout("walk in.chpm cam.path --render --viewport 64x64 --memory 4M --gpu-memory 4M -q");
    for told in ["4 frames", "culling on", "culling off", "fps", "front", "refining", "stalling"] {
        assert!(out.contains(told), "{told}: {out}");
    }
    // What belongs to the walk without pictures, and the other way round.
    folder.chpm("walk in.chpm cam.path --render --latency 3").code(2);
    for words in
        ["--plot x.svg", "--smooth", "--one-sided", "--color plain", "--adapter software", "--gpu-memory 4M"]
    {
        let error = folder.stderr(&format!("walk in.chpm cam.path {words}"), 2);
        assert!(error.contains("--render"), "{words}: {error}");
    }
}

#[test]
fn culling_is_proved_on_a_path() {
    let folder = built();
    folder.stdout("path dive in.chpm --frames 40 -o cam.path");
    let words = "walk in.chpm cam.path --render --prove --viewport 80x60 --poe 0.2 -q";
    let out = folder.stdout(words);
    assert!(out.contains("40 frames") && out.contains(" 0 of 192,000 pixels"), "{out}");
    let proof = json(&folder.stdout(&format!("{words} --json")));
    assert_eq!((&proof["different"], &proof["pixels"]), (&0.into(), &192_000.into()));
    let number = |name: &str| proof[name].as_u64().expect("a number");
    assert!(number("occluded") > 100 && number("frustum_culled") > 100, "{proof}");
    folder.chpm(&format!("{words} --csv out.csv")).code(2);
}

#[test]
fn damage_is_told_of_the_file_that_has_it() {
    let folder = built();
    let mut bytes = folder.read("in.chpm");
    let half = bytes.len() / 2;
    bytes[half..].iter_mut().for_each(|byte| *byte ^= 0xff);
    folder.write("bad.chpm", bytes);
    for words in ["bad.chpm", "in.chpm bad.chpm", "bad.chpm in.chpm"] {
        let told = folder.stderr(&format!("render {words} -o a.png --viewport 40x30"), 2);
        assert!(
            told.contains("'bad.chpm': page of cluster") && !told.contains("'in.chpm'"),
            "{words}: {told}"
        );
        assert!(told.contains("copy or build it again"), "{words}: {told}");
    }
}

#[test]
fn two_models_are_drawn_where_their_poses_put_them() {
    let folder = built();
    folder.stdout("synth torus --triangles 3000 -o other.ply -q");
    let wide = "--viewport 200x120 --background 102030 --camera 1.5,0,12,1.5,0,0 --samples 1";
    let draw = |words: &str| -> BTreeSet<usize> {
        folder.stdout(&format!("render {words} {wide} -q -f -o a.png"));
        let (_, _, pixels) = picture(&folder, "a.png");
        (0..pixels.len()).filter(|place| pixels[*place][..3] != [0x10, 0x20, 0x30]).collect()
    };
    // A mesh is built first.
    let alone = draw("in.chpm");
    let both = draw("in.chpm other.ply --pose 3,0,0");
    let other: BTreeSet<usize> = both.difference(&alone).copied().collect();
    assert!(alone.is_subset(&both) && other.len() > 200, "{} more", other.len());
    assert!(other.iter().all(|place| place % 200 > 90), "to the right");
    assert_eq!(draw("other.ply in.chpm --pose-a 3,0,0"), both, "it is the same the other way round");
    assert_eq!(draw("in.chpm in.chpm --pose 0,0,0"), alone, "one lies in the other");

    let out = folder.stdout("render in.chpm in.chpm --pose 3,0,0 -o b.png --viewport 80x60 --json");
    let one = folder.stdout("render in.chpm -o c.png --viewport 80x60 --poe 0 --json");
    assert!(json(&out)["frame"]["triangles"].as_u64() > Some(1000), "{out}");
    let all =
        "render in.chpm in.chpm --pose 3,0,0 -o b.png -f --viewport 80x60 --poe 0 --no-occlusion --json";
    let (all, one) = (json(&folder.stdout(all)), json(&one));
    assert!(all["frame"]["triangles"].as_u64() > one["frame"]["triangles"].as_u64());

    // In the item buffer, the first model's triangles have the colours that they have alone, and the second's have others.
    let items = |words: &str| {
        let camera = "--viewport 200x120 --camera 1.5,0,12,1.5,0,0";
        folder.stdout(&format!("render {words} {camera} --ids -q -f -o ids.png"));
        picture(&folder, "ids.png").2
    };
    let (one, two) = (items("in.chpm"), items("in.chpm other.ply --pose 3,0,0"));
    let black = [0, 0, 0, 255];
    assert!(one.iter().zip(&two).all(|(one, two)| *one == black || one == two));
    let (first, all) = (one.iter().collect::<BTreeSet<_>>(), two.iter().collect::<BTreeSet<_>>());
    assert!(first.len() > 50 && all.len() > first.len() + 50, "{} of {}", first.len(), all.len());

    for (words, told) in [
        ("in.chpm in.chpm --pose 2,0,0,1,0,2,0,0,0,0,2,0", "changes lengths"),
        ("in.chpm in.chpm --pose 1,0,0,0,0,1,0,0,0,0,-1,0", "mirrors"),
        ("in.chpm --pose 1,0,0", "second"),
        ("in.chpm none.chpm", "none.chpm"),
        ("in.chpm in.chpm --memory 1K", "memory"),
        ("in.chpm in.chpm -o in.chpm", "in.chpm"),
    ] {
        let output = if words.contains("-o") { "" } else { "-o d.png" };
        let error = folder.stderr(&format!("render {words} {output}"), 2);
        assert!(error.to_lowercase().contains(told), "{words}: {error}");
    }
}
