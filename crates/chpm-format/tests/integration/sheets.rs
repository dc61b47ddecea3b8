use crate::sample::{reseal, two_level, with};
use chpm_format::header::Header;
use chpm_format::{
    Chpm, ChpmWriter, FilePart, FormatError, Invariant, SectionKind, SheetLayout, SheetRecord, Tables,
    checksum, dump, same, verify,
};
use chpm_mesh::{Chart, ClusterId};
use proptest::prelude::*;
use std::mem::offset_of;
use std::sync::LazyLock;

/// The sample's box is some units wide; every chart looks down on all of it.
fn layout(triangles: u32) -> SheetLayout {
    let chart = |axes| Chart { axes, offset: [8.0, 8.0], rect: [0, 0, 64, 48] };
    let second = Chart { rect: [64, 0, 64, 48], ..chart([[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]) };
    SheetLayout {
        origin: [0.0, 0.0, -1.0],
        charts: vec![chart([[4.0, 0.0, 0.0], [0.0, 4.0, 1.0]]), Chart { offset: [72.0, 8.0], ..second }],
        chart_of: (0..triangles).map(|triangle| (triangle % 2) as u16).collect(),
    }
}

/// As much of a PNG as says how large it is.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x80\0\0\0\x30\x08\x06";

fn sheet_of(layout: &SheetLayout, image: &[u8]) -> (SheetRecord, Vec<u8>) {
    let mut bytes = layout.encode().unwrap();
    let record = SheetRecord {
        chart_count: layout.charts.len() as u32,
        layout_len: bytes.len() as u32,
        image_len: image.len() as u32,
        size: [128, 48],
        codec: 2,
        texel: 0.25,
        ..SheetRecord::default()
    };
    bytes.extend_from_slice(image);
    (SheetRecord { checksum: checksum(&bytes), ..record }, bytes)
}

/// A file of three clusters, each with a sheet of another length.
pub(crate) fn bytes(change: impl Fn(usize, &mut SheetLayout)) -> Vec<u8> {
    let (mut tables, pages) = two_level().tables();
    let mut sheets = Vec::new();
    for (at, cluster) in tables.clusters.iter().enumerate() {
        let mut layout = layout(cluster.triangle_count);
        change(at, &mut layout);
        let (record, bytes) = sheet_of(&layout, &[PNG, &b"abc"[..at]].concat());
        tables.sheets.push(record);
        sheets.push(bytes);
    }
    write(&mut tables, &sheets, &pages)
}

fn write(tables: &mut Tables, sheets: &[Vec<u8>], pages: &[Vec<u8>]) -> Vec<u8> {
    let mut writer = ChpmWriter::begin(Vec::new(), tables).unwrap();
    sheets.iter().for_each(|sheet| writer.sheet(sheet).unwrap());
    pages.iter().for_each(|page| writer.page(page).unwrap());
    writer.finish().unwrap()
}

static GOOD: LazyLock<Vec<u8>> = LazyLock::new(|| bytes(|_, _| ()));

fn faults(bytes: Vec<u8>) -> Vec<(Invariant, FilePart)> {
    let file = Chpm::open(bytes).unwrap();
    verify(&file, |_, _| ()).faults.iter().map(|fault| (fault.invariant, fault.place)).collect()
}

/// Where a section begins.
fn start(bytes: &[u8], kind: SectionKind) -> usize {
    let file = Chpm::open(bytes.to_vec()).unwrap();
    file.sections().find(|(other, _)| *other == kind).unwrap().1.start
}

#[test]
fn sheets_come_back() {
    let file = Chpm::open(GOOD.clone()).unwrap();
    assert_eq!((file.header().version_minor, file.header().required_flags), (6, 8));
    assert_eq!(faults(GOOD.clone()), []);
    for (at, cluster) in file.clusters().iter().enumerate() {
        let sheet = file.sheet(ClusterId(at as u32)).unwrap().unwrap();
        assert_eq!(sheet.layout, layout(cluster.triangle_count));
        assert_eq!(sheet.image, [PNG, &b"abc"[..at]].concat());
        assert_eq!(sheet.image_size(), Some([128, 48]));
    }
    let mut text = Vec::new();
    dump(&file, &mut text, true).unwrap();
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("sheet of cluster 2 128 x 48 png charts 2 texel 0.25 at "), "{text}");
    assert!(text.contains("  charts of triangles [0, 1, 0, 1"), "{text}");

    // Tables come back, too.
    let mut again = Tables::of(&file).unwrap();
    let sheets: Vec<Vec<u8>> = (0..3).map(|id| file.sheet_bytes(ClusterId(id)).unwrap().to_vec()).collect();
    let pages: Vec<Vec<u8>> = (0..3).map(|id| file.page_bytes(ClusterId(id)).to_vec()).collect();
    assert!(write(&mut again, &sheets, &pages) == *GOOD);
}

