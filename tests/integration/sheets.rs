//! Sheets: images of clusters, from the sources' images to a GLB with atlases.

use super::harness::{Folder, was_killed};
#[cfg(feature = "viewer")]
use super::render::picture;
use chpm_mesh::TriMesh;
use std::fmt::Write;
use std::fs;
use std::process::Stdio;

/// Squares of the image's board, each way, and their two colours.
pub(crate) const SQUARES: u32 = 8;
pub(crate) const LIGHT: [u8; 3] = [230, 200, 60];
pub(crate) const DARK: [u8; 3] = [40, 60, 150];

pub(crate) fn board(u: f64, v: f64) -> [u8; 3] {
    let square = |x: f64| (x.rem_euclid(1.0) * f64::from(SQUARES)) as u32;
    if (square(u) + square(v)).is_multiple_of(2) { LIGHT } else { DARK }
}

pub(crate) fn png(side: u32, color: impl Fn(f64, f64) -> Vec<u8>, kind: png::ColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, side, side);
    encoder.set_color(kind);
    let at = |x: u32| (f64::from(x) + 0.5) / f64::from(side);
    let pixels: Vec<u8> =
        (0..side * side).flat_map(|pixel| color(at(pixel % side), 1.0 - at(pixel / side))).collect();
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(&pixels).expect("pixels");
    drop(writer);
    bytes
}

/// Hills over the unit square, with the board all over them.
pub(crate) fn hills(side: usize, head: &str, uv: impl Fn(f64, f64) -> [f64; 2]) -> String {
    let mut text = head.to_owned();
    let at = |x: usize| x as f64 / side as f64;
    for (x, y) in (0..=side).flat_map(|y| (0..=side).map(move |x| (at(x), at(y)))) {
        let z = 0.05 * ((17.0 * x).sin() * (13.0 * y).cos());
        let [u, v] = uv(x, y);
        writeln!(text, "v {x} {y} {z}\nvt {u} {v}").expect("text");
    }
    for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
        let [a, b] = [y, y + 1].map(|y| y * (side + 1) + x + 1);
        writeln!(text, "f {a}/{a} {0}/{0} {1}/{1} {b}/{b}", a + 1, b + 1).expect("text");
    }
    text
}

pub(crate) const HEAD: &str = "mtllib a.mtl\nusemtl a\n";
pub(crate) const BUILD: &str = "--texture sheets --cluster-triangles 512 -q";

pub(crate) fn textured() -> Folder {
    let folder = Folder::new();
    add_textured(&folder);
    folder
}

/// Hills with a board, `a.obj`.
pub(crate) fn add_textured(folder: &Folder) {
    folder.write("a.obj", hills(48, HEAD, |x, y| [x, y]));
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\n");
    folder.write("a.png", png(512, |u, v| board(u, v).to_vec(), png::ColorType::Rgb));
}

/// Texels in the middle of squares of the board, held against it.
fn check_board(folder: &Folder, glb: &str, place: impl Fn([f64; 2]) -> [f64; 2], least: usize) {
    let seen = seen_board(centers(folder, glb), glb, place);
    assert!(seen >= least, "{glb}: {seen} triangles");
}

fn seen_board(centers: Vec<([f64; 2], [u8; 3])>, glb: &str, place: impl Fn([f64; 2]) -> [f64; 2]) -> usize {
    let mut seen = 0;
    for (middle, color) in centers {
        let [u, v] = place(middle);
        let in_middle = |x: f64| ((x.rem_euclid(1.0) * f64::from(SQUARES)).fract() - 0.5).abs() < 0.12;
        if in_middle(u) && in_middle(v) {
            seen += 1;
            let expected = board(u, v);
            let off = color.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max();
            assert!(off <= Some(24), "{glb} at {middle:?}: {color:?}, not {expected:?}");
        }
    }
    seen
}

/// Squares of a finer board, each smaller than a triangle.
#[cfg(feature = "viewer")]
const FINE: u32 = 64;

