use crate::sample::{entries, reseal, sheet, tetrahedron, write};
use chpm_format::volume::{self, HEAD_LEN, TOLD};
use chpm_format::{Chpm, FormatError, RemoteChpm, SectionKind, Tables, VolumeFault, dump, same, verify};
use chpm_mesh::{Attributes, ClusterId};
use proptest::prelude::*;
use std::io;
use std::path::Path;
use std::sync::LazyLock;

/// The file and its volumes, of one that has none.
fn split(bytes: &[u8], size: u64) -> Result<Vec<Vec<u8>>, FormatError> {
    let file = Chpm::open(bytes)?;
    let mut tables = Tables::of(&file)?;
    tables.header.volume_size = Some(size);
    let mut parts = vec![tables.encode()?];
    let volumes = tables.volumes()?;
    for (number, volume) in (1..).zip(&volumes) {
        let mut part = volume::head(&volumes, number);
        part.resize(volume.file_len() as usize, 0);
        parts.push(part);
    }
    let first = tables.first_sheet_offset()?;
    let ids = (0..tables.clusters.len() as u32).map(ClusterId);
    let sheets =
        ids.clone().zip(&tables.sheets).map(|(id, record)| (first + record.offset, file.sheet_bytes(id)));
    let pages = ids.zip(&tables.clusters).map(|(id, record)| (record.page_offset, Some(file.page_bytes(id))));
    for (offset, stored) in sheets.chain(pages) {
        let (stored, (part, start)) = (stored.unwrap_or_default(), volume::place(&volumes, offset));
        parts[part][start as usize..][..stored.len()].copy_from_slice(stored);
    }
    Ok(parts)
}

/// Opens the file, with each volume by its name.
fn open(parts: &[Vec<u8>]) -> Result<Chpm<Vec<u8>>, FormatError> {
    let model = Path::new("folder/scan.chpm");
    Chpm::open_at(parts[0].clone(), model, |path| {
        let number = (1..parts.len()).find(|number| volume::path(model, *number as u32) == path);
        number.map(|number| parts[number].clone()).ok_or(io::Error::from(io::ErrorKind::NotFound))
    })
}

fn strips() -> Vec<u8> {
    let (mut tables, pages) = sheet(8, 3, 4, Attributes { colors: true, ..Attributes::NONE }).tables();
    tables.header.chunked = true;
    write(&mut tables, &pages)
}

/// Seven clusters, two in a volume.
static GOOD: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| split(&strips(), 12_288).unwrap());

#[test]
fn volumes_change_nothing() {
    for (bytes, size, count) in [
        (strips(), 8192, 7),
        (strips(), 12_288, 4),
        (strips(), 1 << 40, 1),
        (tetrahedron().bytes(), 8192, 1),
        (crate::sheets::bytes(|_, _| ()), 8192, 4),
        (crate::sheets::bytes(|_, _| ()), 9000, 4),
    ] {
        let (parts, whole) = (split(&bytes, size).unwrap(), Chpm::open(bytes.clone()).unwrap());
        assert_eq!(parts.len(), count + 1, "{size}");
        assert!(parts[1..].iter().all(|part| part.len() as u64 <= size));
        let file = open(&parts).unwrap();
        assert_eq!((file.header().version_minor, file.header().required_flags & 64), (9, 64));
        assert_eq!(verify(&file, |_, _| ()).faults, []);
        assert_eq!(same::compare(&file, &whole, || ()).unwrap().told, Vec::<String>::new());
        // Joined, it is what it was.
        let mut tables = Tables::of(&file).unwrap();
        assert_eq!(tables.encode().unwrap(), Tables::of(&whole).unwrap().encode().unwrap());
        assert_eq!(split(&bytes, size).unwrap(), parts);
        let mut text = Vec::new();
        dump(&file, &mut text, true).unwrap();
        let text = String::from_utf8(text).unwrap();
        assert!(text.contains("section VOLUMES ") && text.matches("\nvolume ").count() == count, "{text}");
    }
}

#[test]
fn a_page_that_does_not_fit_is_told() {
    let error = split(&strips(), 8191).unwrap_err().to_string();
    assert!(
        error.contains("size of a volume: expected at least 8192, for the largest page, got 8191"),
        "{error}"
    );
}

