//! `chpm serve` and `chpm share`, and the page beside the library.

use super::harness::{Folder, skipped};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::{Camera, Cut, Hierarchy, View, is_visible, select_by};
use chpm_synth::{Shape, Synth};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::symlink;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// `chpm serve` at work; ended when it is dropped.
pub(super) struct Host {
    pub(super) child: Child,
    pub(super) address: String,
}

impl Host {
    pub(super) fn start(folder: &Folder, words: &str) -> Self {
        Self::begin(folder.command(&format!("serve {words} --port 0")))
    }

    pub(super) fn begin(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().expect("a process");
        let mut said = String::new();
        BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut said).expect("an address");
        let address = said.trim().trim_start_matches("http://");
        let address = address.split_once('/').expect("an address").0.to_owned();
        Host { child, address }
    }

    /// Status, headers and body of what is answered.
    pub(super) fn get(&self, path: &str, headers: &str) -> (u16, String, Vec<u8>) {
        self.ask(path, &self.address, headers)
    }

    /// The same where the server is called by another name.
    fn ask(&self, path: &str, host: &str, headers: &str) -> (u16, String, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.address).expect("a connection");
        // Who is refused may be told so before all is said, and is cut off then.
        let _ = write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}\r\n");
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").expect("a header");
        let head = String::from_utf8_lossy(&answer[..end]).to_ascii_lowercase();
        let status = head.split_whitespace().nth(1).and_then(|code| code.parse().ok()).expect("a status");
        (status, head, answer[end + 4..].to_vec())
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub(crate) fn built() -> Folder {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &Synth::new(Shape::Isosurface, 6_000, 1).to_mesh());
    folder.stdout("build in.ply -o a.chpm -q --cluster-triangles 512 --pages raw");
    folder
}

#[test]
fn ranges_of_one_file_are_served_and_nothing_else() {
    let folder = built();
    fs::copy(folder.path("a.chpm"), folder.path("b.chpm")).expect("a copy");
    let host = Host::start(&folder, "a.chpm");
    let whole = folder.read("a.chpm");
    let (status, head, body) = host.get("/a.chpm", "Range: bytes=100-299\r\n");
    assert_eq!(status, 206);
    assert!(head.contains(&format!("content-range: bytes 100-299/{}", whole.len())), "{head}");
    assert_eq!(body, whole[100..300]);
    let (status, head, _) = host.get("/", "");
    assert!(status == 307 && head.contains("view.html?file=a%2echpm"), "{head}");
    for (path, kind) in [("/view.html", "text/html"), ("/chpm/index.js", "text/javascript")] {
        let (status, head, _) = host.get(path, "");
        assert!(status == 200 && head.contains(kind), "{path}: {head}");
    }
    for path in ["/b.chpm", "/in.ply", "/../a.chpm", "/%2e%2e/a.chpm", "/%2fetc%2fpasswd", "/%ff", "/chpm/"] {
        assert_eq!(host.get(path, "").0, 404, "{path}");
    }
}

#[test]
fn a_model_is_served_whatever_its_name() {
    let folder = built();
    for name in ["model", "model.dat", "UP.CHPM", "a.0001.pages"] {
        fs::copy(folder.path("a.chpm"), folder.path(name)).expect("a copy");
        let host = Host::start(&folder, name);
        assert!(host.get(&format!("/{name}"), "").2 == folder.read("a.chpm"), "{name}");
        for other in ["a.chpm", "model.chpm", "up.chpm", "in.ply"] {
            assert_eq!(host.get(&format!("/{other}"), "").0, 404, "{name}: {other}");
        }
    }
    // In a folder it is the extension that says what is a model.
    let host = Host::start(&folder, ". --list");
    let page = String::from_utf8(host.get("/", "").2).expect("text");
    assert!(page.contains("UP.CHPM") && !page.contains("model"), "{page}");
    let answers = ["/UP.CHPM", "/model", "/model.dat"].map(|path| host.get(path, "").0);
    assert_eq!(answers, [200, 404, 404]);
}

