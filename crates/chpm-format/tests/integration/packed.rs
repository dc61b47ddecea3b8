//! Packed pages: every bit comes back, of any page; and what is no packed page is refused.

use crate::sample;
use crate::sample::{Sample, sheet, tetrahedron};
use chpm_format::page::PAGE_HEADER_LEN;
use chpm_format::{
    Chpm, ChpmWriter, ClusterRecord, FormatError, Page, PageParts, Tables, checksum, packed, same, verify,
};
use chpm_mesh::{Attributes, ClusterId, Octahedral, VertexSlices};
use proptest::prelude::*;

const ALL: Attributes = Attributes::ALL;
const COLORS: Attributes = Attributes { colors: true, ..Attributes::NONE };
const SCALARS: Attributes = Attributes { scalar_words: 4, ..Attributes::NONE };
const CODED: Attributes = Attributes { octahedral: true, ..Attributes::NONE };

fn unpacked(packed: &[u8], len: usize) -> Result<Vec<u8>, FormatError> {
    let mut words = vec![0u32; len.div_ceil(4)];
    let raw = &mut bytemuck::cast_slice_mut(&mut words)[..len];
    packed::unpack(packed, raw)?;
    Ok(raw.to_vec())
}

/// Packs a page, whether or not that makes it shorter, and compares what comes back.
fn comes_back(raw: &[u8]) -> usize {
    let mut out = b"before".to_vec();
    if !packed::pack(raw, &mut out).unwrap() {
        assert_eq!(out, b"before", "nothing is left behind");
        return raw.len();
    }
    assert_eq!(unpacked(&out[6..], raw.len()).unwrap(), raw);
    let mut again = Vec::new();
    assert!(packed::pack(raw, &mut again).unwrap());
    assert_eq!(again, out[6..], "the same bytes every time");
    again.len()
}

/// The file with its pages packed.
pub(crate) fn packed_file(sample: &Sample) -> Vec<u8> {
    let (mut tables, mut pages) = sample.tables();
    pack_all(&mut tables, &mut pages);
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).unwrap();
    pages.iter().for_each(|page| writer.page(page).unwrap());
    writer.finish().unwrap()
}

fn pack_all(tables: &mut Tables, pages: &mut [Vec<u8>]) {
    tables.header.packed = true;
    for (record, page) in tables.clusters.iter_mut().zip(pages) {
        let mut packed = Vec::new();
        if packed::pack(page, &mut packed).unwrap() {
            *page = packed;
            record.flags |= ClusterRecord::PACKED;
            (record.page_len, record.page_checksum) = (page.len() as u32, checksum(page));
        }
    }
}

#[test]
fn a_packed_file_is_sound_shorter_and_the_same() {
    for attributes in [Attributes::NONE, ALL, CODED, CODED.joined(COLORS), SCALARS, CODED.joined(SCALARS)] {
        let sample = sheet(64, 40, 4, attributes);
        let (raw, packed) = (Chpm::open(sample.bytes()).unwrap(), Chpm::open(packed_file(&sample)).unwrap());
        assert!(
            packed.bytes().len() * 2 < raw.bytes().len(),
            "{} of {}",
            packed.bytes().len(),
            raw.bytes().len()
        );
        let report = verify(&packed, |_, _| ());
        assert!(report.is_ok(), "{:?}", report.faults);
        assert!((0..raw.clusters().len() as u32).all(|id| packed.is_packed(ClusterId(id))));
        let differences = same::compare(&raw, &packed, || ()).unwrap();
        assert_eq!(differences.told, [""; 0]);
        for id in (0..raw.clusters().len() as u32).map(ClusterId) {
            let page = packed.page(id).unwrap();
            assert_eq!(page.bytes_or(&[]), raw.page_bytes(id));
            assert_eq!(packed.page_viewed(id).unwrap().view().triangles, page.view().triangles);
            assert_eq!(packed.page_len(id), raw.page_bytes(id).len() as u64);
        }
    }
}

/// The bytes of a sheet's first page, packed, with its positions times `scale` and its triangles as told or from their least corners on.
fn packed_len(scale: f32, least: bool) -> usize {
    let mut sample = sheet(64, 40, 4, Attributes::NONE);
    let cluster = &mut sample.clusters[0];
    cluster.positions.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
    for (i, triangle) in cluster.triangles.iter_mut().enumerate() {
        *triangle = least_first(*triangle);
        triangle.rotate_left(if least { 0 } else { i * i % 7 % 3 });
    }
    comes_back(&sample.tables().1[0])
}