/// The share of the fine board's squares that a picture from above shows in their own colour.
#[cfg(feature = "viewer")]
fn share_of_squares(folder: &Folder, name: &str, ask: &str) -> f64 {
    let camera = "--camera 0.5,0.5,3,0.5,0.5,0,19 --up y --viewport 1024x1024";
    folder.stdout(&format!("render {name}.chpm -o {name}.png -f -q {camera} {ask}"));
    let (width, height, pixels) = picture(folder, &format!("{name}.png"));
    // Half of the picture's side in the plane of the board, and where each square's middle is.
    let half = 3.0 * (19.0_f64 / 2.0).to_radians().tan();
    let (mut right, mut all) = (0.0, 0.0);
    // Not those of the rim, where the hills' height moves them most.
    for (column, row) in (8..FINE - 8).flat_map(|row| (8..FINE - 8).map(move |column| (column, row))) {
        let [x, y] = [column, row].map(|at| (f64::from(at) + 0.5) / f64::from(FINE));
        // The hills are nearer to the camera than the plane, or farther.
        let z = 0.05 * ((17.0 * x).sin() * (13.0 * y).cos());
        let [right_of, above] = [x, y].map(|at| (at - 0.5) * 3.0 / (3.0 - z) / half);
        let pixel = [(1.0 + right_of) / 2.0 * f64::from(width), (1.0 - above) / 2.0 * f64::from(height)];
        let [red, _, blue, _] = pixels[(pixel[1] as u32 * width + pixel[0] as u32) as usize];
        let is_light = (column + row).is_multiple_of(2);
        right += f64::from(u8::from(is_light == (red > blue)));
        all += 1.0;
    }
    right / all
}

#[cfg(feature = "viewer")]
#[test]
fn sheets_are_drawn() {
    let folder = textured();
    let fine = |u: f64, v: f64| board(u * f64::from(FINE / SQUARES), v * f64::from(FINE / SQUARES)).to_vec();
    folder.write("a.png", png(1024, fine, png::ColorType::Rgb));
    folder.stdout(&format!("build a.obj -o sheets.chpm {BUILD}"));
    folder.stdout(&format!("build a.obj -o vertices.chpm {}", BUILD.replace("sheets", "vertices")));
    for (ask, least) in [
        ("--adapter software --poe 0", 0.99),
        ("--adapter software --triangles 700", 0.9),
        ("--adapter software --smooth --poe 0.5 --samples 4", 0.99),
        ("--rays --poe 0 --samples 1 --occlusion 0 --no-shadows", 0.99),
        ("--rays --poe 2 --samples 1 --smooth --occlusion 0 --no-shadows", 0.99),
    ] {
        let [sheets, vertices] = ["sheets", "vertices"].map(|name| share_of_squares(&folder, name, ask));
        assert!(sheets >= least, "{ask}: {sheets} of the squares");
        assert!(vertices < 0.75, "{ask}: {vertices} without sheets");
    }
    // Where they find no room, that is said.
    let told = folder
        .stderr("render sheets.chpm -o few.png --adapter software --poe 0 --gpu-memory 1M -q --strict", 1);
    assert!(told.contains("without their texture") && told.contains("--gpu-memory"), "{told}");
    // Other colours are what they were.
    for colors in ["--color plain", "--color cluster", "--color plain --wireframe"] {
        let pictures = ["sheets", "vertices"].map(|name| {
            folder.stdout(&format!("render {name}.chpm -o {name}.png -f -q --adapter software {colors}"));
            folder.read(&format!("{name}.png"))
        });
        assert!(pictures[0] == pictures[1], "{colors}");
    }
}

#[test]
fn sheets_leave_the_geometry_alone() {
    let folder = textured();
    for (name, texture) in [("sheets", "sheets"), ("vertices", "vertices"), ("none", "none")] {
        let build = BUILD.replace("sheets", texture);
        folder.stdout(&format!("build a.obj -o {name}.chpm {build}"));
    }
    folder.stdout("verify sheets.chpm --against a.obj --cuts 3 -q");
    for other in ["vertices", "none"] {
        let told = folder.stdout(&format!("verify sheets.chpm --same-as {other}.chpm --geometry -q"));
        assert!(told.contains("has the geometry of"), "{told}");
        folder.stderr(&format!("verify sheets.chpm --same-as {other}.chpm -q"), 1);
    }
    // Whoever does not draw sheets has the colours of vertices, and is told.
    let told = folder.stderr("extract sheets.chpm --error 0 -o told.glb -q", 0);
    assert!(told.contains("--texture-size"), "{told}");
    let told = folder.stderr("extract sheets.chpm --error 0 -o plain.glb -q --no-colors", 0);
    assert!(!told.contains("--texture-size"), "{told}");
    for ask in ["--error 0", "--triangles 700"] {
        let taken = ["sheets", "vertices"].map(|name| {
            folder.stdout(&format!("extract {name}.chpm {ask} -o {name}.ply -q -f"));
            folder.read(&format!("{name}.ply"))
        });
        assert!(taken[0] == taken[1], "{ask}");
    }
    let told = folder.stdout("info sheets.chpm");
    assert!(told.contains("sheets     ") && told.contains("CHPM 1.6"), "{told}");
    assert!(!folder.stdout("info vertices.chpm").contains("sheets     "));
    assert!(folder.stdout("dump sheets.chpm").contains("sheet of cluster 0 "));
}

