//! Damaged .chpm files: each verb answers, none panics.

use super::harness::{Folder, text};

const VERBS: [&str; 13] = [
    "verify bad.chpm -q",
    "info bad.chpm",
    "dump bad.chpm --pages",
    "extract bad.chpm --triangles 2000 -o out.ply -qf",
    "extract bad.chpm --level 0 -o out.ply -qf",
    "extract bad.chpm --level 0 -o out.stl -qf",
    "extract bad.chpm --level 0 -o out.glb -qf --meshopt",
    "export bad.chpm --3dtiles tiles -qf",
    "export bad.chpm --3dtiles tiles.3tz -qf",
    "export bad.chpm --meshlets out.meshlets -qf",
    "path dive bad.chpm --frames 5 -o out.path -f",
    "walk bad.chpm good.path --poe 0.1 -q",
    "walk bad.chpm good.path --poe 0.1 --latency 1 --prefetch 1M --memory 200K -q",
];

fn built() -> (Folder, Vec<u8>) {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 4000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 512");
    folder.stdout("path dive in.chpm --frames 5 -o good.path");
    let bytes = folder.read("in.chpm");
    (folder, bytes)
}

/// Runs all verbs on `bytes`; each must end with a code of `allowed`, and verify with 1.
fn all_verbs(folder: &Folder, bytes: &[u8], allowed: &[i32], what: &str) {
    folder.write("bad.chpm", bytes);
    for verb in VERBS {
        let output = folder.chpm(verb);
        let output = output.get_output();
        let code = output.status.code().unwrap_or(-1);
        let expected = if verb.starts_with("verify") { &[1] } else { allowed };
        assert!(expected.contains(&code), "{what}: {verb}: {code}: {}", text(&output.stderr));
        assert!(!text(&output.stderr).contains("panicked"), "{what}: {verb}");
    }
}

#[test]
fn a_changed_byte_is_found_wherever_it_is() {
    let (folder, bytes) = built();
    // Some of the header, some of the tables, some of the pages and their padding: every 7th part of each.
    let pages = bytes.windows(4).position(|window| window == b"CPGE").expect("a page");
    let header = (0..256).step_by(37);
    let tables = (256..pages).step_by(pages / 7 + 1);
    let rest = (pages..bytes.len()).step_by((bytes.len() - pages) / 9 + 1).chain([bytes.len() - 1]);
    for (places, allowed) in
        [(header.chain(tables).collect::<Vec<_>>(), [1, 2].as_slice()), (rest.collect(), &[0, 2])]
    {
        for place in places {
            let mut bad = bytes.clone();
            bad[place] ^= 0x55;
            // The zero bytes between tables are not read by a verb that does not look for them.
            let allowed = if bytes[place] == 0 && place >= 256 { &[0, 1, 2] } else { allowed };
            all_verbs(&folder, &bad, allowed, &format!("byte {place}"));
        }
    }
}

#[test]
fn a_cut_file_is_refused() {
    let (folder, bytes) = built();
    for len in [0, 1, 7, 8, 255, 256, 300, 4095, 4096, bytes.len() / 2, bytes.len() - 1] {
        all_verbs(&folder, &bytes[..len], &[2], &format!("{len} bytes"));
    }
    let longer = [bytes.as_slice(), b"more"].concat();
    all_verbs(&folder, &longer, &[2], "four bytes too many");
}

#[test]
fn other_files_are_refused() {
    let (folder, _) = built();
    all_verbs(&folder, &folder.read("in.ply"), &[2], "a PLY");
    all_verbs(&folder, &[0xff; 10_000], &[2], "noise");
}