/// The value of a header of an answer.
fn header<'a>(head: &'a str, name: &str) -> Option<&'a str> {
    head.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": ")).map(str::trim)
}

#[test]
fn parts_of_a_file_are_told_from_parts_of_another() {
    let folder = built();
    let host = Host::start(&folder, "a.chpm");
    let whole = folder.read("a.chpm");
    let (_, head, _) = host.get("/a.chpm", "");
    let tag = header(&head, "etag").expect("a tag").to_owned();
    let ask = |more: &str| host.get("/a.chpm", &format!("Range: bytes=5-9\r\n{more}\r\n"));
    assert_eq!(ask(&format!("If-Range: {tag}")).0, 206);
    assert_eq!(ask(&format!("If-Match: {tag}")).0, 206);
    assert_eq!(ask("If-Match: \"another\"").0, 412);
    // A tag says more than a date.
    let long_ago = "If-Unmodified-Since: Mon, 01 Jan 2001 00:00:00 GMT";
    assert_eq!(ask(long_ago).0, 412);
    assert_eq!(ask(&format!("If-Match: {tag}\r\n{long_ago}")).0, 206);
    assert_eq!(ask("If-None-Match: \"another\"").0, 206);
    assert_eq!(ask(&format!("If-None-Match: \"another\", W/{tag}")).0, 304);
    for other in ["\"another\"", "Mon, 01 Jan 2001 00:00:00 GMT"] {
        let (status, _, body) = ask(&format!("If-Range: {other}"));
        assert!(status == 200 && body == whole, "{other}: {status}");
    }
    // Of the same length and in the same second.
    folder.write("a.chpm", &whole);
    let (status, head, _) = ask(&format!("If-Range: {tag}"));
    assert_eq!(status, 200);
    assert_ne!(header(&head, "etag"), Some(&tag[..]));
}

#[test]
fn a_file_that_is_replaced_is_not_sent_under_the_tag_of_another() {
    let folder = built();
    let models = [folder.read("a.chpm"), folder.read("in.ply")];
    let host = Host::start(&folder, "a.chpm");
    let is_over = AtomicBool::new(false);
    let mut seen = BTreeSet::new();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for model in models.iter().rev().cycle().take_while(|_| !is_over.load(Relaxed)) {
                folder.write("new", model);
                fs::rename(folder.path("new"), folder.path("a.chpm")).expect("another file");
            }
        });
        for _ in 0..2000 {
            let (status, head, _) = host.get("/a.chpm", "Range: bytes=0-9\r\n");
            // The length is the second part of a tag.
            let tag = header(&head, "etag").and_then(|tag| tag.split('-').nth(1)).map(str::to_owned);
            let range = header(&head, "content-range").and_then(|range| range.split('/').nth(1));
            let len = range.and_then(|len| len.parse::<usize>().ok());
            seen.insert((status, len, tag));
        }
        is_over.store(true, Relaxed);
    });
    // Where it is replaced faster than it is looked at, nothing is sent.
    seen.remove(&(503, None, None));
    let both = models.iter().map(|model| (206, Some(model.len()), Some(format!("{:x}", model.len()))));
    assert_eq!(seen, both.collect());
}

#[test]
fn what_is_known_is_not_sent_again() {
    let folder = built();
    let host = Host::start(&folder, "a.chpm");
    for path in ["/a.chpm", "/view.html", "/chpm/index.js"] {
        let (_, head, _) = host.get(path, "");
        assert_eq!(header(&head, "cache-control"), Some("no-cache"), "{path}");
        let tag = header(&head, "etag").expect("a tag").to_owned();
        let (status, head, body) = host.get(path, &format!("If-None-Match: {tag}\r\n"));
        assert_eq!((status, header(&head, "etag"), body.len()), (304, Some(&tag[..]), 0), "{path}");
        assert_eq!(host.get(path, "If-None-Match: \"another\"\r\n").0, 200, "{path}");
    }
}