#[test]
fn any_memory_and_threads_give_the_same_sheets() {
    let folder = textured();
    let mut built = Vec::new();
    for resources in ["", "--threads 1", "--threads 8 --memory 128M", "--threads 3 --memory 160M"] {
        folder.stdout(&format!("build a.obj -o a.chpm -f {BUILD} {resources}"));
        built.push(folder.read("a.chpm"));
    }
    assert!(built.windows(2).all(|two| two[0] == two[1]));
}

#[test]
fn a_killed_build_goes_on_to_the_same_sheets() {
    let folder = textured();
    let build = format!("build a.obj -o a.chpm -f {BUILD} --checkpoint 0 --json");
    folder.stdout(&build);
    let whole = folder.read("a.chpm");
    let mut resumed = 0;
    for access in (40..400).step_by(60) {
        let mut command = folder.command(&format!("{build} --kill-at {access}"));
        let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status().expect("a process");
        if status.success() {
            break;
        }
        assert!(was_killed(status), "at access {access}");
        let report: serde_json::Value = serde_json::from_str(&folder.stdout(&build)).expect("a report");
        resumed += usize::from(report["resumed_after"].is_string());
        assert!(folder.read("a.chpm") == whole, "killed at access {access}");
    }
    assert!(resumed > 1, "{resumed}");
}

#[test]
fn extracted_images_show_what_the_source_did() {
    let folder = textured();
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    for (ask, least) in [("--error 0", 150), ("--triangles 1500", 40), ("--triangles 300", 6)] {
        for side in [256, 2048] {
            folder.stdout(&format!("extract a.chpm {ask} --texture-size {side} -o a.glb -q -f"));
            check_board(&folder, "a.glb", |place| place, least);
        }
    }
}

/// An OBJ and a PLY have images beside them and no seams; what is built from them shows the same.
#[test]
fn images_lie_beside_obj_and_ply() {
    let folder = textured();
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    folder.stdout("extract a.chpm --error 0 -o plain.ply -q");
    let plain = folder.read_mesh("plain.ply");
    for (name, beside) in [("b.obj", "b.mtl"), ("c.ply", "c.0.jpg")] {
        let command = format!("extract a.chpm --error 0 --texture-size 256 -q -o {name}");
        folder.stdout(&command);
        assert!(folder.names().contains(&beside.to_owned()), "{:?}", folder.names());
        folder.stderr(&command, 2);
        folder.stdout(&format!("{command} -f"));
        folder.stdout(&format!("build {name} -o back.chpm -f {BUILD}"));
        folder.stdout("extract back.chpm --error 0 --texture-size 2048 -o back.glb -q -f");
        check_board(&folder, "back.glb", |place| place, 150);
        folder.stdout("extract back.chpm --error 0 -o back.ply -q -f");
        let mesh = folder.read_mesh("back.ply");
        let counts = |mesh: &TriMesh| (mesh.positions.len(), mesh.triangles.len());
        assert_eq!(counts(&mesh), counts(&plain));
    }
}

#[test]
fn a_smaller_mesh_keeps_its_images() {
    let folder = textured();
    for asked in ["--triangles 1500", "--within 0.2%", "--within 0.2% --effort 1"] {
        folder.stdout(&format!("simplify a.obj {asked} --texture-size 1024 -o small.obj -q -f"));
        folder.stdout(&format!("build small.obj -o small.chpm -f {BUILD}"));
        folder.stdout("extract small.chpm --error 0 --texture-size 2048 -o small.glb -q -f");
        check_board(&folder, "small.glb", |place| place, 30);
    }
    let told = folder.stderr("simplify a.obj --within 1% --effort 2 --texture-size 1024 -o b.glb -q", 2);
    assert!(told.contains("--effort 1"), "{told}");
    folder.write("bare.obj", hills(12, "", |x, y| [x, y]));
    let told = folder.stderr("simplify bare.obj --triangles 50 --texture-size 1024 -o b.glb -q", 2);
    assert!(told.contains("no images"), "{told}");
    assert!(!folder.names().contains(&"b.glb".to_owned()));
}

