//! The same file with its pages stored otherwise.

use super::harness::Folder;
use chpm_format::{Chpm, ChpmWriter, ClusterRecord, Gaps, Tables, checksum};
use chpm_mesh::{Attributes, ClusterId, GroupId};
use chpm_synth::{Shape, Synth};

fn built(attributes: Attributes, triangles: u64) -> Folder {
    let folder = Folder::new();
    let mut mesh = Synth::new(Shape::Isosurface, triangles, 1).to_mesh();
    let vertices = 0..mesh.positions.len();
    if attributes.normals {
        mesh.normals = mesh.positions.clone();
    }
    if attributes.colors {
        mesh.colors = vertices.map(|v| [v as u8, (v / 7) as u8, 9, 255]).collect();
    }
    folder.write_mesh("in.ply", &mesh);
    folder.stdout("build in.ply -q --cluster-triangles 512");
    folder
}

#[test]
fn packed_pages_hold_the_same_in_less_than_half_and_go_back() {
    for attributes in [Attributes::NONE, Attributes::ALL] {
        let folder = built(attributes, 12_000);
        let said = folder.stdout("relayout in.chpm -o packed.chpm --pages packed -q");
        assert!(said.contains("bytes a source triangle"), "{said}");
        let [raw, packed] = ["in.chpm", "packed.chpm"].map(|name| folder.read(name));
        assert!(2 * packed.len() < raw.len(), "{} of {}", packed.len(), raw.len());
        let same = folder.stdout("verify packed.chpm --same-as in.chpm --against in.ply --cuts 3 -q");
        assert!(same.contains("packed.chpm: holds the same as in.chpm"), "{same}");
        folder.stdout("verify in.chpm --same-as packed.chpm -q");
        folder.stdout("relayout packed.chpm -o back.chpm --pages raw -q");
        assert!(folder.read("back.chpm") == raw, "every byte comes back");
        folder.stdout("relayout packed.chpm -o again.chpm --pages packed -q --threads 1");
        assert!(
            folder.read("again.chpm") == packed,
            "the same bytes, whatever it is made from, by any threads"
        );
    }
}

#[test]
fn a_build_packs_as_relayout_does() {
    let folder = built(Attributes::ALL, 12_000);
    folder.stdout("relayout in.chpm -o packed.chpm --pages packed -q");
    for resources in ["", "--threads 1 --memory 128M"] {
        folder.stdout(&format!(
            "build in.ply -o built.chpm -qf --cluster-triangles 512 --pages packed {resources}"
        ));
        let [built, packed] = ["built.chpm", "packed.chpm"].map(|name| folder.read(name));
        // The built one says so in its settings.
        assert!(built.len().abs_diff(packed.len()) < 128, "{} {}", built.len(), packed.len());
        let [built, packed] = [built, packed].map(|bytes| Chpm::open(bytes).expect("a file"));
        for id in (0..built.clusters().len() as u32).map(ClusterId) {
            assert!(built.page_bytes(id) == packed.page_bytes(id), "{id}");
        }
    }
    folder.stdout("verify built.chpm --same-as in.chpm --against in.ply -q");
    folder.stdout("build in.ply -o trimmed.chpm -q --cluster-triangles 512 --pages packed --finest-error 1%");
    folder.stdout("verify trimmed.chpm --against in.ply -q");
}

#[test]
fn verbs_answer_of_packed_pages_what_they_answer_of_raw_ones() {
    let folder = built(Attributes::ALL, 12_000);
    folder.stdout("relayout in.chpm -o packed.chpm --pages packed -q");
    for how in ["--triangles 3000", "--error 0.5%", "--level 1", "--level 0"] {
        folder.stdout(&format!("extract in.chpm {how} -o a.ply -f"));
        folder.stdout(&format!("extract packed.chpm {how} -o b.ply -f"));
        assert!(folder.read("a.ply") == folder.read("b.ply"), "{how}");
    }
    folder.stdout("path dive in.chpm --frames 10 -o dive.path");
    let columns = |name: &str| {
        let text = String::from_utf8(folder.read(name)).expect("text");
        // Times and reads of the file differ.
        let lines = text.lines().map(|line| line.split(',').take(5).collect::<Vec<_>>().join(","));
        lines.collect::<Vec<_>>()
    };
    // Where pages come late, go and come again, too.
    for how in ["", "--latency 2 --prefetch 200K", "--memory 500K --latency 1"] {
        folder.stdout(&format!("walk in.chpm dive.path {how} --csv a.csv -qf"));
        folder.stdout(&format!("walk packed.chpm dive.path {how} --csv b.csv -qf"));
        assert_eq!(columns("a.csv"), columns("b.csv"), "{how}");
    }
    let pages = |name: &str| {
        let text = folder.stdout(&format!("dump --pages {name}"));
        text.lines().filter(|line| line.starts_with("  ")).map(str::to_owned).collect::<Vec<_>>()
    };
    assert!(pages("in.chpm") == pages("packed.chpm"));
}

