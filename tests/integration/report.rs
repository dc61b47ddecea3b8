//! The page of a file: what is in it, and what a browser makes of it.

use super::harness::{Folder, skipped, text};
use super::raw::Raw;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::process::{Command, Output};

/// A model, its file, another file of it and a page of both.
fn page() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 30k -o in.ply -q");
    let built = folder.stdout("build in.ply -q --json --cluster-triangles 512");
    folder.write("built.json", built);
    folder.stdout("build in.ply -q --cluster-triangles 1024 --boundary lock -o other.chpm");
    folder.stdout("report in.chpm -o page.html --compare other.chpm --built built.json");
    folder
}

/// What is between two texts.
fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let rest = text.split_once(from).unwrap_or_else(|| panic!("{from}")).1;
    rest.split_once(to).unwrap_or_else(|| panic!("{to}")).0
}

fn decoded(base64: &str) -> Vec<u8> {
    let digit = |c: u8| {
        b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/".iter().position(|d| *d == c)
    };
    let digits: Vec<u32> = base64.bytes().filter_map(digit).map(|d| d as u32).collect();
    let mut bytes = Vec::new();
    for four in digits.chunks(4) {
        let word = four.iter().fold(0, |word, digit| word << 6 | digit) << (6 * (4 - four.len()));
        bytes.extend(&word.to_be_bytes()[1..four.len()]);
    }
    bytes
}

/// Colours of the opaque pixels of a picture, and how many these are.
fn colors(base64: &str) -> (BTreeSet<[u8; 3]>, usize) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(decoded(base64))).read_info().expect("a picture");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    reader.next_frame(&mut pixels).expect("pixels");
    let opaque = pixels.as_chunks::<4>().0.iter().filter(|pixel| pixel[3] == 255);
    let opaque: Vec<[u8; 3]> = opaque.map(|[r, g, b, _]| [*r, *g, *b]).collect();
    (opaque.iter().copied().collect(), opaque.len())
}

/// Colours of images, on pages of one model and of many, with holes.
#[test]
fn pictures_show_images() {
    let folder = super::sheets::textured();
    folder.write("bare.obj", folder.read("a.obj"));
    let half = |u: f64, v: f64| [&super::sheets::board(u, v)[..], &[if u < 0.5 { 255 } else { 0 }]].concat();
    folder.write("half.png", super::sheets::png(512, half, png::ColorType::Rgba));
    folder.write("half.mtl", "newmtl a\nmap_Kd half.png\nmap_d half.png\n");
    folder.write("half.obj", text(&folder.read("a.obj")).replace("a.mtl", "half.mtl"));
    for name in ["a", "half"] {
        folder.stdout(&format!("build {name}.obj {}", super::sheets::BUILD));
        assert_eq!(folder.stderr(&format!("report {name}.chpm -o {name}.html"), 0), "");
    }
    folder.stdout(&format!("build bare.obj {}", super::sheets::BUILD.replace("sheets", "none")));
    folder.stdout("report bare.chpm -o bare.html");
    let picture = |name: &str| {
        let html = text(&folder.read(name));
        let (colors, pixels) = colors(between(&html, "base64,", "\""));
        // The board's light squares are yellow, its dark ones blue.
        let count = |is: fn(&[u8; 3]) -> bool| colors.iter().filter(|color| is(color)).count();
        let is_light = count(|[r, _, b]| r.saturating_sub(*b) > 60) > 20;
        (is_light, count(|[r, _, b]| b.saturating_sub(*r) > 40) > 20, pixels)
    };
    let (all, half, bare) = (picture("a.html"), picture("half.html"), picture("bare.html"));
    assert!(all.0 && all.1 && !bare.0 && !bare.1 && all.2 == bare.2, "{all:?} {bare:?}");
    let share = half.2 as f64 / all.2 as f64;
    assert!(half.0 && half.1 && (0.2..0.8).contains(&share), "{half:?} {all:?}");

    let damaged = folder.read("a.chpm");
    let is_image = |place: &usize| damaged[*place..].starts_with(&[0xff, 0xd8, 0xff]);
    let images: Vec<usize> = (0..damaged.len()).filter(is_image).collect();
    let mut bytes = damaged.clone();
    images.iter().for_each(|image| bytes[image + 3] ^= 0x55);
    folder.write("bad.chpm", bytes);
    assert!(
        !images.is_empty() && folder.stderr("report bad.chpm -o bad.html", 2).contains("sheet of cluster")
    );
    assert!(!folder.path("bad.html").exists());

    fs::create_dir(folder.path("many")).expect("a folder");
    for name in ["a.obj", "a.mtl", "a.png"] {
        folder.write(&format!("many/{name}"), folder.read(name));
    }
    folder.stdout("batch many -o out -q --report --texture sheets");
    let (light, dark, _) = picture("out/index.html");
    assert!(light && dark);
}

