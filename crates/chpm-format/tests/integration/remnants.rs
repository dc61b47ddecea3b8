use crate::sample::{Cluster, Sample, reseal, tetrahedron, write};
use chpm_format::{Chpm, FormatError, Gaps, Invariant, Remnant, SectionKind, Tables, dump, same, verify};
use chpm_mesh::ClusterId;

/// A triangle that stays and two that vanish, the last vertex first.
fn specks() -> Tables {
    tables().0
}

fn tables() -> (Tables, Vec<Vec<u8>>) {
    let triangle = |x: f32| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]];
    let positions = [triangle(0.0), triangle(20.0), triangle(40.0)];
    let mut positions = positions.as_flattened().to_vec();
    // What is left of the specks in front of what collapses.
    positions.swap(5, 6);
    positions.swap(6, 7);
    let cluster = Cluster {
        triangles: vec![[0, 1, 2], [3, 4, 7], [5, 6, 8]],
        targets: vec![4, 6],
        errors: vec![2.0, 1.0],
        positions,
        ..Cluster::default()
    };
    let mut sample = Sample { clusters: vec![cluster], ..tetrahedron() };
    sample.header.source_vertex_count = 9;
    sample.header.chunked = true;
    let (mut tables, pages) = sample.tables();
    tables.groups[0].gaps = Gaps { fine: 0.0, base: 41.0, from: 1.0 };
    let remnant = |x: f32, corners| Remnant {
        center: [x, 0.5, 0.0],
        radius: 1.25,
        corners,
        bound: 0.5,
        ..Remnant::default()
    };
    // The writer sorts them.
    tables.remnants = vec![remnant(40.0, [8, 6, 5]), remnant(20.0, [7, 4, 3])];
    (tables, pages)
}

/// A file with these tables.
fn bytes(change: impl FnOnce(&mut Tables)) -> Result<Vec<u8>, FormatError> {
    let (mut tables, pages) = tables();
    change(&mut tables);
    tables.encode()?;
    Ok(write(&mut tables, &pages))
}

fn broken(change: impl FnOnce(&mut Tables)) -> Vec<Invariant> {
    let file = Chpm::open(bytes(change).unwrap()).unwrap();
    verify(&file, |_, _| ()).faults.iter().map(|fault| fault.invariant).collect()
}

#[test]
fn they_come_back_sorted_and_are_told() {
    let file = Chpm::open(bytes(|_| ()).unwrap()).unwrap();
    assert_eq!(file.header().version_minor, 5);
    let report = verify(&file, |_, _| ());
    assert!(report.is_ok(), "{report:?}");
    let mut expected = specks().remnants;
    expected.reverse();
    assert_eq!(file.remnants(), expected);
    assert!(file.has_remnants());
    let mut text = Vec::new();
    dump(&file, &mut text, false).unwrap();
    let text = String::from_utf8(text).unwrap();
    assert!(
        text.contains("remnant of cluster 0 corners [7, 4, 3] within 0.5 center [20.0, 0.5, 0.0]"),
        "{text}"
    );
    // In another order of clusters they are of the same.
    let mut again = Tables::of(&file).unwrap();
    again.reorder(&[ClusterId(0)]);
    let copy = write(&mut again, &[file.page_bytes(ClusterId(0)).to_vec()]);
    assert_eq!(copy, file.bytes());
    let without = Chpm::open(bytes(|tables| tables.remnants.truncate(1)).unwrap()).unwrap();
    assert_eq!(same::compare(&file, &without, || ()).unwrap().count, 1);
}

/// Without any, the file is as it was before there were remnants.
#[test]
fn a_file_without_any_is_of_an_earlier_version() {
    let file = Chpm::open(bytes(|tables| tables.remnants.clear()).unwrap()).unwrap();
    assert_eq!((file.header().version_minor, file.has_remnants()), (3, false));
    assert!(verify(&file, |_, _| ()).is_ok());
    // What has no meaning there must be zero.
    let lies = |tables: &mut Tables| {
        tables.remnants.clear();
        tables.groups[0].rest = 1.0;
    };
    assert_eq!(broken(lies), [Invariant::Bytes]);
}

#[test]
fn what_no_reader_could_follow_is_refused() {
    type Change = fn(&mut Tables);
    let wrong: [(&str, Change); 11] = [
        ("cluster", |t| t.remnants[0].cluster = 1),
        ("corners", |t| t.remnants[0].corners[0] = 9),
        ("corners", |t| t.remnants[0].corners[0] = 6),
        ("corners", |t| t.remnants[0].corners[1] = 8),
        ("corners", |t| t.remnants[0].corners[2] = 6),
        ("ball and bound", |t| t.remnants[0].radius = -1.0),
        ("ball and bound", |t| t.remnants[0].bound = f32::NAN),
        ("ball and bound", |t| t.remnants[0].center[1] = f32::INFINITY),
        ("order", |t| t.remnants[0] = t.remnants[1]),
        ("rest_gap", |t| t.groups[0].rest = -1.0),
        ("rest_gap", |t| t.groups[0].rest = 42.0),
    ];
    for (field, change) in wrong {
        let refused = bytes(change).map(|_| ()).unwrap_err().to_string();
        assert!(refused.contains(field), "{field}: {refused}");
    }
    // The reader refuses it, too, whoever has written it, and the damage of any byte.
    let good = bytes(|_| ()).unwrap();
    let file = Chpm::open(good.clone()).unwrap();
    let (_, range) = file.sections().find(|(kind, _)| *kind == SectionKind::Remnants).unwrap();
    for at in range.clone() {
        let mut bad = good.clone();
        bad[at] ^= 0x40;
        let told = Chpm::open(bad.clone()).map(|_| ()).unwrap_err().to_string();
        assert!(told.contains("section REMNANTS") && told.contains("checksum"), "{at}: {told}");
        reseal(&mut bad);
        // What is left is wrong, or only another number, which `verify` may find.
        if let Ok(file) = Chpm::open(bad) {
            let _ = verify(&file, |_, _| ());
        }
    }
    let mut unsorted = good.clone();
    unsorted[range.start..range.start + 64].rotate_left(32);
    reseal(&mut unsorted);
    let told = Chpm::open(unsorted).map(|_| ()).unwrap_err().to_string();
    assert!(told.contains("section REMNANTS: order"), "{told}");
}

#[test]
fn verify_finds_what_is_no_remnant() {
    // One that is not the component's triangle; one whose corner is another's.
    assert_eq!(broken(|t| t.remnants[0].corners = [8, 6, 4]), [Invariant::Vertices]);
    assert_eq!(broken(|t| t.remnants[0].corners = [8, 5, 6]), [Invariant::Vertices]);
    // One that is farther than the mesh is said to be.
    assert_eq!(broken(|t| t.remnants[0].bound = 1.5), [Invariant::Nesting]);
    assert_eq!(broken(|t| t.remnants[0].reserved = [1, 0]), [Invariant::Bytes]);
}
