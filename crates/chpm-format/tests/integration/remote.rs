//! Files of which only ranges are read.

use crate::sample::{entries, reseal, section_ranges, sheet, tetrahedron, with, write};
use chpm_format::remote::FIRST_BYTES;
use chpm_format::{Chpm, ClusterRecord, FormatError, GroupRecord, Header, RemoteChpm, dump, same, verify};
use chpm_mesh::{Attributes, ClusterId, GroupId};
use proptest::prelude::*;
use std::cell::RefCell;
use std::io;
use std::mem::offset_of;
use std::ops::Range;
use std::sync::LazyLock;

const CHUNKS: u32 = 0x8000_0001;
const ALL: Attributes = Attributes { scalar_words: 3, ..Attributes::ALL };

fn chunked(columns: usize, strips: usize, attributes: Attributes) -> Vec<u8> {
    let (mut tables, pages) = sheet(columns, 1, strips, attributes).tables();
    tables.header.chunked = true;
    write(&mut tables, &pages)
}

/// 511 clusters: four chunks of CLUSTERS and two of GROUPS.
static LARGE: LazyLock<Vec<u8>> = LazyLock::new(|| chunked(512, 256, Attributes::NONE));
static SMALL: LazyLock<Vec<u8>> = LazyLock::new(|| chunked(8, 4, ALL));