#[test]
fn models_without_a_size_have_a_page() {
    let folder = Folder::new();
    let triangle = |corners: &[[f32; 3]; 3]| {
        let points = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
        format!("{points}f 1 2 3\n")
    };
    let far = [-400_000.0, 133_333.33, 0.0];
    for (name, corners) in
        [("zero", [[0.0; 3]; 3]), ("far", [far; 3]), ("line", [[0.0; 3], [1.0; 3], [2.0; 3]])]
    {
        folder.write(&format!("{name}.obj"), triangle(&corners));
        folder.stdout(&format!("build {name}.obj -q"));
        folder.stdout(&format!("report {name}.chpm -o {name}.html"));
    }
}

#[test]
fn the_page_is_whole_and_needs_nothing_else() {
    let folder = page();
    let html = text(&folder.read("page.html"));
    assert!(!html.contains("src=\"http") && !html.contains("href=\"http") && !html.contains("@import"));
    assert_eq!(html.matches("<svg").count(), 6, "plots");
    let pictures: Vec<&str> = html
        .split("src=\"data:image/png;base64,")
        .skip(1)
        .filter_map(|rest| rest.split('"').next())
        .collect();
    let seen: Vec<_> = pictures.iter().map(|picture| colors(picture)).collect();
    assert_eq!(seen.len(), 4);
    // First the model as it is, in greys and larger; then the same in three ways.
    let is_grey = |[r, g, b]: &[u8; 3]| r.abs_diff(*g) < 12 && g.abs_diff(*b) < 16;
    assert!(seen[0].0.iter().all(is_grey) && seen[0].1 > seen[1].1, "{:?}", seen[0].1);
    let ways = &seen[1..];
    assert!(
        ways.iter().all(|(colors, pixels)| colors.len() > 50
            && pixels.abs_diff(ways[0].1) < 2000
            && *pixels > 20_000),
        "{:?}",
        ways[0].1
    );
    assert!(ways[0].0 != ways[1].0 && ways[1].0 != ways[2].0 && ways[1].1 == ways[2].1);
    // From dark blue to yellow, evenly lighter: nothing is red.
    assert!(ways[2].0.iter().all(|[r, g, b]| u16::from(*r) < u16::from(*g.max(b)) + 30), "no rainbow");
    // Whoever does not see them is told.
    assert_eq!(html.matches("<svg role=\"img\" aria-label=\"").count(), 6);
    assert!(
        html.matches("<main>").count() == 1
            && html.contains("role=\"img\" aria-label=\"A map of the clusters")
    );
    let headers = html.matches("<th").count();
    assert!(headers > 20 && html.matches("<th scope=").count() == headers, "{headers}");
    for word in [
        "in.ply",
        "Compared with other.chpm",
        "cluster-triangles",
        "xxh3",
        "Time by stage",
        "Bytes by part",
        "acmr24",
    ] {
        assert!(html.to_lowercase().contains(&word.to_lowercase()), "{word}");
    }
    let streamed = folder.stdout("report in.chpm -o - --compare other.chpm --built built.json");
    assert!(streamed == html, "the same page as a stream");
    assert!(folder.stderr("report in.chpm -o page.html", 2).contains("--force"));
    assert!(folder.stderr("report in.chpm -o page.html -f --built in.ply", 2).contains("chpm build --json"));
    // Without an end, as far as it takes anybody to read it.
    fs::File::create(folder.path("long.json")).unwrap().set_len(300 << 20).unwrap();
    assert!(
        folder
            .stderr("report in.chpm -o page.html -f --built long.json", 2)
            .contains("longer than 256.0 MiB")
    );
    assert!(folder.stderr("report in.chpm -o page.png", 2).contains("HTML"));
}

