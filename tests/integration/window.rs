//! A real window, on a display without a screen: it opens, turns and quits.
//!
//! Needs Xvfb and xdotool, which `tests/all.sh` installs where it may; elsewhere these tests say that they are skipped where one is missing. No window
//! manager runs: windows are where they want to be, and have the keyboard when they are given it.

use super::harness::{CHPM, Folder, root, skipped};
use chpm_refine::{CameraPath, Up};
use chpm_viewer::Look;
use chpm_viewer::window::keys::{KEYS, MOTIONS};
use nalgebra::{Point3, Rotation3, Vector3};
use std::f64::consts::PI;
use std::fs;
use std::io::{BufRead, BufReader, Cursor};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Longer than any of this takes on a machine that is busy.
const PATIENCE: Duration = Duration::from_secs(120);
/// Columns of the window that the panel may cover.
const PANEL: usize = 300;
const MISSING: &str = "windows: Xvfb or xdotool is not installed (apt-get install xvfb xdotool)";

/// A display of its own, whose content lies in a file.
pub(super) struct Display {
    server: Child,
    name: String,
    folder: Folder,
}

impl Display {
    /// None, and a word about it, where there is no Xvfb.
    pub(super) fn open() -> Option<Self> {
        let has = |tool: &str| Command::new(tool).arg("-help").output().is_ok();
        if !has("Xvfb") || !has("xdotool") {
            skipped(MISSING);
            return None;
        }
        let folder = Folder::new();
        let mut server = Command::new("Xvfb")
            // Not anew when its last client leaves: who comes meanwhile would be refused.
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp", "-noreset", "-fbdir"])
            .arg(folder.path(""))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts");
        // The server tells its number when it can be talked to.
        let mut number = String::new();
        let stdout = server.stdout.take().expect("a pipe");
        BufReader::new(stdout).read_line(&mut number).expect("a line");
        Some(Display { server, name: format!(":{}", number.trim()), folder })
    }