/// Each tile shows its cluster's sheet, the two of a leaf one file.
#[test]
fn tiles_show_sheets() {
    let folder = textured();
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    folder.stdout("export a.chpm --3dtiles tiles -q");
    let entries = fs::read_dir(folder.path("tiles/tiles/000")).expect("a folder");
    let name = |entry: std::io::Result<fs::DirEntry>| entry.expect("a file").file_name();
    let tiles: Vec<String> = entries.map(|entry| name(entry).into_string().expect("a name")).collect();
    let named = |end: &str| tiles.iter().filter(|name| name.ends_with(end)).count();
    assert!(named("-finest.glb") > 4 && named("-finest.glb") == named(".jpg"), "{tiles:?}");
    let mut seen = 0;
    for name in tiles.iter().filter(|name| name.ends_with(".glb")) {
        let glb = format!("tiles/tiles/000/{name}");
        seen += seen_board(points_of(&folder, "a.chpm", &glb, &[[1.0 / 3.0; 3]]), &glb, |place| place);
    }
    assert!(seen > 400, "{seen} triangles");
    folder.stdout("export a.chpm --3dtiles packed --meshopt -q");
    let finest = tiles.iter().find(|name| name.ends_with("-finest.glb")).expect("a leaf");
    let bytes = |name: &str| folder.read(&format!("{name}/tiles/000/{finest}")).len();
    assert!(bytes("packed") < bytes("tiles"));
}

#[test]
fn layouts_take_sheets_along() {
    let folder = textured();
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    for how in ["--pages packed", "--order levels", "--pages packed --order levels"] {
        folder.stdout(&format!("relayout a.chpm -o b.chpm -q -f {how}"));
        folder.stdout("verify b.chpm --same-as a.chpm -q");
        folder.stdout("relayout b.chpm -o c.chpm -q -f --pages raw --order splits");
        assert!(folder.read("c.chpm") == folder.read("a.chpm"), "{how}");
    }
    folder.stdout(&format!("build a.obj -o b.chpm -f {BUILD} --pages packed"));
    folder.stdout("verify b.chpm --same-as a.chpm -q");
    // Vertices have other numbers then.
    folder.stdout(&format!("build a.obj -o b.chpm -f {BUILD} --order simplification"));
    folder.stdout("verify b.chpm -q");
}

