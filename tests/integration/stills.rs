//! Pictures by rays: the same bytes whatever the threads and the memory, no dark spots, shadows where they must be.

use super::harness::{Folder, skipped};
use super::render::{json, picture};

type Pixels = Vec<[u8; 4]>;

fn ball(triangles: u32) -> Folder {
    let folder = Folder::new();
    folder.stdout(&format!("synth sphere --triangles {triangles} -o ball.ply -q"));
    folder.stdout("build ball.ply -q --cluster-triangles 256");
    folder
}

fn still(folder: &Folder, words: &str) -> Pixels {
    folder.stdout(&format!("render {words} --rays -qf -o still.png"));
    picture(folder, "still.png").2
}

#[test]
fn neither_threads_nor_memory_show() {
    let folder = ball(60_000);
    folder.stdout("synth isosurface --triangles 60000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 256");
    for (words, other) in [
        ("in.chpm --viewport 120x90 --poe 0 --ground", "--threads 2 --memory 64M"),
        (
            "ball.chpm --viewport 90x90 --poe 2 --studio --samples 3 --light 100,20 --light -160,30",
            "--threads 3 --memory 70M",
        ),
        (
            "in.chpm --viewport 64x48 --poe 1 --clip z:0.5 --shading flat --transparent",
            "--threads 2 --memory 64M",
        ),
    ] {
        folder.stdout(&format!("render {words} --rays -q --threads 1 -f -o one.png"));
        folder.stdout(&format!("render {words} --rays -q {other} -f -o other.png"));
        assert!(folder.read("one.png") == folder.read("other.png"), "{words}");
    }
}

/// What fits is read once, however many threads there are.
#[test]
fn pages_that_fit_are_read_once() {
    let folder = ball(200_000);
    let words = "render ball.chpm --rays --ground --poe 0 --viewport 120x90 -o still.png -qf --json";
    let told = json(&folder.stdout(&format!("{words} --threads 24 --memory 256M")));
    assert!(told["pages"].as_u64().expect("a number") > 20, "{told}");
    assert_eq!(told["pages"], told["pages_different"], "{told}");
}

/// A sphere has no shadow of its own on its lit side: with shadows it is as bright there as without, at any error.
#[test]
fn a_lit_sphere_has_no_dark_spots() {
    let folder = ball(20_000);
    for words in ["--poe 0", "--poe 8", "--poe 8 --shading flat"] {
        let words = format!("ball.chpm --viewport 160x160 {words} --samples 4 --light 50,30");
        let free = still(&folder, &format!("{words} --occlusion 0 --no-shadows"));
        let shadowed = still(&folder, &format!("{words} --occlusion 0 --light-width 0"));
        let open = still(&folder, &format!("{words} --no-shadows"));
        let covered = free.iter().filter(|pixel| pixel[0] > 40).count();
        assert!(covered > 5000, "{covered}");
        let worst = |other: &Pixels| {
            free.iter().zip(other).map(|(a, b)| i32::from(a[0]) - i32::from(b[0])).max().expect("pixels")
        };
        assert!(worst(&shadowed) <= 4, "{words}: {}", worst(&shadowed));
        assert!(worst(&open) <= 4, "{words}: {}", worst(&open));
    }
}

type Vector = [f64; 3];

fn sum(a: Vector, b: Vector, factor: f64) -> Vector {
    std::array::from_fn(|axis| a[axis] + factor * b[axis])
}