#[test]
fn odd_ranges_are_answered_as_the_standard_says() {
    let folder = built();
    let host = Host::start(&folder, "a.chpm");
    let whole = folder.read("a.chpm");
    let len = whole.len();
    let all = format!("bytes 0-{}/{len}", len - 1);
    for (range, status, content) in [
        ("bytes=-4".to_owned(), 206, Some(format!("bytes {}-{}/{len}", len - 4, len - 1))),
        (format!("bytes=-{}", len + 9), 206, Some(all.clone())),
        (format!("bytes=0-{}", len + 9), 206, Some(all.clone())),
        // Beyond 64 bits.
        ("bytes=0-99999999999999999999".to_owned(), 206, Some(all.clone())),
        ("bytes=-99999999999999999999".to_owned(), 206, Some(all)),
        ("bytes=99999999999999999999-".to_owned(), 416, Some(format!("bytes */{len}"))),
        (format!("bytes={len}-"), 416, Some(format!("bytes */{len}"))),
        ("bytes=-0".to_owned(), 416, Some(format!("bytes */{len}"))),
        ("lines=1-2".to_owned(), 200, None),
        ("BYTES=0-3".to_owned(), 206, Some(format!("bytes 0-3/{len}"))),
        ("bytes=0-3,".to_owned(), 206, Some(format!("bytes 0-3/{len}"))),
        // All of it is an answer, too.
        ("bytes=0-3,8-9".to_owned(), 200, None),
    ] {
        let (got, head, body) = host.get("/a.chpm", &format!("Range: {range}\r\n"));
        assert_eq!((got, header(&head, "content-range")), (status, content.as_deref()), "{range}");
        let is_part = whole.starts_with(&body) || whole.ends_with(&body);
        assert!(status == 416 || is_part && !body.is_empty(), "{range}");
    }
    let ask = |method: &str| {
        let mut stream = TcpStream::connect(&host.address).expect("a connection");
        let more = "Host: localhost\r\nConnection: close\r\nRange: bytes=0-3\r\n\r\n";
        write!(stream, "{method} /a.chpm HTTP/1.1\r\n{more}").expect("a request");
        let mut said = String::new();
        stream.read_to_string(&mut said).expect("an answer");
        said.to_lowercase()
    };
    let said = ask("POST");
    assert!(said.contains(" 405 ") && said.contains("allow: get, head"), "{said}");
    // A range is one of what GET answers with.
    let said = ask("HEAD");
    assert!(said.contains(" 200 ") && said.contains(&format!("content-length: {len}\r\n")), "{said}");
    assert!(!said.contains("content-range"), "{said}");
}

#[test]
fn who_asks_by_another_name_gets_nothing() {
    let folder = built();
    let host = Host::start(&folder, "a.chpm");
    let port = host.address.rsplit(':').next().expect("a port");
    for name in ["localhost", "LOCALHOST", "localhost.", "127.0.0.1", "127.3.2.1", "[::1]"] {
        assert_eq!(host.ask("/a.chpm", &format!("{name}:{port}"), "").0, 200, "{name}");
        assert_eq!(host.ask("/a.chpm", name, "").0, 200, "{name}");
    }
    for name in
        ["example.org", "localhost.example.org", "localhost..", "127.0.0.1.example.org", "10.0.0.1", ""]
    {
        for path in ["/a.chpm", "/view.html", "/"] {
            assert_eq!(host.ask(path, &format!("{name}:{port}"), "").0, 403, "{name} {path}");
        }
    }
    let open = Host::start(&folder, "a.chpm --address 0.0.0.0");
    assert_eq!(open.ask("/a.chpm", "example.org", "").0, 200);
}