#[test]
fn what_does_not_go_with_sheets_is_refused_in_words() {
    let folder = textured();
    for setting in ["--finest-error 1%", "--order cache-oblivious"] {
        // Nobody has asked for sheets then.
        let build = BUILD.replace("--texture sheets", "");
        folder.stdout(&format!("build a.obj -o unasked.chpm {build} -f {setting}"));
        assert!(folder.stdout("info unasked.chpm --json").contains(r#""texture": "vertices""#));
        let told = folder.stderr(&format!("build a.obj -o a.chpm {BUILD} {setting}"), 2);
        let name = setting.split(' ').next().expect("a name");
        assert!(told.contains(name) && told.contains("--texture vertices"), "{told}");
        assert!(!folder.names().contains(&"a.chpm".to_owned()));
    }
    folder.stdout("build a.obj -o a.chpm -q --texture vertices");
    let told = folder.stderr("extract a.chpm --error 0 --texture-size 512 -o a.glb -q", 2);
    assert!(told.contains("has no sheets") && told.contains("--texture sheets"), "{told}");
    folder.stdout(&format!("build a.obj -o a.chpm -f {BUILD}"));
    for output in ["a.stl", "a.ply --ascii", "- --format obj"] {
        let told = folder.stderr(&format!("extract a.chpm --error 0 --texture-size 512 -q -o {output}"), 2);
        assert!(told.contains("GLB"), "{told}");
    }
}

/// Sources as they come: each is built, verified, drawn, and shows what it should where that is known.
#[test]
fn hard_sources_have_sheets() {
    let folder = textured();
    let corner = |u: f64, v: f64| [if u > 0.9 { f64::NAN } else { u }, v];
    let bare = hills(24, "mtllib a.mtl\n", |x, y| [x, y]) + "usemtl a\nf 1/1 2/2 30/30\n";
    // In front, so that all other vertices have other numbers once it is gone.
    let mote = "vt 0 0\nvt 0.1 0\nvt 0 0.1\nv 0.5 0.5 2\nv 0.51 0.5 2\nv 0.5 0.51 2\nf 1/1 2/2 3/3\n";
    let behind = |text: &str| text.replace(HEAD, &format!("{HEAD}{mote}"));
    let dusty = behind(&hills(24, HEAD, |x, y| [x, y]));
    let dusty = dusty.lines().map(|line| match line.strip_prefix("f ") {
        Some(corners) if line != "f 1/1 2/2 3/3" => {
            let more =
                |corner: &str| corner.split('/').next().and_then(|v| v.parse::<usize>().ok()).map(|v| v + 3);
            let corners = corners.split(' ').filter_map(more).map(|v| format!(" {v}/{v}"));
            format!("f{}\n", corners.collect::<String>())
        }
        _ => format!("{line}\n"),
    });
    let dusty = dusty.collect::<String>();
    for (name, text) in [
        ("nan", hills(24, HEAD, corner).replace("NaN", "nan")),
        ("flat", hills(24, HEAD, |_, _| [0.3, 0.3])),
        ("repeat", hills(24, HEAD, |x, y| [2.0 * x - 0.5, 2.0 * y - 0.5])),
        ("mirrored", hills(24, HEAD, |x, y| [1.0 - x, y])),
        ("bare", bare),
        ("dusty", dusty),
    ] {
        folder.write(&format!("{name}.obj"), text);
        let dust = if name == "dusty" { " --min-component 10%" } else { "" };
        folder.stdout(&format!("build {name}.obj -o {name}.chpm {BUILD}{dust}"));
        folder.stdout(&format!("verify {name}.chpm --against {name}.obj -q"));
        let glb = format!("{name}.glb");
        folder.stdout(&format!("extract {name}.chpm --triangles 500 --texture-size 1024 -o {glb} -q"));
        match name {
            "mirrored" => check_board(&folder, &glb, |[x, y]| [1.0 - x, y], 8),
            "repeat" => check_board(&folder, &glb, |[x, y]| [2.0 * x - 0.5, 2.0 * y - 0.5], 8),
            "dusty" => check_board(&folder, &glb, |place| place, 8),
            "flat" => check_board(&folder, &glb, |_| [0.3125, 0.3125], 200),
            _ => assert!(centers(&folder, &glb).len() > 200, "{name}"),
        }
    }
}

/// A few triangles have all of an image, of more texels than the memory holds.
#[test]
fn a_sheet_that_needs_more_memory_is_refused_with_what_does_without() {
    let folder = Folder::new();
    folder.write("a.obj", hills(2, HEAD, |x, y| [x, y]));
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\n");
    folder.write("a.png", png(4096, |u, _| vec![(255.0 * u) as u8], png::ColorType::Grayscale));
    let told = folder.stderr("build a.obj -o a.chpm -q --memory 128M", 2);
    assert!(told.contains("--texture vertices") && told.contains("raise --memory"), "{told}");
    assert!(!folder.names().contains(&"a.chpm".to_owned()));
    folder.stdout("build a.obj -o a.chpm -q --memory 128M --texture vertices");
    folder.stdout("build a.obj -o a.chpm -q -f --memory 256M");
    assert!(folder.stdout("info a.chpm --settings").contains("leaf-triangles"));
}

/// Each triangle has a chart of its own in the source, in any order.
#[test]
fn sources_of_as_many_charts_as_triangles() {
    let folder = textured();
    let (side, across) = (16usize, 24usize);
    let mut text = HEAD.to_owned();
    let at = |x: usize| x as f64 / side as f64;
    for (x, y) in (0..=side).flat_map(|y| (0..=side).map(move |x| (at(x), at(y)))) {
        writeln!(text, "v {x} {y} {}", 0.1 * (3.0 * x).sin()).expect("text");
    }
    // Triangle n lies in the n-th square of a grid of the image, which has its colour.
    let mut count = 0;
    for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
        let [a, b] = [y, y + 1].map(|y| y * (side + 1) + x + 1);
        for [p, q, r] in [[a, a + 1, b + 1], [a, b + 1, b]] {
            let place = |i: usize, j: usize| {
                let [column, row] = [count * 7 % 576 % across, count * 7 % 576 / across];
                let inner =
                    |cell: usize, part: usize| (cell as f64 + 0.25 + 0.5 * part as f64) / across as f64;
                format!("vt {} {}\n", inner(column, i), inner(row, j))
            };
            text += &(place(0, 0) + &place(1, 0) + &place(0, 1));
            writeln!(text, "f {p}/-3 {q}/-2 {r}/-1").expect("text");
            count += 1;
        }
    }
    folder.write("many.obj", text);
    let cell = |x: f64| (x * across as f64) as usize;
    let color = |n: usize| [60 + n * 5 % 150, 60 + n * 11 % 150, 60 + n * 17 % 150].map(|part| part as u8);
    let paint = |u: f64, v: f64| {
        let number = cell(v) * across + cell(u);
        // The inverse of times 7 modulo 576.
        color(number * 247 % 576).to_vec()
    };
    assert_eq!(7 * 247 % 576, 1);
    folder.write("a.png", png(384, paint, png::ColorType::Rgb));
    folder.stdout("build many.obj -o many.chpm --texture sheets -q");
    folder.stdout("verify many.chpm --against many.obj -q");
    folder.stdout("extract many.chpm --level 0 --texture-size 1024 -o many.glb -q");
    // Where triangles are split from each other, a vertex has its triangle's colour alone.
    let mut fine = 0;
    for (triangle, color_found) in centers(&folder, "many.glb") {
        let [x, y] = triangle;
        let (column, row) = ((x * side as f64) as usize, (y * side as f64) as usize);
        let is_lower = (x * side as f64).fract() > (y * side as f64).fract();
        let expected = color(2 * (row * side + column) + usize::from(!is_lower));
        let off = color_found.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max();
        // A triangle has eight texels a side, and the image half as many of hue.
        fine += usize::from(off <= Some(40));
    }
    assert!(fine * 100 >= 97 * 512, "{fine} of 512 triangles have their colour");
}

/// Middles of the triangles of a GLB that was taken from a file, in the model's coordinates, and the texel of each.
pub(crate) fn centers(folder: &Folder, glb: &str) -> Vec<([f64; 2], [u8; 3])> {
    points_of(folder, &glb.replace(".glb", ".chpm"), glb, &[[1.0 / 3.0; 3]])
}

/// The same of points of each triangle, given the shares of its corners in them.
pub(crate) fn points_of(
    folder: &Folder,
    chpm: &str,
    glb: &str,
    shares: &[[f64; 3]],
) -> Vec<([f64; 2], [u8; 3])> {
    let text = folder.stdout(&format!("dump {chpm}"));
    let origin = text.split("origin [").nth(1).and_then(|rest| rest.split(']').next()).expect("an origin");
    let origin: Vec<f64> = origin.split(", ").map(|x| x.parse().expect("a number")).collect();
    let bytes = folder.read(glb);
    let len = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + len]).expect("JSON");
    let view = |number: &serde_json::Value| {
        let view = &json["bufferViews"][number.as_u64().expect("a number") as usize];
        let [start, len_of] =
            ["byteOffset", "byteLength"].map(|key| view[key].as_u64().expect("a number") as usize);
        bytes[28 + len + start..][..len_of].to_vec()
    };
    let accessor = |number: &serde_json::Value| {
        view(&json["accessors"][number.as_u64().expect("a number") as usize]["bufferView"])
    };
    let mut found = Vec::new();
    for (number, primitive) in json["meshes"][0]["primitives"].as_array().expect("a list").iter().enumerate()
    {
        let floats = |name: &str| -> Vec<f32> {
            let bytes = accessor(&primitive["attributes"][name]);
            bytes.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect()
        };
        let (positions, places) = (floats("POSITION"), floats("TEXCOORD_0"));
        let indices: Vec<usize> = accessor(&primitive["indices"])
            .as_chunks()
            .0
            .iter()
            .map(|two| u16::from_le_bytes(*two).into())
            .collect();
        let image = match json["images"][number]["uri"].as_str() {
            Some(name) => folder.read(&format!("{}/{name}", glb.rsplit_once('/').expect("a folder").0)),
            None => view(&json["images"][number]["bufferView"]),
        };
        let mut rows = chpm_image::ImageRows::open(std::io::Cursor::new(image), u64::MAX).expect("an image");
        let ([width, height], mut pixels) = (rows.size(), Vec::new());
        rows.read_rows(height as usize, &mut pixels).expect("pixels");
        for (corners, shares) in
            indices.as_chunks::<3>().0.iter().flat_map(|corners| shares.iter().map(move |of| (corners, of)))
        {
            let mean = |values: &[f32], step: usize, at: usize| -> f64 {
                corners.iter().zip(shares).map(|(v, share)| share * f64::from(values[v * step + at])).sum()
            };
            let [x, y] = [(0, width), (1, height)].map(|(at, side)| mean(&places, 2, at) * f64::from(side));
            let [r, g, b, _] = pixels[y as usize * width as usize + x as usize];
            let place = [0, 1].map(|at| mean(&positions, 3, at) + origin[at]);
            found.push((place, [r, g, b]));
        }
    }
    found
}