#[test]
fn times_of_another_build_are_refused() {
    let folder = page();
    let said = folder.stderr("report other.chpm -o other.html --built built.json", 2);
    assert!(said.contains("'built.json' is of another build than 'other.chpm': clusters"), "{said}");
    assert!(!folder.path("other.html").exists());
    // A name is no proof.
    fs::rename(folder.path("in.chpm"), folder.path("moved.chpm")).expect("a name");
    let said = folder.stderr("report moved.chpm -o moved.html --built built.json", 0);
    assert!(said.contains("warning: 'built.json' tells of the build of 'in.chpm'"), "{said}");
    fs::rename(folder.path("moved.chpm"), folder.path("in.chpm")).expect("a name");
    assert_eq!(folder.stderr("report in.chpm -o page.html -f --built built.json", 0), "");
    // Nor is it another build where less is kept than the source has.
    folder.write("less.json", folder.stdout("build in.ply -q --json -o less.chpm --finest-error 1%"));
    assert_eq!(folder.stderr("report less.chpm -o less.html --built less.json", 0), "");
}

#[test]
fn the_map_is_of_the_hierarchy() {
    let folder = page();
    let html = text(&folder.read("page.html"));
    let tree: Value =
        serde_json::from_str(between(&html, "type=\"application/json\">", "</script>")).expect("JSON");
    let raw = Raw(folder.read("in.chpm"));
    let (clusters, groups) = (raw.clusters(), raw.groups());
    let nodes = tree["nodes"].as_array().expect("nodes");
    assert_eq!(nodes.len(), clusters.len());
    let number = |node: &Value, place: usize| node[place].as_i64().expect("a number");
    let mut below = vec![0; clusters.len()];
    for (id, node) in nodes.iter().enumerate() {
        let (c, parent) = (&clusters[id], number(node, 1));
        assert_eq!(
            [0, 2, 4, 10].map(|place| number(node, place)),
            [id as i64, c.level.into(), c.triangle_count.into(), c.page_len.into()]
        );
        assert_eq!(node[5].as_f64().map(|error| error as f32), Some(c.errors[1]));
        match usize::try_from(parent) {
            Ok(parent) => {
                assert_eq!(clusters[parent].group, c.parent, "a parent is of the group that it came from");
                below[parent] += number(node, 3);
            }
            Err(_) => assert_eq!(c.parent, u32::MAX),
        }
    }
    for (node, below) in nodes.iter().zip(&below) {
        let leaf = number(node, 2) == 0;
        assert_eq!(number(node, 3), if leaf { number(node, 4) } else { *below });
    }
    let roots: i64 = nodes.iter().filter(|node| number(node, 1) < 0).map(|node| number(node, 3)).sum();
    assert_eq!(roots, raw.u64(56) as i64);
    // Where a group has as many coarse clusters as pairs of fine ones, each has its two children.
    for group in groups.iter().filter(|group| group.fine.len() == 2 * group.coarse as usize) {
        let parents: Vec<i64> = group.fine.iter().map(|id| number(&nodes[*id as usize], 1)).collect();
        assert!(
            parents.iter().all(|parent| parents.iter().filter(|other| *other == parent).count() == 2),
            "{parents:?}"
        );
    }
}

#[test]
fn odd_models_have_a_page() {
    let folder = Folder::new();
    for (name, words) in [
        ("one", "sphere --triangles 20"),
        ("far", "hard:far-double --triangles 5000"),
        ("huge", "hard:huge --triangles 5000"),
    ] {
        folder.stdout(&format!("synth {words} -o {name}.ply -q"));
        folder.stdout(&format!("build {name}.ply -q --cluster-triangles 512 --pages packed"));
        folder.stdout(&format!("report {name}.chpm -o {name}.html -q"));
        let html = text(&folder.read(&format!("{name}.html")));
        let (_, pixels) = colors(between(&html, "base64,", "\""));
        // Pictures have any letters.
        let words: String =
            html.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, rest)| rest)).collect();
        assert!(pixels > 10_000 && !words.contains("NaN"), "{name}: {pixels}");
    }
}