#[test]
fn a_folder_shows_no_list_unless_asked_and_lets_nobody_out() {
    let folder = built();
    fs::create_dir(folder.path("inner")).expect("a folder");
    fs::copy(folder.path("a.chpm"), folder.path("inner/a <b>.chpm")).expect("a copy");
    symlink(folder.path("a.chpm"), folder.path("inner/out.chpm")).expect("a link");
    symlink(folder.path("inner/a <b>.chpm"), folder.path("inner/within.chpm")).expect("a link");
    folder.write("inner/notes.txt", "private");
    fs::create_dir(folder.path("inner/.old")).expect("a folder");
    fs::copy(folder.path("a.chpm"), folder.path("inner/.old/b.chpm")).expect("a copy");
    fs::copy(folder.path("a.chpm"), folder.path("inner/.c.chpm")).expect("a copy");
    let quiet = Host::start(&folder, "inner");
    let (status, head, _) = quiet.get("/", "");
    assert!(status == 307 && head.ends_with("view.html") || head.contains("location: view.html\r"), "{head}");
    assert_eq!(quiet.get("/a%20%3Cb%3E.chpm", "").0, 200);
    assert_eq!(quiet.get("/within.chpm", "").0, 200);
    for path in [
        "/out.chpm",
        "/notes.txt",
        "/.c.chpm",
        "/.old/b.chpm",
        "/%2eold/b.chpm",
        "/../a.chpm",
        "/inner/../../a.chpm",
    ] {
        assert_eq!(quiet.get(path, "").0, 404, "{path}");
    }

    let list = Host::start(&folder, "inner --list");
    let page = String::from_utf8(list.get("/", "").2).expect("text");
    assert!(page.contains("a &lt;b&gt;.chpm") && page.contains("within.chpm"), "{page}");
    assert!(!page.contains("out.chpm") && !page.contains("notes") && !page.contains(".c.chpm"), "{page}");
    // What is named is meant.
    assert_eq!(Host::start(&folder, "inner/.c.chpm").get("/.c.chpm", "").0, 200);
}

#[test]
fn what_cannot_be_served_is_said_at_once() {
    let folder = built();
    assert!(folder.stderr("serve absent.chpm --port 0", 2).contains("absent.chpm"));
    assert!(folder.stderr("serve in.ply --port 0", 2).contains("in.ply"));
    assert!(folder.stderr("serve a.chpm --list --port 0", 2).contains("--list is for a folder"));
    let host = Host::start(&folder, "a.chpm");
    let port = host.address.rsplit(':').next().expect("a port");
    let said = folder.stderr(&format!("serve a.chpm --port {port}"), 2);
    assert!(said.contains("--port"), "{said}");
}

/// From where a page shows its model first.
fn seen_first(page: &str) -> Value {
    let escaped =
        page.split_once("data-view=\"").and_then(|(_, rest)| rest.split_once('"')).expect("a view").0;
    serde_json::from_str(&escaped.replace("&quot;", "\"").replace("&lt;", "<").replace("&amp;", "&"))
        .expect("JSON")
}

#[test]
fn a_page_knows_how_its_model_stands() {
    let folder = Folder::new();
    // A wedge that stands on its broad side when -y is up, and something that has y up.
    let wedge =
        "v -2 1 -2\nv 2 1 -2\nv 2 1 2\nv -2 1 2\nv 0 -4 0\nf 4 3 2 1\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n";
    for (name, mesh, up, ahead) in
        [("down", wedge.to_owned(), "-y", 1.0), ("up", wedge.replace("v 0 -4", "v 0 6"), "y", -1.0)]
    {
        folder.write(&format!("{name}.obj"), mesh);
        folder.stdout(&format!("build {name}.obj -q"));
        let host = Host::start(&folder, &format!("{name}.chpm"));
        let (status, _, page) = host.get(&format!("/view.html?pixels=2&file={name}%2Echpm"), "");
        let view = seen_first(&String::from_utf8(page).expect("text"));
        assert_eq!((status, view["up"].as_str()), (200, Some(up)), "{view}");
        assert!(view["sight"][2].as_f64().is_some_and(|z| z * ahead > 0.5), "{view}");
        // Without a model, or with one that is not served, the page is as it is.
        for path in ["/view.html", "/view.html?file=in.ply", "/view.html?file=..%2Fx.chpm"] {
            let (status, _, page) = host.get(path, "");
            assert!(status == 200 && !String::from_utf8_lossy(&page).contains("data-view"), "{path}");
        }
    }
}