/// The share of a picture's pixels that show the model.
#[cfg(feature = "viewer")]
fn share_of_model(folder: &Folder, name: &str, ask: &str) -> f64 {
    let camera = "--camera 0.5,0.5,3,0.5,0.5,0,19 --up y --viewport 256x256 --transparent";
    folder.stdout(&format!("render {name}.chpm -o {name}.png -f -q {camera} {ask}"));
    let (.., pixels) = picture(folder, &format!("{name}.png"));
    pixels.iter().map(|pixel| f64::from(pixel[3]) / 255.0).sum::<f64>() / pixels.len() as f64
}

#[cfg(feature = "viewer")]
#[test]
fn sheets_are_drawn_with_their_holes() {
    let folder = textured();
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\nmap_d a.png\n");
    // A hole on the right, and a third of it seen above on the left.
    let alpha = |u: f64, v: f64| {
        if u > 0.5 {
            0
        } else if v > 0.5 {
            85
        } else {
            255
        }
    };
    let veiled = |u: f64, v: f64| [&board(u, v)[..], &[alpha(u, v)]].concat();
    folder.write("a.png", png(256, veiled, png::ColorType::Rgba));
    folder.stdout(&format!("build a.obj -o holes.chpm {BUILD}"));
    folder.stdout(&format!("build a.obj -o whole.chpm {}", BUILD.replace("sheets", "none")));
    for ask in [
        "--adapter software --poe 0",
        "--adapter software --triangles 700",
        "--adapter software --poe 0 --samples 1",
        "--rays --poe 0 --samples 1 --occlusion 0 --no-shadows",
        "--rays --poe 3 --samples 2 --occlusion 2",
    ] {
        let [holes, whole] = ["holes", "whole"].map(|name| share_of_model(&folder, name, ask));
        let share = holes / whole;
        assert!((share - (0.25 + 0.25 / 3.0)).abs() < 0.01, "{ask}: {share}");
    }
}