fn unit(a: Vector) -> Vector {
    let length = a.iter().map(|x| x * x).sum::<f64>().sqrt();
    a.map(|x| x / length)
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Whether a ray comes into the box from 0 to 2, 4, 6.
fn meets_box(from: Vector, way: Vector) -> bool {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let [a, b] = [0.0, [2.0, 4.0, 6.0][axis]].map(|side| (side - from[axis]) / way[axis]);
        (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
    }
    enter < leave
}

#[test]
fn a_box_throws_its_shadow_where_geometry_says() {
    let folder = Folder::new();
    let corner = |n: u32| format!("{} {} {}", 2 * (n & 1), 4 * (n >> 1 & 1), 6 * (n >> 2));
    let corners: Vec<String> = (0..8).map(corner).collect();
    let faces = "4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n4 1 3 7 5\n";
    let header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 6\nproperty list uchar int vertex_indices\nend_header\n";
    folder.write("box.ply", format!("{header}{}\n{faces}", corners.join("\n")));
    folder.stdout("build box.ply -q");
    let (eye, target, half) = ([20.0, -30.0, 25.0], [1.5, 2.5, 0.5], 22.5_f64.to_radians().tan());
    let forward = unit(sum(target, eye, -1.0));
    let right = unit(cross(forward, [0.0, 0.0, 1.0]));
    let up = cross(right, forward);

    // From the right, from behind, and from the eye.
    for [aside, above] in [[80.0, 35.0], [150.0, 50.0], [0.0, 0.0_f64]] {
        let words = format!(
            "box.chpm --camera 20,-30,25,1.5,2.5,0.5,45 --up z --viewport 160x120 --samples 1 --occlusion 0 --ground \
             --background ffffff --light-width 0 --light {aside},{above}"
        );
        let pixels = still(&folder, &words);
        let [(sin, cos), (high, level)] = [aside, above].map(|angle: f64| angle.to_radians().sin_cos());
        let light = sum(sum([0.0; 3], sum(sum([0.0; 3], right, sin), forward, -cos), level), up, high);
        // 1 for the box, 2 for its shadow, 0 for neither.
        let seen = |x: f64, y: f64| {
            let across = sum(forward, right, (2.0 * x / 160.0 - 1.0) * half * 160.0 / 120.0);
            let way = unit(sum(across, up, (1.0 - 2.0 * y / 120.0) * half));
            if meets_box(eye, way) {
                return 1;
            }
            let ground = sum(eye, way, -eye[2] / way[2]);
            if way[2] < 0.0 && meets_box(ground, light) { 2 } else { 0 }
        };
        let mut counts = [0; 3];
        for (n, pixel) in pixels.iter().enumerate() {
            let (x, y) = ((n % 160) as f64 + 0.5, (n / 160) as f64 + 0.5);
            let expected = seen(x, y);
            // But for what is at an edge.
            if [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
                .iter()
                .any(|[h, v]| seen(x + h, y + v) != expected)
            {
                continue;
            }
            counts[expected] += 1;
            match expected {
                0 => assert_eq!(pixel, &[255; 4], "{x},{y} of {words}"),
                2 => assert!(
                    pixel[0] < 225 && pixel[0] > 40 && pixel[0] == pixel[2],
                    "{x},{y} of {words}: {pixel:?}"
                ),
                _ => assert!(pixel[0] > pixel[2], "{x},{y} of {words}: {pixel:?}"),
            }
        }
        // What the eye itself lights throws no shadow that it could see.
        assert!(counts[0] > 5000 && counts[1] > 150 && (counts[2] > 100) == (aside != 0.0), "{counts:?}");
    }
}

/// Without shadows it is the picture that a GPU draws.
#[test]
fn rays_see_what_the_gpu_draws() {
    let folder = ball(20_000);
    folder.stdout("synth isosurface --triangles 40000 -o iso.ply -q");
    folder.stdout("build iso.ply -q --cluster-triangles 512");
    let drawn = folder.chpm("render ball.chpm --viewport 20x20 -o probe.png").get_output().clone();
    if !drawn.status.success() {
        skipped("stills beside the GPU: there is no adapter");
        return;
    }
    for words in [
        "ball.chpm --viewport 160x120 --poe 0 --samples 1 --transparent",
        "iso.chpm --viewport 160x120 --poe 0 --samples 1 --transparent",
        "iso.chpm --viewport 120x160 --poe 0 --samples 4 --transparent --shading flat --view top",
        "iso.chpm --viewport 160x120 --poe 0 --samples 2 --transparent --clip z:0.5 --roll 20 --light -40,10",
    ] {
        let traced = still(&folder, &format!("{words} --no-shadows --occlusion 0"));
        folder.stdout(&format!("render {words} -f -o drawn.png"));
        let (width, height, drawn) = picture(&folder, "drawn.png");
        let (width, height) = (width as usize, height as usize);
        // In silhouette, within a pixel: what all about it show, or none, both show.
        let around = |pixels: &Pixels, n: usize, is: &dyn Fn(u8) -> bool| {
            let (x, y) = (n % width, n / width);
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            columns
                .into_iter()
                .all(|x| (y.saturating_sub(1)..(y + 2).min(height)).all(|y| is(pixels[y * width + x][3])))
        };
        let (mut shown, mut unlike) = (0, 0);
        for n in 0..traced.len() {
            if around(&drawn, n, &|alpha| alpha == 255) {
                assert_eq!(traced[n][3], 255, "{n} of {words}");
                shown += 1;
                // At creases inside, samples may fall on either side.
                unlike += usize::from((0..3).any(|c| traced[n][c].abs_diff(drawn[n][c]) > 6));
            } else if around(&drawn, n, &|alpha| alpha == 0) {
                assert_eq!(traced[n][3], 0, "{n} of {words}");
            }
        }
        assert!(shown > 500 && unlike * 50 < shown, "{unlike} of {shown} of {words}");
    }
}

/// The ground is behind all of a model that lies on it.
#[test]
fn a_flat_model_hides_the_ground_below_it() {
    let folder = Folder::new();
    let vertices = "-1.1 -0.7 0.3\n1.3 -0.9 0.3\n0.9 1.2 0.3\n-0.8 1.1 0.3\n";
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 2\nproperty list uchar int vertex_indices\nend_header\n";
    folder.write("flat.ply", format!("{header}{vertices}3 0 1 2\n3 0 2 3\n"));
    folder.stdout("build flat.ply -q");
    for camera in ["0.4,-3.3,2.7", "2.1,1.7,0.9"] {
        let words = format!(
            "flat.chpm --camera {camera},0,0,0.3,45 --up z --viewport 120x90 --samples 1 --occlusion 0 --no-shadows \
             --background 00ff00"
        );
        let alone = still(&folder, &words);
        let above = still(&folder, &format!("{words} --ground"));
        let drawn: Vec<_> =
            alone.iter().zip(&above).filter(|(alone, _)| **alone != [0, 255, 0, 255]).collect();
        let same = drawn.iter().filter(|(alone, above)| alone == above).count();
        assert!(same == drawn.len() && same > 1000, "{camera}: {same} of {}", drawn.len());
    }
}

/// Neither threads nor memory show in images, and a picture without them is that of a model without them.
#[test]
fn images_are_what_rays_see() {
    let folder = super::sheets::textured();
    let veiled = |u: f64, v: f64| {
        let alpha = if u > 0.4 && v > 0.4 { 90 } else { 255 };
        [&super::sheets::board(u, v)[..], &[alpha]].concat()
    };
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\nmap_d a.png\n");
    folder.write("a.png", super::sheets::png(256, veiled, png::ColorType::Rgba));
    folder.stdout(&format!("build a.obj -o a.chpm {}", super::sheets::BUILD));
    folder.stdout(&format!("build a.obj -o bare.chpm {}", super::sheets::BUILD.replace("sheets", "none")));
    for words in ["--poe 0", "--poe 4 --samples 2 --transparent"] {
        let words = format!("a.chpm --viewport 80x60 {words}");
        let one = still(&folder, &format!("{words} --threads 1"));
        assert!(one == still(&folder, &format!("{words} --threads 3 --memory 64M")), "{words}");
        assert!(one != still(&folder, &format!("{words} --color plain")), "{words}");
    }
    let plain = |name: &str| still(&folder, &format!("{name}.chpm --viewport 80x60 --poe 0 --color plain"));
    assert!(plain("a") == plain("bare"), "images are left out with their holes");
    // What is damaged is no picture.
    let text = folder.stdout("dump a.chpm");
    assert!(text.contains("sheet of cluster 0 "));
    let mut bytes = folder.read("a.chpm");
    let is_image = |place: &usize| bytes[*place..].starts_with(b"\x89PNG\r\n\x1a\n");
    let images: Vec<usize> = (0..bytes.len()).filter(is_image).collect();
    images.iter().for_each(|image| bytes[image + 100] ^= 1);
    folder.write("bad.chpm", bytes);
    let told = folder.stderr("render bad.chpm --rays --viewport 80x60 --poe 0 -o bad.png", 2);
    assert!(told.contains("sheet of cluster") && !folder.path("bad.png").exists(), "{told}");
}

#[test]
fn a_still_says_what_it_took() {
    let folder = ball(20_000);
    let told = |words: &str| {
        json(&folder.stdout(&format!("render ball.chpm --rays --viewport 60x40 -qf -o a.png --json {words}")))
    };
    let all = told("--samples 2");
    assert_eq!(
        (&all["schema"], &all["camera_rays"], &all["views"]),
        (&"chpm-still/1".into(), &4800.into(), &1.into())
    );
    let number = |value: &serde_json::Value, key: &str| value[key].as_u64().expect("a number");
    assert!(number(&all, "seen") > 1000 && number(&all, "shadow_rays") > 4 * number(&all, "seen"));
    assert_eq!(number(&all, "occlusion_rays"), 16 * number(&all, "seen"));
    let bare = told("--samples 2 --occlusion 0 --no-shadows --poe 4");
    assert_eq!((number(&bare, "shadow_rays"), number(&bare, "occlusion_rays")), (0, 0));
    assert!(number(&bare, "triangles") < number(&all, "triangles"), "{bare}");
    folder.stdout("render ball.chpm --rays --viewport 30x20 -q -o turn.png --turntable 3");
    assert_eq!(folder.names().iter().filter(|name| name.starts_with("turn-")).count(), 3);
}

#[test]
fn options_of_rays_are_checked() {
    let folder = ball(2000);
    let before = folder.names();
    for (words, told) in [
        ("--rays --samples 0", "--samples"),
        ("--rays --poe nan", "--poe"),
        ("--rays --poe=-1", "--poe"),
        ("--rays --light-width 200", "120 degrees"),
        ("--rays --occlusion x", "--occlusion"),
        ("--rays --color level", "leave it out for --color level"),
        ("--rays --wireframe", "--wireframe"),
        ("--rays --ids", "--ids"),
        ("--rays --adapter software", "--adapter"),
        ("--rays --triangles 100", "--triangles"),
        ("--rays --memory 1M", "--memory"),
        ("--rays --pose 1,0,0", "a pose needs a second model"),
        ("--rays --color-by quality", "has no scalars"),
        ("--rays --camera 0,0,0,0,0,0", "a target away from the position"),
        ("--ground", "--rays"),
        ("--light 1,2 --light 3,4", "only --rays draws them"),
    ] {
        let error = folder.stderr(&format!("render ball.chpm -q -o out.png {words}"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    assert_eq!(folder.names(), before, "nothing is written");
    folder.write("there.png", "mine");
    let error = folder.stderr("render ball.chpm --rays -q -o there.png", 2);
    assert!(error.contains("--force") && folder.read("there.png") == b"mine", "{error}");
    let error = folder.stderr("render ball.chpm --rays -q -o out.png --camera 0,0,5,0,0,9 --strict", 1);
    assert!(error.contains("the picture is empty"), "{error}");
}