#[test]
fn a_folder_to_share_has_all_that_its_page_loads() {
    let folder = built();
    folder.stdout("relayout a.chpm -o packed.chpm --pages packed -q");
    folder.stdout("share packed.chpm -o unpacked -q --pages raw");
    assert_eq!(folder.read("unpacked/model.chpm"), folder.read("a.chpm"));
    let said = folder.stdout("share a.chpm -o site -q");
    assert_eq!(folder.read("site/model.chpm"), folder.read("packed.chpm"));
    assert!(said.contains("a model of "), "{said}");
    // What is shorter stays so, unless something else is asked for.
    folder.stdout("relayout a.chpm -o chained.chpm --pages chained -q");
    folder.stdout("share chained.chpm -o chained -q");
    assert_eq!(folder.read("chained/model.chpm"), folder.read("chained.chpm"));
    folder.stdout("share chained.chpm -o chained -q --force --pages packed");
    assert!(folder.read("chained/model.chpm").len() > folder.read("chained.chpm").len());
    let index = String::from_utf8(folder.read("site/index.html")).expect("text");
    assert!(index.contains("data-file=\"model.chpm\""), "{index}");
    // From where it is seen first is decided here, as for `render`; and what is asked for first.
    let seen = seen_first(&index);
    assert!(seen["points"].as_array().is_some_and(|points| points.len() > 8));
    let file =
        Chpm::open(MappedFile::open(&folder.path("site/model.chpm")).expect("a file")).expect("a CHPM");
    let root = &file.clusters()[0];
    assert_eq!(seen["first"][1], serde_json::json!([root.page_offset, root.page_len]));
    // The page is one file, and the folder has nothing but that and the model.
    assert!(!index.contains("src=\"view") && !index.contains("href=\"view"), "{index}");
    let mut names: Vec<_> = fs::read_dir(folder.path("site"))
        .expect("a folder")
        .map(|entry| entry.expect("one").file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["index.html", "model.chpm"]);
    let again = folder.stderr("share packed.chpm -o site -q", 2);
    assert!(again.contains("--force"), "{again}");
    folder.stdout("share packed.chpm -o site -q --force");

    // What fails on its way leaves nothing, and what was there as it was.
    let mut damaged = folder.read("packed.chpm");
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    folder.write("damaged.chpm", &damaged);
    let before = folder.names();
    for target in ["new", "site"] {
        folder.stderr(&format!("share damaged.chpm -o {target} -q --force --pages raw"), 2);
    }
    assert_eq!(folder.names(), before);
    assert_eq!(folder.read("site/model.chpm"), folder.read("packed.chpm"));
    // Nor does it take what is somebody else's.
    folder.write("site/notes.txt", b"mine");
    let told = folder.stderr("share packed.chpm -o site -q --force", 2);
    assert!(told.contains("notes.txt"), "{told}");
    // The model may be that of the folder itself.
    fs::remove_file(folder.path("site/notes.txt")).expect("a file removed");
    folder.stdout("share site/model.chpm -o site -q --force --pages raw");
    assert_eq!(folder.read("site/model.chpm"), folder.read("a.chpm"));
}