    /// Runs `chpm` here; it is ended if it does not end by itself.
    pub(super) fn spawn(&self, folder: &Folder, words: &str) -> Child {
        let seconds = PATIENCE.as_secs().to_string();
        Command::new("timeout")
            .arg(seconds)
            .arg(CHPM)
            .args(words.split_whitespace())
            .current_dir(folder.path(""))
            .env("DISPLAY", &self.name)
            .env_remove("WAYLAND_DISPLAY")
            .env("XDG_STATE_HOME", folder.path("state"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("chpm starts")
    }

    /// Moves the pointer, presses keys, or waits for a window; answers what xdotool says.
    pub(super) fn hand(&self, words: &str) -> String {
        let tool = Command::new("timeout")
            .args([&PATIENCE.as_secs().to_string(), "xdotool"])
            .args(words.split_whitespace())
            .env("DISPLAY", &self.name)
            .output()
            .expect("xdotool runs");
        assert!(tool.status.success(), "{words}: {tool:?}");
        String::from_utf8_lossy(&tool.stdout).trim().to_owned()
    }

    /// Waits for the model's window, and gives it the keyboard.
    pub(super) fn window(&self, model: &str) {
        let window = self.hand(&format!("search --sync --onlyvisible --name {model}"));
        self.hand(&format!("windowfocus --sync {window}"));
    }

    /// Waits until this share of what is displayed beside the panel differs from the pixel in the lower right corner.
    fn wait_for_a_picture(&self, share: f64) {
        let begun = Instant::now();
        while self.displayed() < share {
            assert!(begun.elapsed() < PATIENCE, "{:.3} of the display is drawn on", self.displayed());
            thread::yield_now();
        }
    }

    /// Waits until something is displayed.
    pub(super) fn wait_until(&self, is_so: &dyn Fn() -> bool) {
        let begun = Instant::now();
        while !is_so() {
            assert!(begun.elapsed() < PATIENCE, "it is not displayed");
            thread::yield_now();
        }
    }

    /// What is displayed: rows from the top, of red, green and blue.
    pub(super) fn dump(&self) -> Vec<[u8; 3]> {
        let dump = self.folder.read("Xvfb_screen0");
        let field = |n: usize| {
            let bytes = dump.get(4 * n..4 * n + 4).expect("a header");
            u32::from_be_bytes(bytes.try_into().expect("four bytes")) as usize
        };
        let (header, stride, colors) = (field(0), field(12), field(19));
        assert_eq!((field(11), field(4), field(5)), (32, 800, 600), "32 bits a pixel");
        let rows = dump[header + 12 * colors..].chunks(stride).take(600);
        rows.flat_map(|row| row.chunks_exact(4).take(800)).map(|p| [p[2], p[1], p[0]]).collect()
    }

    /// The share of the display beside the panel that is not as its lower right corner: an X window dump, with 32 bits a pixel.
    fn displayed(&self) -> f64 {
        let dump = self.folder.read("Xvfb_screen0");
        let field = |n: usize| {
            let bytes = dump.get(4 * n..4 * n + 4).expect("a header");
            u32::from_be_bytes(bytes.try_into().expect("four bytes")) as usize
        };
        let (header, width, height, stride, colors) = (field(0), field(4), field(5), field(12), field(19));
        assert_eq!((field(11), width, height), (32, 800, 600), "32 bits a pixel");
        let pixels = &dump[header + 12 * colors..];
        let row = |y: usize| pixels[y * stride..][..4 * width].chunks_exact(4).map(|pixel| &pixel[..3]);
        let corner = row(height - 1).next_back();
        let beside = (0..height).flat_map(|y| row(y).skip(PANEL));
        let drawn = beside.filter(|pixel| Some(*pixel) != corner).count();
        drawn as f64 / ((width - PANEL) * height) as f64
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

pub(super) fn finish(child: Child) -> String {
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn built() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 4000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 128");
    folder
}

/// What is remembered of the one model that was opened.
fn remembered_text(folder: &Folder, name: &str) -> String {
    let state = fs::read_dir(folder.path("state/chpm")).expect("a folder");
    let files: Vec<_> = state.map(|entry| entry.expect("an entry").path()).collect();
    assert_eq!(files.len(), 1, "{files:?}");
    let text = fs::read_to_string(&files[0]).expect("text");
    let line = text.lines().find_map(|line| line.strip_prefix(&format!("{name} = ")));
    line.expect("a name").to_owned()
}

/// Numbers behind a name.
fn remembered(folder: &Folder, name: &str) -> Vec<f64> {
    let text = remembered_text(folder, name);
    let numbers = text.strip_prefix('[').and_then(|list| list.strip_suffix(']')).expect("a list").split(',');
    numbers.map(|number| number.trim().parse().expect("a number")).collect()
}

/// The number behind a name.
fn number(folder: &Folder, name: &str) -> f64 {
    remembered_text(folder, name).parse().expect("a number")
}

#[test]
fn it_opens_turns_and_quits_and_comes_back_as_it_was() {
    let Some(display) = Display::open() else { return };
    let folder = built();
    let child = display.spawn(&folder, "view in.chpm --up y --view front");
    display.window("in.chpm");
    display.wait_for_a_picture(0.2);
    display.hand("key ctrl+q");
    finish(child);
    let [start, target] = ["position", "target"].map(|name| Point3::from_slice(&remembered(&folder, name)));
    let child = display.spawn(&folder, "view in.chpm --up y --view front");
    display.window("in.chpm");
    display.wait_for_a_picture(0.2);
    display.hand("mousemove 500 300 key r mousedown 1 mousemove 520 310 mousemove 620 340 mouseup 1 key r");
    display.hand("key ctrl+q");
    finish(child);

    // A window's height of dragging is half a turn; the camera began at the front.
    let height = remembered(&folder, "window")[1];
    let arm = start - target;
    assert!(arm.x.abs() + arm.y.abs() < 1e-9 * arm.z, "{arm}");
    let turn = |pixels: f64| PI * pixels / height;
    let pitch = Rotation3::from_axis_angle(&Vector3::x_axis(), -turn(40.0));
    let yaw = Rotation3::from_axis_angle(&Vector3::y_axis(), -turn(120.0));
    let expected = target + yaw * (pitch * arm);
    let position = remembered(&folder, "position");
    let missed = (Point3::from_slice(&position) - expected).norm();
    assert!(missed < 1e-9 * arm.norm(), "{position:?} instead of {expected}");

    let path: CameraPath =
        fs::read_to_string(folder.path("in-1.path")).expect("a path").parse().expect("a path");
    assert!(!path.cameras.is_empty());
    assert!(folder.stdout("walk in.chpm in-1.path -q").contains("frame"));

    let child = display.spawn(&folder, "view in.chpm --adapter software");
    display.window("in.chpm");
    display.wait_for_a_picture(0.2);
    display.hand("key ctrl+q");
    finish(child);
    let again = Point3::from_slice(&remembered(&folder, "position"));
    assert!((again - Point3::from_slice(&position)).norm() < 1e-9 * arm.norm());
}

/// However fast keys come, every press counts; and a pointer does what the manual says.
#[test]
fn every_press_counts_and_a_drag_moves_the_light() {
    let Some(display) = Display::open() else { return };
    let folder = built();
    let child = display.spawn(&folder, "view in.chpm --up y --view front");
    display.window("in.chpm");
    display.wait_for_a_picture(0.2);
    // Eight times around the seven choices and one on: the first plane. Then five steps, and two of them back.
    display.hand(&format!("key --delay 0 {}", ["k"; 57].join(" ")));
    display.hand("key --delay 0 bracketleft bracketleft bracketleft bracketleft bracketleft");
    display.hand("key --delay 0 bracketright bracketright");
    display.hand("mousemove 500 300 keydown shift keydown ctrl mousedown 1 mousemove 520 310");
    display.hand("mousemove 560 330 mouseup 1 keyup ctrl keyup shift");
    display.hand("key ctrl+q");
    finish(child);
    let height = remembered(&folder, "window")[1];
    let [aside, above] = [0, 1].map(|axis| remembered(&folder, "light")[axis]);
    let [right, down] = [60.0, 30.0].map(|pixels| 180.0 * pixels / height);
    let [usual, high] = Look::LIGHT;
    assert!((aside - usual - right).abs() < 1e-9 && (above - high + down).abs() < 1e-9, "{aside} {above}");
    let [position, target] =
        ["position", "target"].map(|name| Point3::from_slice(&remembered(&folder, name)));
    let arm = position - target;
    assert!(arm.x.abs() + arm.y.abs() < 1e-9 * arm.z, "the camera stays: {arm}");
    let [clip, share] = ["clip", "clip_share"].map(|name| number(&folder, name));
    assert_eq!(clip, 1.0);
    assert!((share - (0.5 - 3.0 * 0.025)).abs() < 1e-9, "{share}");
}

/// The clipping plane that looks at the camera has an outline, filled, and V writes what `section` does.
#[test]
fn the_clipping_plane_has_an_outline_that_can_be_written() {
    let Some(display) = Display::open() else { return };
    let folder = built();
    let child = display.spawn(&folder, "view in.chpm --up y --view front");
    display.window("in.chpm");
    display.wait_for_a_picture(0.2);
    // The camera is at the front, where z is high.
    let presses = Up::ALL.iter().position(|up| up.axis() == 2 && !up.is_negative()).expect("an axis") + 1;
    display.hand(&format!("key --delay 0 {}", vec!["k"; presses].join(" ")));
    // Warm colours, which neither the model nor the panel has: lines, and what is filled in a darker one.
    let warm =
        |pixel: &&[u8; 3], least: u8| pixel[0] >= least && pixel[0] > pixel[1] && pixel[1] > pixel[2] + 30;
    let outline = |least: u8, most: u8| {
        let dump = display.dump();
        let beside = dump.chunks(800).flat_map(|row| &row[PANEL..]);
        beside.filter(|pixel| warm(pixel, least) && pixel[0] <= most).count()
    };
    display.wait_until(&|| outline(230, 255) > 300 && outline(130, 190) > 3000);
    display.hand("key v");
    display.wait_until(&|| folder.names().contains(&"in-1.svg".to_owned()));
    // Where there is no plane there is none.
    display.hand(&format!("key --delay 0 {}", vec!["k"; Up::ALL.len() + 1 - presses].join(" ")));
    display.wait_until(&|| outline(230, 255) == 0);
    display.hand("key ctrl+q");
    finish(child);

    let drawn = String::from_utf8(folder.read("in-1.svg")).expect("text");
    let title = drawn.split_once("<title>in, ").and_then(|(_, rest)| rest.split_once("</title>"));
    let plane = title.expect("a title").0;
    assert!(plane.starts_with("0,0,1:"), "{plane}");
    folder.stdout(&format!("section in.chpm --plane {plane} -o again.svg -q"));
    assert!(folder.read("again.svg") == drawn.into_bytes(), "the same drawing");
}

/// What the other buttons and the wheel do: the camera moves with what is held, and goes nearer to what is under the pointer.
#[test]
fn drags_move_what_is_held_and_the_wheel_comes_nearer() {
    let Some(display) = Display::open() else { return };
    let folder = built();
    let after = |steps: &[&str]| {
        let child = display.spawn(&folder, "view in.chpm");
        display.window("in.chpm");
        display.wait_for_a_picture(0.1);
        steps.iter().for_each(|step| drop(display.hand(step)));
        display.hand("key ctrl+q");
        finish(child);
        let [position, target] =
            ["position", "target"].map(|name| Point3::from_slice(&remembered(&folder, name)));
        (position, position - target)
    };
    let (start, arm) = after(&[]);
    for (held, button) in [("", 2), ("", 3), ("keydown shift ", 1)] {
        let (from, _) = after(&[]);
        let press = format!("mousemove 500 300 {held}mousedown {button} mousemove 520 300");
        let (to, same) = after(&[&press, &format!("mousemove 440 300 mouseup {button} keyup shift")]);
        assert!((same - arm).norm() < 1e-9 * arm.norm(), "{held}{button}: the camera turns: {same}");
        // The sphere's surface goes 60 pixels to the left, the camera to the right; its near side is half as far away as its middle, or farther.
        let fov = number(&folder, "fov").to_radians();
        let pixel = 2.0 * (fov / 2.0).tan() / remembered(&folder, "window")[1];
        let share = (to - from).norm() / (60.0 * pixel * arm.norm());
        assert!((0.5..1.0).contains(&share), "{held}{button}: {share} of what the middle would need");
        assert!((to - from).dot(&arm).abs() < 1e-9 * arm.norm_squared(), "{held}{button}: not aside");
        let back = format!("mousemove 440 300 {held}mousedown {button} mousemove 470 300");
        after(&[&back, &format!("mousemove 500 300 mouseup {button} keyup shift")]);
    }
    let distance = |steps: &[&str]| after(steps).0.coords.norm();
    let nearer = distance(&["mousemove 500 300 click --repeat 3 4"]) / start.coords.norm();
    assert!((0.3..0.95).contains(&nearer), "{nearer} of the distance");
    let farther = distance(&["mousemove 500 300 click --repeat 6 5"]) / start.coords.norm();
    assert!(farther > 1.05, "{farther} of the distance");
    let held = distance(&[
        "mousemove 500 300 keydown ctrl mousedown 1 mousemove 500 280",
        "mousemove 500 100 mouseup 1 keyup ctrl",
    ]);
    assert!(held < 0.9 * farther * start.coords.norm(), "a drag upward with Ctrl held comes nearer");
}

#[test]
fn a_script_leaves_the_picture_of_its_last_frame() {
    let Some(display) = Display::open() else { return };
    let folder = built();
    folder.stdout("path orbit in.chpm --frames 8 -o orbit.path");
    let picture = |frames: u32| {
        let words = format!("view in.chpm --path orbit.path --frames {frames} --screenshot {frames}.png -f");
        let told = finish(display.spawn(&folder, &words));
        assert!(told.contains(&format!("{frames} frame")), "{told}");
        let bytes = folder.read(&format!("{frames}.png"));
        let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("a small PNG")];
        reader.next_frame(&mut pixels).expect("a picture");
        let drawn = pixels.chunks_exact(4).filter(|pixel| *pixel != &pixels[..4]).count();
        assert!(drawn > pixels.len() / 4 / 20, "{drawn} pixels are drawn on");
        pixels
    };
    let (first, third) = (picture(1), picture(3));
    assert!(first == picture(1), "the same script, the same picture");
    assert!(first != third, "the camera went on");
    assert!(!folder.names().contains(&"state".to_owned()), "a script leaves nothing but its picture");
    let error = folder.stderr("view in.chpm --frames 1 --screenshot 1.png", 2);
    assert!(error.contains("--force"), "{error}");
}

#[test]
fn a_mesh_is_built_once() {
    let Some(display) = Display::open() else { return };
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 2000 -o in.ply -q");
    finish(display.spawn(&folder, "view in.ply --frames 1"));
    folder.stdout("verify in.chpm --against in.ply -q");
    let built = folder.read("in.chpm");
    finish(display.spawn(&folder, "view in.ply --frames 1 -q"));
    assert!(built == folder.read("in.chpm"));
    // Of another mesh the file is left alone.
    folder.stdout("synth sphere --triangles 3000 -o in.ply -qf");
    let error = folder.stderr("view in.ply --frames 1", 2);
    assert!(error.contains("not built from") && built == folder.read("in.chpm"), "{error}");
    finish(display.spawn(&folder, "view in.ply --frames 1 --force"));
    folder.stdout("verify in.chpm --against in.ply -q");
}

#[test]
fn a_mesh_is_seen_while_it_is_built() {
    let Some(display) = Display::open() else { return };
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 200000 -o in.ply -q");
    let child = display.spawn(&folder, "view in.ply");
    // The window is there before the file is, and has a picture of its own meanwhile.
    display.window("in.ply");
    display.wait_for_a_picture(0.1);
    display.window("in.chpm");
    display.hand("key ctrl+q");
    finish(child);
    folder.stdout("verify in.chpm --against in.ply -q");
    assert!(remembered(&folder, "position").len() == 3, "of the model, and of no preview");
}

#[test]
fn a_build_that_nobody_waits_for_leaves_nothing() {
    let Some(display) = Display::open() else { return };
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 1000000 -o in.ply -q");
    let child = display.spawn(&folder, "view in.ply");
    display.window("in.ply");
    display.hand("key ctrl+q");
    finish(child);
    assert_eq!(folder.names(), ["in.ply"]);
}

#[test]
fn a_path_is_typed_into_the_open_dialog() {
    opened_by_hand(&["key ctrl+o", "type --delay 60 pluncorb.chpm", "key Return"]);
}

/// Who types faster than frames come is heard, too.
#[test]
fn a_path_is_typed_before_the_dialog_is_there() {
    opened_by_hand(&["key --delay 0 ctrl+o p l u n x BackSpace c o r b period c h p m Return"]);
}

/// Opens pluncorb.chpm, every letter of which is a shortcut elsewhere.
fn opened_by_hand(steps: &[&str]) {
    let Some(display) = Display::open() else { return };
    let folder = built();
    fs::copy(folder.path("in.chpm"), folder.path("pluncorb.chpm")).expect("a copy");
    let child = display.spawn(&folder, "view in.chpm");
    display.window("in.chpm");
    display.wait_for_a_picture(0.2);
    for step in steps {
        display.hand(step);
    }
    display.window("pluncorb.chpm");
    display.hand("key ctrl+q");
    finish(child);
}

#[test]
fn what_cannot_be_shown_is_told() {
    let Some(display) = Display::open() else { return };
    let folder = built();
    let told = |child: Child| {
        let output = child.wait_with_output().expect("it ends");
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(told(display.spawn(&folder, "view none.chpm")).contains("none.chpm"));
    folder.write("bad.chpm", &folder.read("in.chpm")[..1000]);
    assert!(told(display.spawn(&folder, "view bad.chpm")).contains("bad.chpm"));
    assert!(told(display.spawn(&folder, "view in.chpm --frames 1 --adapter nobody's")).contains("nobody's"));
    folder.write("bad.path", "chpm-path 1\n1 2 3\n");
    assert!(told(display.spawn(&folder, "view in.chpm --path bad.path")).contains("line 2"));
    // Without a display, too, a file that is not there comes first.
    for (words, error) in [
        ("view in.chpm --frames 1", "DISPLAY"),
        ("view none.chpm", "'none.chpm'"),
        ("view in.chpm none.chpm", "'none.chpm'"),
        ("view none.ply", "'none.ply'"),
    ] {
        let mut blind = folder.command(words);
        let blind = blind.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        let output = blind.output().expect("it ends");
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(error), "{output:?}");
    }
}

#[test]
fn the_manual_has_every_key() {
    let manual = fs::read_to_string(root().join("docs/MANUAL.md")).expect("a manual");
    for (key, does) in MOTIONS.iter().copied().chain(KEYS.iter().map(|key| (key.key, key.does))) {
        assert!(manual.contains(&format!("| {key} | {does} |")), "{key}: {does}");
    }
}