#[test]
fn what_is_no_volume_of_it_is_refused_by_name() {
    let fault = |change: &dyn Fn(&mut Vec<Vec<u8>>)| {
        let mut parts = GOOD.clone();
        change(&mut parts);
        match open(&parts) {
            Err(FormatError::Volume { path, fault }) => (path.to_str().unwrap().to_owned(), fault),
            other => panic!("{other:?}"),
        }
    };
    let named = |number: u32| format!("folder/scan.{number:04}.pages");
    assert_eq!(fault(&|parts| parts.truncate(3)), (named(3), VolumeFault::Missing));
    assert_eq!(fault(&|parts| parts.swap(2, 3)), (named(2), VolumeFault::Other { number: 2, other: 3 }));
    let other = split(&sheet(8, 3, 4, Attributes::NONE).bytes(), 12_288).unwrap();
    assert_eq!(fault(&|parts| parts[4] = other[4].clone()), (named(4), VolumeFault::Foreign));
    assert_eq!(fault(&|parts| parts[1] = parts[0].clone()), (named(1), VolumeFault::None));
    let len = GOOD[1].len() as u64;
    for got in [0, len - 1, len + 1] {
        let cut = |parts: &mut Vec<Vec<u8>>| parts[1].resize(got as usize, 0);
        assert_eq!(fault(&cut), (named(1), VolumeFault::Len { expected: len, got }));
    }
    let alone = Chpm::open(GOOD[0].clone()).unwrap_err();
    assert!(
        matches!(alone, FormatError::Apart { count: 4 }) && alone.to_string().contains("relayout"),
        "{alone}"
    );
    let unread = Chpm::open_at(GOOD[0].clone(), Path::new("scan.chpm"), |_| {
        Err::<Vec<u8>, _>(io::Error::from(io::ErrorKind::PermissionDenied))
    });
    assert!(unread.unwrap_err().to_string().contains("'scan.0001.pages'"));
}

/// Each bit of a head matters: what is no volume is refused, and what is not zero is told by `verify`.
#[test]
fn heads_are_looked_at() {
    for at in 0..HEAD_LEN as usize {
        let mut parts = GOOD.clone();
        parts[2][at] ^= 1 << (at % 8);
        match open(&parts) {
            Ok(file) if at >= TOLD => {
                let faults = verify(&file, |_, _| ()).faults;
                assert!(faults[0].to_string().contains("volume 2: zeros in its head"), "{at}: {faults:?}");
            }
            Err(FormatError::Volume { .. }) if at < TOLD => {}
            other => panic!("{at}: {other:?}"),
        }
    }
}

/// Whatever a table of volumes says that is not so is refused, whoever made its checksums right.
#[test]
fn the_table_of_volumes_is_not_believed() {
    let table =
        entries(&GOOD[0]).into_iter().find(|entry| entry.kind == SectionKind::Volumes as u32).unwrap();
    for at in table.offset as usize..(table.offset + table.len) as usize {
        for bit in 0..8 {
            let mut main = GOOD[0].clone();
            main[at] ^= 1 << bit;
            reseal_without_pages(&mut main);
            let mut parts = GOOD.clone();
            parts[0] = main;
            assert!(open(&parts).is_err(), "byte {at}, bit {bit}");
        }
    }
}

/// As [`reseal`], of a file whose pages are elsewhere.
fn reseal_without_pages(main: &mut [u8]) {
    reseal(main);
}

#[test]
fn ranges_of_volumes_say_what_the_whole_says() {
    let whole = open(&GOOD).unwrap();
    let read = |part: usize, offset: u64, out: &mut [u8]| {
        let range = offset as usize..offset as usize + out.len();
        out.copy_from_slice(GOOD[part].get(range).ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    };
    let mut file = RemoteChpm::open(GOOD[0].len() as u64, read).unwrap();
    assert_eq!(file.volumes(), whole.volume_records());
    for id in (0..whole.clusters().len() as u32).map(ClusterId) {
        let (here, there) = (file.page(id).unwrap(), whole.page(id).unwrap());
        assert_eq!(here.view().positions, there.view().positions);
    }
    for len in [0, 256, GOOD[0].len() as u64 - 1, GOOD[0].len() as u64 + 1] {
        assert!(RemoteChpm::open(len, read).is_err(), "{len}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn damage_of_files_with_volumes_never_panics(
        changes in prop::collection::vec((0..GOOD.len(), 0..4096_usize, any::<u8>()), 1..6),
        lens in prop::collection::vec((0..GOOD.len(), 0..20_000_usize), 0..2),
    ) {
        let mut parts = GOOD.clone();
        for (part, at, value) in changes {
            parts[part][at] = value;
        }
        for (part, len) in lens {
            parts[part].resize(len, 7);
        }
        if parts[0].len() >= 4096 {
            reseal_without_pages(&mut parts[0]);
        }
        if let Ok(file) = open(&parts) {
            verify(&file, |_, _| ());
            dump(&file, &mut io::sink(), true).ok();
        }
        let read = |part: usize, offset: u64, out: &mut [u8]| {
            let start = usize::try_from(offset).unwrap();
            let bytes = parts.get(part).and_then(|part| part.get(start..start.checked_add(out.len())?));
            out.copy_from_slice(bytes.ok_or(io::ErrorKind::UnexpectedEof)?);
            Ok(())
        };
        if let Ok(mut file) = RemoteChpm::open(parts[0].len() as u64, read) {
            (0..file.header().cluster_count.min(9)).for_each(|id| drop(file.page(ClusterId(id))));
        }
    }
}
