//! Chained pages: the same meshes at every position, read through all that is above; and damage has a name, wherever it is.

use crate::packed::{any_page, symbols};
use crate::sample;
use crate::sample::{Sample, reseal, sheet, write};
use chpm_format::{
    Chpm, ClusterRecord, FilePart, FormatError, Page, PageParts, RemoteChpm, checksum, packed, same, verify,
};
use chpm_mesh::{Attributes, ClusterId, Octahedral, VertexSlices};
use proptest::prelude::*;
use std::io;

const ALL: Attributes = Attributes::ALL;
const CODED: Attributes = Attributes { octahedral: true, colors: true, ..Attributes::NONE };
const SCALARS: Attributes = Attributes { scalar_words: 4, ..Attributes::NONE };

/// A page's bytes where it can be looked at in place.
fn words(bytes: &[u8]) -> Vec<u32> {
    let mut words = vec![0; bytes.len().div_ceil(4)];
    bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
    words
}

fn in_place<T>(bytes: &[u8], look: impl FnOnce(&Page<'_>) -> T) -> T {
    look(&Page::parse(&bytemuck::cast_slice(&words(bytes))[..bytes.len()]).unwrap())
}

fn chain(raw: &[u8], parent: &[u8], out: &mut Vec<u8>) -> Option<packed::Chained> {
    let raw_words = words(raw);
    in_place(parent, |parent| {
        packed::chain(&bytemuck::cast_slice(&raw_words)[..raw.len()], parent, 0, out).unwrap()
    })
}

fn unchain(chained: &[u8], parent: &Page<'_>, len: usize) -> Result<Vec<u32>, FormatError> {
    let mut words = vec![0u32; len.div_ceil(4)];
    packed::unchain(chained, parent, &mut bytemuck::cast_slice_mut(&mut words)[..len])?;
    Ok(words)
}

/// The triangles at a position, each from its least corner on, with vertices by `number`.
fn mesh(page: &Page<'_>, n: usize, number: impl Fn(u16) -> u16) -> Vec<[u16; 3]> {
    let map = |mut vertex: u16| {
        while usize::from(vertex) >= n {
            vertex = page.targets[usize::from(vertex) - page.base_vertex_count];
        }
        number(vertex)
    };
    let corners = page.triangles.iter().map(|t| t.map(map));
    let mut mesh: Vec<[u16; 3]> = corners
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .map(|[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap())
        .collect();
    mesh.sort_unstable();
    mesh
}

/// Whether a page has the same vertices, under their new numbers, and the same mesh at every position.
fn assert_same(raw: &[u8], ordered: &[u8], vertices: &[u16]) {
    in_place(raw, |old| {
        in_place(ordered, |new| {
            let number = |vertex: u16| vertices[usize::from(vertex)];
            let bits = |p: [f32; 3]| p.map(f32::to_bits);
            for (vertex, own) in (0..).zip(vertices) {
                let (i, j) = (usize::from(vertex), usize::from(*own));
                assert_eq!(bits(old.positions[i]), bits(new.positions[j]));
                assert_eq!(old.normals.get(i).map(|n| bits(*n)), new.normals.get(j).map(|n| bits(*n)));
                assert_eq!(old.octahedral.get(i), new.octahedral.get(j));
                assert_eq!(old.colors.get(i), new.colors.get(j));
                let words = usize::from(old.attributes().scalar_words);
                assert_eq!(old.scalars[i * words..][..words], new.scalars[j * words..][..words]);
                assert_eq!(old.is_shared(vertex), new.is_shared(*own));
            }
            let mut ids: Vec<(u16, u32)> = old.shared().map(|(vertex, id)| (number(vertex), id)).collect();
            ids.sort_unstable();
            assert_eq!(ids, new.shared().collect::<Vec<_>>());
            assert_eq!(old.error_codes, new.error_codes);
            assert_eq!(old.triangles.len(), new.triangles.len());
            let (b, v) = (old.base_vertex_count, old.vertex_count());
            for n in (b..=v).step_by((v - b) / 20 + 1).chain([v]) {
                assert_eq!(mesh(old, n, number), mesh(new, n, |vertex| vertex), "at {n} of {b} to {v}");
            }
        });
    });
}

/// The file with its pages chained, and its pages when they are not.
fn chained_file(sample: &Sample) -> (Vec<u8>, Vec<Vec<u8>>) {
    let (mut tables, mut raw) = sample.tables();
    (tables.header.packed, tables.header.chained) = (true, true);
    let mut stored = Vec::new();
    for id in 0..raw.len() {
        let mut bytes = Vec::new();
        // Clusters come from the top, and each group has one that is coarse.
        let parent = tables.clusters[id].parent_group().0;
        let parent = tables.groups.get(parent as usize).map(|g| tables.members[g.coarse_first as usize]);
        match parent {
            Some(parent) => {
                let chained =
                    chain(&raw[id], &raw[parent as usize], &mut bytes).expect("its base mesh is above");
                assert_same(&raw[id], &chained.raw, &chained.vertices);
                raw[id] = chained.raw;
            }
            None => assert!(packed::pack(&raw[id], &mut bytes).unwrap()),
        }
        let record = &mut tables.clusters[id];
        record.flags |= ClusterRecord::PACKED;
        (record.page_len, record.page_checksum) = (bytes.len() as u32, checksum(&bytes));
        stored.push(bytes);
    }
    (write(&mut tables, &stored), raw)
}

fn remote(bytes: &[u8]) -> RemoteChpm<impl FnMut(usize, u64, &mut [u8]) -> io::Result<()>> {
    let read = move |_: usize, offset: u64, out: &mut [u8]| {
        let start = offset as usize;
        out.copy_from_slice(bytes.get(start..start + out.len()).ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    };
    RemoteChpm::open(bytes.len() as u64, read).unwrap()
}

#[test]
fn a_chained_file_is_sound_shorter_and_has_the_same_meshes() {
    for attributes in [Attributes::NONE, ALL, CODED, SCALARS] {
        let sample = sheet(64, 40, 8, attributes);
        let packed = crate::packed::packed_file(&sample);
        let (bytes, raw) = chained_file(&sample);
        assert!(bytes.len() * 10 < packed.len() * 9, "{} of {}", bytes.len(), packed.len());
        let file = Chpm::open(bytes.clone()).unwrap();
        assert_eq!((file.header().version_minor, file.header().required_flags & 33), (8, 33));
        let report = verify(&file, |_, _| ());
        assert!(report.is_ok(), "{:?}", report.faults);
        let other = Chpm::open(packed).unwrap();
        assert_eq!(same::compare(&file, &other, || ()).unwrap().told, [""; 0]);
        // From the leaves up, so that nothing is here yet.
        for id in (0..raw.len() as u32).map(ClusterId).rev() {
            let own = &raw[id.index()];
            assert_eq!(file.page(id).unwrap().bytes_or(&[]), own);
            let fresh = Chpm::open(bytes.clone()).unwrap();
            assert_eq!(fresh.page(id).unwrap().bytes_or(&[]), own);
            assert_eq!(remote(&bytes).page(id).unwrap().bytes_or(&[]), own);
            let sizes = file.page_sizes(id, &file.page(id).unwrap()).unwrap().iter().sum::<u64>().div_ceil(8);
            // zstd's head and what is left of the last bytes belong to no part.
            assert!(sizes.abs_diff(file.clusters()[id.index()].page_len.into()) < 16);
        }
    }
}

#[test]
fn damage_above_is_told_by_the_page_that_has_it() {
    let (bytes, raw) = chained_file(&sheet(64, 40, 8, Attributes::NONE));
    let leaf = ClusterId(raw.len() as u32 - 1);
    let root = Chpm::open(bytes.clone()).unwrap().clusters()[0];
    let mut damaged = bytes.clone();
    damaged[root.page_offset as usize + 60] ^= 4;
    let is_root = |error: &FormatError| {
        matches!(error, FormatError::Checksum { place: FilePart::Page(ClusterId(0)), .. })
    };
    assert!(is_root(&Chpm::open(damaged.clone()).unwrap().page(leaf).unwrap_err()));
    assert!(is_root(&remote(&damaged).page(leaf).unwrap_err()));
    // Nothing else hangs on the others.
    assert!(Chpm::open(damaged).unwrap().page(ClusterId(0)).is_err());

    // A page that names one above that is not there, in a file whose checksums are right.
    let own = Chpm::open(bytes.clone()).unwrap().clusters()[leaf.index()];
    let mut elsewhere = bytes.clone();
    elsewhere[own.page_offset as usize + 38] = 9;
    reseal(&mut elsewhere);
    let told = Chpm::open(elsewhere.clone()).unwrap().page(leaf).unwrap_err().to_string();
    assert!(told.contains("place of the page above") && told.contains("below 1"), "{told}");
    assert_eq!(remote(&elsewhere).page(leaf).unwrap_err().to_string(), told);

    // Without the flag a chained page is none that is packed.
    let mut unflagged = bytes.clone();
    unflagged[16] &= !32;
    reseal(&mut unflagged);
    assert!(Chpm::open(unflagged).unwrap().page(leaf).unwrap_err().to_string().contains("CPGP"));
    // As version 1.7 had it.
    let mut outdated = bytes.clone();
    outdated[16] ^= 16 | 32;
    reseal(&mut outdated);
    let told = Chpm::open(outdated).unwrap_err().to_string();
    assert!(told.contains("chained pages of version 1.8, not of 1.7; build the file again"), "{told}");
    let mut alone = bytes;
    alone[16] &= !1;
    reseal(&mut alone);
    assert!(Chpm::open(alone).is_err());
}

/// A page whose finest mesh has the base mesh of another, turned and the other way around, and some more.
fn above(page: &Page<'_>, more: usize) -> Vec<u8> {
    let last = page.base_vertex_count as u16 - 1;
    let number = |vertex: u16| last - vertex;
    let mut triangles = mesh(page, page.base_vertex_count, number);
    triangles.iter_mut().enumerate().for_each(|(i, t)| t.rotate_left(i % 3));
    triangles.reverse();
    let extra: Vec<[u16; 3]> = triangles.iter().step_by(3).take(more).map(|[a, b, c]| [*b, *a, *c]).collect();
    triangles.extend(extra);
    fn reversed<T: Copy>(of: &[T], each: usize, count: usize) -> Vec<T> {
        of.chunks_exact(each.max(1))
            .take(count)
            .collect::<Vec<_>>()
            .into_iter()
            .rev()
            .flatten()
            .copied()
            .collect()
    }
    let b = page.base_vertex_count;
    let (positions, normals) = (reversed(page.positions, 1, b), reversed(page.normals, 1, b));
    let (octahedral, colors): (Vec<Octahedral>, _) =
        (reversed(page.octahedral, 1, b), reversed(page.colors, 1, b));
    let scalars = reversed(page.scalars, page.attributes().scalar_words.into(), b);
    // What is shared above has the same id below.
    let ids = page.shared().filter(|(vertex, id)| usize::from(*vertex) < b && id % 2 == 0);
    let mut shared: Vec<(u16, u32)> = ids.map(|(vertex, id)| (number(vertex), id)).collect();
    shared.reverse();
    sample::page(&PageParts {
        vertices: VertexSlices {
            positions: &positions,
            normals: &normals,
            octahedral: &octahedral,
            colors: &colors,
            scalars: &scalars,
        },
        triangles: &triangles,
        shared: &shared,
        ..PageParts::default()
    })
}

/// Chains a page to one above, if it can be, and compares what comes back; whether it was.
fn comes_back(raw: &[u8], parent: &[u8]) -> bool {
    let mut out = b"before".to_vec();
    let Some(chained) = chain(raw, parent, &mut out) else {
        assert_eq!(out, b"before", "nothing is left behind");
        return false;
    };
    assert_same(raw, &chained.raw, &chained.vertices);
    let mut again = Vec::new();
    let twice = chain(&chained.raw, parent, &mut again).expect("once more");
    assert_eq!((again, twice.raw), (out[6..].to_vec(), chained.raw), "what is chained stays as it is");
    true
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_page_comes_back_from_one_above(page in any_page(), more in 0..40usize) {
        comes_back(&page, &in_place(&page, |page| above(page, more)));
    }
}

#[test]
fn pages_of_no_surface_are_chained() {
    // A strip, a fan that is closed, two that touch at a vertex, a triangle twice, and edges of three triangles.
    let fan = |middle: u16, first: u16, count: u16| {
        (0..count).map(move |i| [middle, first + i, first + (i + 1) % count])
    };
    let mut triangles: Vec<[u16; 3]> = fan(0, 1, 30).collect();
    triangles.extend(fan(0, 31, 29));
    triangles.extend((60..90).map(|i| [i, i + 1, i + 2]));
    triangles.extend([[60, 61, 62], [60, 61, 90], [60, 61, 91]]);
    let positions: Vec<[f32; 3]> = (0..92u16).map(|i| [f32::from(i), f32::from(i * 7 % 13), 1.0]).collect();
    let targets: Vec<u16> = (20..92u16).map(|i| if i % 5 == 0 { 0 } else { i - 1 }).collect();
    let errors: Vec<f32> = (0..72).map(|i| 72.0 - i as f32).collect();
    let shared: Vec<(u16, u32)> = (0..92).step_by(4).map(|i| (i, u32::from(i) * 3)).collect();
    let parts = PageParts {
        vertices: VertexSlices { positions: &positions, ..VertexSlices::default() },
        triangles: &triangles,
        targets: &targets,
        errors: &errors,
        shared: &shared,
        ..PageParts::default()
    };
    let page = sample::page(&parts);
    let parent = in_place(&page, |page| above(page, 5));
    assert!(comes_back(&page, &parent));
    // Of a triangle that is not above, nothing can be told.
    let other = in_place(&page, |page| {
        let mut positions = page.positions.to_vec();
        positions[3][0] += 0.25;
        sample::page(&PageParts {
            vertices: VertexSlices { positions: &positions, ..VertexSlices::default() },
            triangles: &triangles,
            targets: &targets,
            errors: &errors,
            shared: &shared,
            ..PageParts::default()
        })
    });
    assert!(!comes_back(&other, &parent));
}

/// Each collapse of a long strip moves all triangles behind it: that is no hierarchy that a build makes, and would take long.
#[test]
fn pages_that_would_take_long_are_not_chained() {
    let page = |count: u16| {
        let positions: Vec<[f32; 3]> = (0..count).map(|i| [f32::from(i), f32::from(i % 2), 0.0]).collect();
        let triangles: Vec<[u16; 3]> = (0..count - 2).map(|i| [i, i + 1, i + 2]).collect();
        let targets: Vec<u16> = (3..count).map(|i| i - 3).collect();
        let errors = vec![1.0; targets.len()];
        sample::page(&PageParts {
            vertices: VertexSlices { positions: &positions, ..VertexSlices::default() },
            triangles: &triangles,
            targets: &targets,
            errors: &errors,
            ..PageParts::default()
        })
    };
    let long = page(30_000);
    assert!(!comes_back(&long, &in_place(&long, |page| above(page, 0))));
}

/// Damaged pages, and good ones with another above them: any is refused, or is a page of the right length. Half of the changes are made behind zstd.
#[test]
fn damaged_chained_pages_are_survived() {
    let mut goods = Vec::new();
    for attributes in [Attributes::NONE, ALL, CODED, SCALARS] {
        let sample = sheet(32, 20, 4, attributes);
        let (bytes, raw) = chained_file(&sample);
        let file = Chpm::open(bytes).unwrap();
        for id in (1..raw.len() as u32).map(ClusterId) {
            let page = file.page_bytes(id);
            let above = file.above(id, page).unwrap().unwrap();
            goods.push((symbols(page), page.to_vec(), raw[above.index()].clone(), raw[id.index()].len()));
        }
    }
    let mut state = 7u64;
    let mut next = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    };
    let [mut refused, mut taken] = [0u64; 2];
    for case in 0..6000 {
        let ((frame, symbols), page, parent, len) = &goods[case % goods.len()];
        let mut bytes = page.clone();
        match next(8) {
            0 => {}
            1..=3 => {
                let at = next(bytes.len());
                bytes[at] ^= 1 << next(8);
            }
            _ => {
                let mut symbols = symbols.clone();
                for _ in 0..=next(3) {
                    let at = next(symbols.len());
                    symbols[at] = next(256) as u8;
                }
                if next(4) == 0 {
                    let bits = 48 + next(*frame - 48);
                    bytes[bits] ^= 1 << next(8);
                }
                bytes.truncate(*frame);
                bytes.extend(zstd::encode_all(&symbols[..], 1).unwrap());
            }
        }
        let parent = if next(4) == 0 { &goods[next(goods.len())].2 } else { parent };
        let survived = in_place(parent, |parent| unchain(&bytes, parent, *len));
        match survived {
            // It is a page like any other, to be checked like any other.
            Ok(words) => taken += u64::from(Page::view(&bytemuck::cast_slice(&words)[..*len]).is_ok()),
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 1000 && taken > 100, "{refused} refused, {taken} taken");
}