#[test]
fn holes_in_images_come_through_as_png() {
    let folder = textured();
    let veiled = |u: f64, v: f64| [&board(u, v)[..], &[if u > 0.5 { 0 } else { 255 }]].concat();
    folder.write("a.png", png(256, veiled, png::ColorType::Rgba));
    // Alpha is nothing unless the material says that it is looked at.
    folder.stdout(&format!("build a.obj -o opaque.chpm {BUILD}"));
    assert!(folder.stdout("dump opaque.chpm").contains(" jpeg charts "));
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\nmap_d a.png\n");
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    folder.stdout("verify a.chpm -q");
    assert!(folder.stdout("dump a.chpm").contains(" png charts "));
    folder.stdout("extract a.chpm --error 0 --texture-size 1024 -o a.glb -q");
    let json = folder.read("a.glb");
    assert!(json.windows(9).any(|bytes| bytes == b"image/png"));
    assert!(json.windows(18).any(|bytes| bytes == b"\"alphaMode\":\"MASK\""));
    // Vertices get the means of what is about them, alpha and all.
    folder.stdout("build a.glb -o back.chpm -q");
    folder.stdout("extract back.chpm --error 0 -o back.ply -q");
    let mesh = folder.read_mesh("back.ply");
    let alpha = |side: std::ops::Range<f32>| {
        let some = mesh.positions.iter().zip(&mesh.colors).filter(|(place, _)| side.contains(&place[0]));
        some.map(|(_, color)| color[3]).collect::<Vec<_>>()
    };
    // The image repeats, so that each border shows a little of the other.
    let (shown, hidden) = (alpha(0.05..0.4), alpha(0.6..0.95));
    assert!(shown.len() > 500 && hidden.len() > 500);
    assert!(shown.iter().all(|alpha| *alpha == 255), "{shown:?}");
    assert!(hidden.iter().all(|alpha| *alpha == 0), "{hidden:?}");
}