#[test]
fn a_mesh_is_shared_by_one_command_as_it_is_to_be_shown() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &Synth::new(Shape::Isosurface, 6_000, 1).to_mesh());
    let told = [
        "--up",
        "-z",
        "--view",
        "back",
        "--title",
        "B\u{fc}ste <1> \"a\"",
        "--credit",
        "a museum",
        "--background",
        "#102030",
    ];
    let done = folder.command("share in.ply -o site -q").args(told).output().expect("a process");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let page = String::from_utf8(folder.read("site/index.html")).expect("text");
    let seen = seen_first(&page);
    assert_eq!(seen["up"], "-z");
    assert_eq!(
        (seen["title"].as_str(), seen["credit"].as_str()),
        (Some("B\u{fc}ste <1> \"a\""), Some("a museum"))
    );
    assert_eq!(seen["background"], "102030");
    assert!(page.contains("<title>B\u{fc}ste &lt;1> &quot;a&quot;</title>"), "{page}");
    // Notes lie beside.
    folder.write("notes.txt", r#"[{"at": [0.5, 0.5, 0.5], "title": "Here", "text": "A note"}]"#);
    folder.stdout("share in.ply -o noted -q --notes notes.txt");
    assert_eq!(folder.read("noted/notes.json"), folder.read("notes.txt"));
    assert_eq!(
        seen_first(&String::from_utf8(folder.read("noted/index.html")).expect("text"))["notes"],
        "notes.json"
    );
    for bad in ["{}", "[{}]", "[1]", "[{\"at\": [1, 2], \"title\": \"x\"}]"] {
        folder.write("bad.json", bad);
        let said = folder.stderr("share in.ply -o none -q --notes bad.json", 2);
        assert!(said.contains("bad.json") && !folder.path("none").exists(), "{said}");
    }
    // Kept with the file: whoever shares that needs not be told, and may tell otherwise.
    folder.stdout("share site/model.chpm -o again -q --up x --pages raw");
    let again = seen_first(&String::from_utf8(folder.read("again/index.html")).expect("text"));
    assert_eq!((again["up"].as_str(), again["title"].as_str()), (Some("x"), seen["title"].as_str()));
    folder.stdout("build in.ply -o told.chpm -q --title Bust --up -z --view back");
    folder.stdout("share told.chpm -o third -q");
    let third = seen_first(&String::from_utf8(folder.read("third/index.html")).expect("text"));
    assert_eq!(
        (third["title"].as_str(), &third["up"], &third["sight"]),
        (Some("Bust"), &seen["up"], &seen["sight"])
    );
    // Settings that tell how a model is shown change nothing of it.
    folder.stdout("build in.ply -o plain.chpm -q --pages packed");
    folder.stdout("share plain.chpm -o plain -q");
    assert_eq!(folder.read("plain/model.chpm"), folder.read("plain.chpm"));
    // Without a title the page has the name of the file that was shared.
    fs::copy(folder.path("in.ply"), folder.path("a bust.scan.ply")).expect("a copy");
    let done = folder.command("share -o named -q").arg("a bust.scan.ply").output().expect("a process");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    for (site, title) in [("plain", "plain"), ("named", "a bust.scan")] {
        let page = String::from_utf8(folder.read(&format!("{site}/index.html"))).expect("text");
        assert!(
            seen_first(&page)["title"] == title && page.contains(&format!("<title>{title}</title>")),
            "{site}"
        );
    }
    let said = folder.stderr("share in.ply -o other -q --background blue", 2);
    assert!(said.contains("RRGGBB"), "{said}");
    assert!(!folder.path("other").exists());
}