/// Fills buffers from bytes and notes the ranges that were asked for.
fn reader<'a>(
    bytes: &'a [u8],
    asked: &'a RefCell<Vec<Range<usize>>>,
) -> impl FnMut(usize, u64, &mut [u8]) -> io::Result<()> {
    move |_, offset, out| {
        let range = offset as usize..offset as usize + out.len();
        asked.borrow_mut().push(range.clone());
        out.copy_from_slice(bytes.get(range).ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }
}

type Read<'a> = Box<dyn FnMut(usize, u64, &mut [u8]) -> io::Result<()> + 'a>;

fn remote(bytes: &[u8]) -> Result<RemoteChpm<Read<'_>>, FormatError> {
    let read = move |_: usize, offset: u64, out: &mut [u8]| {
        let start = usize::try_from(offset).unwrap();
        out.copy_from_slice(bytes.get(start..start + out.len()).ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    };
    RemoteChpm::open(bytes.len() as u64, Box::new(read))
}

/// Goes down from the roots as far as records can be had, and reads every page; the clusters met.
fn descend(bytes: &[u8]) -> Result<Vec<ClusterId>, FormatError> {
    let mut file = remote(bytes)?;
    let mut met = file.roots()?;
    let mut next = 0;
    while next < met.len() {
        let id = met[next];
        next += 1;
        file.page(id)?;
        let group = file.cluster(id)?.group();
        // Of all coarse clusters of a group, the first leads down.
        if file.coarse(group)?.first() == Some(&id) {
            met.extend(file.fine(group)?);
        }
    }
    Ok(met)
}

#[test]
fn chunks_come_first_and_tables_begin_with_the_top() {
    let file = Chpm::open(LARGE.clone()).unwrap();
    assert_eq!(verify(&file, |_, _| ()).faults, []);
    assert_eq!((file.header().version_minor, file.is_chunked()), (3, true));
    assert_eq!(entries(&LARGE)[0].kind, CHUNKS);
    // Chunks of 16 KiB: four of 128 clusters, two of 256 groups, one of members.
    assert_eq!(entries(&LARGE)[0].count, 1 + 4 + 2 + 1);
    assert_eq!(file.roots().collect::<Vec<_>>(), [ClusterId(0)]);
    assert_eq!(file.clusters()[0].group(), GroupId(0));
    assert!(file.groups().is_sorted_by_key(|group| std::cmp::Reverse(group.level)));
    // The same but for the order, and readable to who skips the section.
    let plain = sheet(512, 1, 256, Attributes::NONE).bytes();
    let plain = Chpm::open(plain).unwrap();
    assert_eq!((plain.header().version_minor, plain.is_chunked()), (1, false));
    assert_eq!(same::compare(&file, &plain, || ()).unwrap().told, Vec::<String>::new());
    let mut text = Vec::new();
    dump(&file, &mut text, false).unwrap();
    assert!(String::from_utf8(text).unwrap().contains("section CHUNKS 576..640"));
}

#[test]
fn ranges_say_what_the_whole_says() {
    for (bytes, is_chunked) in [
        (LARGE.clone(), true),
        (SMALL.clone(), true),
        (sheet(512, 1, 256, Attributes::NONE).bytes(), false),
        (sheet(8, 3, 4, ALL).bytes(), false),
        (tetrahedron().bytes(), false),
    ] {
        let whole = Chpm::open(bytes.clone()).unwrap();
        let mut file = remote(&bytes).unwrap();
        assert_eq!(file.is_chunked(), is_chunked);
        assert_eq!(file.header().file_len, bytes.len() as u64);
        assert_eq!(file.roots().unwrap(), whole.roots().collect::<Vec<_>>());
        for id in (0..whole.groups().len() as u32).rev().map(GroupId) {
            let ids = |ids: &[u32]| ids.iter().copied().map(ClusterId).collect::<Vec<_>>();
            assert_eq!(file.group(id).unwrap(), whole.groups()[id.index()]);
            assert_eq!(file.coarse(id).unwrap(), ids(whole.coarse(id)));
            assert_eq!(file.fine(id).unwrap(), ids(whole.fine(id)));
        }
        for id in (0..whole.clusters().len() as u32).rev().map(ClusterId) {
            assert_eq!(file.cluster(id).unwrap(), whole.clusters()[id.index()]);
            let (here, there) = (file.page(id).unwrap(), whole.page(id).unwrap());
            assert_eq!(here.view().positions, there.view().positions);
            assert_eq!(here.view().triangles, there.view().triangles);
        }
        assert_eq!(descend(&bytes).unwrap().len(), whole.clusters().len());
        assert!(file.cluster(ClusterId(whole.clusters().len() as u32)).is_err());
        assert!(file.group(GroupId(u32::MAX)).is_err());
    }
}

#[test]
fn no_more_is_read_than_it_takes() {
    let asked = RefCell::default();
    let mut file = RemoteChpm::open(LARGE.len() as u64, reader(&LARGE, &asked)).unwrap();
    let whole = Chpm::open(&LARGE[..]).unwrap();
    let root = file.roots().unwrap()[0];
    let first = 0..FIRST_BYTES as usize;
    assert!(asked.take().iter().eq([&first]), "the roots' records are in the first bytes");
    file.page(root).unwrap();
    let place = |id: ClusterId| {
        let record = &whole.clusters()[id.index()];
        record.page_offset as usize..record.page_offset as usize + record.page_len as usize
    };
    assert!(asked.take().iter().eq([&place(root)]));
    let group = file.cluster(root).unwrap().group();
    let fine = file.fine(group).unwrap();
    let [_, _, groups, members, ..] = &section_ranges(&LARGE)[..] else { panic!("sections") };
    let chunk = groups.start..groups.start + (16 << 10);
    assert_eq!(asked.take(), [chunk, members.clone()], "one chunk of each table");
    fine.iter().for_each(|id| drop(file.page(*id).unwrap()));
    assert_eq!(asked.take(), fine.into_iter().map(place).collect::<Vec<_>>());
    file.fine(group).unwrap();
    assert_eq!(asked.take(), [], "nothing twice");
}

#[test]
fn a_damaged_chunk_is_named_and_no_other_suffers() {
    let clusters = section_ranges(&LARGE)[1].clone();
    for chunk in 0..4 {
        let mut bytes = LARGE.clone();
        bytes[clusters.start + chunk * (16 << 10) + 1000] ^= 4;
        assert!(Chpm::open(&bytes[..]).is_err());
        let mut file = remote(&bytes).unwrap();
        for id in (0..511).map(ClusterId) {
            let error = file.cluster(id).err().map(|error| error.to_string());
            let hit = id.index() / 128 == chunk;
            assert_eq!(
                error.is_some_and(|error| error.starts_with("section CLUSTERS: checksum")),
                hit,
                "{id}"
            );
        }
    }
    // In the list itself, in the header, in a page.
    for (at, told) in
        [(600, "section CHUNKS: checksum"), (100, "header: checksum"), (300, "section table: checksum")]
    {
        let mut bytes = LARGE.clone();
        bytes[at] ^= 1;
        assert!(remote(&bytes).err().unwrap().to_string().starts_with(told), "{told}");
    }
    let mut bytes = LARGE.clone();
    let page = Chpm::open(&LARGE[..]).unwrap().clusters()[300].page_offset as usize;
    bytes[page + 70] ^= 1;
    let error = remote(&bytes).unwrap().page(ClusterId(300)).unwrap_err();
    assert!(matches!(error, FormatError::Checksum { .. }), "{error}");
}

#[test]
fn every_cut_and_every_refusal_to_read_is_an_error() {
    for len in (0..SMALL.len()).step_by(61) {
        assert!(remote(&SMALL[..len]).is_err(), "{len}");
        // The server says that there is more.
        let cut = |_: usize, offset: u64, out: &mut [u8]| {
            let range = offset as usize..offset as usize + out.len();
            out.copy_from_slice(SMALL[..len].get(range).ok_or(io::ErrorKind::UnexpectedEof)?);
            Ok(())
        };
        let opened = RemoteChpm::open(SMALL.len() as u64, cut);
        assert!(matches!(opened.err(), Some(FormatError::Read(_))) || len >= FIRST_BYTES as usize, "{len}");
    }
    for len in [1, u64::MAX] {
        let opened = RemoteChpm::open(len, |_, _, out: &mut [u8]| {
            out.copy_from_slice(&LARGE[..out.len()]);
            Ok(())
        });
        assert!(opened.is_err(), "{len}");
    }
}

#[test]
fn lies_are_refused_and_verify_tells_them() {
    let list = section_ranges(&SMALL)[0].start;
    let refused = |bytes: &[u8]| match descend(bytes) {
        Ok(_) => "read".to_owned(),
        Err(error) => error.to_string(),
    };
    let told = |bytes: Vec<u8>| {
        let report = verify(&Chpm::open(bytes).unwrap(), |_, _| ());
        report.faults.iter().map(|fault| fault.to_string()).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(refused(&SMALL), "read");
    for chunk_len in [0, 4095, 5000, 2 << 20, u64::MAX] {
        let bytes = with(&SMALL, list, &chunk_len.to_le_bytes());
        assert!(
            refused(&bytes).contains("section CHUNKS: chunk_len: expected a power of two"),
            "{chunk_len}"
        );
        assert!(told(bytes).contains("section CHUNKS: chunk_len"), "{chunk_len}");
    }
    let small = with(&LARGE, section_ranges(&LARGE)[0].start, &4096_u64.to_le_bytes());
    assert!(refused(&small).contains("section CHUNKS: count: expected 26, got 8"), "{}", refused(&small));

    // A checksum of a chunk that is wrong under a right one of the list.
    let mut bytes = SMALL.clone();
    bytes[list + 8] ^= 1;
    let mut entries = entries(&bytes);
    entries[0].checksum = chpm_format::checksum(&bytes[section_ranges(&SMALL)[0].clone()]);
    let table: &[u8] = bytemuck::cast_slice(&entries);
    bytes[256..256 + table.len()].copy_from_slice(table);
    for (range, at) in [(256..256 + table.len(), 240), (0..248, 248)] {
        let sum = chpm_format::checksum(&bytes[range]).to_le_bytes();
        bytes[at..at + 8].copy_from_slice(&sum);
    }
    assert!(refused(&bytes).contains("section CLUSTERS: checksum"));
    assert!(told(bytes).contains("of chunk 0 of CLUSTERS expected"));

    let ranges = section_ranges(&SMALL);
    let cluster = |id: usize, field, value: u32| {
        refused(&with(&SMALL, ranges[1].start + 128 * id + field, &value.to_le_bytes()))
    };
    for (id, field, value, expected) in [
        (0, offset_of!(ClusterRecord, page_offset), 100, "cluster 0: page: expected aligned"),
        (0, offset_of!(ClusterRecord, page_offset), 0, "cluster 0: page: expected aligned"),
        (1, offset_of!(ClusterRecord, page_offset), 0xffff_f000, "cluster 1: page: expected aligned"),
        (0, offset_of!(ClusterRecord, page_len), u32::MAX, "cluster 0: page_len"),
        (0, offset_of!(ClusterRecord, level), 9, "cluster 0: level"),
        (0, offset_of!(ClusterRecord, group), 7, "cluster 0: group: expected less than 7"),
        (0, offset_of!(ClusterRecord, parent_group), 2, "cluster 0: parent_group: expected of the first 1"),
        (
            1,
            offset_of!(ClusterRecord, parent_group),
            u32::MAX,
            "cluster 1: parent_group: expected of the first 1",
        ),
        (1, offset_of!(ClusterRecord, parent_group), 5, "cluster 1: parent group of a fine member"),
        (1, offset_of!(ClusterRecord, level), 2, "cluster 1: level of a"),
    ] {
        let text = cluster(id, field, value);
        assert!(text.contains(expected), "expected '{expected}', got '{text}'");
    }
    let group = |field, value: u32| refused(&with(&SMALL, ranges[2].start + field, &value.to_le_bytes()));
    for (field, value, expected) in [
        (offset_of!(GroupRecord, coarse_first), u32::MAX, "group 0: range of members"),
        (offset_of!(GroupRecord, coarse_count), u32::MAX, "group 0: range of members"),
        (offset_of!(GroupRecord, fine_first), 0, "parent group of a fine member"),
        (offset_of!(GroupRecord, fine_count), 0, "fine_count"),
        (offset_of!(GroupRecord, min_error), 0x7fc0_0000, "group 0: errors"),
    ] {
        let text = group(field, value);
        assert!(text.contains(expected), "expected '{expected}', got '{text}'");
    }
    let member = |slot: usize, id: u32| refused(&with(&SMALL, ranges[3].start + 4 * slot, &id.to_le_bytes()));
    assert!(member(1, 0).contains("parent group of a fine member"), "a group that brings itself");
    assert!(member(2, 1).contains("members: expected ascending"));
    assert!(member(2, 7).contains("cluster 7: id: expected less than 7"));
    for roots in [0, 2, 8, u32::MAX] {
        let bytes = with(&SMALL, offset_of!(Header, root_count), &u32::to_le_bytes(roots));
        let text = refused(&bytes);
        assert!(text.contains("root_count") || text.contains("parent_group"), "{roots}: {text}");
    }
    assert!(
        refused(&with(&SMALL, offset_of!(Header, cluster_count), &[8])).contains("section CLUSTERS: count")
    );
}

#[test]
fn an_order_that_is_not_from_the_top_is_told() {
    // A file as it is written without chunks, under the name of one with them: the sections' places are right, the order is not.
    let told = |change: &dyn Fn(&mut chpm_format::Tables)| {
        let (mut tables, pages) = sheet(8, 1, 4, Attributes::NONE).tables();
        tables.header.chunked = true;
        change(&mut tables);
        chpm_format::ChpmWriter::begin(Vec::new(), &mut tables)
            .map(|_| pages)
            .err()
            .map(|error| error.to_string())
    };
    assert_eq!(told(&|_| ()), None);
    let last_first = told(&|tables| {
        let order: Vec<ClusterId> = (0..7).rev().map(ClusterId).collect();
        tables.reorder(&order);
    });
    assert!(last_first.unwrap().contains("the roots first"));

    // Two groups of one level change places under right checksums.
    let ranges = section_ranges(&SMALL);
    let swapped = |section: usize, len: usize, a: usize, b: usize| {
        let mut bytes = SMALL.clone();
        let at = |index: usize| ranges[section].start + len * index;
        for offset in 0..len {
            bytes.swap(at(a) + offset, at(b) + offset);
        }
        bytes
    };
    let mut bytes = swapped(2, 64, 1, 2);
    let renumbered: Vec<usize> = (0..7).collect();
    for id in renumbered {
        for field in [offset_of!(ClusterRecord, group), offset_of!(ClusterRecord, parent_group)] {
            let at = ranges[1].start + 128 * id + field;
            let group: u32 = bytemuck::pod_read_unaligned(&bytes[at..at + 4]);
            let new = match group {
                1 => 2,
                2 => 1,
                other => other,
            };
            bytes[at..at + 4].copy_from_slice(&u32::to_le_bytes(new));
        }
    }
    reseal(&mut bytes);
    let report = verify(&Chpm::open(bytes).unwrap(), |_, _| ());
    let faults = report.faults.iter().map(|fault| fault.to_string()).collect::<Vec<_>>().join("\n");
    assert!(faults.contains("section CHUNKS: section MEMBERS: order"), "{faults}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn sealed_damage_never_panics(changes in prop::collection::vec((0..4096_usize, any::<u8>()), 1..6)) {
        let mut bytes = SMALL.clone();
        changes.iter().for_each(|(offset, value)| bytes[*offset] = *value);
        reseal(&mut bytes);
        if let Ok(met) = descend(&bytes) {
            prop_assert!(met.len() <= 1 << 10);
        }
        if let Ok(file) = Chpm::open(bytes) {
            verify(&file, |_, _| ());
        }
    }

    #[test]
    fn small_lies_never_panic(offset in 0..1024_usize, word in prop_oneof![0..9_u32, Just(u32::MAX), 4090..4100_u32]) {
        let mut bytes = SMALL.clone();
        bytes[4 * offset..4 * offset + 4].copy_from_slice(&word.to_le_bytes());
        reseal(&mut bytes);
        let _ = descend(&bytes);
    }
}