#[test]
fn lattices_and_least_corners_are_shorter() {
    let [exact, lattice] = [0.371_246_8, 0.5].map(|scale| packed_len(scale, true));
    assert!(2 * lattice < exact, "{lattice} of {exact}");
    // The step counts for nothing, as long as all are multiples of it.
    for scale in [2f32.powi(-140), 2f32.powi(100), 1.0] {
        assert_eq!(packed_len(scale, true), lattice);
    }
    let turned = packed_len(0.5, false);
    assert!(lattice + 100 < turned, "{lattice} {turned}");
}

#[test]
fn what_differs_between_two_files_is_told() {
    let sample = sheet(16, 8, 2, ALL);
    let file = Chpm::open(sample.bytes()).unwrap();
    let differences = |change: &dyn Fn(&mut Sample)| {
        let mut other = sample.clone();
        change(&mut other);
        same::compare(&file, &Chpm::open(packed_file(&other)).unwrap(), || ()).unwrap()
    };
    assert_eq!(differences(&|_| ()).count, 0);
    // Of triangles the order does not count, nor which corner is the first; their turn does.
    assert_eq!(differences(&|s| s.clusters[0].triangles.reverse()).count, 0);
    assert_eq!(differences(&|s| s.clusters[0].triangles[3].rotate_left(1)).count, 0);
    // A cluster here, one there, and their groups: one in which it is coarse and one in which it is fine, or one for the root.
    assert_ne!(differences(&|s| s.clusters[1].triangles[3].swap(0, 1)).count, 0);
    assert_ne!(differences(&|s| s.clusters[1].positions[0][1] = -0.0).count, 0);
    assert_ne!(differences(&|s| s.clusters[1].colors[2][3] ^= 1).count, 0);
    let origin = differences(&|s| s.header.origin[2] += 1.0);
    assert!(origin.count == 1 && origin.told[0].starts_with("origin: "), "{origin:?}");
}