#[test]
fn a_batch_has_an_index_with_failures_first() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("in/deep")).expect("a folder");
    folder.stdout("synth terrain --triangles 3000 -o in/a.ply -q");
    folder.stdout("synth sphere --triangles 3000 -o c.ply -q");
    std::fs::rename(folder.path("c.ply"), folder.path("in/deep/c #1%.ply")).expect("a move");
    folder.write("in/b<b>.ply", "no mesh");
    folder.chpm("batch in -o out -q --report").code(1);
    let html = text(&folder.read("out/index.html"));
    let cards: Vec<&str> = html.split("<div class=\"card").skip(2).collect();
    assert_eq!(cards.len(), 3, "{html}");
    assert!(cards[0].starts_with(" failed") && cards[0].contains("b&#60;b&#62;") && !html.contains("b<b>"));
    for (card, link) in cards[1..].iter().zip(["a.chpm", "deep/c%20%231%25.chpm"]) {
        assert!(
            card.contains(&format!("href=\"{link}\"")) && colors(between(card, "base64,", "\"")).1 > 5000
        );
    }
    folder.chpm("batch in -o plain -q").code(1);
    assert!(!folder.path("plain/index.html").exists());
}

/// Runs Chromium on a page of the folder; none where it is not installed.
fn chromium(folder: &Folder, page: &str, options: &[&str]) -> Option<Output> {
    let fixed = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
    ];
    let more = [
        "--disable-component-update",
        "--disable-sync",
        "--enable-logging=stderr",
        "--window-size=1200,2600",
        "--virtual-time-budget=4000",
    ];
    let mut command = Command::new("chromium");
    command.args(fixed).args(more).arg(format!("--user-data-dir={}", folder.path("profile").display()));
    command.args(options).arg(format!("file://{}", folder.path(page).display()));
    match command.env("HOME", folder.path("")).output() {
        Ok(output) => Some(output),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            skipped("the page of report: chromium is not installed (apt-get install chromium)");
            None
        }
        Err(error) => panic!("chromium: {error}"),
    }
}

/// What somebody does with the page, and what came of it.
const VISIT: &str = r#"<script>
window.addEventListener("load", () => {
  const map = document.getElementById("map"), under = document.getElementById("under"), told = {};
  const send = (type, of) => {
    const { left, top, width, height } = map.getBoundingClientRect();
    map.dispatchEvent(new PointerEvent(type, { bubbles: true, clientX: left + width / of, clientY: top + height / of }));
  };
  const pixels = () => map.toDataURL();
  told.before = under.textContent; told.root = map.dataset.root; told.boxes = Number(map.dataset.boxes);
  send("pointermove", 3); told.pointed = under.textContent;
  const first = pixels(); send("click", 3); told.inside = map.dataset.root; told.place = document.getElementById("place").textContent;
  told.changed = first !== pixels();
  const colored = pixels(); document.getElementById("measure").value = "shared";
  document.getElementById("measure").dispatchEvent(new Event("change")); told.recolored = colored !== pixels();
  document.getElementById("up").click(); told.out = map.dataset.root;
  for (let n = 0; n < 20; n++) document.getElementById("up").click();
  told.top = map.dataset.root; told.still = document.getElementById("up").disabled;
  send("click", 2); for (let n = 0; n < 20; n++) document.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape" })); told.escaped = map.dataset.root;
  told.pictures = [...document.images].map((image) => image.naturalWidth);
  told.plots = [...document.querySelectorAll(".plots svg")].map((plot) => [plot.getBoundingClientRect().width, plot.querySelectorAll("polyline,circle,rect").length]);
  told.ink = getComputedStyle(document.querySelector(".plots svg text")).fill;
  told.wide = document.documentElement.scrollWidth > window.innerWidth;
  document.body.dataset.told = JSON.stringify(told);
});
</script>"#;

