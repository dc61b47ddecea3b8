use crate::sample::{entries, reseal, section_ranges, sheet, tetrahedron, two_level, with};
use chpm_format::{
    Chpm, ClusterRecord, FilePart, FormatError, Gaps, GroupRecord, Header, Page, SectionEntry, checksum,
    verify,
};
use chpm_mesh::{Attributes, ClusterId};
use std::mem::offset_of;

fn refusal(bytes: Vec<u8>) -> String {
    match Chpm::open(bytes) {
        Ok(_) => "opened".to_owned(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn every_flip_before_the_pages_is_refused() {
    let good = two_level().bytes();
    for (offset, bit) in (0..4096).flat_map(|offset| [(offset, 1u8), (offset, 0x80)]) {
        let mut bytes = good.clone();
        bytes[offset] ^= bit;
        assert!(Chpm::open(bytes).is_err(), "byte {offset}");
    }
}

#[test]
fn every_flip_in_the_pages_is_found() {
    let good = two_level().bytes();
    for offset in (4096..good.len()).filter(|offset| offset % 4096 < 600 || offset % 64 == 0) {
        let mut bytes = good.clone();
        bytes[offset] ^= 1;
        let file = Chpm::open(bytes).unwrap();
        assert!(!verify(&file, |_, _| ()).is_ok(), "byte {offset}");
    }
}

/// A way to read a page.
type Way = fn(&Chpm<Vec<u8>>) -> Result<(), FormatError>;

/// A coordinate that is moved, so that nothing but the checksum tells.
#[test]
fn a_damaged_page_is_refused_whichever_way_it_is_read() {
    let sample = sheet(64, 40, 4, Attributes::NONE);
    for (name, good) in [("raw", sample.bytes()), ("packed", crate::packed::packed_file(&sample))] {
        let file = Chpm::open(good.clone()).unwrap();
        let record = file.clusters()[2];
        assert_eq!(file.is_packed(ClusterId(2)), name == "packed");
        let mut bytes = good.clone();
        // Of a packed page a bit of what zstd expands, which has no checksum of its own.
        let at = record.page_offset as usize + if name == "raw" { 66 } else { record.page_len as usize - 1 };
        bytes[at] ^= 0x10;
        let ways: [Way; 4] = [
            |file| file.page(ClusterId(2)).map(drop),
            |file| file.page_viewed(ClusterId(2)).map(drop),
            |file| file.page_known(ClusterId(2)).map(drop),
            |file| file.page_checked(ClusterId(2)).map(drop),
        ];
        for (way, read) in ways.iter().enumerate() {
            let damaged = Chpm::open(bytes.clone()).unwrap();
            // The second time as the first.
            for _ in 0..2 {
                let error = read(&damaged).unwrap_err();
                let is_told =
                    matches!(error, FormatError::Checksum { place: FilePart::Page(ClusterId(2)), .. });
                assert!(is_told, "{name}, way {way}: {error}");
            }
            damaged.page(ClusterId(1)).unwrap();
            read(&file).unwrap();
        }
    }
}

#[test]
fn every_cut_is_refused() {
    let good = tetrahedron().bytes();
    for len in 0..good.len() {
        let error = Chpm::open(good[..len].to_vec()).unwrap_err();
        let named = matches!(error, FormatError::Magic { .. } | FormatError::Truncated { .. });
        assert!(named, "{len} bytes: {error}");
    }
    let mut longer = good;
    longer.push(0);
    assert!(refusal(longer).contains("file_len: expected 8193, got 8192"));
}

#[test]
fn what_is_no_chpm_file_is_told_so() {
    assert!(refusal(vec![]).contains("cut short"));
    assert!(refusal(b"ply\nformat ascii 1.0\n".to_vec()).contains("give a file that chpm built"));
    let mut text_mode = tetrahedron().bytes();
    text_mode.remove(5);
    assert!(refusal(text_mode).contains("text mode"));
    assert!(refusal(chpm_format::volume::MAGIC.repeat(200)).contains("give the .chpm that it belongs to"));
}

#[test]
fn headers_of_another_kind_are_refused_by_name() {
    let good = tetrahedron().bytes();
    let header = |offset, value: &[u8]| refusal(with(&good, offset, value));
    assert!(header(offset_of!(Header, version_major), &[2]).contains("version 2.1 is not supported"));
    assert!(header(offset_of!(Header, required_flags), &[0x80]).contains("unknown required feature 0x80"));
    assert_eq!(header(offset_of!(Header, version_minor), &[99]), "opened");
    assert_eq!(header(offset_of!(Header, optional_flags), &[9]), "opened");
    for (offset, value, name) in [
        (offset_of!(Header, header_len), 128, "header_len"),
        (offset_of!(Header, section_count), 65, "section_count"),
        (offset_of!(Header, section_table_offset), 512, "section_table_offset"),
        (offset_of!(Header, page_align), 1, "page_align"),
        (offset_of!(Header, attributes), 5, "attributes"),
        (offset_of!(Header, attributes), 8, "attributes"),
        (offset_of!(Header, attributes), 4, "flag of octahedral normals"),
        (offset_of!(Header, required_flags), 2, "flag of octahedral normals"),
        (offset_of!(Header, required_flags), 0x40, "bit 6 of required_flags says of VOLUMES"),
        (offset_of!(Header, cluster_count), 2, "cluster_count"),
        (offset_of!(Header, group_count), u32::MAX, "group_count"),
        (offset_of!(Header, level_count), 0, "level_count"),
        (offset_of!(Header, root_count), 0, "root_count"),
        (offset_of!(Header, leaf_count), 2, "leaf_count"),
        (offset_of!(Header, boundary_mode), 3, "boundary_mode"),
        (offset_of!(Header, error_kind), 2, "error_kind"),
        (offset_of!(Header, shared_vertex_count), u32::MAX, "shared_vertex_count"),
        (offset_of!(Header, origin), 0, ""),
    ] {
        let text = header(offset, &u32::to_le_bytes(value));
        assert!(text.contains(name) && (text != "opened" || name.is_empty()), "{name}: {text}");
    }
    assert!(header(offset_of!(Header, origin), &f64::NAN.to_le_bytes()).contains("origin"));
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for corner in [offset_of!(Header, aabb_min), offset_of!(Header, aabb_max)] {
            assert!(header(corner + 4, &value.to_le_bytes()).contains("header: box"), "{value}");
        }
        assert!(header(offset_of!(Header, max_error), &value.to_le_bytes()).contains("header: max_error"));
    }
    assert!(header(offset_of!(Header, aabb_min), &2_f32.to_le_bytes()).contains("header: box"), "min > max");
    assert!(header(offset_of!(Header, max_error), &(-1_f32).to_le_bytes()).contains("header: max_error"));
    assert!(header(offset_of!(Header, file_len), &u64::MAX.to_le_bytes()).contains("cut short"));
}

#[test]
fn section_tables_that_lie_are_refused() {
    let good = tetrahedron().bytes();
    let entry =
        |index: usize, field: usize, value: &[u8]| refusal(with(&good, 256 + 40 * index + field, value));
    let huge = u64::MAX.to_le_bytes();
    assert!(entry(0, offset_of!(SectionEntry, offset), &huge).contains("offset of a section"));
    assert!(
        entry(1, offset_of!(SectionEntry, offset), &512u64.to_le_bytes()).contains("offset of a section")
    );
    assert!(entry(0, offset_of!(SectionEntry, len), &huge).contains("cut short"));
    assert!(entry(0, offset_of!(SectionEntry, count), &huge).contains("count * record_len"));
    assert!(entry(0, offset_of!(SectionEntry, record_len), &[64]).contains("record_len"));
    assert!(entry(1, offset_of!(SectionEntry, kind), &[11]).contains("unknown required feature 0xb"));
    // Kinds swapped: record lengths betray it. A section that becomes optional is missing.
    assert!(entry(0, offset_of!(SectionEntry, kind), &[2]).contains("record_len"));
    assert!(entry(4, offset_of!(SectionEntry, kind), &[9, 0, 0, 0x80]).contains("expected METADATA"));
    assert!(entry(5, offset_of!(SectionEntry, kind), &[9, 0, 0, 0x80]).contains("offset of a section"));
    assert!(entry(5, offset_of!(SectionEntry, count), &[2]).contains("section PAGES: count"));
    assert!(entry(5, offset_of!(SectionEntry, checksum), &[2]).contains("section PAGES: checksum"));
    assert!(refusal(with(&good, 498, &[1])).contains("padding between sections"));
}

#[test]
fn optional_sections_are_skipped() {
    let good = tetrahedron().bytes();
    // A seventh entry, of zero length behind METADATA. The tables start at 512 still only if the table did not grow:
    // 256 + 7 * 40 = 536, so that every table moves by 64.
    let (ranges, old) = (section_ranges(&good), entries(&good));
    let mut table = old.clone();
    let mut bytes = good[..576].to_vec();
    for (entry, range) in table.iter_mut().zip(&ranges) {
        let align = if entry.kind == 6 { 4096 } else { 64 };
        bytes.resize(bytes.len().next_multiple_of(align), 0);
        entry.offset = bytes.len() as u64;
        bytes.extend(&good[range.clone()]);
    }
    let metadata = table[4];
    let offset = (metadata.offset + metadata.len).next_multiple_of(64);
    table.insert(
        5,
        SectionEntry { kind: 1 << 31 | 77, record_len: 3, offset, len: 0, count: 0, checksum: checksum(&[]) },
    );
    bytes[512..576].fill(0);
    bytes[256..256 + 7 * 40].copy_from_slice(bytemuck::cast_slice(&table));
    bytes[32] = 7;
    reseal(&mut bytes);
    let file = Chpm::open(bytes).unwrap();
    assert_eq!(verify(&file, |_, _| ()).faults, []);
}

/// File offset of a field of record `index` in section `section`.
fn at(bytes: &[u8], section: usize, record_len: usize, index: usize, field: usize) -> usize {
    section_ranges(bytes)[section].start + record_len * index + field
}

#[test]
fn tables_that_lie_are_refused() {
    let good = two_level().bytes();
    let cluster =
        |id, field, value: u32| refusal(with(&good, at(&good, 0, 128, id, field), &value.to_le_bytes()));
    for (id, field, value, expected) in [
        (0, offset_of!(ClusterRecord, page_offset), 8192, "cluster 0: page_offset: expected 4096"),
        (1, offset_of!(ClusterRecord, page_offset), 4096, "cluster 1: page_offset: expected 8192"),
        (2, offset_of!(ClusterRecord, page_offset), 0, "cluster 2: page_offset"),
        (0, offset_of!(ClusterRecord, page_len), u32::MAX, "cluster 0: page_len"),
        (0, offset_of!(ClusterRecord, level), 2, "cluster 0: level: expected less than 2"),
        (1, offset_of!(ClusterRecord, level), 1, "leaf_count"),
        (0, offset_of!(ClusterRecord, vertex_count), 65_536, "vertex_count"),
        (0, offset_of!(ClusterRecord, base_vertex_count), 0, "base_vertex_count"),
        (0, offset_of!(ClusterRecord, base_vertex_count), 1000, "base_vertex_count"),
        (0, offset_of!(ClusterRecord, triangle_count), u32::MAX, "page_len"),
        (0, offset_of!(ClusterRecord, base_triangle_count), u32::MAX, "base_triangle_count"),
        (0, offset_of!(ClusterRecord, shared_count), u32::MAX, "shared_count"),
        (0, offset_of!(ClusterRecord, group), 3, "cluster 0: group"),
        (0, offset_of!(ClusterRecord, group), 0, "cluster 0: group of a coarse member"),
        (1, offset_of!(ClusterRecord, parent_group), 7, "cluster 1: parent_group"),
        (0, offset_of!(ClusterRecord, parent_group), 2, "root_count"),
        (1, offset_of!(ClusterRecord, parent_group), 1, "cluster 1: parent group of a fine member"),
        (0, offset_of!(ClusterRecord, min_error), 0xffc0_0000, "errors"),
        (0, offset_of!(ClusterRecord, max_error), 0, "errors"),
        (0, offset_of!(ClusterRecord, aabb_min), 0x7f80_0000, "box"),
        (0, offset_of!(ClusterRecord, radius), 0xbf80_0000, "sphere"),
        (0, offset_of!(ClusterRecord, normal_deviation), 0x7fc0_0000, "normal_deviation: expected 0 to 180"),
        (0, offset_of!(ClusterRecord, color_deviation), 0x4380_0000, "expected 0 to 255, got 256"),
    ] {
        let text = cluster(id, field, value);
        assert!(text.contains(expected), "expected '{expected}', got '{text}'");
    }
    let group =
        |id, field, value: u32| refusal(with(&good, at(&good, 1, 64, id, field), &value.to_le_bytes()));
    for (id, field, value, expected) in [
        (0, offset_of!(GroupRecord, coarse_first), u32::MAX, "range of members"),
        (0, offset_of!(GroupRecord, coarse_first), 1, "group of a coarse member"),
        (0, offset_of!(GroupRecord, coarse_count), 0, "coarse_count"),
        (0, offset_of!(GroupRecord, coarse_count), u32::MAX, "range of members"),
        (0, offset_of!(GroupRecord, fine_count), 1, "fine_count"),
        (2, offset_of!(GroupRecord, fine_count), 0, "fine_count"),
        (2, offset_of!(GroupRecord, fine_count), 1, "fine clusters of all groups"),
        (2, offset_of!(GroupRecord, fine_first), 2, "to itself"),
        (2, offset_of!(GroupRecord, level), 0, "fine_count"),
        (2, offset_of!(GroupRecord, level), 9, "level"),
        (2, offset_of!(GroupRecord, min_error), 0x7fc0_0000, "errors"),
        (2, offset_of!(GroupRecord, radius), 0x7fc0_0000, "sphere"),
        (2, offset_of!(GroupRecord, gaps) + offset_of!(Gaps, fine), 0x3f80_0000, "gaps"),
        (2, offset_of!(GroupRecord, gaps) + offset_of!(Gaps, base), 0x7f80_0000, "gaps"),
        (2, offset_of!(GroupRecord, gaps) + offset_of!(Gaps, from), 0xbf80_0000, "gaps"),
    ] {
        let text = group(id, field, value);
        assert!(text.contains(expected), "expected '{expected}', got '{text}'");
    }
    let member = |slot, id: u32| refusal(with(&good, at(&good, 2, 4, slot, 0), &id.to_le_bytes()));
    assert!(member(4, 3).contains("member: expected less than 3, got 3"));
    assert!(member(4, 1).contains("members: expected ascending"), "one twice");
    assert!(member(3, 0).contains("parent group of a fine member"), "a group that brings itself");
    assert!(refusal(with(&good, at(&good, 3, 128, 0, 0), &[1])).contains("level 0: level"));
}

#[test]
fn metadata_that_lies_harms_nothing() {
    let good = tetrahedron().bytes();
    let start = section_ranges(&good)[4].start;
    for (offset, value) in
        [(0, vec![9]), (2, vec![253, 255, 255, 255, 255, 255, 255, 255, 255]), (2, vec![0]), (3, vec![0xff])]
    {
        let file = Chpm::open(with(&good, start + offset, &value)).unwrap();
        assert!(matches!(file.metadata(), Err(FormatError::Metadata(_))));
        assert_eq!(verify(&file, |_, _| ()).fault_count, 1);
    }
}

#[test]
fn pages_that_lie_are_refused() {
    let good = tetrahedron().bytes();
    // Header 64, positions 48, triangles 24, target 2, code 2, bits 1.
    let page = |offset: usize, value: &[u8]| match Chpm::open(with(&good, 4096 + offset, value))
        .unwrap()
        .page(ClusterId(0))
    {
        Ok(_) => "parsed".to_owned(),
        Err(error) => error.to_string(),
    };
    assert_eq!(page(64, &[1]), "parsed");
    for (offset, value, expected) in [
        (0, &[0][..], "page of cluster 0: magic"),
        (4, &[2], "format version 2"),
        (6, &[1], "length: expected 189, got 141"),
        (6, &[8], "attributes"),
        (6, &[5], "attributes"),
        (6, &[4], "length: expected 153, got 141"),
        (8, &[5], "length: expected 157, got 141"),
        (8, &[0, 0, 1], "vertex_count: expected at most 65535"),
        (12, &[0], "base_vertex_count"),
        (12, &[5], "base_vertex_count"),
        (20, &[3], "base_triangle_count: expected 2, got 3"),
        (24, &[9], "shared_count"),
        (28, &[0, 0, 0x80, 0x3e], "min_error"),
        (28, &[0, 0, 0xc0, 0x7f], "min_error"),
        (32, &[1], "error_scale"),
        (35, &[0xbf], "error_scale"),
        (112, &[4], "corner of a triangle: expected less than 4, got 4"),
        (112, &[2], "triangles with equal corners"),
        (136, &[3], "target of a collapse: expected less than 3, got 3"),
        (138, &[2, 0xf8], "error code: expected at most 63489"),
        (138, &[0, 0xf7], "max_error"),
        (140, &[1], "shared bits that are set: expected 0, got 1"),
        (140, &[0x10], "shared bits"),
    ] {
        let text = page(offset, value);
        assert!(text.contains(expected), "at {offset}: expected '{expected}', got '{text}'");
    }
}

#[test]
fn bytes_at_odd_addresses_are_refused() {
    let bytes = tetrahedron().bytes();
    let mut shifted = vec![0; 4];
    shifted.extend(&bytes);
    assert!(matches!(Chpm::open(&shifted[4..]), Err(FormatError::Alignment { .. })));
    let page = &bytes[4096..4096 + 141];
    shifted.truncate(1);
    shifted.extend(page);
    assert!(Page::parse(page).is_ok());
    assert!(matches!(Page::parse(&shifted[1..]), Err(FormatError::Alignment { .. })));
    assert!(Page::parse(&page[..140]).unwrap_err().to_string().contains("length: expected 141, got 140"));
    assert!(matches!(Page::parse(&page[..60]), Err(FormatError::Truncated { .. })));
}