#[test]
fn an_order_changes_places_only() {
    let folder = built(Attributes::ALL, 12_000);
    folder.stdout("build in.ply -o plain.chpm -q --cluster-triangles 512 --order simplification");
    let open = |name: &str| Chpm::open(folder.read(name)).expect("a file");
    // Whether all that a split brings lies side by side.
    let is_by_splits = |name: &str| {
        let file = open(name);
        let groups = (0..file.groups().len() as u32).map(GroupId);
        groups.map(|group| file.fine(group)).all(|fine| fine.windows(2).all(|pair| pair[1] == pair[0] + 1))
    };
    assert!(!is_by_splits("plain.chpm"));
    folder.stdout("relayout plain.chpm -o splits.chpm --order splits -q");
    assert!(is_by_splits("splits.chpm"));
    folder.stdout("verify splits.chpm --same-as plain.chpm --against in.ply --cuts 3 -q");
    folder.stdout("relayout splits.chpm -o levels.chpm --order levels -q");
    assert!(open("levels.chpm").clusters().iter().map(|record| record.level).is_sorted_by(|a, b| a >= b));
    // Packing and ordering do not get in each other's way.
    folder.stdout("relayout plain.chpm -o packed.chpm --pages packed --order splits -q");
    folder.stdout("relayout packed.chpm -o unpacked.chpm --pages raw -q");
    assert!(folder.read("splits.chpm") == folder.read("unpacked.chpm"));
    assert!(folder.stderr("relayout in.chpm -o out.chpm", 2).contains("--pages"));
}

/// The file as version 1.0 has it: no gaps, no chunks, in the order of before.
fn of_version_0(file: &Chpm<Vec<u8>>) -> Vec<u8> {
    let mut tables = Tables::of(file).expect("tables");
    tables.header.chunked = false;
    let by_level = |id: &ClusterId| file.clusters()[id.index()].level;
    let mut order: Vec<ClusterId> = (0..file.header().cluster_count).map(ClusterId).collect();
    order.sort_by_key(by_level);
    tables.reorder(&order);
    tables.groups.iter_mut().for_each(|group| group.gaps = Gaps::default());
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).expect("tables");
    order.iter().for_each(|id| writer.page(file.page_bytes(*id)).expect("a page"));
    let mut bytes = writer.finish().expect("a file");
    bytes[10] = 0;
    let sum = checksum(&bytes[..248]).to_le_bytes();
    bytes[248..256].copy_from_slice(&sum);
    bytes
}

#[test]
fn a_file_of_version_0_goes_both_ways() {
    let folder = built(Attributes { normals: true, colors: true, ..Attributes::NONE }, 12_000);
    let old = of_version_0(&Chpm::open(folder.read("in.chpm")).expect("a file"));
    folder.write("old.chpm", &old);
    assert!(
        folder.stdout("info old.chpm").contains("CHPM 1.0") && !Chpm::open(old).expect("a file").is_chunked()
    );
    folder.stdout("relayout old.chpm -o packed.chpm --pages packed -q");
    folder.stdout("relayout packed.chpm -o raw.chpm --pages raw -q");
    folder.stdout("relayout old.chpm -o splits.chpm --order splits -q");
    for name in ["packed.chpm", "raw.chpm", "splits.chpm"] {
        folder.stdout(&format!("verify {name} --same-as old.chpm --against in.ply --cuts 3 -q"));
        let told = folder.stdout(&format!("info {name}"));
        assert!(told.contains("CHPM 1.3") && told.contains("distance unknown"), "{told}");
        let file = Chpm::open(folder.read(name)).expect("a file");
        assert!(file.is_chunked() && file.roots().eq([ClusterId(0)]), "{name}: the top comes first");
    }
    folder.stdout("relayout old.chpm -o straight.chpm --pages raw -q");
    assert!(folder.read("raw.chpm") == folder.read("straight.chpm"), "every byte comes back");
}

#[test]
fn what_is_not_the_same_is_a_fault() {
    let folder = built(Attributes::NONE, 4_000);
    folder.stdout("build in.ply -o other.chpm -q --cluster-triangles 256");
    folder.chpm("verify in.chpm --same-as other.chpm -q").code(1);
    let said =
        String::from_utf8(folder.chpm("verify in.chpm --same-as other.chpm -q").get_output().stdout.clone());
    assert!(said.expect("text").contains("I9 not the same as 'other.chpm': "));
    // One coordinate, under right checksums.
    let mut bytes = folder.read("in.chpm");
    let (offset, len) = {
        let file = Chpm::open(bytes.clone()).expect("a file");
        let record: &ClusterRecord = &file.clusters()[ClusterId(0).index()];
        (record.page_offset as usize, record.page_len as usize)
    };
    bytes[offset + len - 1] ^= 0x80;
    folder.write("bent.chpm", &bytes);
    let said = folder.stderr("relayout bent.chpm -o out.chpm --pages packed -q", 2);
    assert!(said.contains("page of cluster 0") && said.contains("checksum"), "{said}");
    assert!(!folder.names().iter().any(|name| name.starts_with("out")), "nothing is left");
    let said = folder.stderr("relayout in.chpm -o in.chpm --pages packed -f", 2);
    assert!(said.contains("is the input itself"), "{said}");
}