#[test]
fn files_without_sheets_have_none() {
    let file = Chpm::open(two_level().bytes()).unwrap();
    assert!(!file.header().has_sheets() && file.sheets().is_empty());
    assert!(file.sheet(ClusterId(0)).unwrap().is_none() && file.sheet_bytes(ClusterId(0)).is_none());
    let both = [Chpm::open(GOOD.clone()).unwrap(), file];
    let differences = same::compare(&both[0], &both[1], || ()).unwrap();
    assert!(differences.told.iter().any(|told| told.contains("sheets: true here, false there")));
    let geometry = same::compare_to(same::Extent::Geometry, &both[0], &both[1], || ()).unwrap();
    assert_eq!(geometry.told, [""; 0]);
}

#[test]
fn other_sheets_are_not_the_same() {
    let good = Chpm::open(GOOD.clone()).unwrap();
    let compare = |other| same::compare(&good, &Chpm::open(other).unwrap(), || ()).unwrap().count;
    assert_eq!(compare(GOOD.clone()), 0);
    assert!(
        compare(bytes(|at, layout| if at == 1 {
            layout.charts[0].offset[0] = 9.0
        })) > 0
    );
    assert!(
        compare(bytes(|at, layout| if at == 2 {
            layout.chart_of[0] = 1
        })) > 0
    );
}

#[test]
fn damage_has_a_name() {
    let texels = start(&GOOD, SectionKind::Texels);
    let mut damaged = GOOD.clone();
    damaged[texels + 20] ^= 1;
    let file = Chpm::open(damaged.clone()).unwrap();
    let place = FilePart::Sheet(ClusterId(0));
    assert!(matches!(file.sheet(ClusterId(0)), Err(FormatError::Checksum { place: at, .. }) if at == place));
    assert!(file.sheet(ClusterId(1)).is_ok() && file.page(ClusterId(0)).is_ok());
    assert_eq!(faults(damaged), [(Invariant::Bytes, place)]);
    assert!(matches!(dump(&file, &mut std::io::sink(), true), Err(FormatError::Checksum { .. })));

    // Behind the first sheet, up to the next.
    let end = texels + file.sheets()[0].len() as usize;
    assert!(!(end - texels).is_multiple_of(8), "there is padding");
    assert_eq!(faults(with(&GOOD, end, &[1])), [(Invariant::Bytes, place)]);
    let textures = start(&GOOD, SectionKind::Textures);
    assert_eq!(
        faults(with(&GOOD, textures + offset_of!(SheetRecord, reserved), &[1])),
        [(Invariant::Bytes, place)]
    );
}