#[test]
fn a_model_in_pieces_is_the_model() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &Synth::new(Shape::Isosurface, 60_000, 1).to_mesh());
    folder.stdout("build in.ply -o a.chpm -q --cluster-triangles 512 --pages raw");
    let said = folder.stdout("share a.chpm -o site -q --split --pages raw");
    assert!(said.contains("http.server"), "{said}");
    assert!(!folder.path("site/model.chpm").exists());
    let pieces =
        seen_first(&String::from_utf8(folder.read("site/index.html")).expect("text"))["pieces"].clone();
    let whole = folder.read("a.chpm");
    assert_eq!(pieces["size"], whole.len());
    let length = pieces["length"].as_u64().expect("a number") as usize;
    let mut joined = Vec::new();
    for number in 0..whole.len().div_ceil(length) {
        let piece = folder.read(&format!("site/model/{number:05}.bin"));
        assert!(piece.len() == length || joined.len() + piece.len() == whole.len(), "{number}");
        joined.extend(piece);
    }
    assert_eq!(joined, whole);
    // Another one in its place, in pieces and then in one.
    folder.stdout("share a.chpm -o site -q --split --force");
    folder.stdout("share a.chpm -o site -q --force");
    assert!(folder.path("site/model.chpm").exists() && !folder.path("site/model").exists());
}

#[test]
fn the_page_draws_what_the_library_selects() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &Synth::new(Shape::Isosurface, 40_000, 1).to_mesh());
    folder.stdout("build in.ply -o a.chpm -q --cluster-triangles 512 --pages raw");
    let tests = concat!(env!("CARGO_MANIFEST_DIR"), "/web/test");
    let mut node = Command::new("node");
    let Ok(out) = node.current_dir(tests).arg("cameras.mjs").arg(folder.path("a.chpm")).output() else {
        skipped("the page: no Node.js");
        return;
    };
    let said = String::from_utf8_lossy(&out.stderr);
    if out.status.code() == Some(3) {
        skipped(format_args!("the page: {}", said.trim()));
        return;
    }
    assert!(out.status.success(), "{said}");

    let file = Chpm::open(MappedFile::open(&folder.path("a.chpm")).expect("a file")).expect("a CHPM");
    let hierarchy = Hierarchy::new(&file);
    let lines: Vec<Value> = String::from_utf8_lossy(&out.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(lines.len(), 20);
    let (mut sizes, mut culled) = (Vec::new(), 0);
    for drawn in lines {
        assert_eq!(drawn["status"], "settled", "{}", drawn["message"]);
        let number = |key: &str| drawn[key].as_f64().expect(key);
        let point = |key: &str| -> [f64; 3] { serde_json::from_value(drawn[key].clone()).expect(key) };
        let camera = Camera {
            fov: number("fov"),
            near: number("near"),
            up: point("up"),
            ..Camera::looking(point("eye"), point("target"))
        };
        let viewport = ["width", "height"].map(|key| number(key) as u32);
        let view = View::new(&camera, viewport, number("pixels")).expect("a view").with_culling(true);
        let selected = select_by(&file, &hierarchy, |group| hierarchy.bound(group, &view)).expect("a cut");
        let expected: Vec<(u32, u32)> =
            selected.members().iter().map(|member| (member.cluster.0, member.vertices)).collect();
        let got: Vec<(u32, Option<f32>)> = serde_json::from_value(drawn["cut"].clone()).expect("a cut");
        let position = |(cluster, bound): (u32, Option<f32>)| {
            let page = file.page(chpm_mesh::ClusterId(cluster)).expect("a page");
            (cluster, page.view().vertices_for(bound.unwrap_or(f32::INFINITY)) as u32)
        };
        let mut got: Vec<(u32, u32)> = got.into_iter().map(position).collect();
        got.sort_unstable();
        assert_eq!(got, expected, "{camera:?}");
        let seen = selected.members().iter().copied();
        let seen = Cut::new(
            seen.filter(|member| is_visible(&file.clusters()[member.cluster.index()], &view)).collect(),
        );
        assert_eq!(number("clusters") as usize, seen.members().len(), "{camera:?}");
        assert_eq!(number("triangles") as u64, seen.triangle_count(&file).expect("a count"));
        culled += usize::from(seen.members().len() < got.len());
        sizes.push(got.len());
    }
    assert!(culled > 5, "{culled}");
    assert!(sizes.iter().max() > Some(&20) && sizes.iter().min() < Some(&5), "{sizes:?}");
}