#[test]
fn a_reader_without_the_flag_refuses_and_an_unknown_flag_is_refused() {
    let mut bytes = packed_file(&sheet(16, 8, 2, ALL));
    assert_eq!(bytes[16..20], [1, 0, 0, 0], "required_flags");
    assert_eq!(bytes[10..12], [2, 0], "version_minor");
    bytes[16] = 129;
    let sum = checksum(&bytes[..248]).to_le_bytes();
    bytes[248..256].copy_from_slice(&sum);
    let error = Chpm::open(bytes).unwrap_err().to_string();
    assert!(error.contains("unknown required feature 0x80"), "{error}");
    // And where no page is packed, nothing has changed.
    assert_eq!(sheet(16, 8, 2, ALL).bytes()[10..20], [1, 0, 0, 1, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn lengths_of_packed_pages_have_bounds() {
    let sample = sheet(64, 40, 4, Attributes::NONE);
    let (mut tables, mut pages) = sample.tables();
    let unpacked = tables.clusters[1].page_len;
    pack_all(&mut tables, &mut pages);
    for (len, legal) in
        [(unpacked, false), (unpacked - 1, true), (unpacked / 64, false), (unpacked / 64 + 1, true)]
    {
        tables.clusters[1].page_len = len;
        assert_eq!(tables.encode().is_ok(), legal, "{len} of {unpacked}");
    }
    // Without the flag of the file, that of a cluster means nothing.
    tables.header.packed = false;
    tables.clusters[1].page_len = unpacked / 2;
    assert!(tables.encode().unwrap_err().to_string().contains("page_len"));
}

#[test]
fn small_pages_come_back_or_stay_as_they_are() {
    let (_, pages) = tetrahedron().tables();
    assert_eq!(comes_back(&pages[0]), 110, "a whole frame of zstd, and yet shorter");
    let point = PageParts {
        vertices: VertexSlices { positions: &[[1.0, 2.0, 3.0]], ..VertexSlices::default() },
        ..PageParts::default()
    };
    let mut page = Vec::new();
    point.encode(&mut page).unwrap();
    comes_back(&page);
    // What is reserved would be lost.
    let (_, pages) = sheet(16, 8, 2, ALL).tables();
    let mut reserved = pages[0].clone();
    reserved[PAGE_HEADER_LEN - 1] = 1;
    assert!(!packed::pack(&reserved, &mut Vec::new()).unwrap());
    assert!(packed::pack(&pages[0][..100], &mut Vec::new()).is_err());
}

/// Coordinates of many kinds: of a text, of a grid, of any bits.
fn coordinate() -> impl Strategy<Value = Vec<f32>> {
    let bits = any::<u32>().prop_map(f32::from_bits);
    let text = (-99_999_i32..99_999, 0_u32..7)
        .prop_map(|(n, places)| (f64::from(n) / 10f64.powi(places as i32)) as f32);
    let fixed = (-9_999_999_i32..9_999_999).prop_map(|n| (f64::from(n) / 1000.0) as f32);
    let small =
        prop_oneof![Just(0.0f32), Just(-0.0), Just(1e-45), Just(f32::MAX), Just(f32::NAN), 0.0f32..1.0];
    let many = |one: BoxedStrategy<f32>| proptest::collection::vec(one, 3..900).boxed();
    // Multiples of one power of two, from the least to more than there are.
    let most = 1 << 24;
    let multiples = proptest::collection::vec(prop_oneof![-most..=most, -300..300], 3..900);
    let lattice = (-149..125i32, multiples).prop_map(|(power, multiples)| {
        multiples.into_iter().map(|n| (f64::from(n) * 2f64.powi(power)) as f32).collect()
    });
    prop_oneof![
        many(bits.boxed()),
        many(text.boxed()),
        many(fixed.boxed()),
        many(small.boxed()),
        lattice.boxed()
    ]
}

/// The triangle from its least corner on.
fn least_first([a, b, c]: [u16; 3]) -> [u16; 3] {
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()
}

/// Any page that a reader takes: triangles over a strip, or of any three vertices.
pub(crate) fn any_page() -> impl Strategy<Value = Vec<u8>> {
    let triangles = proptest::collection::vec((any::<[u16; 3]>(), any::<bool>()), 0..700);
    (coordinate(), triangles, any::<u64>(), 0..6usize).prop_map(|(numbers, triangles, seed, attributes)| {
        let positions: Vec<[f32; 3]> = numbers.as_chunks().0.to_vec();
        let v = positions.len();
        let mut state = seed;
        let mut next = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below.max(1)
        };
        let mut corners = Vec::new();
        for (i, (any, strip)) in triangles.into_iter().enumerate() {
            let at = |k: usize| (k % v) as u16;
            let mut t = if strip { [at(i), at(i + 1), at(i + 2)] } else { any.map(|k| at(k.into())) };
            t.rotate_left(next(3));
            if seed % 2 == 0 {
                t = least_first(t);
            }
            if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
                corners.push(t);
            }
        }
        let base = 1 + next(v);
        let targets: Vec<u16> = (base..v).map(|i| next(i) as u16).collect();
        let mut errors: Vec<f32> = targets.iter().map(|_| next(1000) as f32 / 64.0).collect();
        errors.sort_by(|a, b| b.total_cmp(a));
        let shared: Vec<(u16, u32)> = (0..v as u16)
            .filter(|_| seed % 3 == 0)
            .map(|i| (i, (seed >> 20) as u32 ^ u32::from(i)))
            .collect();
        let normals: Vec<[f32; 3]> = positions.iter().map(|p| p.map(|x| x * 0.1)).collect();
        let colors: Vec<[u8; 4]> =
            positions.iter().map(|_| [next(256) as u8, 7, 255, next(2) as u8]).collect();
        let codes: Vec<Octahedral> = positions
            .iter()
            .map(|_| Octahedral::from_steps([next(4096) as u32, next(4096) as u32]))
            .collect();
        // Words of any bits beside those of a lattice.
        let words = seed as usize / 7 % 4;
        let scalars: Vec<u32> = numbers[..words * v.min(numbers.len() / words.max(1))]
            .iter()
            .map(|x| if next(2) == 0 { x.to_bits() } else { next(1 << 31) as u32 * 2 })
            .collect();
        let scalars = if scalars.len() == words * v { scalars } else { Vec::new() };
        sample::page(&PageParts {
            vertices: VertexSlices {
                positions: &positions,
                scalars: &scalars,
                normals: if attributes % 3 == 1 { &normals } else { &[] },
                octahedral: if attributes % 3 == 2 { &codes } else { &[] },
                colors: if attributes > 2 { &colors } else { &[] },
            },
            triangles: &corners,
            targets: &targets,
            errors: &errors,
            shared: &shared,
            ..PageParts::default()
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_page_comes_back(page in any_page()) {
        comes_back(&page);
    }
}

/// Pages to damage, packed, with the length of each when it is not.
fn goods() -> Vec<(Vec<u8>, usize)> {
    let on_lattice = sheet(16, 8, 2, Attributes::NONE);
    let [mut decimal, mut binary] = [on_lattice.clone(), on_lattice.clone()];
    for (sample, scale) in [(&mut decimal, 0.1), (&mut binary, 0.371_246_8)] {
        for cluster in &mut sample.clusters {
            cluster.positions.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
            cluster.triangles.iter_mut().for_each(|t| *t = least_first(*t));
        }
    }
    let samples = [
        on_lattice,
        decimal,
        binary,
        sheet(24, 12, 2, ALL),
        sheet(24, 12, 2, CODED.joined(COLORS)),
        sheet(24, 12, 2, SCALARS),
    ];
    let pages = samples.iter().flat_map(|sample| sample.tables().1);
    let packed = pages.filter_map(|page| {
        let mut packed = Vec::new();
        packed::pack(&page, &mut packed).unwrap().then_some((packed, page.len()))
    });
    packed.collect()
}

/// The symbols of a packed page, which zstd hides from whoever only changes bytes.
pub(crate) fn symbols(packed: &[u8]) -> (usize, Vec<u8>) {
    let len = |at: usize| u32::from_le_bytes(packed[at..at + 4].try_into().unwrap()) as usize;
    let frame = 48 + len(40) + len(44);
    (frame, zstd::decode_all(&packed[frame..]).unwrap())
}

/// Damaged pages, `cases` of them: any is refused, or is a page of the right length, which is then checked like any other. Half of the changes
/// are made to symbols and open bits behind zstd, so that they reach what reads these.
fn damaged(cases: u64) {
    let goods: Vec<_> = goods().into_iter().map(|(page, len)| (symbols(&page), page, len)).collect();
    let mut state = 1u64;
    let mut next = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    };
    let [mut refused, mut taken] = [0u64; 2];
    for case in 0..cases {
        let ((frame, symbols), page, len) = &goods[case as usize % goods.len()];
        let mut bytes = page.clone();
        if next(2) == 0 {
            let mut symbols = symbols.clone();
            for _ in 0..=next(4) {
                let at = next(symbols.len());
                symbols[at] = match next(3) {
                    0 => next(256) as u8,
                    1 => symbols[at] ^ 1 << next(8),
                    _ => symbols[next(symbols.len())],
                };
            }
            if next(8) == 0 {
                symbols.truncate(next(symbols.len()));
            }
            bytes.truncate(*frame);
            bytes.extend(zstd::encode_all(&symbols[..], 1).unwrap());
        }
        for _ in 0..next(3) {
            let within = if next(4) == 0 { 48 } else { bytes.len() };
            let at = next(within);
            bytes[at] = next(256) as u8;
        }
        if next(16) == 0 {
            bytes.truncate(next(bytes.len()));
        }
        match unpacked(&bytes, *len) {
            Err(_) => refused += 1,
            Ok(raw) => {
                taken += 1;
                let mut words = vec![0u32; raw.len().div_ceil(4)];
                let aligned: &mut [u8] = &mut bytemuck::cast_slice_mut(&mut words)[..raw.len()];
                aligned.copy_from_slice(&raw);
                if let Ok(page) = Page::parse(aligned) {
                    page.progressive_mesh().triangles_at(page.vertices_for(0.01), &mut Vec::new());
                }
            }
        }
    }
    assert!(refused > cases / 8 && taken > cases / 8, "{refused} refused, {taken} taken of {cases}");
}

/// `CHPM_FUZZ_CASES=1000000 cargo test --release -p chpm-format damaged_packed` for more.
#[test]
fn damaged_packed_pages_are_refused_or_read() {
    damaged(std::env::var("CHPM_FUZZ_CASES").map_or(5_000, |cases| cases.parse().expect("a number")));
}

/// Counts of a packed page must be those of its record, or nothing is allocated by them.
#[test]
fn counts_that_are_not_those_of_the_record_are_refused() {
    let (page, len) = &goods()[0];
    for at in [8, 12, 16, 24] {
        for value in [0u32, 1, 65_535, 1 << 29, u32::MAX] {
            let mut bytes = page.clone();
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            assert!(bytes == *page || unpacked(&bytes, *len).is_err(), "{value} at {at}");
        }
    }
    assert!(unpacked(page, len + 1).is_err() && unpacked(page, len - 1).is_err());
    // More symbols than the page has room for.
    let (frame, symbols) = symbols(page);
    let mut bytes = page[..frame].to_vec();
    bytes.extend(zstd::encode_all(&vec![symbols[0]; 1 << 24][..], 1).unwrap());
    assert!(unpacked(&bytes, *len).is_err());
}

/// All open bits are used, and no more: a byte more or less at the end of either part is refused, whatever it holds.
#[test]
fn open_bits_are_as_many_as_symbols_need() {
    const HEAD: usize = 48;
    for (page, len) in goods() {
        let mut end = HEAD;
        for place in [40, 44] {
            let own = u32::from_le_bytes(page[place..place + 4].try_into().unwrap());
            end += own as usize;
            for (change, by) in [(Some(0), 1), (Some(0xff), 1), (None, u32::MAX)] {
                let mut bytes = page.clone();
                match change {
                    Some(byte) => bytes.insert(end, byte),
                    None if own > 0 => drop(bytes.remove(end - 1)),
                    None => continue,
                }
                bytes[place..place + 4].copy_from_slice(&own.wrapping_add(by).to_le_bytes());
                let error = unpacked(&bytes, len).expect_err("not all is used").to_string();
                // Where bits are missing, what is read in their place may be damage of its own.
                let told = change.is_none() || error.contains("as many open bits as symbols need");
                assert!(told, "{place}, {change:?}: {error}");
            }
        }
    }
}