#[test]
fn wrong_records_are_refused() {
    let textures = start(&GOOD, SectionKind::Textures);
    let record = |at: usize, new: &[u8]| Chpm::open(with(&GOOD, textures + at, new)).is_err();
    assert!(!record(0, &[0]));
    assert!(record(64, &[0]), "cluster");
    assert!(record(offset_of!(SheetRecord, offset), &[8]));
    assert!(record(offset_of!(SheetRecord, image_len), &[0xff; 4]));
    assert!(record(offset_of!(SheetRecord, layout_len), &[1]));
    assert!(record(offset_of!(SheetRecord, codec), &[3]));
    assert!(record(offset_of!(SheetRecord, size), &[1, 0]));
    assert!(record(offset_of!(SheetRecord, texel), &f32::NAN.to_le_bytes()));
    assert!(record(offset_of!(SheetRecord, chart_count), &[0; 4]));

    // The flag and the sections belong together.
    let flags = offset_of!(Header, required_flags);
    assert!(Chpm::open(with(&GOOD, flags, &[0])).is_err());
    assert!(Chpm::open(with(&two_level().bytes(), flags, &[8])).is_err());
}

#[test]
fn triangles_outside_their_charts_are_faults() {
    let place = FilePart::Sheet(ClusterId(1));
    let moved = bytes(|at, layout| {
        if at == 1 {
            layout.charts[1].offset[0] = 0.0
        }
    });
    assert_eq!(faults(moved), [(Invariant::Sheets, place)]);
    let (mut tables, pages) = two_level().tables();
    let mut sheets = Vec::new();
    for (at, cluster) in tables.clusters.iter().enumerate() {
        let image = if at == 1 { &b"no image"[..] } else { PNG };
        let (record, bytes) = sheet_of(&layout(cluster.triangle_count), image);
        tables.sheets.push(record);
        sheets.push(bytes);
    }
    assert_eq!(faults(write(&mut tables, &sheets, &pages)), [(Invariant::Sheets, place)]);
}

#[test]
fn the_writer_wants_what_was_announced() {
    let (mut tables, pages) = two_level().tables();
    let mut sheets = Vec::new();
    for cluster in &tables.clusters {
        let (record, bytes) = sheet_of(&layout(cluster.triangle_count), PNG);
        tables.sheets.push(record);
        sheets.push(bytes);
    }
    let begin = |tables: &mut Tables| ChpmWriter::begin(Vec::new(), tables).unwrap();
    assert!(begin(&mut tables).page(&pages[0]).is_err(), "sheets come first");
    assert!(begin(&mut tables).sheet(&sheets[0][1..]).is_err());
    let mut writer = begin(&mut tables);
    sheets.iter().for_each(|sheet| writer.sheet(sheet).unwrap());
    assert!(writer.sheet(&sheets[0]).is_err(), "one too many");
    tables.sheets.pop();
    assert!(ChpmWriter::begin(Vec::new(), &mut tables).is_err(), "one too few");
}

#[test]
fn an_order_takes_sheets_along() {
    let file = Chpm::open(GOOD.clone()).unwrap();
    let mut tables = Tables::of(&file).unwrap();
    let order = [ClusterId(0), ClusterId(2), ClusterId(1)];
    tables.reorder(&order);
    let of = |id: ClusterId| file.sheet_bytes(id).unwrap().to_vec();
    let sheets: Vec<Vec<u8>> = order.iter().map(|id| of(*id)).collect();
    let pages: Vec<Vec<u8>> = order.iter().map(|id| file.page_bytes(*id).to_vec()).collect();
    let other = write(&mut tables, &sheets, &pages);
    assert_eq!(faults(other.clone()), []);
    assert_eq!(same::compare(&file, &Chpm::open(other).unwrap(), || ()).unwrap().told, [""; 0]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn sealed_damage_never_panics(changes in prop::collection::vec((0..9000usize, any::<u8>()), 1..6)) {
        let mut bytes = GOOD.clone();
        let sheets = start(&GOOD, SectionKind::Textures);
        for (offset, value) in changes {
            if let Some(byte) = bytes.get_mut(sheets.saturating_sub(512) + offset % 2600) {
                *byte = value;
            }
        }
        reseal(&mut bytes);
        let Ok(file) = Chpm::open(bytes) else { return Ok(()) };
        for id in (0..file.clusters().len() as u32).map(ClusterId) {
            let _ = file.sheet(id);
        }
        verify(&file, |_, _| ());
        prop_assert!(!matches!(dump(&file, &mut std::io::sink(), true), Err(FormatError::Write(_))));
    }
}
