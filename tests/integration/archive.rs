//! `chpm export --3dtiles X.3tz`: a tileset as one file, read back by two readers of others: Python's `zipfile`, and a search of the index.

use super::harness::{CHPM, Folder, shell, skipped, text};
use super::tiles::files;
use nix::sys::signal::Signal;
use std::collections::BTreeSet;
use std::process::Command;

/// Unpacks an archive into a folder, and finds each of its files as the format's text has it: `python3 - ARCHIVE FOLDER`.
const READER: &str = r#"
import hashlib, struct, sys, zipfile
path, folder = sys.argv[1:]
raw = open(path, "rb").read()
archive = zipfile.ZipFile(path)
assert archive.testzip() is None
entries = archive.infolist()
index = entries[-1]
assert index.filename == "@3dtilesIndex1@" and index.comment == b""
assert len({entry.filename for entry in entries}) == len(entries)
for entry in entries:
    assert entry.compress_type == zipfile.ZIP_STORED and entry.flag_bits == 0 and entry.date_time == (1980, 1, 1, 0, 0, 0)
    assert ".3tz" not in entry.filename
table = archive.read(index)
rows = [struct.unpack("<QQQ", table[at:at + 24]) for at in range(0, len(table), 24)]
assert rows == sorted(rows) and len(rows) == len(entries) - 1
places = {row[:2]: row[2] for row in rows}
for entry in entries[:-1]:
    at = places[struct.unpack("<QQ", hashlib.md5(entry.filename.encode()).digest())]
    assert at == entry.header_offset and raw[at:at + 4] == b"PK\3\4"
    crc, packed, size, name, extra = struct.unpack("<IIIHH", raw[at + 14:at + 30])
    assert (crc, packed, size, extra) == (entry.CRC, entry.file_size, entry.file_size, 0)
    assert raw[at + 30:at + 30 + name].decode() == entry.filename
    assert raw[at + 30 + name:at + 30 + name + size] == archive.read(entry)
archive.extractall(folder, entries[:-1])
print(len(entries), len(raw))
"#;

/// Unpacks an archive into a folder of the name `NAME.unpacked`; how many files it has. None where there is no Python.
fn unpack(folder: &Folder, name: &str) -> Option<usize> {
    folder.write("reader.py", READER);
    let mut reader = Command::new("python3");
    reader.current_dir(folder.path("")).args(["reader.py", name, &format!("{name}.unpacked")]);
    let Ok(out) = reader.output() else {
        skipped("the archive of tiles: no python3 (sudo apt-get install python3)");
        return None;
    };
    assert!(out.status.success(), "{name}: {}", text(&out.stderr));
    let told = text(&out.stdout);
    let numbers: Vec<usize> = told.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert_eq!(numbers[1], folder.read(name).len());
    Some(numbers[0])
}

#[test]
fn an_archive_has_the_files_of_the_folder() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 40000 -o plain.ply -q");
    folder.stdout("build plain.ply --cluster-triangles 256 -q");
    super::crs::hills(&folder);
    folder.stdout("build hills.ply --cluster-triangles 512 -q");
    super::sheets::add_textured(&folder);
    folder.stdout("build a.obj -q --texture sheets --cluster-triangles 512");
    for (name, words) in [
        ("one", "plain.chpm --up z"),
        ("packed", "plain.chpm --span 2 --meshopt --origin 13.4,52.5,34 --origin-at centre"),
        ("placed", "hills.chpm --crs EPSG:32633 --geoid 40 --normals none"),
        ("sheets", "a.chpm"),
    ] {
        let told = folder.stdout(&format!("export {words} --3dtiles {name} -q"));
        let archived = folder.stdout(&format!("export {words} --3dtiles {name}.3tz -q --threads 1"));
        let expected = files(&folder.path(name));
        // The same summary, and what the archive takes.
        let (sums, whole) = archived.trim_end().rsplit_once("; the archive has ").expect("a summary");
        assert_eq!(sums.replace(".3tz", ""), told.trim_end(), "{whole}");
        if let Some(count) = unpack(&folder, &format!("{name}.3tz")) {
            assert_eq!(count, expected.len() + 1);
            assert!(files(&folder.path(&format!("{name}.3tz.unpacked"))) == expected, "{name}");
        }
        let bytes = folder.read(&format!("{name}.3tz"));
        let again = format!("export {words} --3dtiles {name}.3tz -q");
        assert!(folder.stderr(&again, 2).contains("--force"));
        folder.stdout(&format!("{again} -f --memory 200M"));
        assert!(bytes == folder.read(&format!("{name}.3tz")), "{name}: the same bytes");
    }
    let names: BTreeSet<String> = files(&folder.path("sheets")).into_keys().collect();
    assert!(names.iter().any(|name| name.ends_with(".png") || name.ends_with(".jpg")), "{names:?}");
}

#[test]
fn an_archive_appears_whole_or_not_at_all() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 40000 -o in.ply -q");
    folder.stdout("build in.ply --cluster-triangles 16 -q");
    let before = folder.names();
    for (words, told) in [
        ("in.chpm --3dtiles no/such.3tz", "no/such"),
        ("in.chpm --3dtiles in.chpm/x.3tz", "in.chpm/x.3tz"),
        ("in.chpm --3dtiles x.3TZ --memory 1M", "--memory"),
        ("in.ply --3dtiles x.3tz", "in.ply"),
    ] {
        let error = folder.stderr(&format!("export -q {words}"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    // On a disk, or under a limit, that has no room for it.
    let out = shell(&folder, "ulimit -f 120; chpm export in.chpm --3dtiles out.3tz -q");
    let told = text(&out.stderr);
    assert!(out.status.code() == Some(2) && told.contains("out.3tz"), "{told}");
    assert_eq!(folder.names(), before);
    for stage in ["tree", "tiles"] {
        let (status, told) = folder.signalled("export in.chpm --3dtiles out.3tz", stage, Signal::SIGINT);
        match status.success() {
            false => assert_eq!(folder.names(), before, "{told:?}"),
            // It was faster than the signal.
            true => std::fs::remove_file(folder.path("out.3tz")).expect("the output"),
        }
    }
    // A folder is no archive, nor is a file a folder.
    std::fs::create_dir(folder.path("dir.3tz")).expect("a folder");
    assert!(folder.stderr("export in.chpm --3dtiles dir.3tz -qf", 2).contains("directory"));
    let error = folder.stderr("share in.chpm -o new.3tz -q", 2);
    assert!(!cfg!(feature = "web") || error.contains("a 3D Tiles archive"), "{CHPM}: {error}");
}