#[test]
fn a_browser_shows_plots_and_a_map_that_reacts() {
    let folder = page();
    let html = text(&folder.read("page.html"));
    folder.write("visit.html", html.replace("</body>", &format!("{VISIT}</body>")));
    let mut inks = BTreeSet::new();
    // Dark and light.
    for scheme in ["--blink-settings=preferredColorScheme=0", "--blink-settings=preferredColorScheme=1"] {
        let Some(output) = chromium(&folder, "visit.html", &["--dump-dom", scheme]) else { return };
        let (dom, log) = (text(&output.stdout), text(&output.stderr));
        assert!(!log.contains("CONSOLE"), "{log}");
        let told = between(&dom, "data-told=\"", "\"").replace("&quot;", "\"");
        let told: Value = serde_json::from_str(&told).expect("JSON");
        for name in ["root", "top", "escaped"] {
            assert_eq!(told[name], "-1", "{name}: {told:#}");
        }
        assert!(told["out"] != told["inside"] && told["still"] == true, "{told:#}");
        assert!(told["boxes"].as_u64() > Some(10) && told["inside"] != "-1", "{told:#}");
        assert!(
            told["pointed"] != told["before"]
                && told["pointed"].as_str().is_some_and(|text| text.contains("triangles"))
        );
        assert!(told["place"].as_str().is_some_and(|text| text.starts_with("cluster ")), "{told:#}");
        assert_eq!(
            (&told["changed"], &told["recolored"], &told["wide"]),
            (&true.into(), &true.into(), &false.into()),
            "{told:#}"
        );
        assert_eq!(told["pictures"], serde_json::json!([960, 640, 640, 640]));
        let plots = told["plots"].as_array().expect("plots");
        let is_drawn = |plot: &Value| plot[0].as_f64() > Some(300.0) && plot[1].as_u64() > Some(2);
        assert!(plots.len() == 6 && plots.iter().all(is_drawn), "{told:#}");
        inks.insert(told["ink"].as_str().expect("a colour").to_owned());
    }
    assert_eq!(inks.len(), 2, "an ink for each theme: {inks:?}");
}

/// The pixels of the first picture of a page: where it is opaque, by row, from the first to the last column.
fn outline(html: &str) -> Vec<[usize; 2]> {
    let reader = png::Decoder::new(std::io::Cursor::new(decoded(between(html, "base64,", "\""))));
    let mut reader = reader.read_info().expect("a picture");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    let width = reader.next_frame(&mut pixels).expect("pixels").width as usize;
    let row = |row: &[u8]| {
        let there = |place: &usize| row[4 * place + 3] > 127;
        Some([(0..width).find(there)?, (0..width).rev().find(there)?])
    };
    pixels.chunks_exact(4 * width).filter_map(row).collect()
}

#[test]
fn models_stand_in_pages_and_thumbnails_and_specks_do_not_move_them() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("in")).expect("a folder");
    // A column on a plinth with z up, and the same with a speck far away.
    let block = |low: [f64; 3], high: [f64; 3], first: usize| {
        let corner = |n: usize| {
            let at: Vec<String> =
                (0..3).map(|a| if n >> a & 1 == 0 { low[a] } else { high[a] }.to_string()).collect();
            format!("v {}\n", at.join(" "))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let face =
            |[a, b, c, d]: [usize; 4]| format!("f {} {} {} {}\n", first + a, first + b, first + c, first + d);
        (0..8).map(corner).chain(quads.into_iter().map(face)).collect::<String>()
    };
    let column = block([-1.0, -1.0, 0.0], [1.0, 1.0, 0.5], 1) + &block([-0.5, -0.6, 0.5], [0.5, 0.6, 6.0], 9);
    folder.write("in/column.obj", &column);
    folder.write("in/specked.obj", column + "v 300 0 0\nv 300.01 0 0\nv 300 0.01 0\nf 17 18 19\n");
    folder.stdout("batch in -o out -q --report");
    let index = text(&folder.read("out/index.html"));
    folder.stdout("report out/column.chpm -o column.html -q");
    folder.stdout("report out/specked.chpm -o specked.html -q");
    let cards: Vec<&str> = index.split("<div class=\"card").skip(2).collect();
    let pages = [
        cards[0].to_owned(),
        cards[1].to_owned(),
        text(&folder.read("column.html")),
        text(&folder.read("specked.html")),
    ];
    for (page, height) in pages.iter().zip([180, 180, 640, 640]) {
        let rows = outline(page);
        // As high as the picture allows; broad below.
        assert!(rows.len() > height * 85 / 100, "{} of {height}", rows.len());
        let wide = |row: &[usize; 2]| row[1] - row[0];
        assert!(wide(&rows[rows.len() - 8]) > 3 * wide(&rows[rows.len() / 2]) / 2, "{rows:?}");
    }
    assert!(pages[3].contains("specks far away") && !pages[2].contains("specks far away"));
}
